"""eos_ref: an independent reference for the fluids of LAMMPS' RHEO package.

Written from the LAMMPS manual and the published papers, never from LAMMPS' source. Physics only: no LAMMPS,
no files, no command line.

>>> from eos_ref import EOS
>>> water = EOS("tait/water", rho0=1000.0, cs=10.0)
>>> print(f"{water.pressure(1010.0):.4f}")
1030.5050
"""

from eos_ref.eos.law import Interval
from eos_ref.eos.registry import STYLES
from eos_ref.eos.table import EOS, EOSTable
from eos_ref.errors import InputError
from eos_ref.syntax.fixes import FixRheo, parse_fix_rheo, parse_fix_rheo_pressure, resolve
from eos_ref.syntax.ranges import type_range

__all__ = [
    "EOS",
    "STYLES",
    "EOSTable",
    "FixRheo",
    "InputError",
    "Interval",
    "parse_fix_rheo",
    "parse_fix_rheo_pressure",
    "resolve",
    "type_range",
]
