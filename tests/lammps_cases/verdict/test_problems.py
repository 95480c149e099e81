"""The reference's problem of a scene: effects of its stops on the state; it is built only once."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eos_ref.evaluation.time_step import Simulation
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.problem import Problem
from lammps_cases.comparison.trajectory import visit
from lammps_cases.run import prepared_case
from lammps_cases.run.prepared_case import PreparedCase
from lammps_cases.scene import casefile
from lammps_cases.verdict.problems import problem_of

Write = Callable[..., Path]
TWO = [{"mass": 1.31, "rho0": 1.2, "cs": 3.1}] * 2


@pytest.fixture
def made(case_file: Write) -> Callable[..., tuple[PreparedCase, Problem]]:
    """Make the problem of twenty particles that go through stops."""

    def make(*stops: dict[str, Any], **changes: Any) -> tuple[PreparedCase, Problem]:
        run = {"steps": 9, "timestep": 0.004, "stops": list(stops)}
        path = case_file(types=TWO, **{"compare": ["f", "v"], "evolve": run} | changes)
        ready = prepared_case.prepare(casefile.load((path,))[0])
        return ready, problem_of(ready.case.scene, ready.atoms, "", (0, 9))

    return make


@pytest.mark.parametrize(
    ("by", "read_back", "digits", "new", "minimized"),
    [
        ("run", False, None, 0, False),
        ("restart", True, None, 0, False),
        ("other scene", True, None, 0, False),
        ("data", True, 16, 20, False),
        ("data nofix", True, 16, 20, False),
        ("redefined", False, None, 20, False),
        ("recreated", False, None, 5, False),
        ("minimize", False, None, 0, True),
        ("set", False, None, 0, False),
    ],
)
def test_state_at_a_stop_follows_its_route(
    made: Callable[..., Any], by: str, read_back: bool, digits: int | None, new: int, minimized: bool
) -> None:
    _, problem = made({"at": 4, "by": by})
    (stop,) = problem.stops
    assert (stop.step, stop.read_back, stop.digits, stop.minimized) == (4, read_back, digits, minimized)
    assert stop.new_n.tolist() == [False] * (20 - new) + [True] * new, "those of the highest ids"
    assert stop.timestep is stop.by_nc is stop.box is None


def test_continued_run_changes_its_time_step_at_the_next_step(made: Callable[..., Any]) -> None:
    _, problem = made({"at": 4, "by": "continued", "timestep": 0.001}, {"at": 6, "by": "dt/reset", "timestep": 0.004})
    assert [(stop.continued, stop.timestep) for stop in problem.stops] == [(True, 0.001), (False, 0.004)]
    began: list[int] = []

    class Counted(Simulation):
        taken = 0

        def setup(self) -> None:
            began.append(self.taken)
            super().setup()

        def step(self, dt: float) -> None:
            self.taken += 1
            super().step(dt)

    list(visit(problem.simulation(stepping=Counted), (0, 9), problem.timestep, problem.stops))
    assert began == [0, 6], "before the first step, and at the stop by dt/reset"


def test_stop_changes_time_step_positions_and_box(made: Callable[..., Any]) -> None:
    """The second stretch applies to the stretched box; one of its edges stays unchanged."""
    ready, problem = made(
        {"at": 2, "timestep": 0.001, "displace": {"x": 0.1, "y": -0.2, "types": "2"}},
        {"at": 4, "stretch": {"x": 1.5}},
        {"at": 6, "stretch": {"x": 0.5, "y": 2.0}},
    )
    first, second, third = problem.stops
    assert (first.timestep, second.timestep, first.box) == (0.001, None, None)
    np.testing.assert_array_equal(first.by_nc, [[0.1, -0.2] if of == 2 else [0.0, 0.0] for of in ready.atoms.type_n])
    low_c, high_c = (np.array(end_c) for end_c in (problem.box.low_c, problem.box.high_c))
    edge_c = high_c - low_c
    assert second.box.high_c == (low_c[0] + 1.5 * edge_c[0], high_c[1])
    assert third.box.high_c == (low_c[0] + 0.5 * (second.box.high_c[0] - low_c[0]), low_c[1] + 2.0 * edge_c[1])
    assert second.box.low_c == third.box.low_c == problem.box.low_c
    assert second.by_nc is None


def test_scene_without_runs_has_no_time_step_and_no_stops(made: Callable[..., Any]) -> None:
    _, problem = made(evolve=None)
    assert (problem.timestep, problem.stops, problem.ranks, problem.fields) == (0.0, (), 1, ("f", "v"))
    assert made()[1].timestep == 0.004
    assert made(engine={"ranks": 2})[1].ranks == 2


def test_problem_is_built_once_for_the_same_steps(made: Callable[..., Any]) -> None:
    ready, _ = made()
    scene, atoms, predictor = ready.case.scene, ready.atoms, Predictor()
    one, other, again = (problem_of(scene, atoms, "", steps, predictor) for steps in ((0,), (0, 9), (0,)))
    assert again is one and (one.steps, other.steps) == ((0,), (0, 9))
