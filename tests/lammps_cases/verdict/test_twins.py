"""LAMMPS against itself, on answers made by hand: allowed differences of the two runs, and their explanation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.problem import Problem
from lammps_cases.comparison.trajectory import Prediction
from lammps_cases.engine.session import Answer
from lammps_cases.engine.workers import Failure
from lammps_cases.findings.variants import Snapshot, combined
from lammps_cases.records.case_parts import Blame, LostAtoms
from lammps_cases.records.run_record import CaseRecord, EngineRecord
from lammps_cases.run import prepared_case
from lammps_cases.run.prepared_case import PreparedCase
from lammps_cases.scene import casefile
from lammps_cases.scene.atoms import seed
from lammps_cases.scene.fields import in_step_order
from lammps_cases.setup.twins import Twin
from lammps_cases.verdict import twins
from lammps_cases.verdict.model_fields import derived
from lammps_cases.verdict.particle_model import Explanation, Trial
from lammps_cases.verdict.problems import problem_of
from lammps_cases.verdict.twins import compare_twin
from tests.support import made_answers
from tests.support.twin_kinds import KINDS, PLAIN

ENGINE = EngineRecord(name="pypi:2025.7.22.4.0", distribution="2025.7.22.4.0")
SCENE: dict[str, Any] = {
    "compare": ["coordination", "f", "x", "v"],
    "velocity": {"random": 0.3},
    "evolve": {"steps": 2, "timestep": 0.001, "compare_at": [0, 2]},
}
Make = Callable[..., PreparedCase]


@pytest.fixture
def make(case_file: Callable[..., Path]) -> Make:
    """Return a small case with a twin."""

    def ready(kind: str, value: Any = None, **changes: Any) -> PreparedCase:
        twin = {kind: KINDS[kind] if value is None else value}
        return prepared_case.prepare(casefile.load((case_file(**SCENE | changes, twin=twin),))[0])

    return ready


def twin_of(ready: PreparedCase) -> Twin:
    assert ready.twin is not None
    return ready.twin


def answers_of(ready: PreparedCase, *findings: str) -> list[Answer]:
    return [made_answers.of_model(scene, atoms, *findings) for scene, atoms in ready.sides]


def judged(ready: PreparedCase, outcomes: Any) -> CaseRecord:
    return compare_twin(ready.case, twin_of(ready), outcomes, ENGINE)[0]


def moved(answer: Answer, name: str, by: float, row: int, at: int = -1) -> Answer:
    """Return an answer with one value changed at one of the steps read."""
    snapshots = [dict(arrays) for arrays in answer.snapshots]
    snapshots[at][name] = snapshots[at][name].copy()
    snapshots[at][name].reshape(len(snapshots[at][name]), -1)[row, 0] += by
    return replace(answer, arrays=snapshots[-1], snapshots=tuple(snapshots))


@pytest.mark.parametrize("kind", PLAIN)
def test_reference_agrees_with_its_twin(make: Make, kind: str) -> None:
    ready = make(kind)
    record, arrays = compare_twin(ready.case, twin_of(ready), answers_of(ready), ENGINE)
    assert record.verdict in ("exact", "pass") and (record.ended, record.blame, record.twin) == ("answered", None, kind)
    steps = [2] if kind == "split" else [0, 2]
    for field in record.fields:
        assert field.stage == "twin" and [row.step for row in field.steps] == steps
        own = derived(field.worst_step)
        assert field.derivation == f"LAMMPS against itself ({kind}): the bounds of both runs, added ({own})"
    assert [field.field for field in record.fields] == in_step_order(SCENE["compare"])
    assert record.seconds.lammps == 2 * made_answers.SECONDS
    assert record.laws[0].rho0 == 1.2 and record.reproduce.endswith("--engine pypi:2025.7.22.4.0 mine")
    assert arrays["rho"] is twin_of(ready).atoms.rho_n and "f.bound" in arrays
    assert record.predictions.computed == (1 if twin_of(ready).same_problem else 2 + twin_of(ready).rounds_input)


@settings(max_examples=3, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    power=st.sampled_from([-3, -1, 2, 5]),
    shift=st.tuples(st.floats(0.1, 9.0), st.floats(-9.0, 9.0)),
    boost=st.tuples(st.floats(0.1, 2.0), st.floats(-2.0, 2.0)),
)
def test_reference_agrees_with_twins_of_any_size_place_and_velocity(
    make: Make, power: int, shift: tuple[float, float], boost: tuple[float, float]
) -> None:
    for kind, value in (("rescale", 2.0**power), ("translate", list(shift)), ("boost", list(boost))):
        ready = make(kind, value)
        assert judged(ready, answers_of(ready)).verdict in ("exact", "pass"), (kind, value)


@pytest.mark.parametrize(("kind", "field"), [("rescale", "f"), ("translate", "x"), ("boost", "v"), ("units", "f")])
def test_bounds_of_both_runs_and_the_rounding_between_them_are_added(make: Make, kind: str, field: str) -> None:
    """In the frame and the units of the original: the scaled run's force is divided by 4^-1."""
    ready = make(kind)
    twin = twin_of(ready)
    ours, theirs = answers_of(ready)
    record, arrays = compare_twin(ready.case, twin, [moved(ours, field, 0.5, 6), theirs], ENGINE)
    assert {each.worst_step for each in record.fields if each.field == field} == {twin.steps[1]}
    problems = [problem_of(scene, atoms, "", twin.steps) for scene, atoms in ready.sides]
    seeds = [seed(f"{name}/moved runs") for name in ("mine", "mine/twin")]
    one, two = (Predictor().predict(problem, seed=s) for problem, s in zip(problems, seeds, strict=True))
    added = one.bounds[1][field] + twin.in_place(two.bounds[1])[field]
    if kind == "rescale":
        np.testing.assert_array_equal(added, one.bounds[1][field] + two.bounds[1][field] / twin.scale.of(field))
        earlier = one.bounds[0][field] + two.bounds[0][field] / twin.scale.of(field)
        np.testing.assert_array_equal(arrays[f"@0 bound {field}"], np.broadcast_to(earlier, (20, 2)))
    elif kind == "units":
        added = added + Predictor().input_spread(problems[0], one, seeds[0])[1][field]
    else:
        added = added + twin.rounding({field: arrays[f"{field}.reference"]}, twin.steps[1])[field]
    np.testing.assert_array_equal(arrays[f"{field}.bound"], np.broadcast_to(added, (20, 2)))


@pytest.mark.parametrize("kind", ["relabel", "boost", "newton"])
@pytest.mark.parametrize("side", [0, 1])
def test_difference_of_the_runs_is_blamed_on_the_original_atom(make: Make, kind: str, side: int) -> None:
    ready = make(kind)
    answers = answers_of(ready)
    row = 6 if side == 0 else int(twin_of(ready).row_n[6])
    answers[side] = moved(answers[side], "f", 0.5, row)
    record = judged(ready, answers)
    assert record.verdict == "differs" and record.blame is not None and not record.not_same_problem
    assert [field.field for field in record.fields if field.verdict == "differs"] == ["f"]
    assert (record.blame.field, record.blame.stage, record.blame.step, record.blame.atom) == ("f", "twin", 2, 7)
    apart = record.blame.lammps - record.blame.reference
    assert abs(apart - (0.5 if side == 0 else -0.5)) <= record.blame.bound
    assert record.message.startswith(f"LAMMPS against itself (twin: {kind}): f (stage twin) leaves its bound at step 2")


def test_runs_of_different_problems_are_reported_as_such(make: Make) -> None:
    ready = make("translate")
    twin = twin_of(ready)
    elsewhere = replace(twin.other_atoms, x_nc=twin.other_atoms.x_nc * [1.001, 1.0, 1.0])
    ready = replace(ready, twin=replace(twin, other_atoms=elsewhere))
    record = judged(ready, answers_of(ready))
    assert (record.verdict, record.not_same_problem) == ("differs", True)


def test_missing_bound_does_not_make_two_problems(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    """A field that differs is examined although the reference has no bound for another one."""
    predict = Predictor.predict

    def leaving_open(self: Predictor, *arguments: Any, **options: Any) -> Prediction:
        prediction = predict(self, *arguments, **options)
        open_ = tuple(bound | {"coordination": np.full(20, np.inf)} for bound in prediction.bounds)
        return replace(prediction, bounds=open_)

    ready = make("translate")
    answers = answers_of(ready)
    answers[0] = moved(answers[0], "f", 0.5, 6)
    monkeypatch.setattr(Predictor, "predict", leaving_open)
    record = judged(ready, answers)
    assert (record.verdict, record.not_same_problem) == ("differs", False)
    assert record.blame is not None and (record.blame.field, record.blame.step) == ("f", 2)


# --- findings


@pytest.mark.parametrize(
    ("has", "also", "explained_by"),
    [
        (["force-per-volume"], None, ["force-per-volume"]),  # a force per volume has another dimension
        ([], None, []),
        (["force-per-volume"], 0, []),
        (["force-per-volume"], 1, []),
        ([], 1, []),
    ],
)
def test_findings_that_reproduce_both_runs_explain_their_difference(
    make: Make, has: list[str], also: int | None, explained_by: list[str]
) -> None:
    ready = make("rescale")
    answers = answers_of(ready, *has)
    if also is not None:
        answers[also] = moved(answers[also], "f", 0.5, 6)
    record = judged(ready, answers)
    same = not has and also is None
    assert record.verdict in (("exact", "pass") if same else ("explained",) if explained_by else ("differs",))
    red = [field for field in record.fields if field.verdict in ("explained", "differs")]
    assert {name for field in red for name in field.explained_by} == set(explained_by)
    assert ("f" in [field.field for field in red]) == (not same)
    assert (record.blame is None) == same
    assert (record.beyond is not None) == (also is not None), "the unexplained difference of one run is reported"


def test_each_run_is_explained_by_its_own_engine_and_ranks(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    """The explanation starts from its own first difference."""
    explain, asked = Trial.explain, []

    def noted(trial: Trial, engine: str, first: Blame) -> Explanation:
        asked.append((trial.problem.ranks, engine, first.field, first.step))
        return explain(trial, engine, first)

    monkeypatch.setattr(Trial, "explain", noted)
    ready = make("ranks")
    ours, theirs = answers_of(ready, "force-per-volume")
    record = judged(ready, [ours, moved(theirs, "f", 0.5, 6)])
    assert asked == [(ranks, ENGINE.distribution, "f", 0) for ranks in (1, 2)]
    assert record.beyond is not None and record.beyond.findings == ["force-per-volume"]


def test_findings_are_fitted_to_each_run_separately(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    made = []

    def noted(variants: Any, problem: Problem, snapshot: Snapshot) -> Any:
        made.append((problem.box.edge_c[0], snapshot["f"][6, 0]))
        return combined(variants, problem, snapshot)

    monkeypatch.setattr(twins, "combined", noted)
    ready = make("rescale")
    answers = answers_of(ready, "force-per-volume")
    assert judged(ready, answers).verdict == "explained"
    edges = [atoms.high_c[0] - atoms.low_c[0] for _, atoms in ready.sides]
    assert made == [(edge, answer.snapshots[0]["f"][6, 0]) for edge, answer in zip(edges, answers, strict=True)]


def test_only_findings_that_distinguish_the_runs_are_named(make: Make) -> None:
    """Heat over a density is equally wrong in both runs, whose densities are the same; the force is not."""
    types = [{"mass": 1.31, "rho0": 1.2, "cs": 3.1, "conductivity": 0.7, "specific_heat": 1.5}]
    ready = make("rescale", types=types, energy={"range": [0.8, 1.9]}, compare=["f", "heatflow"], evolve=None)
    record = judged(ready, answers_of(ready, "force-per-volume", "heat-over-density"))
    explained_by = {field.field: field.explained_by for field in record.fields}
    assert (record.verdict, explained_by) == ("explained", {"f": ["force-per-volume"], "heatflow": []})


# --- no numbers


@pytest.mark.parametrize(
    ("ends", "verdict", "only_twin"),
    [
        ((None, "crashed"), "crashed", True),
        ((None, "skipped"), "skipped", False),  # its outcome is unknown
        (("crashed", None), "crashed", False),
        (("refused", "crashed"), "refused", False),
    ],
)
def test_run_without_an_answer_ends_the_comparison(
    make: Make, ends: tuple[Any, Any], verdict: str, only_twin: bool
) -> None:
    ready = make("newton")
    outcomes = [
        Failure(end, f"{end}: words") if end else answer for end, answer in zip(ends, answers_of(ready), strict=True)
    ]
    record, arrays = compare_twin(ready.case, twin_of(ready), outcomes, ENGINE)
    assert (record.verdict, record.ended, record.only_twin) == (verdict, verdict, only_twin)
    assert (record.fields, arrays, record.engine_error) == ([], {}, f"{verdict}: words")
    assert record.seconds.lammps == made_answers.SECONDS * ends.count(None)


def test_scene_predicts_an_ending_of_either_run(make: Make) -> None:
    ready = make("newton", compare=["stress/t"], evolve=None)
    record = judged(ready, [Failure("crashed", "SIGSEGV"), Failure("crashed", "SIGSEGV")])
    assert (record.verdict, record.explained_by) == ("explained", ["stress-without-pressure-segfault"])


@pytest.mark.parametrize("side", [0, 1])
def test_lost_atoms_of_either_run_end_the_comparison(make: Make, side: int) -> None:
    ready = make("newton")
    answers = answers_of(ready)
    ids = answers[side].arrays["id"]
    answers[side] = replace(answers[side], arrays=answers[side].arrays | {"id": ids[ids != 7]})
    record = judged(ready, answers)
    assert (record.verdict, record.ended, record.fields) == ("differs", "unusable", [])
    assert record.unusable == LostAtoms(returned=19, given=20, first_id=7)
