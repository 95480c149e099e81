"""Orders of convergence, and runs that fail."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import linregress

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from lammps_cases.engine.workers import Workers
from lammps_cases.studies.flows.catalogue import FLOWS
from lammps_cases.studies.flows.flow import Flow, Options, Start
from lammps_cases.studies.flows.periodic import SHEAR
from lammps_cases.studies.flows.solve import by_lammps, by_reference, converge, fit, in_worker
from tests.support.roundings import HALF_EPS, rounded

pytestmark = pytest.mark.slow

RESOLUTIONS = (8, 12, 20, 30)


def lost(errors: list[float]) -> float:
    """Error of a slope, or of its standard error, by 8 roundings of every logarithm."""
    x = np.log(RESOLUTIONS) - np.log(RESOLUTIONS).mean()
    return float(8 * HALF_EPS * np.abs(np.log(errors)).max() * np.abs(x).sum() / (x**2).sum())


def test_fit_is_least_squares() -> None:
    errors = [0.5, 0.21, 0.11, 0.03]
    line = linregress(np.log(RESOLUTIONS), np.log(errors))
    found = fit(RESOLUTIONS, errors)
    expected = -line.slope, line.stderr
    assert (found.order, found.standard_error) == pytest.approx(expected, rel=0, abs=2 * lost(errors))


def test_fit_of_a_power_has_no_error() -> None:
    errors = [3.0 * n**-1.5 for n in RESOLUTIONS]
    found = fit(RESOLUTIONS, errors)
    assert (found.order, found.standard_error) == pytest.approx((1.5, 0.0), rel=0, abs=lost(errors))


def test_fit_omits_missing_values() -> None:
    # ln 32 and ln 8, each 2.5 times their difference at most; that, ln 4 and the quotient.
    assert fit((8, 16, 32), (1.0, float("nan"), 0.25)).order == rounded(1.0, 8)
    assert np.isnan(fit((8, 16, 32), (1.0, float("nan"), 0.25)).standard_error)
    assert np.isnan(fit((8, 16), (1.0, 0.0)).order)


def refused(n: int, options: Options) -> Start:
    """A shear wave that lacks an argument at resolution 12."""
    start = SHEAR.start(n, options)
    violate = "unknown-pressure-style" if n == 12 else None
    scene = start.case.scene.model_copy(update={"violate": violate})
    return replace(start, case=replace(start.case, scene=scene))


def test_flows_have_names_resolutions_and_orders() -> None:
    """Every flow is listed by its own name, at three or more resolutions, with a numeric order."""
    assert len(FLOWS) >= 9
    for name, flow in FLOWS.items():
        assert name == flow.name
        assert min(len(set(flow.resolutions)), len(set(flow.quick)) or 3) >= 3
        assert flow.expected.split(":")[0].isdecimal()


def test_only_lammps_errors_become_messages() -> None:
    """A bug of this project is not blamed on LAMMPS."""
    with pytest.raises(AttributeError):
        by_lammps(SHEAR.start(8, SHEAR.options), None)


@pytest.mark.lammps
def test_refused_run_leaves_a_message() -> None:
    flow: Flow = replace(SHEAR, start=refused)
    (found,) = converge(flow, engines=("lammps",), resolutions=(8, 12, 16))
    assert list(found.messages) == [12]
    assert "ERROR" in found.messages[12]
    assert [np.isfinite(error) for error in found.errors["rate"]] == [True, False, True]
    assert found.fit("rate").order == pytest.approx(2.0, abs=0.5)  # from two coarse runs: nearer to 2 than to 1 or 3


@pytest.mark.lammps
def test_lost_atoms_leave_a_message() -> None:
    start = SHEAR.start(8, SHEAR.options)
    assert start.atoms.v_nc is not None
    fast = replace(start, atoms=replace(start.atoms, v_nc=start.atoms.v_nc + np.array([1e9, 0.0, 0.0])))
    with Workers(None, 1) as workers:
        fled = in_worker(fast, workers)
        assert fled.lost and "Lost atoms" in fled.message
        unreal = in_worker(replace(start, atoms=replace(start.atoms, v_nc=start.atoms.v_nc * np.nan)), workers)
        assert not unreal.lost and unreal.message
        late = in_worker(SHEAR.start(48, SHEAR.options), workers, 0.01)
        assert not late.lost and "time limit" in late.message
        assert not in_worker(start, workers).message  # the worker lives on


@pytest.mark.parametrize("evaluator", [None, ArrayEvaluator])
def test_snapshots_are_at_the_requested_steps(evaluator: type[ArrayEvaluator] | None) -> None:
    start = SHEAR.start(8, SHEAR.options)
    sampled = replace(start, steps=(0, 3, start.steps[-1]))
    result = by_reference(sampled, evaluator)
    assert [shot.time for shot in result.snapshots] == [step * start.timestep for step in sampled.steps]
    assert np.array_equal(result.snapshots[0].x_nc, start.atoms.x_nc[:, :2])
    assert (result.n, result.steps, result.message) == (64, start.steps[-1], "")
    assert not np.array_equal(result.snapshots[1].v_nc, result.snapshots[2].v_nc)
