"""eos_ref: an independent reference for the fluids of LAMMPS' RHEO package.

Written from the LAMMPS manual and the published papers, never from LAMMPS' source. Physics only: no LAMMPS,
no files, no command line.

>>> from eos_ref import EOS
>>> water = EOS("tait/water", rho0=1000.0, cs=10.0)
>>> print(f"{water.pressure(1010.0):.4f}")
1030.5050
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from eos_ref.eos.law import Interval
from eos_ref.eos.registry import STYLES
from eos_ref.eos.table import EOS, EOSTable
from eos_ref.errors import InputError
from eos_ref.syntax.fixes import FixRheo, Shift, SurfaceDetection, parse_fix_rheo, parse_fix_rheo_pressure, resolve
from eos_ref.syntax.ranges import type_range

if TYPE_CHECKING:
    from eos_ref.compiled.evaluator import CompiledEvaluator
    from eos_ref.evaluation.array_evaluator import ArrayEvaluator
    from eos_ref.evaluation.time_step import Simulation
    from eos_ref.model.box import Box
    from eos_ref.model.parameters import Force, Model, PairRheo, Thermal, Viscosity
    from eos_ref.model.state import State

__all__ = [
    "EOS",
    "STYLES",
    "ArrayEvaluator",
    "Box",
    "CompiledEvaluator",
    "EOSTable",
    "FixRheo",
    "Force",
    "InputError",
    "Interval",
    "Model",
    "PairRheo",
    "Shift",
    "Simulation",
    "State",
    "SurfaceDetection",
    "Thermal",
    "Viscosity",
    "parse_fix_rheo",
    "parse_fix_rheo_pressure",
    "resolve",
    "type_range",
]

_LATER = {
    "ArrayEvaluator": "evaluation.array_evaluator",
    "CompiledEvaluator": "compiled.evaluator",
    "Simulation": "evaluation.time_step",
    "Box": "model.box",
    "State": "model.state",
    **dict.fromkeys(("Force", "Model", "PairRheo", "Thermal", "Viscosity"), "model.parameters"),
}


def _by_method(*arguments: Any) -> Any:
    """See `eos_ref.methods.choice.pressure`, which is imported when it is first used: most users do without it."""
    from eos_ref.methods import choice

    return choice.pressure(*arguments)


EOS.by_method = _by_method


def __getattr__(name: str) -> Any:
    """Import the particle model when it is first used: laws alone do without it."""
    if name in _LATER:
        return getattr(import_module(f"eos_ref.{_LATER[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
