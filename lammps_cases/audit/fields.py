"""The fields that an audit can check: where LAMMPS shows each at a look, and why it cannot be checked, where it cannot.

A look comes after the forces: there the state (positions, velocities, densities, energies, phases) is the very one that
the evaluation saw, so whatever follows from the state alone can be checked.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from eos_ref.errors import InputError
from eos_ref.model.parameters import Model
from lammps_cases.audit.deck import Deck

# Names of compute rheo/property/atom, with the rank of each, and of the arrays of atoms.
COLUMNS = {
    "coordination": 0,
    "chi": 0,
    "surface": 0,
    "surface/r": 0,
    "surface/divr": 0,
    "surface/n": 1,
    "shift/v": 1,
    "grad/v": 2,
    "stress/v": 2,
    "stress/t": 2,
    "cv": 0,
}
PROPERTIES = {
    "rho": "rho",
    "pressure": "pressure",
    "viscosity": "viscosity",
    "temperature": "temperature",
    "conductivity": "conductivity",
    "heatflow": "heatflow",
    "drho": "drho",
    "f": "f",
}
# In the order of a force evaluation, in which a difference is blamed; then what no look can check.
CHECKED = (
    *("coordination", "rho", "chi", "grad/v", "surface", "surface/r", "surface/n", "surface/divr"),
    *("shift/v", "viscosity", "pressure", "conductivity", "cv", "temperature", "stress/v", "stress/t"),
    *("heatflow", "drho", "f"),
)
NEVER = {
    "x": "it is the state that a look starts from",
    "v": "it is the state that a look starts from",
    "energy": "it is the state that a look starts from",
    "phase": "it is the state that a look starts from; melting and freezing have a history",
    "status": "its bits are not documented; see surface and phase",
}
FIELDS = (*CHECKED, *NEVER)
PAIRWISE = frozenset(CHECKED) - {"pressure", "conductivity", "cv", "temperature"}
KEYWORDS = {"chi": "interface/reconstruct", "shift/v": "shift"}
KEYWORDS |= dict.fromkeys(("surface", "surface/r", "surface/n", "surface/divr"), "surface/detection")
KEYWORDS |= dict.fromkeys(("temperature", "conductivity", "cv", "heatflow"), "thermal")
ALL = "all"
DEFAULT = ("pressure",)


def chosen(names: Iterable[str]) -> tuple[str, ...]:
    """Fields by their names, each once, in the order of a force evaluation; ``all`` stays alone.

    Raises
    ------
    InputError
        An unknown name, or none.
    """
    names = list(names)
    for name in names:
        if name not in (*FIELDS, ALL):
            raise InputError("field", f"must be one of {', '.join((ALL, *FIELDS))}", name, "option --fields")
    if not names:
        raise InputError("fields", "must name at least one", where="option --fields")
    return (ALL,) if ALL in names else tuple(name for name in FIELDS if name in names)


@dataclass(frozen=True)
class Choice:
    """What is checked in a run, and why the rest is not."""

    fields: tuple[str, ...]
    unchecked: dict[str, str]


@dataclass(frozen=True)
class Setting:
    """A run's circumstances beside its model."""

    deck: Deck
    units: str
    triclinic: bool = False
    between: str = ""  # a command that run executes in between and that may change the model


def choose(asked: Sequence[str], model: Model | InputError, setting: Setting) -> Choice:
    """What of the fields asked for can be checked in a run.

    Raises
    ------
    InputError
        A field named explicitly that cannot be.
    """
    fields, unchecked = [], {}
    for name in FIELDS if ALL in asked else asked:
        reason = why_not(name, model, setting)
        if not reason:
            fields.append(name)
        elif ALL in asked:
            unchecked[name] = reason
        else:
            raise InputError(name, f"cannot be checked in this deck: {reason}", where="option --fields")
    return Choice(tuple(fields), unchecked)


def why_not(name: str, model: Model | InputError, setting: Setting) -> str:
    """Why a field cannot be checked; nothing if it can."""
    if name in NEVER:
        return NEVER[name]
    if name == "pressure":
        return ""
    if isinstance(model, InputError):
        return str(model)
    keyword = KEYWORDS.get(name)
    if keyword and not _has(model, keyword):
        return f"fix rheo has no {keyword} in this deck"
    if setting.between:
        return f"run executes commands in between that may change the model ({setting.between})"
    if name not in PAIRWISE or (name == "viscosity" and not is_power(model)):
        return ""
    hidden = setting.deck.hides_pairs() or ("the box is not rectangular" if setting.triclinic else "")
    return hidden or _of_pairs(name, model, setting)


def _has(model: Model, keyword: str) -> bool:
    fix = model.fix
    return {
        "interface/reconstruct": fix.interface_reconstruct,
        "shift": fix.shift is not None,
        "surface/detection": fix.surface_detection is not None,
        "thermal": fix.thermal,
    }[keyword]


def is_power(model: Model) -> bool:
    """Whether a viscosity depends on the velocity gradient."""
    return any(law.style == "power" for law in model.viscosity)


def _of_pairs(name: str, model: Model, setting: Setting) -> str:
    if name == "rho" and not model.fix.rho_sum:
        return "it is integrated from step to step; only rho/sum makes it a function of the positions"
    if name not in ("heatflow", "drho", "f"):
        return ""
    if corrected_by_hidden_densities(model):
        return "the reproducing kernels saw densities of walls from before their reconstruction"
    deck = setting.deck
    added = ""
    if name == "f" and setting.units in ("real", "metal", "electron"):
        added = f"in units {setting.units} force over mass is no acceleration"
    elif name != "drho":
        added = deck.adds_force() if name == "f" else deck.adds_heat()
    return added or deck.changes_pairs()


def corrected_by_hidden_densities(model: Model) -> bool:
    """Whether the matrices of reproducing kernels held densities of walls that no look can see."""
    return model.corrects_gradients and model.fix.interface_reconstruct and not model.fix.rho_sum
