"""Verdicts on claims: what refutes a claim, what does not, and that no claim holds without its cases being run."""

from __future__ import annotations

import pytest

from eos_ref.syntax.manual import MANUALS, Manual, manual_of
from lammps_cases.claims.model import Claim, claims
from lammps_cases.claims.verdicts import Judged, Names, counts, judge, refuted_by, summary, worst
from lammps_cases.records.case_parts import FieldRecord, StepRecord
from lammps_cases.records.run_record import CaseRecord, EngineRecord, RunRecord
from tests.support.claim_records import CASES, KNOWN, PROBES, WITHOUT_NUMBERS, all_good, field, good, wrong

NEW = "2025.7.22.4.0"
IN_FORCE = [claim for claim in claims() if claim.made_in(manual_of(NEW))]
BY_CASES = [claim for claim in IN_FORCE if not claim.argument]
NAMES = Names(KNOWN)
GOOD = all_good()
TESTABLE = [claim.id for claim in claims() if claim.cases]
BY_ID = {claim.id: claim for claim in claims()}


def one(claim: Claim, records: dict[str, CaseRecord]) -> Judged:
    return judge([claim], records, KNOWN, claim.since)[0]


def test_all_claims_hold_on_a_lammps_that_follows_its_manual() -> None:
    found = counts(judge(BY_CASES, GOOD, KNOWN))
    testable = sum(not claim.untestable for claim in BY_CASES)
    assert found == {"holds": testable, "cannot be tested": len(BY_CASES) - testable}


def test_claims_of_the_page_stand_and_fall_by_their_argument() -> None:
    """Also on an unknown LAMMPS, and without a finding."""
    pages = [claim for claim in claims() if claim.argument]
    assert {claim.falls for claim in pages} == {True, False}
    for claim in pages:
        judged = one(claim, {})
        assert judged.verdict == ("does not hold" if claim.falls else "holds")
        assert not judged.unexplained and not judged.cases
        assert [evidence.text for evidence in judged.evidence] == [claim.argument]


@pytest.mark.parametrize("id", TESTABLE)
def test_every_case_can_refute_its_claim(id: str) -> None:
    """Each case alone, if wrong in the fields of the claim, changes the verdict."""
    claim = BY_ID[id]
    for name in NAMES.of(claim):
        flipped = one(claim, GOOD | {name: wrong(name, claim.fields)})
        assert flipped.verdict == "does not hold", name
        assert flipped.unexplained or name.startswith("open."), name
        assert {evidence.case for evidence in flipped.evidence} == {name}


@pytest.mark.parametrize("id", [id for id in TESTABLE if BY_ID[id].refuted_by])
def test_finding_that_contradicts_refutes(id: str) -> None:
    claim = BY_ID[id]
    name = NAMES.of(claim)[0]
    for finding in claim.refuted_by:
        flipped = one(claim, GOOD | {name: wrong(name, claim.fields, ["unheard-of", finding])})
        assert flipped.verdict == "does not hold" and not flipped.unexplained
        assert flipped.evidence[0].findings == (finding,)


@pytest.mark.parametrize("id", [id for id in TESTABLE if BY_ID[id].fields])
def test_finding_that_does_not_contradict_is_a_remark(id: str) -> None:
    claim = BY_ID[id]
    numbers = [n for n in NAMES.of(claim) if n in CASES and not CASES[n].scene.expect and n not in WITHOUT_NUMBERS]
    for name in numbers[:1]:
        still = one(claim, GOOD | {name: wrong(name, claim.fields, ["unheard-of"])})
        assert still.verdict == "holds"
        assert any(remark.startswith("unheard-of explains") for remark in still.remarks)


def test_other_fields_do_not_matter() -> None:
    claim = BY_ID["rheo-sum-formula"]
    assert one(claim, GOOD | {"density.one.2d": wrong("density.one.2d", ("f", "v"))}).verdict == "holds"
    assert one(claim, GOOD | {"density.one.2d": wrong("density.one.2d", ("rho",))}).verdict == "does not hold"


@pytest.mark.parametrize("id", ["rheo-sum-formula", "pressure-tait-water-formula", "rheo-fix-modify", "rheo-restart"])
def test_not_run_unless_every_case_was(id: str) -> None:
    claim = BY_ID[id]
    for name in NAMES.of(claim):
        less = {case: record for case, record in GOOD.items() if case != name}
        assert one(claim, less).verdict == "not run"
    assert one(claim, {}).verdict == "not run"


def test_refuted_even_if_some_cases_were_not_run() -> None:
    assert one(BY_ID["rheo-sum-formula"], {"density.one.2d": wrong("density.one.2d")}).verdict == "does not hold"


def test_every_pattern_needs_a_case_without_the_list_of_cases() -> None:
    claim = BY_ID["pressure-linear-formula"]
    some = {f"{head}.linear.2d": good(f"{head}.linear.2d") for head in ("near-rho0", "compression", "tension")}
    assert judge([claim], some)[0].verdict == "holds"
    del some["tension.linear.2d"]
    assert judge([claim], some)[0].verdict == "not run"


@pytest.mark.parametrize(
    "record",
    [
        CaseRecord(case="density.one.2d", verdict="skipped"),
        CaseRecord(case="density.one.2d", verdict="error", message="a fault of the harness"),
        CaseRecord(case="density.one.2d", verdict="crashed", message="LAMMPS' process was killed by SIGSEGV"),
        CaseRecord(case="density.one.2d", verdict="timeout", message="LAMMPS did not finish"),
        CaseRecord(case="density.one.2d", verdict="pass", fields=[field("f")]),
        CaseRecord(case="density.one.2d", verdict="explained", explained_by=["unheard-of"], message="crashed"),
    ],
)
def test_case_without_result_is_no_evidence(record: CaseRecord) -> None:
    judged = one(BY_ID["rheo-sum-formula"], GOOD | {record.case: record})
    assert judged.verdict == "not run" and any("density.one.2d" in remark for remark in judged.remarks)


def test_unforeseen_refusal_refutes() -> None:
    ended = CaseRecord(case="density.one.2d", verdict="refused", message="LAMMPS refused")
    judged = one(BY_ID["rheo-sum-formula"], GOOD | {"density.one.2d": ended})
    assert judged.verdict == "does not hold" and judged.unexplained
    assert judged.evidence[0].text == "LAMMPS refused"


def test_evidence_of_a_valid_claim_is_the_closest_result() -> None:
    near = FieldRecord(
        field="rho",
        stage="made",
        verdict="explained",
        explained_by=["force-per-volume"],
        max_over_bound=50.0,
        steps=[
            StepRecord(step=0, verdict="pass", max_abs=1e-15, max_over_bound=0.7),
            StepRecord(step=1, verdict="explained", max_abs=1e-9, max_over_bound=50.0),
        ],
    )
    records = GOOD | {"density.two.2d": CaseRecord(case="density.two.2d", verdict="explained", fields=[near])}
    (evidence,) = one(BY_ID["rheo-sum-masses"], records).evidence
    assert (evidence.case, evidence.text) == ("density.two.2d", "2 cases: rho within 0.7 of its bound at worst")


def test_worst_over_engines() -> None:
    assert worst(["holds", "does not hold", "not run"]) == "does not hold"
    assert worst(["holds", "not run"]) == "not run"
    assert worst(["holds", "holds"]) == "holds"
    assert worst(["cannot be tested"]) == "cannot be tested"


def run_of(records: dict[str, CaseRecord]) -> RunRecord:
    return RunRecord(engine=EngineRecord(distribution=NEW), reference={}, cases=list(records.values()))


def test_summary_of_a_run() -> None:
    """A run has no probes: claims that need them count as not run."""
    cases = {name: record for name, record in GOOD.items() if name not in PROBES and not name.startswith("open.")}
    whole = summary(run_of(cases | {"density.one.2d": wrong("density.one.2d", ("rho",))}))
    assert whole is not None
    assert {judged.claim.id for judged in whole.refuted} >= {"rheo-sum", "rheo-sum-formula"}
    # every claim of cases alone was run, except the one with the case that is red on purpose
    assert whole.not_run - whole.probes == 1
    assert whole.holds + whole.not_run + whole.untestable + len(whole.refuted) == len(BY_CASES)
    made = judge(IN_FORCE, cases | {"density.one.2d": wrong("density.one.2d", ("rho",))}, manual=manual_of(NEW))
    grounds = refuted_by([made, judge(IN_FORCE, GOOD, manual=manual_of(NEW))])
    assert grounds["cases"] == len(whole.refuted) and grounds["page"] == sum(claim.falls for claim in IN_FORCE)
    assert summary(run_of({"in.deck": CaseRecord(case="in.deck", verdict="pass")})) is None


@pytest.mark.parametrize("manual", MANUALS)
def test_claim_absent_from_a_manual_is_not_judged_by_it(manual: Manual) -> None:
    judged = {one.claim.id: one.verdict for one in judge(claims(), GOOD, KNOWN, manual)}
    silent = {name for name, verdict in judged.items() if verdict == "not claimed"}
    assert silent == {claim.id for claim in claims() if not claim.made_in(manual)} != set()
    assert ("rheo-scale-support-formula" in silent) == (manual == "2026.7.4")
