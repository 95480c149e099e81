"""Panels of sums, kernels, searches and time steps: their errors, and the limits that they find."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from eos_ref.compiled import evaluator
from lammps_cases.engine import session
from lammps_cases.records import measure
from lammps_cases.records.measure import Call, Timing
from lammps_cases.studies.chart import kernels, searches, sums, threads, timestep
from lammps_cases.studies.chart import search_methods as search_methods
from lammps_cases.studies.chart import sum_methods as sum_methods
from lammps_cases.studies.chart.prepared import prepared
from lammps_cases.studies.flows import FLOWS
from lammps_cases.studies.flows.layout import relative
from tests.support.roundings import rounded

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def lmp() -> Any:
    return session.open_lammps()


@pytest.fixture
def untimed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every method takes a second."""

    def called(calls: Mapping[str, Call], rounds: int = 9, at_least: float = 0.02) -> dict[str, Timing]:
        for call in calls.values():
            call()
        return {name: Timing((1.0,) * rounds, 1, 1.0) for name in calls}

    monkeypatch.setattr(measure, "in_turns", called)


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Scenes that need no time."""
    monkeypatch.setattr(sums, "QUICK_EDGE", {2: 12, 3: 8})
    monkeypatch.setattr(searches, "EDGES", (12, 24))
    monkeypatch.setattr(searches, "NEAR", 100)
    monkeypatch.setattr(searches, "MOST_STEPS", searches.LEAST_STEPS)
    monkeypatch.setattr(kernels, "QUICK_EDGE", 16)


@pytest.mark.usefixtures("untimed", "small")
@pytest.mark.parametrize(
    ("module", "methods"),
    [(sums, sum_methods.METHODS), (searches, search_methods.METHODS), (kernels, ()), (timestep, ())],
    ids=["sums", "searches", "kernels", "timestep"],
)
def test_panels_are_complete(module: Any, methods: Any) -> None:
    panels = list(module.panels(True, None))
    assert len({panel.id for panel in panels}) == len(panels)
    for panel in panels:
        for regime in panel.regimes:
            names = [point.method for point in panel.of(regime)]
            assert len(set(names)) == len(names) > 1
        assert all(math.isfinite(point.error) and point.error >= 0 for point in panel.points)
        assert not any(name.startswith("LAMMPS") for name in (point.method for point in panel.points))
    if methods:
        assert {point.method for point in panels[0].points} == {method.name for method in methods}


# --- kernels


def test_the_gradient_is_that_of_the_field() -> None:
    x_nc, step = np.random.default_rng(1).uniform(0, 16, (50, 2)), 1e-4
    for axis in (0, 1):
        ahead = kernels.field(x_nc + step * np.eye(2)[axis]) - kernels.field(x_nc - step * np.eye(2)[axis])
        # Central differences: step^2/6 of a third derivative, which is at most k^3; and rounding over the step.
        bound = kernels.K**3 * step**2 / 6 + 4 * np.finfo(float).eps / step
        assert np.abs(ahead / (2 * step) - kernels.gradient(x_nc)[:, :, axis]).max() < bound


@pytest.mark.lammps
def test_both_engines_have_the_same_gradients(lmp: Any) -> None:
    with ExitStack() as stack:
        runs = kernels.run(kernels.gradients((2.0, 3.0), 0.2, 16), lmp, stack)
    for name in (name for name in runs if not name.startswith("LAMMPS")):
        theirs_n = runs[f"LAMMPS {name}"].value_n
        # Sums of fewer than 40 terms of size k, each with a few roundings; the corrections' matrix loses some digits.
        assert np.abs(runs[name].value_n - theirs_n).max() < 1e-10 * kernels.K, name
    other = runs["RK1, cutoff 2"].value_n - runs["RK1, cutoff 3"].value_n
    assert np.abs(other).max() > 1e-3 * kernels.K


def test_corrected_gradients_are_more_accurate_where_particles_are_disordered() -> None:
    with ExitStack() as stack:
        runs = kernels.run(kernels.gradients((3.0,), 0.3, 32), None, stack)
    true_n = kernels.gradient(prepared("quintic", 3.0, 0.3, 32).atoms.x_nc)
    off = {name.split(",")[0]: relative(run.value_n - true_n, true_n) for name, run in runs.items()}
    assert off["RK2"] < off["RK1"] < off["quintic"] == off["RK0"]


def test_density_of_a_deformed_fluid_is_that_of_its_cells() -> None:
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


def test_continuity_follows_a_deformation_that_a_sum_smooths() -> None:
    found = {}
    for way, rho_sum in (("continuity", False), ("summation", True)):
        made = kernels.deformed("RK1", 2.5, 0.0, 32, rho_sum)
        sim = made.simulation(())
        sim.run(kernels.STEPS, 1.0 / kernels.STEPS)
        true_n = kernels.exact_density(made.atoms.x_nc)
        found[way] = relative(sim.output("rho") - true_n, true_n - 1)
    assert found["continuity"] < found["summation"] < 0.5
    assert relative(np.ones(len(true_n)) - true_n, true_n - 1) == 1.0  # no change at all


def test_maps_have_a_value_for_every_cutoff_and_disorder(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernels, "QUICK_EDGE", 16)
    found = {made.id: made for made in kernels.maps(True)}
    for made in found.values():
        assert np.array(made.value).shape == (len(made.y), len(made.x))
    quintic, rk1 = (np.array(found[f"kernels-{name}"].value) for name in ("quintic", "rk1"))
    assert (rk1[-1] < quintic[-1]).all() and (quintic[-1] > quintic[0]).all()


# --- lists with a skin


@pytest.mark.usefixtures("untimed")
def test_a_list_held_too_long_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    sound = searches._rebuild_points("fast", 0.3, 20, True)
    assert [point.error for point in sound] == [0.0] * len(searches.SKINS)
    monkeypatch.setattr("eos_ref.compiled.neighbours.Neighbours.holds", lambda self, x_nc: self.built > 0)
    stale = searches._rebuild_points("fast", 0.3, 20, True)
    fluid, dt = searches.fluid(0.3, 0.0, 20)
    fluid.run(searches.LEAST_STEPS, dt)
    # Without a new list even the one to compare with is wrong, but by other pairs.
    assert max(point.error for point in stale) > 0


def test_the_number_of_lists_falls_with_the_skin() -> None:
    rates = [searches._ran(0.3, skin, 20, 60)[1] for skin in searches.SKINS]
    assert rates == sorted(rates, reverse=True) and rates[0] == 1.0 and rates[-1] < 0.5


def test_a_crossing_is_found_where_times_cross(monkeypatch: pytest.MonkeyPatch) -> None:
    """Times of 100 + n and 2 n, but for 1 % of noise, cross at 100 particles."""
    methods = search_methods.METHODS[:2]
    costs = {methods[0].name: lambda n: 100.0 + n, methods[1].name: lambda n: 2.0 * n}

    def timed(calls: Mapping[str, Any], rounds: int = 9, at_least: float = 0.02) -> dict[str, Timing]:
        random = np.random.default_rng(3)
        size = len(next(iter(calls.values())).args[0])
        noise = {name: 1 + random.uniform(-0.01, 0.01, rounds) for name in calls}
        return {name: Timing(tuple(costs[name](size) * noise[name]), 1, 1.0) for name in calls}

    monkeypatch.setattr(measure, "in_turns", timed)
    monkeypatch.setattr(searches, "METHODS", methods)
    (crossing,) = searches._crossings((4, 8, 40), quick=True)
    assert crossing.methods == (methods[1].name, methods[0].name)
    assert crossing.at.low <= 100 <= crossing.at.high and crossing.at.high < 400


# --- time step


def shear() -> timestep.Wave:
    return timestep.waves()[0]


def test_the_time_step_is_of_first_order_for_viscosity() -> None:
    solved = timestep.solve(shear(), 16, timestep.FRACTIONS, 1 / 16, [None] * 5)
    found = timestep.order(solved)
    assert abs(found.order - 1) < 0.1 and found.standard_error < 0.05
    assert [s.temporal for s in solved] == sorted((s.temporal for s in solved), reverse=True)


@pytest.mark.lammps
def test_both_engines_become_unstable_at_the_same_step(lmp: Any) -> None:
    ours, theirs = (timestep.stability(FLOWS["shear-wave"], 16, who) for who in (None, lmp))
    assert ours.low < ours.high < timestep.CLOSE * 1.001 * ours.low
    assert ours == theirs  # the same bisection, so the same ends
    assert not timestep._grows(FLOWS["shear-wave"], 16, ours.low, None)
    assert timestep._grows(FLOWS["shear-wave"], 16, ours.high, None)


@pytest.mark.lammps
def test_stepping_by_hand_is_stepping_at_once(lmp: Any) -> None:
    start = timestep.started(FLOWS["sound-wave-linear"], 16, 1.0)
    for who in (None, lmp):
        shots = timestep.shots(timestep.stepping(start, who), start.steps)
        assert [round(shot.time / start.timestep) for shot in shots] == list(start.steps)
        at_once = timestep.stepping(start, who)
        at_once.advance(start.steps[-1])
        assert np.array_equal(at_once.snapshot().rho_n, shots[-1].rho_n)


# --- threads


@pytest.mark.usefixtures("untimed")
def test_threads_of_the_model_are_charted_once_it_has_them(monkeypatch: pytest.MonkeyPatch) -> None:
    class Threaded(evaluator.CompiledEvaluator):
        """Wrong with two threads."""

        def __init__(self, *arguments: Any, threads: int = 1, **more: Any) -> None:
            super().__init__(*arguments, **more)
            self.off = 1.0 + 1e-3 * (threads - 1)

        def pair_terms(self, *arguments: Any, **more: Any) -> Any:
            terms = super().pair_terms(*arguments, **more)
            return replace(terms, force_nc=self.off * terms.force_nc)

    monkeypatch.setattr(evaluator, "CompiledEvaluator", Threaded)
    monkeypatch.setattr(threads, "QUICK_EDGES", (16,))
    law, model = threads.panels(True)
    assert [point.error for point in law.points] == [0.0] * len(law.points)
    assert [point.method for point in model.points] == ["1 thread", "2 threads"]
    assert model.points[1].error == rounded(1e-3, 4, terms=1.0)


@pytest.mark.usefixtures("untimed")
def test_steps_that_are_timed_are_not_taken_for_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a method that is called more often the particles have moved further."""
    untimed = measure.in_turns

    def twice(calls: Mapping[str, Call], *effort: Any) -> Any:
        calls["2 threads"]()
        return untimed(calls, *effort)

    monkeypatch.setattr(measure, "in_turns", twice)
    monkeypatch.setattr(threads, "QUICK_EDGES", (16,))
    one = evaluator.CompiledEvaluator
    monkeypatch.setattr(evaluator, "CompiledEvaluator", lambda *given, threads=1, **more: one(*given, **more))
    assert threads._model_threads(True).points[1].error == 0.0
