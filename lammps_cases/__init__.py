"""lammps_cases: scenes, real LAMMPS and the reference, comparison, reports and the ``eos-ref`` command.

The commands that judge are functions as well, and return their results instead of printing them:

>>> from lammps_cases import audit, compare, run
>>> run("near-rho0.*").headline.state
'PASS'

It also has the calculators for ASE, `EosRefCalculator` and `LammpsRheoCalculator`.

All are imported on use. `run` and `audit` are packages of the harness too, so these packages are
callable.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lammps_cases.audit.command import audit
    from lammps_cases.run.calculators import EosRefCalculator, LammpsRheoCalculator
    from lammps_cases.run.command import run
    from lammps_cases.versions.command import compare

__all__ = ["EosRefCalculator", "LammpsRheoCalculator", "audit", "compare", "run"]


def __getattr__(name: str) -> Any:
    """Import a function or a class when it is first used."""
    if name in ("EosRefCalculator", "LammpsRheoCalculator"):
        return getattr(import_module("lammps_cases.run.calculators"), name)
    if name == "compare":
        return import_module("lammps_cases.versions.command").compare
    if name in ("audit", "run"):
        return import_module(f"lammps_cases.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
