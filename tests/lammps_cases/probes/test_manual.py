"""Decks for what no scene can say: put to LAMMPS, and shown to see what they look for."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from lammps_cases.engine.workers import Workers
from lammps_cases.findings import LEDGER
from lammps_cases.probes import PREFIX, manual
from lammps_cases.probes.manual import ManualProbe, judge, put
from lammps_cases.probes.run import Reply
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.records.wording import error_text
from tests.support.progress import Steps

BY_ID = {probe.id: probe for probe in manual.probes()}
# Probes of statements that the manual makes and that are wrong.
REFUTED = {
    "rheo-sound-cs0-to-csn": "speed-sound-count",
    "rheo-unit-wmin": "support-unit",
    "pressure-taitwater": "style-taitwater",
    "pressure-unit-a3": "cubic-unit",
    "specific-heat-zero": "specific-heat-zero",
}


# Probes gone wrong on purpose: the other expectation, or the control in the place of the deck.
def planted() -> list[ManualProbe]:
    found = []
    for probe in manual.probes():
        if probe.refused:
            changes: dict[str, Any] = {"id": f"{probe.id}-planted", "edits": ()}
        elif probe.accepted:
            changes = {"id": f"{probe.id}-planted", "edits": (("run 3", "fix 9 all nosuchstyle\nrun 3"),)}
        else:
            changes = {"id": f"{probe.id}-planted", "edits": probe.control}
        found.append(probe.model_copy(update=changes))
    return found


@pytest.fixture(scope="module")
def records() -> dict[str, CaseRecord]:
    """All probes and their planted faults, on LAMMPS."""
    progress = Steps()
    chosen = [*manual.probes(), *planted()]
    with Workers(None, 2) as workers:
        found = put(chosen, workers, progress)
    assert progress.done == [(k + 1, len(chosen), "probes") for k in range(len(chosen))]
    return {one.case.removeprefix(PREFIX): one for one in found}


@pytest.mark.lammps
@pytest.mark.slow
@pytest.mark.parametrize("id", BY_ID)
def test_probe(id: str, records: dict[str, CaseRecord]) -> None:
    expected = "explained" if id in REFUTED else "pass"
    assert records[id].verdict == expected, records[id].message
    assert records[id].explained_by == ([REFUTED[id]] if id in REFUTED else [])
    assert records[id].as_expected


@pytest.mark.lammps
@pytest.mark.parametrize("id", BY_ID)
def test_probe_sees_its_fault(id: str, records: dict[str, CaseRecord]) -> None:
    assert not records[f"{id}-planted"].as_expected, id


def test_no_finding_of_a_probe_is_stale() -> None:
    named = {p.removeprefix(PREFIX) for e in LEDGER for p in e.applies_to if p.startswith(PREFIX)}
    assert named == set(REFUTED)


def test_error_is_lammps_words_alone() -> None:
    text = "ERROR: Illegal fix rheo command: 1 (src/src/RHEO/fix_rheo.cpp:181)\nLast input line: fix 1 all rheo density"
    assert error_text(text) == "ERROR: Illegal fix rheo command: 1"


def test_probe_needs_one_expectation_and_a_control() -> None:
    with pytest.raises(ValueError, match="exactly one"):
        ManualProbe(id="x", about="X.")
    with pytest.raises(ValueError, match="exactly one"):
        ManualProbe(id="x", about="X.", accepted=True, refused="no")
    with pytest.raises(ValueError, match="control"):
        ManualProbe(id="x", about="X.", same=())


def ran(log: str = "", **arrays: list[float]) -> Reply:
    return Reply("answered", arrays={name: np.array(values) for name, values in arrays.items()}, log=log)


def error(text: str) -> Reply:
    return Reply("refused", text)


SAME = ManualProbe(id="x", about="X.", same=(), control=(), times={"p": 2.0})


def said(probe: ManualProbe, *replies: Reply) -> str:
    """The message of a probe's record."""
    return judge(probe, replies).message


def test_inputs_are_the_deck_the_other_and_the_control() -> None:
    probe = BY_ID["rheo-unit-cut"]
    edits = [line for deck in probe.inputs for line in deck if line.startswith("fix 1")]
    assert [line.split()[4:8] for line in edits] == [
        ["3.0", "quintic", "0", "shift"],
        ["6.0", "quintic", "0", "shift"],
        ["3.0", "quintic", "0", "shift"],
    ]
    assert "exclude/type" in edits[2] and "exclude/type" not in edits[0]


def test_comparison() -> None:
    assert said(SAME, ran(p=[1.0]), ran(p=[2.0]), ran(p=[3.0])) == ""
    assert said(SAME, ran(p=[1.0, 2.0]), ran(p=[2.0, 4.5]), ran(p=[3.0])) == (
        "p differs at 1 of 2 numbers, most 4.0 and 4.5"
    )
    assert said(SAME, ran(p=[1.0]), ran(p=[2.0, 1.0]), ran(p=[3.0])) == "p differs: 1 and 2 atoms"
    assert "most nan and 2.0" in said(SAME, ran(p=[np.nan]), ran(p=[2.0]), ran(p=[3.0]))


def test_blind_control() -> None:
    blind = "the probe is blind: its control passes"
    assert said(SAME, ran(p=[1.0]), ran(p=[2.0]), ran(p=[1.0])) == f"{blind} (no difference)"
    assert said(SAME, ran(p=[1.0]), ran(p=[2.0]), error("ERROR: no")) == f"{blind} (ERROR: no)"


@pytest.mark.parametrize("at", [0, 1])
def test_decks_compared_must_run(at: int) -> None:
    replies = [ran(p=[1.0]), ran(p=[2.0]), ran(p=[3.0])]
    replies[at] = error("ERROR: no")
    assert judge(SAME, replies).verdict == "refused"
    replies[at] = Reply("timeout", "too long")
    assert judge(SAME, replies).verdict == "timeout"


def test_numbers_must_be_finite() -> None:
    accepted = ManualProbe(id="x", about="X.", accepted=True)
    assert judge(accepted, [ran(p=[1.0])]).verdict == "pass"
    assert said(accepted, ran(p=[np.inf])) == "p come out as NaN or infinite"


def test_log_must_not_hold_a_text() -> None:
    quiet = ManualProbe(id="x", about="X.", lacks="WARNING", control=())
    assert said(quiet, ran(log="WARNING: no"), ran()) == "the log holds 'WARNING'"
    assert judge(quiet, [ran(), ran(log="WARNING: no")]).verdict == "pass"


def test_refusal_must_be_the_one_promised() -> None:
    refused = ManualProbe(id="x", about="X.", refused="out of bounds")
    right = judge(refused, [error("ERROR: Numeric index 3 is out of bounds")])
    assert (right.verdict, right.ended) == ("pass", "refused")
    assert said(refused, error("ERROR: Illegal fix command")).endswith("LAMMPS said: ERROR: Illegal fix command")
    assert said(refused, ran(p=[np.nan])).startswith("LAMMPS accepts what the manual refuses, and p")


@pytest.mark.lammps
@pytest.mark.slow
def test_style_that_is_missing_is_seen() -> None:
    probe = BY_ID["rheo-oxidation"]
    missing = [(old, new.replace("rheo/oxidation", "rheo/nonsense")) for old, new in probe.edits]
    assert missing != list(probe.edits)
    with Workers(None, 1) as workers:
        (found,) = put([probe.model_copy(update={"edits": missing})], workers)
    assert not found.as_expected and "is_available" in found.message


def test_record_of_a_death() -> None:
    probe = ManualProbe(id="x", about="X.", refused="not a range")
    found = judge(probe, [Reply("crashed", "killed by SIGABRT")])
    assert (found.case, found.verdict, found.message) == ("probes.x", "crashed", "killed by SIGABRT")
