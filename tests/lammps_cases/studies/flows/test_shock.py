"""The shock tube: order on the reference, faults that it detects, the solution that LAMMPS converges to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eos_ref import InputError
from eos_ref.eos.bounds import EPS
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from lammps_cases.engine.session import Session
from lammps_cases.findings.forces import ForcePerVolume
from lammps_cases.studies.flows.flow import Options
from lammps_cases.studies.flows.solve import converge
from lammps_cases.studies.flows.surfaces import SHOCK_TUBE, problem, without_volume
from tests.support.flow_faults import Plant, differences, of_energy, of_gamma, of_types, order

pytestmark = pytest.mark.slow

QUICK = SHOCK_TUBE.quick
SAME = 1e-8  # velocities over the largest, densities relative: roundings of some dozen steps


def test_order() -> None:
    assert SHOCK_TUBE.expected.startswith("1:")
    assert order(SHOCK_TUBE, QUICK) > 0.5


@pytest.mark.parametrize(
    "plant",
    [
        pytest.param(of_energy(1.1), id="energy"),
        pytest.param(of_gamma(1.45), id="gamma"),
        pytest.param(of_types((2,), mass=0.9), id="mass of the thin gas"),
    ],
)
def test_order_detects_faults(plant: Plant) -> None:
    assert order(SHOCK_TUBE, QUICK, plant) < 0.5


@pytest.mark.lammps
def test_lammps_converges_to_the_solution_without_volumes() -> None:
    """force-per-volume, as a closed solution: LAMMPS converges to it and not to that of the gas."""
    (found,) = converge(SHOCK_TUBE, engines=("lammps",), resolutions=QUICK)
    assert not found.messages
    for name in ("density", "velocity"):
        assert found.fit(name).order < 0.5 < found.fit(f"{name} without volume").order
        assert found.errors[name][-1] > found.errors[f"{name} without volume"][-1]


@pytest.mark.lammps
def test_finding_accounts_for_lammps() -> None:
    session = Session()
    assert max(differences(SHOCK_TUBE, QUICK[0], ForcePerVolume, session)) < SAME
    assert max(differences(SHOCK_TUBE, QUICK[0], ArrayEvaluator, session)) > 1e4 * SAME


def test_solution_without_volumes() -> None:
    """The mass stays; in the fan du/dt = -dP/dx / m and d rho/dt = -rho du/dx, by central differences."""
    gases = problem(Options())
    left, t, d = gases.left, 1.3, 1e-5
    x_n = np.linspace(-3.0, 3.0, 600_001)
    rho_n, _ = without_volume(gases, x_n, t)
    mass = np.trapezoid(rho_n, x_n)
    assert mass == pytest.approx(3 * (left.rho + gases.right.rho), abs=x_n[1] - x_n[0])
    x_n = np.linspace(-0.95, -0.5, 10) * t * left.c
    (rho_t, u_t), (rho_x, u_x) = (
        [
            (a - b) / (2 * d)
            for a, b in zip(
                without_volume(gases, x_n + dx, t + dt), without_volume(gases, x_n - dx, t - dt), strict=True
            )
        ]
        for dx, dt in ((0, d), (d, 0))
    )
    rho_n, u_n = without_volume(gases, x_n, t)
    # Central differences of a profile with lengths and times of 1: d^2, and ten roundings over d.
    allowed = d**2 + 10 * EPS / d
    np.testing.assert_allclose(rho_t + u_n * rho_x + rho_n * u_x, 0.0, atol=allowed)
    np.testing.assert_allclose(u_t + u_n * u_x + left.c**2 * rho_x / left.rho, 0.0, atol=allowed)


def test_bad_input() -> None:
    with pytest.raises(InputError, match="thin"):
        SHOCK_TUBE.start(60, replace(SHOCK_TUBE.options, extra={"thin": 1.5}))
