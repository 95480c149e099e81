"""Rules of reconstructed walls: densities by the inverse of each law, velocities as fluid meets them, repulsion."""

from __future__ import annotations

from typing import Any

import numpy as np

from eos_ref.evaluation.evaluator import WALL_FLOOR
from eos_ref.model import interactions
from lammps_cases.scene.rules.rule import Evaluated, pair_rule, rules_of


def _met(at: Evaluated) -> Any:
    """Return the solids with fluid neighbours."""
    return at.solid_n & at.any_of_n(at.mixed_p)


def _law(*styles: str) -> Any:
    return lambda at: _met(at) & at.evaluator.of_type(law.style in styles for law in at.sim.model.eos)


def _background(at: Evaluated) -> Any:
    return _met(at) & (at.of_type("background", at.sim.model.eos) != 0)


def _accelerated(at: Evaluated) -> Any:
    """Return the pairs in which the accelerations of wall and fluid differ along the pair."""
    other_nc = np.broadcast_to(np.asarray(at.sim.other_nc), at.v_nc.shape)
    return at.mixed_p & at.differs_p(other_nc)


def _set(at: Evaluated) -> Any:
    return at.sim.set_n & _met(at) & (at.step > 0)


def _not_set(at: Evaluated) -> Any:
    return ~at.sim.set_n & _met(at) & (at.step > 0)


def _at_floor(at: Evaluated) -> Any:
    return _met(at) & (at.rho_n <= at.evaluator.rho0_n / WALL_FLOOR)


def _distances(at: Evaluated) -> tuple[Any, Any]:
    """Return the estimated distances to the interface of the solid and of the fluid of every pair, (p,)."""
    solid_p = at.solid_n[at.i]
    chi_i, chi_j = at.chi_n[at.i], at.chi_n[at.j]
    cut = at.sim.model.cut
    inside = interactions.interface_distance(np.where(solid_p, chi_i, chi_j), cut)
    return inside, interactions.interface_distance(np.where(solid_p, chi_j, chi_i), cut)


def _moving_p(at: Evaluated) -> Any:
    return at.mixed_p & at.differs_p(at.v_nc)


def _extrapolated(at: Evaluated) -> Any:
    return _moving_p(at) & (_distances(at)[0] > 0)


def _not_extrapolated(at: Evaluated) -> Any:
    return _moving_p(at) & (_distances(at)[0] < 0)


def _close(at: Evaluated) -> Any:
    return _extrapolated(at) & (_distances(at)[1] < np.sqrt(3) / 12 * at.sim.model.cut)


def _repelled(at: Evaluated) -> Any:
    chi_p = np.where(at.solid_n[at.i], at.chi_n[at.i], at.chi_n[at.j])
    near_p = at.evaluator.r < 0.5 * at.sim.model.cut
    return at.mixed_p & near_p & (chi_p > interactions.REPULSION_CHI)


_walls = rules_of("chi")
RULES = (
    _walls(
        "same-phase-fraction",
        "chi is the part of the kernel's sum that is of the own phase.",
        lambda at: at.any_of_n(at.mixed_p),
        "formula.chi-of-other",
    ),
    _walls(
        "wall-density-linear",
        "The density of a wall follows from the inverse of the linear law.",
        _law("linear"),
        "formula.inverse-of-linear",
    ),
    _walls(
        "wall-density-tait",
        "The density of a wall follows from the inverse of Tait's law.",
        _law("tait/water", "tait/general"),
        "formula.inverse-of-tait",
    ),
    _walls(
        "wall-density-gas",
        "The density of a wall follows from the inverse of the law of an ideal gas.",
        _law("ideal/gas"),
        "formula.inverse-of-gas",
    ),
    _walls(
        "wall-background",
        "The inverse law subtracts the background pressure of the wall.",
        _background,
        "formula.background-in-inverse",
    ),
    _walls(
        "wall-without-fluid",
        "A wall without fluid neighbours has its equilibrium density.",
        lambda at: at.solid_n & ~_met(at),
        "formula.wall-alone-keeps-density",
    ),
    _walls(
        "wall-floor",
        "The density of a wall is at least a tenth of that of equilibrium.",
        _at_floor,
        "formula.wall-without-floor",
    ),
    _walls(
        "wall-thin",
        "A wall below its equilibrium density is seen with that density.",
        lambda at: _met(at) & (at.rho_n < at.evaluator.rho0_n),
        "formula.wall-meets-thin",
    ),
    pair_rule(
        "walls-met-at-rho0",
        "Two reconstructed solids see each other with their equilibrium densities.",
        lambda at: at.solids_p & at.differs_p(at.rho_n),
        "formula.solids-meet-as-walls",
        needs="chi",
    ),
    pair_rule(
        "wall-acceleration",
        "The pressure at a wall takes the accelerations of fluid and wall.",
        _accelerated,
        "formula.wall-no-acceleration",
        needs="chi",
    ),
    _walls(
        "wall-force-set",
        "A wall whose force is set has the acceleration of that.",
        _set,
        "formula.wall-set-force-ignored",
    ),
    _walls(
        "wall-free",
        "A wall whose force is not set has the acceleration of its forces except pressure.",
        _not_set,
        "formula.walls-all-forces",
    ),
    pair_rule(
        "no-slip-gradient",
        "Velocity gradients take the extrapolated velocity of a wall.",
        _extrapolated,
        "formula.no-slip-not-in-gradients",
        needs="chi",
    ),
    pair_rule(
        "no-slip-force",
        "Viscous forces take the extrapolated velocity of a wall.",
        lambda at: _extrapolated(at) & ("f" in at.sim.plan),
        "formula.no-slip-not-in-forces",
        needs="chi",
    ),
    pair_rule(
        "no-slip-floor",
        "Fluid close to a wall counts as no closer than a twelfth of the cutoff times the root of 3.",
        _close,
        "formula.no-slip-floor",
        needs="chi",
    ),
    pair_rule(
        "no-slip-not",
        "A solid with more fluid than solid around it has its own velocity.",
        _not_extrapolated,
        "formula.no-slip-backwards",
        needs="chi",
    ),
    _walls(
        "moving-wall",
        "Particles see the velocity of a moving wall.",
        lambda at: _met(at) & at.v_nc.any(axis=1),
        "formula.lint-velocity-of-walls-lost",
    ),
    pair_rule(
        "repulsion",
        "Solids deep in their phase repel fluid at short distance.",
        _repelled,
        "formula.repulsion-linear-cs",
        needs="chi",
    ),
)
