"""The files for LAMMPS' tree: unit tests with the reference's numbers, and decks in the style of its examples.

A test is a YAML file and a data file, with one input template for all. A deck is a flow that compares a number with the
reference's at the end: it prints the obtained and the reference's value, and PASS or FAIL; its log is that of the
LAMMPS that ran it.
"""

from __future__ import annotations

import functools
import subprocess
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.syntax.manual import MANUALS
from lammps_cases.bugs import deck
from lammps_cases.bugs.deck import BugDeck, Check
from lammps_cases.bugs.upstream.force_tests import (
    COEFFICIENTS,
    OWN,
    TEMPLATE,
    Expected,
    ForceTest,
    expected,
    shipped,
    template,
    with_manual,
)
from lammps_cases.ci.kits import KitFile
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.engine.installations import Engine
from lammps_cases.engine.session import EngineMissing
from lammps_cases.records.files import DATA
from lammps_cases.scene import casefile
from lammps_cases.scene.atoms import build, seed
from lammps_cases.setup import commands
from lammps_cases.setup.plan import plan
from lammps_cases.verdict.problems import problem_of

TESTS = "unittest/force-styles/tests"  # in LAMMPS' tree
TAIT = "unittest/python/python-eosref-tait.py"  # of a form of Tait's law that keeps its digits, docs/tait.md
_MONTHS = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")
CASES = DATA / "upstream" / "examples.yaml"
FOLDER = f"examples/rheo/{OWN}"  # in LAMMPS' tree
THERMO = 20  # steps between lines of the log


def date(manual: str) -> str:
    """Return the date of a version of the manual in LAMMPS' form, as 4 Jul 2026."""
    year, month, day = map(int, manual.split(".")[:3])
    return f"{day} {_MONTHS[month - 1]} {year}"


def kit_files(predictor: Predictor | None = None, chosen: Sequence[ForceTest] | None = None) -> list[KitFile]:
    """Return the files of the kit, by their paths in LAMMPS' tree."""
    predictor = predictor or Predictor()
    contents = {TEMPLATE: template()}
    for test in shipped() if chosen is None else chosen:
        contents[test.data_name] = test.data
        contents[f"{test.name}.yaml"] = yaml_text(test, expected(test, predictor))
    if any(name.startswith("fix-") for name in contents):
        contents[COEFFICIENTS] = "pair_coeff       * *\n"
    paths = {f"{TESTS}/{name}": content for name, content in contents.items()}
    if chosen is None:
        paths[TAIT] = (DATA / "upstream" / Path(TAIT).name).read_text(encoding="utf-8")
    return [KitFile(path, content, executable=False) for path, content in paths.items()]


def write_folder(folder: Path, files: Iterable[KitFile]) -> None:
    """Write only the tests into a folder, without the folders of LAMMPS' tree."""
    for file in files:
        if file.path.startswith(TESTS):
            (folder / Path(file.path).name).write_text(file.content, encoding="utf-8")


def yaml_text(test: ForceTest, numbers: Expected) -> str:
    """Return a YAML file in the form written by the test programs."""
    lines = [
        "---",
        *(f"# {line}" for line in test.case.about.splitlines()),
        "# The numbers are those of an independent reference that follows the manual, not of a LAMMPS (eos-ref).",
        f"# epsilon: {numbers.why}",
        f"lammps_version: {date(MANUALS[-1])}",
        "tags: rheo no_respa",
        f"date_generated: by eos-ref {version('eos-ref')}",  # a time would change the file without new numbers
        f"epsilon: {numbers.epsilon:g}",
        "skip_tests:",
        *_block("prerequisites", test.prerequisites),
        *_block("pre_commands", test.pre_commands),
        *_block("post_commands", test.post_commands),
        f"input_file: {TEMPLATE}",
    ]
    if test.program == "test_pair_style":
        energies = [f"{when}_{of}: 0" for when in ("init", "run") for of in ("vdwl", "coul")]
        lines += [f"pair_style: {test.pair}", *_block("pair_coeff", ["* *"]), 'extract: ! ""']
        lines += [f"natoms: {len(test.atoms)}", *energies]
    else:
        lines += [f"input_coeffs: {COEFFICIENTS}", f"natoms: {len(test.atoms)}"]
    for key, values in numbers.values.items():
        count = f"{len(values)} " if key == "global_vector" else ""
        lines += [f"{key}: ! |2", *_rows(values, count)]
    return "\n".join(lines) + "\n...\n"


def _block(key: str, lines: Sequence[str]) -> list[str]:
    return [f"{key}: ! |", *(f"  {line}" for line in lines)] if lines else [f'{key}: ! ""']


def _rows(values: FloatArray, count: str) -> list[str]:
    """Return a vector on one line, after its size if given, or those of all atoms, each after its id."""
    rows = [" ".join(f"{value:23.16e}" for value in row) for row in np.atleast_2d(values)]
    return (
        [f"  {count}{row}" for row in rows]
        if values.ndim == 1
        else [f"  {n:3d} {row}" for n, row in enumerate(rows, 1)]
    )


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
def example_cases() -> tuple[casefile.Case, ...]:
    """Return the cases of the decks."""
    return tuple(with_manual(case) for case in casefile.load_file(CASES))


@functools.cache
def examples() -> tuple[UpstreamExample, ...]:
    """Return all examples; the number is the largest of the compared field, with its bound."""
    return tuple(_example(case) for case in example_cases())


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
    """Return all decks with their data files and, with an engine, the logs that do not exist yet.

    Raises
    ------
    EngineMissing
    """
    contents: dict[str, str] = {}
    for example in examples():
        contents |= example.files
        there = out is not None and any((out / FOLDER).glob(f"log.*.{example.name}.g++.1"))
        if engine and not there:  # a log has times, which differ at every run
            contents |= dict([log_of(example, engine)])
    return [KitFile(f"{FOLDER}/{name}", content, executable=False) for name, content in contents.items()]


def log_of(example: UpstreamExample, engine: Engine) -> tuple[str, str]:
    """Run an example with an engine's program; return the log, and its name by LAMMPS' convention.

    Raises
    ------
    EngineMissing
        No program, or it does not run the deck.
    """
    with tempfile.TemporaryDirectory() as folder:
        for name, content in example.files.items():
            (Path(folder) / name).write_text(content, encoding="utf-8")
        arguments = ["-in", f"in.{example.name}", "-log", "log", "-screen", "none", "-nocite"]
        try:
            subprocess.run(
                [str(deck.program(engine)), *arguments],
                cwd=folder,
                env=deck.environment(engine),
                capture_output=True,
                timeout=deck.TIME_LIMIT,
                check=True,
            )
        except subprocess.SubprocessError as error:
            raise EngineMissing(f"LAMMPS does not run in.{example.name}: {error}") from None
        log = (Path(folder) / "log").read_text(encoding="utf-8")
    version = log.partition("(")[2].partition(")")[0].partition(" - ")[0].replace(" ", "")
    return f"log.{version}.{example.name}.g++.1", log
