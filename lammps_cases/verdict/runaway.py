"""Why a run went wrong: the reference goes on from a state, with and without the findings of the engine."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.parameters import Model
from eos_ref.model.quantities import needed_to_step
from eos_ref.model.state import State, masses
from lammps_cases.comparison.problem import Problem
from lammps_cases.comparison.trajectory import own_stages
from lammps_cases.findings import Finding, applicable
from lammps_cases.findings.variants import combined
from lammps_cases.records.audit_record import OutlookRecord
from lammps_cases.records.run_record import CaseRecord

STEPS = (50, 500)  # that an attempt takes at least and at most, else twice as many as LAMMPS took
WORK = 1_000_000  # steps times particles of an attempt, beyond which it would take longer than a user waits
FINER = 10  # a time step is too large if this part of it is not
RUNAWAY = 10.0  # a speed, density or energy beyond this many times the largest there was is none of a fluid

# What LAMMPS says where particles have run away.
LOST = re.compile(
    "Lost atoms|Non-numeric atom coords|Domain too large for neighbor bins|instead of '-?nan'"
    "|Replicate did not assign all atoms|Too many atom sorting bins"
)

Cause = Literal["findings", "time step", "set-up", "not understood"]
External = Callable[[Simulation, Any], Any]  # forces with those of other fixes, given those of pairs


def fastest(model: Model, state: State) -> float:
    """Return the largest speed there is: of sound, of heat as sound for a gas, or of a particle."""
    speeds = [*(law.cs for law in model.eos.laws), float(np.abs(state.v_nc).max(initial=0.0))]
    if model.eos.needs_energy and state.energy_n is not None:
        speeds.append(float(np.sqrt(2 * np.abs(state.energy_n / masses(model, state)).max(initial=0.0))))
    return max(speeds)


def diverged(record: CaseRecord) -> bool:
    """Return whether LAMMPS ended a case as it does where particles have run away, or gave no numbers."""
    if record.verdict == "refused":
        return not record.expects and LOST.search(record.engine_error) is not None
    lammps = record.blame.lammps if record.blame else None
    return record.verdict == "differs" and lammps is not None and not np.isfinite(lammps)


def touching(problem: Problem, engine: str) -> list[Finding]:
    """Return the findings of an engine that can be put into the reference for a problem, without LAMMPS' numbers."""
    listed = (entry for entry in applicable(problem) if entry.listed(engine))
    return [entry for entry in listed if entry.model_variant and not entry.model_variant.fit]


@dataclass(frozen=True)
class Attempts:
    """Runs of the reference from a state that is that of a fluid.

    Attributes
    ----------
    start : the state with its time step, at step 0
    taken : steps that LAMMPS took from there
    external : the forces of other fixes, where these are not those of the model
    """

    start: Problem
    taken: int
    external: External | None = None

    @property
    def count(self) -> int:
        """Steps of an attempt; 0 if the particles are too many."""
        count = min(max(2 * self.taken, STEPS[0]), STEPS[1], WORK // max(len(self.start.state.x_nc), 1))
        return count if count >= STEPS[0] else 0

    def cause(self, engine: str, run: int, step: int) -> OutlookRecord:
        """Return the likeliest cause of an end that came after a state, which is of a step of a run.

        If the reference runs away, the set-up is to blame, or the time step if a tenth of it does not. If not, the
        findings of the engine are put into it, each alone and at last all together: the first that makes it run away
        is the cause.

        Raises
        ------
        InputError
            The reference does not take the state.
        """
        dt = self.start.timestep
        record = OutlookRecord(cause="not understood", run=run, step=step, taken=self.taken, steps=self.count)
        after = self.runaway(dt, ())
        if after is not None:
            finer = self.runaway(dt / FINER, (), 2 * FINER * after)
            return record.model_copy(update={"cause": "set-up" if finer is not None else "time step", "after": after})
        for entries in _sets(touching(self.start, engine)):
            after = self.runaway(dt, entries)
            if after is not None:
                names = [entry.id for entry in entries]
                return record.model_copy(update={"cause": "findings", "findings": names, "after": after})
        return record

    def runaway(self, timestep: float, entries: Sequence[Finding], steps: int | None = None) -> int | None:
        """Return the number of steps after which speeds or energies run away; None if they do not.

        Raises
        ------
        InputError
            The reference does not take the state.
        """
        steps = steps or self.count
        sim = self._simulation(timestep, steps, entries)
        begin = self.start.state
        limit = RUNAWAY * fastest(self.start.model, begin)
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
        sim = self._simulation(self.start.timestep, steps, ())
        sim.setup()
        sim.run(steps, self.start.timestep)
        return sim.state

    def _simulation(self, timestep: float, steps: int, entries: Sequence[Finding]) -> Simulation:
        fields = needed_to_step(self.start.model)
        problem = replace(self.start, timestep=timestep, fields=fields, steps=(0, steps))
        variants = [entry.model_variant for entry in entries if entry.model_variant]
        stages, stepping = combined(variants, problem, {}) or (ArrayEvaluator, Simulation)
        if self.external:
            stepping = type("Acted", (stepping,), {"_external": self.external})
        return stepping(problem.model, problem.box, problem.state, fields, stages if entries else own_stages(problem))


def _sets(entries: Sequence[Finding]) -> Iterator[tuple[Finding, ...]]:
    """Yield each finding alone, the most severe first, and all of them."""
    order = ("high", "medium", "low")
    alone = sorted(entries, key=lambda entry: order.index(entry.severity))
    yield from ((entry,) for entry in alone)
    if len(alone) > 1:
        yield tuple(alone)
