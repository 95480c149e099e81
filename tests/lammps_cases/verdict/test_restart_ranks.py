"""A restart file written on one number of processes and read on another gives the same state and the same run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from lammps_cases.comparison.predictor import Predictor
from lammps_cases.engine.interlude import FOLDER, Carried, Interlude, InterludeAction
from lammps_cases.engine.session import Answer, Job, RunCommand
from lammps_cases.engine.workers import Workers
from lammps_cases.records.run_record import CaseRecord, EngineRecord
from lammps_cases.run.prepared_case import PreparedCase, prepare
from lammps_cases.scene import Scene, casefile
from lammps_cases.verdict.cases import compare_case

pytestmark = pytest.mark.lammps
ENGINE = EngineRecord(name="env", distribution="2025.7.22.4.0")
WRITES = {"write_restart"}


def restarted(name: str) -> PreparedCase:
    """Return a shipped case that goes through a restart file at step 5."""
    (case,) = casefile.select(casefile.load(), [name])
    content = case.scene.model_dump(exclude_unset=True)
    content["evolve"] |= {"stops": [{"at": 5, "by": "restart"}]}
    content["compare"] = [field for field in content["compare"] if field != "press"]  # which needs neighbour lists
    return prepare(replace(case, scene=Scene.model_validate(content), exercises=()))


def between(job: Job, ranks: int, folder: Path, *beginnings: str) -> Job:
    """Return a job on ``ranks`` processes with the actions that begin with ``beginnings``; files are in ``folder``."""

    def kept(action: InterludeAction) -> bool:
        return action.text.startswith(beginnings)

    def placed(action: InterludeAction) -> InterludeAction:
        return replace(action, text=action.text.replace(FOLDER, str(folder)))

    runs = tuple(
        replace(part, actions=tuple(map(placed, filter(kept, part.actions)))) if isinstance(part, Interlude) else part
        for part in job.runs
    )
    return replace(job, ranks=ranks, runs=runs)


def judged(workers: Workers, ready: PreparedCase, ranks: tuple[int, int], folder: Path, early: int = 0) -> CaseRecord:
    """Write on one number of processes, ``early`` steps too early, read on the other, and judge the continued run."""
    (job,) = ready.jobs
    others = {action.text.split()[0] for part in job.runs if isinstance(part, Interlude) for action in part.actions}
    writing, reading = between(job, ranks[0], folder, "write_restart"), between(job, ranks[1], folder, *others - WRITES)
    fewer = tuple(
        replace(part, command=part.command.replace("run 4", f"run {4 - early}"))
        if isinstance(part, RunCommand)
        else part
        for part in writing.runs
    )
    wrote = workers.outcome(workers.submit(replace(writing, runs=fewer), 60.0))
    read = workers.outcome(workers.submit(reading, 60.0))
    assert isinstance(wrote, Answer) and isinstance(read, Answer), (wrote, read)
    answer = replace(read, carried=(Carried(wrote.carried[0].before, read.carried[0].after),))
    return compare_case(ready.case, ready.eos, ready.atoms, answer, ENGINE, Predictor())[0]


@pytest.mark.parametrize("ranks", [(1, 2), (2, 1)])
@pytest.mark.parametrize("name", ["stretched.fluid.once", "stretched.surface.once"])
def test_number_of_processes_may_change(workers: Workers, name: str, ranks: tuple[int, int], tmp_path: Path) -> None:
    """Every attribute has the same bits after reading; then the run agrees with the reference, as always."""
    record = judged(workers, restarted(name), ranks, tmp_path)
    assert record.as_expected, record.message
    carried = {field.field: field.verdict for field in record.fields if "restart at 5" in field.field}
    assert {f"{name} (restart at 5)" for name in ("type", "x", "v", "rho", "rheo_status")} <= set(carried)
    assert set(carried.values()) == {"exact"} or carried.pop("x (restart at 5)") == "pass"


def test_file_of_another_step_is_detected(workers: Workers, tmp_path: Path) -> None:
    record = judged(workers, restarted("stretched.fluid.once"), (1, 2), tmp_path, early=1)
    assert record.verdict == "differs"
