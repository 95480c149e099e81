"""The record of a run: order of verdicts, exit codes, sums, digests, and reading it back."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eos_ref import EOS, InputError
from lammps_cases.records.case_parts import (
    BY_SEVERITY,
    VERDICTS,
    FieldRecord,
    LawRecord,
    Predictions,
    Seconds,
    Verdict,
    digest,
    worst,
)
from lammps_cases.records.run_record import CaseRecord, EngineRecord, RunRecord, read_run
from lammps_cases.records.wording import predictions


def run_of(*cases: CaseRecord, changed: int = 0) -> RunRecord:
    return RunRecord(engine=EngineRecord(), reference={}, cases=list(cases), changed=changed)


def case(verdict: Verdict, expects: str = "", **more: Any) -> CaseRecord:
    return CaseRecord(case="one", verdict=verdict, expects=expects, **more)


def test_worst_verdict_counts_in_any_order() -> None:
    by_severity: list[Verdict] = [
        *("skipped", "exact", "pass", "explained", "refused", "differs", "timeout", "crashed", "error")
    ]
    assert {*by_severity} == {*VERDICTS} and tuple(by_severity) == BY_SEVERITY and worst([]) == "skipped"
    for better, worse in itertools.combinations(by_severity, 2):
        assert worst([better, worse]) == worst([worse, better]) == worse


@pytest.mark.parametrize("verdict", VERDICTS)
def test_agreement_known_differences_and_expected_refusals_are_as_expected(verdict: Verdict) -> None:
    assert case(verdict).as_expected == (verdict in ("exact", "pass", "explained", "skipped"))
    assert case(verdict, expects="some text").as_expected == (case(verdict).as_expected or verdict == "refused")


EXPLAINED = case("explained", explained_by=["one", "two"])


@pytest.mark.parametrize(
    ("run", "rejected", "code"),
    [
        (run_of(), (), 0),
        (run_of(case("exact"), case("pass"), case("explained"), case("skipped")), (), 0),
        (run_of(case("pass"), case("differs")), (), 1),
        (run_of(case("refused")), (), 3),
        (run_of(case("refused", expects="some text")), (), 0),
        (run_of(case("crashed")), (), 3),
        (run_of(case("timeout")), (), 3),
        (run_of(case("error")), (), 3),
        (run_of(case("differs"), case("crashed")), (), 3),  # an engine that fails weighs more than one that differs
        (run_of(EXPLAINED), ("three",), 0),
        (run_of(EXPLAINED), ("two",), 1),
        (run_of(case("pass")), ("two",), 0),
        (run_of(case("pass"), changed=2), (), 1),
        (run_of(case("crashed"), changed=2), (), 3),
    ],
)
def test_exit_code_follows_from_verdicts_findings_and_changes(
    run: RunRecord, rejected: tuple[str, ...], code: int
) -> None:
    assert run.exit_code(rejected) == code


def test_verdicts_and_predictions_are_counted() -> None:
    cases = [case("pass", predictions=Predictions(computed=2, stored=1)), case("differs")]
    run = run_of(*cases, case("pass", predictions=Predictions(stored=4))).counted()
    assert list(run.summary.items()) == [("pass", 2), ("differs", 1)]
    assert (run.predictions.computed, run.predictions.stored) == (2, 5)
    assert predictions(run.predictions) == "5 of 7 reference predictions taken from the cache"


def test_record_of_a_law_holds_its_parameters() -> None:
    law = {"style": "tait/general", "rho0": 1.2, "cs": 3.1, "parameter": 2.3, "background": 0.5}
    assert LawRecord.of(2, EOS(**law), None).model_dump() == {"type": 2, "mass": None, "freezes": False} | law


def test_digest_is_of_every_bit() -> None:
    array_n = np.array([1.0, 2.0])
    assert digest(array_n) == digest(array_n.copy()) != digest(np.nextafter(array_n, 9.0))
    assert digest(np.array([0.0])) != digest(np.array([-0.0]))
    assert digest(np.array([[1.0, 2.0], [3.0, 4.0]]).T) == digest(np.array([[1.0, 3.0], [2.0, 4.0]]))
    assert digest("aa", "bb") != digest("bb", "aa")
    assert len(digest(array_n)) == 16


# --- reading back

NUMBERS, TEXTS = st.none() | st.floats(), st.text(max_size=5)
SOME = st.lists(TEXTS, max_size=2)
FIELDS = st.builds(
    FieldRecord,
    field=TEXTS,
    stage=TEXTS,
    verdict=st.sampled_from(VERDICTS),
    max_abs=NUMBERS,
    max_over_bound=NUMBERS,
    explained_by=SOME,
)
CASES = st.builds(
    CaseRecord,
    case=st.from_regex(r"[A-Za-z0-9_][^/\\\x00-\x1f]{0,9}", fullmatch=True),
    verdict=st.sampled_from(VERDICTS),
    message=TEXTS,
    seconds=st.builds(Seconds, lammps=st.floats()),
    fields=st.lists(FIELDS, max_size=2),
    thermo=st.lists(st.dictionaries(TEXTS, st.floats(), max_size=2), max_size=2),
)
RUNS = st.builds(
    RunRecord,
    engine=st.builds(EngineRecord, name=TEXTS, git=TEXTS),
    reference=st.dictionaries(TEXTS, TEXTS, max_size=2),
    fail_on=st.sampled_from(["new", "low", "0.5%"]),
    notes=SOME,
    cases=st.lists(CASES, max_size=2),
    missing=st.integers(0, 9),
)


@given(RUNS, st.data())
def test_run_is_read_back_as_written_and_cut_anywhere_is_refused(run: RunRecord, data: st.DataObject) -> None:
    """Of every text and number, infinities and NaN included; what --json prints before the record is no part of it."""
    text = run.counted().to_json()
    printed = {"state": "FAIL", "sentence": "x", "findings": [], "statements": {}} | json.loads(text)
    with TemporaryDirectory() as name:
        folder = Path(name)
        for written in (text, json.dumps(printed)):
            (folder / "run.json").write_text(written, encoding="utf-8")
            assert read_run(folder).to_json() == text
        content = text.rstrip().encode()
        (folder / "run.json").write_bytes(content[: data.draw(st.integers(0, len(content) - 1))])
        with pytest.raises(InputError) as refused:
            read_run(folder)
        assert "\n" not in str(refused.value)


@pytest.mark.parametrize(("strict", "level"), [(True, "low"), (False, "new")])
def test_older_documents_with_strict_are_read(tmp_path: Path, strict: bool, level: str) -> None:
    document = json.loads(run_of(case("pass")).to_json())
    del document["fail_on"]
    (tmp_path / "run.json").write_text(json.dumps(document | {"strict": strict}))
    assert read_run(tmp_path).fail_on == level


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"schema": "eos-ref/run/1"}, "schema: must be eos-ref/run/2, found 'eos-ref/run/1'"),
        ({"engine": None}, "engine: "),
        ({"surplus": 1}, "surplus: "),
        ({"cases": [{"case": "one", "verdict": "fine"}]}, "cases.0.verdict: "),
        *(({"fail_on": level}, "fail_on.") for level in ("-1%", "1", "%", "1e9999%", "nan%", "1 %", "1.%")),
    ],
)
def test_malformed_documents_are_refused_in_one_line(tmp_path: Path, change: dict[str, object], said: str) -> None:
    document = json.loads(run_of(case("pass")).to_json()) | change
    (tmp_path / "run.json").write_text(json.dumps(document))
    with pytest.raises(InputError) as refused:
        read_run(tmp_path)
    assert str(refused.value).startswith(said) and "\n" not in str(refused.value)


def test_folder_without_a_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        read_run(tmp_path)
