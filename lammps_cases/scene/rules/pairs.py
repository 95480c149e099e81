"""Rules of pair_style rheo and of viscosities: classes of pairs, by phase, type and motion."""

from __future__ import annotations

from typing import Any

import numpy as np

from eos_ref.model import per_atom
from eos_ref.numbers.columns import axes, dot, matrix
from lammps_cases.scene.rules.rule import Evaluated, Rule, pair_rule

LINT_MEAN = "formula.lint-arithmetic-for-harmonic-mean-or-the-reverse"


def _artificial(at: Evaluated) -> Any:
    """Return the pairs in which artificial viscosity may act: its coefficient is not 0."""
    return np.full(len(at.i), bool(at.sim.model.pair.artificial_viscosity))


def _seen_p(at: Evaluated) -> Any:
    """Return the pairs between which the model has artificial viscosity: not of two solids, nor at rebuilt walls."""
    return _artificial(at) & ~at.solids_p & ~(at.mixed_p & at.evaluator.walls)


def _approach_p(at: Evaluated) -> Any:
    """Return the rates at which pairs part, r times, beside what their gradients account for, (p,)."""
    assert at.sim.gradient.v_ncc is not None
    i, j, x = at.i, at.j, at.evaluator.x
    u = [v_n[i] - v_n[j] for v_n in axes(at.v_nc)]
    G = [[0.5 * (c_n[i] + c_n[j]) for c_n in row] for row in matrix(at.sim.gradient.v_ncc)]
    return dot([u_a - dot(G_a, x) for u_a, G_a in zip(u, G, strict=True)], x)


def _approaching(at: Evaluated) -> Any:
    mask_p = _seen_p(at)
    return mask_p & (_approach_p(at) < 0) if mask_p.any() else mask_p


def _separating(at: Evaluated) -> Any:
    mask_p = _seen_p(at)
    return mask_p & (_approach_p(at) > 0) if mask_p.any() else mask_p


def _gas_sound(at: Evaluated) -> Any:
    gas_n = at.evaluator.of_type(law.needs_energy for law in at.sim.model.eos)
    return _seen_p(at) & gas_n[at.i] & gas_n[at.j]


def _damped(at: Evaluated, corrected: bool) -> Any:
    on = bool(at.sim.model.pair.rho_damp) and at.sim.model.corrects_gradients == corrected
    return at.fluids_p & on & at.differs_p(at.rho_n)


def _damped_types(at: Evaluated) -> Any:
    return _damped(at, corrected=False) & at.differs_p(at.evaluator.rho0_n)


def _damped_not(at: Evaluated) -> Any:
    return at.mixed_p & bool(at.sim.model.pair.rho_damp)


def _viscous(at: Evaluated) -> Any:
    eta_n = at.sim.fields["viscosity"]
    return ~at.solids_p & at.differs_p(at.v_nc) & (eta_n[at.i] + eta_n[at.j] > 0)


def _means(at: Evaluated, harmonic: bool) -> Any:
    differs_p = at.differs_p(at.sim.fields["viscosity"])
    return _viscous(at) & differs_p & (at.sim.model.pair.harmonic_means == harmonic)


def _power(at: Evaluated) -> Any:
    return at.evaluator.of_type(law.style == "power" for law in at.sim.model.viscosity)


def _fast(at: Evaluated) -> Any:
    rate_n = per_atom.strain_rate(matrix(at.sim.gradient.v_ncc))
    return rate_n > at.of_type("gd0", at.sim.model.viscosity)


def _exponent(at: Evaluated) -> Any:
    return at.of_type("n", at.sim.model.viscosity)


def _viscosity(name: str, sentence: str, which: Any, *faults: str) -> Rule:
    def of_power(at: Evaluated) -> Any:
        power_n = _power(at)
        return power_n & which(at) if power_n.any() else power_n

    return Rule(name, sentence, of_power, needs=("viscosity",), faults=faults)


RULES = (
    pair_rule(
        "force-same-fluid",
        "Fluid particles of one type push each other.",
        lambda at: at.fluids_p & ~at.other_type_p,
        "formula.force-same-fluid",
    ),
    pair_rule(
        "force-other-fluid",
        "Fluid particles of two types push each other.",
        lambda at: at.fluids_p & at.other_type_p,
        "formula.force-other-fluid",
    ),
    pair_rule(
        "force-stored-wall",
        "Fluid and solid, taken as it is, push each other.",
        lambda at: at.mixed_p & (not at.evaluator.walls),
        "formula.force-at-walls",
    ),
    pair_rule(
        "force-rebuilt-wall",
        "Fluid and reconstructed solid push each other.",
        lambda at: at.mixed_p & at.evaluator.walls,
        "formula.force-at-walls",
    ),
    pair_rule(
        "no-force-in-solids",
        "Two solid particles exert no force on each other.",
        lambda at: at.solids_p,
        "formula.solids-push",
    ),
    pair_rule(
        "viscosity",
        "Particles in relative motion exert viscous forces.",
        _viscous,
        "formula.viscous-sign",
    ),
    pair_rule(
        "viscosity-arithmetic",
        "Different viscosities are averaged arithmetically.",
        lambda at: _means(at, harmonic=False),
        LINT_MEAN,
    ),
    pair_rule(
        "viscosity-harmonic",
        "With harmonic/means different viscosities are averaged harmonically.",
        lambda at: _means(at, harmonic=True),
        LINT_MEAN,
    ),
    _viscosity(
        "power-law-plateau",
        "Below gd0 the viscosity of the style power is eta.",
        lambda at: ~_fast(at),
        "formula.power-no-plateau",
    ),
    _viscosity(
        "power-law",
        "Above gd0 the viscosity of the style power follows the strain rate.",
        _fast,
        "formula.power-without-yield",
    ),
    _viscosity(
        "shear-thinning",
        "The exponent n of the style power is below 1.",
        lambda at: _fast(at) & (_exponent(at) < 1),
        "formula.power-exponent",
    ),
    _viscosity(
        "shear-thickening",
        "The exponent n of the style power is above 1.",
        lambda at: _fast(at) & (_exponent(at) > 1),
        "formula.power-exponent",
    ),
    pair_rule(
        "artificial-viscosity",
        "Particles that approach each other have artificial viscosity.",
        _approaching,
        "formula.artificial-without-two",
    ),
    pair_rule(
        "artificial-viscosity-not",
        "Particles that move apart have no artificial viscosity.",
        _separating,
        "formula.artificial-parting",
    ),
    pair_rule(
        "artificial-viscosity-gradients",
        "Artificial viscosity leaves out what the velocity gradients account for.",
        _approaching,
        "formula.artificial-no-gradients",
    ),
    pair_rule(
        "artificial-viscosity-sound",
        "Artificial viscosity takes the mean of two speeds of sound.",
        lambda at: _approaching(at) & at.differs_p(at.evaluator.cs_n),
        "formula.artificial-own-cs",
    ),
    pair_rule(
        "artificial-viscosity-gas",
        "Artificial viscosity of a gas takes the speed of sound of its energy.",
        _gas_sound,
        "formula.gas-sound-of-fix",
    ),
    pair_rule(
        "artificial-viscosity-stored-wall",
        "Artificial viscosity acts between fluid and solid without reconstruction.",
        lambda at: _approaching(at) & at.mixed_p,
        "formula.artificial-never-at-walls",
    ),
    pair_rule(
        "artificial-viscosity-rebuilt-wall",
        "Artificial viscosity does not act between fluid and reconstructed solid.",
        lambda at: _artificial(at) & at.mixed_p & at.evaluator.walls,
        "formula.artificial-walls",
    ),
    pair_rule(
        "density-diffusion",
        "rho/damp smooths densities between fluid particles.",
        lambda at: _damped(at, corrected=at.sim.model.corrects_gradients),
        "formula.damp-without-two",
        needs="drho",
    ),
    pair_rule(
        "density-diffusion-types",
        "rho/damp takes densities less those of equilibrium, which differ between types.",
        _damped_types,
        "formula.damp-of-rho",
        needs="drho",
    ),
    pair_rule(
        "density-diffusion-corrected",
        "rho/damp with RK1 and RK2 leaves out what the density gradients account for.",
        lambda at: _damped(at, corrected=True),
        "formula.damp-without-slope",
        needs="drho",
    ),
    pair_rule(
        "density-diffusion-not",
        "rho/damp does not act between fluid and solid.",
        _damped_not,
        "formula.damp-of-solids",
        needs="drho",
    ),
)
