"""Decks in the style of LAMMPS' examples, with their logs: flows that compare a number with the reference's at the end.

A deck prints what it obtained, what the reference gives, and PASS or FAIL; its log is that of the LAMMPS that ran it.
"""

from __future__ import annotations

import functools
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lammps_cases.bugs import bare, deck
from lammps_cases.bugs.deck import BugDeck, Check
from lammps_cases.bugs.upstream.form import with_manual
from lammps_cases.ci.kits.files import KitFile
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.engine.installations import Engine
from lammps_cases.engine.session import EngineMissing
from lammps_cases.records.files import DATA
from lammps_cases.scene import casefile
from lammps_cases.scene.atoms import build, seed
from lammps_cases.setup import commands
from lammps_cases.setup.plan import plan
from lammps_cases.verdict.problems import problem_of

CASES = DATA / "upstream" / "examples.yaml"
FOLDER = "examples/rheo/reference"  # in LAMMPS' tree
THERMO = 20  # steps between lines of the log


@dataclass(frozen=True)
class UpstreamExample:
    """A deck by its name, with its data file."""

    name: str
    deck: BugDeck

    @property
    def files(self) -> dict[str, str]:
        """Return the input deck and the data file by name."""
        text = self.deck.text.replace(deck.DATA, self.data_name)
        return {f"in.{self.name}": text, self.data_name: self.deck.data}

    @property
    def data_name(self) -> str:
        """Return the name of the data file."""
        return f"data.{self.name}"


@functools.cache
def cases() -> tuple[casefile.Case, ...]:
    """Return the cases that the decks are made of."""
    return tuple(with_manual(case) for case in casefile.load_file(CASES))


@functools.cache
def examples() -> tuple[UpstreamExample, ...]:
    """Return all examples; the number is the largest of the field compared, with its bound."""
    return tuple(_example(case) for case in cases())


def _example(case: casefile.Case) -> UpstreamExample:
    scene = case.scene
    atoms = build(case, scene.eos(case.where))
    job = commands.job(scene, atoms, plan(scene))
    (field,), last = scene.compare, scene.snapshots[-1]
    prediction = Predictor().predict(
        problem_of(scene, atoms, case.where, (last,)), seed=seed(f"{case.name}/moved runs")
    )
    value = np.asarray(prediction.fields[0][field])
    at = tuple(int(k) for k in np.unravel_index(int(np.abs(value).argmax()), value.shape))
    bound = float(np.broadcast_to(prediction.bounds[0][field], value.shape)[at])
    check = Check(deck.word(job, field, at[0] + 1, at[1:]), repr(float(value[at])), bound)
    made = deck.of_number(job, last, check)
    about = (f"# {case.about}", f"# {field} of atom {at[0] + 1} after {last} steps, by eos-ref's reference")
    lines = [line.replace(deck.OUTPUT, f"thermo {THERMO}\n{deck.OUTPUT} ke") for line in made.lines]
    return UpstreamExample(case.name.replace(".", "-"), BugDeck((*about, *lines), made.data))


def example_files(engine: Engine | None, out: Path | None = None) -> list[KitFile]:
    """Return all decks with their data files and, if there is an engine, its logs but for those that are there.

    Raises
    ------
    EngineMissing
    """
    contents: dict[str, str] = {}
    for example in examples():
        contents |= example.files
        there = out is not None and any((out / FOLDER).glob(f"log.*.{example.name}.g++.1"))
        if engine and not there:  # a log has times, which differ whenever it is written
            contents |= dict([log_of(example, engine)])
    return [KitFile(f"{FOLDER}/{name}", content, executable=False) for name, content in contents.items()]


def log_of(example: UpstreamExample, engine: Engine) -> tuple[str, str]:
    """Run an example by an engine's program; return the name of its log, as LAMMPS names those, and the log.

    Raises
    ------
    EngineMissing
        There is no program, or it does not run the deck.
    """
    with tempfile.TemporaryDirectory() as folder:
        for name, content in example.files.items():
            (Path(folder) / name).write_text(content, encoding="utf-8")
        arguments = ["-in", f"in.{example.name}", "-log", "log", "-screen", "none", "-nocite"]
        try:
            subprocess.run(
                [str(bare.program(engine)), *arguments],
                cwd=folder,
                env=bare.environment(engine),
                capture_output=True,
                timeout=bare.TIME_LIMIT,
                check=True,
            )
        except subprocess.SubprocessError as error:
            raise EngineMissing(f"LAMMPS does not run in.{example.name}: {error}") from None
        log = (Path(folder) / "log").read_text(encoding="utf-8")
    version = log.partition("(")[2].partition(")")[0].partition(" - ")[0].replace(" ", "")
    return f"log.{version}.{example.name}.g++.1", log
