"""Slow flow through arrays of obstacles: the drag of the sources' series, and a field that solves the problem."""

from __future__ import annotations

import numpy as np
import pytest

from eos_ref import InputError
from eos_ref.analytic import stokes


@pytest.mark.parametrize("a", [0.02, 0.05, 1 / 12])
def test_drag_of_dilute_cylinders_is_that_of_the_series(a: float) -> None:
    phi = np.pi * a**2
    below = -0.5 * np.log(phi) - 0.738 + phi - 0.887 * phi**2 + 2.038 * phi**3
    assert stokes.cylinders(a).drag == pytest.approx(4 * np.pi / below, rel=0.0005 / below)  # 0.738 has three digits


@pytest.mark.parametrize("a", [0.02, 1 / 12, 0.2, 0.3])
def test_speed_between_cylinders_carries_the_flux_and_vanishes_on_them(
    a: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    x, weight = np.polynomial.legendre.leggauss(60)
    y = a + (0.5 - a) * (x + 1) / 2

    def flux(modes: int) -> float:
        monkeypatch.setattr(stokes, "MODES", modes)
        return float((0.5 - a) * (weight @ stokes.cylinders(a).speed(y)))

    whole = flux(stokes.MODES)  # the series converges with the number of modes, by a factor of ten for six of them
    assert abs(flux(18) - 1) < abs(flux(12) - 1) / 10 < 0.01 and whole == flux(18)
    flow = stokes.cylinders(a)
    assert flow.speed(np.array([0.0, a])).tolist() == [0.0, 0.0]
    near, further = flow.speed(a * (1 + np.array([1e-4, 1e-3])))
    assert near == pytest.approx(further / 10, rel=0.01)  # linear in the distance, to first order in 1e-3
    assert flow.speed(-y) == pytest.approx(flow.speed(y))


def test_drag_of_a_single_sphere_is_that_of_stokes() -> None:
    third = 1e-4  # of the fraction 1e-12; the next terms of 1/K are of its square
    assert stokes.drag_of_sphere(third**3) == pytest.approx(1 + 1.7601 * third, rel=4 * third**2)
    # Sangani & Acrivos (1982) tabulate 2.842 for a radius of a quarter of the cell.
    assert stokes.drag_of_sphere(4 / 3 * np.pi / 64) == pytest.approx(2.842, abs=5e-4)


@pytest.mark.parametrize("wrong", [0.0, 0.35, np.nan])
def test_radius_and_fraction_must_lie_in_their_range(wrong: float) -> None:
    with pytest.raises(InputError, match="must lie above 0"):
        stokes.cylinders(wrong)
    with pytest.raises(InputError, match="must lie above 0"):
        stokes.drag_of_sphere(wrong)
