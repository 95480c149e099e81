"""The hand calculation of a number: what the reference summed over the pairs of one particle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from eos_ref.numbers.columns import joined
from eos_ref.numbers.number import Array
from eos_ref.numbers.rounded import value
from lammps_cases.comparison.trajectory import Problem, visit, wanted

MOST_PAIRS = 12  # that are printed; the nearest ones


@dataclass(frozen=True)
class Particle:
    """A particle as the reference has it at the step of the number."""

    id: int
    type: int
    solid: bool
    x: tuple[float, ...]
    v: tuple[float, ...]
    mass: float
    rho: float
    pressure: float


@dataclass(frozen=True)
class Pair:
    """A pair: the other particle, the distance vector to it, the kernel and its gradient."""

    other: Particle
    x: tuple[float, ...]
    r: float
    w: float
    gradient: tuple[float, ...]


@dataclass(frozen=True)
class Sum:
    """The particle of a number, its nearest pairs, and how many there are."""

    particle: Particle
    pairs: tuple[Pair, ...]
    count: int


def terms(problem: Problem, step: int, atom: int) -> Sum:
    """Return the pairs of a particle after a step, nearest first."""
    sim = Simulation(problem.model, problem.box, problem.state, wanted(problem), ArrayEvaluator)
    for _ in visit(sim, (step,), problem.timestep):
        pass
    evaluator, state = sim.evaluator, sim.state
    assert isinstance(evaluator, ArrayEvaluator)
    evaluator.move(state.x_nc)  # a number that needs no pairs leaves them out
    evaluator.correct(state.rho_n)
    pressure_n = _array(evaluator.pressure(state.rho_n, state.energy_n))

    def particle(n: int) -> Particle:
        return Particle(
            n + 1,
            int(state.type_n[n]),
            bool(state.solid_n[n]),
            tuple(map(float, state.x_nc[n])),
            tuple(map(float, state.v_nc[n])),
            float(evaluator.mass_n[n]),
            float(state.rho_n[n]),
            float(pressure_n[n]),
        )

    x_pc, gradient_pc = _array(joined(evaluator.x)), _array(joined(evaluator.g))
    r_p, w_p = _array(evaluator.r), _array(evaluator.w)
    own = np.flatnonzero(evaluator.i == atom - 1)
    nearest = own[np.argsort(r_p[own], kind="stable")][:MOST_PAIRS]
    pairs = tuple(
        Pair(
            particle(int(evaluator.j[p])),
            tuple(map(float, x_pc[p])),
            float(r_p[p]),
            float(w_p[p]),
            tuple(map(float, gradient_pc[p])),
        )
        for p in nearest
    )
    return Sum(particle(atom - 1), pairs, len(own))


def _array(given: Array) -> FloatArray:
    return np.asarray(value(given), float)
