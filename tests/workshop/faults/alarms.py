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
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
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
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan
from lammps_cases.verdict.particle_model import Reason
from tests.workshop.faults.perturbed import (
    JudgingWorkers,
    PerturbedCase,
    first_difference,
    rearranged,
    run_and_judge,
)
from tests.workshop.together import Asking, together

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
SETTINGS: dict[Kind, dict[str, Any]] = {
    "unsorted": {"sort": 0},
    "newton": {"newton": None},
    "skin": {"skin": 0.71},
    "rebuilt": {"every": 1, "delay": 0, "check": False},
}
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


def perturbed_case(kind: Kind, ready: PreparedCase, every_step: bool = False) -> PerturbedCase:
    """Return a case with the jobs of a kind, read at the steps compared or at every one."""
    p_n = np.random.default_rng(seed(f"{ready.case.name}/{kind}")).permutation(len(ready.atoms))
    ready = prepared_anew(ready.case) if kind == "seed" else ready
    others = [(_with_settings(scene, SETTINGS.get(kind, {})), atoms) for scene, atoms in ready.sides]
    jobs, row_n = [job(scene, atoms, plan(scene), every_step=every_step) for scene, atoms in others], None
    match kind:
        case "relabelled":
            jobs, row_n = [rearranged(one, p_n, one.id_n) for one in jobs], np.argsort(p_n)
        case "renamed":
            jobs, row_n = [replace(one, id_n=one.id_n[p_n]) for one in jobs], p_n
        case "reordered":
            jobs = [rearranged(one, p_n) for one in jobs]
        case "ranks":
            jobs = [replace(one, ranks=2) for one in jobs]
    return PerturbedCase(ready, tuple(jobs), row_n)


def prepared_anew(case: Case) -> PreparedCase:
    """Return a case with another seed; it keeps its name, by which the ledger knows it."""
    return replace(prepare(replace(case, name=f"{case.name}/another seed")), case=case)


def _with_settings(scene: Scene, settings: Mapping[str, Any]) -> Scene:
    """Return a scene with other settings of LAMMPS; newton is the other one."""
    engine = scene.engine
    other = {"newton": not engine.newton} if "newton" in settings else settings
    return scene.model_copy(update={"engine": engine.model_copy(update=other)})


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
                runs.append(alarm_run(kind, cases, plain, records, workers))
    if "machine" in kinds:  # by separate processes: the workers have ended by then
        here = run_apart(cases, engine, {}, jobs)
        there = run_apart(cases, engine, older(), jobs)
        moved = sum(there.references[name] != here.references[name] for name in here.references)
        runs.append(alarm_run("machine", cases, here.records, there.records, None, moved))
    return runs


def _records(workers: JudgingWorkers, kind: Kind, cases: Sequence[Case], progress: Progress) -> Records:
    """Return the record of every case by name; some cases are prepared while others run."""

    def judged(case: Case) -> Asking[CaseRecord]:
        perturbed = perturbed_case(kind, prepare(case.by(workers.judge.engine.manual)))
        record: CaseRecord | Failure = yield workers.judging(run_and_judge, perturbed)
        if isinstance(record, Failure):  # LAMMPS terminated the worker: the failure is judged here
            return workers.judge.verdict(perturbed, [record for _ in perturbed.jobs])
        return record

    records: Records = {}
    for record in together(workers, map(judged, cases), AHEAD):
        records[record.case] = record
        progress.advance(len(records), len(cases), f"alarms, {kind}: {record.case}")
    return records


def _reason(workers: JudgingWorkers, kind: Kind, case: Case) -> Reason | None:
    """Find the first difference, in a run read after every step; None without any."""
    scene = case.scene
    if not scene.whole_model or scene.twin or scene.snapshots[-1] < 1 or kind == "ranks":
        return None
    ready = prepare(case.by(workers.judge.engine.manual))
    first = workers.outcome(workers.judging(first_difference, perturbed_case(kind, ready, every_step=True)))
    return None if isinstance(first, Failure) else first


def alarm_run(
    kind: Kind,
    cases: Sequence[Case],
    plain: Records,
    records: Records,
    workers: JudgingWorkers | None = None,
    moved: int | None = None,
) -> AlarmRun:
    """Return what a restatement changed, with its alarms, whose first difference workers look for."""
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


def run_apart(cases: Sequence[Case], engine: Engine, settings: Mapping[str, str], jobs: int = 2) -> MachineRun:
    """Run cases by ``eos-ref run`` with some environment variables; without any, with the user's store.

    Raises
    ------
    RuntimeError
        The process left no report.
    """
    with tempfile.TemporaryDirectory(prefix="eos-ref-machine-") as folder:
        report = Path(folder) / "report"
        own = {VARIABLE: str(Path(folder) / "store")} if settings else {}
        here = os.pathsep.join([str(Path(__file__).parents[3]), *filter(None, [os.environ.get("PYTHONPATH")])])
        sources = sorted({str(case.source) for case in cases})
        program = [sys.executable, "-m", "lammps_cases.cli.main", "run", "--engine", engine.name, "--jobs", str(jobs)]
        program += ["--out", str(report), *(word for path in sources for word in ("--cases", path))]
        # No entry of the history: a run for a separate purpose. Its progress is shown as it shows it.
        environment = {**os.environ, **settings, **own, "EOS_REF_HISTORY": "off", "PYTHONPATH": here}
        names = [case.name for case in cases]
        subprocess.run([*program, *names], env=environment, stdout=subprocess.DEVNULL, check=False)
        if not (report / "run.json").exists():
            raise RuntimeError("eos-ref run on the other machine left no report")
        records = {record.case: record for record in read_run(report).cases}
        return MachineRun(records, {name: _reference(report / "fields" / f"{name}.npz") for name in records})


def _reference(file: Path) -> str:
    if not file.exists():
        return ""
    arrays = read_arrays(file)
    return digest(*(arrays[name] for name in sorted(arrays) if name.endswith(".reference")))
