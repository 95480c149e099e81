"""What a run has judged so far: a file per case in its folder in the making, written when the case is judged.

A kill at any moment costs the cases under way and no other: an entry is written whole, after the arrays, for which it
vouches by their hashes. What is damaged, or has no entry, counts as not judged.
"""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from eos_ref import InputError
from lammps_cases.comparison import prediction_keys
from lammps_cases.records import folders
from lammps_cases.records.documents import SCHEMAS, Document
from lammps_cases.records.files import arrays_files, write_atomically
from lammps_cases.records.run_record import CaseRecord, RunRecord
from lammps_cases.records.wording import counted
from lammps_cases.scene.casefile import SHIPPED, Case

PACKAGES = ("eos_ref", "lammps_cases")
RESUME = "--resume"  # what complaints call it


class RunStart(BaseModel):
    """What a run is: whoever goes on with it has to be the same, but for the code."""

    model_config = ConfigDict(extra="forbid", populate_by_name=True)

    schema_: str = Field(SCHEMAS["journal"], alias="schema")
    run: RunRecord = Field(description="without cases, as it began")
    code: str
    context: str = Field("", description="hash of all that predictions depend on")
    cases: dict[str, str]


class Entry(BaseModel):
    """A case that is judged, and the hashes of its files of arrays by their names."""

    model_config = ConfigDict(extra="forbid")

    record: CaseRecord
    arrays: dict[str, str]


_START = Document("journal", RunStart)


@dataclass(frozen=True)
class CaseJournal:
    """The journal of a folder in the making."""

    folder: Path

    @property
    def _entries(self) -> Path:
        return self.folder / folders.JOURNAL / "cases"

    @property
    def _start(self) -> Path:
        return self.folder / folders.JOURNAL / "run.json"

    def begun(self) -> RunStart | None:
        """Return what the run was when it began; None if it begins now."""
        try:
            return _START.read(self._start)
        except InputError:
            return None

    def begin(self, now: RunStart, judged: Collection[str] = ()) -> RunStart:
        """Note what the run is, and return it; if it goes on it is as it began, with the cases that are ``judged``.

        Raises
        ------
        InputError
            It goes on as another.
        """
        if begun := self.begun():
            _check_same(begun, now)
            now = _resumed(begun, now, judged)
        else:
            self.forget()
        _START.write(self._start, now)
        return now

    def keep(self, record: CaseRecord) -> None:
        """Keep a case whose arrays are written."""
        entry = Entry(record=record, arrays={path.name: _hash(path) for path in self.arrays(record.case)})
        write_atomically(self._entries / f"{record.case}.json", entry.model_dump_json(by_alias=True))

    def records(self, read: Mapping[str, CaseRecord] = MappingProxyType({})) -> dict[str, CaseRecord]:
        """Return the cases that are judged by their names, those known unread; drop what no entry vouches for."""
        records = dict(read)
        vouched = {path for case in read for path in (self._entries / f"{case}.json", *self.arrays(case))}
        for path in sorted({*self._entries.glob("*.json")} - vouched):
            try:
                entry = Entry.model_validate_json(path.read_bytes())
            except (ValidationError, OSError):
                continue
            arrays = self.arrays(entry.record.case)
            if {file.name: _hash(file) for file in arrays} == entry.arrays:
                records[entry.record.case] = entry.record
                vouched |= {path, *arrays}
        kept = (self._entries, self.folder / "fields")
        for path in self.folder.rglob("*"):
            half_written = path.parent == self.folder and path.name.startswith(".")
            unvouched = path.parent in kept and path not in vouched and path != self._start
            if (half_written or unvouched) and path.is_file():
                path.unlink(missing_ok=True)
        return records

    def lost(self, records: Mapping[str, CaseRecord]) -> list[str]:
        """Return the cases that were judged and whose entries or arrays are there no more."""
        return [
            name
            for name, record in records.items()
            if not (record.harness_error or (self._entries / f"{name}.json").is_file())
            or (record.fields and not self.arrays(name))
        ]

    def forget(self) -> None:
        """Take everything away."""
        for folder in (folders.JOURNAL, "fields"):
            shutil.rmtree(self.folder / folder, ignore_errors=True)

    def arrays(self, case: str) -> list[Path]:
        """Return the files of a case's arrays."""
        return [path for path in arrays_files(self.folder / "fields", case) if path.is_file()]


def start(run: RunRecord, cases: Sequence[Case]) -> RunStart:
    """Return what a run is that begins with some cases."""
    context = prediction_keys.context()
    hashes = {case.name: _hash_of_case(case) for case in cases}
    return RunStart(run=run, code=code(context), context=context, cases=hashes)


def _hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def said(case: Case) -> tuple[object, ...]:
    """Return all that a case says but for its name, and what lies in other files."""
    return case.about, case.tags, case.exercises, str(case.source), case.scene.model_dump_json()


def _hash_of_case(case: Case) -> str:
    return prediction_keys.fingerprint(said(case), [_hash(case.source.parent / file) for file in case.scene.files])


def code(context: str = "") -> str:
    """Return the hash of all that judges and reports: the sources, and what predictions depend on beside them."""
    root = Path(__file__).parents[2]
    digest = hashlib.sha256((context or prediction_keys.context()).encode())
    for folder, below, names in (found for package in PACKAGES for found in os.walk(root / package)):
        below[:] = sorted(name for name in below if name != "__pycache__" and Path(folder, name) != SHIPPED)
        for path in (Path(folder, name) for name in sorted(names)):
            digest.update(f"{path.relative_to(root)} {_hash(path)}\n".encode())
    return digest.hexdigest()


def _check_same(begun: RunStart, now: RunStart) -> None:
    """Refuse to go on with a run of another engine, other cases or options."""
    one, other = begun.run, now.run
    rule = "needs the {} of the interrupted run"
    if one.engine != other.engine:
        raise InputError(RESUME, f"{rule.format('engine')}, {one.engine.label}", other.engine.label)
    if begun.cases != now.cases:
        raise InputError(RESUME, f"{rule.format('cases')}: {_difference(begun.cases, now.cases)}")
    options = [(run.fail_on, run.shard, ", ".join(sorted(run.allowed))) for run in (one, other)]
    for option, before, after in zip(("fail-on", "shard", "allow"), *options, strict=True):
        if before != after:
            raise InputError(RESUME, f"{rule.format(f'--{option}')}, {before or 'none'}", after or "none")


def _resumed(begun: RunStart, now: RunStart, judged: Collection[str]) -> RunStart:
    """Return a run that goes on, by the code that there is now: cases that other code has judged are named."""
    older = {case: what for case, what in begun.run.older.items() if case in judged}
    if (begun.context, begun.run.reference) != (now.context, now.run.reference):
        older = dict.fromkeys(judged, "reference")
    elif begun.code != now.code:
        older = {case: older.get(case, "code") for case in judged}
    changed = {"reference": now.run.reference, "machine": now.run.machine, "older": older}
    return now.model_copy(update={"run": begun.run.model_copy(update=changed)})


def _difference(before: Mapping[str, str], now: Mapping[str, str]) -> str:
    changed = [name for name in before if name in now and before[name] != now[name]]
    sets = {"new": [*now.keys() - before], "gone": [*before.keys() - now], "changed": changed}
    return ", ".join(f"{counted(len(names), 'case')} {what} ({min(names)})" for what, names in sets.items() if names)
