"""Every deck of a folder, audited in processes of their own, a few at a time."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path

from eos_ref.errors import InputError
from lammps_cases.audit.options import AuditOptions, AuditResult
from lammps_cases.audit.settings import Settings, matches
from lammps_cases.audit.supervise import audit_deck, case_name
from lammps_cases.records.progress import SILENT
from lammps_cases.records.run_record import CaseRecord, EngineRecord, RunRecord
from lammps_cases.records.yaml_files import DECK

NAMES = ("in.*", "*.in", "*.lmp")
HEAD = 2**16  # bytes of a file that are looked at to see whether it is a deck


def decks(folder: Path, settings: Settings) -> list[str]:
    """Return the decks below a folder by their paths in it, sorted: files named as such, and those of the settings.

    Files that hold no command of a deck (data files are named *.lmp as well) and hidden folders are left out.

    Raises
    ------
    InputError
        There is none, or the settings name one that is not there.
    """
    for name in settings.decks:
        if not (folder / name).is_file():
            raise InputError("decks", "no such file", name, str(folder))
    found = {path.relative_to(folder) for pattern in NAMES for path in folder.rglob(pattern) if _is_deck(path)}
    names = {path.as_posix() for path in found if not any(part.startswith(".") for part in path.parts)}
    names = {name for name in names if not any(matches(name, pattern) for pattern in settings.skip)}
    if not names | {*settings.decks}:
        raise InputError("decks", f"must be files named {', '.join(NAMES)}", where=str(folder))
    return sorted(names | {*settings.decks})


def _is_deck(path: Path) -> bool:
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return DECK.search(file.read(HEAD).decode(errors="replace")) is not None


def audit_folder(folder: Path, options: AuditOptions, settings: Settings) -> list[AuditResult]:
    """Audit every deck below a folder, in the order of their names; bad input ends the audit of one deck alone.

    Raises
    ------
    InputError
        No deck, or two of one name.
    EngineMissing
    """
    names = decks(folder, settings)
    cases = {name: case_name(Path(name.replace("/", "_"))) for name in names}
    for name, case in cases.items():
        if list(cases.values()).count(case) > 1:
            raise InputError("deck", "must have a name of its own", name, str(folder))

    def one(name: str) -> AuditResult:
        try:
            own = settings.options(name, replace(options, progress=SILENT))
            result = audit_deck(folder / name, own)
        except InputError as error:
            return AuditResult(RunRecord(engine=EngineRecord(), reference={}, cases=[_refused(error)]), {}, {})
        return result

    results: dict[str, AuditResult] = {}
    with ThreadPoolExecutor(min(len(names), os.cpu_count() or 1)) as pool:
        running = {pool.submit(one, name): name for name in names}
        for done in as_completed(running):
            results[running[done]] = done.result()
            options.progress.advance(len(results), len(names), "decks")
    for name in names:
        record = results[name].record.cases[0]
        record.case, record.source = cases[name], str(folder / name)
    return [results[name] for name in names]


def _refused(error: InputError) -> CaseRecord:
    return CaseRecord(case="deck", tags=["audit"], verdict="error", ended="error", message=" ".join(str(error).split()))
