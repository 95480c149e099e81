"""The stretching drop and two fluids at rest: order on the reference, faults that it detects, LAMMPS in comparison."""

from __future__ import annotations

import numpy as np
import pytest

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from lammps_cases.engine.session import Session
from lammps_cases.findings.forces import ForcePerVolume
from lammps_cases.studies.flows.flow import Flow
from lammps_cases.studies.flows.solve import converge
from lammps_cases.studies.flows.surfaces import DROP, INTERFACE
from tests.support.flow_faults import Plant, differences, faster, of_types, order

pytestmark = pytest.mark.slow

QUICK = DROP.quick  # the same as the interface's
SAME = 1e-8  # velocities over the largest, densities relative: roundings of a hundred steps
flows = pytest.mark.parametrize("flow", [DROP, INTERFACE], ids=["drop", "interface"])


@pytest.fixture(scope="module")
def session() -> Session:
    return Session()


@flows
def test_order(flow: Flow) -> None:
    assert flow.expected.startswith("1:")
    assert order(flow, QUICK) > 0.5


@pytest.mark.parametrize(
    ("flow", "plant"),
    [
        pytest.param(DROP, faster(1.05), id="drop-rate"),
        pytest.param(DROP, of_types(cs=0.3), id="drop-sound"),
        pytest.param(INTERFACE, of_types((2,), mass=1.1), id="interface-mass"),
        pytest.param(INTERFACE, of_types((2,), rho0=1.1), id="interface-density"),
    ],
)
def test_order_detects_faults(flow: Flow, plant: Plant) -> None:
    assert order(flow, QUICK, plant) < 0.5


@pytest.mark.lammps
@flows
def test_lammps_converges_with_the_same_errors(flow: Flow) -> None:
    """Volumes stay near 1, so the missing volume changes the error by less than a tenth."""
    ours, theirs = converge(flow, resolutions=QUICK)
    assert not theirs.messages
    headline = next(iter(ours.errors))
    np.testing.assert_allclose(theirs.errors[headline], ours.errors[headline], rtol=0.1)


@pytest.mark.lammps
@flows
def test_finding_accounts_for_lammps(flow: Flow, session: Session) -> None:
    assert max(differences(flow, QUICK[0], ForcePerVolume, session)) < SAME
    assert max(differences(flow, QUICK[0], ArrayEvaluator, session)) > 1e3 * SAME
