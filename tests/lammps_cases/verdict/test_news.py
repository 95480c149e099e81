"""State that LAMMPS does not hold as given or loses at a stop: no finding explains it, whatever else differs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lammps_cases.comparison.predictor import Predictor
from lammps_cases.engine.interlude import Carried
from lammps_cases.engine.session import Answer
from lammps_cases.findings import LEDGER
from lammps_cases.records.case_parts import Beyond, Blame
from lammps_cases.records.run_record import CaseRecord, EngineRecord
from lammps_cases.run import prepared_case
from lammps_cases.run.prepared_case import PreparedCase
from lammps_cases.scene import casefile
from lammps_cases.verdict.cases import compare_case, first_step, prefer_input
from lammps_cases.verdict.particle_model import Reason
from tests.support import made_answers

Write = Callable[..., Path]
KNOWN = EngineRecord(distribution="2025.7.22.4.0")
FORCE = next(entry for entry in LEDGER if entry.id == "force-per-volume")
TEXT = [{"at": 1, "by": "data"}]


def at(step: int | None, field: str = "f") -> Blame:
    """Return a first difference at a step."""
    return Blame(field=field, stage="input", step=step, atom=7, lammps=2.0, reference=1.0, bound=0.5, outside=1, of=9)


def reason(step: int | None, left: int | None = None, explained: bool = False) -> Reason:
    """Return the reason for a difference from a step on, explained by a finding, or explained up to another step."""
    beyond = None if left is None else Beyond(findings=["one"], blame=at(left))
    return Reason(at(step), beyond, [FORCE] if explained else [])


@pytest.mark.parametrize(
    ("of", "step"),
    [
        (None, 3),
        (reason(3), 3),  # input precedes its consequences
        (reason(3), 2),
        (reason(0, left=0), None),
        (reason(None), 0),
        (reason(3, explained=True), 3),
        (reason(3, left=5), 1),
    ],
)
def test_input_outside_is_the_reason_unless_preceded(of: Reason | None, step: int | None) -> None:
    assert prefer_input(of, at(step, "x")) == Reason(at(step, "x"))


@pytest.mark.parametrize(
    ("of", "step"),
    [(reason(3), 4), (reason(0), 1), (reason(2, left=4), 5), (reason(0, left=0), 1), (reason(None, left=0), 1)],
)
def test_input_outside_after_a_new_difference_changes_nothing(of: Reason, step: int) -> None:
    assert prefer_input(of, at(step, "x")) is of


@pytest.mark.parametrize(
    ("of", "step", "beside"),
    [
        (reason(2, left=7), 5, ["one"]),
        (reason(2, left=5), 5, ["one"]),
        (reason(2, explained=True), 5, ["force-per-volume"]),
        (reason(2, left=7, explained=True), 5, ["one"]),
    ],
)
def test_input_outside_after_a_known_finding_is_new(of: Reason, step: int, beside: list[str]) -> None:
    assert prefer_input(of, at(step, "x")) == Reason(of.first, Beyond(findings=beside, blame=at(step, "x")))


def test_reason_stays_without_input_outside() -> None:
    of = reason(2)
    assert prefer_input(of, None) is of and prefer_input(None, None) is None


# --- whole cases


@pytest.fixture
def ready(case_file: Write) -> PreparedCase:
    """A fluid whose particles go through a text file at step 1."""
    evolve = {"steps": 2, "timestep": 0.001, "compare_at": [0, 1, 2], "stops": TEXT}
    path = case_file(compare=["coordination", "f"], velocity={"random": 0.3}, evolve=evolve)
    return prepared_case.prepare(casefile.load((path,))[0])


def answer(ready: PreparedCase, *findings: str, **after: Any) -> Answer:
    """Return an answer of LAMMPS with some findings, with positions outside the box, and arrays after the stop."""
    made = made_answers.of_model(ready.case.scene, ready.atoms, *findings)
    x_nc = ready.atoms.x_nc + np.array([3 * (ready.atoms.high_c[0] - ready.atoms.low_c[0]), 0, 0])
    before = {"x": x_nc, "rho": np.asarray(ready.atoms.rho_n)}
    return replace(made, carried=(Carried(before, {"x": ready.atoms.x_nc, "rho": before["rho"]} | after),))


def judged(ready: PreparedCase, given: Answer) -> CaseRecord:
    return compare_case(ready.case, ready.eos, ready.atoms, given, KNOWN)[0]


def test_positions_in_text_agree_with_any_image_to_its_digits(ready: PreparedCase) -> None:
    carried = {field.field: field for field in judged(ready, answer(ready)).fields if "at 1" in field.field}
    assert [(name, field.verdict) for name, field in carried.items()] == [
        ("x (data at 1)", "exact"),
        ("rho (data at 1)", "exact"),
    ]
    assert {field.derivation for field in carried.values()} == {"half a unit of the 16th digit of the text"}


def wrong(ready: PreparedCase) -> dict[str, Any]:
    """Return densities after a stop, one of them corrupted by the file."""
    rho_n = np.array(ready.atoms.rho_n)
    rho_n[4] *= 1.01
    return {"rho": rho_n}


def test_state_corrupted_at_a_stop_is_new_next_to_a_finding(ready: PreparedCase) -> None:
    record = judged(ready, answer(ready, FORCE.id, **wrong(ready)))
    assert record.blame is not None and record.beyond is not None
    assert (record.verdict, record.blame.field, record.blame.step) == ("differs", "f", 0)
    left = record.beyond.blame
    assert record.beyond.findings == [FORCE.id]
    assert (left.field, left.step, left.atom, left.stage) == ("rho (data at 1)", 1, 5, "input")


def test_state_corrupted_at_a_stop_is_blamed_alone(ready: PreparedCase) -> None:
    record = judged(ready, answer(ready, **wrong(ready)))
    assert record.blame is not None and record.beyond is None
    assert (record.blame.field, record.blame.step, record.blame.atom) == ("rho (data at 1)", 1, 5)


def test_state_not_held_as_given_is_blamed_at_the_first_step(ready: PreparedCase) -> None:
    made = answer(ready)
    held = made.snapshots[0] | {"rho": made.snapshots[0]["rho"] + (ready.atoms.id_n == 9)}
    record = judged(ready, replace(made, snapshots=(held, *made.snapshots[1:])))
    assert record.blame is not None
    assert (record.blame.field, record.blame.step, record.blame.atom) == ("rho (given)", 0, 9)


def test_difference_beyond_a_finding_is_reported_with_it(ready: PreparedCase) -> None:
    made = answer(ready, FORCE.id)
    last = dict(made.snapshots[2])
    last["f"] = last["f"] + [[0.0, 1.0, 0.0]]
    record = judged(ready, replace(made, snapshots=(*made.snapshots[:2], last)))
    assert record.blame is not None and record.beyond is not None
    assert (record.blame.step, record.beyond.findings, record.beyond.blame.step) == (0, [FORCE.id], 2)


def test_first_difference_may_be_a_stop_that_corrupts_state(ready: PreparedCase) -> None:
    others = KNOWN.distribution, Predictor()
    found = first_step(ready.case, ready.atoms, answer(ready, **wrong(ready)), *others)
    assert found is not None
    assert (found.first.field, found.first.step, found.first.atom) == ("rho (data at 1)", 1, 5)
    beside = first_step(ready.case, ready.atoms, answer(ready, FORCE.id, **wrong(ready)), *others)
    assert beside is not None and beside.beyond is not None
    assert (beside.first.field, beside.beyond.findings) == ("f", [FORCE.id])
    assert beside.beyond.blame.field == "rho (data at 1)"


@pytest.mark.parametrize(("version", "gone"), [("2025.7.22.1.0", True), ("2025.7.22.4.0", False)])
def test_absent_finding_is_one_that_this_version_had(case_file: Write, version: str, gone: bool) -> None:
    types = [{"mass": 1.31, "rho0": 1.2, "cs": 3.1, "conductivity": 0.7, "specific_heat": 1.5}]
    path = case_file(types=types, energy={"range": [0.8, 1.9]}, compare=["heatflow"])
    ready = prepared_case.prepare(casefile.load((path,))[0])
    made = made_answers.of_model(ready.case.scene, ready.atoms)
    record = compare_case(ready.case, ready.eos, ready.atoms, made, EngineRecord(distribution=version))[0]
    assert ("heat-over-density" in record.unseen) == gone
