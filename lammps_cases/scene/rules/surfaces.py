"""Rules of surface detection and of shifting: classes of particles, normals, and what becomes of the shift there."""

from __future__ import annotations

from typing import Any

import numpy as np

from eos_ref.numbers.columns import axes, dot
from lammps_cases.scene.rules.rule import Evaluated, Rule, rules_of

BULK, SURFACE, SPLASH = 0, 1, 2


def class_n(at: Evaluated) -> Any:
    """Return the surface classes, (n,); all bulk without surface detection."""
    classes_n = at.sim.surface.class_n
    return np.zeros(at.evaluator.n) if classes_n is None else classes_n


def _of(which: int, style: str) -> Any:
    def particles(at: Evaluated) -> Any:
        setting = at.sim.model.fix.surface_detection
        assert setting is not None
        return (class_n(at) == which) & (setting.style == style)

    return particles


def _near_surface(at: Evaluated) -> Any:
    """Return fluid in the bulk with neighbours at the surface."""
    return at.fluid_n & (class_n(at) == BULK) & (at.sim.surface.r_n < at.sim.model.cut)


def _solid_candidates(at: Evaluated) -> Any:
    setting = at.sim.model.fix.surface_detection
    assert setting is not None
    by_count = setting.style == "coordination"
    return at.solid_n & ((at.evaluator.coordination_n if by_count else at.sim.surface.divr_n) < setting.limit)


def _raw_nc(at: Evaluated) -> Any:
    """Return the shifting velocities before what surfaces take away, (n, d)."""
    return at.evaluator.shift(at.v_nc, at.rho_n)


def _outward_n(at: Evaluated) -> Any:
    """Return the component of the shift along the normal of particles at the surface, (n,); 0 elsewhere."""
    if at.sim.surface.normal_nc is None:
        return np.zeros(at.evaluator.n)
    along_n: Any = dot(axes(at.sim.surface.normal_nc), axes(_raw_nc(at)))
    return np.where(class_n(at) == SURFACE, along_n, 0.0)


def _excluded(at: Evaluated) -> Any:
    return at.fluid_n & ~at.evaluator.of_type(at.sim.model.shifted_t) & at.v_nc.any(axis=1)


def _moves(at: Evaluated) -> Any:
    return at.sim.fields["shift/v"].any(axis=1)


def _cross_type(at: Evaluated, which: str) -> Any:
    setting = at.sim.model.fix.shift
    if setting is None or not setting.scale_cross_type:
        return np.zeros(at.evaluator.n, bool)
    keep, cmin, wmin = setting.scale_cross_type
    _, color_n, same_n = at.evaluator.color_sums(at.evaluator.volume_of_wall(at.rho_n))
    moves_n = at.fluid_n & at.v_nc.any(axis=1) & at.evaluator.of_type(at.sim.model.shifted_t)
    of = {
        "unsupported": same_n < wmin,
        "scaled": (same_n >= wmin) & (color_n >= cmin) & (keep != 1),
        "far": (same_n >= wmin) & (color_n < cmin) & (color_n > 0) & (keep != 1),
    }
    return moves_n & of[which]


_surface, _shift = rules_of("surface"), rules_of("shift/v")
RULES = (
    _surface(
        "surface-by-coordination",
        "Fluid with few neighbours is at the surface.",
        _of(SURFACE, "coordination"),
        "formula.surface-never",
    ),
    _surface(
        "surface-by-divergence",
        "Fluid with a small divergence of positions is at the surface.",
        _of(SURFACE, "divergence"),
        "formula.surface-never",
    ),
    _surface(
        "splash-by-coordination",
        "Fluid at the surface with very few neighbours is splash, by coordination.",
        _of(SPLASH, "coordination"),
        "formula.splash-never",
    ),
    _surface(
        "splash-by-divergence",
        "Fluid at the surface with very few neighbours is splash, by divergence.",
        _of(SPLASH, "divergence"),
        "formula.splash-never",
    ),
    _surface(
        "surface-bulk",
        "Fluid that is not at the surface is bulk.",
        lambda at: at.fluid_n & (class_n(at) == BULK),
        "formula.surface-everywhere",
    ),
    _surface(
        "surface-normal",
        "Particles at the surface have normals, against the gradient of the color function.",
        lambda at: (class_n(at) == SURFACE) & at.sim.surface.normal_nc.any(axis=1),
        "formula.normal-inward",
    ),
    _surface(
        "surface-distance",
        "Bulk near the surface stores its distance to the nearest surface particle.",
        _near_surface,
        "formula.surface-distance-never",
    ),
    _surface(
        "layer",
        "Bulk beside a surface particle is a layer in the status.",
        lambda at: _near_surface(at) & ("status" in at.compared),
        "formula.status-without-layer",
    ),
    _surface(
        "surface-not-solid",
        "A solid with few neighbours is not at the surface.",
        _solid_candidates,
        "formula.surface-solids",
    ),
    Rule(
        "divergence-of-positions",
        "The divergence of positions is a sum over neighbours.",
        lambda at: at.evaluator.coordination_n > 0,
        needs=("surface",),
        faults=("formula.divr-sign",),
    ),
    Rule(
        "pairs-bulk-surface",
        "A particle in the bulk has a neighbour at the surface; this does not affect the forces.",
        lambda at: _pair_p(at, BULK, SURFACE),
        "pair",
        ("surface", "f"),
    ),
    Rule(
        "pairs-both-surface",
        "Two particles at the surface are neighbours; this does not affect the forces.",
        lambda at: _pair_p(at, SURFACE, SURFACE),
        "pair",
        ("surface", "f"),
    ),
    Rule(
        "pairs-splash",
        "A splash has other fluid as a neighbour; this does not affect the forces.",
        lambda at: _pair_p(at, SPLASH, SURFACE) | _pair_p(at, SPLASH, BULK),
        "pair",
        ("surface", "f"),
    ),
    _shift(
        "shift",
        "Fluid in the bulk is shifted towards where particles are sparse.",
        lambda at: _moves(at) & (class_n(at) == BULK),
        "formula.shift-sign",
    ),
    _shift(
        "shift-outward",
        "Particles at the surface lose the outward part of their shift.",
        lambda at: _outward_n(at) > 0,
        "formula.shift-outward",
    ),
    _shift(
        "shift-inward",
        "Particles at the surface keep a shift inward.",
        lambda at: _outward_n(at) < 0,
        "formula.shift-never-at-surface",
    ),
    _shift(
        "shift-splash",
        "Splashes are not shifted.",
        lambda at: (class_n(at) == SPLASH) & _raw_nc(at).any(axis=1),
        "formula.shift-splash",
    ),
    _shift(
        "shift-excluded",
        "Types of exclude/type are not shifted.",
        _excluded,
        "formula.shift-of-excluded",
    ),
    _shift(
        "shift-not-solid",
        "Solids that move are not shifted.",
        lambda at: at.solid_n & at.v_nc.any(axis=1),
        "formula.shift-of-solids",
    ),
    _shift(
        "shift-cross-type",
        "scale/cross/type scales the shift along the normal between types.",
        lambda at: _cross_type(at, "scaled"),
        "formula.cross-type-along",
    ),
    _shift(
        "shift-cross-type-far",
        "scale/cross/type leaves the shift alone where the color function is below cmin.",
        lambda at: _cross_type(at, "far"),
        "formula.cross-type-everywhere",
    ),
    _shift(
        "shift-cross-type-unsupported",
        "scale/cross/type turns the shift off where support by the own type is below wmin.",
        lambda at: _cross_type(at, "unsupported"),
        "formula.cross-type-unsupported-shift",
    ),
    _shift(
        "shift-carries-position",
        "The shift moves particles.",
        lambda at: _moves(at) & (at.step > 0),
        "formula.shift-not-moved",
    ),
    _shift(
        "shift-carries-velocity",
        "The shift carries velocities along.",
        lambda at: _moves(at) & (at.step > 0),
        "formula.shift-not-carried",
    ),
    _shift(
        "shift-carries-density",
        "The shift carries densities along, where they are not summed.",
        lambda at: _moves(at) & (at.step > 0) & (not at.sim.model.fix.rho_sum),
        "formula.shift-density-not-carried",
    ),
    _shift(
        "shift-carries-energy",
        "The shift carries energies along.",
        lambda at: _moves(at) & (at.step > 0) & at.sim.model.fix.thermal,
        "formula.shift-energy-not-carried",
    ),
)


def _pair_p(at: Evaluated, one: int, other: int) -> Any:
    """Return the pairs of fluid particles of two classes, (p,)."""
    class_i, class_j = class_n(at)[at.i], class_n(at)[at.j]
    either = ((class_i == one) & (class_j == other)) | ((class_i == other) & (class_j == one))
    return at.fluids_p & either
