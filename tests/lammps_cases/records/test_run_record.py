"""The record of a run: order of verdicts, exit codes, sums, digests, and reading it back."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import numpy as np
import pytest

from eos_ref import EOS, InputError
from lammps_cases.records.case_parts import VERDICTS, LawRecord, Predictions, Verdict, digest, worst
from lammps_cases.records.run_record import CaseRecord, EngineRecord, RunRecord, read_run
from lammps_cases.records.wording import predictions


def run_of(*cases: CaseRecord, changed: int = 0) -> RunRecord:
    return RunRecord(engine=EngineRecord(), reference={}, cases=list(cases), changed=changed)


def case(verdict: Verdict, expects: str = "") -> CaseRecord:
    return CaseRecord(case="one", verdict=verdict, expects=expects)


# --- verdicts


def test_the_worst_verdict_counts_in_any_order() -> None:
    by_severity: list[Verdict] = [
        *("skipped", "exact", "pass", "explained", "refused", "differs", "timeout", "crashed", "error")
    ]
    assert set(by_severity) == set(VERDICTS)
    for better, worse in itertools.combinations(by_severity, 2):
        assert worst([better, worse]) == worst([worse, better]) == worse


def test_without_fields_a_case_is_skipped() -> None:
    assert worst([]) == "skipped"


@pytest.mark.parametrize("verdict", VERDICTS)
def test_only_agreement_and_explained_differences_are_as_expected(verdict: Verdict) -> None:
    assert case(verdict).as_expected == (verdict in ("exact", "pass", "explained", "skipped"))


def test_refusal_is_as_expected_if_the_scene_expects_one() -> None:
    assert case("refused", expects="some text").as_expected
    assert not case("differs", expects="some text").as_expected


# --- exit codes


@pytest.mark.parametrize(
    ("verdicts", "code"),
    [
        ((), 0),
        (("exact", "pass", "explained", "skipped"), 0),
        (("pass", "differs"), 1),
        (("refused",), 3),
        (("crashed",), 3),
        (("timeout",), 3),
        (("error",), 3),
        (("differs", "crashed"), 3),  # an engine that fails weighs more than one that differs
    ],
)
def test_the_exit_code_follows_from_the_verdicts(verdicts: tuple[Verdict, ...], code: int) -> None:
    assert run_of(*map(case, verdicts)).exit_code() == code


def test_rejected_finding_fails_the_cases_it_explains() -> None:
    explained = case("explained")
    explained.explained_by = ["one", "two"]
    assert [run_of(explained).exit_code(rejected) for rejected in ((), ("three",), ("two",))] == [0, 0, 1]
    assert run_of(case("pass")).exit_code(("two",)) == 0


def test_changes_against_a_baseline_fail() -> None:
    assert [run_of(case("pass"), changed=count).exit_code() for count in (0, 2)] == [0, 1]
    assert run_of(case("crashed"), changed=2).exit_code() == 3


@pytest.mark.parametrize(("strict", "level"), [(True, "low"), (False, "new")])
def test_older_documents_with_strict_are_read(tmp_path: Path, strict: bool, level: str) -> None:
    document = json.loads(run_of(case("pass")).to_json())
    del document["fail_on"]
    (tmp_path / "run.json").write_text(json.dumps(document | {"strict": strict}))
    assert read_run(tmp_path).fail_on == level


def test_an_expected_refusal_leaves_a_run_green() -> None:
    assert run_of(case("refused", expects="some text")).exit_code() == 0


# --- sums


def test_verdicts_and_predictions_are_counted() -> None:
    cases = [case("pass"), case("differs"), case("pass")]
    cases[0].predictions, cases[2].predictions = Predictions(computed=2, stored=1), Predictions(stored=4)
    run = run_of(*cases).counted()
    assert list(run.summary.items()) == [("pass", 2), ("differs", 1)]
    assert (run.predictions.computed, run.predictions.stored) == (2, 5)
    assert predictions(run.predictions) == "5 of 7 reference predictions taken from the cache"


def test_the_record_of_a_law_holds_its_parameters() -> None:
    law = EOS("tait/general", rho0=1.2, cs=3.1, parameter=2.3, background=0.5)
    record = LawRecord.of(2, law, None)
    assert record.model_dump() == {
        "type": 2,
        "style": "tait/general",
        "rho0": 1.2,
        "cs": 3.1,
        "parameter": 2.3,
        "background": 0.5,
        "mass": None,
        "freezes": False,
    }


# --- digests


def test_a_digest_is_of_every_bit() -> None:
    array_n = np.array([1.0, 2.0])
    assert digest(array_n) == digest(array_n.copy()) != digest(np.nextafter(array_n, 9.0))
    assert digest(np.array([0.0])) != digest(np.array([-0.0]))
    assert digest(np.array([[1.0, 2.0], [3.0, 4.0]]).T) == digest(np.array([[1.0, 3.0], [2.0, 4.0]]))
    assert digest("aa", "bb") != digest("bb", "aa")
    assert len(digest(array_n)) == 16


# --- reading back


def test_a_run_is_read_back_as_written(tmp_path: Path) -> None:
    run = run_of(case("pass"), case("differs")).counted()
    (tmp_path / "run.json").write_text(run.to_json())
    assert read_run(tmp_path) == run


def test_infinities_are_read_back(tmp_path: Path) -> None:
    record = case("differs")
    record.seconds.total = float("inf")
    (tmp_path / "run.json").write_text(run_of(record).to_json())
    assert read_run(tmp_path).cases[0].seconds.total == float("inf")


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"schema": "eos-ref/run/1"}, "schema: must be eos-ref/run/"),
        ({"engine": None}, "engine"),
        ({"surplus": 1}, "surplus"),
        ({"cases": [{"case": "one", "verdict": "fine"}]}, "cases.0.verdict"),
    ],
)
def test_malformed_documents_are_refused_in_one_line(tmp_path: Path, change: dict[str, object], text: str) -> None:
    document = json.loads(run_of(case("pass")).to_json()) | change
    (tmp_path / "run.json").write_text(json.dumps(document))
    with pytest.raises(InputError) as refused:
        read_run(tmp_path)
    assert text in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_folder_without_a_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        read_run(tmp_path)
