"""The hand calculation of a number: what the reference summed over the pairs of one particle."""

from __future__ import annotations

import copy
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.parameters import Model, PairTerms, State
from eos_ref.numbers.columns import joined
from eos_ref.numbers.number import Array
from eos_ref.numbers.rounded import value
from lammps_cases.comparison.trajectory import Problem, visit, wanted

MOST_PAIRS = 12  # that are printed; the nearest ones


@dataclass(frozen=True)
class ParticleValues:
    """A particle as the reference has it at the step of the number.

    ``constants`` are those of its type (rhoeq, cs, and of one that carries energy kappa and cv) and its energy E.
    """

    id: int
    type: int
    solid: bool
    x: tuple[float, ...]
    v: tuple[float, ...]
    mass: float
    rho: float
    pressure: float
    constants: dict[str, float]


@dataclass(frozen=True)
class PairContribution:
    """A pair: the other particle, the distance vector to it, the kernel and its gradient.

    With what the pair adds to the particle's force (``pressure_force``: by pressure and artificial viscosity), rate of
    density and heat flow, as far as the model has them and they were asked for.
    """

    other: ParticleValues
    x: tuple[float, ...]
    r: float
    w: float
    gradient: tuple[float, ...]
    force: tuple[float, ...] = ()
    pressure_force: tuple[float, ...] = ()
    drho: float | None = None
    heat: float | None = None


@dataclass(frozen=True)
class Sum:
    """The particle of a number, its nearest pairs, and how many there are.

    ``force_with_fixes`` is the force after fixes that add to it or set it, of models that have them.
    """

    particle: ParticleValues
    pairs: tuple[PairContribution, ...]
    count: int
    force_with_fixes: tuple[float, ...] = ()


class _PairByPair(ArrayEvaluator):
    """Stages whose sums over pairs are left as their terms."""

    def total(self, term_p: Any) -> Any:
        return term_p


def added(sim: Simulation) -> PairTerms | None:
    """Return what every pair added to the particle it is listed for, (p, ...), when forces were evaluated last.

    None if they were not. At the end of a step velocities and densities are further on than they were then.
    """
    if sim.pressure_force_nc is None:
        return None
    last = sim.rounded()
    stages: Any = copy.copy(last.evaluator)
    stages.__class__ = type("PairByPair", (_PairByPair, type(stages)), {})
    terms: PairTerms = stages.pair_terms(last.pair_input(last.force_pressure())._replace(virial=False))
    return terms if sim.model.pair.rho_damp else replace(terms, drho_n=None)


def terms(problem: Problem, step: int, atom: int, most: int = MOST_PAIRS, forces: bool = False) -> Sum:
    """Return pairs of a particle after a step, nearest first; with ``forces`` what each of them adds."""
    sim = Simulation(problem.model, problem.box, problem.state, wanted(problem), ArrayEvaluator)
    for _ in visit(sim, (step,), problem.timestep, problem.stops):
        pass
    evaluator, state = sim.evaluator, sim.state
    adds = added(sim) if forces else None
    assert isinstance(evaluator, ArrayEvaluator)
    evaluator.move(state.x_nc)  # a number that needs no pairs leaves them out
    evaluator.correct(state.rho_n)
    pressure_n = _array(evaluator.pressure(state.rho_n, state.energy_n))

    def particle(n: int) -> ParticleValues:
        return ParticleValues(
            n + 1,
            int(state.type_n[n]),
            bool(state.solid_n[n]),
            tuple(map(float, state.x_nc[n])),
            tuple(map(float, state.v_nc[n])),
            float(evaluator.mass_n[n]),
            float(state.rho_n[n]),
            float(pressure_n[n]),
            _constants(problem.model, int(state.type_n[n])) | _energy(state, n),
        )

    x_pc, gradient_pc = _array(joined(evaluator.x)), _array(joined(evaluator.g))
    r_p, w_p = _array(evaluator.r), _array(evaluator.w)
    own = np.flatnonzero(evaluator.i == atom - 1)
    nearest = own[np.argsort(r_p[own], kind="stable")][:most]
    pairs = tuple(
        PairContribution(
            particle(int(evaluator.j[p])),
            tuple(map(float, x_pc[p])),
            float(r_p[p]),
            float(w_p[p]),
            tuple(map(float, gradient_pc[p])),
            *_added(adds, int(p)),
        )
        for p in nearest
    )
    acted = tuple(map(float, _array(sim.fields["f"])[atom - 1])) if adds is not None and problem.model.forces else ()
    return Sum(particle(atom - 1), pairs, len(own), acted)


def _added(adds: PairTerms | None, p: int) -> tuple[Any, ...]:
    """Return what a pair adds, as the last fields of `PairContribution`."""
    if adds is None:
        return ()
    vectors = [tuple(map(float, _array(of)[p])) for of in (adds.force_nc, adds.pressure_force_nc)]
    return *vectors, *(None if of is None else float(_array(of)[p]) for of in (adds.drho_n, adds.heat_n))


def _array(given: Array) -> FloatArray:
    return np.asarray(value(given), float)


def _constants(model: Model, of_type: int) -> dict[str, float]:
    law = model.eos.laws[of_type - 1]
    constants = {"rhoeq": law.rho0, "cs": law.cs}
    if model.thermal is not None:
        thermal = model.thermal[of_type - 1]
        constants |= {"kappa": thermal.conductivity, "cv": thermal.specific_heat}
    return constants


def _energy(state: State, n: int) -> dict[str, float]:
    return {} if state.energy_n is None else {"E": float(state.energy_n[n])}


# --- formulas


@dataclass(frozen=True)
class Line:
    """A line of the calculation: a name, its formula, the same with numbers for LAMMPS, the value."""

    name: str
    formula: str
    numbers: str
    value: float


def symbols(given: Sum) -> dict[str, float]:
    """Return what formulas may name, each with the id of its particle: m1, rho1, v1 by components, of pairs r2, W2.

    ``gx2`` and ``gy2`` are the gradient of the kernel at the pair of the particle of the number with particle 2, ``x2``
    and ``y2`` its distance vector.
    """
    numbers: dict[str, float] = {}
    for one in (given.particle, *(pair.other for pair in given.pairs)):
        values = {"m": one.mass, "rho": one.rho, "vx": one.v[0], "vy": one.v[1], **one.constants}
        numbers |= {f"{name}{one.id}": number for name, number in values.items()}
    for pair in given.pairs:
        values = {"r": pair.r, "W": pair.w, "x": pair.x[0], "y": pair.x[1]}
        values |= {"gx": pair.gradient[0], "gy": pair.gradient[1]}
        numbers |= {f"{name}{pair.other.id}": number for name, number in values.items()}
    return numbers


def calculate(formulas: Mapping[str, str], given: Sum) -> tuple[Line, ...]:
    """Evaluate formulas one after another, each of which may name those before it."""
    numbers, lines = symbols(given), dict[str, Line]()
    for name, formula in formulas.items():

        def number(word: re.Match[str]) -> str:
            if word[0] in lines:
                return f"${{{word[0]}}}"
            return repr(numbers[word[0]]) if numbers[word[0]] >= 0 else f"({numbers[word[0]]!r})"

        scope = numbers | {line.name: line.value for line in lines.values()}
        result = float(eval(formula.replace("^", "**"), {"__builtins__": {}}, scope))  # of this package's own data
        lines[name] = Line(name, formula, re.sub(r"[A-Za-z]\w*", number, formula), result)
    return tuple(lines.values())
