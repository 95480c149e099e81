"""Why a deck's run broke off: what the reference makes of the last good sample."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.errors import InputError
from eos_ref.model.parameters import Force, IntArray, Model
from eos_ref.numbers.number import Array
from lammps_cases.audit.effects import effects
from lammps_cases.audit.evaluation import ParticleSample, acted_on
from lammps_cases.findings import Finding
from lammps_cases.records.case_parts import EffectRecord, OutlookRecord
from lammps_cases.studies.stability.limits import numbers
from lammps_cases.verdict.runaway import Attempts


@dataclass(frozen=True)
class Good:
    """The last sample before the end that looks like a fluid: with the time step, the run and the step it is of."""

    sample: ParticleSample
    timestep: float
    run: int
    step: int
    id_n: IntArray


def outlook(
    good: Good, engine: str, taken: int, brief: str = "", unpredictable: Sequence[Finding] = ()
) -> tuple[OutlookRecord | None, list[EffectRecord]]:
    """Return why a run broke off, and what findings do to the particles that the reference makes of the sample.

    A lattice at rest feels no force yet, right or wrong; some steps later it does. The latter is left out where the
    particles are too many to follow them all.

    Parameters
    ----------
    taken : steps that LAMMPS took from the sample
    brief : what is wrong with the set-up, in a few words
    unpredictable : findings that change forces of the sample in a way that cannot be evaluated
    """
    sample, model = boxed(good.sample), model_with_forces(good.sample)

    def forces(force_nc: Array, mass_n: FloatArray, rows_n: IntArray) -> Any:
        return acted_on(force_nc, [(action, acts_n[rows_n]) for action, acts_n in sample.actions], mass_n)

    start = replace(sample.problem(("f",)), model=model or sample.model, timestep=good.timestep)
    attempts = Attempts(start, taken, good.id_n, None if model else forces)
    try:
        record = attempts.cause(engine, good.run, good.step)
        if record.cause == "findings" and record.of_particles is None:
            state = attempts.state_after(record.after or 0)
            step = good.step + (record.after or 0)
            return record, effects(replace(good.sample, state=state), engine, good.run, step)
    except InputError:  # the reference does not take the particles as they are
        return None, []
    if record.cause == "not understood" and unpredictable:
        names = [entry.id for entry in unpredictable]
        return record.model_copy(update={"cause": "findings", "findings": names}), []
    because = {"set-up": brief, "time step": _limit(good)}.get(record.cause, "")
    return record.model_copy(update={"because": because}), []


def _limit(good: Good) -> str:
    """Return how many times its limit by theory the time step is, and of what that is."""
    step = numbers(good.sample.model, good.sample.state, good.timestep)
    of = "sound" if step.viscous <= step.acoustic else "conduction" if step.conducts else "viscosity"
    return f"time step is {step.fraction:.3g} times the limit of {of} at step {good.step}"


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
