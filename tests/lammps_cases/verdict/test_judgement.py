"""Verdicts on answers made by hand: what is compared, what is blamed first, how a case ends without numbers."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eos_ref import EOS, EOSTable
from eos_ref.model.box import Box
from lammps_cases import findings
from lammps_cases.comparison import compare
from lammps_cases.comparison.compare import EosState, compare_field
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.problem import Problem
from lammps_cases.comparison.trajectory import Prediction
from lammps_cases.engine.session import Answer
from lammps_cases.engine.workers import Failure
from lammps_cases.findings import LEDGER
from lammps_cases.findings.variants import Variant
from lammps_cases.records.case_parts import (
    Blame,
    DigitsLost,
    LawRecord,
    LostAtoms,
    OtherSteps,
    Predictions,
    StepRecord,
    digest,
)
from lammps_cases.records.progress import taken
from lammps_cases.records.run_record import CaseRecord, EngineRecord
from lammps_cases.run import prepared_case
from lammps_cases.run.prepared_case import PreparedCase
from lammps_cases.scene import casefile
from lammps_cases.scene.atoms import seed
from lammps_cases.scene.settings import Evolve
from lammps_cases.verdict import outcome
from lammps_cases.verdict.case_arrays import asks_for_lists, read_snapshots
from lammps_cases.verdict.cases import compare_case, first_step
from lammps_cases.verdict.mistakes import undetected_in_model
from lammps_cases.verdict.model_fields import derived, over_steps, sides
from lammps_cases.verdict.outcome import blank_record, explain_ending, finish
from lammps_cases.verdict.problems import problem_of
from tests.support import made_answers
from tests.support.made_findings import finding
from tests.support.roundings import rounded

Write = Callable[..., Path]
ENGINE = EngineRecord(name="pypi:2099.1.1", distribution="2099.1.1")  # for which the ledger has no finding
KNOWN = "2025.7.22.4.0"
GAS: dict[str, Any] = {
    "pressure": [{"types": "*", "style": "ideal/gas", "gamma": 1.4}],
    "energy": {"range": [0.5, 2.5]},
}
RUN = {"steps": 2, "timestep": 0.001, "compare_at": [0, 1, 2]}
MODEL = {"compare": ["coordination", "f"], "velocity": {"random": 0.3}}
REFUSED = {"violate": "missing-argument", "expect": {"refused": "Invalid range"}}


def prepared(file: Path) -> PreparedCase:
    (case,) = casefile.load((file,))
    return prepared_case.prepare(case)


def pressure(ready: PreparedCase, rho_n: Any = None, cs: float | None = None) -> Any:
    """Return the reference's pressure, optionally at other densities or with another speed of sound."""
    atoms = ready.atoms
    assert ready.eos is not None and atoms.rho_n is not None
    table = ready.eos if cs is None else EOSTable(tuple(replace(law, cs=cs) for law in ready.eos.laws))
    rho_n = atoms.rho_n if rho_n is None else rho_n
    return compare.evaluate(table, EosState(atoms.id_n, atoms.type_n, rho_n, atoms.mass_n, atoms.energy_n))


def answer_of(ready: PreparedCase) -> Answer:
    """Return the reference's output as an answer of LAMMPS."""
    if ready.case.scene.whole_model:
        return made_answers.of_model(ready.case.scene, ready.atoms)
    p_n = pressure(ready)
    return Answer(made_answers.given(ready.atoms) | {"pressure": p_n, "q.pressure": p_n.copy()}, made_answers.SECONDS)


def judged(ready: PreparedCase, outcome: Answer | Failure) -> CaseRecord:
    return compare_case(ready.case, ready.eos, ready.atoms, outcome, ENGINE)[0]


def changed(answer: Answer, **arrays: Any) -> Answer:
    return replace(answer, arrays=answer.arrays | {name.replace("__", "."): made for name, made in arrays.items()})


def with_pressure(answer: Answer, p_n: Any) -> Answer:
    return changed(answer, pressure=p_n, q__pressure=p_n)


def blamed(record: CaseRecord) -> tuple[Any, ...]:
    assert record.verdict == "differs" and record.blame is not None
    return record.blame.field, record.blame.stage, record.blame.atom


@pytest.fixture
def law(case_file: Write) -> PreparedCase:
    return prepared(case_file())


@pytest.fixture
def model(case_file: Write) -> PreparedCase:
    return prepared(case_file(**MODEL, evolve=RUN))


# --- before and after a run


@pytest.mark.parametrize("shipped", [False, True])
def test_blank_record_describes_the_case(case_file: Write, shipped: bool) -> None:
    run = {"compare": ["f"], "evolve": {"steps": 7, "timestep": 0.001}, "twin": {"newton": False}, "units": "si"}
    path = case_file(**run, types=[{"mass": 1.5, "rho0": 1.2, "cs": 3.1}, {"mass": 0.5, "rho0": 1.1, "cs": 2.5}])
    ready = prepared(path)
    case = replace(ready.case, tags=("one", "two"), shipped=shipped)
    table = EOSTable([EOS("linear", 1.2, 3.1), EOS("cubic", 1.1, 2.5, 0.3, 0.7)])
    file = [] if shipped else ["--cases", str(path)]
    assert blank_record(case, table, ready.atoms, ENGINE) == CaseRecord(
        case="mine",
        tags=["one", "two"],
        about="A scene of the tests.",
        verdict="skipped",
        ended="skipped",
        natoms=20,
        steps=7,
        dimension=2,
        units="si",
        twin="newton",
        laws=[
            LawRecord(type=1, style="linear", rho0=1.2, cs=3.1, mass=1.5),
            LawRecord(type=2, style="cubic", rho0=1.1, cs=2.5, parameter=0.3, background=0.7, mass=0.5),
        ],
        seed=seed("mine"),
        source=path.name if shipped else str(path),
        reproduce=" ".join(["eos-ref run", *file, "--engine pypi:2099.1.1 mine"]),
    )


def test_finished_record_has_message_times_and_prediction_counts() -> None:
    blame = Blame(field="f", stage="pair", step=3, atom=7, lammps=2.0, reference=1.0, bound=0.5, outside=1, of=9)
    record = CaseRecord(case="one", verdict="differs", blame=blame)
    begin = time.perf_counter() - 100.0
    finish(record, 2.5, begin, Predictor(computed=3, stored=4))
    assert record.message.startswith("f (stage pair) leaves its bound at step 3")
    assert 100.0 <= record.seconds.reference <= time.perf_counter() - begin
    assert (record.seconds.lammps, record.seconds.total) == (2.5, 2.5 + record.seconds.reference)
    assert record.predictions == Predictions(computed=3, stored=4)


# --- a law alone


def test_references_own_numbers_are_exact_and_saved_with_the_atoms(law: PreparedCase) -> None:
    answer, atoms = answer_of(law), law.atoms
    record, arrays = compare_case(law.case, law.eos, atoms, answer, ENGINE)
    assert (record.verdict, record.ended, record.blame, record.message) == ("exact", "answered", None, "")
    fields = {field.field: field for field in record.fields}
    stages = {"type": "input", "rho": "input", "pressure_used": "eos", "pressure": "eos"}
    assert {name: field.stage for name, field in fields.items()} == stages
    assert record.seconds.lammps == made_answers.SECONDS
    assert fields["pressure_used"].digits_lost == DigitsLost(), "only output can lose digits"
    assert fields["pressure"].digits_lost.reference is not None
    assert fields["type"].derivation == fields["rho"].derivation == "the same doubles"
    names = [f"{name}.{side}" for name in stages for side in ("lammps", "reference", "bound")]
    assert list(arrays) == ["id", "type", "x", "v", "rho", "mass", "box", "periodic", *names]
    assert all(arrays[name] is answer.arrays[name] for name in ("id", "type", "x", "v", "rho"))
    np.testing.assert_array_equal(arrays["box"], [atoms.low_c, atoms.high_c])
    np.testing.assert_array_equal(arrays["type.reference"], atoms.type_n)
    np.testing.assert_array_equal(arrays["rho.bound"], np.zeros(len(atoms)))


@pytest.mark.parametrize(("key", "field"), [("pressure", "pressure_used"), ("q.pressure", "pressure")])
def test_wrong_pressure_is_blamed_on_its_first_atom(law: PreparedCase, key: str, field: str) -> None:
    """The one that forces used, or the output alone."""
    answer = answer_of(law)
    p_n = answer.arrays[key].copy()
    p_n[[4, 7]] += 1.0
    record, arrays = compare_case(law.case, law.eos, law.atoms, changed(answer, **{key: p_n}), ENGINE)
    assert blamed(record) == (field, "eos", 5) and record.blame is not None
    assert (record.blame.outside, record.blame.of) == (2, len(law.atoms))
    assert (record.blame.type, record.blame.rho) == (law.atoms.type_n[4], law.atoms.rho_n[4])
    assert (record.blame.lammps, record.blame.reference) == (p_n[4], p_n[4] - 1.0) and record.blame.bound < 1.0
    np.testing.assert_array_equal(arrays[f"{field}.lammps"], p_n)


def test_law_is_evaluated_at_the_density_that_lammps_holds(law: PreparedCase) -> None:
    """A density other than the given one is blamed first, not the pressure that follows from it, nor a wrong one."""
    answer = answer_of(law)
    rho_n = answer.arrays["rho"].copy()
    rho_n[9] = np.nextafter(rho_n[9], 9.0)
    p_n = pressure(law, rho_n)
    record = judged(law, with_pressure(changed(answer, rho=rho_n), p_n))
    assert blamed(record) == ("rho", "input", 10)
    assert {field.field: field.verdict for field in record.fields}["pressure"] == "exact"
    p_n[2] += 1.0
    assert blamed(judged(law, with_pressure(changed(answer, rho=rho_n), p_n))) == ("rho", "input", 10)


def test_gas_is_judged_by_the_energy_that_lammps_holds(case_file: Write) -> None:
    ready = prepared(case_file(**GAS))
    answer = answer_of(ready)
    record, arrays = compare_case(ready.case, ready.eos, ready.atoms, answer, ENGINE)
    assert [(field.field, field.verdict) for field in record.fields] == [
        (name, "exact") for name in ("type", "rho", "esph", "pressure_used", "pressure")
    ]
    np.testing.assert_array_equal(arrays["e"], ready.atoms.energy_n / ready.atoms.mass_n)
    doubled = changed(answer, esph=2 * answer.arrays["esph"], pressure=2 * answer.arrays["pressure"])
    assert [field.verdict for field in judged(ready, doubled).fields] == ["exact"] * 2 + ["differs", "exact", "differs"]


@pytest.mark.parametrize(
    ("pattern", "cs", "verdict"), [("mi*", 1.0, "explained"), ("other", 1.0, "differs"), ("mine", 2.0, "differs")]
)
def test_wrong_pressure_is_explained_by_a_finding_with_that_law(
    law: PreparedCase, monkeypatch: pytest.MonkeyPatch, pattern: str, cs: float, verdict: str
) -> None:
    """The finding covers the case, and its law agrees with LAMMPS on every atom; no real finding does so today."""
    made = finding("a-law", law=lambda table, state: pressure(law, cs=cs), applies_to=(pattern,))
    monkeypatch.setattr(findings, "LEDGER", (replace(LEDGER[0], applies_to=("mine",)), made))
    wrong_n = pressure(law, cs=1.0)
    record = judged(law, with_pressure(answer_of(law), wrong_n))
    explained_by = ["a-law"] if verdict == "explained" else []
    assert record.verdict == verdict and record.blame is not None
    assert (record.blame.field, record.blame.atom, record.blame.outside) == ("pressure_used", 1, len(law.atoms))
    assert [field.explained_by for field in record.fields] == [[], [], explained_by, explained_by]
    wrong_n[-1] *= 2  # an atom that the finding does not explain
    assert judged(law, with_pressure(answer_of(law), wrong_n)).verdict == "differs"


@pytest.mark.parametrize(("off", "explained"), [(1.0, True), (1.5, False)])
def test_pressure_within_the_bound_of_a_finding_is_explained(
    law: PreparedCase, monkeypatch: pytest.MonkeyPatch, off: float, explained: bool
) -> None:
    nowhere = finding("nowhere", law=lambda table, state: np.zeros(2), applies_to=("mine",))
    monkeypatch.setattr(findings, "LEDGER", (nowhere,))
    comparison = compare_field("p", "eos", np.arange(2), np.array([0.0, off]), np.full(2, 7.0), np.ones(2))
    assert (findings.explain_pressure("mine", law.eos, None, comparison) is nowhere) == explained


@pytest.mark.parametrize(("cells", "seen"), [([5, 4], True), ([50, 79], True), ([50, 80], False)])
def test_lint_examines_up_to_two_thousand_states(case_file: Write, cells: list[int], seen: bool) -> None:
    """Of 4000 it takes every second one; a mistake that only the others show counts as undetected."""
    positions = {"lattice": "sq", "spacing": 0.8, "cells": cells}
    ready = prepared(case_file(positions=positions, pressure=[{"types": "*", "style": "linear"}]))
    rho_n = np.full(len(ready.atoms), 1.2)
    rho_n[3] = 1.3
    ready = replace(ready, atoms=replace(ready.atoms, rho_n=rho_n))
    assert ("cs ignored" in judged(ready, answer_of(ready)).lint) == (not seen)


@pytest.mark.parametrize(("mass", "lint"), [(1.0, ["energy not per unit mass"]), (1.31, [])])
def test_lint_depends_on_energies_and_masses(case_file: Write, mass: float, lint: list[str]) -> None:
    """Only for unit masses does it not matter whether the energy is per mass."""
    ready = prepared(case_file(**GAS, types=[{"mass": mass, "rho0": 1.2, "cs": 3.1}]))
    assert judged(ready, answer_of(ready)).lint == lint


ONE_STEP = {"timestep": 0.001, "compare_at": [0, 1], "steps": 1}


@pytest.mark.parametrize(
    ("changes", "given"),
    [
        ({}, ["type", "rho"]),
        ({"evolve": {"steps": 1, "timestep": 0.001}}, ["type"]),
        ({"rheo": {"interface_reconstruct": True}}, ["type"]),
        (MODEL | {"evolve": ONE_STEP}, ["type", "rho"]),
        (MODEL | {"evolve": ONE_STEP | {"compare_at": [1]}}, ["type"]),
        (MODEL | {"evolve": ONE_STEP, "rheo": {"interface_reconstruct": True}}, ["type"]),
        (MODEL | {"evolve": ONE_STEP, "rheo": {"rho_sum": True}, "rho": None}, ["type"]),
        (MODEL | {"evolve": ONE_STEP, "energy": {"range": [0.5, 2.5]}}, ["type", "rho", "esph"]),
        (MODEL | {"evolve": ONE_STEP | {"compare_at": [1]}, "energy": {"range": [0.5, 2.5]}}, ["type"]),
        (MODEL | {"evolve": ONE_STEP | {"stops": [{"at": 0, "by": "restart"}]}}, ["type", "rho"]),
        (MODEL | {"evolve": ONE_STEP | {"stops": [{"at": 0, "by": "data"}]}}, ["type"]),  # text lacks some digits
        (MODEL | {"evolve": ONE_STEP | {"stops": [{"at": 1, "by": "data"}]}}, ["type", "rho"]),
    ],
)
def test_input_is_compared_with_the_given_one_unless_it_changes_first(
    case_file: Write, changes: dict[str, Any], given: list[str]
) -> None:
    ready = prepared(case_file(**changes))
    record = judged(ready, answer_of(ready))
    assert (record.verdict, record.ended) == ("exact", "answered")
    stops = changes.get("evolve", {}).get("stops", ())
    carried = [f"rho ({stop['by']} at {stop['at']})" for stop in stops]
    model = "compare" in changes
    names = [f"{name} (given)" if model else name for name in given]
    assert [field.field for field in record.fields if field.stage == "input"] == names + carried
    assert {field.derivation for field in record.fields if field.field in names} == {"the same doubles"}
    assert not model or [field.field for field in record.fields][-2:] == MODEL["compare"]


# --- the particle model


def spoilt(answer: Answer, *changes: tuple[int, str, int, float]) -> Answer:
    """Return an answer with values changed: the snapshot, the array, the row, and by how much."""
    snapshots = [dict(arrays) for arrays in answer.snapshots]
    for at, name, row, by in changes:
        snapshots[at][name] = snapshots[at][name].astype(float)
        snapshots[at][name].reshape(len(snapshots[at][name]), -1)[row, -1 if name != "f" else 1] += by
    return replace(answer, snapshots=tuple(snapshots))


def test_model_record_has_steps_lint_bounds_and_absent_findings(model: PreparedCase) -> None:
    engine = EngineRecord(distribution=KNOWN)
    taken()
    record, arrays = compare_case(model.case, model.eos, model.atoms, answer_of(model), engine)
    assert set(taken()) == {"reference", "bounds", "variants", "digits", "mistakes", "rest"}
    assert (record.verdict, record.blame) == ("exact", None)
    assert {row.step for field in record.fields for row in field.steps} == {0, 1, 2}
    assert record.unseen == ["force-per-volume"], "this LAMMPS computes the force that the manual gives"
    problem = problem_of(model.case.scene, model.atoms, "", (0, 1, 2))
    prediction = Predictor().predict(problem, seed=seed("mine/moved runs"))
    assert record.lint == undetected_in_model(problem, prediction) != []
    force = next(field for field in record.fields if field.field == "f")
    at = next(k for k, row in enumerate(force.steps) if row.step == force.worst_step)
    np.testing.assert_array_equal(arrays["f.bound"], np.broadcast_to(prediction.bounds[at]["f"], (20, 2)))
    assert record.predictions.computed > 0 and record.laws[0].style == "tait/general"
    assert [force.derivation for force in record.fields[-2:]] == [derived(0)] * 2


def test_first_step_is_blamed_not_the_worst(model: PreparedCase) -> None:
    record = judged(model, spoilt(answer_of(model), (1, "f", 4, 1e-3), (2, "f", 5, 1e3)))
    assert blamed(record)[::2] == ("f", 5) and record.blame is not None and record.blame.step == 1
    (force,) = [field for field in record.fields if field.field == "f"]
    assert (force.verdict, force.worst_step, force.worst_id) == ("differs", 2, 6)
    assert [row.verdict for row in force.steps] == ["exact", "differs", "differs"]


def test_first_field_of_a_step_is_blamed(model: PreparedCase) -> None:
    """Neighbours are counted before forces are summed, whichever atom is wrong."""
    record = judged(model, spoilt(answer_of(model), (0, "q.coordination", 8, 1.0), (0, "f", 0, 1.0)))
    assert blamed(record) == ("coordination", "neighbours", 9)


def test_bound_has_a_derivation_in_words() -> None:
    one = "4 x 2^-53 per operation, carried through the formulas; a sum by its absolute terms"
    assert derived(0) == one
    assert derived(3) == f"{one}; plus the spread of runs moved by that in every one of 3 steps"


def test_positions_are_compared_at_the_image_of_the_reference() -> None:
    """LAMMPS wraps positions outside a periodic box; along an open axis a shift by the edge is a difference."""
    box = Box((0.0, 0.0), (4.0, 3.0), (True, False))
    problem = Problem(SimpleNamespace(deform=None), box, None, 0.0, ("x", "v"), (0,))
    theirs_nc = np.array([[0.5, 1.0], [3.5, 1.0], [1.0, 0.5]])
    ours_nc = np.array([[4.5, 1.0], [-4.5, 1.0], [1.0, 3.5]])
    for name, placed_nc in (("x", [[4.5, 1.0], [-4.5, 1.0], [1.0, 0.5]]), ("v", theirs_nc)):
        prediction = Prediction(({name: ours_nc},), ({name: 0.25},))
        for got, right in zip(
            sides(problem, name, {name: theirs_nc}, prediction, 0),
            (placed_nc, ours_nc, np.full((3, 2), 0.25)),
            strict=True,
        ):
            np.testing.assert_array_equal(got, right)


def test_field_record_has_its_worst_step_and_all_rows() -> None:
    moved = {0: 0.0, 2: 0.5, 5: 0.25}
    at = {
        step: compare_field("f", "pair", np.arange(1, 4), np.array([0.0, by, 0.0]), np.zeros(3), np.ones(3))
        for step, by in moved.items()
    }
    records = [comparison.record for comparison in at.values()]
    worst = over_steps(list(at.values()), list(at))
    assert worst.lammps_n is at[2].lammps_n
    rows = [
        StepRecord(step=step, verdict=of.verdict, max_abs=by, max_over_bound=by, worst_id=of.worst_id, digest=of.digest)
        for (step, by), of in zip(moved.items(), records, strict=True)
    ]
    whole = {"steps": rows, "worst_step": 2, "digest": digest(*(of.digest for of in records))}
    assert worst.record == records[1].model_copy(update=whole)
    assert [(row.verdict, row.worst_id) for row in rows] == [("exact", 1), ("pass", 2), ("pass", 2)]
    with pytest.raises(ValueError, match="zip"):
        over_steps(list(at.values()), [0, 2])
    records[2].verdict, records[2].explained_by = "explained", ["a-finding"]
    explained = over_steps(list(at.values()), list(at)).record
    assert (explained.verdict, explained.explained_by, explained.worst_step) == ("explained", ["a-finding"], 2)


# --- an answer read at every step, and LAMMPS' neighbour lists


def test_first_step_outside_is_found_if_every_step_is_read(model: PreparedCase) -> None:
    others, every_other = (KNOWN, Predictor()), Evolve(steps=2, timestep=0.001, compare_at=(0, 2))
    few = replace(model.case, scene=model.case.scene.model_copy(update={"evolve": every_other}))
    answer = answer_of(model)
    assert first_step(few, model.atoms, answer, *others) is None
    found = first_step(few, model.atoms, spoilt(answer, (1, "f", 0, 1.0), (2, "f", 0, 1.0)), *others)
    assert found is not None and found.beyond is not None
    assert (found.beyond.findings, found.beyond.known) == ([], ["force-per-volume"]), "known, and of no help"
    assert (found.first.field, found.first.step, found.first.atom, found.first.of) == ("f", 1, 1, 20)
    assert found.first.lammps == rounded(found.first.reference + 1.0, 1)


def test_snapshots_are_at_requested_steps_and_the_first_has_lists(model: PreparedCase) -> None:
    scene, answer = model.case.scene, answer_of(model)
    every, last = read_snapshots(scene, answer), read_snapshots(scene, answer, (2,))
    assert [list(snapshot) for snapshot in every] == [["coordination", "f"]] * 3
    assert every[0]["f"].shape == (20, 2) and len(last) == 1
    np.testing.assert_array_equal(last[0]["f"], every[2]["f"])
    ids = answer.arrays | {"id": np.array([3, 5, 9])}
    listed = {"id_s": np.array([9, 3]), "own_s": [], "pair_ps": [], "rank_s": [], "low_rc": [], "newton": []}
    lists = tuple(listed | {"x_sc": n} for n in range(2))
    first, *others = read_snapshots(scene, replace(answer, arrays=ids, lists=lists))
    assert [(one.row_s.tolist(), one.x_sc) for one in first["lists"]] == [([2, 0], 0), ([2, 0], 1)]
    assert not any("lists" in snapshot for snapshot in others)


@pytest.mark.parametrize(("lists", "applies"), [(True, True), (True, False), (False, True)])
def test_lists_are_requested_if_a_finding_depends_on_them(
    model: PreparedCase, monkeypatch: pytest.MonkeyPatch, lists: bool, applies: bool
) -> None:
    def of_the_scene(problem: Problem) -> bool:
        return applies and problem.fields == model.case.scene.compare and problem.steps == (0, 1, 2)

    monkeypatch.setattr(findings, "LEDGER", (LEDGER[0], finding("a", model=Variant(of_the_scene, lists=lists))))
    assert asks_for_lists(model.case, model.case.scene, model.atoms) == (lists and applies)


# --- no numbers


@pytest.mark.parametrize(
    ("ids", "first"),
    [
        (lambda id_n: id_n[id_n != 7], 7),
        (lambda id_n: np.append(id_n, 99), 99),
        (lambda id_n: np.sort(np.append(id_n, 4)), 4),
        (lambda id_n: id_n[:0], 1),
        (lambda id_n: np.r_[id_n[1], id_n[0], id_n[2:]], 2),
    ],
    ids=["missing", "foreign", "doubled", "none", "exchanged"],
)
def test_lost_atoms_end_the_comparison(law: PreparedCase, ids: Callable[[Any], Any], first: int) -> None:
    id_n = ids(law.atoms.id_n)
    record = judged(law, changed(answer_of(law), id=id_n))
    assert (record.verdict, record.ended, record.fields) == ("differs", "unusable", [])
    assert record.unusable == LostAtoms(returned=len(id_n), given=len(law.atoms), first_id=first)
    assert f"LAMMPS returned {len(id_n)} of {len(law.atoms)} atoms" in record.message


@pytest.mark.parametrize("where", ["first", "before", "after"])
def test_atoms_lost_before_the_end_are_reported(case_file: Write, where: str) -> None:
    ready = prepared(case_file(compare=["f"], evolve=RUN | {"stops": [{"at": 1, "by": "run"}]}))
    answer = made_answers.of_model(ready.case.scene, ready.atoms)
    fewer: dict[str, Any] = {name: array[1:] for name, array in answer.snapshots[0].items()}
    if where == "first":
        answer = replace(answer, snapshots=(fewer, *answer.snapshots[1:]))
    else:
        answer = replace(answer, carried=(replace(answer.carried[0], **{where: fewer}),))
    record = judged(ready, answer)
    assert (record.verdict, record.unusable) == ("differs", LostAtoms(returned=19, given=20, first_id=1))


def test_answers_at_other_steps_are_not_compared(model: PreparedCase) -> None:
    record = judged(model, replace(answer_of(model), steps=(0, 1, 3)))
    assert (record.verdict, record.ended, record.fields) == ("differs", "unusable", [])
    assert record.unusable == OtherSteps(counted=[0, 1, 3], asked=[0, 1, 2])


@pytest.mark.parametrize("verdict", ["refused", "crashed", "timeout", "error"])
def test_failure_is_the_verdict_with_the_engines_message(law: PreparedCase, verdict: Any) -> None:
    record = judged(law, Failure(verdict, "ERROR: some\n  words"))
    assert (record.verdict, record.ended, record.engine_error) == (verdict, verdict, "ERROR: some words")


@pytest.mark.parametrize(
    ("words", "verdict"),
    [("Invalid range", "refused"), ("Out of memory", "differs"), ("Illegal fix command, cubic", "differs")],
)
def test_refusal_must_contain_the_expected_words(case_file: Write, words: str, verdict: str) -> None:
    ready = prepared(case_file(**REFUSED))
    blank = blank_record(ready.case, ready.eos, ready.atoms, ENGINE)
    assert (blank.expects, blank.laws, blank.steps, blank.twin) == ("Invalid range", [], 0, "")
    record = judged(ready, Failure("refused", f"ERROR: {words} string"))
    assert (record.verdict, record.ended, record.lacks) == (verdict, "refused", "")
    assert record.as_expected == (verdict == "refused")


def test_answer_instead_of_a_refusal_differs(case_file: Write, law: PreparedCase) -> None:
    record = judged(prepared(case_file(**REFUSED)), answer_of(law))
    assert (record.verdict, record.ended, record.expects) == ("differs", "accepted", "Invalid range")


@pytest.mark.parametrize(
    ("ended", "words", "expects", "predicted", "verdict"),
    [
        ("crashed", "SIGSEGV", "", True, "explained"),
        ("refused", "any", "", True, "explained"),
        ("refused", "other words", "Invalid range", True, "explained"),
        ("refused", "Invalid range string", "Invalid range", True, "refused"),
        ("crashed", "Invalid range string", "Invalid range", True, "explained"),
        ("skipped", "not in this build", "", True, "skipped"),  # it has no ending
        ("skipped", "not in this build", "Invalid range", True, "skipped"),
        ("crashed", "SIGSEGV", "", False, "crashed"),
    ],
)
def test_unexpected_ending_may_be_explained_by_a_finding_that_predicts_it(
    monkeypatch: pytest.MonkeyPatch, ended: Any, words: str, expects: str, predicted: bool, verdict: str
) -> None:
    monkeypatch.setattr(outcome, "explain_outcome", lambda record, *scene: LEDGER[0] if predicted else None)
    record = CaseRecord(case="a.case", verdict="skipped", ended="skipped", expects=expects)
    outcome.record_failure(record, Failure(ended, words))
    explained_by = [LEDGER[0].id] if verdict == "explained" else []
    assert (record.verdict, record.ended, record.explained_by) == (verdict, ended, explained_by)


@pytest.mark.parametrize(
    ("compare", "ended", "words", "explained_by"),
    [
        (["stress/t"], "crashed", "SIGSEGV", ["stress-without-pressure-segfault"]),
        (["stress/t", "pressure"], "crashed", "SIGSEGV", []),
        (["stress/t"], "crashed", "SIGFPE", []),
        (["stress/t"], "refused", "SIGSEGV", []),
    ],
)
def test_scene_predicts_an_ending(
    case_file: Write, compare: list[str], ended: Any, words: str, explained_by: list[str]
) -> None:
    """The finding does not cover another verdict, such as that of a refusal in other words."""
    ready = prepared(case_file(compare=compare))
    record, arrays = compare_case(ready.case, ready.eos, ready.atoms, Failure(ended, words), ENGINE)
    assert (record.explained_by, record.ended, arrays) == (explained_by, ended, {})
    assert record.verdict == ("explained" if explained_by else ended)
    other = CaseRecord(case="any", verdict="differs", ended="crashed", engine_error="SIGSEGV")
    explain_ending(other, ready.case.scene)
    assert other.verdict == "differs"


@pytest.mark.parametrize(
    ("error", "lacks"),
    [
        ("ERROR: Unrecognized fix style 'rheo/thermal' (src/modify.cpp:929)\nLast input line: fix 1", "rheo/thermal"),
        ("ERROR: Illegal fix rheo command: self/mass (src/RHEO/fix_rheo.cpp:181)", "self/mass"),
        ("ERROR: Illegal fix command, cubic (src/RHEO/fix_rheo_pressure.cpp:123)", "cubic"),
        ("ERROR: Unknown kernel style RK2 in fix rheo (src/RHEO/fix_rheo.cpp:113)", "RK2"),
        ("ERROR: Unknown fix rheo/thermal keyword: react (src/RHEO/fix_rheo_thermal.cpp:201)", "react"),
        ("ERROR: Illegal surface/detection option in fix rheo, divergence (src/RHEO/fix_rheo.cpp:154)", "divergence"),
        ("ERROR: Illegal pair_style command, harmonic/means (src/RHEO/pair_rheo.cpp:445)", "harmonic/means"),
        ("ERROR: Invalid keyword surface/r for atom style rheo in compute rheo/property/atom command", "surface/r"),
        ("ERROR: Unrecognized set or fix set command keyword rheo/rho (src/set.cpp:410)", "rheo/rho"),
        ("ERROR: Illegal fix rheo command: missing argument(s) (src/RHEO/fix_rheo.cpp:181)", ""),
        ("ERROR: Illegal fix rheo command: 0.9", ""),
        ("ERROR: Unknown command: no_such_command (src/input.cpp:408)", ""),
        ("ERROR: Lost atoms: original 20 current 19 (src/thermo.cpp:494)", ""),
    ],
)
def test_word_that_lammps_lacks_is_not_a_difference(law: PreparedCase, error: str, lacks: str) -> None:
    record = judged(law, Failure("refused", error))
    assert (record.verdict, record.lacks) == ("skipped" if lacks else "refused", lacks)
    assert (record.message == f"this LAMMPS has no {lacks!r}") == bool(lacks)


def test_ending_is_explained_by_case_kind_and_message() -> None:
    style = CaseRecord(
        case="refused.unknown-style", verdict="differs", ended="refused", engine_error="ERROR: Illegal fix command, *"
    )
    assert findings.explain_outcome(style) is not None
    for other in ({"ended": "accepted"}, {"engine_error": "ERROR: Illegal fix command"}, {"case": "refused.other"}):
        assert findings.explain_outcome(style.model_copy(update=other)) is None
