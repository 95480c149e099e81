"""Probes: decks for claims that no scene can express, run by LAMMPS and shown to detect planted faults."""

from __future__ import annotations

import math
from collections.abc import Iterator
from fnmatch import fnmatchcase
from itertools import pairwise, permutations
from typing import Any, cast

import numpy as np
import pytest

from lammps_cases.claims.probes import PREFIX, manual, run
from lammps_cases.claims.probes.manual import ManualProbe, judge, put
from lammps_cases.claims.probes.run import Reply
from lammps_cases.engine.workers import Workers
from lammps_cases.findings import LEDGER
from lammps_cases.records.case_wording import error_text
from lammps_cases.records.run_record import CaseRecord
from tests.support.progress import Steps

BY_ID = {probe.id: probe for probe in manual.probes()}
# Probes of wrong statements of the manual, by the patterns of the findings.
REFUTED = {
    id: entry.id
    for entry in LEDGER
    for pattern in entry.applies_to
    for id in BY_ID
    if fnmatchcase(PREFIX + id, pattern)
}


# Probes gone wrong on purpose: the other expectation, or the control in the place of the deck.
def planted() -> list[ManualProbe]:
    found = []
    for probe in manual.probes():
        if probe.refused:
            changes: dict[str, Any] = {"id": f"planted-{probe.id}", "edits": ()}
        elif probe.accepted:
            changes = {"id": f"planted-{probe.id}", "edits": (("run 3", "fix 9 all nosuchstyle\nrun 3"),)}
        else:
            changes = {"id": f"planted-{probe.id}", "edits": probe.control}
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
def test_probe_detects_its_fault(id: str, records: dict[str, CaseRecord]) -> None:
    assert not records[f"planted-{id}"].as_expected, id


def test_no_finding_of_a_probe_is_stale() -> None:
    """Each pattern names probes; each probe has one finding at most."""
    named = [pattern for entry in LEDGER for pattern in entry.applies_to if pattern.startswith(PREFIX)]
    assert len(REFUTED) >= 50 and all(any(fnmatchcase(PREFIX + id, each) for id in BY_ID) for each in named)
    for id, finding in REFUTED.items():
        assert [e.id for e in LEDGER if e.covers(PREFIX + id)] == [finding]


def test_error_is_the_text_of_lammps_alone() -> None:
    text = "ERROR: Illegal fix rheo command: 1 (src/src/RHEO/fix_rheo.cpp:181)\nLast input line: fix 1 all rheo density"
    assert error_text(text) == "ERROR: Illegal fix rheo command: 1"


@pytest.mark.parametrize(
    ("keys", "complaint"),
    [
        ({}, "exactly one"),
        ({"accepted": True, "refused": "no"}, "exactly one"),
        ({"same": ()}, "control"),
        ({"measured": "a speed", "control": ()}, "needs a bound"),
        ({"accepted": True, "bound": "so"}, "nothing else has one"),
    ],
)
def test_probe_needs_one_expectation_and_a_control(keys: dict[str, Any], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        ManualProbe(id="x", about="X.", **keys)


def ran(log: str = "", **arrays: list[float]) -> Reply:
    return Reply("answered", arrays={name: np.array(values) for name, values in arrays.items()}, log=log)


def error(text: str) -> Reply:
    return Reply("refused", text)


SAME = ManualProbe(id="x", about="X.", same=(), control=(), times={"p": 2.0})


def said(probe: ManualProbe, *replies: Reply) -> str:
    """The message of a probe's record."""
    return judge(probe, replies).message


def test_inputs_are_deck_other_deck_and_control() -> None:
    probe = BY_ID["rheo-unit-cut"]
    edits = [line for deck in probe.inputs for line in deck if line.startswith("fix 1")]
    assert [line.split()[4:8] for line in edits] == [
        ["3.0", "quintic", "0", "shift"],
        ["6.0", "quintic", "0", "shift"],
        ["3.0", "quintic", "0", "shift"],
    ]
    assert "exclude/type" in edits[2] and "exclude/type" not in edits[0]


@pytest.mark.parametrize(
    ("replies", "message"),
    [
        ((ran(p=[1.0]), ran(p=[2.0]), ran(p=[3.0])), ""),
        ((ran(p=[1.0, 2.0]), ran(p=[2.0, 4.5]), ran(p=[3.0])), "p differs at 1 of 2 numbers, most 4.0 and 4.5"),
        ((ran(p=[1.0]), ran(p=[2.0, 1.0]), ran(p=[3.0])), "p differs: 1 and 2 atoms"),
        ((ran(p=[np.nan]), ran(p=[2.0]), ran(p=[3.0])), "p differs at 1 of 1 numbers, most nan and 2.0"),
        ((ran(p=[1.0]), ran(p=[2.0]), ran(p=[1.0])), "the probe is blind: its control passes (no difference)"),
        ((ran(p=[1.0]), ran(p=[2.0]), error("ERROR: no")), "the probe is blind: its control passes (ERROR: no)"),
    ],
)
def test_comparison_and_blind_control(replies: tuple[Reply, ...], message: str) -> None:
    assert said(SAME, *replies) == message


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
    assert said(accepted, ran(p=[np.inf])) == "p are NaN or infinite"


MEASURED = ManualProbe(id="x", about="X.", measured="a speed", bound="as it is", control=())


def measured(found: float, expected: float = 5.0, within: float = 0.25) -> Reply:
    """A deck with a measurement."""
    return ran(found=[found], expected=[expected], within=[within])


@pytest.mark.parametrize("number", [4.7, 4.75, 5.25, 5.3, math.nan, math.inf])
def test_number_is_measured_within_its_bound_or_not(number: float) -> None:
    record = judge(MEASURED, [measured(number), measured(9.0)])
    if abs(number - 5) <= 0.25:
        assert record.verdict == "pass"
        return
    assert record.verdict == "differs" and record.mismatch is not None and record.mismatch.fields == ["a speed"]
    assert record.message == f"a speed is measured as {number:.6g}, where 5 within 0.25 is expected"


def test_columns_equal_the_arrays_that_they_output() -> None:
    probe = ManualProbe(id="x", about="X.", columns={"rho": 2}, control=())
    wrong = Reply("answered", arrays={"q": np.array([[1.0, 1.1]]), "rho": np.array([1.3])})
    right = Reply("answered", arrays={"q": np.array([[1.0, 1.3]]), "rho": np.array([1.3])})
    assert judge(probe, [right, wrong]).verdict == "pass"
    assert said(probe, wrong, right) == "rho differs at 1 of 1 numbers, most 1.1 and 1.3"
    assert "the probe is blind" in said(probe, right, right)


def test_control_of_a_measurement_must_be_outside() -> None:
    assert "the probe is blind" in judge(MEASURED, [measured(5.0), measured(5.1)]).message


def test_entry_with_instances_expands_to_several_probes() -> None:
    several = [id for id in BY_ID if id.startswith("rheo-fix-modify.")]
    assert len(several) == 6 and "rheo-fix-modify" not in BY_ID
    assert BY_ID["sound.cubic"].edits == (("* linear", "* cubic 2.0"),)
    assert BY_ID["sound.cubic"].control == BY_ID["sound.linear"].control


def test_every_keyword_follows_every_other_directly() -> None:
    """In at least one of the orders tried."""
    words = {"thermal", "interface/reconstruct", "surface/detection", "shift", "rho/sum", "density", "speed/sound"}
    behind = set()
    for probe in (probe for id, probe in BY_ID.items() if id.startswith("rheo-keyword-order.")):
        order = [word for word in probe.edits[-1][1].split() if word in words]
        assert sorted(order) == sorted(words)
        behind |= set(pairwise(order))
    assert behind == set(permutations(words, 2))


def test_identical_decks_are_run_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each reply still reaches its probe."""
    asked: list[Any] = []

    def answer(workers: Any, inputs: Any, limit: float) -> Iterator[Reply]:
        asked.extend(inputs)
        return (ran(log=" ".join(given)) for given in inputs)

    monkeypatch.setattr(run, "put", answer)
    heard: list[tuple[str, list[str]]] = []
    monkeypatch.setattr(manual, "judge", lambda probe, of: heard.append((probe.id, [reply.log for reply in of])))
    chosen = [probe for id, probe in BY_ID.items() if id.startswith(("sound.", "rheo-exclude", "rheo-unit"))]
    put(chosen, cast("Workers", None))
    decks = [given for probe in chosen for given in probe.inputs]
    assert len(asked) == len(set(asked)) == len(set(decks)) < len(decks)
    assert [logs for _, logs in heard] == [[" ".join(map(str, given)) for given in probe.inputs] for probe in chosen]


def test_log_must_not_contain_a_text() -> None:
    quiet = ManualProbe(id="x", about="X.", lacks="WARNING", control=())
    assert said(quiet, ran(log="WARNING: no"), ran()) == "the log holds 'WARNING'"
    assert judge(quiet, [ran(), ran(log="WARNING: no")]).verdict == "pass"


def test_refusal_must_be_the_documented_one() -> None:
    refused = ManualProbe(id="x", about="X.", refused="out of bounds")
    right = judge(refused, [error("ERROR: Numeric index 3 is out of bounds")])
    assert (right.verdict, right.ended) == ("pass", "refused")
    assert said(refused, error("ERROR: Illegal fix command")).endswith("LAMMPS printed: ERROR: Illegal fix command")
    assert said(refused, ran(p=[np.nan])).startswith("LAMMPS accepts what the manual refuses, and p")


@pytest.mark.lammps
@pytest.mark.slow
def test_missing_style_is_detected() -> None:
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
