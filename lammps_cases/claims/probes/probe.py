"""Probes: edited commands of small decks, and LAMMPS' reaction to them.

The reaction is one word: the error is clear or not, nothing is reported, or LAMMPS dies.
"""

from __future__ import annotations

import functools
import re
import tempfile
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, TypeAdapter

from eos_ref import InputError
from lammps_cases.claims.probes.run import Reply
from lammps_cases.engine.session import Job, RunCommand
from lammps_cases.records.case_wording import error_text
from lammps_cases.records.files import DATA
from lammps_cases.records.wording import one_line
from lammps_cases.records.yaml_files import read_yaml
from lammps_cases.scene import atoms, casefile
from lammps_cases.setup import reference_side
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan

FOLDER = DATA / "probes"

Edits = tuple[tuple[str, str], ...]  # texts and their replacements: nothing, or several lines
Commands = tuple[str, ...]
Input = Commands | Job  # of a deck; of a scene, whose particles LAMMPS receives as arrays
Reaction = Literal[
    "clear error",
    "vague error",
    "misleading error",
    "warning",
    "no effect",
    "silent acceptance",
    "silent NaN",
    "crash",
    "hang",
]
REACTIONS: tuple[Reaction, ...] = get_args(Reaction)
ERRORS: tuple[Reaction, ...] = ("clear error", "vague error", "misleading error")


class Probe(BaseModel):
    """An input given to LAMMPS.

    Attributes
    ----------
    id : its name
    base : the deck or scene that is changed
    edits : texts replaced in the commands of the base; each occurs there exactly once
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
        """Return the input for LAMMPS.

        Raises
        ------
        InputError
            A text to be replaced occurs in no command of the base, or in several.
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
    """Replace texts in commands; an empty line is dropped."""
    text = "\n".join(lines)
    for old, new in edits:
        text = text.replace(old, new)
    return tuple(line for line in text.split("\n") if line)


def edited(name: str, edits: Edits) -> Input:
    """Edit the commands of a base.

    Raises
    ------
    InputError
        A text to be replaced occurs in no command, or in several.
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
    """Load a changed base as ``eos-ref run`` loads a scene: read from a file, its particles placed, its state checked.

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


def error_words(error: str) -> str:
    """Return LAMMPS' own words of an error: without the place in its source, and the command, which it repeats."""
    return one_line(re.sub(r"ERROR( on proc \d+)?:|For more information see \S+", "", error_text(error)))


def offending(probe: Probe) -> tuple[str, ...]:
    """Return the words of an input that its base lacks, without single digits, which many texts contain."""
    before = commands(base(probe.base))
    present = set(" ".join(before).split())
    new = [word for line in probe.add for word in line.split() if word not in present]
    for line in before:
        first, *more = replaced((line,), probe.edits) or ("",)
        new += (Counter(first.split()) - Counter(line.split())).elements()
        new += (word for other in more for word in other.split() if word not in present)
    return tuple(word for word in dict.fromkeys(new) if not re.fullmatch(r"\d", word))


def names_it(text: str, names: Sequence[str]) -> bool:
    """Return whether a text contains one of the words, whole and in any case; latent/heat may be spelt latent heat."""

    def held(name: str) -> bool:
        spelt = "[/_ ]".join(map(re.escape, re.split("[/_ ]", name)))
        return bool(re.search(rf"(?<![\w./-]){spelt}(?![\w/])(?!\.\d)", text, re.IGNORECASE))

    return any(map(held, names))


def reaction(
    reply: Reply, names: Sequence[str], others: Sequence[str] = (), control: Reply | None = None
) -> tuple[Reaction, str]:
    """Return the class of LAMMPS' reaction to an input, and its text.

    An error is *clear* if it contains one of the names of what is wrong; *misleading* if instead it contains one of the
    words for something else; else *vague*. Where LAMMPS goes on, it is a *warning* if its log has one that
    the control's has not, *silent NaN* if any number of the particles after the last step is not finite, *no effect* if
    all numbers are those of the control, to the last bit, and *silent acceptance* if they differ.

    Parameters
    ----------
    names, others : sequence of str
        What is wrong, and what is not, in the manual's words.
    control : Reply, optional
        To the same input without what is wrong; without it nothing is classified as no effect.

    Raises
    ------
    RuntimeError
        The harness failed, not LAMMPS.
    """
    match reply.ended:
        case "answered":
            return _accepted(reply, control)
        case "crashed":
            return "crash", reply.error
        case "timeout":
            return "hang", reply.error
        case "error":
            raise RuntimeError(reply.error)
        case "lost":  # the harness counts atoms; LAMMPS itself reported nothing
            return "silent acceptance", error_words(reply.error)
    text = error_words(reply.error)
    if names_it(text, names):
        return "clear error", text
    return "misleading error" if names_it(text, others) else "vague error", text


def warnings(reply: Reply) -> list[str]:
    """Return the warnings of a log, in its order, without the place in LAMMPS' source."""
    lines = [line for line in reply.log.splitlines() if line.startswith("WARNING")]
    return [one_line(re.sub(r"WARNING( on proc \d+)?:|\([^()]*\.(cpp|h):\d+\)", "", line)) for line in lines]


def _accepted(reply: Reply, control: Reply | None) -> tuple[Reaction, str]:
    numbers = {name.removeprefix("q."): np.asarray(v, float) for name, v in reply.arrays.items() if name != "id"}
    wrong = {name: ~np.isfinite(v).all(axis=tuple(range(1, v.ndim))) for name, v in numbers.items()}
    bad = {name: int(wrong_n.sum()) for name, wrong_n in wrong.items() if wrong_n.any()}
    p_n = numbers.get("pressure", np.zeros(0))
    text = f"pressure {p_n.min():.4g} to {p_n.max():.4g}" if p_n.size else "no atoms"
    if bad:
        counts = ", ".join(f"{name} of {count}" for name, count in sorted(bad.items()))
        text = f"not finite: {counts} of {len(next(iter(numbers.values())))} atoms"
    given = warnings(control) if control else []
    if new := [line for line in warnings(reply) if line not in given]:
        return "warning", f"{new[0]}; {text}"
    if bad:
        return "silent NaN", text
    if control is not None and same(reply.arrays, control.arrays):
        return "no effect", text
    return "silent acceptance", text


def same(one: dict[str, Any], other: dict[str, Any]) -> bool:
    """Return whether arrays are the same to the last bit."""
    return one.keys() == other.keys() and all(np.array_equal(one[name], other[name]) for name in one)
