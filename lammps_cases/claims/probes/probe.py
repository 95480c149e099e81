"""A probe: a harmless deck or scene (``bases.yaml``), and the edits of its commands."""

from __future__ import annotations

import functools
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, TypeAdapter

from eos_ref import InputError
from lammps_cases.engine.session import Job, RunCommand
from lammps_cases.records.files import DATA
from lammps_cases.records.yaml_files import read_yaml
from lammps_cases.scene import atoms, casefile
from lammps_cases.setup import reference_side
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan

FOLDER = DATA / "probes"

Edits = tuple[tuple[str, str], ...]  # texts, and what stands in their place: nothing, or several lines
Commands = tuple[str, ...]
Input = Commands | Job  # of a deck; of a scene, whose particles LAMMPS is given as arrays


class Probe(BaseModel):
    """What is put to LAMMPS.

    Attributes
    ----------
    id : its name
    base : the deck or scene that is changed
    edits : texts replaced in the commands of the base; each stands there exactly once
    add : commands in front of those that follow the particles of a scene
    drop : per-atom arrays of a scene that are not given, ``atoms`` for all particles
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    id: str
    base: str
    edits: Edits = ()
    add: Commands = ()
    drop: tuple[str, ...] = ()

    @property
    def input(self) -> Input:
        """Return what LAMMPS is given.

        Raises
        ------
        InputError
            A text to be replaced stands in no command of the base, or in several.
        """
        given = edited(self.base, self.edits)
        if not isinstance(given, Job):
            return given
        kept = {name: values_n for name, values_n in given.per_atom.items() if name not in self.drop}
        given = replace(given, commands=self.add + given.commands, per_atom=kept)
        if "atoms" in self.drop:
            arrays = {name: getattr(given, name)[:0] for name in ("id_n", "type_n", "x_nc")}
            given = replace(given, **arrays, v_nc=None, per_atom={})
        return given


P = TypeVar("P", bound=Probe)


def load(name: str, kind: type[P]) -> tuple[P, ...]:
    """Read the probes of a file in this folder, in its order."""
    return TypeAdapter(tuple[kind, ...]).validate_python(read_yaml(FOLDER / name, "probes"))  # type: ignore[valid-type]


def commands(given: Input) -> Commands:
    """List all commands, run commands included, in order."""
    if not isinstance(given, Job):
        return given
    return *given.setup, *given.commands, *(run.command for run in given.runs if isinstance(run, RunCommand))


def replaced(lines: Commands, edits: Edits) -> Commands:
    """Replace texts in commands; a line that is left empty is none."""
    text = "\n".join(lines)
    for old, new in edits:
        text = text.replace(old, new)
    return tuple(line for line in text.split("\n") if line)


def edited(name: str, edits: Edits) -> Input:
    """Edit the commands of a base.

    Raises
    ------
    InputError
        A text to be replaced stands in no command, or in several.
    """
    given = base(name)
    text = "\n".join(commands(given))
    for old, _ in edits:
        if text.count(old) != 1:
            raise InputError(f"edit {old!r}", f"must stand once in the commands of {name}", text.count(old))
    if not isinstance(given, Job):
        return replaced(given, edits)
    runs = (
        replace(run, command="\n".join(replaced((run.command,), edits))) if isinstance(run, RunCommand) else run
        for run in given.runs
    )
    setup, physics = replaced(given.setup, edits), replaced(given.commands, edits)
    return replace(given, setup=setup, commands=physics, runs=tuple(runs))


# --- bases


@functools.cache
def _bases() -> dict[str, dict[str, Any]]:
    content: dict[str, dict[str, Any]] = read_yaml(FOLDER / "bases.yaml", "bases of probes")
    return content


@functools.cache
def base(name: str) -> Input:
    """Return the commands of a deck, or the job of a scene."""
    if name in _bases()["scenes"]:
        case, laid = load_scene(name, {})
        return job(case.scene, laid, plan(case.scene))
    deck = _bases()["decks"][name]
    if "of" in deck:
        return edited(deck["of"], tuple(map(tuple, deck["edits"])))
    return tuple(deck["commands"].splitlines())


def load_scene(name: str, changes: Mapping[str, Any]) -> tuple[casefile.Case, atoms.Atoms]:
    """Take a changed base as ``eos-ref run`` takes a scene: read from a file, its particles laid, its state checked.

    Raises
    ------
    InputError
    """
    scenes = _bases()["scenes"]
    content = casefile.merge(casefile.merge(scenes["one"], scenes[name]), changes)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "input.yaml"
        file.write_text(yaml.safe_dump({"name": "input", "about": "An input.", "scene": content}))
        case = casefile.load_file(file)[0]
    laid = atoms.build(case, case.scene.eos())
    reference_side.state(case.scene, laid)
    return case, laid
