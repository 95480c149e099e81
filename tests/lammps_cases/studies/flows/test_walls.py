"""Plane flow from rest and the tank: order on the reference, faults that it detects, differences of LAMMPS."""

from __future__ import annotations

from dataclasses import replace

import pytest

from eos_ref import EOS
from eos_ref.analytic.channel import column
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from lammps_cases.engine.session import Session
from lammps_cases.findings.forces import ForcePerVolume
from lammps_cases.findings.walls import WallVelocityLost
from lammps_cases.studies.flows.flow import Flow, Options
from lammps_cases.studies.flows.solve import Engine, converge
from lammps_cases.studies.flows.walls import COMPRESSION, COUETTE, COUETTE_STORED, POISEUILLE, TANK
from tests.support.flow_faults import Plant, differences, faster, of_gravity, of_types, order

pytestmark = pytest.mark.slow

QUICK = (8, 12, 18)
# Formulas that are the same on paper differ by roundings, which grow over a hundred steps and by pressures c^2 drho.
SAME = 1e-8


class ForceAndWall(ForcePerVolume, WallVelocityLost):
    """The two findings that plane flow with a moving wall meets."""


@pytest.fixture(scope="module")
def session() -> Session:
    return Session()


@pytest.mark.parametrize(
    ("flow", "promised"),
    [(POISEUILLE, 2), (COUETTE, 2), (COUETTE_STORED, 1), (TANK, 1)],
    ids=["poiseuille", "couette", "couette-stored", "tank"],
)
def test_order(flow: Flow, promised: int) -> None:
    """Nearer to the expected order than to the next lower one, or better."""
    assert str(promised) == flow.expected.split(":")[0]
    assert order(flow, QUICK) > promised - 0.5


@pytest.mark.parametrize(
    ("flow", "promised", "plant"),
    [
        pytest.param(POISEUILLE, 2, of_types(viscosity=1.05), id="poiseuille-viscosity"),
        pytest.param(POISEUILLE, 2, of_gravity(1.02), id="poiseuille-gravity"),
        pytest.param(COUETTE, 2, of_types(viscosity=1.05), id="couette-viscosity"),
        pytest.param(COUETTE, 2, faster(1.02), id="couette-speed"),
        pytest.param(TANK, 1, of_gravity(1.02), id="tank-gravity"),
        pytest.param(TANK, 1, of_types(cs=1.02), id="tank-sound"),
    ],
)
def test_order_detects_faults(flow: Flow, promised: int, plant: Plant) -> None:
    assert order(flow, QUICK, plant) < promised - 0.5


def lammps_errors(flow: Flow, options: Options | None = None) -> tuple[float, ...]:
    engines: tuple[Engine, ...] = ("lammps",)
    (found,) = converge(flow, options, engines, QUICK)
    assert not found.messages
    return next(iter(found.errors.values()))


@pytest.mark.lammps
def test_lammps_drags_fluid_to_half_the_speed_of_a_plate() -> None:
    """wall-velocity-lost: U d_s/(d_s + d_f), and a wall half way between the rows has d_s = d_f."""
    assert lammps_errors(COUETTE) == pytest.approx([0.5] * len(QUICK), abs=0.5 / QUICK[0] ** 2)


@pytest.mark.lammps
def test_lammps_tank_has_an_error_of_the_size_of_its_compression() -> None:
    """force-per-volume: forces of rho g on masses m. The error is at most rho/rho0 - 1, twice that in a swing."""
    errors = lammps_errors(TANK)
    assert all(0.5 * COMPRESSION < error < 2 * COMPRESSION for error in errors)
    hardly = replace(TANK.options, extra={"compression": COMPRESSION / 40})
    assert all(new < old / 4 for new, old in zip(lammps_errors(TANK, hardly), errors, strict=True))


@pytest.mark.lammps
@pytest.mark.parametrize(
    ("flow", "stages"),
    [(POISEUILLE, ForcePerVolume), (COUETTE, ForceAndWall), (TANK, ForcePerVolume)],
    ids=["poiseuille", "couette", "tank"],
)
def test_findings_account_for_lammps(flow: Flow, stages: type[ArrayEvaluator], session: Session) -> None:
    """With the findings' variants the reference reproduces LAMMPS; without them it does not (poiseuille: hardly)."""
    explained, plain = (
        differences(flow, QUICK[0], stages, session),
        differences(flow, QUICK[0], ArrayEvaluator, session),
    )
    assert max(explained) < SAME
    assert flow is POISEUILLE or max(plain) > 1e4 * SAME


@pytest.mark.parametrize("law", ["linear", "tait/water"])
def test_tank_rows_have_equal_mass(law: str) -> None:
    """Spacing times density is the mass of a row, to second order; the surface has the density at rest."""
    n = 12
    atoms = TANK.start(n, replace(TANK.options, extra={"law": law})).atoms
    fluid_n = (atoms.type_n == 1) & (atoms.x_nc[:, 0] < 1)
    y_n, rho_n = atoms.x_nc[fluid_n, 1], atoms.rho_n[fluid_n] if atoms.rho_n is not None else None
    assert rho_n is not None
    middle_n = (rho_n[1:] + rho_n[:-1]) / 2
    assert (y_n[1:] - y_n[:-1]) * middle_n == pytest.approx(1.0, rel=(COMPRESSION / n) ** 2)
    expected = column(EOS("tait/water" if law == "tait/water" else "linear"), 0.5, COMPRESSION / n)[1]
    assert rho_n[-1] == float(expected)
