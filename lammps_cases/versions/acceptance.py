"""Accept a run as the baseline of its engine, with a reason that is kept."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from eos_ref import InputError
from lammps_cases.records import folders
from lammps_cases.records.files import write_arrays, write_atomically
from lammps_cases.records.outcome import CaseOutcome
from lammps_cases.records.run_record import RunRecord, read_run
from lammps_cases.versions import baseline, outcomes
from lammps_cases.versions.baseline import ARRAYS, IDENTITY, REASONS, VERDICT_LINES, Identity
from lammps_cases.versions.change import Policy
from lammps_cases.versions.changes import Changes, compare
from lammps_cases.versions.outcomes import Side

QUICK = "quick"  # cases with this tag keep their arrays
BUSY = "is being replaced by another program"


@dataclass(frozen=True)
class Accepted:
    """An accepted baseline; ``changes`` is None if it is the first, ``written`` False if nothing changed."""

    folder: Path
    changes: Changes | None
    cases: int
    dropped: tuple[str, ...]
    written: bool


def accept(
    folder: Path,
    reason: str,
    baselines: Path,
    command: str = "",
    with_failures: bool = False,
    prune: bool = False,
) -> Accepted:
    """Accept the run of a report folder as the baseline of its engine.

    Cases that the run lacks are kept, or dropped if pruned. A kill at any moment leaves the
    old baseline or the new one.

    Raises
    ------
    InputError
        No reason, no run, a part of a run or an audit, unexpected failures unless these are to be accepted, a damaged
        baseline, or one of another engine or machine some of whose cases would remain.
    """
    if not reason.strip():
        raise InputError("reason", "must say why", reason)
    run = read_run(folder)
    _acceptable(run, folder, with_failures)
    return _take(run, folder, reason, baselines / baseline.engine_name(run.engine), command, prune)


def accept_decks(folder: Path, reason: str, target: Path, command: str = "", prune: bool = False) -> Accepted:
    """Accept the audits of a report folder, however they ended, as the baseline of their decks.

    There is one baseline for all engines, so that a deck is compared from one engine to the next.

    Raises
    ------
    InputError
        As `accept`; a deck that was not audited.
    """
    run = read_run(folder)
    for case in run.cases:
        if case.verdict == "error":
            raise InputError("deck", f"cannot be accepted: {case.message}", where=case.source)
    if target.exists() and any(target.iterdir()) and not (target / IDENTITY).exists():
        raise InputError("baseline", "must be a new folder, or hold an earlier baseline", str(target))
    return _take(run, folder, reason, target, command, prune)


def _take(run: RunRecord, folder: Path, reason: str, target: Path, command: str, prune: bool) -> Accepted:
    side = outcomes.of_run(run, folder)
    with folders.exclusive(target, "baseline", BUSY), folders.replacement(target) as partial:
        old = baseline.read(target) if (target / IDENTITY).exists() else None
        kept = {} if old is None or prune else {n: c for n, c in old.cases.items() if n not in side.cases}
        if old is not None and kept:
            _compatible(run, old, target)
        changes = None
        if old is not None:
            held = {name: case for name, case in old.cases.items() if name not in kept}
            changes = compare(replace(old, cases=held), side, Policy(bits=True, findings=True))
        dropped = () if old is None else tuple(sorted(old.cases.keys() - side.cases.keys() - kept.keys()))
        cases = {**kept, **side.cases}
        _arrays(partial, run, side, old, set(kept))
        _write(partial, run, cases)
        written = old is None or not _same(partial, target)
        if written:
            _reason(partial, target, " ".join(reason.split()), run, command, changes, dropped)
            folders.swap(partial, target)
    return Accepted(target, changes, len(cases), dropped, written)


def _acceptable(run: RunRecord, folder: Path, with_failures: bool) -> None:
    run.check_whole(folder)
    if run.shard:
        raise InputError("run", "must be whole (eos-ref merge joins its parts)", f"part {run.shard}", str(folder))
    if any(case.checks for case in run.cases):
        raise InputError("run", "must be one of cases, not the audit of a deck", where=str(folder))
    if not run.cases:
        raise InputError("run", "must hold a case", where=str(folder))
    bad = [case.case for case in run.cases if not case.as_expected]
    if bad and not with_failures:
        some = ", ".join(bad[:3]) + (", ..." if len(bad) > 3 else "")
        rule = "must be as expected throughout, unless --with-failures"
        raise InputError("run", rule, f"{len(bad)} unexpected failures: {some}", str(folder))


def _compatible(run: RunRecord, old: Side, target: Path) -> None:
    """Raise if one baseline would hold cases of two machines or two libraries."""
    rule = "must be that of the baseline, unless the run holds all its cases or --prune drops the others"
    if run.engine.library_sha256 != old.engine.library_sha256:
        raise InputError("library", rule, run.engine.library_sha256[:16], str(target))
    if baseline.machine_of(run) != old.machine:
        raise InputError("machine", rule, baseline.machine_of(run), str(target))


def _write(folder: Path, run: RunRecord, cases: dict[str, CaseOutcome]) -> None:
    identity = Identity(
        engine=run.engine,
        machine=baseline.machine_of(run),
        reference=run.reference,
        cases=len(cases),
        fields=sum(len(case.fields) for case in cases.values()),
    )
    # Name and place of the engine are not part of the baseline.
    baseline.DOCUMENT.write(folder / IDENTITY, identity, {"engine": {"name", "library"}})
    audited = {path.name for path in folder.glob(f"{outcomes.DECKS}/*")}
    write_atomically(folder / VERDICT_LINES, baseline.lines(cases, audited))


def _arrays(folder: Path, run: RunRecord, side: Side, old: Side | None, kept: set[str]) -> None:
    """Write the arrays of the quick cases of the run; those of kept cases are not changed."""
    for record in run.cases:
        if record.checks:
            outcomes.write_deck(folder / outcomes.DECKS / record.case, side.cases[record.case], side.folder)
        samples, arrays = side.samples(record.case), {}
        for field in record.fields if QUICK in record.tags else ():
            sample = samples.of(field.field)
            if sample is not None:
                bound_n = sample.bound_n.astype(np.float32)  # rounded up: half the size, never too strict
                bound_n = np.where(bound_n < sample.bound_n, np.nextafter(bound_n, np.float32(np.inf)), bound_n)
                arrays[field.field] = sample.values_n
                arrays[f"{field.field}.bound"] = bound_n
                arrays[f"{field.field}.step"] = np.array(-1 if sample.step is None else sample.step)
        if arrays:
            write_arrays(folder / ARRAYS / f"{record.case}.npz", arrays, compressed=True)
    for path in sorted((old.folder / ARRAYS).glob("*.npz")) if old else ():
        if path.stem in kept:
            write_atomically(folder / ARRAYS / path.name, path.read_bytes())
    for path in sorted((old.folder / outcomes.DECKS).glob("*/*.tsv")) if old else ():
        if path.parent.name in kept:
            write_atomically(folder / outcomes.DECKS / path.parent.name / path.name, path.read_bytes())


def _reason(
    partial: Path,
    target: Path,
    reason: str,
    run: RunRecord,
    command: str,
    changes: Changes | None,
    dropped: tuple[str, ...],
) -> None:
    earlier = (target / REASONS).read_text(encoding="utf-8") if (target / REASONS).exists() else ""
    entry = {
        "date": datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "reason": reason,
        "command": portable(command),
        "run": portable(run.command),
        "run_date": run.date,
        "cases": len(run.cases),
        "changes": None if changes is None else dict(changes.counts),
        "dropped": list(dropped),
    }
    write_atomically(partial / REASONS, earlier + json.dumps(entry, ensure_ascii=False) + "\n")


def portable(command: str) -> str:
    """Return a command in a form to be kept for other users: absolute paths reduced to their last part."""
    return re.sub(r"(?<![\w.~/])(?:/[^/\s']+)*/([^/\s']+)", r"\1", command)


def _same(partial: Path, target: Path) -> bool:
    """Return whether a baseline equals the existing one, apart from its reasons."""

    def content(folder: Path) -> dict[str, bytes]:
        files = (path for path in folder.rglob("*") if path.is_file() and path.name != REASONS)
        return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}

    return content(partial) == content(target)
