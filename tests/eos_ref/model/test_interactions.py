"""Terms of a pair and properties of a particle: worked values, symmetries, limits, edges of their regimes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from eos_ref.model import interactions as pair
from eos_ref.model import per_atom
from tests.support.particle_scenes import EPS


def test_means() -> None:
    a, b = np.array([2.0, 0.0, 0.0, 5.0]), np.array([6.0, 4.0, 0.0, 5.0])
    assert pair.arithmetic_mean(a, b).tolist() == [4.0, 2.0, 0.0, 5.0]
    with np.errstate(all="raise"):  # 0 and 0 divides nothing
        assert pair.harmonic_mean(a, b).tolist() == [3.0, 0.0, 0.0, 5.0]
    assert pair.harmonic_mean(b, a).tolist() == pair.harmonic_mean(a, b).tolist()


def test_worked_values() -> None:
    """Small whole numbers: exact."""
    assert pair.pressure_term(2.0, 3.0, 5.0) == -30
    assert pair.viscous_term(0.5, 2.0, 3.0, -2.0) == -12
    assert pair.heat_term(0.5, 2.0, 3.0, -2.0) == -12
    assert pair.diffusion_term(0.5, 3.0, 2.0, -2.0) == 12
    assert pair.interface_distance(0.75, 3.0) == 1.5
    assert pair.interface_distance(0.5, 3.0) == 0
    assert pair.shift_weight(6.0, 3.0) == 1 + 0.2 * 16
    assert pair.shift_weight(0.0, 3.0) == 1


def test_signs_are_physical() -> None:
    """For x.gradW < 0: friction against v_ij, heat from hot to cold, density from dense to thin."""
    assert pair.viscous_term(1.0, 1.0, 1.0, -1.0) < 0
    assert pair.heat_term(1.0, 1.0, 1.0, -1.0) < 0
    assert pair.diffusion_term(1.0, 1.0, +1.0, -1.0) > 0  # the neighbour is the denser


def test_artificial_viscosity() -> None:
    """mu = (-6/1.5)/(9/2.25 + 0.01) for approaching particles, none for parting ones."""
    mu = -4 / 4.01
    expected = 0.5 * (-2 * 3.0 * mu + mu * mu) * 2.25
    found = pair.artificial_term(0.5, 3.0, -6.0, 9.0, 1.5, 2.25)
    assert abs(found - expected) <= 12 * EPS * expected  # all terms are positive, 12 roundings
    assert pair.artificial_term(0.5, 3.0, 6.0, 9.0, 1.5, 2.25) == 0
    assert pair.artificial_term(0.5, 3.0, 0.0, 9.0, 1.5, 2.25) == 0


def test_no_slip_ratio() -> None:
    r"""Ratio of the distances; nothing behind the interface, and at least sqrt(3)/12 of the cutoff below."""
    assert pair.no_slip_ratio(0.75, 1.0, 3.0) == 0.5
    assert pair.no_slip_ratio(0.5, 1.0, 3.0) == pair.no_slip_ratio(0.2, 0.1, 3.0) == 0
    least = math.sqrt(3) / 12
    assert abs(pair.no_slip_ratio(1.0, 0.1, 3.0) - 1 / least) <= 6 * EPS / least
    edge = 0.5 + least / 2  # where 2 (chi - 1/2) meets the limit the ratio is continuous
    apart = 1e-12 * edge
    above, below = (pair.no_slip_ratio(1.0, chi, 3.0) for chi in (edge + apart, edge - apart))
    # Above, 1/(2 (chi - 1/2)) falls with the slope 2/least^2; chi is rounded as 1 is.
    assert 0 <= below - above <= (apart + EPS) * 2 / least**2 + 12 * EPS / least


def test_repulsion() -> None:
    """(chi - 0.9)(cut/2 - r) rho0 c^2 cut: zero at either edge, positive inside."""
    found = pair.repulsion_term(1.0, 0.5, 2.0, 3.0, 4.0)
    expected = 0.1 * 1.5 * 2 * 9 * 4
    assert abs(found - expected) <= 12 * EPS * expected + EPS * 1.5 * 72  # 1 - 0.9 keeps an error of eps
    assert pair.repulsion_term(0.9, 0.5, 2.0, 3.0, 4.0) == 0
    assert pair.repulsion_term(0.3, 0.5, 2.0, 3.0, 4.0) == 0
    assert pair.repulsion_term(1.0, 2.0, 2.0, 3.0, 4.0) == pair.repulsion_term(1.0, 3.0, 2.0, 3.0, 4.0) == 0


# --- one particle


def shear(rate: float) -> list[list[float]]:
    return [[0.0, rate], [0.0, 0.0]]


def test_strain_rate() -> None:
    """Simple shear: the rate itself. Rotation: 0. Expansion a in d dimensions: a sqrt(2 d), no trace removed."""
    assert abs(per_atom.strain_rate(shear(3.0)) - 3) <= 4 * EPS * 3
    assert abs(per_atom.strain_rate(shear(-3.0)) - 3) <= 4 * EPS * 3
    assert per_atom.strain_rate([[0.0, 2.0], [-2.0, 0.0]]) == 0
    assert per_atom.strain_rate([[2.0, 0.0], [0.0, 2.0]]) == 4
    G = [[2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0]]
    assert abs(per_atom.strain_rate(G) - 2 * math.sqrt(6)) <= 4 * EPS * 5


@pytest.mark.parametrize(("K", "n"), [(0.2, 0.6), (0.2, 1.4), (0.0, 1.0), (1.0, 1.0), (3.0, 0.1)])
def test_power_law_is_continuous(K: float, n: float) -> None:
    """At gd0 both branches give eta; their difference beyond is at most the slope's bound times the distance."""
    eta, gd0 = 0.5, 0.75
    tau0 = eta * gd0 - K * gd0**n

    def law(rate: float) -> float:
        return float(per_atom.power_viscosity(eta, gd0, K, n, np.float64(rate)))

    assert law(0.0) == law(gd0 / 2) == law(gd0) == eta
    for step in (1e-3, 1e-6, 1e-9):
        slope = K * abs(n - 1) * gd0 ** (n - 2) + abs(tau0) / gd0**2  # either falls with rate (n < 2)
        assert abs(law(gd0 * (1 + step)) - eta) <= slope * gd0 * step + 16 * EPS * (K * gd0 ** (n - 1) * 2 + eta)
    far = 7.3
    expected = K * far ** (n - 1) + tau0 / far
    assert abs(law(far) - expected) <= 16 * EPS * (K * far ** (n - 1) + (eta * gd0 + K * gd0**n) / far)
    # the stress eta * rate is the Herschel-Bulkley law tau0 + K rate**n
    assert abs(law(far) * far - (tau0 + K * far**n)) <= 20 * EPS * (eta * gd0 + K * gd0**n + K * far**n)


def test_newtonian_power_law() -> None:
    """n = 1 and K = eta: no regime differs."""
    rate = np.linspace(0, 9, 50)
    assert (np.abs(per_atom.power_viscosity(0.5, 0.75, 0.5, 1.0, rate) - 0.5) <= 8 * EPS).all()


def test_temperature_with_latent_heat() -> None:
    """e/cv to the freezing point, a plateau of width L, then (e - L)/cv; without a freezing point e/cv throughout."""
    cv, latent, T_freeze = 2.0, 3.0, 1.5
    e = np.array([1.0, 3.0, 3.5, 6.0, 7.0, 16.0])
    on = np.ones(6, bool)
    expected = [0.5, 1.5, 1.5, 1.5, 2.0, 6.5]
    assert per_atom.temperature(e, cv, latent, on, T_freeze).tolist() == expected
    assert per_atom.temperature(e, cv, latent, ~on, T_freeze).tolist() == (e / cv).tolist()
    assert per_atom.temperature(e, cv, 0.0, on, T_freeze).tolist() == (e / cv).tolist()


def test_stress() -> None:
    G = [[1.0, 2.0], [3.0, 5.0]]
    assert per_atom.stress(G, 0.5) == [[1.0, 2.5], [2.5, 5.0]]
    assert per_atom.stress(G, 0.5, 7.0) == [[8.0, 2.5], [2.5, 12.0]]
