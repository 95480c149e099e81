"""Compiled pair terms of two particles by themselves, against the formulas evaluated by hand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from eos_ref.compiled import forces
from eos_ref.compiled.loops import Pairs

pytestmark = pytest.mark.slow

X_C, SLOPE = (0.375, -0.5), -0.75  # displacement x_i - x_j, and W'/r
LIKE = (0.0, 0.0)
U = 2.0**-53  # unit roundoff
ROUNDINGS = 16  # of a product of numbers given exactly: at most 8 operations on either side, each within U


def assert_products(actual: Any, expected: Any) -> None:
    """Check products of a few factors, which two orders of multiplication round by U each."""
    assert (np.abs(actual - np.asarray(expected)) <= ROUNDINGS * U * np.abs(expected)).all()


def two(terms: forces.Terms, *virials: np.ndarray, **fields: object) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return force (pressure, then the rest), density diffusion and heat flow of both particles."""
    pairs = Pairs(
        np.array([0, 1, 1], np.uint64),
        np.array([1], np.uint32),
        np.array([X_C]),
        np.array([0.5]),
        np.array([SLOPE]),
        None,
        None,
    )
    plain = dict.fromkeys(forces.Fields._fields) | {
        "volume_n": np.array([0.5, 0.75]),
        "v_nc": np.array([[1.0, 0.5], [-0.25, 0.25]]),
        "rho_n": np.array([1.25, 1.5]),
        "rho0_n": np.array([1.0, 1.125]),
        "pressure_n": np.array([2.0, 3.0]),
        "viscosity_n": np.array([0.25, 0.75]),
        "sound_n": np.array([10.0, 12.0]),
    }
    force_nf, drho_n, heat_n = np.zeros((2, 4)), np.zeros(2), np.zeros(2)
    given = forces.Fields(**(plain | fields))
    forces.pair_terms(pairs, given, terms, LIKE, LIKE * 2, force_nf, drho_n, heat_n, *virials)
    return force_nf, drho_n, heat_n


def test_pressure_and_viscosity() -> None:
    """-V_i V_j (P_i + P_j) grad W and 2 eta V_i V_j F v_ij, with F = W'/r; opposite on the partner."""
    force_nf, drho_n, heat_n = two(forces.Terms(0.0, 0.0, False, 0.5, 1.5))
    x_c, v_c = np.array(X_C), np.array([1.25, 0.25])
    assert_products(force_nf[0, :2], -(0.5 * 0.75) * 5.0 * SLOPE * x_c)
    assert_products(force_nf[0, 2:], 2 * 0.5 * (0.5 * 0.75) * SLOPE * v_c)
    assert np.array_equal(force_nf[1], -force_nf[0])
    assert not drho_n.any()
    assert not heat_n.any()


def test_harmonic_means() -> None:
    arithmetic, harmonic = (two(forces.Terms(0.0, 0.0, mean, 0.5, 1.5))[0] for mean in (False, True))
    assert np.array_equal(harmonic[:, :2], arithmetic[:, :2])
    assert_products(harmonic[:, 2:], arithmetic[:, 2:] * (2 * 0.25 * 0.75 / (0.25 + 0.75)) / 0.5)


def test_density_diffusion_acts_on_fluid_alone() -> None:
    """-2 xi V_j F [(rho_j - rho0_j) - (rho_i - rho0_i)]."""
    terms = forces.Terms(0.0, 0.125, False, 0.5, 1.5)
    drho_n = two(terms)[1]
    psi = (1.5 - 1.125) - (1.25 - 1.0)
    assert_products(drho_n, [-2 * 0.125 * 0.75 * psi * SLOPE, 2 * 0.125 * 0.5 * psi * SLOPE])
    assert not two(terms, solid_n=np.array([True, False]))[1].any()


def test_heat_flows_between_solids_too() -> None:
    """2 kappa V_i V_j F (T_i - T_j), the gain of one is the loss of the other; two solids have no force."""
    given = {"conductivity_n": np.array([0.5, 1.5]), "temperature_n": np.array([2.0, 5.0])}
    force_nf, _, heat_n = two(forces.Terms(0.0, 0.0, False, 0.5, 1.5), solid_n=np.array([True, True]), **given)
    flow = 2 * 1.0 * (0.5 * 0.75) * SLOPE * (2.0 - 5.0)
    assert_products(heat_n, [flow, -flow])
    assert not force_nf.any()


def test_wall_extrapolates_its_velocity_and_repels() -> None:
    """The fluid meets v_s + (v_s - v_f) k; within half a cutoff a deep solid adds (chi - 0.9)(rc/2 - r) rho0 c^2 rc."""
    walls = {"solid_n": np.array([True, False]), "rest_volume_n": np.ones(2), "chi_n": np.array([0.95, 0.75])}
    cut = 1.5
    force_nf, _, _ = two(forces.Terms(0.0, 0.0, False, 0.5, cut), **walls)
    ratio = (2 * cut * 0.45) / (2 * cut * 0.25)
    r = math.hypot(*X_C)
    repulsion = (0.95 - 0.9) * (cut / 2 - r) * 1.0 * 11.0**2 * cut / r
    viscous_c = 2 * 0.5 * (0.5 * 0.75) * SLOPE * (1 + ratio) * np.array([1.25, 0.25])
    repelled_c = repulsion * np.array(X_C)
    # The differences chi - 0.9 and rc/2 - r enlarge the errors of what is subtracted.
    lost = 1 + 0.9 / (0.95 - 0.9) + r / (cut / 2 - r)
    bound_c = ROUNDINGS * U * (np.abs(viscous_c) + lost * np.abs(repelled_c))
    assert (np.abs(force_nf[0, 2:] - (viscous_c + repelled_c)) <= bound_c).all()
    assert np.array_equal(force_nf[1], -force_nf[0])


def test_virials_of_both_particles() -> None:
    """Half of the distance times the force on either; without an array for them nothing else changes."""
    terms = forces.Terms(0.0, 0.0, False, 0.5, 1.5)
    virial_nf = np.zeros((2, 4))
    force_nf = two(terms)[0]
    assert np.array_equal(two(terms, virial_nf)[0], force_nf)
    sizes_nc = np.abs(force_nf[:, :2]) + np.abs(force_nf[:, 2:])
    for k, x_c in enumerate((np.array(X_C), -np.array(X_C))):
        virial = 0.5 * np.outer(x_c, force_nf[k, :2] + force_nf[k, 2:]).ravel()
        bound = ROUNDINGS * U * np.outer(np.abs(x_c), sizes_nc[k]).ravel()
        assert virial.any() and (np.abs(virial_nf[k] - virial) <= bound).all()
