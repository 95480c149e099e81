"""Judgement of stops: state lost by a file or forgotten by a set-up is detected, and named."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from lammps_cases.comparison.predictor import Predictor
from lammps_cases.engine.session import Answer
from lammps_cases.engine.workers import Workers
from lammps_cases.records.run_record import CaseRecord, EngineRecord
from lammps_cases.run import prepared_case
from lammps_cases.run.prepared_case import PreparedCase
from lammps_cases.scene import Scene, casefile
from lammps_cases.scene.settings import Evolve
from lammps_cases.verdict.cases import compare_case
from tests.workshop.faults import input_faults

pytestmark = pytest.mark.lammps
ENGINE = EngineRecord(name="env", distribution="2025.7.22.4.0")
FILES, SETTINGS = "runs.summed.files", "runs.summed.settings"


@pytest.fixture(scope="module")
def judge() -> Any:
    """Run a case, with a fault if one is named, and judge it after a change of the answer."""
    predictor = Predictor()
    with Workers(None, 1) as workers:

        def judged(
            name: str, change: Callable[[Answer], Answer] = lambda a: a, fault: str = "", **scene: Any
        ) -> CaseRecord:
            (case,) = casefile.select(casefile.load(), [name])
            content = case.scene.model_dump(exclude_unset=True)
            case = replace(case, scene=Scene.model_validate(casefile.merge(content, scene)), exercises=())
            ready: PreparedCase = prepared_case.prepare(case)
            jobs = input_faults.jobs(input_faults.faults()[f"told.{fault}"], ready) if fault else ready.jobs
            assert jobs is not None
            answer = workers.outcome(workers.submit(jobs[0], 60.0))
            outcome = change(answer) if isinstance(answer, Answer) else answer
            return compare_case(case, ready.eos, ready.atoms, outcome, ENGINE, predictor)[0]

        yield judged


def carried(name: str, update: Callable[[Any], Any], at: int = 0) -> Callable[[Answer], Answer]:
    """Return a change of an array that was read right after a stop."""

    def change(answer: Answer) -> Answer:
        both = answer.carried[at]
        wrong = replace(both, after=both.after | {name: update(both.after[name])})
        return replace(answer, carried=(*answer.carried[:at], wrong, *answer.carried[at + 1 :]))

    return change


def outside(record: CaseRecord) -> list[str]:
    """Return the fields that differ."""
    return [field.field for field in record.fields if field.verdict == "differs"]


def test_state_in_files_is_compared_right_after_reading(judge: Any) -> None:
    right = judge(FILES)
    assert right.as_expected and not outside(right)
    exact = [field for field in right.fields if "restart at" in field.field or "data nofix at" in field.field]
    assert [field.field for field in exact if "at 1" in field.field] == [
        f"{name} (data nofix at 1)" for name in ("type", "x", "v", "rho", "rheo_status")
    ]
    assert all(field.stage == "input" for field in exact)


@pytest.mark.parametrize("at", [0, 2])
def test_loss_at_a_stop_takes_the_headline_from_known_findings(judge: Any, at: int) -> None:
    """A loss at step 0 precedes every finding; for later stops the findings of earlier steps are named as well."""
    record = judge(FILES, carried("v", lambda v: v * 1.5, at=at))
    assert "explained" in {field.verdict for field in record.fields}
    assert record.headline.field == f"v (restart at {at})" and record.headline.step == at
    assert record.message.startswith(f"v (restart at {at}) (stage input) leaves its bound at step {at}")
    assert record.message.endswith("in addition to force-per-volume") == bool(at)


@pytest.mark.parametrize(
    ("case", "fault", "first"),
    [
        (FILES, "restart-loses-rho", "rho (restart at 0)"),
        (FILES, "restart-loses-v", "v (restart at 0)"),
        (FILES, "between-no-timestep", "x"),
        (SETTINGS, "between-no-displacement", "x"),
        ("stretched.fluid.once", "between-no-stretch", "x"),
        ("stretched.fluid.once", "stretch-without-atoms", "x"),
        ("runs.stored.files", "restart-loses-status", "rheo_status (restart at 0)"),
        ("runs.thermal.files", "restart-loses-energy", "esph (given)"),
        ("runs-walls.fluid.anew", "between-no-forces", "x"),
    ],
)
def test_fault_between_runs_is_detected(judge: Any, case: str, fault: str, first: str) -> None:
    record = judge(case, fault=fault)
    assert record.verdict == "differs" and outside(record)[0] == first


EVERY = {"steps": 5, "every": 2, "compare_at": [5]}


@pytest.mark.parametrize("stop", [[], [{"at": 3, "by": "set"}]])
def test_pieces_of_a_run_begin_with_a_set_up(judge: Any, stop: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """`run N every M` does so; a difference appears if the reference treats the pieces as one run."""
    assert judge(SETTINGS, evolve=EVERY | {"stops": stop}).as_expected
    monkeypatch.setattr(Evolve, "beginnings", property(lambda evolve: evolve.stops))
    assert judge(SETTINGS, evolve=EVERY | {"stops": stop}).verdict == "differs"


def test_recreated_atoms_feel_the_same_forces(judge: Any) -> None:
    force = {"style": "addforce", "vector": [0.3, -0.2], "types": 1}
    record = judge(SETTINGS, forces=[force], evolve={"stops": [{"at": 1, "by": "recreated"}]})
    assert record.as_expected, record.message


def test_runs_without_a_new_set_up_end_early(judge: Any) -> None:
    """After a change of settings LAMMPS has no energy of the step; with recreated atoms its behaviour is undefined."""
    record = judge("runs.thermal.settings", fault="set-up-never-again")
    assert record.verdict == "refused" and "Energy was not tallied" in record.message


def test_lammps_own_count_is_compared_with_the_scene(judge: Any) -> None:
    record = judge(SETTINGS, fault="between-no-count")
    assert record.verdict == "differs" and record.ended == "unusable"
