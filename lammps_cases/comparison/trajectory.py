"""Predictions of the reference for a scene of the particle model: fields at some steps, each with its bound.

The bound of a single evaluation follows from its formulas (`eos_ref.numbers.rounded`). Over steps rounding grows:
the bound is the spread of reference runs in which every evaluation is moved by its own bound and every update of the
state by one unit of the last place, with random signs, in one run of three the same at every step: numbers that hardly
change round the same way. The sum of updates that all round one way is added. Where units round the input itself,
runs from moved input add their spread (`lammps_cases.comparison.perturbation`).
"""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from eos_ref.eos.bounds import EPS
from eos_ref.eos.table import FloatArray
from eos_ref.errors import InputError
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.blocks import count_rounded, in_blocks
from eos_ref.evaluation.cutoff import at_cutoff
from eos_ref.evaluation.evaluator import Evaluator
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.box import Box, Deform
from eos_ref.model.quantities import QUANTITIES
from eos_ref.model.state import Gradients, PairTerms
from eos_ref.numbers.rounded import Rounded, error
from lammps_cases.comparison.perturbation import Signs, moved_input
from lammps_cases.comparison.problem import Problem, ProblemStop
from lammps_cases.records.progress import stage

Fields = dict[str, Any]
MOVED_RUNS = 3
MOVED_PARTICLES = 48  # in all runs: random signs move half of all pairs as a whole, without effect between the two
UPDATES = 3  # updates of a value in a step, at most: two halves, and the shift
# Loading the compiled loops takes 0.456 s; they then save 7.92 us per evaluation of a particle. Both are
# rounded measurements of one machine, fixed here so that the size of a scene alone determines its bits.
COMPILED_ABOVE = int(0.456 / 7.92e-6)


@dataclass(frozen=True)
class Prediction:
    """Fields of the reference at the steps of a scene, and the bound of each."""

    fields: tuple[Fields, ...]
    bounds: tuple[Fields, ...]


def visit(sim: Simulation, steps: Sequence[int], dt: float, stops: Sequence[ProblemStop] = ()) -> Iterator[int]:
    """Run a simulation, halting at each step given (0: the first evaluation), at a stop once the next run has begun."""
    sim.setup()
    done, stop_at = 0, {stop.step: stop for stop in stops if stop.step <= steps[-1]}
    for step in sorted({*steps, *stop_at}):
        sim.run(step - done, dt)
        done = step
        if stop := stop_at.get(step):
            if stop.minimized:
                sim.minimize()
            if stop.box is not None:
                sim.remap(stop.box)
            if stop.by_nc is not None:
                sim.state.x_nc = sim.state.x_nc + stop.by_nc
            if isinstance(sim, Shaken):
                sim.shake(0.5 * 10.0 ** (1 - stop.digits) if stop.digits else 0.0)
            if not stop.continued:
                sim.begin_again(stop.new_n, stop.read_back)
            dt = stop.timestep or dt
        if step in steps:
            yield step


def predict(
    problem: Problem,
    evaluator: type[ArrayEvaluator] | None = None,
    stepping: type[Simulation] = Simulation,
    seed: int = 0,
    halts: dict[int, Halt] | None = None,
) -> Prediction:
    """Return the fields at some steps with their bounds.

    Parameters
    ----------
    evaluator, stepping : class
        The stages, and the order in which a step takes them; a variant's, for a finding. By default the reference's
        own stages, compiled if the scene is large enough to be worth loading them.
    seed : int
        For the random signs of the moved runs.
    halts : dict
        The simulation at every step; an empty dict receives them.
    """
    *_, prediction = widening(problem, evaluator, stepping, seed, halts)
    return prediction


def widening(
    problem: Problem,
    evaluator: type[ArrayEvaluator] | None = None,
    stepping: type[Simulation] = Simulation,
    seed: int = 0,
    halts: dict[int, Halt] | None = None,
) -> Iterator[Prediction]:
    """Yield the fields at some steps with bounds that grow by one moved run after another; see `predict`.

    The first are those of the evaluations alone, the last those of all runs: once LAMMPS is inside, no more are needed.
    """
    fields, steps = problem.fields, problem.steps
    count = _in_blocks(problem)
    stages = in_blocks(evaluator, count) if evaluator else own_stages(problem)
    bounding = in_blocks(at_cutoff(evaluator or ArrayEvaluator), count)
    values, own, sizes = [], [], Sizes()
    for step, halt in halts.items() if halts else reached(problem, problem.simulation(stages, stepping), halts):
        with stage("bounds"):
            count_rounded(len(problem.state.x_nc))
            errors = halt.sim.rounded(bounding)
            sizes.add(errors)  # of step 0 in any case: later all particles may be frozen, without erring forces
            if step in steps:
                values.append(halt.fields)
                own.append({field: _output_error(errors, field, halt.fields[field], step) for field in fields})
            consistent = halt.sim.units.consistent
            del errors, halt  # a large scene's arrays, before those of the next step are made
    spreads: list[Fields] = [dict.fromkeys(fields, 0.0) for _ in steps]

    def so_far() -> Prediction:
        bounds = tuple({f: own[k][f] + spreads[k][f] for f in fields} for k in range(len(steps)))
        return Prediction(tuple(values), bounds)

    yield so_far()
    for run in _moved_runs(problem, stages, stepping, sizes, seed) if problem.goes_on else ():
        with stage("bounds"):
            _follow(run, problem, problem.timestep, values, spreads, first=bool(problem.stops))
        yield so_far()
    if not consistent:  # the factors round the input
        with stage("bounds"):
            more = input_spread(problem, stages, stepping, values, seed)
            spreads = [{f: spread[f] + other[f] for f in fields} for spread, other in zip(spreads, more, strict=True)]
        yield so_far()


@dataclass(frozen=True, eq=False)
class Halt:
    """A simulation halted at a step, without the pairs, which take most memory; and its fields."""

    sim: Simulation
    fields: Fields

    @classmethod
    def of(cls, sim: Simulation, fields: Sequence[str] = ()) -> Self:
        """Return the snapshot of a simulation."""
        halt = copy.copy(sim)
        halt.state = replace(sim.state)  # steps make new arrays for all that they change
        del halt.evaluator
        return cls(halt, {field: sim.output(field).copy() for field in fields})


def reached(problem: Problem, sim: Simulation, halts: dict[int, Halt] | None = None) -> Iterator[tuple[int, Halt]]:
    """Run a scene; yield its state at step 0 and at every step, and add all of these to ``halts`` at the end."""
    found = {}
    for step in visit(sim, (0, *problem.steps), problem.timestep, problem.stops):
        halt = Halt.of(sim, problem.fields)
        if halts is not None:
            found[step] = halt
        yield step, halt
    if halts is not None:
        halts.update(found)


def halted(problem: Problem, steps: Sequence[int]) -> dict[int, Simulation]:
    """Run a scene; return its states at some steps."""
    sim: Simulation = problem.simulation()
    return {step: Halt.of(sim).sim for step in visit(sim, steps, problem.timestep, problem.stops)}


def evaluations(problem: Problem) -> int:
    """Return the number of evaluations of particles in all runs that predict a scene."""
    runs = 1 + moved_runs(problem) * bool(problem.steps[-1])
    return len(problem.state.x_nc) * (1 + problem.steps[-1]) * runs


def moved_runs(problem: Problem) -> int:
    """Return the number of moved runs: more for few particles, so that enough signs are drawn."""
    return max(MOVED_RUNS, math.ceil(MOVED_PARTICLES / max(len(problem.state.x_nc), 1)))


def _in_blocks(problem: Problem) -> int:
    """Return the number of particles that may be evaluated in blocks: 0 if they follow a growing box."""
    return 0 if problem.model.deform else len(problem.state.x_nc)


def own_stages(problem: Problem) -> type[Evaluator]:
    """Return the reference's own evaluator: compiled from `COMPILED_ABOVE` evaluations on, in an upright, fixed box."""
    if problem.box.tilted or problem.model.deform or evaluations(problem) <= COMPILED_ABOVE:
        return in_blocks(ArrayEvaluator, _in_blocks(problem))
    from eos_ref.compiled.evaluator import CompiledEvaluator  # heavy, and useful only for large problems

    return CompiledEvaluator


# --- one evaluation


def _output_error(twin: Simulation, field: str, values: FloatArray, step: int) -> Any:
    if QUANTITIES[field].integrated and step > 0:  # the errors of forces and rates are in the spread
        return np.zeros(np.shape(values)) if QUANTITIES[field].discrete else _summed_up(values, step)
    return error(twin.output(field))


def _summed_up(values: FloatArray, steps: int) -> FloatArray:
    """Return how far the sums of the increments of some steps may differ between two codes.

    Each rounds its sums by one unit roundoff, up to `UPDATES` times a step, and always the same way where increments
    are equal: sums of random signs, as in the moved runs, grow only with the root of their number.
    """
    return 2 * UPDATES * steps * EPS * np.abs(values)


class Sizes(dict[str, FloatArray]):
    """Largest rounding error of every quantity, over the evaluations added."""

    def add(self, twin: Simulation) -> None:
        """Add one evaluation."""
        quantities = twin.fields | {"pressure force": twin.pressure_force_nc, "rho": twin.state.rho_n}
        quantities["virial"] = twin.virial_ncc
        for name, quantity in quantities.items():
            if isinstance(quantity, Rounded):
                self[name] = np.maximum(self.get(name, 0.0), np.where(np.isnan(quantity.error), np.inf, quantity.error))


# --- many steps


def moved(evaluator: type[Evaluator], sizes: Sizes, signs: Signs) -> type[Evaluator]:
    """Return the stages of an evaluator with every result moved by its bound, up or down at random."""

    def move(quantity: Any, name: str) -> Any:
        if quantity is None or name not in sizes:
            return quantity
        return quantity + signs(name, np.shape(quantity)) * sizes[name]

    class Moved(evaluator):  # type: ignore[misc, valid-type]
        def density_sum(self) -> Any:
            return move(super().density_sum(), "rho")

        def interface(self, rho_n: Any, acceleration_nc: Any, energy_n: Any = None) -> Any:
            chi_n, new_n = super().interface(rho_n, acceleration_nc, energy_n)
            return move(chi_n, "chi"), np.where(self.solid_n, move(new_n, "rho"), new_n)

        def gradients(self, *arguments: Any, **options: Any) -> Gradients:
            gradients: Gradients = super().gradients(*arguments, **options)
            for name, gradient in vars(gradients).items():
                setattr(gradients, name, move(gradient, f"grad/{name.partition('_')[0]}"))
            return gradients

        def shift(self, v_nc: Any, rho_n: Any) -> Any:
            return move(super().shift(v_nc, rho_n), "shift/v")

        def pair_terms(self, *arguments: Any, **options: Any) -> PairTerms:
            terms = super().pair_terms(*arguments, **options)
            names = ("f", "pressure force", "drho", "heatflow", "stress/atom", "virial")
            return PairTerms(*(move(term, name) for term, name in zip(vars(terms).values(), names, strict=True)))

    return Moved


def precise_setup(problem: Problem) -> Fields:
    """Return the fields of the first evaluation in extended precision."""
    stages = in_blocks(ArrayEvaluator, len(problem.state.x_nc))
    twin: Simulation = problem.simulation().precise(stages)
    return {field: twin.output(field) for field in problem.fields}


class Shaken(Simulation):
    """Stepping that moves the state by one unit of the last place after every update; made by `shaken`.

    A step updates it twice: before its evaluation, and after it.
    """

    signs: Signs

    def evaluate(self) -> Fields:
        """Evaluate a state after one more move, unless it is the initial one."""
        if not self.fresh:
            self.shake()
        return super().evaluate()

    def step(self, dt: float) -> None:
        """Take a step, and move the state."""
        super().step(dt)
        self.shake()

    def remap(self, box: Box) -> None:
        """Change box and positions; move these by all roundings on the way to fractions and back, 6 on either side."""
        super().remap(box)
        reach_c = np.abs(box.low_c) + np.array(box.edge_c)
        size_c = 6 * EPS * reach_c + box.rounding(self.model.cut)
        self.state.x_nc = self.state.x_nc + self.signs("x", self.state.x_nc.shape) * size_c

    def grown(self, by: Deform, time: float) -> Box:
        """Return the box with its corners moved by all roundings in their calculation, 6 on either side."""
        box = super().grown(by, time)
        moved = 6 * EPS * np.maximum(np.abs(box.low_c), np.abs(box.high_c))
        low_c, high_c = (
            np.array(end_c) + self.signs(name, moved.shape) * moved
            for name, end_c in (("low", box.low_c), ("high", box.high_c))
        )
        tilt = np.array(box.tilt)
        tilt = tilt + self.signs("tilt", tilt.shape) * 6 * EPS * np.abs(tilt) * bool(by.shear)
        return replace(box, low_c=tuple(low_c.tolist()), high_c=tuple(high_c.tolist()), tilt=tuple(tilt.tolist()))

    def shake(self, relative: float = 0.0) -> None:
        """Move the state by one unit of the last place and by a fraction of every value, with random signs."""
        s = self.state
        reach_c = np.maximum(np.abs(self.box.low_c), np.abs(self.box.high_c))  # a wrapped coordinate rounds so
        size_nc = EPS * reach_c + self.box.rounding(self.model.cut) + relative * np.abs(s.x_nc)
        s.x_nc = s.x_nc + self.signs("x", s.x_nc.shape) * size_nc
        s.v_nc = s.v_nc * (1 + (EPS + relative) * self.signs("v", s.v_nc.shape))
        if (moving_cc := self.evaluator.image_velocity_cc) is not None:  # changes of a particle at the boundary
            size_cc = 2 * EPS * np.abs(moving_cc) + self.evaluator.image_rounding_cc
            s.v_nc = s.v_nc + self.signs("v", s.v_nc.shape) * size_cc.sum(axis=0)
        s.rho_n = s.rho_n * (1 + (EPS + relative) * self.signs("rho", s.rho_n.shape))
        if s.energy_n is not None:
            s.energy_n = s.energy_n * (1 + (EPS + relative) * self.signs("energy", s.energy_n.shape))


def shaken(stepping: type[Simulation], signs: Signs) -> type[Simulation]:
    """Return a stepping in which the state moves by one unit of the last place whenever a step has updated it."""
    return type("ShakenSteps", (Shaken, stepping), {"signs": signs})


def _moved_runs(
    problem: Problem, evaluator: type[Evaluator], stepping: type[Simulation], sizes: Sizes, seed: int
) -> Iterator[Simulation]:
    for k in range(moved_runs(problem)):
        signs = Signs(np.random.default_rng((seed, k)), kept=k % MOVED_RUNS == 0)
        steps = shaken(stepping, signs)
        stages = moved(evaluator, sizes, signs)
        yield problem.simulation(stages, steps)


def input_spread(
    problem: Problem, stages: type[Evaluator], stepping: type[Simulation], values: Sequence[Fields], seed: int
) -> list[Fields]:
    """Return the largest distance between a run's fields and those of runs with moved input, per field and step."""
    largest: list[Fields] = [dict.fromkeys(problem.fields, 0.0) for _ in problem.steps]
    for k in range(moved_runs(problem)):
        other = moved_input(problem, np.random.default_rng((seed, k, 1)))
        run = other.simulation(stages, stepping)
        _follow(run, problem, other.timestep, values, largest)
    return largest


def _follow(
    run: Simulation, problem: Problem, dt: float, values: Sequence[Fields], largest: list[Fields], first: bool = True
) -> None:
    """Widen a spread by a run, at step 0 if ``first``; from where a run fails, nothing is bounded."""
    at = -1
    try:
        for at, step in enumerate(visit(run, problem.steps, dt, problem.stops)):
            if step or first:
                _widen(largest[at], run, values[at])
    except InputError:
        for later in largest[at + 1 :]:
            later.update(dict.fromkeys(later, np.inf))


def _widen(largest: Fields, run: Simulation, values: Fields) -> None:
    """Widen a spread, per field, to include a run."""
    for field in largest:
        distance = np.abs(run.output(field) - values[field])
        distance = np.where(np.isfinite(distance), distance, np.inf)  # a failed run bounds nothing
        # Counts and classes change by whole numbers, and only where rounding decides: particle by particle.
        far = distance if QUANTITIES[field].discrete else distance.max(initial=0.0)
        largest[field] = np.maximum(largest[field], far)
