"""Findings in the report of a run: shown, gone, of other versions; agreement; keywords that LAMMPS lacks."""

from __future__ import annotations

import json
from typing import Any

import pytest

from lammps_cases.findings import KNOWN, LEDGER
from lammps_cases.findings.variants import Variant
from lammps_cases.records import case_wording, wording
from lammps_cases.records.case_parts import FieldRecord, StepRecord, Verdict
from lammps_cases.records.run_record import CaseRecord, EngineRecord, RunRecord
from lammps_cases.report import findings
from lammps_cases.scene.fields import in_step_order
from tests.support.made_findings import finding
from tests.support.made_report import FINDINGS, NAME, entry
from tests.support.made_runs import case

OLD, NEW, UNKNOWN = KNOWN[0], KNOWN[-1], "2099.1.1"
FOLLOWS = Variant(lambda problem: True, lists=True)


def run_of(*cases: CaseRecord, version: str = UNKNOWN, **settings: Any) -> RunRecord:
    """A run of cases on a version of LAMMPS."""
    return RunRecord(engine=EngineRecord(distribution=version), reference={}, cases=list(cases), **settings).counted()


def explained(name: str, by: str) -> CaseRecord:
    """A case that a finding explains."""
    return case(name, "explained", 2.0, finding=by)


@pytest.mark.parametrize(
    ("version", "engines", "allowed", "code"),
    [
        (UNKNOWN, KNOWN[:-1], (), 1),
        (UNKNOWN, KNOWN[:-1], ("bug",), 0),
        (UNKNOWN, KNOWN, (), 0),  # the nearest version has it
        (UNKNOWN, (), (), 0),  # not yet accepted on any version: the finding itself is new
        (NEW, KNOWN[:-1], (), 1),  # a build of a known version
        (OLD, (NEW,), (), 1),
        (OLD, (OLD,), (), 0),
        ("", (OLD,), (), 0),  # LAMMPS crashed before reporting its version
    ],
)
def test_finding_of_other_versions_fails_until_it_is_allowed(
    version: str, engines: tuple[str, ...], allowed: tuple[str, ...], code: int
) -> None:
    run = run_of(explained("a", "bug"), version=version, allowed=dict.fromkeys(allowed, "--allow"))
    found = findings.outcome(run, [finding("bug", engines=engines)])
    assert (found.exit_code, found.accepted(run.cases[0])) == (code, not code)
    assert found.headline.state == ("FAIL" if code else "KNOWN BUGS")
    before = NEW if version == UNKNOWN else version
    assert found.headline.sentence.startswith(f"regression: bug, not in {before}") == bool(code)


def test_crash_that_only_earlier_versions_had_fails() -> None:
    (crash,) = (entry for entry in LEDGER if entry.id == "no-pressure-segfault")
    assert crash.outcome == "crashed" and NEW not in crash.engines
    record = CaseRecord(case="a", verdict="explained", ended="crashed", explained_by=[crash.id])
    assert findings.outcome(run_of(record)).exit_code == 1
    assert findings.outcome(run_of(record, version=crash.engines[-1])).exit_code == 0


def test_regressions_come_first_and_only_the_first_of_many_are_named() -> None:
    ledger = [finding("bug", engines=(OLD,)), finding("known", engines=KNOWN)]
    found = findings.outcome(run_of(explained("a", "bug"), explained("b", "known"), case("c", "differs")), ledger)
    known = "1 known bug seen in this LAMMPS (not severe)"
    assert found.headline.sentence == f"regression: bug, not in {NEW}; 1 case not as expected: 1 differs; {known}"
    assert [one.entry.id for one in found.shown] == ["bug", "known"] and "(bug)" in found.closing()[0]
    ledger = [finding(f"bug-{k}", k, engines=(OLD,)) for k in range(8)]
    run = run_of(*(explained(f"c{k}", f"bug-{k}") for k in range(8)))
    assert "bug-5, 2 more, not in" in findings.outcome(run, ledger).headline.sentence


def test_unknown_version_has_new_known_and_gone_findings() -> None:
    ledger = [
        finding("new", 1, engines=(OLD,)),
        finding("known", 2, engines=(NEW,)),
        finding("gone", 3, engines=(NEW,), applies_to=("g*",), outcome="differs"),
    ]
    lacking = CaseRecord(case="g2", verdict="skipped", ended="skipped", lacks="cubic")
    red = CaseRecord(case="g3", verdict="refused", ended="refused")
    run = run_of(explained("a", "new"), explained("b", "known"), case("g1"), lacking, red)
    carried = findings.compare_with_ledger(run, ledger)
    assert carried is not None and carried.nearest == NEW
    assert (carried.first_seen, carried.partly, carried.gone) == ({"new": 1}, {}, {"gone": 1})
    assert wording.carried(carried).endswith("1 finding new, 1 gone, 1 difference unexplained")
    assert wording.carried_rows(carried)[0] == ("new", f"new, not in {NEW}", 1)


@pytest.mark.parametrize(("verdict", "count"), [("pass", 2), ("differs", 1), ("skipped", 1)])
def test_finding_from_lists_is_gone_where_accepted_runs_showed_it(
    verdict: Any, count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(findings, "accepted_cases", lambda engine: {"listing": ["a", "b", "not-run"], "other": ["a"]})
    ledger = [
        finding("listing", 1, engines=(NEW,), model=FOLLOWS),
        finding("other", 2, engines=(NEW,), model=Variant(lambda problem: True)),  # determined from its own cases
        finding("elsewhere", 3, engines=(OLD,), model=FOLLOWS),
    ]
    carried = findings.compare_with_ledger(run_of(case("a"), case("b", verdict), case("c"), version=NEW), ledger)
    assert carried is not None and (carried.gone, carried.partly) == ({"listing": count}, {})
    shown = findings.compare_with_ledger(run_of(case("a"), explained("b", "listing"), version=NEW), ledger)
    assert shown is not None and (shown.gone, shown.partly) == ({}, {"listing": 1})
    refused = explained("b", "other").model_copy(update={"fields": []})  # by another finding: no comparison
    assert findings.compare_with_ledger(run_of(case("c"), refused, version=NEW), ledger[::2]) is None


def test_keyword_that_lammps_lacks_is_one_line_and_fails() -> None:
    records = [CaseRecord(case=f"c{k}", verdict="skipped", ended="skipped", lacks="cubic") for k in range(3)]
    found = findings.outcome(run_of(*records, case("other")))
    assert found.headline.sentence == "no 'cubic' in this LAMMPS: 3 cases skipped"
    assert (found.exit_code, found.unaccepted) == (1, [])
    assert case_wording.message(records[0]) == "this LAMMPS has no 'cubic'"


def test_unknown_findings_are_severe_and_never_a_pass() -> None:
    run = run_of(fail_on="high")
    assert findings.outcome(run).headline.state == "EMPTY"
    cases = [{"case": "a", "verdict": "explained", "explained_by": ["forgotten"]}]
    found = findings.outcome(RunRecord.model_validate(json.loads(run.to_json()) | {"cases": cases}))
    assert (found.headline.state, found.exit_code, found.known) == ("FAIL", 1, {"forgotten": "high"})


def test_effects_of_findings_are_one_line() -> None:
    for one in LEDGER:
        assert 10 < len(one.effect) <= 100 and not one.effect.endswith("."), one.id
        assert one.effect != one.title and one.since, one.id


# --- of a run with a case of every kind


def test_findings_of_a_run(run: RunRecord) -> None:
    found = {finding.entry.id: finding for finding in findings.of_run(run, FINDINGS)}
    assert list(found) == ["pairs", "gone", "elsewhere", "F-3", "open", "hostile"]  # severity, then status
    assert found["pairs"].cases == ["model.flat", "model.cube", f"hostile2.{NAME}"]
    assert found["pairs"].unseen == []  # of the particle model: the records of cases show where it applies
    assert "ledger.artificial" in found["F-3"].cases
    assert (found["gone"].status, found["gone"].unseen) == ("unseen", ["model.cube"])
    assert found["open"].cases == ["eos.broken"]  # without a variant a difference is shown, not explained
    assert found["elsewhere"].status == "absent" and not found["elsewhere"].listed


def test_finding_without_its_predicted_outcome_is_unseen() -> None:
    crash = entry("crash", applies_to=("[a-d]",), outcome="crashed")
    cases = [
        CaseRecord(case="a", verdict="explained", explained_by=["crash"]),
        CaseRecord(case="b", verdict="refused", expects="x"),
        CaseRecord(case="c", verdict="skipped"),
        CaseRecord(case="d", verdict="differs"),
    ]
    (found,) = findings.of_run(run_of(*cases, version="2025.7.22.4.0"), (crash,))
    assert (found.cases, found.unseen) == (["a"], ["b", "d"])


# --- agreement: fields against steps


def test_agreement(run: RunRecord) -> None:
    model, twins = findings.matrices(run)
    assert (model.cases, model.steps, twins.cases) == (2, [0, 10], 1)
    assert [row.field for row in model.rows] == ["grad/v", "pressure", "f"]
    force, gradient = model.rows[2].cells[0], model.rows[0].cells[0]
    assert force is not None and (force.agree, force.explained.cases, force.explained.ratio) == (0, 2, 3e9)
    assert gradient is not None and (gradient.agree, gradient.inside.ratio, gradient.verdict) == (2, 0.5, "pass")
    assert in_step_order(["zz", "f", "x", "aa"]) == ["x", "f", "aa", "zz"]  # unknown fields do no harm


def _stepped(name: str, field: str, *at: tuple[int, Verdict, float], **facts: Any) -> CaseRecord:
    steps = [StepRecord(step=step, verdict=verdict, max_over_bound=ratio, max_abs=0.0) for step, verdict, ratio in at]
    record = FieldRecord(field=field, stage="pair", verdict="pass", max_over_bound=0.0, steps=steps)
    return CaseRecord(case=name, verdict="pass", fields=[record], **facts)


def test_fields_against_steps() -> None:
    cases = [
        _stepped("a", "f", (0, "exact", 0.0), (1, "pass", 0.5)),
        _stepped("b", "f", (0, "exact", 0.0), (1, "pass", 0.25), (5, "differs", 3.0)),
        _stepped("c", "f", (1, "explained", 7.0), explained_by=["y", "x"]),
        _stepped("d", "rho", (1, "exact", 0.0)),
        _stepped("t", "f", (1, "differs", 2.0), twin="newton"),
        CaseRecord(case="law", verdict="pass"),
    ]
    of_reference, of_twins = findings.matrices(run_of(*cases))
    assert (of_reference.cases, of_reference.steps, of_reference.explained) == (4, [0, 1, 5], ["x", "y"])
    assert [(row.field, row.exact) for row in of_reference.rows] == [("f", False), ("rho", True)], "as a step computes"
    first, second, last = of_reference.rows[0].cells
    assert first and second and last and of_reference.rows[1].cells[0] is None
    assert [cell.verdict for cell in (first, second, last)] == ["exact", "explained", "differs"]
    assert (second.cases, second.agree, second.inside.cases) == (3, 2, 2)
    assert (second.inside.ratio, second.inside.case, second.explained.ratio) == (0.5, "a", 7.0)
    assert (last.outside.case, of_twins.twins, of_twins.cases) == ("b", True, 1)
    assert findings.matrices(run_of(cases[-1])) == []
