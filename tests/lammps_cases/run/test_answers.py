"""LAMMPS' answers in files."""

from __future__ import annotations

from pathlib import Path

import pytest

from lammps_cases.engine.session import Answer, Job
from lammps_cases.engine.workers import KeptAnswer
from lammps_cases.records.run_record import EngineRecord
from lammps_cases.run import prepared_case
from lammps_cases.run.flow import record_case
from lammps_cases.run.prepared_case import prepare
from lammps_cases.scene import casefile
from tests.support.outcome import Solver


@pytest.mark.lammps
def test_deleted_answer_is_requested_again(solver: Solver, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A cleaner of temporary files may delete answers while a run waits."""
    ready = prepare(next(case for case in casefile.load() if case.name == "near-rho0.linear.2d"))
    asked: list[Job] = []

    def solve(site: str | None, job: Job) -> Answer:
        asked.append(job)
        return solver(job)

    monkeypatch.setattr(prepared_case, "solve", solve)
    gone = KeptAnswer(tmp_path / "answer")
    record = record_case(None, tmp_path, ready, [gone], EngineRecord())
    assert record.verdict == "exact"
    assert len(asked) == 1
    prepared_case.discard([gone])
