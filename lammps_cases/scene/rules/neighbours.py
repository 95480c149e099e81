"""Rules of neighbours, kernels, densities and gradients: sums over pairs before any force."""

from __future__ import annotations

from typing import Any

import numpy as np

from eos_ref.numbers.columns import joined
from eos_ref.numbers.matrices import cholesky
from lammps_cases.scene.rules.rule import Evaluated, Rule, pair_rule


def _across(at: Evaluated) -> Any:
    """Return the pairs with an image on the other side of a periodic boundary."""
    x_nc = at.sim.evaluated.x_nc
    apart_pc = x_nc[at.i] - x_nc[at.j]
    return (np.abs(apart_pc - joined(at.evaluator.x)) > 0.5 * min(at.sim.box.edge_c)).any(axis=1)


def _displaced(at: Evaluated) -> Any:
    """Return the pairs whose image is across an edge that leans."""
    box, x_nc = at.sim.box, at.sim.evaluated.x_nc
    image_pc = box.periods(x_nc[at.i] - x_nc[at.j] - joined(at.evaluator.x))
    return (box.shift(image_pc) != image_pc * box.edge_c).any(axis=1)


def _several_images(at: Evaluated) -> Any:
    """Return the pairs of two particles that meet in several images."""
    both = at.i * at.evaluator.n + at.j
    _, inverse, times = np.unique(both, return_inverse=True, return_counts=True)
    return times[inverse] > 1


def _kernel(name: str) -> Any:
    return lambda at: (at.evaluator.coordination_n > 0) & (at.sim.model.fix.kernel == name)


def _corrected(order: int) -> Any:
    return lambda at: at.evaluator.corrected_n & (at.sim.model.order == order)


def _too_few(at: Evaluated) -> Any:
    few_n = at.evaluator.coordination_n < at.sim.model.fix.zmin
    return few_n & (at.evaluator.coordination_n > 0) & at.sim.model.corrects_gradients


def _without_factor(at: Evaluated) -> Any:
    """Return the particles with enough neighbours whose moment matrix has no Cholesky factor."""
    if not at.sim.model.corrects_gradients:
        return np.zeros(at.evaluator.n, bool)
    definite_n = cholesky(at.evaluator.moments(at.rho_n)[1])[1]
    enough_n = at.evaluator.coordination_n >= max(at.sim.model.fix.zmin, 1)
    return ~definite_n & enough_n


def _summed(at: Evaluated) -> Any:
    return (at.evaluator.coordination_n > 0) & at.sim.model.fix.rho_sum


def _evolves(at: Evaluated) -> Any:
    return at.fluid_n & (at.step > 0) & (not at.sim.model.fix.rho_sum)


def _solids_keep(at: Evaluated) -> Any:
    return at.solid_n & (at.step > 0) & (not at.sim.model.fix.rho_sum) & (not at.evaluator.walls)


def _moving_apart(at: Evaluated) -> Any:
    return at.differs_p(at.v_nc)


RULES = (
    Rule(
        "own-masses",
        "A particle has its own mass, different from that of its type.",
        lambda at: at.evaluator.mass_n != at.evaluator.of_type(at.sim.model.mass),
        faults=("formula.masses-of-types",),
    ),
    Rule(
        "volumes",
        "The volume of a particle, mass over density, is not 1.",
        lambda at: at.evaluator.mass_n != at.rho_n,
        needs=("pairs",),
        faults=("formula.lint-masses-ignored",),
    ),
    pair_rule(
        "images",
        "Particles have neighbours across periodic boundaries.",
        _across,
        "formula.pairs-no-images",
        needs="kernel",
    ),
    pair_rule(
        "images-displaced",
        "Periodic images across a face of a tilted box are displaced along it.",
        _displaced,
        "formula.pairs-upright-images",
        needs="kernel",
    ),
    pair_rule(
        "own-images",
        "A particle has its own periodic images as neighbours.",
        lambda at: at.i == at.j,
        "formula.pairs-own-images",
        needs="kernel",
    ),
    pair_rule(
        "several-images",
        "A particle has several periodic images of another as neighbours.",
        _several_images,
        "formula.pairs-first-image",
        needs="kernel",
    ),
    Rule(
        "kernel-quintic",
        "Gradients are those of the quintic spline.",
        _kernel("quintic"),
        needs=("kernel",),
        faults=("formula.slope-without-five",),
    ),
    Rule(
        "kernel-rk0",
        "RK0 keeps the gradients of the spline.",
        _kernel("RK0"),
        needs=("kernel",),
        faults=("formula.rk0-corrected",),
    ),
    Rule(
        "kernel-rk1",
        "Gradients are corrected to first order.",
        _corrected(1),
        needs=("correction",),
        faults=("formula.moments-without-volume",),
    ),
    Rule(
        "kernel-rk2",
        "Gradients are corrected to second order.",
        _corrected(2),
        needs=("correction",),
        faults=("formula.basis-without-half",),
    ),
    Rule(
        "forces-corrected",
        "Pair forces take corrected gradients.",
        lambda at: at.evaluator.corrected_n,
        needs=("correction", "f"),
        faults=("formula.forces-plain",),
    ),
    Rule(
        "zmin",
        "A particle with fewer than zmin neighbours keeps the spline.",
        _too_few,
        needs=("correction",),
        faults=("formula.zmin-ignored",),
    ),
    Rule(
        "matrix-without-factor",
        "A particle whose moment matrix has no Cholesky factor keeps the spline.",
        _without_factor,
        needs=("correction",),
        faults=("formula.matrix-taken",),
    ),
    Rule(
        "density-summed",
        "The density is a sum over neighbours and the particle itself.",
        _summed,
        needs=("kernel", "rho"),
        faults=("formula.sum-without-self",),
    ),
    Rule(
        "density-summed-masses",
        "Neighbours of other masses enter the density sum with their own.",
        lambda at: _summed(at) & at.any_of_n(at.differs_p(at.evaluator.mass_n)),
        needs=("kernel", "rho"),
        faults=("formula.sum-own-mass",),
    ),
    Rule(
        "density-evolved",
        "The density follows the continuity equation.",
        _evolves,
        needs=("grad/v",),
        faults=("formula.density-without-rho",),
    ),
    Rule(
        "density-of-solids",
        "The density of solids does not change.",
        _solids_keep,
        needs=("grad/v",),
        faults=("formula.density-of-solids",),
    ),
    pair_rule(
        "gradient-of-velocity",
        "Velocity gradients are sums of differences of velocity.",
        _moving_apart,
        "formula.gradient-sign",
        needs="grad/v",
    ),
)
