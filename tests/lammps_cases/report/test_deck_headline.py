"""The headline of an audited deck, or of several, by record."""

from __future__ import annotations

import json
import math

import pytest

from lammps_cases.records import deck_wording, wording
from lammps_cases.records.case_parts import EffectRecord, FieldRecord
from lammps_cases.records.headline import of_decks, strictest
from lammps_cases.records.levels import allowed, severity_of
from lammps_cases.records.run_record import CaseRecord, RunRecord
from lammps_cases.report.findings import outcome
from tests.support.made_audits import (
    BUG,
    OTHER,
    acting,
    blame,
    broke,
    deck,
    effect,
    field,
    lost,
    outlook,
    run,
)

LARGE, BOTH = f"forces are 40 000 times too large ({BUG})", [effect(0.2), effect(15.0, 16.0, "heatflow", OTHER)]
MASS = "mass is 4e4 times rho0 V"
DIFFERS = [field("shift/v", "differs"), field("f", "differs"), field("rho")]


@pytest.mark.parametrize(
    ("case", "said"),
    [
        (deck(), "PASS: no difference in 11 fields"),
        (deck(fields=1, warnings=["a", "b"]), "PASS: no difference in 1 field; 2 warnings"),
        (
            deck(unchecked={"f": "bonds add to it", "drho": "bonds add to it", "chi": "absent"}, out_of_scope=["chi"]),
            "PASS: no difference in 11 fields; f and drho not checked (bonds add to it)",
        ),
        (
            deck(unchecked={"f": "bonds", "drho": "a", "rho": "b", "chi": "c", "cv": "d"}),
            "PASS: no difference in 11 fields; f, drho, rho, 2 more not checked",
        ),
        (deck(lost=lost(True, 24, 144)), "PASS: no difference in 11 fields; 24 of 144 atoms lost"),
        (
            deck(fields=[field("f", until=40), field("rho", until=60), field("drho")]),
            "PASS: no difference in 3 fields; checked to step 40 only",
        ),
        (deck(fields=0), "EMPTY: nothing was compared"),
        (
            deck(verdict="skipped", fields=0, message="built without RHEO"),
            "EMPTY: nothing was compared: built without RHEO",
        ),
        (
            deck(effects=[effect(4e-5)]),
            f"KNOWN BUGS: 1 known bug: forces are off by at most 0.004 % ({BUG})",
        ),
        (deck(effects=[effect(39999.0, 4e4)]), f"KNOWN BUGS: 1 known bug: {LARGE}"),
        (
            deck(acting=[acting()]),
            f"KNOWN BUGS: 1 known bug: every force is divided by 10 (m/rho0 = 10) ({BUG})",
        ),
        (
            deck(verdict="explained", effects=BOTH, acting=[acting("it does", "a"), acting("so it does", "b")]),
            "KNOWN BUGS: 4 known bugs: it does (a); so it does (b); 2 more",
        ),
        (
            deck(verdict="explained", effects=BOTH),
            f"KNOWN BUGS: 2 known bugs: heat flows are 16 times too large ({OTHER}); forces are off by at most 20 % "
            f"({BUG})",
        ),
        (
            deck(verdict="explained", fields=[field("f", "explained", explained_by=[BUG])]),
            f"KNOWN BUGS: 1 known bug: forces are wrong ({BUG})",
        ),
        (deck(verdict="explained", explained_by=["units"]), "KNOWN BUGS: 1 known bug: units"),
        (
            deck(verdict="refused", lost=lost(False), outlook=outlook("findings", BUG), effects=[effect(4e4, 4e4)]),
            f"FAIL: LAMMPS loses 800 of 1158 atoms by step 50, because of a known bug: {LARGE}",
        ),
        (
            deck(verdict="refused", lost=lost(False), outlook=outlook("findings", BUG), effects=BOTH),
            "FAIL: LAMMPS loses 800 of 1158 atoms by step 50, because of a known bug: forces are off by at most 20 % "
            f"({BUG}); 1 other known bug: heat flows are 16 times too large ({OTHER})",
        ),
        (
            deck(verdict="refused", engine_error="ERROR: x", ended="refused", outlook=outlook("set-up", because=MASS)),
            f"FAIL: unstable as set up: {MASS} (ERROR: x)",
        ),
        (
            deck(verdict="refused", lost=lost(False), outlook=outlook("set-up")),
            "FAIL: unstable as set up: LAMMPS loses 800 of 1158 atoms by step 50",
        ),
        (
            deck(verdict="refused", lost=lost(False), outlook=outlook("time step")),
            "FAIL: unstable because of the time step: LAMMPS loses 800 of 1158 atoms by step 50",
        ),
        (
            deck(verdict="refused", lost=lost(False), outlook=outlook("not understood")),
            "FAIL: LAMMPS loses 800 of 1158 atoms by step 50, which is not understood",
        ),
        (deck(broke=broke()), "FAIL: vx of atom 54 is nan at step 20"),
        (deck(broke=broke(column="f", value=math.inf, run=2)), "FAIL: f of atom 54 is inf at step 20 of run 2"),
        (
            deck(
                broke=broke("runaway", "energy", 6e56, step=40),
                outlook=outlook("findings", OTHER),
                effects=[effect(15.0, 16.0, "heatflow", OTHER)],
            ),
            "FAIL: energies run away from step 40 on, because of a known bug: "
            f"heat flows are 16 times too large ({OTHER})",
        ),
        (
            deck(verdict="differs", fields=DIFFERS, blame=blame()),
            "FAIL: shift/v differs at 43 of 256 atoms from step 0 on (new); f too",
        ),
        (
            deck(verdict="differs", fields=DIFFERS, blame=blame(), effects=[effect(0.2)], warnings=["a"]),
            "FAIL: shift/v differs at 43 of 256 atoms from step 0 on (new); f too; "
            f"1 known bug: forces are off by at most 20 % ({BUG}); 1 warning",
        ),
        (deck(verdict="crashed", ended="crashed", engine_error="SIGSEGV", fields=0), "FAIL: SIGSEGV"),
        (deck(verdict="differs", fields=0), "FAIL: differs"),
    ],
)
def test_a_deck(case: CaseRecord, said: str) -> None:
    of_run = outcome(run(case))
    assert str(of_run.headline) == said
    assert (of_run.exit_code != 0) == (of_run.headline.state == "FAIL") == bool(of_run.unaccepted)


@pytest.mark.parametrize(
    ("cases", "said"),
    [
        ([deck("in.a"), deck("in.b")], "PASS: no difference in 2 decks"),
        ([deck("in.a", fields=0), deck("in.b", fields=0)], "EMPTY: nothing was compared"),
        ([deck("in.a"), deck("in.b", effects=[effect(0.1)])], "KNOWN BUGS: 1 known bug in 1 of 2 decks"),
        (
            [
                deck("in.a", broke=broke()),
                deck("in.b", verdict="differs", fields=DIFFERS[:1], blame=blame()),
                *(deck(f"in.{k}", effects=[effect(0.1)]) for k in range(7)),
                *(deck(f"in.{k}") for k in range(7, 10)),
            ],
            "FAIL: 2 of 12 decks: in.a: vx of atom 54 is nan at step 20; in.b: shift/v differs at 43 of 256 atoms from "
            "step 0 on (new); 1 known bug in 7 others",
        ),
        (
            [deck(f"in.{k}", broke=broke()) for k in range(5)],
            "FAIL: 5 of 5 decks: in.0: vx of atom 54 is nan at step 20; in.1: vx of atom 54 is nan at step 20; 3 more",
        ),
    ],
)
def test_several_decks(cases: list[CaseRecord], said: str) -> None:
    of_run = outcome(run(*cases))
    assert str(of_run.headline) == said
    assert (of_run.exit_code != 0) == (of_run.headline.state == "FAIL")


def test_problems_of_the_run_come_first() -> None:
    assert str(of_decks([deck()], ["2 changes against the baseline"])) == (
        "FAIL: 2 changes against the baseline; no difference in 11 fields"
    )


@pytest.mark.parametrize(
    ("record", "level", "fails"),
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
    ],
)
def test_finding_fails_by_its_effect_on_the_deck(record: EffectRecord, level: str, fails: bool) -> None:
    of_run = outcome(run(deck(verdict="explained", effects=[record]), fail_on=level))
    assert (of_run.headline.state == "FAIL") == fails == (of_run.exit_code == 1)
    assert f"rejected by --fail-on {level}" in of_run.headline.sentence or not fails


def test_finding_without_a_measured_effect_is_severe() -> None:
    of_run = outcome(run(deck(acting=[acting()]), fail_on="99999%"))
    assert (of_run.headline.state, of_run.known) == ("FAIL", {BUG: "high"})


def test_only_decks_with_a_large_effect_fail() -> None:
    little, much = (deck(name, effects=[effect(of)]) for name, of in (("in.a", 0.001), ("in.b", 0.2)))
    of_run = outcome(run(little, much, fail_on="1%"))
    assert of_run.headline.sentence.startswith("1 of 2 decks: in.b: 1 known bug: forces are off by at most 20 %")
    assert [case.case for case in of_run.unaccepted] == ["in.b"]


def test_levels_are_ordered() -> None:
    assert [severity_of(of) for of in (math.inf, 0.2, 0.1, 0.02, 0.01, 1e-9)] == [
        "high", "high", "medium", "medium", "low", "low",
    ]  # fmt: skip
    assert strictest(["high", "0.5%", "medium"]) == "0.5%" and allowed("0.5%") == 0.005


@pytest.mark.parametrize("level", ["-1%", "1", "%", "1e9999%", "nan%", "1 %", "1.%"])
def test_no_level(level: str) -> None:
    with pytest.raises(ValueError, match="fail_on"):
        RunRecord.model_validate({"engine": {}, "reference": {}, "fail_on": level})


@pytest.mark.parametrize(
    ("of", "at_length", "in_brief"),
    [
        (effect(3.9e4, 4e4), "f is 40 000 times what it should be", "forces are 40 000 times too large"),
        (effect(1.2e13, 1.2e13), "f is 1.2e13 times what it should be", "forces are 1.2e13 times too large"),
        (effect(0.9, 0.1), "f is 1/10 of what it should be", "forces are 10 times too small"),
        (effect(0.3, 0.7), "f is 0.7 times what it should be", "forces are off by at most 30 %"),
        (
            effect(35000.0),
            "f is off by up to 35 000 times its largest right",
            "forces are off by up to 35 000 times",
        ),
        (effect(9.0), "f is wrong by up to 900 % of its largest value", "forces are off by at most 900 %"),
        (effect(0.004, 1.004), "f is wrong by up to 0.4 % of its largest value", "forces are off by at most 0.4 %"),
        (effect(None), "f is wrong where it should be 0", "forces are wrong where they should be 0"),
        (effect(2.0, name="surface/r"), "surface/r is wrong by up to 200 %", "values of surface/r are off by at most"),
    ],
)
def test_large_effects_are_factors(of: EffectRecord, at_length: str, in_brief: str) -> None:
    assert deck_wording.effect(of).startswith(at_length)
    assert deck_wording.in_brief(of).startswith(in_brief)


def test_numbers_of_times() -> None:
    assert [wording.times(of) for of in (1.25, 101.0, 1000.0, 34_987.0, 999_999.0, 1.2e13, math.inf)] == [
        "1.25", "101", "1 000", "35 000", "1 000 000", "1.2e13", "∞",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("record", "said"),
    [
        (field("f"), "pass"),
        (field("f", until=40), "pass to step 40"),
        (field("pressure", "exact"), "exact"),
        (field("pressure", "exact", max_abs=3e-14), "exact (same rounding)"),
    ],
)
def test_qualified_verdicts(record: FieldRecord, said: str) -> None:
    assert deck_wording.verdict(record) == said


def test_headline_survives_reading_back() -> None:
    before = run(deck(broke=broke()), fail_on="0.5%")
    after = RunRecord.model_validate_json(before.to_json())
    assert str(outcome(after).headline) == str(outcome(before).headline) and after.fail_on == "0.5%"
    printed = {"state": "FAIL", "sentence": "x", "findings": [], "statements": {}} | json.loads(before.to_json())
    assert RunRecord.model_validate(printed).cases[0].case == "in.deck"
