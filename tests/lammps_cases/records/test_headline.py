"""The headline of a run and of audited decks: its states, looks and words, and the levels at which a finding fails."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import pytest
from syrupy.assertion import SnapshotAssertion

from lammps_cases.records import deck_wording
from lammps_cases.records.case_parts import EffectRecord
from lammps_cases.records.headline import LOOKS, headline, how_severe, of_decks, strictest
from lammps_cases.records.levels import FAIL_ON, SEVERITIES, Severity, allowed, fails, severity_of
from lammps_cases.records.run_record import CaseRecord, RunRecord
from lammps_cases.report.findings import outcome
from tests.support.made_audits import BUG, OTHER, acting, blame, broke, deck, effect, field, lost, outlook, run

KNOWN: Mapping[str, Severity] = {"a": "high", "b": "high", "c": "medium", "d": "low"}
RUNS: dict[str, tuple[Mapping[str, Severity], dict[str, Any]]] = {
    "no difference": ({}, {}),
    "in other words": ({}, {"same": "7 statements hold"}),
    "nothing compared": ({}, {"compared": False}),
    "known": (KNOWN, {}),
    "one known": ({"c": "medium"}, {}),
    "known differences": ({}, {"differences": "1 statement does not hold, all known"}),
    "new": ({}, {"new": ["1 case not as expected"]}),
    "engine failed": ({}, {"new": ["the engine failed"], "compared": False}),
    "new and known": (KNOWN, {"new": ["x"]}),
    "rejected": (KNOWN, {"fail_on": "high"}),
    "not rejected": ({"d": "low"}, {"fail_on": "medium"}),
    "low rejected": ({"d": "low"}, {"fail_on": "low"}),
}
BOTH = [effect(0.2), effect(15.0, 16.0, "heatflow", OTHER)]
DIFFERS = {"verdict": "differs", "fields": [field("shift/v", "differs"), field("f", "differs"), field("rho")]}
LOST = {"verdict": "refused", "lost": lost(False)}
UNCHECKED = {"f": "bonds add to it", "drho": "bonds add to it", "chi": "absent"}
MASS = "mass is 4e4 times rho0 V"
DECKS: dict[str, CaseRecord] = {
    "agrees": deck(),
    "two warnings": deck(fields=1, warnings=["a", "b"]),
    "not checked for one reason": deck(unchecked=UNCHECKED, out_of_scope=["chi"]),
    "not checked for many": deck(unchecked={"f": "bonds", "drho": "a", "rho": "b", "chi": "c", "cv": "d"}),
    "ignores lost atoms": deck(lost=lost(True, 24, 144)),
    "checked in part": deck(fields=[field("f", until=40), field("rho", until=60), field("drho")]),
    "nothing compared": deck(fields=0),
    "skipped": deck(verdict="skipped", fields=0, message="built without RHEO"),
    "small effect": deck(effects=[effect(4e-5)]),
    "large effect": deck(effects=[effect(39999.0, 4e4)]),
    "acts by definition": deck(acting=[acting()]),
    "four bugs": deck(verdict="explained", effects=BOTH, acting=[acting("it does", "a"), acting("so it does", "b")]),
    "two bugs": deck(verdict="explained", effects=BOTH),
    "explained": deck(verdict="explained", fields=[field("f", "explained", explained_by=[BUG])]),
    "explained as a whole": deck(verdict="explained", explained_by=["units"]),
    "unstable by a bug": deck(outlook=outlook("findings", BUG), effects=[effect(4e4, 4e4)], **LOST),
    "unstable by one of two": deck(outlook=outlook("findings", BUG), effects=BOTH, **LOST),
    "unstable by its mass": deck(
        verdict="refused", engine_error="ERROR: x", ended="refused", outlook=outlook("set-up", because=MASS)
    ),
    "unstable as set up": deck(outlook=outlook("set-up"), **LOST),
    "unstable by its time step": deck(outlook=outlook("time step"), **LOST),
    "unstable, not understood": deck(outlook=outlook("not understood"), **LOST),
    "not a number": deck(broke=broke()),
    "infinite in a later run": deck(broke=broke(column="f", value=math.inf, run=2)),
    "runs away": deck(
        broke=broke("runaway", "energy", 6e56, step=40), outlook=outlook("findings", OTHER), effects=BOTH[1:]
    ),
    "differs": deck(blame=blame(), **DIFFERS),
    "differs, and a bug": deck(blame=blame(), effects=[effect(0.2)], warnings=["a"], **DIFFERS),
    "crashed": deck(verdict="crashed", ended="crashed", engine_error="SIGSEGV", fields=0),
    "differs without fields": deck(verdict="differs", fields=0),
}
SEVERAL: dict[str, list[CaseRecord]] = {
    "agree": [deck("in.a"), deck("in.b")],
    "nothing compared": [deck("in.a", fields=0), deck("in.b", fields=0)],
    "one has a bug": [deck("in.a"), deck("in.b", effects=[effect(0.1)])],
    "two fail, others have bugs": [
        deck("in.a", broke=broke()),
        deck("in.b", verdict="differs", fields=DIFFERS["fields"][:1], blame=blame()),
        *(deck(f"in.{k}", effects=[effect(0.1)]) for k in range(7)),
        *(deck(f"in.{k}") for k in range(7, 10)),
    ],
    "all fail": [deck(f"in.{k}", broke=broke()) for k in range(5)],
}
SEVERAL |= {f"one: {name}": [case] for name, case in DECKS.items()}


def test_state_and_words_of_a_run(snapshot: SnapshotAssertion) -> None:
    assert {name: str(headline(known, **more)) for name, (known, more) in RUNS.items()} == snapshot


def test_state_and_words_of_decks(snapshot: SnapshotAssertion) -> None:
    """The headline fails exactly if the exit code and some deck do; it is the same of a record that was read back."""
    said = {}
    for name, cases in SEVERAL.items():
        record = run(*cases)
        of_run = outcome(record)
        failed = of_run.headline.state == "FAIL"
        assert (of_run.exit_code != 0) == failed == bool(of_run.unaccepted), name
        said[name] = str(of_run.headline)
        assert str(outcome(RunRecord.model_validate_json(record.to_json())).headline) == said[name]
    said["with a change"] = str(of_decks([deck()], ["2 changes against the baseline"]))
    assert said == snapshot


def test_headline_of_a_run_counts_cases_that_end_early() -> None:
    """A known bug may leave a case without a single number to compare: the count of bugs alone hides that."""
    why = outlook("findings", BUG)
    early = CaseRecord(case="drop", verdict="explained", ended="refused", explained_by=[BUG], outlook=why)
    sentence = str(outcome(run(early)).headline)
    assert sentence == "KNOWN BUGS: LAMMPS ends 1 case early; 1 known bug seen in this LAMMPS (severe); nothing new"
    other = early.model_copy(update={"outlook": None})
    assert "early" not in str(outcome(run(other)).headline)


def test_deck_without_a_bug_needs_no_next_command() -> None:
    assert not any(line.startswith("next") for line in outcome(run(deck())).closing())


def test_every_state_looks_different() -> None:
    for name in ("css", "terminal", "mark"):
        assert len({getattr(look, name) for look in LOOKS.values()}) == len(LOOKS)
    levels = {"PASS": "notice", "KNOWN BUGS": "warning", "FAIL": "error", "EMPTY": "warning"}
    assert {state: look.level for state, look in LOOKS.items()} == levels


def test_levels_and_severities_are_ordered() -> None:
    """A level fails findings at least as severe."""
    failing = {level: [severity for severity in SEVERITIES if fails(severity, level)] for level in FAIL_ON}
    assert failing == {"high": ["high"], "medium": ["high", "medium"], "low": ["high", "medium", "low"], "new": []}
    assert strictest(["high", "low", "medium", "new"]) == "low"
    assert strictest(["new", "high"]) == "high" and strictest([]) == "new"
    assert strictest(["high", "0.5%", "medium"]) == "0.5%" and allowed("0.5%") == 0.005
    assert how_severe(KNOWN) == "2 high, 1 medium, 1 low" and how_severe({}) == ""
    severities = [severity_of(of) for of in (math.inf, 0.2, 0.1, 0.02, 0.01, 1e-9)]
    assert severities == ["high", "high", "medium", "medium", "low", "low"]


@pytest.mark.parametrize(
    ("record", "level", "failing"),
    [
        (effect(0.02), "1%", True),
        (effect(0.02), "2.5%", False),
        (effect(0.02), "0.5%", True),
        (effect(0.02), "medium", True),
        (effect(0.02), "high", False),
        (effect(0.02), "new", False),
        (effect(1e-9), "low", True),
        (effect(0.2), "high", True),
        (effect(None), "99999%", True),
        (effect(math.nan), "99999%", True),
        (effect(None), "new", False),
        (None, "99999%", True),  # it acts, and its effect was not measured
    ],
)
def test_finding_fails_by_its_effect_on_the_deck(record: EffectRecord | None, level: str, failing: bool) -> None:
    of_deck = {"effects": [record]} if record else {"acting": [acting()]}
    of_run = outcome(run(deck(verdict="explained", **of_deck), fail_on=level))
    assert (of_run.headline.state == "FAIL") == failing == (of_run.exit_code == 1)
    assert f"rejected by --fail-on {level}" in of_run.headline.sentence or not failing
    assert record or of_run.known == {BUG: "high"}


def test_only_decks_with_a_large_effect_fail() -> None:
    little, much = (deck(name, effects=[effect(of)]) for name, of in (("in.a", 0.001), ("in.b", 0.2)))
    of_run = outcome(run(little, much, fail_on="1%"))
    assert of_run.headline.sentence.startswith("1 of 2 decks: in.b: 1 known bug: forces are off by at most 20 %")
    assert [case.case for case in of_run.unaccepted] == ["in.b"]


def test_large_effects_are_factors_and_verdicts_qualified(snapshot: SnapshotAssertion) -> None:
    effects = [effect(3.9e4, 4e4), effect(1.2e13, 1.2e13), effect(0.9, 0.1), effect(0.3, 0.7), effect(35000.0)]
    effects += [effect(9.0), effect(0.004, 1.004), effect(None), effect(2.0, name="surface/r")]
    said: dict[str, Any] = {
        f"{of.field}, relative {of.relative}, factor {of.factor}": (deck_wording.effect(of), deck_wording.in_brief(of))
        for of in effects
    }
    fields = [field("f"), field("f", until=40), field("p", "exact"), field("p", "exact", max_abs=3e-14)]
    said["verdicts"] = [deck_wording.verdict(of) for of in fields]
    assert said == snapshot
