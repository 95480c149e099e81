"""Diagnosis of a failed run: the reference continues from a state, with and without the findings of the engine."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.box import BoolArray
from eos_ref.model.parameters import IntArray, Model
from eos_ref.model.quantities import needed_to_step
from eos_ref.model.state import Gradients, State, masses
from eos_ref.numbers.elementary import where
from lammps_cases.comparison.problem import Problem
from lammps_cases.comparison.trajectory import own_stages
from lammps_cases.findings import Finding, applicable
from lammps_cases.findings.variants import combined
from lammps_cases.records.case_parts import OutlookRecord
from lammps_cases.records.run_record import CaseRecord

STEPS = (50, 500)  # steps of an attempt at least and at most, else twice as many as LAMMPS took
MOST = 2_000  # particles of an attempt; from larger problems those around the one likeliest to run away are cut out
RIM = 2  # cutoffs: moving particles and their neighbours have all their own neighbours
FINER = 10  # a time step is too large if a tenth of it is not
RUNAWAY = 10.0  # a speed, density or energy beyond this multiple of the largest initial one is not a fluid's

# LAMMPS' messages after particles have run away.
LOST = re.compile(
    "Lost atoms|Non-numeric atom coords|Domain too large for neighbor bins|instead of '-?nan'"
    "|Replicate did not assign all atoms|Too many atom sorting bins"
)

# Forces including those of other fixes, from those of pairs, the masses and the rows of the particles.
External = Callable[[Any, FloatArray, IntArray], Any]


@dataclass(frozen=True)
class CutOut:
    """Particles of a problem around one of them.

    Attributes
    ----------
    problem : of these particles alone
    rows_k : their rows, (k,)
    held_k : those in the rim, (k,): without all their neighbours they are left as they are
    around : the row of the central one
    """

    problem: Problem
    rows_k: IntArray
    held_k: BoolArray
    around: int


def cut_out(problem: Problem, around: int, most: int) -> CutOut:
    """Return the nearest particles to one of a problem, in its box; all of them if they are not too many."""
    state, n = problem.state, len(problem.state.x_nc)
    if n <= most:
        return CutOut(problem, np.arange(n), np.zeros(n, bool), around)
    apart_nc = state.x_nc - state.x_nc[around]
    r_n = np.linalg.norm(apart_nc - problem.box.shift(problem.box.periods(apart_nc)), axis=1)
    radius = np.partition(r_n, most - 1)[most - 1]
    rows_k = np.flatnonzero(r_n <= radius)
    held_k = r_n[rows_k] > radius - min(RIM * problem.model.cut, radius / 2)
    some = replace(state, **{name: of[rows_k] for name, of in vars(state).items() if of is not None})
    return CutOut(replace(problem, state=some), rows_k, held_k, around)


def likeliest(problem: Problem, force_nc: FloatArray | None = None) -> int:
    """Return the row of the fastest particle of fluid, or of that with the largest force if all are at rest.

    The forces are evaluated if they are not given.
    """
    size_n = np.abs(problem.state.v_nc).max(axis=1)
    fluid_n = ~problem.state.solid_n
    if not size_n[fluid_n].any():
        if force_nc is None:
            one = replace(problem, steps=(0,))
            run = Simulation(problem.model, problem.box, problem.state, ("f",), own_stages(one))
            run.setup()
            force_nc = run.output("f")
        size_n = np.abs(force_nc).max(axis=1)
    return int(np.argmax(np.where(fluid_n, size_n, -1.0)))


class _Given(ArrayEvaluator):
    """Stages that sum no densities of held particles."""

    part: CutOut

    def density_sum(self) -> Any:
        return where(self.part.held_k, self.part.problem.state.rho_n, super().density_sum())


class _Acted(Simulation):
    """Steps with the forces of other fixes, and with held particles."""

    part: CutOut
    other: tuple[External] | None  # in a tuple, as it is not a method

    def _external(self, force_nc: Any) -> Any:
        rows_k = self.part.rows_k
        acted_nc: Any = self.other[0](force_nc, self.mass_n, rows_k) if self.other else super()._external(force_nc)
        return np.where(self.part.held_k[:, None], 0.0, acted_nc)

    def _shift(self, dt: float, shift_nc: Any, gradient: Gradients) -> None:
        super()._shift(dt, np.where(self.part.held_k[:, None], 0.0, shift_nc), gradient)


def fastest(model: Model, state: State) -> float:
    """Return the largest speed present: of sound, of heat as sound for a gas, or of a particle."""
    speeds = [*(law.cs for law in model.eos.laws), float(np.abs(state.v_nc).max(initial=0.0))]
    if model.eos.needs_energy and state.energy_n is not None:
        speeds.append(float(np.sqrt(2 * np.abs(state.energy_n / masses(model, state)).max(initial=0.0))))
    return max(speeds)


def diverged(record: CaseRecord) -> bool:
    """Return whether LAMMPS ended a case as it does when particles have run away, or returned no numbers."""
    if record.verdict == "refused":
        return not record.expects and LOST.search(record.engine_error) is not None
    lammps = record.blame.lammps if record.blame else None
    return record.verdict == "differs" and lammps is not None and not np.isfinite(lammps)


def touching(problem: Problem, engine: str) -> list[Finding]:
    """Return the findings of an engine that can be added to the reference for a problem, without LAMMPS' numbers."""
    listed = (entry for entry in applicable(problem) if entry.listed(engine))
    return [entry for entry in listed if entry.model_variant and not entry.model_variant.fit]


def left_open(problem: Problem, engine: str) -> list[str]:
    """Return the findings of an engine that leave values of a problem without a bound, whose effect is unknown."""
    listed = (entry for entry in applicable(problem, lists=True) if entry.listed(engine))
    return [entry.id for entry in listed if entry.model_variant and entry.model_variant.undefined]


@dataclass(frozen=True)
class Attempts:
    """Runs of the reference from a valid state of a fluid.

    Attributes
    ----------
    start : the state with its time step, at step 0
    taken : steps that LAMMPS took after it
    id_n : ids of the particles
    external : the forces of other fixes, where these differ from the model's
    """

    start: Problem
    taken: int
    id_n: IntArray
    external: External | None = None

    @property
    def count(self) -> int:
        """Return the number of steps of an attempt."""
        return min(max(2 * self.taken, STEPS[0]), STEPS[1])

    @cached_property
    def part(self) -> CutOut:
        """Return the particles that are followed; the held ones are at rest."""
        part = cut_out(self.start, likeliest(self.start) if len(self.id_n) > MOST else 0, MOST)
        state = part.problem.state
        at_rest = replace(state, v_nc=np.where(part.held_k[:, None], 0.0, state.v_nc))
        return replace(part, problem=replace(part.problem, state=at_rest))

    def cause(self, engine: str, run: int, step: int) -> OutlookRecord:
        """Return the likeliest cause of an end that came after a state, at a step of a run.

        If the reference runs away, the set-up is to blame, or the time step if a tenth of it does not. If not, the
        findings of the engine are added to it, each alone and finally all together: the first that makes it run away is
        the cause.

        Raises
        ------
        InputError
            The reference rejects the state.
        """
        dt = self.start.timestep
        record = OutlookRecord(cause="not understood", run=run, step=step, taken=self.taken, steps=self.count)
        if len(self.part.rows_k) < len(self.id_n):
            record.particles, record.of_particles = len(self.part.rows_k), len(self.id_n)
            record.around = int(self.id_n[self.part.around])
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
            The reference rejects the state.
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
        """Return the particles of the reference, without findings, after some steps."""
        sim = self._simulation(self.start.timestep, steps, ())
        sim.setup()
        sim.run(steps, self.start.timestep)
        return sim.state

    def _simulation(self, timestep: float, steps: int, entries: Sequence[Finding]) -> Simulation:
        fields = needed_to_step(self.start.model)
        problem = replace(self.part.problem, timestep=timestep, fields=fields, steps=(0, steps))
        variants = [entry.model_variant for entry in entries if entry.model_variant]
        stages, stepping = combined(variants, problem, {}) or (ArrayEvaluator, Simulation)
        stages = stages if entries else own_stages(problem)  # type: ignore[assignment]
        if self.external or self.part.held_k.any():
            other = (self.external,) if self.external else None
            stepping = type("Acted", (_Acted, stepping), {"part": self.part, "other": other})
        if self.part.held_k.any():
            stages = type("Given", (_Given, stages), {"part": self.part})
        return stepping(problem.model, problem.box, problem.state, fields, stages)


def _sets(entries: Sequence[Finding]) -> Iterator[tuple[Finding, ...]]:
    """Yield each finding alone, the most severe first, and all of them."""
    order = ("high", "medium", "low")
    alone = sorted(entries, key=lambda entry: order.index(entry.severity))
    yield from ((entry,) for entry in alone)
    if len(alone) > 1:
        yield tuple(alone)
