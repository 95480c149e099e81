"""eos_ref: an independent reference for the fluids of LAMMPS' RHEO package, and its comparison with LAMMPS.

The reference is written from the LAMMPS manual and the published papers, never from LAMMPS' source. The packages below
are physics only: no LAMMPS, no files, no command line.

>>> from eos_ref import EOS
>>> water = EOS("tait/water", rho0=1000.0, cs=10.0)
>>> print(f"{water.pressure(1010.0):.4f}")
1030.5050

The commands that judge are functions as well, and return their results instead of printing them. They belong to the
harness, the package `lammps_cases`, which is imported when one of its names is first used:

>>> from eos_ref import audit, compare, run
>>> run("near-rho0.*").headline.state
'PASS'
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
    "ComparisonResult",
    "CompiledEvaluator",
    "EOSTable",
    "EngineMissing",
    "EosRefCalculator",
    "FixRheo",
    "Force",
    "InputError",
    "Interval",
    "LammpsRheoCalculator",
    "Model",
    "PairRheo",
    "Result",
    "Shift",
    "Simulation",
    "State",
    "SurfaceDetection",
    "Thermal",
    "Viscosity",
    "audit",
    "compare",
    "parse_fix_rheo",
    "parse_fix_rheo_pressure",
    "resolve",
    "run",
    "type_range",
]

# Imported when they are first used: laws alone do without the particle model, and all of the reference without the
# harness around it, which is named here and imported nowhere.
_LATER = {
    "ArrayEvaluator": "eos_ref.evaluation.array_evaluator",
    "CompiledEvaluator": "eos_ref.compiled.evaluator",
    "Simulation": "eos_ref.evaluation.time_step",
    "Box": "eos_ref.model.box",
    "State": "eos_ref.model.state",
    **dict.fromkeys(("Force", "Model", "PairRheo", "Thermal", "Viscosity"), "eos_ref.model.parameters"),
    "audit": "lammps_cases.audit.command",
    **dict.fromkeys(("compare", "ComparisonResult"), "lammps_cases.versions.command"),
    **dict.fromkeys(("run", "Result"), "lammps_cases.run.command"),
    **dict.fromkeys(("EosRefCalculator", "LammpsRheoCalculator"), "lammps_cases.run.calculators"),
    "EngineMissing": "lammps_cases.engine.session",
}


def _by_method(*arguments: Any) -> Any:
    """See `eos_ref.methods.choice.pressure`, which is imported when it is first used: most users do without it."""
    from eos_ref.methods import choice

    return choice.pressure(*arguments)


EOS.by_method = _by_method


def __getattr__(name: str) -> Any:
    """Import what is imported when it is first used."""
    if name in _LATER:
        return getattr(import_module(_LATER[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
