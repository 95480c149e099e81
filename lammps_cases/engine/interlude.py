"""Actions in LAMMPS between two runs: commands, some for each atom, some that it must refuse."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy.typing as npt

Array = npt.NDArray[Any]
# Arrays of atoms that hold the state; those that an atom style lacks are left out.
STATE = ("type", "x", "v", "rho", "rheo_status", "esph", "rmass")
FOLDER = "{folder}"  # in a command: a folder for files that lives as long as the job


@dataclass(frozen=True)
class InterludeAction:
    """One command, or one for each of the atoms.

    Attributes
    ----------
    text : with ``{folder}``; for atoms with the values before: ``{id}``, ``{type}``, ``{x}``, ``{vx}``, ``{phase}``...
    how : "refused": LAMMPS must refuse it, and continues to be used
    last : the number of atoms it applies to, those of the highest ids
    evaluates : whether it evaluates forces, with its own neighbour list
    """

    text: str
    how: Literal["given", "refused", "for each atom"] = "given"
    last: int = 0
    evaluates: bool = False


@dataclass(frozen=True)
class Interlude:
    """Actions between two runs, in order, after which the state of every atom must be unchanged.

    Attributes
    ----------
    moves : whether they move atoms
    sets_up : whether the next run sets up, with its own neighbour list
    """

    actions: tuple[InterludeAction, ...]
    moves: bool = False
    sets_up: bool = True


@dataclass(frozen=True)
class Carried:
    """The state of all atoms before and after an interlude, sorted by id."""

    before: dict[str, Array]
    after: dict[str, Array]


class NotRefused(Exception):
    """LAMMPS accepted a command that it must refuse."""


def perform(
    lmp: Any,
    interlude: Interlude,
    state: Callable[[], dict[str, Array]],
    folder: str,
    refusal: type[Exception],
    evaluated: Callable[[], None] = lambda: None,
) -> Carried:
    """Perform all actions between two runs.

    Parameters
    ----------
    state : callable
        Reads the existing arrays of `STATE`, sorted by id.
    folder : str
        Folder of the job's files.
    refusal : class
        LAMMPS' own errors as raised by the library.
    evaluated : callable
        Called after every action that evaluates forces.

    Raises
    ------
    NotRefused
    """
    before = state()
    for action in interlude.actions:
        text = action.text.replace(FOLDER, folder)
        if action.how == "for each atom":
            lmp.commands_string("\n".join(text.format(**row) for row in rows(before, action.last)))
        elif action.how == "refused":
            _refused(lmp, text, refusal)
        else:
            lmp.command(text)
        if action.evaluates:
            evaluated()
    return Carried(before, state())


def _refused(lmp: Any, command: str, refusal: type[Exception]) -> None:
    try:
        lmp.command(command)
    except refusal as error:
        if type(error) is not refusal:  # after an error on one rank the instance must not be used again
            raise
        return
    raise NotRefused(f"LAMMPS accepted what it must refuse: {command}")


def rows(arrays: Mapping[str, Array], last: int) -> list[dict[str, str]]:
    """Return the values of the last atoms as texts that read back as the same numbers, vectors by x, y, z."""
    first = len(arrays["id"]) - last
    named: dict[str, Array] = {"phase": arrays["rheo_status"] & 1}
    for name, array in arrays.items():
        if array.ndim == 1:
            named[name] = array
        else:
            named |= {f"{'' if name == 'x' else name}{axis}": array[:, k] for k, axis in enumerate("xyz")}
    return [{name: repr(array[k].item()) for name, array in named.items()} for k in range(first, first + last)]


def scratch() -> tempfile.TemporaryDirectory[str]:
    """Return a new folder for the files of a job."""
    return tempfile.TemporaryDirectory(prefix="eos-ref-files-")
