"""Adoption of a LAMMPS: its runs, the status of findings in the ledger, and the updates of the repository."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from eos_ref import InputError
from lammps_cases.claims import verdicts
from lammps_cases.claims.probes import manual
from lammps_cases.engine.installations import Engine
from lammps_cases.findings import KNOWN, LEDGER, SEEN_ON, engines
from lammps_cases.records.files import write_atomically
from lammps_cases.records.run_record import RunRecord
from lammps_cases.report import findings
from lammps_cases.run import campaign
from lammps_cases.scene import casefile
from lammps_cases.versions import adopt, evidence, outcomes
from lammps_cases.versions.adopt import DOCUMENT, Adoption, FindingRow, Intake, collect, engines_showing
from lammps_cases.versions.inputs import table
from lammps_cases.versions.inputs.refusals import bad_inputs
from tests.support import made_runs
from tests.support.outcome import Outcome
from tests.support.pages import text_of

Run = Callable[..., Outcome]


@pytest.mark.lammps
@pytest.mark.slow
def test_findings_claims_and_inputs_of_an_engine(tmp_path: Path) -> None:
    """Adopt this environment's LAMMPS with a few cases, probes and inputs."""
    cases = casefile.select(casefile.load(), ("near-rho0.linear.2d", "forces.all.rk1.2d", "refused.range-hyphen"))
    probes = [probe for probe in manual.probes() if probe.id in ("specific-heat-zero", "rheo-restart")]
    some = [bad for bad in bad_inputs() if bad.id in ("specific-heat-zero", "region-inside-out")]
    record = collect(Intake(Engine(), 1, tmp_path, cases, probes, some, rounds=0), evidence.BASELINES)
    rows = {row.id: row for row in record.findings}
    for id, case in (
        ("force-per-volume", "forces.all.rk1.2d"),
        ("hyphen-range-accepted", "refused.range-hyphen"),
        ("specific-heat-zero", "probes.specific-heat-zero"),
    ):
        assert rows[id].cases == (case,)
    assert rows["cross-type-support"].status == "not asked"
    assert all(row.known for row in rows.values() if row.cases)
    assert [row.id for row in record.inputs] == ["specific-heat-zero", "region-inside-out"]
    assert record.unexplained == () and record.skipped == ()
    assert record.nearest.startswith("lammps-") and set(record.changed) < {f"lammps-{v}" for v in KNOWN}
    assert (tmp_path / "run" / "report.html").exists()
    assert DOCUMENT.read(tmp_path / "adopt.json") == record
    assert json.loads((tmp_path / "adopt.json").read_text())["schema"] == "eos-ref/adopt/1"
    html = adopt.render(record)
    assert all(words in html for words in (record.sentence, "hyphen-range-accepted", "every difference is reproduced"))


def test_page_begins_with_unexplained_cases_and_their_hypotheses() -> None:
    row = FindingRow("some-id", "A title", "high", "there", False, False, ("walls.a", "walls.b"), ())
    gone = replace(row, id="other-id", status="gone", expected=True, cases=(), gone=("walls.c",))
    record = Adoption(
        engine=made_runs.run().engine,
        date="2026-01-01",
        command="eos-ref adopt env",
        findings=(row, gone),
        claims=(),
        inputs=(),
        unexplained=(adopt.Difference("walls.d", "differs", "f is 3 bounds off"),),
        skipped=(),
        counts={"pass": 2, "differs": 1},
        hypotheses=("triage 1 of 1: 1 case", "  hypothesis: as if <c> were 2 c"),
        times=("time of B over A, all together: 1.5",),
        seconds={"cases": 2.0},
    )
    words = text_of(adopt.render(record))
    order = ["Unexplained (1)", "walls.d", "as if <c> were 2 c", "New against the nearest engine (1)", "some-id"]
    order += ["Gone (1)", "other-id", "time of B over A, all together: 1.5"]
    places = [words.index(text) for text in order[:1]] + [words.rindex(text) for text in order[5:6]]
    assert all(text in words for text in order) and places == sorted(places)


@pytest.mark.parametrize(
    ("before", "status", "after"),
    [
        (("1.0",), "there", ("1.0", "2.0")),
        (("1.0", "2.0"), "there", ("1.0", "2.0")),
        (("1.0", "2.0"), "gone", ("1.0",)),
        (("1.0", "2.0"), "not asked", ("1.0", "2.0")),
        (("1.0", "2.0"), None, ("1.0", "2.0")),
    ],
)
def test_engine_list_is_merged(
    before: tuple[str, ...], status: adopt.FindingStatus | None, after: tuple[str, ...]
) -> None:
    shown, gone = ("case",) * (status == "there"), ("case",) * (status == "gone")
    rows = [FindingRow("x", "t", "low", status, True, True, shown, gone)] if status else []
    assert engines_showing(before, "2.0", rows, "x") == after


def test_list_of_engines_round_trips() -> None:
    assert engines.FILE.read_text() == engines.document(KNOWN, SEEN_ON)
    assert {entry.id for entry in LEDGER} == SEEN_ON.keys()
    assert {engine for seen_on in SEEN_ON.values() for engine in seen_on} <= set(KNOWN)


@pytest.mark.parametrize(
    ("version", "known"),
    [
        ("2025.7.22.4.0", "2025.7.22.4.0"),
        ("2025.7.22.3.9", "2025.7.22.2.0"),
        ("2024.1.1", "2025.7.22.0.1"),
        ("2099.1.1", KNOWN[-1]),
        ("fork", KNOWN[-1]),
    ],
)
def test_nearest_engine(version: str, known: str) -> None:
    assert engines.nearest(version) == known


def test_update_needs_a_checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(evidence, "ROOT", tmp_path)
    with pytest.raises(InputError, match="must run in a checkout"):
        adopt.land(Adoption.__new__(Adoption), tmp_path, tmp_path)


def test_folder_of_a_run_is_not_overwritten(eos_ref_command: Run, tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text("{}")
    assert eos_ref_command("adopt", "env", "--out", tmp_path).code == 2


PARTS = {
    "": (adopt, "_"),
    "probes": (manual, "put"),
    "bad inputs": (table, "table"),
    "findings": (findings, "of_run"),
    "claims": (verdicts, "of_run"),
    "nearest engine": (outcomes, "of_run"),
    "page": (adopt, "render"),
}


@pytest.mark.parametrize("name", PARTS)
def test_failing_part_leaves_the_others(
    name: str, eos_ref_command: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An incomplete record updates nothing; a failing page does not make it incomplete."""

    def fails(*_: object, **__: object) -> None:
        raise RuntimeError("planted here")

    def run_cases(*_: object, **__: object) -> RunRecord:
        write_atomically(tmp_path / "out" / "run" / "run.json", (run := made_runs.run()).to_json())
        return run

    def land(adoption: Adoption, run: Path, baselines: Path) -> list[Path]:
        landed.append(run)
        return []

    landed = list[Path]()
    monkeypatch.setattr(campaign, "run_cases", run_cases)
    monkeypatch.setattr(adopt, "Workers", lambda *_: contextlib.nullcontext())
    monkeypatch.setattr(manual, "put", lambda *_: [])
    monkeypatch.setattr(table, "table", lambda *_: [])
    monkeypatch.setattr(adopt, "land", land)
    monkeypatch.setattr(*PARTS[name], fails, raising=False)
    code, out, err = eos_ref_command("adopt", "env", "--out", tmp_path / "out", "--baselines", tmp_path)
    lacks = [line for line in out.splitlines() if "planted here" in line]
    assert [line.partition(": Runtime")[0] for line in lacks] == ([f"  not in this report: {name}"] if name else [])
    assert code == (3 if name else 0) and "Traceback" not in out + err
    assert [fault.part for fault in DOCUMENT.read(tmp_path / "out" / "adopt.json").faults] in ([name], [])
    assert bool(landed) == (name in ("", "page"))
    assert (tmp_path / "out" / "adopt.html").exists() == (name != "page")
