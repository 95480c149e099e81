"""Panels of kernels and time steps: their errors, and the limits that they find."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import ExitStack

import numpy as np
import pytest

from lammps_cases.engine.session import Session
from lammps_cases.records import measure
from lammps_cases.records.measure import Call, Timing
from lammps_cases.studies.chart import collect, flows, kernels
from lammps_cases.studies.chart.kernels import prepared
from lammps_cases.studies.flows.catalogue import FLOWS
from lammps_cases.studies.flows.flow import relative

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def session() -> Session:
    return Session()


@pytest.fixture
def untimed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Skip the timing: every method takes a second."""

    def called(calls: Mapping[str, Call], rounds: int = 9, at_least: float = 0.02) -> dict[str, Timing]:
        for call in calls.values():
            call()
        return {name: Timing((1.0,) * rounds, 1, 1.0) for name in calls}

    monkeypatch.setattr(measure, "in_turns", called)


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Scenes small enough to run quickly."""
    monkeypatch.setattr(kernels, "QUICK_EDGE", 16)


@pytest.mark.usefixtures("untimed", "small")
@pytest.mark.parametrize("section", ["kernels", "timestep"])
def test_panels_are_complete(section: str) -> None:
    panels = list(collect.PANELS[section](True, None))
    assert len({panel.id for panel in panels}) == len(panels)
    for panel in panels:
        assert all(math.isfinite(p.error) and p.error >= 0 and not p.method.startswith("LAMMPS") for p in panel.points)
        for regime in panel.regimes:
            names = [point.method for point in panel.of(regime)]
            assert len(set(names)) == len(names) > 1


# --- kernels


def test_gradient_is_that_of_the_field() -> None:
    x_nc, step = np.random.default_rng(1).uniform(0, 16, (50, 2)), 1e-4
    for axis in (0, 1):
        ahead = kernels.field(x_nc + step * np.eye(2)[axis]) - kernels.field(x_nc - step * np.eye(2)[axis])
        # Central differences: step^2/6 times the third derivative, which is at most k^3; and rounding over the step.
        bound = kernels.K**3 * step**2 / 6 + 4 * np.finfo(float).eps / step
        assert np.abs(ahead / (2 * step) - kernels.gradient(x_nc)[:, :, axis]).max() < bound


@pytest.mark.lammps
def test_engines_have_the_same_gradients(session: Session) -> None:
    with ExitStack() as stack:
        runs = kernels.run(kernels.gradients((2.0, 3.0), 0.2, 16), session, stack)
    for name in (name for name in runs if not name.startswith("LAMMPS")):
        theirs_n = runs[f"LAMMPS {name}"].value_n
        # Sums of fewer than 40 terms of size k, each with a few roundings; the correction matrix loses some digits.
        assert np.abs(runs[name].value_n - theirs_n).max() < 1e-10 * kernels.K, name
    other = runs["RK1, cutoff 2"].value_n - runs["RK1, cutoff 3"].value_n
    assert np.abs(other).max() > 1e-3 * kernels.K


def test_corrected_gradients_are_more_accurate_under_disorder() -> None:
    with ExitStack() as stack:
        runs = kernels.run(kernels.gradients((3.0,), 0.3, 32), None, stack)
    true_n = kernels.gradient(prepared("quintic", 3.0, 0.3, 32).atoms.x_nc)
    off = {name.split(",")[0]: relative(run.value_n - true_n, true_n) for name, run in runs.items()}
    assert off["RK2"] < off["RK1"] < off["quintic"] == off["RK0"]


def test_density_of_deformed_fluid_is_that_of_its_cells() -> None:
    made = kernels.deformed("quintic", 3.0, 0.0, 16, rho_sum=False)
    v_nc = made.atoms.v_nc
    assert v_nc is not None
    step = 1e-5
    volume_n = np.ones(len(v_nc))
    for axis in (0, 1):
        x_n = made.atoms.x_nc[:, axis]
        ends = [x + kernels.DEFORMED * np.sin(kernels.K * x) for x in (x_n - step, x_n + step)]
        volume_n *= (ends[1] - ends[0]) / (2 * step)
    # As above; two factors of at most 1.1 each.
    bound = 4 * (kernels.DEFORMED * kernels.K**3 * step**2 / 6 + 64 * np.finfo(float).eps / step)
    assert np.abs(kernels.exact_density(made.atoms.x_nc) * volume_n - 1).max() < bound
    assert np.abs(kernels.exact_density(made.atoms.x_nc + 0.1) * volume_n - 1).max() > bound


def test_continuity_follows_a_deformation_smoothed_by_a_sum() -> None:
    found = {}
    for way, rho_sum in (("continuity", False), ("summation", True)):
        made = kernels.deformed("RK1", 2.5, 0.0, 32, rho_sum)
        sim = made.simulation(())
        sim.run(kernels.STEPS, 1.0 / kernels.STEPS)
        true_n = kernels.exact_density(made.atoms.x_nc)
        found[way] = relative(sim.output("rho") - true_n, true_n - 1)
    assert found["continuity"] < found["summation"] < 0.5
    assert relative(np.ones(len(true_n)) - true_n, true_n - 1) == 1.0  # no change at all


@pytest.mark.usefixtures("small")
def test_maps_have_a_value_for_every_cutoff_and_disorder() -> None:
    found = {made.id: made for made in kernels.maps(True)}
    assert all(np.array(made.value).shape == (len(made.y), len(made.x)) for made in found.values())
    quintic, rk1 = (np.array(found[f"kernels-{name}"].value) for name in ("quintic", "rk1"))
    assert (rk1[-1] < quintic[-1]).all() and (quintic[-1] > quintic[0]).all()


# --- time step


def test_time_step_error_of_viscosity_is_first_order() -> None:
    solved = flows.solve(flows.waves()[0], 16, flows.FRACTIONS, 1 / 16, [None] * 5)
    found = flows.order(solved)
    assert abs(found.order - 1) < 0.1 and found.standard_error < 0.05
    assert [s.temporal for s in solved] == sorted((s.temporal for s in solved), reverse=True)


@pytest.mark.lammps
def test_single_steps_equal_one_run(session: Session) -> None:
    start = flows.started(FLOWS["sound-wave-linear"], 16, 1.0)
    for who in (None, session):
        shots = flows.shots(flows.stepping(start, who), start.steps)
        assert [round(shot.time / start.timestep) for shot in shots] == list(start.steps)
        at_once = flows.stepping(start, who)
        at_once.advance(start.steps[-1])
        assert np.array_equal(at_once.snapshot().rho_n, shots[-1].rho_n)
