"""``eos-ref adopt``: run all that is needed to know an engine, then bring the repository up to date."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from eos_ref import InputError
from lammps_cases.claims import model, verdicts
from lammps_cases.claims.probes import manual
from lammps_cases.comparison.store import open_store
from lammps_cases.engine.installations import Engine
from lammps_cases.engine.workers import Workers
from lammps_cases.findings import KNOWN, LEDGER, SEEN_ON, SHOWN_BY, engines
from lammps_cases.records.faults import MissingPart, part
from lammps_cases.records.files import write_atomically
from lammps_cases.records.progress import SILENT, Progress
from lammps_cases.records.run_record import CaseRecord, RunRecord
from lammps_cases.report import findings
from lammps_cases.run import campaign, provenance
from lammps_cases.scene import casefile
from lammps_cases.scene.casefile import Case
from lammps_cases.versions import baseline, evidence, groups, outcomes
from lammps_cases.versions.acceptance import accept
from lammps_cases.versions.change import Policy
from lammps_cases.versions.changes import compare
from lammps_cases.versions.inputs import table
from lammps_cases.versions.intake.record import (
    DOCUMENT,
    AdoptedInput,
    Adoption,
    ClaimRow,
    Difference,
    FindingRow,
    FindingStatus,
)
from lammps_cases.versions.outcomes import Side

T = TypeVar("T")


@dataclass(frozen=True)
class Intake:
    """What an engine is asked: cases, by default all that are not long, and probes of the manual."""

    engine: Engine
    jobs: int
    out: Path
    cases: Sequence[Case]
    probes: Sequence[manual.ManualProbe]
    bad_inputs: Sequence[table.BadWords]
    progress: Progress = SILENT
    resume: bool = False


def everything(engine: Engine, jobs: int, out: Path, progress: Progress = SILENT, resume: bool = False) -> Intake:
    """Return all that an engine is asked before it is known."""
    cases = casefile.select(casefile.load(), (), None)
    return Intake(engine, jobs, out, cases, manual.probes(), table.every(), progress, resume)


def collect(intake: Intake, baselines: Path) -> Adoption:
    """Run all cases, probes and bad inputs on an engine, and hold the outcome against what is known.

    The report of the cases is left in the folder ``run``, the record of all in ``adopt.json``. A fault of eos-ref after
    the cases are judged costs a part of that, and is noted in it.

    Raises
    ------
    EngineMissing
    InputError
        The engine has no version by which it could be known.
    """
    seconds: dict[str, float] = {}
    faults: list[MissingPart] = []
    command, store = provenance.command_line(), open_store()

    def timed(name: str, make: Callable[[], list[T]]) -> list[T]:
        begin = time.perf_counter()
        made = part(name, faults, make, list[T]())
        seconds[name] = round(time.perf_counter() - begin, 1)
        return made

    begin = time.perf_counter()
    run = campaign.run_cases(
        intake.cases,
        intake.engine,
        intake.jobs,
        intake.out / "run",
        campaign.Request(command),
        intake.progress,
        store,
        intake.resume,
    )
    if not run.engine.distribution:
        raise InputError("engine", "must say its version to be taken in", intake.engine.name)
    seconds["cases"] = round(time.perf_counter() - begin, 1)
    with Workers(intake.engine.site, intake.jobs) as workers:
        probes = [probe for probe in intake.probes if probe.made_in(run.engine.manual)]
        probed = timed("probes", lambda: manual.put(probes, workers, intake.progress))
        rows = timed("bad inputs", lambda: table.table(workers, intake.progress, intake.bad_inputs))
    whole = run.model_copy(update={"cases": [*run.cases, *probed]})
    known = part("nearest engine", faults, lambda: _against_known(run, intake.out / "run", baselines), ("", {}, ()))
    adoption = Adoption(
        engine=run.engine,
        date=run.date,
        command=command,
        findings=tuple(part("findings", faults, lambda: _finding_rows(whole), [])),
        claims=tuple(part("claims", faults, lambda: _claim_rows(whole), [])),
        inputs=tuple(AdoptedInput(row.id, row.words, row.reaction, row.text, row.ledger) for row in rows),
        unexplained=tuple(_differences(whole.cases, skipped=False)),
        skipped=tuple(_differences(whole.cases, skipped=True)),
        counts=run.summary,
        nearest=known[0],
        changed=known[1],
        differences=known[2],
        seconds=seconds,
        faults=faults,
    )
    DOCUMENT.write(intake.out / "adopt.json", adoption)
    return adoption


def _finding_rows(run: RunRecord) -> list[FindingRow]:
    rows = []
    for one in findings.of_run(run, LEDGER):
        status: FindingStatus = "there" if one.cases else "gone" if one.unseen else "not asked"
        if one.cases and one.unseen:
            status = "gone in some cases"
        entry, known = one.entry, run.engine.distribution in one.entry.engines
        cases, gone = tuple(one.cases), tuple(one.unseen)
        rows.append(FindingRow(entry.id, entry.title, entry.severity, status, known, one.listed, cases, gone))
    return rows


def _claim_rows(run: RunRecord) -> list[ClaimRow]:
    judged = verdicts.of_run(model.claims(), run, [case.case for case in run.cases])
    return [
        ClaimRow(
            one.claim.id,
            one.claim.text,
            one.verdict,
            tuple(sorted({name for evidence_ in one.evidence for name in evidence_.findings})),
            one.unexplained,
        )
        for one in judged
        if one.verdict in ("does not hold", "not run")
    ]


def _differences(cases: Sequence[CaseRecord], skipped: bool) -> list[Difference]:
    chosen = [case for case in cases if (case.verdict == "skipped" if skipped else not case.as_expected)]
    return [Difference(case.case, case.verdict, case.message) for case in chosen]


def _against_known(run: RunRecord, folder: Path, baselines: Path) -> tuple[str, dict[str, int], tuple[str, ...]]:
    """Return the nearest baseline, the distance of each, and what changed from the nearest, in sentences."""
    side = outcomes.of_run(run, folder)
    changes = {}
    for identity in sorted(baselines.glob(f"[!.]*/{baseline.IDENTITY}")):
        accepted = baseline.read(identity.parent)
        if accepted.engine.distribution != run.engine.distribution:
            changes[identity.parent.name] = compare(_shared(accepted, side), side, Policy())
    if not changes:
        return "", {}, ()
    changed = {name: len(change.different) for name, change in changes.items()}
    nearest = min(changed, key=lambda name: (changed[name], -list(changed).index(name)))
    grouped = groups.groups(changes[nearest].different)
    sides = nearest.removeprefix("lammps-"), run.engine.distribution
    return nearest, changed, tuple(group.sentence(*sides) for group in grouped)


def _shared(accepted: Side, side: Side) -> Side:
    """Return a baseline with those cases alone that the other side was asked."""
    return replace(accepted, cases={name: case for name, case in accepted.cases.items() if name in side.cases})


# --- the repository


def land(adoption: Adoption, run: Path, baselines: Path) -> list[Path]:
    """Bring the repository up to date: the engines of every finding, the baseline, and what follows from both.

    Raises
    ------
    InputError
        This is not a checkout.
    """
    if not (evidence.ROOT / "pyproject.toml").exists() or not evidence.TABLE.exists():
        raise InputError("adopt", "must run in a checkout of eos-ref to bring it up to date (--dry-run does not)")
    version = adoption.engine.distribution
    seen_on = {
        entry.id: engines_showing(SEEN_ON.get(entry.id, ()), version, adoption.findings, entry.id) for entry in LEDGER
    }
    write_atomically(engines.FILE, engines.document(tuple(sorted({*KNOWN, version})), seen_on))
    accepted = accept(run, f"taken in: {adoption.sentence}", baselines, adoption.command, with_failures=True)
    # Another process: this one has read the list of engines as it was.
    subprocess.run([sys.executable, "-m", evidence.__name__], check=True, cwd=evidence.ROOT)
    return [engines.FILE, accepted.folder, SHOWN_BY, evidence.TABLE]


def engines_showing(before: Sequence[str], version: str, rows: Sequence[FindingRow], name: str) -> tuple[str, ...]:
    """Return the engines that a finding was seen on, after an intake; what was not asked stays as it was."""
    row = next((row for row in rows if row.id == name), None)
    if row is None or row.status == "not asked":
        return tuple(before)
    others = [engine for engine in before if engine != version]
    return (*others, version) if row.cases else tuple(others)
