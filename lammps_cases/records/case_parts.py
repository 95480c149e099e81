"""Parts of the record of a case: verdicts, what was compared and with what result, how LAMMPS ended.

Of an audited deck also the effects of findings, budgets, and runs of the reference.
"""

from __future__ import annotations

import hashlib
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt
from pydantic import Field

from eos_ref import EOS
from lammps_cases.records.documents import Record
from lammps_cases.records.levels import Severity

Verdict = Literal["exact", "pass", "explained", "differs", "refused", "crashed", "timeout", "error", "skipped"]
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)
# How LAMMPS ended a case: with numbers to compare; with an answer where a refusal was due; without an answer; with
# atoms or steps other than those requested.
Ended = Literal["answered", "accepted", "refused", "crashed", "timeout", "error", "skipped", "unusable"]
Failed = Literal["refused", "crashed", "timeout", "error", "skipped"]  # a verdict and an end in one: without an answer
# From best to worst. A refusal that the scene expects counts as good as a pass; see `CaseRecord.as_expected`.
BY_SEVERITY = ("skipped", "exact", "pass", "explained", "refused", "differs", "timeout", "crashed", "error")


class DigitsLost(Record):
    """Decimal digits lost against the rigorous value, worst atom; None where it was not evaluated."""

    lammps: float | None = None
    reference: float | None = None


class StepRecord(Record):
    """A field at one of the steps compared."""

    step: int
    verdict: Verdict
    max_abs: float
    max_over_bound: float
    worst_id: int | None = None
    digest: str = Field("", description="of the bits of the engine's array at this step; see `digest`")


class FieldRecord(Record):
    """Verdict on one per-atom field of a case."""

    field: str
    stage: str = Field(description="what is tested: input, eos, or a stage of the particle model")
    verdict: Verdict
    max_abs: float | None = Field(None, description="largest absolute difference over the atoms")
    max_over_bound: float | None = Field(None, description="largest ratio of difference to bound")
    bound: float | None = Field(None, description="bound at the worst atom")
    derivation: str = Field("", description="how the bound was derived")
    worst_id: int | None = Field(None, description="id of the worst atom")
    worst_step: int | None = None
    until: int | None = Field(None, description="last step at which it could be judged, if the run went on (audit)")
    outside: int = Field(0, description="number of atoms outside the bound")
    first_id: int | None = Field(None, description="lowest id outside the bound")
    atom_type: int | None = Field(None, description="only atoms of this type (audit)")
    digits_lost: DigitsLost = Field(default_factory=DigitsLost)  # pydantic would copy a default for every record
    explained_by: list[str] = Field([], description="ids of the ledger entries whose variants are inside the bound")
    digest: str = Field("", description="of the bits of the engine's array, of all steps compared; see `digest`")
    steps: list[StepRecord] = Field([], description="every step compared; the values above are of the worst")


class LawRecord(Record):
    """Equation of state of one atom type."""

    type: int
    style: str
    rho0: float
    cs: float
    parameter: float | None = None
    background: float = 0.0
    mass: float | None = None
    freezes: bool = Field(False, description="whether particles freeze and melt: then solids are no walls (audit)")

    @classmethod
    def of(cls, atom_type: int, law: EOS, mass: float | None, freezes: bool = False) -> LawRecord:
        """Return the record of a law and of the mass that its particles have (None: they differ)."""
        parameters = {name: getattr(law, name) for name in ("style", "rho0", "cs", "parameter", "background")}
        return cls(type=atom_type, mass=mass, freezes=freezes, **parameters)


class CheckRecord(Record):
    """One check of an audit: a field of one type, or of all, at one step."""

    step: int
    run: int = Field(description="number of the run command, from 1")
    field: str = "pressure"
    type: int = Field(description="0: all types together")
    natoms: int
    verdict: Verdict
    max_abs: float
    max_over_bound: float
    worst_id: int
    digest: str = Field("", description="of the bits of the engine's array, by id; see `digest`")


class Seconds(Record):
    """Wall time spent on a case."""

    lammps: float = 0.0
    reference: float = 0.0
    total: float = 0.0
    stages: dict[str, float] = Field({}, description="processor seconds of the process that judged it, by stage")


class Predictions(Record):
    """Where the reference's predictions came from; a stored one has the bits of a computed one."""

    computed: int = Field(0, description="evaluated in this run")
    stored: int = Field(0, description="found in the store of predictions (eos-ref run --fresh ignores it)")
    judgements: int = Field(0, description="judgements found there, of answers that LAMMPS gave before, bit for bit")


class Blame(Record):
    """The first step, stage, field and atom outside the bound; of a twin, the reference's side is the other run."""

    field: str
    stage: str = ""
    step: int | None = None
    run: int | None = Field(None, description="number of the run command, from 1 (audit)")
    atom: int = Field(description="lowest id outside the bound")
    type: int | None = Field(None, description="type of that atom, where the laws are compared one by one")
    rho: float | None = Field(None, description="density of that atom, likewise")
    lammps: float | None = Field(None, description="value of that atom in LAMMPS; its worst component")
    reference: float | None = None
    bound: float | None = None
    outside: int = Field(description="number of atoms outside the bound")
    of: int = Field(description="number of atoms compared")
    max_abs: float | None = Field(None, description="largest absolute difference over the atoms (audit)")
    max_over_bound: float | None = Field(None, description="largest ratio of difference to bound (audit)")
    worst_id: int | None = Field(None, description="id of the atom with that (audit)")


class Beyond(Record):
    """What leaves the bound first with a minimal set of findings, without any of which something leaves it earlier."""

    findings: list[str]
    blame: Blame
    known: list[str] = Field([], description="of those that LAMMPS is known to have all that change the scene")


class LostAtoms(Record):
    """LAMMPS returned atoms other than those it was given."""

    returned: int
    given: int
    first_id: int = Field(description="first id that is missing, foreign or doubled")


class OtherSteps(Record):
    """LAMMPS counted steps other than those requested."""

    counted: list[int]
    asked: list[int]


class Mismatch(Record):
    """What is wrong with the answer to a probe.

    ``counts`` and ``values``: of numbers that differ, how many of how many, and the two that are furthest apart; of
    arrays that cannot be compared, their lengths; of a number that is measured, itself, that expected, and the bound.
    """

    kind: Literal["not finite", "logged", "other numbers", "other atoms", "measured", "blind"]
    fields: list[str] = Field([])
    text: str = Field("", description="what the log holds; of a blind probe, how its control ended")
    counts: list[int] = Field([])
    values: list[float] = Field([])


class HarnessError(Record):
    """A fault of the harness, not of LAMMPS."""

    exception: str = Field("", description="its class; empty: the process that judged ended")
    text: str


class EffectRecord(Record):
    """What a finding does to a field of an audited deck, in the sample in which it is largest."""

    finding: str
    field: str
    run: int
    step: int
    particles: int = Field(description="outside the rounding bound of the field as it should be")
    of: int
    relative: float | None = Field(description="largest difference over the largest right value; null if these are 0")
    factor: float | None = Field(description="if the field is a multiple of the right one")


class ActingRecord(Record):
    """A finding that acts on an audited deck by its definitions, whether or not a compared field shows it."""

    finding: str
    does: str = Field(description="what it does there")
    own: bool = Field(False, description="whether these words are of this deck, and not those of the finding")
    severity: Severity = Field("high", description="of the finding; on a deck where the size of its effect is unknown")
    fields: list[str] = Field([], description="those that it changes and that cannot be predicted here")


class BreakRecord(Record):
    """The first sample in which the state of an audited deck is not that of a fluid, whichever code evaluates it."""

    kind: Literal["not a number", "runaway"]
    run: int
    step: int
    column: str = Field(description="as LAMMPS names it: vx, rho, energy, f")
    atom: int = Field(description="the first particle of which it holds")
    value: float
    particles: int
    of: int
    both: bool = Field(description="whether the reference has it from the same state as well, so that codes agree")
    given: bool = Field(False, description="whether a run begins with it")


class LostRecord(Record):
    """Particles that an audited run lost, with LAMMPS' error or without one (thermo_modify lost ignore)."""

    lost: int
    of: int
    run: int
    step: int = Field(description="of the sample after which no more are lost, or the end of the run")
    ignored: bool = Field(description="whether the deck tells LAMMPS to go on")


class OutlookRecord(Record):
    """Why an audited run broke off: how the reference continues from its last good sample."""

    cause: Literal["findings", "time step", "set-up", "not understood"]
    because: str = Field("", description="what is wrong with the set-up, in a few words: mass is 4e4 times rho0 V")
    findings: list[str] = Field([], description="that make the reference run away, which without them does not")
    run: int
    step: int = Field(description="of the last good sample")
    taken: int = Field(description="steps that LAMMPS took from there")
    after: int | None = Field(None, description="steps after which the reference runs away, with the findings if any")
    steps: int = Field(description="steps that the reference was given")
    particles: int | None = Field(None, description="that the reference was given, if not all; those at the rim held")
    of_particles: int | None = Field(None, description="of how many these are")
    around: int | None = Field(None, description="the atom in the middle: the fastest, or that with the largest force")


class BudgetPart(Record):
    """What a part of the model adds to momentum and energy per unit of time, summed over all particles."""

    name: str
    force: list[float] = Field([], description="sum of the forces; empty: none")
    power: float = Field(0.0, description="rate of the kinetic energy")
    storage: float = Field(0.0, description="rate of the energy of compression, the sum of m P/rho^2 drho/dt")
    heat: float = Field(0.0, description="rate of the heat")


class BudgetRecord(Record):
    """Conserved quantities of an audited deck in one sample."""

    run: int
    step: int
    mass: float
    volume: float = Field(description="sum of m/rho")
    momentum: list[float]
    kinetic: float = Field(description="kinetic energy")
    size: float = Field(description="sum of the absolute components of the forces of pairs")
    residual: dict[str, float] = Field(description="sums that are 0 where the formulas conserve a quantity, by name")
    bound: dict[str, float] = Field(description="their largest values by rounding alone")
    parts: list[BudgetPart]
    pairs: BudgetPart = Field(description="all that pairs do")
    press: float | None = Field(None, description="pressure of the system, at the set-up of a run")
    press_findings: list[str] = Field([], description="that can change the pressure that LAMMPS prints")
    findings: list[BudgetPart] = Field([], description="all that pairs do with a finding, by its id")


class SeriesRecord(Record):
    """A run of the reference from the first sample of an audited deck's last run, with one change."""

    name: str
    findings: list[str] = Field([])
    steps: list[int] = Field(description="of the deck, at which the other numbers are taken")
    kinetic: list[float]
    momentum: list[list[float]]
    seconds: float = 0.0
    ended: str = Field("", description="why it broke off, if it did")


class ClosedRecord(Record):
    """A closed solution of the flow that an audited deck sets up."""

    flow: str
    quantity: str
    about: str
    steps: list[int]
    values: list[float] = Field(description="of the quantity at these steps")
    decays: bool = Field(False, description="whether rates are compared, not values")


def as_expected(verdict: Verdict, expects: str) -> bool:
    """Return whether a verdict leaves a run green, for a case that expects a refusal with some text, or none."""
    return bool(expects) if verdict == "refused" else verdict in ("exact", "pass", "explained", "skipped")


def worst(verdicts: list[Verdict]) -> Verdict:
    """Return the worst of some verdicts; `skipped` without any."""
    return max(verdicts, key=BY_SEVERITY.index, default="skipped")


def digest(*parts: npt.NDArray[Any] | str) -> str:
    """Hash arrays of doubles bit by bit, or other digests: the first 64 bits of SHA-256, in hexadecimal."""
    sha256 = hashlib.sha256()
    for part in parts:
        sha256.update(part.encode() if isinstance(part, str) else np.ascontiguousarray(part, float).tobytes())
    return sha256.hexdigest()[:16]
