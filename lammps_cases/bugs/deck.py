"""``in.lammps``: a job as a deck of LAMMPS commands that prints the obtained and the expected value, and a verdict.

The verdict is PASS or FAIL on a separate line. A deck that LAMMPS must refuse passes if it stops there. LAMMPS' own
program runs it, without this project: ``lmp -in in.lammps``.
"""

from __future__ import annotations

import importlib.metadata
import math
import os
import re
import signal
import subprocess
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eos_ref import InputError
from lammps_cases.engine import mpi
from lammps_cases.engine.installations import Engine
from lammps_cases.engine.interlude import FOLDER, Interlude, rows
from lammps_cases.engine.reading import COMPONENTS
from lammps_cases.engine.session import Array, EngineMissing, Job, package_directory
from lammps_cases.records.files import write_atomically
from lammps_cases.scene.fields import FIELDS
from lammps_cases.setup.deck import until_first_run

DECK, DATA = "in.lammps", "data.lammps"
MOST_SINGLE = 5  # particles that a deck creates one by one; more are in a data file
_ARRAYS = {"x": ("x", "y", "z"), "v": ("vx", "vy", "vz"), "f": ("fx", "fy", "fz")}  # that variables read
TIME_LIMIT = 120.0  # seconds; the decks take a fraction of one


@dataclass(frozen=True)
class BugDeck:
    """A deck with its data file (empty: none), and the text of the expected refusal (empty: LAMMPS must run it)."""

    lines: tuple[str, ...]
    data: str = ""
    refused: str = ""

    @property
    def text(self) -> str:
        """Return the content of the deck."""
        return "".join(f"{line}\n" for line in self.lines)

    def write(self, folder: Path) -> list[Path]:
        """Write the files into a folder; return their paths."""
        contents = {DECK: self.text} | ({DATA: self.data} if self.data else {})
        for name, content in contents.items():
            write_atomically(folder / name, content)
        return [folder / name for name in contents]


@dataclass(frozen=True)
class Check:
    """A number of LAMMPS, and the expected number.

    Attributes
    ----------
    obtained : LAMMPS' name of the number in a formula
    expected : the number that the manual's formula gives, as a text that LAMMPS reads back as the same double
    bound : the largest difference that rounding makes
    formulas : of variables, the last one of which is the expected number; empty: it is a text
    """

    obtained: str
    expected: str
    bound: float
    formulas: tuple[tuple[str, str], ...] = ()

    @property
    def by_hand(self) -> tuple[str, ...]:
        """Return the commands that calculate the expected number."""
        if not self.formulas:
            return ()
        *parts, (_, last) = self.formulas
        return (*(f"variable {name} string ({text})" for name, text in parts), f"variable expected equal {last}")

    @property
    def inside(self) -> str:
        """Return the command that tests whether the number is inside the bound; NaN counts as outside."""
        # Formulas get other variables with 15 digits: hence the number itself, not a variable that holds it.
        return f"variable inside equal abs({self.obtained}-({self.expected}))<={self.bound!r}"

    @property
    def printed(self) -> tuple[str, ...]:
        """Return the commands that print both numbers and the verdict."""
        shown = f"$({self.expected}:%.15g)" if self.formulas else self.expected
        return (
            f'print "obtained $({self.obtained}:%.17g)"',
            f'print "expected {shown} within {self.bound:.2g}"',
            'if "${inside} == 1" then "print PASS" else "print FAIL"',
        )


OUTPUT = "thermo_style custom step v_inside"  # output computes, for the last step, what a variable reads


def of_number(job: Job, step: int, check: Check) -> BugDeck:
    """Return the deck of a job that compares a number after some steps."""
    lines, data = until_first_run(job, DATA, MOST_SINGLE)
    *before, last = _stretches(job, step)
    return BugDeck((*lines, *before, *check.by_hand, check.inside, OUTPUT, last, *check.printed), data)


def of_two(job: Job, other: Job, times: float, check: Check) -> BugDeck:
    """Return the deck of two jobs; the second must give the number of the first times a factor."""
    second = Check(check.obtained, "${expected}", check.bound)
    return BugDeck(
        (
            *until_first_run(job, DATA, MOST_SINGLE)[0],
            f"variable first equal {check.obtained}",
            "thermo_style custom step v_first",
            "run 0 post no",
            f"variable expected string $({times!r}*{check.obtained}:%.17g)",
            "clear",
            *until_first_run(other, DATA, MOST_SINGLE)[0],
            second.inside,
            OUTPUT,
            "run 0 post no",
            *second.printed,
        )
    )


def of_outcome(given: Job | tuple[str, ...], refused: str) -> BugDeck:
    """Return the deck of an input that LAMMPS must run, or refuse with a text."""
    lines, data = ([*given], "") if isinstance(given, tuple) else until_first_run(given, DATA, MOST_SINGLE)
    if isinstance(given, Job):
        if given.outputs:  # LAMMPS computes only what is read
            first, shape = next(iter(given.outputs.items()))
            lines += [f"variable read equal {word(given, first, 1, (0,) * len(shape))}"]
            lines += ["thermo_style custom step v_read"]
        lines += _stretches(given)
    due = f"an error that holds: {refused}" if refused else "LAMMPS runs this deck"
    verdict = "FAIL" if refused else "PASS"
    lines = [f'print "expected {due}"', *lines, 'print "obtained LAMMPS ran it"', f"print {verdict}"]
    return BugDeck(tuple(lines), data, refused)


def _stretches(job: Job, last: int | None = None) -> list[str]:
    """Return the commands of a job's runs up to a step and between them, with files in the folder of the deck.

    Raises
    ------
    InputError
        Commands that hold values of atoms after steps, which a deck does not have.
    """
    if last is not None and not any(isinstance(stretch, Interlude) for stretch in job.runs):
        return [f"run {last} post no"]
    lines: list[str] = []
    done = 0
    for stretch in job.runs:
        if isinstance(stretch, Interlude):
            lines += _between(job, stretch, done)
            continue
        done += int(stretch.command.split()[1])
        if last is not None and done > last:
            break
        lines.append(stretch.command)
    return lines


def _between(job: Job, interlude: Interlude, done: int) -> Iterable[str]:
    for action in interlude.actions:
        if action.how == "given":
            yield action.text.replace(FOLDER, ".")
        elif action.how == "for each atom":
            if done:
                raise InputError("case", "has commands for each atom after steps, which no deck has", len(job.id_n))
            yield from (action.text.format(**row) for row in rows(_given(job), action.last))


def _given(job: Job) -> dict[str, Array]:
    """Return the given state of a job's atoms before the first step."""
    solid = [int(words[2]) for words in map(str.split, job.commands) if words[:2] == ["set", "type"]]
    v_nc = np.zeros_like(job.x_nc) if job.v_nc is None else job.v_nc
    given = {"id": job.id_n, "type": job.type_n, "x": job.x_nc, "v": v_nc, **job.per_atom}
    return given | {"rheo_status": np.isin(job.type_n, solid).astype(int)}


def of_measured(lines: tuple[str, ...]) -> BugDeck:
    """Return the deck of a probe that measures: its variables ``found``, ``expected`` and ``within`` are printed."""
    shown = ('print "obtained $(v_found:%.17g)"', 'print "expected $(v_expected:%.15g) within $(v_within:%.2g)"')
    verdict = 'if "$(abs(v_found-v_expected)<=v_within) == 1" then "print PASS" else "print FAIL"'
    return BugDeck((*lines, *shown, verdict))


def word(job: Job, field: str, atom: int, axes: tuple[int, ...]) -> str:
    """Return LAMMPS' name of a component of a field of an atom; empty if no variable reads it."""
    if field in FIELDS and FIELDS[field].compute:
        component = f"[{COMPONENTS[axes[0]][axes[1]] + 1}]" if axes else ""
        of = f"c_{FIELDS[field].compute_id}" if FIELDS[field].overall else f"C_{FIELDS[field].compute_id}[{atom}]"
        return of + component
    if field not in job.outputs:
        return f"{_ARRAYS[field][axes[0]]}[{atom}]" if field in _ARRAYS else ""
    shapes = list(job.outputs.values())
    at = list(job.outputs).index(field)
    column = sum(map(math.prod, shapes[:at])) + (int(np.ravel_multi_index(axes, shapes[at])) if axes else 0)
    return f"C_q[{atom}]" + (f"[{column + 1}]" if sum(map(math.prod, shapes)) > 1 else "")


@dataclass(frozen=True)
class Ending:
    """How LAMMPS ended: its exit code, negative for a signal, and its output."""

    code: int
    output: str

    @property
    def version(self) -> str:
        """Return the version that LAMMPS printed, with the number of its update."""
        match = re.search(r"^LAMMPS \((.+)\)", self.output, re.M)
        return match[1] if match else ""

    @property
    def error(self) -> str:
        """Return LAMMPS' own error, its uncaught exception, or the signal that killed it."""
        if self.code < 0:
            return signal.Signals(-self.code).name
        match = re.search(r"^(ERROR|Exception).*", self.output, re.M)
        return match[0] if match else ""

    def verdict(self, deck: BugDeck) -> str:
        """Return PASS or FAIL, as printed by the deck, or by whether LAMMPS refused what it must refuse."""
        lines = self.output.splitlines()
        if deck.refused:
            return "PASS" if self.code > 0 and deck.refused in self.error and "FAIL" not in lines else "FAIL"
        return "PASS" if self.code == 0 and "PASS" in lines else "FAIL"

    def printed(self, name: str) -> str:
        """Return a number that the deck printed; empty if it did not get there."""
        match = re.search(rf"^{name} (\S+)", self.output, re.M)
        return match[1] if match else ""


def program(engine: Engine) -> Path:
    """Return LAMMPS' program in or near the folder of an engine's library.

    Raises
    ------
    EngineMissing
    """
    folder = library_folder(engine)
    places = (folder / "lmp", folder.parent / "bin" / "lmp", folder.parent / "lmp")
    path = next((place for place in places if place.is_file()), None)
    if path is None:
        raise EngineMissing(f"there is no program lmp near the library in {folder}")
    return path


def library_folder(engine: Engine) -> Path:
    """Return the folder of the library itself, not of a link to it."""
    package = Path(engine.site) / "lammps" if engine.site else package_directory()
    return (package / "liblammps.so").resolve().parent


def run(deck: BugDeck, engine: Engine) -> Ending:
    """Run a deck in a temporary folder."""
    with tempfile.TemporaryDirectory() as folder:
        deck.write(Path(folder))
        # The start script of a wheel sets the place of its MPI in an environment variable.
        process = subprocess.Popen(
            [program(engine), "-in", DECK, "-log", "none"],
            cwd=folder,
            env=environment(engine),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
        )
        try:
            printed, _ = process.communicate(timeout=TIME_LIMIT)
        finally:
            process.kill()
            process.wait()
            mpi.remove_shared_memory(process.pid)
    return Ending(process.returncode, printed)


def environment(engine: Engine) -> dict[str, str]:
    """Return the environment in which the program of an engine finds its MPI."""
    environment = dict(os.environ)
    try:
        library = mpi.file_of_mpich("libmpi.so.12", library_folder(engine).parent)
    except (OSError, importlib.metadata.PackageNotFoundError):
        return environment
    environment["LD_LIBRARY_PATH"] = os.pathsep.join(
        filter(None, [environment.get("LD_LIBRARY_PATH", ""), str(library.parent)])
    )
    return environment
