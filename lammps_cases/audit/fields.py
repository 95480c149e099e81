"""The fields that an audit can check, and the reasons why it cannot check the others.

A sample is taken after the forces: there the state (positions, velocities, densities, energies, phases) is that of the
evaluation, so that whatever follows from the state alone can be checked.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy.typing as npt

from eos_ref.errors import InputError, nearest
from eos_ref.model.box import TILTED
from eos_ref.model.parameters import Model
from eos_ref.model.quantities import QUANTITIES, dependencies, has, keyword_of
from lammps_cases.audit.deck import Deck
from lammps_cases.scene.fields import FIELDS

Array = npt.NDArray[Any]
ALL = "all"
DEFAULT = (ALL,)
ABSENT = "fix rheo of this deck has no such feature"  # where all fields are requested
INTEGRATED = "integrated over time; it can be checked only with rho/sum"
PRESSURE = ("pressure",)
SHELLS = "with fix rheo/oxidation it depends on the bonds of the step before"


def checked() -> tuple[str, ...]:
    """Return the fields that an audit can check, in the order of a force evaluation, which blame follows."""
    return tuple(name for name in QUANTITIES if name in FIELDS and FIELDS[name].unaudited == "")


def offered() -> tuple[str, ...]:
    """Return the names that a user may give: fields that an audit can check, then those that it cannot."""
    return (*checked(), *(name for name in QUANTITIES if name in FIELDS and FIELDS[name].unaudited))


def unaudited() -> dict[str, str]:
    """Return the fields that no audit of a running deck checks, with the reason of each."""
    return {name: reason for name in offered() if (reason := FIELDS[name].unaudited)}


def chosen(names: Iterable[str]) -> tuple[str, ...]:
    """Return fields by their names, each once, in the order of a force evaluation; ``all`` stays alone.

    Raises
    ------
    InputError
        An unknown name, or no name.
    """
    names = list(names)
    for name in names:
        if name not in (*offered(), ALL):
            raise InputError(
                "field",
                f"must be one of {', '.join((ALL, *offered()))}{nearest(name, offered())}",
                name,
                "option --fields",
            )
    if not names:
        raise InputError("fields", "must name at least one", where="option --fields")
    return (ALL,) if ALL in names else tuple(name for name in offered() if name in names)


def out_of_scope(reasons: Iterable[tuple[str, str]]) -> list[str]:
    """Return those of some fields that no audit of a deck checks, with the reasons why they are not checked."""
    ordinary = {ABSENT, INTEGRATED, *unaudited().values()}
    pairs = list(reasons)
    others = {name for name, reason in pairs if reason not in ordinary}
    return [name for name in dict.fromkeys(name for name, _ in pairs) if name not in others]


@dataclass(frozen=True)
class Choice:
    """The fields checked in a run, and why each of the others is not."""

    fields: tuple[str, ...]
    unchecked: dict[str, str]


@dataclass(frozen=True)
class Setting:
    """The setting of a run apart from its model."""

    deck: Deck
    units: str
    open_tilt: bool = False  # whether the box is tilted along an axis that is not periodic
    between: str = ""  # a command that the run executes in between and that may change the model
    massless: bool = False  # whether periodic images lack the masses that particles have of their own
    forces: str = ""  # what adds to the forces of pairs and is not followed
    heat: str = ""  # what adds to the heat flows
    shells: bool = False  # whether it is known which particles had bonds of fix rheo/oxidation in the step before


def choose(requested: Sequence[str], model: Model | InputError, setting: Setting) -> Choice:
    """Choose those of the requested fields that can be checked in a run.

    Raises
    ------
    InputError
        A field named explicitly that cannot be.
    """
    fields, unchecked = [], {}
    for name in offered() if ALL in requested else requested:
        reason = why_not(name, model, setting)
        if not reason:
            fields.append(name)
        elif ALL in requested:
            unchecked[name] = ABSENT if absent(name, model) else reason
        else:
            raise InputError(name, f"cannot be checked in this deck: {reason}", where="option --fields")
    return Choice(tuple(fields), unchecked)


def absent(name: str, model: Model | InputError) -> bool:
    """Return whether a model does not have a field."""
    return isinstance(model, Model) and not has(model, keyword_of(name))


def why_not(name: str, model: Model | InputError, setting: Setting) -> str:
    """Return why a field cannot be checked; nothing if it can."""
    if reason := FIELDS[name].unaudited:
        return reason
    if name == "pressure":
        return ""
    if isinstance(model, InputError):
        return str(model)
    if absent(name, model):
        return f"fix rheo has no {keyword_of(name)} in this deck"
    if name == "shift/v" and setting.deck.fix("rheo/oxidation") and not setting.shells:
        return SHELLS
    if setting.between:
        return f"run executes commands in between that may change the model ({setting.between})"
    if name != "rho" and not needs(name, "pairs", model):
        return ""
    if setting.open_tilt:
        return "the box is tilted along an axis that is not periodic"
    if setting.massless and needs(name, "rho", model):
        return "periodic images have no rmass (fix property/atom without 'ghost yes')"
    return setting.deck.hides_pairs() or _of_pairs(name, model, setting)


def leans_open(tilt: Sequence[float], periodic: Sequence[bool]) -> bool:
    """Return whether a box, tilted by xy, xz and yz, is tilted along an axis that is not periodic."""
    return any(lean and not all(periodic[axis] for axis in axes) for lean, axes in zip(tilt, TILTED, strict=False))


def needs(name: str, quantity: str, model: Model) -> bool:
    """Return whether a field depends on a quantity of the evaluation or of the state."""
    return quantity in dependencies(model, name)


def _of_pairs(name: str, model: Model, setting: Setting) -> str:
    if needs(name, "v", model) and (moving := setting.deck.moves_images()):
        return moving
    if name == "rho" and not model.fix.rho_sum:
        return INTEGRATED
    if FIELDS[name].stage != "pair":
        return ""
    if corrected_by_hidden_densities(model):
        return "the reproducing kernels use wall densities from before the reconstruction, which LAMMPS does not output"
    deck = setting.deck
    if name == "f" and setting.units in ("real", "metal", "electron"):
        return f"in units {setting.units} force over mass is not an acceleration"
    added = {"f": setting.forces, "heatflow": setting.heat}.get(name)
    return added or deck.changes_pairs()


def corrected_by_hidden_densities(model: Model) -> bool:
    """Return whether the matrices of reproducing kernels held densities of walls that LAMMPS never shows."""
    return model.corrects_gradients and model.fix.interface_reconstruct and not model.fix.rho_sum
