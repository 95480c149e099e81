"""Options, result and task of an audit."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from dataclasses import fields as fields_of
from pathlib import Path
from typing import Annotated, Any

import numpy.typing as npt
from pydantic import BeforeValidator, ConfigDict, TypeAdapter, ValidationError

from eos_ref.errors import InputError
from lammps_cases.audit import text
from lammps_cases.audit.fields import DEFAULT, chosen
from lammps_cases.audit.place import DeckPlace
from lammps_cases.engine.containment import Means
from lammps_cases.records.levels import EFFECT
from lammps_cases.records.options import Option
from lammps_cases.records.progress import SILENT, Progress
from lammps_cases.records.run_record import Level, RunRecord
from lammps_cases.run.options import EngineName, LevelOptions
from lammps_cases.scene.runs import MOST_RANKS

TIMEOUT = 3600.0  # seconds
TRUST = "EOS_REF_TRUST"  # in the environment: 1 for decks that are trusted


def trusted() -> bool:
    """Return whether the environment says that decks are trusted."""
    return os.environ.get(TRUST) == "1"


def _names(fields: Any) -> Any:
    """Split fields that are one word with commas."""
    return [name for part in fields.split(",") if (name := part.strip())] if isinstance(fields, str) else fields


@dataclass(frozen=True)
class FinishedOptions:
    """Output of a deck to be checked instead of a run of the deck."""

    dump: Annotated[Path | None, Option("Check a dump written by DECK, without running it.", metavar="FILE")] = None
    restart: Annotated[Path | None, Option("Check a restart file written by DECK.", metavar="FILE")] = None


@dataclass(frozen=True)
class DeckLevelOptions(LevelOptions):
    """The LAMMPS that runs a deck, and the known findings that make the exit code 1."""

    _: KW_ONLY
    fail_on: Annotated[
        Level | None,
        Option(
            "Exit 1 also for known findings of at least this severity on the deck, or for an effect on the deck above "
            "this (1%); new: for none.  [default: new]",
            like=EFFECT,
        ),
    ] = None  # type: ignore[assignment]  # wider than that of runs
    engine: EngineName = "env"


@dataclass(frozen=True)
class Given:
    """What a deck cannot say of its flow, in its units; see `lammps_cases.audit.advised`."""

    speed: Annotated[float | None, Option("Largest speed of the flow.", metavar="U")] = None
    length: Annotated[float | None, Option("Gap, height or box that the flow has.", metavar="L")] = None
    height: Annotated[float | None, Option("Height of the fluid along gravity.", metavar="H")] = None
    surface_tension: Annotated[float, Option("Surface tension that other styles of the deck give.", metavar="S")] = 0.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if value is not None and not 0 <= value < math.inf:
                raise InputError(name, "must be a number from 0 on", value, f"option --{name.replace('_', '-')}")


@dataclass(frozen=True)
class AuditOptions:
    """How a deck is audited.

    Attributes
    ----------
    engine : str, optional
        Folder (for ``sys.path``) of another lammps package.
    progress : Progress, optional
        Receives the number of steps done, and the total.
    keep : Path, optional
        Run in this folder and leave it, with what the deck wrote; by default a temporary one.

    Raises
    ------
    InputError
        A number that is not positive, an unknown field, a variable without name or value.
    """

    __pydantic_config__ = ConfigDict(arbitrary_types_allowed=True, extra="forbid")

    every: Annotated[int, Option("Check all atoms every M time steps.", metavar="M")] = 10
    steps: Annotated[int | None, Option("Stop after N time steps in all.  [default: the whole deck]", metavar="N")] = (
        None
    )
    timeout: Annotated[float, Option("Stop after S seconds.  [default: an hour]", metavar="S")] = TIMEOUT
    trust: Annotated[
        bool,
        Option("Let the deck run programs, and read and write files with your own file permissions.", envvar=TRUST),
    ] = field(default_factory=trusted)
    engine: str | None = None
    progress: Progress = field(default=SILENT, compare=False)
    keep: Path | None = field(default=None, compare=False)
    fields: Annotated[
        tuple[str, ...],
        BeforeValidator(_names),
        Option(
            "What to check, by LAMMPS' names (pressure, coordination, grad/v, f, ...); all: whatever can be checked.",
            metavar="NAME,...",
            type=str,
            multiple=False,
            default=",".join(DEFAULT),
        ),
    ] = DEFAULT
    suffix: Annotated[
        str | None, Option("Style suffix, as LAMMPS' own switch.", "-sf", "--suffix", "-suffix", metavar="STYLE")
    ] = None
    package: Annotated[
        tuple[str, ...], Option("As LAMMPS' own switch.", "-pk", "-package", metavar="STYLE ...", multiple=False)
    ] = ()
    var: Annotated[
        Mapping[str, Any],
        Option(
            "Define an index variable before DECK, as LAMMPS' own switch; all words before the next - are its values.",
            "-v",
            "-var",
            metavar="NAME VALUE...",
            type=str,
        ),
    ] = field(default_factory=dict)
    root: Annotated[Path | None, Option("Copy DIR, for decks that read files of other folders.", metavar="DIR")] = None
    ranks: Annotated[int, Option("Run LAMMPS on N MPI ranks, as mpirun -np N lmp.", metavar="N")] = 1
    budgets: Annotated[bool, Option("Also follow momentum and energy, and where they are lost.")] = False

    def __post_init__(self) -> None:
        if not 1 <= self.every < 2**31:
            raise InputError("every", "must be 1 to 2147483647 time steps", self.every, "option --every")
        if self.steps is not None and self.steps < 1:
            raise InputError("steps", "must be at least 1 time step", self.steps, "option --steps")
        if not self.timeout > 0:
            raise InputError("timeout", "must be a positive number of seconds", self.timeout, "option --timeout")
        if not 1 <= self.ranks <= MOST_RANKS:
            raise InputError("ranks", f"must be 1 to {MOST_RANKS} processes", self.ranks, "option --ranks")
        object.__setattr__(self, "fields", chosen(self.fields))
        object.__setattr__(self, "var", {name: _values(name, given) for name, given in self.var.items()})

    @classmethod
    def of(cls, **given: Any) -> AuditOptions:
        """Return options given by a user: fields may be one string with commas; wrong types are bad input.

        Raises
        ------
        InputError
            An unknown option, a wrong type, or a wrong value.
        """
        try:
            return TypeAdapter(cls).validate_python(given)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            cause = first.get("ctx", {}).get("error")
            if isinstance(cause, InputError):
                raise cause from None
            raise InputError(f"argument {first['loc'][0]}", first["msg"], first["input"], "audit()") from None

    def commands(self) -> list[str]:
        """Return the commands that LAMMPS executes before the deck."""
        variables = [" ".join(["variable", name, "index", *map(text.quoted, of)]) for name, of in self.var.items()]
        suffix = [] if self.suffix is None else [f"suffix {self.suffix}"]
        return [*suffix, *(f"package {given}" for given in self.package), *variables]

    def words(self) -> list[str]:
        """Return the options other than the defaults as words of the command line."""
        plain = AuditOptions(trust=False)
        given = {each.name: getattr(self, each.name) for each in fields_of(self) if each.compare}
        return [w for name, value in given.items() if value != getattr(plain, name) for w in _words(name, value)]


def _values(name: str, given: Any) -> tuple[str, ...]:
    values = tuple(map(str, [given] if isinstance(given, str) or not isinstance(given, Sequence) else given))
    if not (re.fullmatch(r"\w+", name) and values):
        raise InputError("var", "must be a name of letters, digits and _, and at least one value", name, "option -var")
    return values


def _words(name: str, value: Any) -> list[str]:
    match name:
        case "var":
            return [word for name, values in value.items() for word in ("-var", name, *values)]
        case "package":
            return [word for given in value for word in ("-pk", *given.split())]
        case "suffix":
            return ["-sf", value]
        case "engine":
            return ["--engine", f"path:{value}"]
        case "fields":
            return ["--fields", ",".join(value)]
        case _:
            return [f"--{name}", *([] if value is True else [str(value)])]


@dataclass(frozen=True)
class AuditResult:
    """The record of an audit, the identity of its LAMMPS, and the per-atom arrays of one sample, sorted by id.

    The sample is the first in which a field differs, else the last.

    ``arrays`` has ``id``, ``type``, ``x``, ``rho``, ``box`` (low and high corner), ``step``, for every field
    ``FIELD.lammps``, ``FIELD.reference`` and ``FIELD.bound``, and ``e`` if a law needs it; it is empty if there
    was no sample or LAMMPS died. A field that was compared for some atoms only is not among them.
    """

    record: RunRecord
    who: dict[str, str]
    arrays: dict[str, npt.NDArray[Any]]
    kept: dict[int, dict[str, npt.NDArray[Any]]] = field(
        default_factory=dict
    )  # by step, see `lammps_cases.audit.arrays`


@dataclass(frozen=True)
class AuditTask:
    """The task of the child process."""

    deck: str
    folder: str  # the copy
    options: AuditOptions
    means: Means
    outside: str  # folder outside of the copy, for the files of the audit itself
    setups: bool = False  # whether runs are described instead of carried out
    place: DeckPlace = field(default_factory=DeckPlace)

    @property
    def working(self) -> str:
        """Return the folder in which LAMMPS runs."""
        return f"{self.folder}/{self.place.within}"

    @property
    def temporary(self) -> str:
        """Return the folder for temporary files."""
        return f"{self.outside}/tmp"

    @property
    def fifo(self) -> str:
        """Return the file that carries the messages."""
        return f"{self.temporary}/messages"
