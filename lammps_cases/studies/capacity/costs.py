"""What a campaign costs per case, per shard and per particle, as measured."""

from __future__ import annotations

import json
import resource
import tempfile
import time
import tracemalloc
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from eos_ref.eos.table import FloatArray
from lammps_cases.engine.session import Answer
from lammps_cases.engine.workers import Failure, Workers, identify, solve
from lammps_cases.records.documents import SCHEMAS, Document
from lammps_cases.records.run_record import EngineRecord, read_run
from lammps_cases.run import campaign, flow, prepared_case
from lammps_cases.run.merge import merge
from lammps_cases.scene.casefile import Case, load

EDGES = (50, 100, 200, 316, 1000)  # particles along an edge of the scenes by which the cost of a particle is measured
SCENE = "many.surface"
LIMIT = 7200.0
QUANTILES = 101


@dataclass(frozen=True)
class JudgedScene:
    """A scene of so many particles: processor seconds of LAMMPS and of the judge, bytes of the process at most.

    Of LAMMPS on several ranks seconds of a clock; ``report``: bytes on disk.
    """

    particles: int
    lammps: float
    judge: float
    memory: int
    verdict: str = ""
    report: int = 0


@dataclass(frozen=True)
class SimulatedCampaign:
    """Cases dealt out to shards of so many workers, predictions computed or stored: seconds until all are judged."""

    cases: int
    shards: int
    workers: int
    predictions: str
    seconds: float


@dataclass(frozen=True)
class CampaignCosts:
    """Seconds are of a processor, all else bytes; of a case unless said otherwise.

    Attributes
    ----------
    worker : quantiles, evenly from the least to the most, of what a shipped case costs its worker, by predictions
    main, merge : seconds of the main process while cases are judged, and of a merge with its report
    base, held, record : the main process when it has as many cases as it keeps; more for each further one; at the end
    arrays, text, history : on disk: of fields, of run.json, of the history
    """

    engine: str
    machine: str
    cases: int
    worker: dict[str, tuple[float, ...]]
    main: float
    merge: float
    base: float
    held: float
    record: float
    arrays: float
    text: float
    history: float
    judged: tuple[JudgedScene, ...]
    simulated: tuple[SimulatedCampaign, ...] = ()
    schema: str = SCHEMAS["capacity"]

    def mean(self, predictions: str) -> float:
        """Return the mean seconds that a case costs its worker."""
        return float(np.trapezoid(self.worker[predictions]) / (QUANTILES - 1))


DOCUMENT = Document("capacity", CampaignCosts)


def _seconds(folder: Path) -> FloatArray:
    """Return what every case of a run cost its worker."""
    return np.array([sum(case.seconds.stages.values()) for case in read_run(folder).cases])


def _large(edge: int) -> Case:
    (case,) = [case for case in load() if case.name == SCENE]
    positions = case.scene.positions.model_copy(update={"cells": (edge, edge)})
    return replace(case, scene=case.scene.model_copy(update={"positions": positions}))


def _judged(site: str | None, case: Case, folder: Path) -> JudgedScene:
    """Task: run and judge a scene."""
    ready = prepared_case.prepare(case)
    begin = time.process_time()
    answers: list[Answer | Failure] = [solve(site, job) for job in ready.jobs]
    answered = time.process_time()
    record = flow.record_case(site, folder, ready, answers, EngineRecord(**identify(site)))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    alone = case.scene.engine.ranks == 1
    return JudgedScene(
        len(ready.atoms),
        answered - begin if alone else record.seconds.lammps,
        time.process_time() - answered,
        peak,
        record.verdict,
        sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()),
    )


def judged_apart(case: Case, folder: Path) -> JudgedScene:
    """Run and judge a scene in a process of its own, which writes into a folder."""
    with Workers(None, 1) as workers:
        outcome = workers.outcome(workers.call(_judged, case, folder, time_limit=LIMIT))
    assert not isinstance(outcome, Failure), outcome.message
    return outcome


def scenes(edges: Sequence[int] = EDGES) -> tuple[JudgedScene, ...]:
    """Judge scenes of so many particles along their edges, one of them once before: it may compile."""
    judged = []
    for edge in (edges[-2], *edges):
        with tempfile.TemporaryDirectory() as folder:
            judged.append(judged_apart(_large(edge), Path(folder)))
    return tuple(judged[1:])


def _timed(call: Callable[[], Any]) -> float:
    begin = time.process_time()
    call()
    return time.process_time() - begin


def measured(soak: Path, runs: dict[str, Path], scratch: Path) -> CampaignCosts:
    """Return the costs from the folder of `make soak`, and from whole runs with predictions computed and stored."""
    samples = [json.loads(line) for line in (soak / "samples").read_text().splitlines()]
    last, first = samples[-1], next(sample for sample in samples if sample["cases"] >= campaign.KEPT)
    cases, further = last["cases"], last["cases"] - first["cases"]
    tracemalloc.start()
    whole = read_run(runs["stored"])
    record = tracemalloc.get_traced_memory()[0] / len(whole.cases)
    tracemalloc.stop()
    files = [path.stat().st_size for path in (runs["computed"] / "fields").iterdir()]
    evenly = np.linspace(0, 1, QUANTILES)
    return CampaignCosts(
        engine=whole.engine.label,
        machine=whole.machine["kind"],
        cases=cases,
        worker={name: tuple(np.quantile(_seconds(folder), evenly).tolist()) for name, folder in runs.items()},
        main=(last["processor"] - first["processor"]) / further,
        merge=_timed(lambda: merge([runs["computed"]], scratch / "merged")) / len(whole.cases),
        base=first["memory"],
        held=(last["memory"] - first["memory"]) / further,
        record=record,
        arrays=sum(files) / len(whole.cases),
        text=(runs["stored"] / "run.json").stat().st_size / len(whole.cases),
        history=(soak / "history.sqlite").stat().st_size / cases,
        judged=scenes(),
    )
