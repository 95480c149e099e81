"""How a case ended, from answers made by hand: what is blamed first, and what is not compared."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lammps_cases import findings
from lammps_cases.comparison import compare
from lammps_cases.comparison.compare import EosState
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.engine.session import Answer
from lammps_cases.engine.workers import Failure
from lammps_cases.findings import LEDGER, Finding
from lammps_cases.records.run_record import CaseRecord, DigitsLost, EngineRecord, LostAtoms, OtherSteps
from lammps_cases.run import campaign
from lammps_cases.run.campaign import PreparedCase
from lammps_cases.scene import casefile
from lammps_cases.verdict import outcome
from lammps_cases.verdict.judgement import evaluate
from lammps_cases.verdict.law_mistakes import MUTANTS
from lammps_cases.verdict.model_cases import problem_of

Write = Callable[..., Path]
ENGINE = EngineRecord(distribution="2099.1.1")  # of which the ledger knows no finding
GAS: dict[str, Any] = {
    "pressure": [{"types": "*", "style": "ideal/gas", "gamma": 1.4}],
    "energy": {"range": [0.5, 2.5]},
}
LINEAR = [{"types": "*", "style": "linear"}]
POSITIONS = {"lattice": "sq", "spacing": 0.8}
SIDES = ("lammps", "reference", "bound")
MODEL = {"compare": ["coordination", "f"], "velocity": {"random": 0.3}}


def prepared(file: Path) -> PreparedCase:
    (case,) = casefile.load((file,))
    return campaign.prepare(case)


def state_of(ready: PreparedCase) -> EosState:
    atoms = ready.atoms
    assert atoms.rho_n is not None
    return EosState(atoms.id_n, atoms.type_n, atoms.rho_n, atoms.mass_n, atoms.energy_n)


def answer_of(ready: PreparedCase) -> Answer:
    """What LAMMPS would answer if it were the reference."""
    atoms, scene = ready.atoms, ready.case.scene
    arrays: dict[str, Any] = {"id": atoms.id_n, "type": atoms.type_n, "x": atoms.x_nc, "rho": atoms.rho_n}
    if atoms.energy_n is not None:
        arrays["esph"] = atoms.energy_n
    if scene.whole_model:
        snapshots = []
        problem = problem_of(scene, atoms, "", scene.snapshots)
        for fields in Predictor().predict(problem).fields:
            force_nc = np.hstack([fields["f"], np.zeros((len(atoms), 3 - scene.dimension))])
            snapshots.append(arrays | {"q.coordination": fields["coordination"], "f": force_nc, "pressure": None})
        return Answer(snapshots[-1], 0.5, tuple(snapshots), scene.snapshots)
    assert ready.eos is not None
    p_n = compare.evaluate(ready.eos, state_of(ready))
    return Answer(arrays | {"pressure": p_n, "q.pressure": p_n.copy()}, 0.5)


def judged(ready: PreparedCase, outcome: Answer | Failure) -> CaseRecord:
    return evaluate(ready.case, ready.eos, ready.atoms, outcome, ENGINE)[0]


def changed(answer: Answer, **arrays: Any) -> Answer:
    return replace(answer, arrays=answer.arrays | {name.replace("__", "."): made for name, made in arrays.items()})


@pytest.fixture
def law(case_file: Write) -> PreparedCase:
    return prepared(case_file())


@pytest.fixture
def model(case_file: Write) -> PreparedCase:
    return prepared(case_file(**MODEL, evolve={"steps": 2, "timestep": 0.001, "compare_at": [0, 1, 2]}))


# --- a law alone


def test_the_references_own_numbers_are_exact(law: PreparedCase) -> None:
    record = judged(law, answer_of(law))
    assert (record.verdict, record.ended, record.blame, record.message) == ("exact", "answered", None, "")
    assert [(field.field, field.stage) for field in record.fields] == [
        ("type", "input"),
        ("rho", "input"),
        ("pressure_used", "eos"),
        ("pressure", "eos"),
    ]
    assert record.seconds.lammps == 0.5


def test_a_wrong_pressure_is_blamed_on_its_first_atom(law: PreparedCase) -> None:
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


def test_input_is_blamed_before_what_follows_from_it(law: PreparedCase) -> None:
    """A density that LAMMPS does not hold as given, and with it another pressure."""
    answer = answer_of(law)
    rho_n, p_n = answer.arrays["rho"].copy(), answer.arrays["pressure"].copy()
    rho_n[9] = np.nextafter(rho_n[9], 9.0)
    p_n[2] += 1.0
    record = judged(law, changed(answer, rho=rho_n, pressure=p_n, q__pressure=p_n))
    assert record.blame is not None
    assert (record.blame.field, record.blame.stage, record.blame.atom) == ("rho", "input", 10)


def test_a_gas_is_judged_by_the_energy_that_lammps_holds(case_file: Write) -> None:
    ready = prepared(case_file(**GAS))
    answer = answer_of(ready)
    record, arrays = evaluate(ready.case, ready.eos, ready.atoms, answer, ENGINE)
    assert [(field.field, field.verdict) for field in record.fields] == [
        (name, "exact") for name in ("type", "rho", "esph", "pressure_used", "pressure")
    ]
    np.testing.assert_array_equal(arrays["e"], state_of(ready).e_n)
    doubled = changed(answer, esph=2 * answer.arrays["esph"], pressure=2 * answer.arrays["pressure"])
    assert [field.verdict for field in judged(ready, doubled).fields] == ["exact"] * 2 + ["differs", "exact", "differs"]


def test_the_output_alone_has_digits_to_lose(law: PreparedCase) -> None:
    fields = {field.field: field for field in judged(law, answer_of(law)).fields}
    assert fields["pressure_used"].digits_lost == DigitsLost()
    assert fields["pressure"].digits_lost.reference is not None
    assert fields["type"].derivation == fields["rho"].derivation == "the same doubles"


def test_both_sides_of_every_field_are_kept_with_the_atoms(law: PreparedCase) -> None:
    answer, atoms = answer_of(law), law.atoms
    wrong = changed(answer, q__pressure=answer.arrays["q.pressure"] + 1.0)
    _, arrays = evaluate(law.case, law.eos, atoms, wrong, ENGINE)
    fields = [f"{name}.{side}" for name in ("type", "rho", "pressure_used", "pressure") for side in SIDES]
    assert list(arrays) == ["id", "type", "x", "rho", "box", *fields]
    assert all(arrays[name] is answer.arrays[name] for name in ("id", "type", "x", "rho"))
    np.testing.assert_array_equal(arrays["box"], [atoms.low_c, atoms.high_c])
    np.testing.assert_array_equal(arrays["pressure.lammps"], arrays["pressure.reference"] + 1.0)
    np.testing.assert_array_equal(arrays["type.reference"], atoms.type_n)
    np.testing.assert_array_equal(arrays["rho.bound"], np.zeros(len(atoms)))


@pytest.mark.parametrize(
    ("pattern", "variant", "verdict"),
    [("mi*", "cs ignored", "explained"), ("other", "cs ignored", "differs"), ("mine", "rho0 ignored", "differs")],
)
def test_a_wrong_pressure_is_explained_by_a_finding_that_has_it(
    law: PreparedCase, monkeypatch: pytest.MonkeyPatch, pattern: str, variant: str, verdict: str
) -> None:
    """A finding about the case, whose variant of the law is LAMMPS' on every atom; no case has one today."""
    texts = dict.fromkeys(("title", "documented", "observed", "argument", "workaround"), "")
    made = Finding("a-law", 1, severity="low", law_variant=MUTANTS[variant], applies_to=(pattern,), **texts)
    monkeypatch.setattr(findings, "LEDGER", (replace(LEDGER[0], applies_to=("mine",)), made))
    assert law.eos is not None
    wrong_n = MUTANTS["cs ignored"](law.eos, state_of(law))
    record = judged(law, changed(answer_of(law), pressure=wrong_n, q__pressure=wrong_n))
    explained_by = ["a-law"] if verdict == "explained" else []
    assert record.verdict == verdict and record.blame is not None
    assert (record.blame.field, record.blame.atom, record.blame.outside) == ("pressure_used", 1, len(law.atoms))
    assert [field.explained_by for field in record.fields] == [[], [], explained_by, explained_by]
    assert wrong_n is not None
    wrong_n[-1] *= 2  # an atom that it does not explain
    assert judged(law, changed(answer_of(law), pressure=wrong_n, q__pressure=wrong_n)).verdict == "differs"


@pytest.mark.parametrize(("cells", "seen"), [([5, 4], True), ([50, 79], True), ([50, 80], False)])
def test_the_lint_looks_at_up_to_two_thousand_states(case_file: Write, cells: list[int], seen: bool) -> None:
    """Every second one of 4000; a mistake that one of the others alone would show counts as unseen."""
    ready = prepared(case_file(positions=POSITIONS | {"cells": cells}, pressure=LINEAR))
    rho_n = np.full(len(ready.atoms), 1.2)
    rho_n[3] = 1.3
    ready = replace(ready, atoms=replace(ready.atoms, rho_n=rho_n))
    assert ("cs ignored" in judged(ready, answer_of(ready)).lint) == (not seen)


def test_the_lint_knows_the_energy_and_the_types(case_file: Write) -> None:
    """Of unit masses alone it does not matter whose the energy is."""
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
def test_only_what_lammps_has_not_changed_since_is_compared_with_what_it_was_given(
    case_file: Write, changes: dict[str, Any], given: list[str]
) -> None:
    ready = prepared(case_file(**changes))
    fields = judged(ready, answer_of(ready)).fields
    assert [field.field for field in fields if field.stage == "input"] == given


# --- the particle model


def test_the_references_own_run_passes_at_every_step(model: PreparedCase) -> None:
    record = judged(model, answer_of(model))
    assert (record.verdict, record.blame) == ("exact", None)
    assert {row.step for field in record.fields for row in field.steps} == {0, 1, 2}


def test_the_first_step_is_blamed_not_the_worst(model: PreparedCase) -> None:
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


def test_the_first_field_of_a_step_is_blamed(model: PreparedCase) -> None:
    """Neighbours are counted before forces are summed, whatever atom is wrong."""
    answer = answer_of(model)
    first = dict(answer.snapshots[0])
    first["q.coordination"] = first["q.coordination"] + (np.arange(len(model.atoms)) == 8)
    first["f"] = first["f"] + 1.0
    record = judged(model, replace(answer, snapshots=(first, *answer.snapshots[1:])))
    assert record.blame is not None
    assert (record.blame.field, record.blame.stage, record.blame.atom) == ("coordination", "neighbours", 9)


def test_other_steps_than_those_asked_for_are_not_compared(model: PreparedCase) -> None:
    record = judged(model, replace(answer_of(model), steps=(0, 1, 3)))
    assert (record.verdict, record.ended, record.fields) == ("differs", "unusable", [])
    assert record.unusable == OtherSteps(counted=[0, 1, 3], asked=[0, 1, 2])


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
def test_a_failure_is_the_verdict_with_the_engines_words(law: PreparedCase, verdict: Any) -> None:
    record = judged(law, Failure(verdict, "ERROR: some\n  words"))
    assert (record.verdict, record.ended, record.engine_error) == (verdict, verdict, "ERROR: some words")


@pytest.mark.parametrize(("words", "verdict"), [("Invalid range", "refused"), ("Out of memory", "differs")])
def test_a_refusal_must_have_the_words_expected(case_file: Write, words: str, verdict: str) -> None:
    ready = prepared(case_file(violate="missing-argument", expect={"refused": "Invalid range"}))
    record = judged(ready, Failure("refused", f"ERROR: {words} string"))
    assert (record.verdict, record.ended, record.as_expected) == (verdict, "refused", verdict == "refused")


def test_an_answer_where_a_refusal_is_expected_differs(case_file: Write, law: PreparedCase) -> None:
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
def test_an_end_other_than_the_one_expected_may_be_explained(
    monkeypatch: pytest.MonkeyPatch, ended: Any, words: str, expects: str, verdict: str
) -> None:
    """Where a finding predicts it; what could not run has no end."""
    monkeypatch.setattr(outcome, "explain_outcome", lambda record, *scene: LEDGER[0])
    record = CaseRecord(case="a.case", verdict="skipped", ended="skipped", expects=expects)
    outcome.judge_failure(record, Failure(ended, words))
    explained_by = [LEDGER[0].id] if verdict == "explained" else []
    assert (record.verdict, record.ended, record.explained_by) == (verdict, ended, explained_by)


def test_an_end_that_no_finding_predicts_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outcome, "explain_outcome", lambda record, *scene: None)
    record = CaseRecord(case="a.case", verdict="skipped", ended="skipped")
    outcome.judge_failure(record, Failure("crashed", "SIGSEGV"))
    assert (record.verdict, record.explained_by) == ("crashed", [])
