"""Cached judgements: of this run, in the journal in its folder; of earlier ones, in the store.

The journal is a file per case, written when the case is judged, and the only input of ``--resume``. A kill at any
moment costs only the cases in progress: an entry is written whole, after the arrays, which it verifies by their
hashes. A damaged or missing entry counts as not judged.

The store holds the judgement of an answer, which is judged again only if it differs by a bit. LAMMPS runs as in a
first run; the key follows from the case, the arrays that LAMMPS returned, its neighbour lists if they are
read, and the release whose findings are known. Only expected results are kept; differences are judged each time.
"""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from eos_ref import InputError
from lammps_cases.comparison import store
from lammps_cases.comparison.store import Arrays, Store, digest, fingerprint
from lammps_cases.engine.session import Answer
from lammps_cases.records import folders
from lammps_cases.records.case_parts import Predictions, Seconds
from lammps_cases.records.documents import SCHEMAS, Document
from lammps_cases.records.files import arrays_files, write_atomically
from lammps_cases.records.run_record import CaseRecord, EngineRecord, RunRecord
from lammps_cases.records.wording import counted
from lammps_cases.run.prepared_case import Answers, Outcomes
from lammps_cases.scene.casefile import Case

RESUME = "--resume"  # its name in messages
_RECORD = "record"
_LISTS = "lists"  # an entry with only this name: the judgement is that of the answer with its lists


class RunStart(BaseModel):
    """Identity of a run; resuming requires an equal one, except for the code."""

    model_config = ConfigDict(extra="forbid", populate_by_name=True)

    schema_: str = Field(SCHEMAS["journal"], alias="schema")
    run: RunRecord = Field(description="without cases, as it began")
    code: str
    context: str = Field("", description="hash of all that predictions depend on")
    cases: dict[str, str]


class Entry(BaseModel):
    """A judged case, and the hashes of its files of arrays by their names."""

    model_config = ConfigDict(extra="forbid")

    record: CaseRecord
    arrays: dict[str, str]


_START = Document("journal", RunStart)


@dataclass(frozen=True)
class CaseJournal:
    """The journal of a report folder in progress."""

    folder: Path

    @property
    def _entries(self) -> Path:
        return self.folder / folders.JOURNAL / "cases"

    @property
    def _start(self) -> Path:
        return self.folder / folders.JOURNAL / "run.json"

    def begun(self) -> RunStart | None:
        """Return the identity of the run in this folder; None without a readable one."""
        try:
            return _START.read(self._start)
        except InputError:
            return None

    def begin(self, now: RunStart, judged: Collection[str] = ()) -> RunStart:
        """Write the identity of the run, and return it; a resumed run keeps its own, with the cases ``judged``.

        Raises
        ------
        InputError
            The resumed run was a different one.
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
        entry = Entry(record=record, arrays={path.name: digest(path) for path in self.arrays(record.case)})
        write_atomically(self._entries / f"{record.case}.json", entry.model_dump_json(by_alias=True))

    def records(self, read: Mapping[str, CaseRecord] = MappingProxyType({})) -> dict[str, CaseRecord]:
        """Return the judged cases by name, known ones without reading; drop files that no entry verifies."""
        records = dict(read)
        vouched = {path for case in read for path in (self._entries / f"{case}.json", *self.arrays(case))}
        for path in sorted({*self._entries.glob("*.json")} - vouched):
            try:
                entry = Entry.model_validate_json(path.read_bytes())
            except (ValidationError, OSError):
                continue
            arrays = self.arrays(entry.record.case)
            if {file.name: digest(file) for file in arrays} == entry.arrays:
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
        """Return the judged cases whose entries or arrays no longer exist."""
        return [
            name
            for name, record in records.items()
            if not (record.harness_error or (self._entries / f"{name}.json").is_file())
            or (record.fields and not self.arrays(name))
        ]

    def forget(self) -> None:
        """Delete everything."""
        for folder in (folders.JOURNAL, "fields"):
            shutil.rmtree(self.folder / folder, ignore_errors=True)

    def arrays(self, case: str) -> list[Path]:
        """Return the files of a case's arrays."""
        return [path for path in arrays_files(self.folder / "fields", case) if path.is_file()]


def start(run: RunRecord, cases: Sequence[Case]) -> RunStart:
    """Return the identity of a run that begins with some cases."""
    context = store.context()
    hashes = {
        case.name: fingerprint(_text(case), [digest(case.source.parent / file) for file in case.scene.files])
        for case in cases
    }
    return RunStart(run=run, code=store.code(context), context=context, cases=hashes)


def _text(case: Case) -> tuple[object, ...]:
    """Return everything of a case except its name and the content of other files."""
    return case.about, case.tags, case.exercises, str(case.source), case.scene.model_dump_json()


def _check_same(begun: RunStart, now: RunStart) -> None:
    """Refuse to resume a run with another engine, other cases or options."""
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
    """Return the identity of a resumed run, with the cases that other code has judged."""
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


@dataclass(frozen=True)
class JudgedBefore:
    """The judgement of a case, in a store, and in the folder of a report.

    Attributes
    ----------
    store : the store of judgements
    key : of the case, and of LAMMPS' answer
    lammps : seconds that LAMMPS took this time
    """

    store: Store
    key: str
    lammps: float

    @classmethod
    def of(cls, store: Store, answers: Answers, engine: EngineRecord) -> JudgedBefore | None:
        """Return the place of the judgement of LAMMPS' answers; None for failures, which are judged at once."""
        given = [outcome for outcome in answers.outcomes if isinstance(outcome, Answer)]
        if len(given) < len(answers.outcomes):
            return None
        ready = answers.ready
        case = ready.case.name, _text(ready.case), ready.case.shipped, ready.atoms
        untimed = [replace(answer, seconds=0.0, run_seconds=()) for answer in given]
        key = fingerprint(*case, engine.name, engine.distribution, untimed)
        return cls(store, key, sum(answer.seconds for answer in given))

    def find(self, folder: Path, answers: Answers) -> CaseRecord | None:
        """Return the record, and copy its arrays into a folder; None: not judged yet.

        LAMMPS is run again for its neighbour lists, if answers with these were judged.
        """
        entry = self.store.read(self.key)
        if entry is not None and _LISTS in entry:
            lists: list[Any] = []
            with contextlib.suppress(Exception):  # judging runs LAMMPS again, and reports the failure
                lists = [answer.lists for answer in answers.with_lists() if isinstance(answer, Answer)]
            entry = self.store.read(fingerprint(self.key, lists)) if lists else None
        return None if entry is None else self._restored(folder, entry)

    def keep(self, folder: Path, record: CaseRecord, listed: Outcomes) -> None:
        """Keep a record whose arrays lie in a folder; ``listed``: the answers with lists, if these were judged."""
        contents = {path.name: path.read_bytes() for path in CaseJournal(folder).arrays(record.case)}
        contents[_RECORD] = record.model_dump_json(by_alias=True).encode()
        entry = {name: np.frombuffer(content, np.uint8) for name, content in contents.items()}
        lists = [answer.lists for answer in listed if isinstance(answer, Answer)]
        if lists:
            self.store.write(self.key, {_LISTS: np.array(len(lists))})
        self.store.write(fingerprint(self.key, lists) if lists else self.key, entry)

    def _restored(self, folder: Path, entry: Arrays) -> CaseRecord:
        contents = {name: array.tobytes() for name, array in entry.items()}
        record = CaseRecord.model_validate_json(contents.pop(_RECORD))
        for name, arrays in contents.items():
            write_atomically(folder / "fields" / name, arrays)
        record.seconds = Seconds(lammps=self.lammps, total=self.lammps)
        predictions = record.predictions.computed + record.predictions.stored
        record.predictions = Predictions(stored=predictions, judgements=1)
        return record
