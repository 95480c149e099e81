"""Why a run broke off: the reference goes on from the last good sample, with and without the findings of the engine."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from eos_ref.errors import InputError
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.parameters import Force, Model
from eos_ref.model.quantities import needed_to_step
from eos_ref.model.state import State
from lammps_cases.audit.effects import effects, touching
from lammps_cases.audit.evaluation import ParticleSample
from lammps_cases.audit.health import RUNAWAY, fastest
from lammps_cases.comparison.problem import Problem
from lammps_cases.comparison.trajectory import own_stages
from lammps_cases.findings import Finding
from lammps_cases.findings.variants import combined
from lammps_cases.records.audit_record import EffectRecord, OutlookRecord
from lammps_cases.studies.stability.limits import numbers

STEPS = (50, 500)  # that an attempt takes at least and at most, else twice as many as LAMMPS took
WORK = 1_000_000  # steps times particles of an attempt, beyond which it would take longer than a user waits
FINER = 10  # a time step is too large if this part of it is not

Cause = Literal["findings", "time step", "set-up", "not understood"]


@dataclass(frozen=True)
class Good:
    """The last sample before the end that looks like a fluid: with the time step, the run and the step it is of."""

    sample: ParticleSample
    timestep: float
    run: int
    step: int


def outlook(
    good: Good, engine: str, taken: int, brief: str = "", unpredictable: Sequence[Finding] = ()
) -> tuple[OutlookRecord | None, list[EffectRecord]]:
    """Return why a run broke off, and what findings do to the particles that the reference makes of the sample.

    A lattice at rest feels no force yet, right or wrong; some steps later it does.

    Parameters
    ----------
    taken : steps that LAMMPS took from the sample
    brief : what is wrong with the set-up, in a few words
    unpredictable : findings that change forces of the sample in a way that cannot be evaluated
    """
    model = model_with_forces(good.sample)
    if model is None:
        return None, []
    count = min(max(2 * taken, STEPS[0]), STEPS[1], WORK // len(good.sample.mass_n))
    if count < STEPS[0]:
        return None, []
    attempts = _Attempts(replace(good, sample=boxed(good.sample)), model, count)
    try:
        record = _cause(attempts, engine, taken, brief, unpredictable)
        if record.cause != "findings":
            return record, []
        state = attempts.state_after(record.after or 0)
        return record, effects(replace(good.sample, state=state), engine, good.run, good.step + (record.after or 0))
    except InputError:  # the reference does not take the particles as they are
        return None, []


def _cause(attempts: _Attempts, engine: str, taken: int, brief: str, unpredictable: Sequence[Finding]) -> OutlookRecord:
    """Return the likeliest cause of an end that came ``taken`` steps after a good sample.

    The reference runs on from the sample: if it runs away, the set-up is to blame, or the time step if a tenth of it
    does not. If not, the findings of the engine are put into it, each alone and at last all together: the first that
    makes it run away is the cause. Else it is what nobody can put into it, if there is any.
    """
    good = attempts.good

    def record(
        cause: Cause, entries: Sequence[Finding] = (), after: int | None = None, because: str = ""
    ) -> OutlookRecord:
        names = [entry.id for entry in entries]
        return OutlookRecord(
            cause=cause, because=because, findings=names,
            run=good.run, step=good.step, taken=taken, after=after, steps=attempts.count,
        )  # fmt: skip

    after = attempts.runaway(good.timestep, ())
    if after is not None:
        finer = attempts.runaway(good.timestep / FINER, (), 2 * FINER * after)
        if finer is not None:
            return record("set-up", after=after, because=brief)
        return record("time step", after=after, because=_limit(attempts.model, good))
    for entries in _sets(touching(good.sample, engine)):
        after = attempts.runaway(good.timestep, entries)
        if after is not None:
            return record("findings", entries, after)
    return record("findings", unpredictable) if unpredictable else record("not understood")


def _limit(model: Model, good: Good) -> str:
    """Return how many times its limit by theory the time step is, and of what that is."""
    step = numbers(model, good.sample.state, good.timestep)
    of = "sound" if step.viscous <= step.acoustic else "conduction" if step.conducts else "viscosity"
    return f"time step is {step.fraction:.3g} times the limit of {of}"


def _sets(entries: Sequence[Finding]) -> Iterator[tuple[Finding, ...]]:
    """Yield each finding alone, the most severe first, and all of them."""
    order = ("high", "medium", "low")
    alone = sorted(entries, key=lambda entry: order.index(entry.severity))
    yield from ((entry,) for entry in alone)
    if len(alone) > 1:
        yield tuple(alone)


def boxed(sample: ParticleSample) -> ParticleSample:
    """Return a sample whose particles lie in its box: between two lists of neighbours LAMMPS lets them leave it."""
    box, x_nc = sample.box, sample.state.x_nc
    x_nc = x_nc - box.shift(box.images(x_nc))
    ends = np.where(box.periodic, (box.low_c, box.high_c), (x_nc.min(axis=0), x_nc.max(axis=0)))
    low_c, high_c = np.minimum(box.low_c, ends[0]), np.maximum(box.high_c, ends[1])
    grown = replace(box, low_c=tuple(map(float, low_c)), high_c=tuple(map(float, high_c)))
    return replace(sample, box=grown, state=replace(sample.state, x_nc=x_nc))


def model_with_forces(sample: ParticleSample) -> Model | None:
    """Return the model with the forces of the deck, or None if these act on other groups than types."""
    forces, type_n = [], sample.state.type_n
    for action, acts_n in sample.actions:
        types = tuple(int(t) for t in np.unique(type_n[acts_n]))
        if not np.array_equal(acts_n, np.isin(type_n, types)):
            return None
        forces.append(Force(action.style, action.vector[: sample.model.dimension], types))  # type: ignore[arg-type]
    return replace(sample.model, forces=tuple(forces))


@dataclass
class _Attempts:
    """Runs of the reference from a sample."""

    good: Good
    model: Model
    count: int

    def runaway(self, timestep: float, entries: Sequence[Finding], steps: int | None = None) -> int | None:
        """Return the number of steps after which it runs away; None if it does not.

        Raises
        ------
        InputError
            The reference does not take the state.
        """
        steps = steps or self.count
        sim = self._simulation(timestep, steps, entries)
        begin = self.good.sample.state
        limit = RUNAWAY * fastest(self.model, begin)
        warmest = 0.0 if begin.energy_n is None else RUNAWAY * float(np.abs(begin.energy_n).max(initial=0.0))
        with np.errstate(all="ignore"):
            sim.setup()
            for step in range(1, steps + 1):
                sim.run(1, timestep)
                if not np.abs(sim.state.v_nc).max(initial=0.0) <= limit:
                    return step
                if warmest and not np.abs(sim.state.energy_n).max(initial=0.0) <= warmest:
                    return step
        return None

    def state_after(self, steps: int) -> State:
        """Return the particles that the reference, as it is, has after some steps."""
        sim = self._simulation(self.good.timestep, steps, ())
        sim.setup()
        sim.run(steps, self.good.timestep)
        return sim.state

    def _simulation(self, timestep: float, steps: int, entries: Sequence[Finding]) -> Simulation:
        sample, fields = self.good.sample, needed_to_step(self.model)
        problem = Problem(self.model, sample.box, sample.state, timestep, fields, (0, steps))
        variants = [entry.model_variant for entry in entries if entry.model_variant]
        stages, stepping = combined(variants, problem, {}) or (ArrayEvaluator, Simulation)
        return stepping(self.model, sample.box, sample.state, fields, stages if entries else own_stages(problem))
