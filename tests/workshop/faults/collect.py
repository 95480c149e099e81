"""The campaign of `make power`: plant faults, measure the resolution, look for false alarms."""

from __future__ import annotations

import fnmatch
import hashlib
import time
from argparse import Namespace
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

from eos_ref import InputError
from eos_ref.errors import unknown
from lammps_cases.comparison.store import open_store
from lammps_cases.engine import installations
from lammps_cases.findings import LEDGER
from lammps_cases.records.journal import Parts
from lammps_cases.records.progress import Progress
from lammps_cases.records.run_record import EngineRecord
from lammps_cases.run.provenance import command_line, run_record
from lammps_cases.scene import casefile
from lammps_cases.scene.casefile import Case
from tests.workshop.faults import alarms, input_faults, output_faults, record, resolution, schedule, substitute
from tests.workshop.faults.fault import SECTIONS, Fault, by_id
from tests.workshop.faults.record import ControlRecord, FaultRecord, Power
from tests.workshop.faults.schedule import MutationPool


@cache
def faults(engine: str = "") -> dict[str, Fault]:
    """Return all faults by id, family after family, without those that an engine is known to have."""
    had = {entry.model_variant.stages for entry in LEDGER if entry.model_variant and entry.listed(engine)} - {None}
    families: Sequence[Mapping[str, Fault]] = (input_faults.faults(), output_faults.faults(), substitute.faults())
    every = [fault for family in families for fault in family.values()]
    return by_id(f for f in every if not (isinstance(f, substitute.FormulaFault) and f.stages in had))


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


def collect(given: Namespace, sections: Sequence[str], names: Sequence[str], progress: Progress) -> Power:
    """Run the sections, with the named faults; results in the folder from the same sources are kept.

    ``given`` has the options of `make power`.

    Raises
    ------
    InputError
        A fault that does not exist, a folder that cannot be written.
    EngineMissing
    """
    begin, planted = time.perf_counter(), record.planted(given.out)
    resolved = installations.resolve(given.engine)
    cases = casefile.select(casefile.load(), tag="quick" if given.quick_only else None)
    settings: dict[str, Any] = {"jobs": given.jobs, "store": open_store(), "progress": progress}
    controls: tuple[ControlRecord, ...] = ()
    records: tuple[FaultRecord, ...] = ()
    who = EngineRecord(name=given.engine)
    if "faults" in sections:
        with MutationPool(resolved, given.jobs, open_store(), given.all) as pool:
            who = pool.engine
            chosen = select(faults(who.distribution), names, given.family, given.sample)
            controls, records = _faults(pool, cases, chosen, planted, f"{given.quick_only} {given.all}", progress)
    measured = resolution.measure(cases, resolved, **settings) if "resolution" in sections else ()
    alarm_runs = alarms.measure(cases, resolved, **settings) if "alarms" in sections else ()
    return Power(
        command_line(),
        run_record(who, "").machine,
        {"name": who.name, "distribution": who.distribution, "library_sha256": who.library_sha256},
        whole=not (names or given.family or given.sample is not None) and "faults" in sections,
        quick_only=given.quick_only,
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
