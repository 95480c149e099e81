"""`audit`: what ``eos-ref audit`` does, as a function that returns the result and prints nothing."""

from __future__ import annotations

import shlex
import time
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

from eos_ref.errors import InputError
from lammps_cases.audit import settings
from lammps_cases.audit.finished import audit_dump
from lammps_cases.audit.folder import audit_folder
from lammps_cases.audit.keep import arrays_of
from lammps_cases.audit.options import AuditOptions, DeckLevelOptions, FinishedOptions
from lammps_cases.audit.restart import audit_restart
from lammps_cases.audit.supervise import audit_deck
from lammps_cases.engine import installations
from lammps_cases.engine.installations import Engine
from lammps_cases.records.checked import checked
from lammps_cases.records.files import write_arrays
from lammps_cases.records.options import flat
from lammps_cases.records.run_record import Level, RunRecord
from lammps_cases.report.findings import outcome
from lammps_cases.run import provenance, report_files
from lammps_cases.run.command import Result, report_folder
from lammps_cases.run.report_files import output_folder


@checked
@flat
def audit(
    deck: str | Path,
    *,
    finished: FinishedOptions,
    options: AuditOptions,
    level: DeckLevelOptions,
    out: str | Path | None = None,
) -> Result:
    """Check every atom while LAMMPS runs an input deck, unchanged, in a copy, as ``eos-ref audit`` does.

    Parameters
    ----------
    deck : path
        The input script.
    out : path, optional
        See `lammps_cases.run.command.run`.
    (options)

    Raises
    ------
    InputError
        Bad input, in one line.
    EngineMissing
        There is no LAMMPS with RHEO.
    """
    chosen, deck = installations.resolve(level.engine), Path(deck)
    options = replace(options, engine=chosen.site)
    words = [word for name, file in vars(finished).items() if file for word in (f"--{name}", str(file))]
    command = shlex.join(["eos-ref", "audit", str(deck), *words, *options.words()])
    with report_folder(out) as (folder, temporary):
        run = audit_into(folder, deck, options, chosen, command, level.level, finished)
        return Result(run, folder, temporary)


def audit_into(
    directory: Path,
    deck: Path,
    options: AuditOptions,
    engine: Engine,
    command: str,
    fail_on: Level,
    finished: FinishedOptions | None = None,
) -> RunRecord:
    """Audit a deck, all decks of a folder, or what a deck has written, and write the report into a folder.

    Options that are not given, and allowances of findings, are those of `settings.FILE` beside the decks.
    """
    dump, restart = (finished.dump, finished.restart) if finished else (None, None)
    if dump is not None and restart is not None:
        raise InputError("dump", "and restart must not be given together")
    begin, of_decks = time.perf_counter(), settings.read(deck if deck.is_dir() else deck.parent)
    with output_folder(directory) as folder:
        own = options if deck.is_dir() else of_decks.options(deck.name, options)
        if dump is not None:
            results = [audit_dump(dump, deck, own)]
        elif restart is not None:
            results = [audit_restart(restart, deck, own)]
        else:
            results = audit_folder(deck, own, of_decks) if deck.is_dir() else [audit_deck(deck, own)]
        who = next((result.who for result in results if result.who), {})
        run = provenance.run_record(provenance.engine_record(engine, who), command)
        run.cases, run.seconds = [result.record.cases[0] for result in results], time.perf_counter() - begin
        run.fail_on = fail_on
        run.allowed, run.notes = of_decks.allowed({*outcome(run).known}, datetime.now(UTC).date())
        for case, result in zip(run.cases, results, strict=True):
            if result.arrays:
                write_arrays(folder / "fields" / f"{case.case}.npz", result.arrays)
            if result.kept:
                write_arrays(folder / "fields" / f"{case.case}@kept.npz", arrays_of(result.kept))
        report_files.write_run(run.counted(), folder)
    return run
