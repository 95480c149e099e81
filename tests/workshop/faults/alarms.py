"""False alarms: nothing is wrong, so nothing may turn red.

Every kind restates the same physics for LAMMPS (other labels, another order, other lists, two ranks), gives both sides
another scene of the same description (another seed), or runs both on another machine. The answers are judged as
always, by the same bounds.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections import Counter, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from lammps_cases.comparison.store import VARIABLE, Store
from lammps_cases.engine.installations import Engine
from lammps_cases.engine.workers import Failure
from lammps_cases.findings import LEDGER
from lammps_cases.findings.entry import ModelFinding
from lammps_cases.records import case_wording
from lammps_cases.records.case_parts import digest
from lammps_cases.records.files import read_arrays
from lammps_cases.records.progress import SILENT, Progress
from lammps_cases.records.run_record import CaseRecord, read_run
from lammps_cases.run.prepared_case import PreparedCase, prepare
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import seed
from lammps_cases.scene.casefile import Case
from lammps_cases.verdict.particle_model import Reason
from tests.workshop.faults.perturbed import (
    JudgingWorkers,
    PerturbedCase,
    first_difference,
    rearranged,
    run_and_judge,
)

Kind = str
WHAT: dict[Kind, str] = {
    "as given": "the control: run as in every run",
    "relabelled": "other ids, dealt out at random, and with them another order of creation",
    "renamed": "other ids, dealt out at random, in the same order of creation",
    "reordered": "the same ids, created in another order",
    "unsorted": "particles not sorted in space (atom_modify sort 0)",
    "newton": "the other setting of newton",
    "skin": "a skin of neighbour lists of 0.71 spacings",
    "rebuilt": "neighbour lists built in every step, without a check",
    "ranks": "two MPI ranks",
    "seed": "another scene of the same description, on both sides: disorder, order of values, velocities",
    "machine": "newer instructions switched off in the C library, numpy, numba and OpenBLAS; predictions recomputed",
}
KINDS = tuple(WHAT)
AHEAD = 40  # cases prepared before they are judged
Records = dict[str, CaseRecord]


@dataclass(frozen=True)
class Alarm:
    """A case that turned red although nothing relevant was changed.

    Attributes
    ----------
    finding, why : the fault of LAMMPS behind it; empty: a false alarm, or an unknown fault
    """

    case: str
    kind: str
    verdict: str
    message: str
    finding: str = ""
    why: str = ""


@dataclass(frozen=True)
class AlarmRun:
    """All cases restated in one way.

    Attributes
    ----------
    what : the difference, in words
    cases : how many ran
    same_bits : how many of them gave every compared field with the bits of `as given`
    within : how many gave other bits and the verdict expected
    verdicts : number of cases by verdict
    alarms : those that are red here and not in `as given`
    reference_moved : in how many the reference has other bits; None if nothing could change it
    """

    kind: str
    what: str
    cases: int
    same_bits: int
    within: int
    verdicts: dict[str, int]
    alarms: tuple[Alarm, ...]
    reference_moved: int | None = None

    @property
    def false(self) -> int:
        """Return the number of alarms that no finding explains."""
        return sum(not alarm.finding for alarm in self.alarms)


# --- what LAMMPS is given


def perturbed_case(kind: Kind, ready: PreparedCase) -> PerturbedCase:
    """Return a case with the jobs of a kind."""
    p_n = np.random.default_rng(seed(f"{ready.case.name}/{kind}")).permutation(len(ready.atoms))
    jobs, row_n = ready.jobs, None
    match kind:
        case "seed":
            ready = prepared_anew(ready.case)
            jobs = ready.jobs
        case "relabelled":
            jobs, row_n = [rearranged(job, p_n, job.id_n) for job in jobs], np.argsort(p_n)
        case "renamed":
            jobs, row_n = [replace(job, id_n=job.id_n[p_n]) for job in jobs], p_n
        case "reordered":
            jobs = [rearranged(job, p_n) for job in jobs]
        case "ranks":
            jobs = [replace(job, ranks=2) for job in jobs]
        case "unsorted":
            jobs = [replace(job, setup=(*job.setup, "atom_modify sort 0 0.0")) for job in jobs]
        case "newton" | "skin" | "rebuilt":
            jobs = _with_settings(kind, ready).jobs
    return PerturbedCase(ready, tuple(jobs), row_n)


def prepared_anew(case: Case) -> PreparedCase:
    """Return a case with another seed; it keeps its name, by which the ledger knows it."""
    return replace(prepare(replace(case, name=f"{case.name}/another seed")), case=case)


def _with_settings(kind: Kind, ready: PreparedCase) -> PreparedCase:
    """Return a case with other settings of LAMMPS, in both the original and the twin."""

    def other(scene: Scene) -> Scene:
        settings: dict[Kind, dict[str, Any]] = {
            "newton": {"newton": not scene.engine.newton},
            "skin": {"skin": 0.71},
            "rebuilt": {"every": 1, "delay": 0, "check": False},
        }
        return scene.model_copy(update={"engine": scene.engine.model_copy(update=settings[kind])})

    twin = ready.twin
    if twin is not None:
        twin = replace(twin, scene=other(twin.scene), other_scene=other(twin.other_scene))
    return replace(ready, case=replace(ready.case, scene=other(ready.case.scene)), twin=twin)


# --- the runs


def measure(
    cases: Sequence[Case],
    engine: Engine,
    kinds: Sequence[Kind] = KINDS,
    jobs: int = 2,
    store: Store | None = None,
    progress: Progress = SILENT,
) -> list[AlarmRun]:
    """Run some cases restated in some ways; `as given` is always the first.

    Raises
    ------
    EngineMissing
    """
    runs = []
    with JudgingWorkers(engine, jobs, store) as workers:
        plain = _records(workers, "as given", cases, progress)
        for kind in dict.fromkeys(("as given", *kinds)):
            if kind != "machine":
                records = plain if kind == "as given" else _records(workers, kind, cases, progress)
                runs.append(_run(kind, cases, plain, records, workers))
    if "machine" in kinds:  # by separate processes: the workers have ended by then
        here = run_apart(cases, engine, {}, jobs, progress)
        there = run_apart(cases, engine, older(), jobs, progress)
        moved = sum(there.references[name] != here.references[name] for name in here.references)
        runs.append(_run("machine", cases, here.records, there.records, None, moved))
    return runs


def _records(workers: JudgingWorkers, kind: Kind, cases: Sequence[Case], progress: Progress) -> Records:
    """Return the record of every case by name; some cases are prepared while others run."""
    perturbed_cases = (perturbed_case(kind, prepare(case.by(workers.judge.engine.manual))) for case in cases)
    waiting = ((perturbed, workers.judging(run_and_judge, perturbed)) for perturbed in perturbed_cases)
    queue = deque(islice(waiting, AHEAD))
    records: Records = {}
    while queue:
        perturbed, future = queue.popleft()
        queue.extend(islice(waiting, 1))
        record = workers.outcome(future)
        if isinstance(record, Failure):  # LAMMPS terminated the worker: the failure is judged here
            record = workers.judge.verdict(perturbed, [record for _ in perturbed.jobs])
        name = perturbed.ready.case.name
        records[name] = record
        progress.advance(len(records), len(cases), f"alarms, {kind}: {name}")
    return records


def _reason(workers: JudgingWorkers, kind: Kind, case: Case) -> Reason | None:
    """Find the first difference, in a run read after every step; None without any."""
    scene = case.scene
    if not scene.whole_model or scene.twin or scene.snapshots[-1] < 1 or kind == "ranks":
        return None
    ready = prepare(case.by(workers.judge.engine.manual))
    first = workers.outcome(workers.judging(first_difference, perturbed_case(kind, ready)))
    return None if isinstance(first, Failure) else first


def _run(
    kind: Kind,
    cases: Sequence[Case],
    plain: Records,
    records: Records,
    workers: JudgingWorkers | None,
    moved: int | None = None,
) -> AlarmRun:
    same = {name for name, record in records.items() if _bits(record) == _bits(plain[name])}
    red = [
        case
        for case in cases
        if not records[case.name].as_expected and (kind == "as given" or plain[case.name].as_expected)
    ]
    return AlarmRun(
        kind,
        WHAT[kind],
        cases=len(records),
        same_bits=len(same),
        within=sum(record.as_expected and name not in same for name, record in records.items()),
        verdicts=dict(sorted(Counter(record.verdict for record in records.values()).items())),
        alarms=tuple(_alarm(kind, case, records[case.name], workers) for case in red),
        reference_moved=moved,
    )


def _bits(record: CaseRecord) -> tuple[str, list[tuple[str, str]]]:
    """Return the ending of a case, with the bits of every field."""
    return record.verdict, [(field.field, field.digest) for field in record.fields]


def _alarm(kind: Kind, case: Case, record: CaseRecord, workers: JudgingWorkers | None) -> Alarm:
    if workers and record.verdict == "differs" and (reason := _reason(workers, kind, case)):
        record = record.model_copy(update={"blame": reason.first, "beyond": reason.beyond})
        record.message = case_wording.message(record)
    return Alarm(case.name, kind, record.verdict, record.message, *_explanation(kind, case.scene, record))


def _explanation(kind: Kind, scene: Scene, record: CaseRecord) -> tuple[str, str]:
    """Return the finding that makes LAMMPS differ under this restatement alone, and why; empty: none."""
    for entry in LEDGER if record.verdict == "differs" else ():
        for expected in entry.expected_in_alarms if isinstance(entry, ModelFinding) else ():
            if kind in expected.kinds and expected.applies(scene):
                return entry.id, expected.why
    return "", ""


# --- another machine, as far as one machine can be another


@dataclass(frozen=True)
class MachineRun:
    """Cases run by a process of its own: their records, and digests of the reference's fields."""

    records: dict[str, CaseRecord]
    references: dict[str, str]


def older() -> dict[str, str]:
    """Return environment variables that disable features of newer processors; other libraries ignore them.

    The C library uses other code for pow, exp and log, which LAMMPS and the reference call, numpy and OpenBLAS use
    other loops, and numba compiles for a generic processor. Predictions are made in a separate store.
    """
    simd: Any = np.show_config(mode="dicts")
    extensions = simd["SIMD Extensions"].get("found", [])
    switches = {
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX,-AVX2,-FMA,-FMA4,-AVX512F",
        "NUMBA_CPU_NAME": "generic",
        "OPENBLAS_CORETYPE": "Nehalem",
    }
    return switches | ({"NPY_DISABLE_CPU_FEATURES": " ".join(extensions)} if extensions else {})


def run_apart(
    cases: Sequence[Case],
    engine: Engine,
    settings: Mapping[str, str],
    jobs: int = 2,
    progress: Progress = SILENT,
) -> MachineRun:
    """Run cases by ``eos-ref run`` with some environment variables; without any, with the user's store.

    Raises
    ------
    RuntimeError
        The process left no report.
    """
    with tempfile.TemporaryDirectory(prefix="eos-ref-machine-") as folder:
        report = Path(folder) / "report"
        own = {VARIABLE: str(Path(folder) / "store")} if settings else {}
        own["EOS_REF_HISTORY"] = "off"  # a run for a separate purpose
        here = os.pathsep.join([str(Path(__file__).parents[3]), *filter(None, [os.environ.get("PYTHONPATH")])])
        sources = sorted({str(case.source) for case in cases})
        program = [sys.executable, "-m", "lammps_cases.cli.main", "run", "--engine", engine.name, "--jobs", str(jobs)]
        program += ["--out", str(report), *(word for path in sources for word in ("--cases", path))]
        with subprocess.Popen(
            [*program, *(case.name for case in cases)],
            env={**os.environ, **settings, **own, "PYTHONPATH": here},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        ) as process:
            last = ""
            try:
                for line in process.stderr or ():
                    last = line.strip() or last
                    progress.advance(0, None, f"machine: {last}")
            except BaseException:
                process.terminate()
                raise
        if not (report / "run.json").exists():
            raise RuntimeError(f"eos-ref run on the other machine left no report: {last}")
        records = {record.case: record for record in read_run(report).cases}
        return MachineRun(records, {name: _reference(report / "fields" / f"{name}.npz") for name in records})


def _reference(file: Path) -> str:
    if not file.exists():
        return ""
    arrays = read_arrays(file)
    return digest(*(arrays[name] for name in sorted(arrays) if name.endswith(".reference")))
