"""What the audit of a deck finds beside verdicts: effects of findings, budgets, runs of the reference."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from lammps_cases.records.documents import Record
from lammps_cases.records.levels import Severity


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
    severity: Severity = Field("high", description="of the finding; on a deck where nobody knows by how much it acts")
    fields: list[str] = Field([], description="those that it changes and that cannot be predicted here")


class BreakRecord(Record):
    """The first sample in which the state of an audited deck is none of a fluid, whichever code evaluates it."""

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
    """Particles that an audited run has lost, with LAMMPS' error or without one (thermo_modify lost ignore)."""

    lost: int
    of: int
    run: int
    step: int = Field(description="of the sample after which no more are lost, or the end of the run")
    ignored: bool = Field(description="whether the deck tells LAMMPS to go on")


class OutlookRecord(Record):
    """Why an audited run broke off: what the reference does from its last good sample on."""

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
    bound: dict[str, float] = Field(description="what rounding makes of them at most")
    parts: list[BudgetPart]
    pairs: BudgetPart = Field(description="all that pairs do")
    press: float | None = Field(None, description="pressure of the system, at the set-up of a run")
    press_findings: list[str] = Field([], description="that can change the pressure that LAMMPS prints")
    findings: list[BudgetPart] = Field([], description="all that pairs do with a finding, by its id")


class SeriesRecord(Record):
    """A run of the reference from the first sample of an audited deck's last run, with one thing changed."""

    name: str
    findings: list[str] = Field([])
    steps: list[int] = Field(description="of the deck, at which the others are taken")
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
