"""Rules of edges: thresholds met exactly, values that types share, time steps that change, rates of 0."""

from __future__ import annotations

from typing import Any

import numpy as np

from eos_ref.model import per_atom
from eos_ref.numbers.columns import matrix
from lammps_cases.scene.rules.rule import Evaluated, Rule, pair_rule, rules_of
from lammps_cases.scene.rules.surfaces import SURFACE, class_n


def _later(at: Evaluated) -> Any:
    """Return all particles after a step of another length, none before."""
    return np.full(at.evaluator.n, at.step_changed)


def _at_limit(at: Evaluated) -> Any:
    setting = at.sim.model.fix.surface_detection
    assert setting is not None
    return at.fluid_n & (at.evaluator.coordination_n == setting.limit) & (setting.style == "coordination")


def _at_splash(style: str) -> Any:
    def particles(at: Evaluated) -> Any:
        setting = at.sim.model.fix.surface_detection
        assert setting is not None
        met_n = at.evaluator.coordination_n == setting.splash
        return met_n & (class_n(at) == SURFACE) & (setting.style == style)

    return particles


def _at_zmin(at: Evaluated) -> Any:
    return at.evaluator.corrected_n & (at.evaluator.coordination_n == at.sim.model.fix.zmin)


def _freezes_now(at: Evaluated) -> Any:
    assert at.sim.model.thermal is not None
    freezing_n = at.evaluator.of_type(np.nan if p.T_freeze is None else p.T_freeze for p in at.sim.model.thermal)
    return (at.sim.fields["temperature"] == freezing_n) & (at.step > 0)


def _at_rest(at: Evaluated) -> Any:
    power_n = at.evaluator.of_type(law.style == "power" for law in at.sim.model.viscosity)
    if not power_n.any():
        return power_n
    return power_n & (per_atom.strain_rate(matrix(at.sim.gradient.v_ncc)) == 0)


def _as_type_before(at: Evaluated) -> Any:
    """Return the particles that have the viscosity of the type before theirs, and not the other constants."""
    model, types = at.sim.model, range(1, len(at.sim.model.viscosity))
    others = list(zip(model.mass_t, model.eos, strict=True))
    return at.evaluator.of_type(
        [False, *(model.viscosity[t] == model.viscosity[t - 1] and others[t] != others[t - 1] for t in types)]
    )


def _types_of_one_density(at: Evaluated) -> Any:
    scaled = at.sim.model.fix.shift is not None and at.sim.model.fix.shift.scale_cross_type is not None
    return at.other_type_p & ~at.differs_p(at.evaluator.rho0_n) & scaled


_surface, _temperature = rules_of("surface"), rules_of("temperature")
RULES = (
    Rule(
        "zmin-met",
        "A particle with exactly zmin neighbours has corrected gradients.",
        _at_zmin,
        needs=("correction",),
        faults=("formula.zmin-more",),
    ),
    _surface(
        "limit-met",
        "Fluid with exactly as many neighbours as limit of coordination says is bulk.",
        _at_limit,
        "formula.surface-at-limit",
    ),
    _surface(
        "splash-met-by-coordination",
        "Fluid at the surface with exactly limit/splash neighbours is no splash, by coordination.",
        _at_splash("coordination"),
        "formula.splash-at-limit",
    ),
    _surface(
        "splash-met-by-divergence",
        "Fluid at the surface with exactly limit/splash neighbours is no splash, by divergence.",
        _at_splash("divergence"),
        "formula.splash-at-limit",
    ),
    _temperature(
        "fluid-at-freezing",
        "Fluid at its freezing temperature stays fluid.",
        lambda at: _freezes_now(at) & at.fluid_n & ~at.start.solid_n,
        "formula.phase-frozen-at-freezing",
    ),
    _temperature(
        "solid-at-freezing",
        "A solid at its freezing temperature stays solid.",
        lambda at: _freezes_now(at) & at.solid_n & at.start.solid_n,
        "formula.phase-molten-at-freezing",
    ),
    Rule(
        "strain-rate-zero",
        "At rest, the viscosity of the style power is eta.",
        _at_rest,
        needs=("viscosity",),
        faults=("formula.power-no-plateau",),
    ),
    Rule(
        "values-shared",
        "A type has the viscosity of the type before it, and other constants of its own.",
        _as_type_before,
        needs=("viscosity",),
        faults=("formula.range-first-type",),
    ),
    pair_rule(
        "types-of-one-density",
        "scale/cross/type tells types apart that have one equilibrium density.",
        _types_of_one_density,
        "formula.cross-type-by-density",
        needs="shift/v",
    ),
    Rule(
        "density-summed-self-mass",
        "With self/mass neighbours of other masses enter the density sum with that of the particle.",
        lambda at: at.any_of_n(at.differs_p(at.evaluator.mass_n)) & at.sim.model.fix.self_mass,
        needs=("kernel", "rho"),
        faults=("formula.self-mass-ignored",),
    ),
    *(
        Rule(
            f"step-changed-{what}", f"A time step that changes holds for {whose}.", _later, "particle", needs, (fault,)
        )
        for what, whose, needs, fault in (
            ("velocity", "velocities", ("f",), "formula.kick-of-first-step"),
            ("position", "positions", ("f",), "formula.drift-of-first-step"),
            ("density", "densities", ("drho",), "formula.density-of-first-step"),
            ("energy", "energies", ("heatflow",), "formula.heat-of-first-step"),
            ("shift", "shifts", ("shift/v",), "formula.shift-of-first-step"),
        )
    ),
)
