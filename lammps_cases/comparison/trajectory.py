"""What the reference predicts for a scene of the particle model: fields at some steps, each with its bound.

The bound of a single evaluation follows from its own formulas (`eos_ref.numbers.rounded`). Over steps rounding grows:
the bound is the spread of reference runs in which every evaluation is moved by its own bound and every update of the
state by one unit of the last place, with random signs.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from eos_ref.eos.bounds import EPS
from eos_ref.eos.table import FloatArray
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.cutoff import at_cutoff
from eos_ref.evaluation.evaluator import Evaluator
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.parameters import Box, Gradients, Model, PairTerms, State
from eos_ref.model.quantities import QUANTITIES, needed_to_step
from eos_ref.numbers.rounded import Rounded, error

Fields = dict[str, Any]
MOVED_RUNS = 3
# Loading the compiled loops takes 0.456 s; from then on they save 7.92 us at every evaluation of a particle. Both are
# rounded measurements of one machine, fixed here so that the size of a scene alone decides which bits it gets.
COMPILED_ABOVE = int(0.456 / 7.92e-6)


@dataclass(frozen=True)
class Problem:
    """A scene as the reference takes it: what it is, the fields compared and the steps at which they are."""

    model: Model
    box: Box
    state: State
    timestep: float
    fields: tuple[str, ...]
    steps: tuple[int, ...]


@dataclass(frozen=True)
class Prediction:
    """Fields of the reference at the steps of a scene, and the bound of each."""

    fields: tuple[Fields, ...]
    bounds: tuple[Fields, ...]


def wanted(problem: Problem) -> tuple[str, ...]:
    """Return the fields compared, and what steps need if there are any."""
    return tuple(dict.fromkeys((*problem.fields, *(needed_to_step(problem.model) if problem.steps[-1] else ()))))


def visit(sim: Simulation, steps: Sequence[int], dt: float) -> Iterator[int]:
    """Run a simulation, halting at each of the steps (0 is the first evaluation)."""
    sim.setup()
    done = 0
    for step in steps:
        sim.run(step - done, dt)
        done = step
        yield step


def predict(
    problem: Problem,
    evaluator: type[ArrayEvaluator] | None = None,
    stepping: type[Simulation] = Simulation,
    seed: int = 0,
) -> Prediction:
    """Return the fields at some steps with their bounds.

    Parameters
    ----------
    evaluator, stepping : class
        The stages, and the order in which a step takes them; a variant's, for a finding. By default the reference's
        own stages, compiled if the scene is large enough to be worth loading them.
    seed : int
        Of the random signs of the moved runs.
    """
    fields, steps, last = problem.fields, problem.steps, problem.steps[-1]
    stages = evaluator or own_stages(problem)
    sim = stepping(problem.model, problem.box, problem.state, wanted(problem), stages)
    values, own, sizes = [], [], Sizes()
    for step in visit(sim, steps, problem.timestep):
        values.append({field: sim.output(field).copy() for field in fields})
        errors = sim.rounded(at_cutoff(evaluator or ArrayEvaluator))
        sizes.add(errors)
        own.append({field: _output_error(errors, field, values[-1][field], step) for field in fields})
    runs = _moved_runs(problem, stages, stepping, sizes, seed) if last else []
    spreads = _spread(runs, problem, values)
    bounds = tuple({f: own[k][f] + spreads[k][f] for f in fields} for k in range(len(steps)))
    return Prediction(tuple(values), bounds)


def evaluations(problem: Problem) -> int:
    """Return how often a particle is evaluated in all runs that predict a scene."""
    runs = 1 + MOVED_RUNS * bool(problem.steps[-1])
    return len(problem.state.x_nc) * (1 + problem.steps[-1]) * runs


def own_stages(problem: Problem) -> type[Evaluator]:
    """Return the reference's own evaluator: compiled if there are more than `COMPILED_ABOVE` evaluations."""
    if evaluations(problem) <= COMPILED_ABOVE:
        return ArrayEvaluator
    from eos_ref.compiled.evaluator import CompiledEvaluator

    return CompiledEvaluator


# --- one evaluation


def _output_error(twin: Simulation, field: str, values: FloatArray, step: int) -> Any:
    if QUANTITIES[field].integrated and step > 0:
        return np.zeros(np.shape(values))  # all of it is in the spread
    return error(twin.output(field))


class Sizes(dict[str, FloatArray]):
    """Largest rounding error of every quantity, over the evaluations added."""

    def add(self, twin: Simulation) -> None:
        """Take in one evaluation."""
        quantities = twin.fields | {"pressure force": twin.pressure_force_nc, "rho": twin.state.rho_n}
        for name, quantity in quantities.items():
            if isinstance(quantity, Rounded):
                self[name] = np.maximum(self.get(name, 0.0), np.where(np.isnan(quantity.error), np.inf, quantity.error))


# --- many steps


def moved(evaluator: type[Evaluator], sizes: Sizes, random: np.random.Generator) -> type[Evaluator]:
    """Return the stages of an evaluator with every result moved by its bound, up or down at random."""

    def move(quantity: Any, name: str) -> Any:
        if quantity is None or name not in sizes:
            return quantity
        return quantity + random.choice((-1.0, 1.0), np.shape(quantity)) * sizes[name]

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
            names = ("f", "pressure force", "drho", "heatflow")
            return PairTerms(*(move(term, name) for term, name in zip(vars(terms).values(), names, strict=True)))

    return Moved


def precise_setup(problem: Problem) -> Fields:
    """Return the fields of the first evaluation in extended precision."""
    twin = Simulation(problem.model, problem.box, problem.state, wanted(problem)).precise()
    return {field: twin.output(field) for field in problem.fields}


def shaken(stepping: type[Simulation], random: np.random.Generator) -> type[Simulation]:
    """Return a stepping after each step of which the state moves by one unit of the last place."""

    def signs(like: FloatArray) -> FloatArray:
        return EPS * random.choice((-1.0, 1.0), like.shape)

    class Shaken(stepping):  # type: ignore[misc, valid-type]
        def step(self, dt: float) -> None:
            super().step(dt)
            s = self.state
            reach_c = np.maximum(np.abs(self.box.low_c), np.abs(self.box.high_c))  # a coordinate that wraps rounds so
            s.x_nc = s.x_nc + signs(s.x_nc) * reach_c
            s.v_nc = s.v_nc * (1 + signs(s.v_nc))
            s.rho_n = s.rho_n * (1 + signs(s.rho_n))
            if s.energy_n is not None:
                s.energy_n = s.energy_n * (1 + signs(s.energy_n))

    return Shaken


def _moved_runs(
    problem: Problem, evaluator: type[Evaluator], stepping: type[Simulation], sizes: Sizes, seed: int
) -> list[Simulation]:
    runs = []
    for k in range(MOVED_RUNS):
        random = np.random.default_rng((seed, k))
        steps = shaken(stepping, random)
        stages = moved(evaluator, sizes, random)
        runs.append(steps(problem.model, problem.box, problem.state, wanted(problem), stages))
    return runs


def _spread(runs: Sequence[Simulation], problem: Problem, values: Sequence[Fields]) -> list[Fields]:
    """Return the largest distance of the moved runs from the reference, per field and step; 0 at step 0."""
    largest: list[Fields] = [dict.fromkeys(problem.fields, 0.0) for _ in problem.steps]
    for run in runs:
        for at, step in enumerate(visit(run, problem.steps, problem.timestep)):
            for field in problem.fields if step else ():
                distance = np.abs(run.output(field) - values[at][field])
                distance = np.where(np.isfinite(distance), distance, np.inf)  # a run that is lost bounds nothing
                # Counts and classes change by whole numbers, and only where rounding decides: particle by particle.
                far = distance if QUANTITIES[field].discrete else distance.max(initial=0.0)
                largest[at][field] = np.maximum(largest[at][field], far)
    return largest
