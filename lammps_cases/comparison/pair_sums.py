"""Per-pair contributions to the sums of one particle, with its neighbours after a step of the reference."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.state import PairTerms
from lammps_cases.comparison.problem import Problem
from lammps_cases.comparison.trajectory import halted

MOST_PAIRS = 12  # printed, the nearest ones
ARE = {"rhoeq": "rho", "cs": "cs", "kappa": "conductivity", "cv": "cv", "E": "energy"}  # quantities with units
LARGEST = 20_000  # particles of a scene whose pairs are listed with its verdict


@dataclass(frozen=True)
class ParticleValues:
    """A particle of the reference at the step of the number, in LAMMPS' units.

    ``volume`` is mass over density, in the cube of the unit of length. ``constants`` are those of its type (rhoeq, cs,
    and, if it carries energy, kappa and cv) and its energy E.
    """

    id: int
    type: int
    solid: bool
    x: tuple[float, ...]
    v: tuple[float, ...]
    mass: float
    rho: float
    volume: float
    pressure: float
    constants: dict[str, float]


@dataclass(frozen=True)
class PairContribution:
    """A pair: the other particle, the distance vector to it, the kernel and its gradient.

    Also its contributions to the particle's force (``pressure_force``: by pressure and artificial viscosity), rate of
    density and heat flow, as far as the model has them and they are wanted.
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
    """The particle of a number, its nearest pairs, and the number of all pairs.

    ``force_with_fixes`` is the force after fixes that add to it or set it, if the model has any.
    """

    particle: ParticleValues
    pairs: tuple[PairContribution, ...]
    count: int
    force_with_fixes: tuple[float, ...] = ()


class _PairByPair(ArrayEvaluator):
    """Stages whose sums over pairs are left as terms."""

    def total(self, term_p: Any) -> Any:
        return term_p


def added(last: Simulation) -> PairTerms | None:
    """Return every pair's contribution to the particle it is listed for, (p, ...), in an evaluation of plain arrays.

    None without forces. At the end of a step velocities and densities have moved on since then.
    """
    if last.pressure_force_nc is None:
        return None
    stages: Any = copy.copy(last.evaluator)
    stages.__class__ = type("PairByPair", (_PairByPair, type(stages)), {})
    terms: PairTerms = stages.pair_terms(last.pair_input(last.force_pressure())._replace(virial=False))
    unit = last.units.of
    return PairTerms(
        terms.force_nc / unit("f"),
        terms.pressure_force_nc / unit("f"),
        terms.drho_n / unit("drho") if last.model.pair.rho_damp else None,
        None if terms.heat_n is None else terms.heat_n / unit("heatflow"),
    )


def terms(problem: Problem, step: int, atom: int, most: int = MOST_PAIRS, forces: bool = False) -> Sum:
    """Return pairs of a particle after a step, nearest first; with ``forces`` also their contributions."""
    return sums(halted(problem, (step,))[step], (atom - 1,), most, forces)[0]


def sums(sim: Simulation, rows: Sequence[int], most: int = MOST_PAIRS, forces: bool = False) -> list[Sum]:
    """Return the same for some particles of a simulation that has halted."""
    state, evaluator = sim.state, _evaluator(sim)
    evaluator.move(state.x_nc)
    evaluator.correct(state.rho_n)
    pressure_n = np.asarray(evaluator.pressure(state.rho_n, state.energy_n))
    last = sim.again() if forces else None
    adds = added(last) if last else None
    met: Any = last.evaluator if last and adds else evaluator  # whose pairs are listed
    unit = sim.units.of

    @cache
    def particle(n: int) -> ParticleValues:  # most of these are neighbours of several particles
        return ParticleValues(
            n + 1,
            int(state.type_n[n]),
            bool(state.solid_n[n]),
            tuple(map(float, state.x_nc[n])),
            tuple(map(float, state.v_nc[n])),
            float(evaluator.mass_n[n]),
            float(state.rho_n[n] / unit("rho")),
            float(evaluator.mass_n[n] / state.rho_n[n]),
            float(pressure_n[n] / unit("pressure")),
            {name: number / unit(ARE[name]) for name, number in _constants(sim, n).items()},
        )

    def pair(p: int) -> PairContribution:
        x, gradient = (tuple(float(of_p[p]) for of_p in of) for of in (met.x, met.g))
        return PairContribution(
            particle(int(met.j[p])), x, float(met.r[p]), float(met.w[p]), gradient, *_added(adds, p)
        )

    def one(row: int) -> Sum:
        own = np.flatnonzero(met.i == row)
        nearest = own[np.argsort(met.r[own], kind="stable")][:most]
        acted = tuple(map(float, sim.output("f")[row])) if adds is not None and sim.model.forces else ()
        return Sum(particle(row), tuple(pair(int(p)) for p in nearest), len(own), acted)

    return [one(row) for row in rows]


def added_up(pairs: Sequence[PairContribution]) -> dict[str, Any]:
    """Return the sums of contributions over pairs."""
    sums: dict[str, Any] = {}
    for name in ("force", "pressure_force"):
        vectors = [getattr(pair, name) for pair in pairs if getattr(pair, name)]
        if vectors:
            sums[name] = [sum(column) for column in zip(*vectors, strict=True)]
    for name in ("drho", "heat"):
        values = [getattr(pair, name) for pair in pairs if getattr(pair, name) is not None]
        if values:
            sums[name] = sum(values)
    return sums


def columns(looks: Sequence[tuple[int, Sum]]) -> dict[str, npt.NDArray[Any]]:
    """Return particles, each at a step, as arrays: one row per particle, or one per pair, particle by particle.

    ``pair``, ``sum``: vectors over the columns in ``names``, such as ``force x``.
    """
    pairs = [pair for _, each in looks for pair in each.pairs]
    names = _names(pairs)
    added = [added_up(each.pairs) for _, each in looks]
    return {
        "step": np.array([step for step, _ in looks], int),
        "row": np.array([each.particle.id - 1 for _, each in looks], int),
        "count": np.array([each.count for _, each in looks], int),
        "other": np.array([pair.other.id - 1 for pair in pairs], int),
        "r": np.array([pair.r for pair in pairs], float),
        "names": np.array(list(names), str),
        "pair": np.array([[_part(vars(pair), *at) for at in names.values()] for pair in pairs], float),
        "sum": np.array([[_part(each, *at) for at in names.values()] for each in added], float),
    }


def _names(pairs: Sequence[PairContribution]) -> dict[str, tuple[str, int | None]]:
    """Return the names of contributions, component by component, with their places in `PairContribution`."""
    if not pairs:
        return {}
    names: dict[str, tuple[str, int | None]] = {}
    for name in ("force", "pressure_force"):
        names |= {f"{name} {axis}": (name, k) for k, axis in enumerate("xyz"[: len(getattr(pairs[0], name))])}
    return names | {name: (name, None) for name in ("drho", "heat") if getattr(pairs[0], name) is not None}


def _part(of: Mapping[str, Any], name: str, axis: int | None) -> float:
    if name not in of:
        return 0.0  # a particle without neighbours
    return float(of[name] if axis is None else of[name][axis])


def _evaluator(sim: Simulation) -> ArrayEvaluator:
    """Return an evaluator set to the state of a simulation."""
    state = sim.state
    evaluator = ArrayEvaluator(sim.model, sim.box, state.type_n, state.solid_n)
    if state.mass_n is not None:
        evaluator.weigh(state.mass_n)
    return evaluator


def _added(adds: PairTerms | None, p: int) -> tuple[Any, ...]:
    """Return the contributions of a pair, as the last fields of `PairContribution`."""
    if adds is None:
        return ()
    vectors = [tuple(map(float, of[p])) for of in (adds.force_nc, adds.pressure_force_nc)]
    return *vectors, *(None if of is None else float(of[p]) for of in (adds.drho_n, adds.heat_n))


def _constants(sim: Simulation, n: int) -> dict[str, float]:
    """Return the constants of a particle's type, and its energy, in consistent units."""
    model, state, of_type = sim.model, sim.state, int(sim.state.type_n[n]) - 1
    law = model.eos.laws[of_type]
    constants = {"rhoeq": law.rho0, "cs": law.cs}
    if model.thermal is not None:
        thermal = model.thermal[of_type]
        constants |= {"kappa": thermal.conductivity, "cv": thermal.specific_heat}
    return constants if state.energy_n is None else constants | {"E": float(state.energy_n[n])}
