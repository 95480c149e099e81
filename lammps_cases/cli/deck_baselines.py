"""Baselines of decks: what ``eos-ref audit`` accepts, and what it compares with; engines compared on decks."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lammps_cases.engine.installations import Engine
    from lammps_cases.records.run_record import RunRecord
    from lammps_cases.regression.sources import RunOptions
    from lammps_cases.run.options import CaseOptions


def readable(place: Path) -> None:
    """Make sure that there is a baseline, before anything runs.

    Raises
    ------
    InputError
    """
    from eos_ref import InputError
    from lammps_cases.records import folders
    from lammps_cases.regression.baseline import IDENTITY

    if not (folders.present(place) / IDENTITY).exists():
        raise InputError("baseline", "none is accepted here (eos-ref audit DECK --accept)", where=str(place))


def accepted(directory: Path, reason: str, place: Path, prune: bool) -> list[str]:
    """Accept the report of an audit as the baseline of its decks; return lines that say what changed."""
    from lammps_cases.records.wording import counted
    from lammps_cases.regression import pairs
    from lammps_cases.regression.acceptance import accept_decks
    from lammps_cases.run.provenance import command_line

    of = accept_decks(directory, reason, place, command_line(), prune)
    changes = [f"first baseline: {counted(of.cases, 'deck')}"]
    if of.changes is not None:
        changes = [*pairs.lines(of.changes, "the old", "the new"), *pairs.faults(of.changes)]
    dropped = [f"dropped: {', '.join(of.dropped)}"] if of.dropped else []
    return [*changes, *dropped, f"baseline: {of.folder}{'' if of.written else ' (unchanged)'}"]


def against(place: Path, run: RunRecord, directory: Path, deck: Path, as_json: bool) -> Iterable[str]:
    """Compare the audits of decks with a baseline; return lines, and keep in the run how many changes count."""
    from lammps_cases.regression import pairs
    from lammps_cases.regression.baseline import check_decks
    from lammps_cases.report.annotations import announce_changes
    from lammps_cases.run import report_files

    changes = check_decks(run, directory, place, whole=deck.is_dir())
    run.changed = len(changes.faults)
    if run.changed:
        report_files.write_run(run, directory)
    if not as_json:
        announce_changes([pairs.fault(change) for change in changes.faults], os.environ)
    return pairs.checked(changes, shlex.join(["eos-ref", "audit", str(deck), "--accept"]))


def on(deck: Path | None, how: RunOptions, cases: Sequence[str], options: CaseOptions) -> RunOptions:
    """Return how engines are compared: on cases, or by audits of a deck or of the decks of a folder.

    Raises
    ------
    InputError
        Cases and a deck.
    """
    from eos_ref import InputError
    from lammps_cases.audit.command import audit_into
    from lammps_cases.audit.options import AuditOptions

    if deck is None:
        return how
    if cases or options.tag or options.cases:
        raise InputError("--deck", "must not be given with cases")

    def judge(engine: Engine, folder: Path) -> RunRecord:
        return audit_into(folder, deck, AuditOptions(engine=engine.site), engine, how.command, "new")

    return replace(how, judge=judge)
