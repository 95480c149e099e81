"""The campaign of `make power`: faults planted, resolution measured, false alarms looked for."""

from __future__ import annotations

import fnmatch
import hashlib
import time
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

from eos_ref import InputError
from eos_ref.errors import unknown
from lammps_cases.comparison.prediction_keys import open_store
from lammps_cases.engine import installations
from lammps_cases.findings import LEDGER
from lammps_cases.records.journal import Parts
from lammps_cases.records.progress import Progress
from lammps_cases.records.run_record import EngineRecord
from lammps_cases.run.provenance import run_record
from lammps_cases.scene import casefile
from lammps_cases.scene.casefile import Case
from tests.workshop.faults import alarms, formula, input_faults, output_faults, record, resolution, schedule
from tests.workshop.faults.fault import SECTIONS, Fault, by_id
from tests.workshop.faults.record import ControlRecord, FaultRecord, Power
from tests.workshop.faults.schedule import MutationPool


@cache
def faults(engine: str = "") -> dict[str, Fault]:
    """Return all faults by id, family after family, without those that an engine is known to have."""
    had = {entry.model_variant.stages for entry in LEDGER if entry.model_variant and entry.listed(engine)} - {None}
    families: Sequence[Mapping[str, Fault]] = (input_faults.faults(), output_faults.faults(), formula.faults())
    every = [fault for family in families for fault in family.values()]
    return by_id(fault for fault in every if formula.stages(fault) not in had)


def select(
    faults: dict[str, Fault], names: Sequence[str], family: str | None = None, sample: int | None = None
) -> list[Fault]:
    """Return faults by name or wild-card pattern and by family; a sample is the same each time.

    Raises
    ------
    InputError
        A name that matches no fault.
    """
    for name in names:
        if not fnmatch.filter(faults, name):
            raise unknown("section or fault", name, (*SECTIONS, *faults))
    chosen = [
        fault
        for fault in faults.values()
        if family in (None, fault.family) and (not names or any(fnmatch.fnmatchcase(fault.id, name) for name in names))
    ]
    if sample is not None:
        drawn = sorted(chosen, key=lambda fault: hashlib.sha256(fault.id.encode()).digest())[:sample]
        chosen = [fault for fault in chosen if fault in drawn]
    if not chosen:
        raise InputError("faults", "none is left to plant")
    return chosen


def collect(
    sections: Sequence[str],
    names: Sequence[str],
    family: str | None,
    sample: int | None,
    quick_only: bool,
    every: bool,
    engine: str,
    jobs: int,
    folder: Path,
    command: str,
    progress: Progress,
) -> Power:
    """Run the sections requested; faults planted before in the same folder, by the same sources, are taken from there.

    Raises
    ------
    InputError
        A fault that does not exist, a folder that cannot be written.
    EngineMissing
    """
    begin, planted = time.perf_counter(), record.planted(folder)
    resolved = installations.resolve(engine)
    cases = casefile.select(casefile.load(), tag="quick" if quick_only else None)
    controls: tuple[ControlRecord, ...] = ()
    records: tuple[FaultRecord, ...] = ()
    measured: list[resolution.Resolution] = []
    alarm_runs: list[alarms.AlarmRun] = []
    who = EngineRecord(name=engine)
    if "faults" in sections:
        with MutationPool(resolved, jobs, open_store(), every) as pool:
            who = pool.engine
            chosen = select(faults(who.distribution), names, family, sample)
            controls, records = _faults(pool, cases, chosen, planted, f"{quick_only} {every}", progress)
    if "resolution" in sections:
        measured = resolution.measure(cases, resolved, jobs=jobs, store=open_store(), progress=progress)
    if "alarms" in sections:
        alarm_runs = alarms.measure(cases, resolved, jobs=jobs, store=open_store(), progress=progress)
    return Power(
        command,
        run_record(who, command).machine,
        {"name": who.name, "distribution": who.distribution, "library_sha256": who.library_sha256},
        whole=not (names or family or sample is not None) and "faults" in sections,
        quick_only=quick_only,
        seconds=round(time.perf_counter() - begin + planted.earlier, 1),
        controls=controls,
        faults=records,
        resolution=tuple(measured),
        alarms=tuple(alarm_runs),
    )


def _faults(
    pool: MutationPool,
    cases: Sequence[Case],
    chosen: Sequence[Fault],
    planted: Parts[FaultRecord],
    mode: str,
    progress: Progress,
) -> tuple[tuple[ControlRecord, ...], tuple[FaultRecord, ...]]:
    key = hashlib.sha256(f"{record.sources()} {pool.engine.library_sha256} {mode}".encode()).hexdigest()
    kept = {fault.id: planted.get(f"{key} {fault.id}") for fault in chosen}
    records = {id: of for id, of in kept.items() if of is not None}
    controls = record.controls(pool.prepare(schedule.in_order(cases), progress))
    for fault, detections in pool.plant([fault for fault in chosen if fault.id not in records]):
        of = record.fault_record(fault, detections, pool.quick)
        records[fault.id] = planted.add(f"{key} {fault.id}", of)
        progress.advance(len(records), len(chosen), fault.id)
    return controls, record.with_arguments([records[fault.id] for fault in chosen])
