"""Verdicts on answers made by hand: what is blamed first, and what is not compared."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

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
from lammps_cases.records.case_parts import DigitsLost, LostAtoms, OtherSteps, StepRecord, digest
from lammps_cases.records.run_record import CaseRecord, EngineRecord
from lammps_cases.run import prepared_case
from lammps_cases.run.prepared_case import PreparedCase
from lammps_cases.scene import casefile
from lammps_cases.scene.atoms import seed
from lammps_cases.scene.settings import Evolve
from lammps_cases.verdict import outcome
from lammps_cases.verdict.case_arrays import asks_for_lists, read_snapshots
from lammps_cases.verdict.cases import compare_case, first_step
from lammps_cases.verdict.mistakes import LAW_MUTANTS, undetected_in_model
from lammps_cases.verdict.model_fields import derived, over_steps, sides
from lammps_cases.verdict.problems import problem_of
from tests.support import made_answers
from tests.support.made_findings import finding
from tests.support.roundings import rounded

Write = Callable[..., Path]
ENGINE = EngineRecord(distribution="2099.1.1")  # for which the ledger has no finding
GAS: dict[str, Any] = {
    "pressure": [{"types": "*", "style": "ideal/gas", "gamma": 1.4}],
    "energy": {"range": [0.5, 2.5]},
}
LINEAR = [{"types": "*", "style": "linear"}]
POSITIONS = {"lattice": "sq", "spacing": 0.8}
EVERY_OTHER = Evolve(steps=2, timestep=0.001, compare_at=(0, 2))
SIDES = ("lammps", "reference", "bound")
MODEL = {"compare": ["coordination", "f"], "velocity": {"random": 0.3}}


def prepared(file: Path) -> PreparedCase:
    (case,) = casefile.load((file,))
    return prepared_case.prepare(case)


def state_of(ready: PreparedCase) -> EosState:
    atoms = ready.atoms
    assert atoms.rho_n is not None
    return EosState(atoms.id_n, atoms.type_n, atoms.rho_n, atoms.mass_n, atoms.energy_n)


def answer_of(ready: PreparedCase) -> Answer:
    """Return the reference's output as an answer of LAMMPS."""
    if ready.case.scene.whole_model:
        return made_answers.of_model(ready.case.scene, ready.atoms)
    assert ready.eos is not None
    p_n = compare.evaluate(ready.eos, state_of(ready))
    return Answer(made_answers.given(ready.atoms) | {"pressure": p_n, "q.pressure": p_n.copy()}, made_answers.SECONDS)


def judged(ready: PreparedCase, outcome: Answer | Failure) -> CaseRecord:
    return compare_case(ready.case, ready.eos, ready.atoms, outcome, ENGINE)[0]


def changed(answer: Answer, **arrays: Any) -> Answer:
    return replace(answer, arrays=answer.arrays | {name.replace("__", "."): made for name, made in arrays.items()})


@pytest.fixture
def law(case_file: Write) -> PreparedCase:
    return prepared(case_file())


@pytest.fixture
def model(case_file: Write) -> PreparedCase:
    return prepared(case_file(**MODEL, evolve={"steps": 2, "timestep": 0.001, "compare_at": [0, 1, 2]}))


# --- a law alone


def test_references_own_numbers_are_exact(law: PreparedCase) -> None:
    record = judged(law, answer_of(law))
    assert (record.verdict, record.ended, record.blame, record.message) == ("exact", "answered", None, "")
    assert [(field.field, field.stage) for field in record.fields] == [
        ("type", "input"),
        ("rho", "input"),
        ("pressure_used", "eos"),
        ("pressure", "eos"),
    ]
    assert record.seconds.lammps == 0.5


def test_wrong_pressure_is_blamed_on_its_first_atom(law: PreparedCase) -> None:
    answer = answer_of(law)
    p_n = answer.arrays["q.pressure"].copy()
    p_n[[4, 7]] += 1.0
    record = judged(law, changed(answer, q__pressure=p_n))
    assert record.verdict == "differs"
    blame, atoms = record.blame, law.atoms
    assert blame is not None and atoms.rho_n is not None
    assert (blame.field, blame.stage, blame.atom, blame.outside, blame.of) == ("pressure", "eos", 5, 2, len(atoms))
    assert (blame.type, blame.rho) == (atoms.type_n[4], atoms.rho_n[4])
    assert (blame.lammps, blame.reference) == (p_n[4], p_n[4] - 1.0)


def test_input_is_blamed_before_its_consequences(law: PreparedCase) -> None:
    """A density that LAMMPS does not hold as given, and therefore another pressure."""
    answer = answer_of(law)
    rho_n, p_n = answer.arrays["rho"].copy(), answer.arrays["pressure"].copy()
    rho_n[9] = np.nextafter(rho_n[9], 9.0)
    p_n[2] += 1.0
    record = judged(law, changed(answer, rho=rho_n, pressure=p_n, q__pressure=p_n))
    assert record.blame is not None
    assert (record.blame.field, record.blame.stage, record.blame.atom) == ("rho", "input", 10)


def test_gas_is_judged_by_the_energy_that_lammps_holds(case_file: Write) -> None:
    ready = prepared(case_file(**GAS))
    answer = answer_of(ready)
    record, arrays = compare_case(ready.case, ready.eos, ready.atoms, answer, ENGINE)
    assert [(field.field, field.verdict) for field in record.fields] == [
        (name, "exact") for name in ("type", "rho", "esph", "pressure_used", "pressure")
    ]
    np.testing.assert_array_equal(arrays["e"], state_of(ready).e_n)
    doubled = changed(answer, esph=2 * answer.arrays["esph"], pressure=2 * answer.arrays["pressure"])
    assert [field.verdict for field in judged(ready, doubled).fields] == ["exact"] * 2 + ["differs", "exact", "differs"]


def test_only_output_can_lose_digits(law: PreparedCase) -> None:
    fields = {field.field: field for field in judged(law, answer_of(law)).fields}
    assert fields["pressure_used"].digits_lost == DigitsLost()
    assert fields["pressure"].digits_lost.reference is not None
    assert fields["type"].derivation == fields["rho"].derivation == "the same doubles"


def test_both_sides_of_every_field_are_saved_with_the_atoms(law: PreparedCase) -> None:
    answer, atoms = answer_of(law), law.atoms
    wrong = changed(answer, q__pressure=answer.arrays["q.pressure"] + 1.0)
    _, arrays = compare_case(law.case, law.eos, atoms, wrong, ENGINE)
    fields = [f"{name}.{side}" for name in ("type", "rho", "pressure_used", "pressure") for side in SIDES]
    assert list(arrays) == ["id", "type", "x", "v", "rho", "mass", "box", "periodic", *fields]
    assert all(arrays[name] is answer.arrays[name] for name in ("id", "type", "x", "v", "rho"))
    np.testing.assert_array_equal(arrays["box"], [atoms.low_c, atoms.high_c])
    np.testing.assert_array_equal(arrays["pressure.lammps"], arrays["pressure.reference"] + 1.0)
    np.testing.assert_array_equal(arrays["type.reference"], atoms.type_n)
    np.testing.assert_array_equal(arrays["rho.bound"], np.zeros(len(atoms)))


@pytest.mark.parametrize(
    ("pattern", "variant", "verdict"),
    [("mi*", "cs ignored", "explained"), ("other", "cs ignored", "differs"), ("mine", "rho0 ignored", "differs")],
)
def test_wrong_pressure_is_explained_by_a_finding_with_that_law(
    law: PreparedCase, monkeypatch: pytest.MonkeyPatch, pattern: str, variant: str, verdict: str
) -> None:
    """The finding covers the case, and its law agrees with LAMMPS on every atom; no real finding does so today."""
    made = finding("a-law", law=LAW_MUTANTS[variant], applies_to=(pattern,))
    monkeypatch.setattr(findings, "LEDGER", (replace(LEDGER[0], applies_to=("mine",)), made))
    assert law.eos is not None
    wrong_n = LAW_MUTANTS["cs ignored"](law.eos, state_of(law))
    record = judged(law, changed(answer_of(law), pressure=wrong_n, q__pressure=wrong_n))
    explained_by = ["a-law"] if verdict == "explained" else []
    assert record.verdict == verdict and record.blame is not None
    assert (record.blame.field, record.blame.atom, record.blame.outside) == ("pressure_used", 1, len(law.atoms))
    assert [field.explained_by for field in record.fields] == [[], [], explained_by, explained_by]
    assert wrong_n is not None
    wrong_n[-1] *= 2  # an atom that the finding does not explain
    assert judged(law, changed(answer_of(law), pressure=wrong_n, q__pressure=wrong_n)).verdict == "differs"


@pytest.mark.parametrize(("off", "explained"), [(1.0, True), (1.5, False)])
def test_pressure_within_the_bound_of_a_finding_is_explained(
    law: PreparedCase, monkeypatch: pytest.MonkeyPatch, off: float, explained: bool
) -> None:
    nowhere = finding("nowhere", law=lambda table, state: np.zeros(2), applies_to=("mine",))
    monkeypatch.setattr(findings, "LEDGER", (nowhere,))
    comparison = compare_field("p", "eos", np.arange(2), np.array([0.0, off]), np.full(2, 7.0), np.ones(2))
    entry = findings.explain_pressure("mine", law.eos, state_of(law), comparison)
    assert (entry is nowhere) == explained


@pytest.mark.parametrize(("cells", "seen"), [([5, 4], True), ([50, 79], True), ([50, 80], False)])
def test_lint_examines_up_to_two_thousand_states(case_file: Write, cells: list[int], seen: bool) -> None:
    """Of 4000 it takes every second one; a mistake that only the others show counts as undetected."""
    ready = prepared(case_file(positions=POSITIONS | {"cells": cells}, pressure=LINEAR))
    rho_n = np.full(len(ready.atoms), 1.2)
    rho_n[3] = 1.3
    ready = replace(ready, atoms=replace(ready.atoms, rho_n=rho_n))
    assert ("cs ignored" in judged(ready, answer_of(ready)).lint) == (not seen)


def test_lint_depends_on_energies_and_masses(case_file: Write) -> None:
    """Only for unit masses does it not matter whether the energy is per mass."""
    lint = {
        mass: judged(ready, answer_of(ready)).lint
        for mass in (1.0, 1.31)
        for ready in [prepared(case_file(**GAS, types=[{"mass": mass, "rho0": 1.2, "cs": 3.1}]))]
    }
    assert lint == {1.0: ["energy not per unit mass"], 1.31: []}


@pytest.mark.parametrize(
    ("changes", "given"),
    [
        ({}, ["type", "rho"]),
        ({"evolve": {"steps": 1, "timestep": 0.001}}, ["type"]),
        ({"rheo": {"interface_reconstruct": True}}, ["type"]),
    ],
)
def test_only_unchanged_input_is_compared_with_the_given_one(
    case_file: Write, changes: dict[str, Any], given: list[str]
) -> None:
    ready = prepared(case_file(**changes))
    fields = judged(ready, answer_of(ready)).fields
    assert [field.field for field in fields if field.stage == "input"] == given


# --- the particle model


def test_references_own_run_passes_at_every_step(model: PreparedCase) -> None:
    record = judged(model, answer_of(model))
    assert (record.verdict, record.blame) == ("exact", None)
    assert {row.step for field in record.fields for row in field.steps} == {0, 1, 2}


def test_first_step_is_blamed_not_the_worst(model: PreparedCase) -> None:
    answer = answer_of(model)
    snapshots = [dict(arrays) for arrays in answer.snapshots]
    for step, size in ((1, 1e-3), (2, 1e3)):
        snapshots[step]["f"] = snapshots[step]["f"].copy()
        snapshots[step]["f"][3 + step, 1] += size
    record = judged(model, replace(answer, snapshots=tuple(snapshots)))
    assert record.blame is not None
    assert (record.blame.field, record.blame.step, record.blame.atom) == ("f", 1, 5)
    (force,) = [field for field in record.fields if field.field == "f"]
    assert (force.verdict, force.worst_step, force.worst_id) == ("differs", 2, 6)
    assert [row.verdict for row in force.steps] == ["exact", "differs", "differs"]


def test_first_field_of_a_step_is_blamed(model: PreparedCase) -> None:
    """Neighbours are counted before forces are summed, whichever atom is wrong."""
    answer = answer_of(model)
    first = dict(answer.snapshots[0])
    first["q.coordination"] = first["q.coordination"] + (np.arange(len(model.atoms)) == 8)
    first["f"] = first["f"] + 1.0
    record = judged(model, replace(answer, snapshots=(first, *answer.snapshots[1:])))
    assert record.blame is not None
    assert (record.blame.field, record.blame.stage, record.blame.atom) == ("coordination", "neighbours", 9)


def test_answers_at_other_steps_are_not_compared(model: PreparedCase) -> None:
    record = judged(model, replace(answer_of(model), steps=(0, 1, 3)))
    assert (record.verdict, record.ended, record.fields) == ("differs", "unusable", [])
    assert record.unusable == OtherSteps(counted=[0, 1, 3], asked=[0, 1, 2])


@pytest.mark.parametrize(
    ("changes", "given"),
    [
        ({}, ["type", "rho"]),
        ({"evolve": {"compare_at": [1, 2]}}, ["type"]),
        ({"rheo": {"interface_reconstruct": True}}, ["type"]),
        ({"rheo": {"rho_sum": True}, "rho": None}, ["type"]),
        ({"energy": {"range": [0.5, 2.5]}}, ["type", "rho", "esph"]),
        ({"energy": {"range": [0.5, 2.5]}, "evolve": {"compare_at": [2]}}, ["type"]),
        ({"evolve": {"stops": [{"at": 0, "by": "restart"}]}}, ["type", "rho"]),
        ({"evolve": {"stops": [{"at": 0, "by": "data"}]}}, ["type"]),  # text lacks some digits
        ({"evolve": {"stops": [{"at": 1, "by": "data"}]}}, ["type", "rho"]),
    ],
)
def test_given_input_is_compared_before_it_changes(case_file: Write, changes: dict[str, Any], given: list[str]) -> None:
    evolve = {"timestep": 0.001, "compare_at": [0, 1]} | changes.get("evolve", {})
    evolve["steps"] = evolve["compare_at"][-1]
    ready = prepared(case_file(**MODEL, **changes | {"evolve": evolve}))
    record = judged(ready, answer_of(ready))
    assert (record.verdict, record.ended) == ("exact", "answered")
    carried = [f"rho ({stop['by']} at {stop['at']})" for stop in evolve.get("stops", ())]
    assert [field.field for field in record.fields] == [f"{name} (given)" for name in given] + carried + MODEL[
        "compare"
    ]
    assert {field.derivation for field in record.fields if "(given)" in field.field} == {"the same doubles"}


def test_state_beyond_the_rounding_of_a_data_file_differs(case_file: Write) -> None:
    stops = [{"at": 1, "by": "data"}]
    ready = prepared(case_file(**MODEL, evolve={"steps": 2, "timestep": 0.001, "compare_at": [0, 2], "stops": stops}))
    record = judged(ready, made_answers.of_model(ready.case.scene, ready.atoms, carries=1 + 1e-15))
    (carried,) = [field for field in record.fields if field.field == "rho (data at 1)"]
    assert (carried.verdict, carried.stage) == ("differs", "input")
    assert carried.derivation == "half a unit of the 16th digit of the text"


def test_model_record_has_lint_bounds_and_absent_findings(model: PreparedCase) -> None:
    engine = EngineRecord(distribution="2025.7.22.4.0")
    record, arrays = compare_case(model.case, model.eos, model.atoms, answer_of(model), engine)
    assert record.unseen == ["force-per-volume"], "this LAMMPS computes the force that the manual gives"
    problem = problem_of(model.case.scene, model.atoms, "", (0, 1, 2))
    prediction = Predictor().predict(problem, seed=seed("mine/moved runs"))
    assert record.lint == undetected_in_model(problem, prediction) != []
    force = next(field for field in record.fields if field.field == "f")
    at = next(k for k, row in enumerate(force.steps) if row.step == force.worst_step)
    np.testing.assert_array_equal(arrays["f.bound"], np.broadcast_to(prediction.bounds[at]["f"], (20, 2)))
    assert record.predictions.computed > 0
    assert [force.derivation for force in record.fields[-2:]] == [derived(0)] * 2
    assert record.laws[0].style == "tait/general"


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
        lammps_nc, reference_nc, bound_nc = sides(problem, name, {name: theirs_nc}, prediction, 0)
        np.testing.assert_array_equal(lammps_nc, placed_nc)
        np.testing.assert_array_equal(reference_nc, ours_nc)
        np.testing.assert_array_equal(bound_nc, np.full((3, 2), 0.25))


def test_field_record_has_its_worst_step_and_all_rows() -> None:
    at = {
        step: compare_field("f", "pair", np.arange(1, 4), np.array([0.0, moved, 0.0]), np.zeros(3), np.ones(3))
        for step, moved in {0: 0.0, 2: 0.5, 5: 0.25}.items()
    }
    records = [comparison.record for comparison in at.values()]
    worst = over_steps(list(at.values()), list(at))
    assert worst.lammps_n is at[2].lammps_n
    assert worst.record == records[1].model_copy(
        update={"steps": worst.record.steps, "worst_step": 2, "digest": digest(*(of.digest for of in records))}
    )
    assert worst.record.steps == [
        StepRecord(step=step, verdict=verdict, max_abs=moved, max_over_bound=moved, worst_id=atom, digest=of.digest)
        for (step, verdict, moved, atom), of in zip(
            [(0, "exact", 0.0, 1), (2, "pass", 0.5, 2), (5, "pass", 0.25, 2)], records, strict=True
        )
    ]
    with pytest.raises(ValueError, match="zip"):
        over_steps(list(at.values()), [0, 2])
    records[2].verdict, records[2].explained_by = "explained", ["a-finding"]
    explained = over_steps(list(at.values()), list(at)).record
    assert (explained.verdict, explained.explained_by, explained.worst_step) == ("explained", ["a-finding"], 2)


# --- an answer read at every step, and LAMMPS' neighbour lists


def test_first_step_outside_is_found_if_every_step_is_read(model: PreparedCase) -> None:
    others = "2025.7.22.4.0", Predictor()
    few = replace(model.case, scene=model.case.scene.model_copy(update={"evolve": EVERY_OTHER}))
    answer = answer_of(model)
    assert first_step(few, model.atoms, answer, *others) is None
    wrong = dict(answer.snapshots[1])
    wrong["f"] = wrong["f"] + [[0.0, 1.0, 0.0]]
    found = first_step(few, model.atoms, replace(answer, snapshots=(answer.snapshots[0], wrong, wrong)), *others)
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
    lists = [
        {"id_s": np.array([9, 3]), "x_sc": n, "own_s": [], "pair_ps": [], "rank_s": [], "low_rc": [], "newton": []}
        for n in range(2)
    ]
    first, *others = read_snapshots(scene, replace(answer, arrays=ids, lists=tuple(lists)))
    assert [(listed.row_s.tolist(), listed.x_sc) for listed in first["lists"]] == [([2, 0], 0), ([2, 0], 1)]
    assert not any("lists" in snapshot for snapshot in others)


@pytest.mark.parametrize(("lists", "applies"), [(True, True), (True, False), (False, True)])
def test_lists_are_requested_if_a_finding_depends_on_them(
    model: PreparedCase, monkeypatch: pytest.MonkeyPatch, lists: bool, applies: bool
) -> None:
    def of_the_scene(problem: Problem) -> bool:
        return applies and problem.fields == model.case.scene.compare and problem.steps == (0, 1, 2)

    follows = finding("a", model=Variant(of_the_scene, lists=lists))
    monkeypatch.setattr(findings, "LEDGER", (LEDGER[0], follows))
    assert asks_for_lists(model.case, model.case.scene, model.atoms) == (lists and applies)


# --- no numbers


@pytest.mark.parametrize(
    ("ids", "first"),
    [
        (lambda id_n: id_n[id_n != 7], 7),
        (lambda id_n: np.append(id_n, 99), 99),
        (lambda id_n: np.sort(np.append(id_n, 4)), 4),
    ],
    ids=["missing", "foreign", "doubled"],
)
def test_lost_atoms_end_the_comparison(law: PreparedCase, ids: Callable[[Any], Any], first: int) -> None:
    id_n = ids(law.atoms.id_n)
    record = judged(law, changed(answer_of(law), id=id_n))
    assert (record.verdict, record.ended, record.fields) == ("differs", "unusable", [])
    assert record.unusable == LostAtoms(returned=len(id_n), given=len(law.atoms), first_id=first)


@pytest.mark.parametrize("verdict", ["refused", "crashed", "timeout", "error"])
def test_failure_is_the_verdict_with_the_engines_message(law: PreparedCase, verdict: Any) -> None:
    record = judged(law, Failure(verdict, "ERROR: some\n  words"))
    assert (record.verdict, record.ended, record.engine_error) == (verdict, verdict, "ERROR: some words")


@pytest.mark.parametrize(("words", "verdict"), [("Invalid range", "refused"), ("Out of memory", "differs")])
def test_refusal_must_contain_the_expected_words(case_file: Write, words: str, verdict: str) -> None:
    ready = prepared(case_file(violate="missing-argument", expect={"refused": "Invalid range"}))
    record = judged(ready, Failure("refused", f"ERROR: {words} string"))
    assert (record.verdict, record.ended, record.as_expected) == (verdict, "refused", verdict == "refused")


def test_answer_instead_of_a_refusal_differs(case_file: Write, law: PreparedCase) -> None:
    ready = prepared(case_file(violate="missing-argument", expect={"refused": "Invalid range"}))
    record = judged(ready, answer_of(law))
    assert (record.verdict, record.ended, record.expects) == ("differs", "accepted", "Invalid range")


@pytest.mark.parametrize(
    ("ended", "words", "expects", "verdict"),
    [
        ("crashed", "SIGSEGV", "", "explained"),
        ("refused", "any", "", "explained"),
        ("refused", "other words", "Invalid range", "explained"),
        ("refused", "Invalid range string", "Invalid range", "refused"),
        ("crashed", "Invalid range string", "Invalid range", "explained"),
        ("skipped", "not in this build", "", "skipped"),
        ("skipped", "not in this build", "Invalid range", "skipped"),
    ],
)
def test_unexpected_ending_may_be_explained(
    monkeypatch: pytest.MonkeyPatch, ended: Any, words: str, expects: str, verdict: str
) -> None:
    """It is explained if a finding predicts it; a case that could not run has no ending."""
    monkeypatch.setattr(outcome, "explain_outcome", lambda record, *scene: LEDGER[0])
    record = CaseRecord(case="a.case", verdict="skipped", ended="skipped", expects=expects)
    outcome.record_failure(record, Failure(ended, words))
    explained_by = [LEDGER[0].id] if verdict == "explained" else []
    assert (record.verdict, record.ended, record.explained_by) == (verdict, ended, explained_by)


def test_ending_that_no_finding_predicts_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outcome, "explain_outcome", lambda record, *scene: None)
    record = CaseRecord(case="a.case", verdict="skipped", ended="skipped")
    outcome.record_failure(record, Failure("crashed", "SIGSEGV"))
    assert (record.verdict, record.explained_by) == ("crashed", [])
