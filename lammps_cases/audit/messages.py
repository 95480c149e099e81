"""What the process that runs a deck sends to the one that started it: plain data."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy.typing as npt
from pydantic import ConfigDict

from eos_ref.errors import InputError
from eos_ref.model.parameters import Model
from eos_ref.syntax.manual import manual_of
from lammps_cases.audit.deck import Deck
from lammps_cases.records.case_parts import (
    ActingRecord,
    BreakRecord,
    BudgetRecord,
    ClosedRecord,
    EffectRecord,
    FieldRecord,
    LawRecord,
    LostRecord,
    OutlookRecord,
    Seconds,
    SeriesRecord,
    Verdict,
)


@dataclass(frozen=True)
class RunSetup:
    """What a run of a deck begins with: the state of its commands, and the particles.

    Attributes
    ----------
    first, last : its steps
    before : how many of the deck's commands come before it
    deck : these commands
    computes : their commands by id
    between : a command that the run executes in between and that may change the model
    mass_t : masses of the types, from index 1; None where every particle has its own
    id_n, solid_n : of the particles
    members : by group, whether a particle is in it
    newton : the flags of pairs and of bonds
    ranks : number of ranks of LAMMPS
    """

    __pydantic_config__ = ConfigDict(arbitrary_types_allowed=True)

    first: int
    last: int
    before: int
    deck: Deck
    dt: float
    version: str
    units: str
    dimension: int
    ntypes: int
    between: str
    mass_t: list[float] | None
    computes: dict[str, list[str]]
    id_n: npt.NDArray[Any]
    solid_n: npt.NDArray[Any]
    members: dict[str, npt.NDArray[Any]]
    newton: tuple[bool, bool]
    ranks: int

    def model(self) -> Model:
        """Return the particle model, without individual masses of particles.

        Raises
        ------
        InputError
            Something that cannot be followed, or that is missing.
        """
        laws = self.deck.laws(self.ntypes)
        if laws is None:
            raise InputError("deck", "defines no fix rheo and fix rheo/pressure")
        mass_t = [1.0] * self.ntypes if self.mass_t is None else self.mass_t[1:]
        return self.deck.model(self.dimension, self.ntypes, mass_t, laws, manual_of(self.version))


@dataclass
class DeckDump:
    """A dump of a deck, or what write_dump writes.

    Attributes
    ----------
    words : id, group, style, steps between two snapshots, file and columns
    modify : words of its dump_modify
    begin, end : number of runs before its definition, and before its end
    step : of write_dump; None for a dump
    """

    words: list[str]
    modify: list[str]
    begin: int
    end: int
    step: int | None = None


@dataclass
class ScriptCommand:
    """A command of a deck as written, and as LAMMPS got it: without words if it only controls the deck's flow.

    ``runs`` is the number of runs before it.
    """

    where: str
    written: str
    runs: int
    values: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class StartState:
    """The particles before the set-up of the first run, in LAMMPS' order, and the box.

    Attributes
    ----------
    box_c : (2, 3) corners; tilt_c : (3,) xy, xz, yz
    id_n, type_n, status_n, rho_n : (n,)
    x_nc, v_nc : (n, 3)
    energy_n : (n,), empty without atom_style rheo/thermal
    members : by group, whether a particle is in it
    """

    __pydantic_config__ = ConfigDict(arbitrary_types_allowed=True)

    box_c: npt.NDArray[Any]
    tilt_c: npt.NDArray[Any]
    periodic: list[bool]
    id_n: npt.NDArray[Any]
    type_n: npt.NDArray[Any]
    status_n: npt.NDArray[Any]
    x_nc: npt.NDArray[Any]
    v_nc: npt.NDArray[Any]
    rho_n: npt.NDArray[Any]
    energy_n: npt.NDArray[Any]
    members: dict[str, npt.NDArray[Any]]


@dataclass(frozen=True)
class DeckSetups:
    """The runs of a deck, set up but not carried out, its dumps, and its fixes and the like as commands.

    Also all of its commands, and the particles at its first run.
    """

    runs: list[RunSetup]
    dumps: list[DeckDump]
    commands: list[str]
    script: list[ScriptCommand] = field(default_factory=list)
    start: StartState | None = None


@dataclass(frozen=True)
class EngineIdentity:
    """The LAMMPS that runs the deck; see `lammps_cases.engine.session.describe`."""

    who: dict[str, str]


@dataclass(frozen=True)
class CommandPlace:
    """The command that LAMMPS is about to execute, and its place in the deck."""

    where: str
    command: str


class SampleRow(NamedTuple):
    """A field of one atom type (or all) in one sample: a plain tuple, which is sent ten times faster than a model."""

    natoms: int
    verdict: Verdict
    max_abs: float
    max_over_bound: float
    bound: float
    worst_id: int
    outside: int
    first_id: int | None
    explained_by: tuple[str, ...] = ()
    digest: str = ""

    @classmethod
    def of(cls, natoms: int, record: FieldRecord) -> SampleRow:
        """Return the row of a comparison's record."""
        r = record
        worst = (r.max_abs or 0.0, r.max_over_bound or 0.0, r.bound or 0.0, r.worst_id or 0)
        return cls(natoms, r.verdict, *worst, r.outside, r.first_id, tuple(r.explained_by), r.digest)


@dataclass(frozen=True)
class SampleRows:
    """One sample: every field and atom type (0: all types) at one step, and the number of steps done.

    ``effects``: what known findings do to the particles, in some of the samples; ``budgets``: one, if
    wanted; ``unpredictable``: by field that could not be compared, the findings that affect it.
    """

    step: int
    run: int
    done: int
    rows: dict[tuple[str, int], SampleRow]
    effects: tuple[EffectRecord, ...] = ()
    budgets: tuple[BudgetRecord, ...] = ()
    unpredictable: dict[str, tuple[str, ...]] = field(default_factory=dict)


@dataclass(frozen=True)
class RunFacts:
    """Facts of a run at its start; ``derivations`` are for the pressure per type, ``derivation`` for the rest.

    ``killing`` is the finding by which a segmentation fault would end it.
    """

    natoms: int
    dimension: int
    units: str
    laws: list[LawRecord]
    derivations: list[str]
    run: int = 0
    unchecked: dict[str, str] = field(default_factory=dict)
    stages: dict[str, str] = field(default_factory=dict)
    derivation: str = ""
    killing: str = ""


@dataclass(frozen=True)
class PairShare:
    """A deck with pair_style rheo alone, and the lines of its data file: the particles of a sample.

    ``reason`` says why the forces of the sample itself could not be compared.
    """

    run: int
    step: int
    reason: str
    commands: list[str]
    data: list[str]


@dataclass(frozen=True)
class DeckEnd:
    """The end of the deck, or the error ``refused``; with arrays of one sample, and the fields of the last."""

    __pydantic_config__ = ConfigDict(arbitrary_types_allowed=True)

    done: int
    runs: int
    seconds: Seconds
    warnings: list[str]
    stability: list[str]
    arrays: dict[str, npt.NDArray[Any]]
    last: dict[int, FieldRecord]
    refused: str = ""
    outlook: OutlookRecord | None = None
    effects: list[EffectRecord] = field(default_factory=list)
    share: PairShare | None = None
    series: list[SeriesRecord] = field(default_factory=list)
    closed: ClosedRecord | None = None
    touching: tuple[str, ...] = ()  # findings that act on the deck by its commands, whatever its particles
    acting: list[ActingRecord] = field(default_factory=list)
    broke: BreakRecord | None = None
    lost: LostRecord | None = None
    brief: str = ""  # the most questionable part of the set-up
    lacks: str = ""  # what the deck needs but this LAMMPS was built without
    kept: dict[int, dict[str, npt.NDArray[Any]]] = field(default_factory=dict)  # see `lammps_cases.audit.arrays`
    thermo: list[dict[str, float]] = field(default_factory=list)
