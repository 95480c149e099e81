"""The harness must be able to fail for the particle model: a shipped case detects every planted mistake."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from eos_ref.evaluation import array_evaluator, time_step
from eos_ref.kernels.kernel import Kernel
from eos_ref.kernels.quintic import QUINTIC
from eos_ref.model import interactions, per_atom
from eos_ref.model.parameters import Model
from lammps_cases.engine.session import Answer
from lammps_cases.findings.forces import ForcePerVolume
from lammps_cases.records.run_record import CaseRecord, EngineRecord
from lammps_cases.run import flow, prepared_case
from lammps_cases.run import prepared_case as of_lammps
from lammps_cases.scene import casefile
from tests.support.outcome import Solver

pytestmark = pytest.mark.lammps

ENGINE = EngineRecord(distribution="2025.7.22.4.0")
CASES = {case.name: case for case in casefile.load()}
Judge = Callable[[str], CaseRecord]


@pytest.fixture(scope="module")
def answers(solver: Solver) -> Callable[[str], tuple[prepared_case.PreparedCase, Answer]]:
    """Return LAMMPS' answer to a case, computed once."""
    known: dict[str, tuple[prepared_case.PreparedCase, Answer]] = {}

    def answer(name: str) -> tuple[prepared_case.PreparedCase, Answer]:
        if name not in known:
            ready = prepared_case.prepare(CASES[name])
            known[name] = ready, solver(ready.jobs[0])
        return known[name]

    return answer


@pytest.fixture
def judge(
    answers: Callable[[str], tuple[prepared_case.PreparedCase, Answer]], solver: Solver, monkeypatch: pytest.MonkeyPatch
) -> Judge:
    monkeypatch.setattr(of_lammps, "solve", lambda site, job: solver(job))

    def of(name: str) -> CaseRecord:
        ready, answer = answers(name)
        return flow.judge(None, ready, [answer], ENGINE)[0]

    return of


def _times(function: Callable[..., Any], factor: float) -> Callable[..., Any]:
    return lambda *arguments: function(*arguments) * factor


def _kernel(**wrong: Any) -> property:
    return property(lambda model: replace(QUINTIC, **wrong))


def _no_floor(self: array_evaluator.ArrayEvaluator, rho_n: Any) -> Any:
    return rho_n


def _late_gradients(self: time_step.Simulation) -> Any:
    return self.gradient


FORCES, WALLS = "forces.all.quintic.2d", "walls.reconstructed.plain"
# fault: (object, attribute, wrong replacement, case that must detect it)
FAULTS: dict[str, tuple[Any, str, Any, str]] = {
    "kernel off by 1e-9": (Model, "kernel", _kernel(shape=_times(QUINTIC.shape, 1 + 1e-9)), "density.one.2d"),
    "slope off by 1e-9": (Model, "kernel", _kernel(slope=_times(QUINTIC.slope, 1 + 1e-9)), FORCES),
    "2D normalisation in 3D": (
        Model,
        "kernel",
        _kernel(factor=lambda d, h: 7 / (478 * np.pi * h * h)),
        "density.one.3d",
    ),
    "self term left out": (Kernel, "self_value", lambda self, d, cut: 0.0, "density.one.2d"),
    "sign of the pressure force": (interactions, "pressure_term", lambda vi, vj, p: vi * vj * p, FORCES),
    "viscosity halved": (
        interactions,
        "viscous_term",
        _times(interactions.viscous_term, 0.5),
        "forces.viscous.quintic.2d",
    ),
    "arithmetic for harmonic": (
        interactions,
        "harmonic_mean",
        interactions.arithmetic_mean,
        "forces.harmonic.quintic.2d",
    ),
    "harmonic for arithmetic": (
        interactions,
        "arithmetic_mean",
        interactions.harmonic_mean,
        "forces.viscous.quintic.2d",
    ),
    "softening of artificial viscosity": (interactions, "VISCOUS_SOFTENING", 0.0, "forces.artificial.quintic.2d"),
    "damping of the other sign": (interactions, "diffusion_term", _times(interactions.diffusion_term, -1), FORCES),
    "heat of the other sign": (interactions, "heat_term", _times(interactions.heat_term, -1), "thermal.arithmetic.2d"),
    "interface half as far": (
        interactions,
        "interface_distance",
        lambda chi, cut: cut * (chi - 0.45),
        WALLS,
    ),
    "no repulsion": (interactions, "REPULSION_CHI", 2.0, "walls.reconstructed.penetrated"),
    "shift weight": (interactions, "shift_weight", lambda w, w_h: 1 + 0.2 * (w / w_h) ** 3, "shift.all.2d"),
    "softening of normals": (interactions, "NORMAL_SOFTENING", 1e-8, "surfaces.coordination.periodic"),
    "strain without factor 2": (per_atom, "strain_rate", _times(per_atom.strain_rate, 0.5**0.5), "strain.bingham.2d"),
    "no latent heat": (
        per_atom,
        "temperature",
        lambda e, cv, latent, freezes, T_freeze: e / cv,
        "thermal.latent.2d",
    ),
    "stress of the other sign": (
        per_atom,
        "stress",
        lambda G, eta, p=None: [[-eta * g for g in row] for row in G],
        FORCES,
    ),
    "wall density without floor": (array_evaluator.ArrayEvaluator, "apparent_density", _no_floor, WALLS),
    "gradients of the last evaluation": (time_step.Simulation, "_half_step_gradients", _late_gradients, FORCES),
    "forces of walls kept": (time_step.Simulation, "keep_forces", lambda self: None, "walls.reconstructed.gravity"),
}


@pytest.mark.parametrize("case", sorted({fault[3] for fault in FAULTS.values()} & set(CASES)))
def test_without_a_fault_nothing_is_red(case: str, judge: Judge) -> None:
    assert judge(case).as_expected


@pytest.mark.parametrize("fault", FAULTS)
def test_planted_fault_turns_a_case_red(fault: str, judge: Judge, monkeypatch: pytest.MonkeyPatch) -> None:
    where, name, wrong, case = FAULTS[fault]
    monkeypatch.setattr(where, name, wrong)
    record = judge(case)
    assert record.verdict == "differs", f"{case} does not see: {fault}"
    assert "leaves its bound at step" in record.message


def test_blame_names_the_first_step_stage_and_atom(judge: Judge, monkeypatch: pytest.MonkeyPatch) -> None:
    right = time_step.Simulation.step

    def disturbed(self: time_step.Simulation, dt: float) -> None:
        right(self, dt)
        self.taken = getattr(self, "taken", 0) + 1  # type: ignore[attr-defined]
        if self.taken == 4:  # type: ignore[attr-defined]
            self.state.v_nc[7, 1] += 1e-7

    # The reference reproduces LAMMPS' known fault, so that nothing else is red.
    monkeypatch.setattr(array_evaluator.ArrayEvaluator, "collecting_volume", ForcePerVolume.collecting_volume)
    assert judge(FORCES).verdict == "pass"
    monkeypatch.setattr(time_step.Simulation, "step", disturbed)
    record = judge(FORCES)  # compared at steps 0, 1 and 10
    assert record.verdict == "differs"
    assert record.message.startswith("v (stage integration) leaves its bound at step 4 at 1 of 80 atoms, first atom 8:")


@pytest.mark.parametrize(
    ("where", "name", "wrong"),
    [
        (array_evaluator.ArrayEvaluator, "wall_density", _times(array_evaluator.ArrayEvaluator.wall_density, 1 + 1e-9)),
        (time_step.Simulation, "keep_forces", lambda self: None),
    ],
)
def test_densities_of_walls_are_blamed_on_walls(
    where: Any, name: str, wrong: Any, judge: Judge, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The blame is not on the gradients and forces that follow, nor on fields that a known finding changes."""
    monkeypatch.setattr(where, name, wrong)
    record = judge("walls.reconstructed.gravity")
    assert record.headline
    assert (record.headline.field, record.headline.stage) == ("rho_wall", "walls")
    assert record.message.startswith("rho_wall (stage walls) leaves its bound at step ")


@pytest.mark.parametrize("field", ["q.coordination", "q.grad/v", "q.viscosity", "pressure", "f", "drho", "x", "v"])
def test_one_wrong_number_of_lammps_is_detected(
    field: str,
    answers: Callable[[str], tuple[prepared_case.PreparedCase, Answer]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ready, answer = answers(FORCES)
    monkeypatch.setattr(array_evaluator.ArrayEvaluator, "collecting_volume", ForcePerVolume.collecting_volume)
    monkeypatch.setattr(flow, "first_step_outside", lambda *of: None)
    snapshots = [{name: values.copy() for name, values in arrays.items()} for arrays in answer.snapshots]
    snapshots[1][field][5] += 1e-9 if field != "q.coordination" else 1
    spoilt = Answer(snapshots[-1], answer.seconds, tuple(snapshots), answer.steps)
    record = flow.judge(None, ready, [spoilt], ENGINE)[0]
    assert record.verdict == "differs"
    name = {"pressure": "pressure_used"}.get(field, field.removeprefix("q."))
    assert [f.field for f in record.fields if f.verdict == "differs"] == [name]
    assert record.message.startswith(f"{name} (stage ")
    assert "leaves its bound at step 1 at 1 of 80 atoms, first atom 6:" in record.message


def test_lint_names_mistakes_hidden_by_unit_volumes(judge: Judge) -> None:
    blind = judge("fluids.unit").lint
    assert {"masses ignored", "no volume in the force", "V_i for V_j", "rho0 for rho in volumes"} <= set(blind)
    assert judge(FORCES).lint == []
    assert judge("walls.reconstructed.damped").lint == []
    assert judge("thermal.arithmetic.2d").lint == []


@pytest.mark.parametrize(
    ("case", "field", "spoil"),
    [
        ("zmin.some.rk1", "f", np.nan),  # some forces are not predictable there, the others are
        ("zmin.some.rk1", "q.grad/v", 1e300),
        ("zmin.every.rk1", "q.coordination", 1.0),
        ("images.quintic.two", "q.coordination", 1.0),
    ],
)
def test_unpredictable_values_hide_no_other_errors(
    case: str, field: str, spoil: float, answers: Callable[[str], tuple[prepared_case.PreparedCase, Answer]]
) -> None:
    ready, answer = answers(case)
    assert flow.judge(None, ready, [answer], ENGINE)[0].as_expected
    snapshots = [dict(arrays) for arrays in answer.snapshots]
    snapshots[-1][field] = snapshots[-1][field] + spoil
    spoilt = Answer(snapshots[-1], answer.seconds, tuple(snapshots), answer.steps)
    assert flow.judge(None, ready, [spoilt], ENGINE)[0].verdict == "differs"


def test_answer_at_other_steps_differs(answers: Callable[[str], tuple[prepared_case.PreparedCase, Answer]]) -> None:
    ready, answer = answers(FORCES)
    other = Answer(answer.arrays, answer.seconds, answer.snapshots, (0, 2, 10))
    record = flow.judge(None, ready, [other], ENGINE)[0]
    assert record.verdict == "differs"
    assert "LAMMPS counted steps (0, 2, 10)" in record.message


def test_finding_that_cannot_be_fitted_explains_nothing(
    answers: Callable[[str], tuple[prepared_case.PreparedCase, Answer]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Missing are the shift, which identifies the pair whose direction LAMMPS uses, and the list ended by that pair."""
    ready, answer = answers("cross-type.both.2d")
    fields = tuple(field for field in ready.case.scene.compare if field != "shift/v")
    scene = ready.case.scene.model_copy(update={"compare": fields})
    blind = replace(ready, case=replace(ready.case, scene=scene))
    assert flow.judge(None, blind, [answer], ENGINE)[0].verdict == "explained"
    monkeypatch.setattr(of_lammps.Answers, "with_lists", lambda self: [])
    assert flow.judge(None, blind, [answer], ENGINE)[0].verdict == "differs"
