"""The harness must be able to fail: against real LAMMPS, a case detects every change planted in the reference."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from eos_ref.evaluation import array_evaluator, time_step
from lammps_cases.comparison.changed import made
from lammps_cases.engine.session import Answer
from lammps_cases.findings.forces import ForcePerVolume
from lammps_cases.records.run_record import CaseRecord, EngineRecord
from lammps_cases.run import flow, prepared_case
from lammps_cases.scene import casefile
from lammps_cases.scene.changes import catalogue
from tests.support.outcome import Solver

pytestmark = pytest.mark.lammps

ENGINE = EngineRecord(distribution="2025.7.22.4.0")
CASES = {case.name: case for case in casefile.load()}
LAWS = [case.name for case in CASES.values() if {"quick", "eos"} <= set(case.tags) and case.scene.expect is None]
FORCES, WALLS = "forces.all.quintic.2d", "walls.reconstructed.plain"
IN_LAWS = [name for name, change in catalogue().items() if change.role == "mistake" and not change.shows]
IN_LAWS += ["water-of-one-trillionth", "cubic-of-square", "tait-without-rho0", "water-of-six"]
PLANTED = {  # and the case that must detect it
    "kernel-of-one-billionth": "density.one.2d",
    "slope-of-one-billionth": FORCES,
    "kernel-2d-for-3d": "density.one.3d",
    "sum-without-self": "density.one.2d",
    "pressure-force-sign": FORCES,
    "viscous-without-two": "forces.viscous.quintic.2d",
    "harmonic-as-arithmetic-by-half": "forces.harmonic.quintic.2d",
    "viscosity-always-harmonic": "forces.viscous.quintic.2d",
    "artificial-unsoftened": "forces.artificial.quintic.2d",
    "damp-sign": FORCES,
    "heat-sign": "thermal.arithmetic.2d",
    "interface-half": WALLS,
    "repulsion-never": "walls.reconstructed.penetrated",
    "shift-cube": "shift.all.2d",
    "normal-softening": "surfaces.coordination.periodic",
    "strain-half": "strain.bingham.2d",
    "latent-forgotten": "thermal.latent.2d",
    "stress-sign": FORCES,
    "wall-meets-thin": WALLS,
    "gradients-late": FORCES,
    "walls-old-forces": "walls.reconstructed.gravity",
}
Answered = Callable[[str], tuple[prepared_case.PreparedCase, Answer]]
Judge = Callable[[str], CaseRecord]


@pytest.fixture(scope="module")
def answers(solver: Solver) -> Answered:
    """Return LAMMPS' answer to a case, computed once."""
    known: dict[str, tuple[prepared_case.PreparedCase, Answer]] = {}

    def answer(name: str) -> tuple[prepared_case.PreparedCase, Answer]:
        if name not in known:
            ready = prepared_case.prepare(CASES[name])
            known[name] = ready, solver(ready.jobs[0])
        return known[name]

    return answer


@pytest.fixture
def judge(answers: Answered, solver: Solver, monkeypatch: pytest.MonkeyPatch) -> Judge:
    monkeypatch.setattr(prepared_case, "solve", lambda site, job: solver(job))

    def of(name: str) -> CaseRecord:
        ready, answer = answers(name)
        return flow.judge(None, ready, [answer], ENGINE)[0]

    return of


def without_force_per_volume(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the reference reproduce LAMMPS' known fault, so that nothing else is red."""
    right = ForcePerVolume.collecting_volume
    monkeypatch.setattr(array_evaluator.ArrayEvaluator, "collecting_volume", right)


# --- planted changes


@pytest.mark.parametrize("case", sorted(set(PLANTED.values())))
def test_nothing_is_red_without_a_change(case: str, judge: Judge) -> None:
    assert judge(case).as_expected


def test_no_law_is_red_without_a_change(judge: Judge) -> None:
    assert {judge(case).verdict for case in LAWS} == {"exact"}


@pytest.mark.parametrize("change", IN_LAWS)
def test_harness_sees_a_change_of_a_law(change: str, judge: Judge) -> None:
    with made(catalogue()[change]):
        red = next((record for record in map(judge, LAWS) if record.verdict == "differs"), None)
    assert red is not None, f"no quick case sees {change}"
    assert "(stage eos) leaves its bound at" in red.message and "first atom" in red.message


@pytest.mark.parametrize("change", PLANTED)
def test_harness_sees_a_change_of_the_model(change: str, judge: Judge) -> None:
    with made(catalogue()[change]):
        record = judge(PLANTED[change])
    assert record.verdict == "differs" and "leaves its bound at step" in record.message


# --- blame


def test_blame_names_the_first_step_stage_and_atom(judge: Judge, monkeypatch: pytest.MonkeyPatch) -> None:
    right = time_step.Simulation.step

    def disturbed(self: Any, dt: float) -> None:
        right(self, dt)
        self.taken = getattr(self, "taken", 0) + 1
        if self.taken == 4:
            self.state.v_nc[7, 1] += 1e-7

    without_force_per_volume(monkeypatch)
    assert judge(FORCES).verdict == "pass"
    monkeypatch.setattr(time_step.Simulation, "step", disturbed)
    record = judge(FORCES)  # compared at steps 0, 1 and 10
    assert record.verdict == "differs"
    assert record.message.startswith("v (stage integration) leaves its bound at step 4 at 1 of 80 atoms, first atom 8:")


@pytest.mark.parametrize("factor", [1 + 1e-9, None])
def test_densities_of_walls_are_blamed_on_walls(
    factor: float | None, judge: Judge, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The blame is not on the gradients and forces that follow, nor on fields that a known finding changes."""
    right = array_evaluator.ArrayEvaluator.wall_density
    if factor:
        monkeypatch.setattr(array_evaluator.ArrayEvaluator, "wall_density", lambda *given: right(*given) * factor)
    else:
        monkeypatch.setattr(time_step.Simulation, "keep_forces", lambda self: None)
    record = judge("walls.reconstructed.gravity")
    assert record.headline and (record.headline.field, record.headline.stage) == ("rho_wall", "walls")
    assert record.message.startswith("rho_wall (stage walls) leaves its bound at step ")


# --- numbers of LAMMPS


def spoilt(answer: Answer, at: int, field: str, by: Any) -> Answer:
    snapshots = [{name: values.copy() for name, values in arrays.items()} for arrays in answer.snapshots]
    snapshots[at][field] = snapshots[at][field] + by
    return Answer(snapshots[-1], answer.seconds, tuple(snapshots), answer.steps)


@pytest.mark.parametrize("field", ["q.coordination", "q.grad/v", "q.viscosity", "pressure", "f", "drho", "x", "v"])
def test_one_wrong_number_of_lammps_is_detected(field: str, answers: Answered, monkeypatch: pytest.MonkeyPatch) -> None:
    ready, answer = answers(FORCES)
    without_force_per_volume(monkeypatch)
    monkeypatch.setattr(flow, "first_step_outside", lambda *of: None)
    values = np.zeros_like(answer.snapshots[1][field], float)
    values[5] = 1e-9 if field != "q.coordination" else 1
    record = flow.judge(None, ready, [spoilt(answer, 1, field, values)], ENGINE)[0]
    name = {"pressure": "pressure_used"}.get(field, field.removeprefix("q."))
    assert [f.field for f in record.fields if f.verdict == "differs"] == [name]
    assert record.message.startswith(f"{name} (stage ")
    assert "leaves its bound at step 1 at 1 of 80 atoms, first atom 6:" in record.message


@pytest.mark.parametrize(
    ("case", "field", "by"),
    [
        ("zmin.some.rk1", "f", np.nan),  # some forces are not predictable there, the others are
        ("zmin.some.rk1", "q.grad/v", 1e300),
        ("zmin.every.rk1", "q.coordination", 1.0),
        ("images.quintic.two", "q.coordination", 1.0),
    ],
)
def test_unpredictable_values_hide_no_other_errors(case: str, field: str, by: float, answers: Answered) -> None:
    ready, answer = answers(case)
    assert flow.judge(None, ready, [answer], ENGINE)[0].as_expected
    assert flow.judge(None, ready, [spoilt(answer, -1, field, by)], ENGINE)[0].verdict == "differs"


def test_answer_at_other_steps_differs(answers: Answered) -> None:
    ready, answer = answers(FORCES)
    record = flow.judge(None, ready, [replace(answer, steps=(0, 2, 10))], ENGINE)[0]
    assert record.verdict == "differs" and "LAMMPS counted steps (0, 2, 10)" in record.message


def test_lint_names_mistakes_hidden_by_unit_volumes(judge: Judge) -> None:
    hidden = {"masses ignored", "no volume in the force", "V_i for V_j", "rho0 for rho in volumes"}
    assert hidden <= set(judge("fluids.unit").lint)
    assert all(judge(name).lint == [] for name in (FORCES, "walls.reconstructed.damped", "thermal.arithmetic.2d"))


def test_finding_that_cannot_be_fitted_explains_nothing(answers: Answered, monkeypatch: pytest.MonkeyPatch) -> None:
    """Missing are the shift, which identifies the pair whose direction LAMMPS uses, and the list ended by that pair."""
    ready, answer = answers("cross-type.both.2d")
    fields = tuple(field for field in ready.case.scene.compare if field != "shift/v")
    blind = replace(ready, case=replace(ready.case, scene=ready.case.scene.model_copy(update={"compare": fields})))
    assert flow.judge(None, blind, [answer], ENGINE)[0].verdict == "explained"
    monkeypatch.setattr(prepared_case.Answers, "with_lists", lambda self: [])
    assert flow.judge(None, blind, [answer], ENGINE)[0].verdict == "differs"
