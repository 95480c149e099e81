"""Findings that come or go with a version of LAMMPS, and keywords that it lacks, in the report of a run."""

from __future__ import annotations

from typing import Any

import pytest

from lammps_cases.findings import KNOWN, LEDGER
from lammps_cases.findings.variants import Variant
from lammps_cases.records import case_wording, wording
from lammps_cases.records.run_record import CaseRecord, EngineRecord, RunRecord
from lammps_cases.report import findings
from tests.support.made_findings import finding
from tests.support.made_runs import case

OLD, NEW = KNOWN[0], KNOWN[-1]
FOLLOWS = Variant(lambda problem: True, lists=True)


def run_of(*cases: CaseRecord, version: str = "2099.1.1", **settings: Any) -> RunRecord:
    """Return a run of cases on a version of LAMMPS."""
    return RunRecord(engine=EngineRecord(distribution=version), reference={}, cases=list(cases), **settings).counted()


def explained(name: str, by: str) -> CaseRecord:
    """Return a case that a finding explains."""
    return case(name, "explained", 2.0, finding=by)


@pytest.mark.parametrize(
    ("version", "engines", "allowed", "code"),
    [
        ("2099.1.1", KNOWN[:-1], (), 1),
        ("2099.1.1", KNOWN[:-1], ("bug",), 0),
        ("2099.1.1", KNOWN, (), 0),  # the nearest version has it
        ("2099.1.1", (), (), 0),  # not yet accepted on any version: the finding itself is new
        (NEW, KNOWN[:-1], (), 1),  # a build of a known version
        (OLD, (NEW,), (), 1),
        (OLD, (OLD,), (), 0),
        ("", (OLD,), (), 0),  # LAMMPS crashed before reporting its version
    ],
)
def test_a_finding_of_other_versions_fails_until_it_is_allowed(
    version: str, engines: tuple[str, ...], allowed: tuple[str, ...], code: int
) -> None:
    run = run_of(explained("a", "bug"), version=version, allowed=dict.fromkeys(allowed, "--allow"))
    found = findings.outcome(run, [finding("bug", engines=engines)])
    assert (found.exit_code, found.accepted(run.cases[0])) == (code, not code)
    assert found.headline.state == ("FAIL" if code else "KNOWN BUGS")
    before = NEW if version == "2099.1.1" else version
    assert found.headline.sentence.startswith(f"regression: bug, not in {before}") == bool(code)


def test_a_crash_that_only_earlier_versions_had_fails() -> None:
    (crash,) = (entry for entry in LEDGER if entry.id == "no-pressure-segfault")
    assert crash.outcome == "crashed" and NEW not in crash.engines
    record = CaseRecord(case="a", verdict="explained", ended="crashed", explained_by=[crash.id])
    assert findings.outcome(run_of(record)).exit_code == 1
    assert findings.outcome(run_of(record, version=crash.engines[-1])).exit_code == 0


def test_regressions_come_before_severe_and_unexplained_ones() -> None:
    ledger = [finding("bug", engines=(OLD,)), finding("known", engines=KNOWN)]
    run = run_of(explained("a", "bug"), explained("b", "known"), case("c", "differs"))
    found = findings.outcome(run, ledger)
    known = "1 known bug seen in this LAMMPS (not severe)"
    assert found.headline.sentence == f"regression: bug, not in {NEW}; 1 case not as expected: 1 differs; {known}"
    assert [one.entry.id for one in found.shown] == ["bug", "known"] and "(bug)" in found.closing()[0]


def test_only_the_first_of_many_are_named() -> None:
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
    carried = findings.compare_with_ledger(
        run_of(explained("a", "new"), explained("b", "known"), case("g1"), lacking, red), ledger
    )
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
