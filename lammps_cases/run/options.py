"""The options of commands that run cases: plain declarations, without heavy imports."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import Annotated

from annotated_types import Ge

from lammps_cases.records.levels import FailOn
from lammps_cases.records.options import Option, Positional

Names = str | Sequence[str]
Paths = str | Path | Sequence[str | Path]
Tag = Annotated[
    str | None,
    Option("Only cases with this tag (quick, eos, refusal, ...); all: every case not tagged long.", complete="tags"),
]
Files = Annotated[Paths, Option("Case file or folder of your own.", "--cases", path=True)]
Jobs = Annotated[Annotated[int, Ge(1)] | None, Option("LAMMPS processes at a time (default: one per core).")]
Fresh = Annotated[bool, Option("Ignore the cache of reference predictions.")]
NAMES = "Cases, whatever lies below them, or patterns; without names and tag all that are not tagged long or more."
ENGINE = "env, pypi:VERSION or path:PLACE of a build, prefix, environment or library."
EngineName = Annotated[str, Option(ENGINE, complete="engines")]


@dataclass(frozen=True)
class CaseOptions:
    """Which cases run, and how."""

    _: KW_ONLY
    tag: Tag = None
    cases: Files = ()
    jobs: Jobs = None
    fresh: Fresh = False

    @property
    def paths(self) -> list[Path]:
        """Return the case files and folders of the user."""
        return paths(self.cases)

    @property
    def processes(self) -> int:
        """Return the number of LAMMPS processes at a time."""
        return processes(self.jobs)


@dataclass(frozen=True)
class LevelOptions:
    """Which known findings make the exit code 1."""

    _: KW_ONLY
    fail_on: Annotated[
        FailOn | None,
        Option("Exit 1 also for known findings of at least this severity; new: for none.  [default: new]"),
    ] = None
    strict: Annotated[bool, Option("The same as --fail-on low.")] = False

    def __post_init__(self) -> None:
        if self.strict and self.fail_on not in (None, "low"):
            from eos_ref.errors import InputError  # loads numpy

            raise InputError("--strict", "is --fail-on low, and must not be given with another level", self.fail_on)

    @property
    def level(self) -> FailOn:
        """Return the least severity of known findings that fails."""
        return "low" if self.strict else self.fail_on or "new"


@dataclass(frozen=True)
class RunOptions(LevelOptions, CaseOptions):
    """What is run on which engine, and what fails."""

    names: Annotated[Names, Positional(NAMES, metavar="[CASE]...", complete="cases")] = ()
    _: KW_ONLY
    engine: EngineName = "env"
    allow: Annotated[
        Names,
        Option(
            "A finding that fails nothing, also where it is new on this version (repeatable).",
            metavar="FINDING",
            complete="findings",
        ),
    ] = ()


@dataclass(frozen=True)
class CompareOptions(CaseOptions):
    """The cases on which sides are compared, and what counts as a change."""

    _: KW_ONLY
    strict: Annotated[bool, Option("Exit 1 also for different bits within the bounds.")] = False
    fail_on: Annotated[
        FailOn | None,
        Option("Exit 1 only for findings of at least this severity; new: without a finding.  [default: any change]"),
    ] = None


def paths(files: Paths) -> list[Path]:
    """Return the case files and folders of the user."""
    return [Path(path) for path in several(files)]


def processes(jobs: int | None) -> int:
    """Return the number of processes at a time: one per core by default."""
    return jobs or os.cpu_count() or 1


def several(names: str | Path | Sequence[str | Path]) -> list[str]:
    """Return one name or several as a list of words."""
    return [str(names)] if isinstance(names, str | Path) else [str(name) for name in names]
