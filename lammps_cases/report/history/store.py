"""An SQLite file of runs, and the stored forms of a run and of one of its cases.

The outcome of a case (`lammps_cases.records.outcome`) is kept once for all runs with the same outcome: a run of a
known engine costs a line per case. A run is added in one transaction: a kill leaves all or nothing of it, and writers
wait for each other. The rollback journal is used, not WAL, which needs shared memory and a folder that readers can
write.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import sqlite3
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import platformdirs

from eos_ref.errors import InputError
from lammps_cases.records.documents import LARGEST
from lammps_cases.records.files import read_bytes
from lammps_cases.records.outcome import CaseOutcome, FieldOutcome
from lammps_cases.records.run_record import EngineRecord, RunRecord, parse_run
from lammps_cases.records.wording import by_severity, finding_ids, kind, listed

VARIABLE = "EOS_REF_HISTORY"  # environment variable that names another file, or `off`
OFF = "off"
VERSION = 1  # of the schema, in user_version
APPLICATION = 0x454F5352  # "EOSR", in application_id: identifies our file
PATIENCE = 10.0  # seconds to wait for another writer
_SCHEMA = """
CREATE TABLE runs (
    id INTEGER PRIMARY KEY, sha256 TEXT NOT NULL UNIQUE, date TEXT NOT NULL,
    engine TEXT NOT NULL, distribution TEXT NOT NULL, version_string TEXT NOT NULL, git TEXT NOT NULL,
    library_sha256 TEXT NOT NULL, revision TEXT NOT NULL, reference TEXT NOT NULL, machine TEXT NOT NULL,
    command TEXT NOT NULL, strict INTEGER NOT NULL, shard TEXT NOT NULL, seconds REAL NOT NULL, counts TEXT NOT NULL);
CREATE TABLE outcomes (
    id INTEGER PRIMARY KEY, sha256 BLOB NOT NULL UNIQUE, case_name TEXT NOT NULL, verdict TEXT NOT NULL,
    expected INTEGER NOT NULL, natoms INTEGER NOT NULL, steps INTEGER NOT NULL, message TEXT NOT NULL,
    explained_by TEXT NOT NULL, worst, worst_field TEXT NOT NULL);
CREATE INDEX outcomes_of_case ON outcomes (case_name);
CREATE TABLE fields (
    outcome INTEGER NOT NULL REFERENCES outcomes ON DELETE CASCADE, place INTEGER NOT NULL, field TEXT NOT NULL,
    atom_type INTEGER, verdict TEXT NOT NULL, max_over_bound, max_abs, digest TEXT NOT NULL,
    explained_by TEXT NOT NULL, PRIMARY KEY (outcome, place)) WITHOUT ROWID;
CREATE TABLE results (
    run INTEGER NOT NULL REFERENCES runs ON DELETE CASCADE, outcome INTEGER NOT NULL REFERENCES outcomes,
    lammps REAL NOT NULL, reference REAL NOT NULL, PRIMARY KEY (run, outcome)) WITHOUT ROWID;
CREATE INDEX results_of_outcome ON results (outcome);
"""
_RUN = "id, sha256, date, engine, distribution, version_string, git, library_sha256, revision, reference, machine, "
_OUTCOME = "id, case_name, verdict, expected, natoms, steps, message, explained_by, worst, worst_field"


@dataclass(frozen=True)
class StoredRun:
    """A run without its cases; ``counts`` is the number of cases of each kind of verdict.

    ``revision`` is the git revision of eos-ref (empty: unknown), ``reference`` the versions of its packages.
    """

    id: int
    sha256: str
    date: str
    engine: EngineRecord
    revision: str
    reference: dict[str, str]
    machine: dict[str, str]
    command: str
    strict: bool
    shard: str
    seconds: float
    counts: dict[str, int]

    @classmethod
    def of(cls, run: RunRecord, sha256: str = "", revision: str = "") -> StoredRun:
        """Return a run record without its cases; ``revision`` is used if the run has none."""
        counts = dict(Counter(kind(case) for case in run.cases))
        engine = run.engine.model_copy(update={"library": "", "mpi": ""})  # a path, and redundant with the hash
        made_by = engine, run.reference.get("git", "") or revision, run.reference, run.machine
        return cls(0, sha256, run.date, *made_by, run.command, run.fail_on == "low", run.shard, run.seconds, counts)

    @property
    def cases(self) -> int:
        """Return the number of cases."""
        return sum(self.counts.values())

    @property
    def ordered_counts(self) -> dict[str, int]:
        """Return the counts, from the best verdict to the worst."""
        return by_severity(self.counts)

    @property
    def made_by(self) -> tuple[str, str]:
        """Return the eos-ref that judged: version and git revision."""
        return self.reference.get("eos-ref", ""), self.revision


@dataclass(frozen=True)
class StoredCase:
    """A case in a run: ids of the run and of the outcome, seconds in LAMMPS and in the reference."""

    run: int
    outcome: int
    case: str
    lammps: float
    reference: float


_RUN += "command, strict, shard, seconds, counts"


def history_file() -> Path | None:
    """Return the file of the user's history: that of `VARIABLE`, or in the user's data folder; None if switched off."""
    named = os.environ.get(VARIABLE)
    if named == OFF:
        return None
    return Path(named) if named else Path(platformdirs.user_data_dir("eos-ref")) / "history.sqlite"


def chosen_file(db: Path | None, made: bool) -> Path:
    """Return a history file by name, or the user's own.

    Raises
    ------
    InputError
        It does not exist, unless it may be ``made``, or the user's own is switched off.
    """
    if db is not None and not db.exists() and not made:
        raise InputError("history", "does not exist", where=str(db))
    place = db or history_file()
    if place is None:
        raise InputError("history", f"is switched off: {VARIABLE} is {OFF}; name a file with --db")
    return place


class History:
    """Runs kept in a file; a context manager. A file that does not exist is an empty history until a run is added.

    Raises
    ------
    InputError
        From all methods: the file is damaged, of a newer schema, of another program, or in use for too long.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._connection: sqlite3.Connection | None = None

    def __enter__(self) -> Self:
        with self._one_line_errors():
            if self.path.exists() and not self.path.is_file():
                raise InputError("history", "must be a regular file", where=str(self.path))
            if self.path.exists():
                connection = self._opened("rw")  # SQLite opens write-protected files for reading
                if _tables(connection):
                    self._connection = connection
                else:
                    connection.close()
        return self

    def __exit__(self, *exception: object) -> None:
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def add(self, run: RunRecord, content: bytes | str | None = None, revision: str = "") -> bool:
        """Keep a run; False if it was kept already. ``content`` is its run.json, written from the record if not given.

        ``revision`` is the git revision of eos-ref, used if the run has none.
        """
        content = run.to_json() if content is None else content
        sha256 = hashlib.sha256(content.encode() if isinstance(content, str) else content).hexdigest()
        with self._writing() as connection:
            row = _row_of(StoredRun.of(run, sha256, revision))
            cursor = connection.execute(f"INSERT OR IGNORE INTO runs ({_RUN}) VALUES (NULL{15 * ', ?'})", row)
            if not cursor.rowcount:
                return False
            number = cursor.lastrowid
            for case in run.cases:
                outcome = _outcome(connection, CaseOutcome.of(case))
                times = case.seconds.lammps, case.seconds.reference
                connection.execute("INSERT INTO results VALUES (?, ?, ?, ?)", (number, outcome, *times))
        return True

    def add_report(self, path: Path) -> None:
        """Keep the run of a report folder, or of the run.json in it."""
        folder = path.parent if path.name == "run.json" else path
        content = read_bytes(folder / "run.json", "run", LARGEST)
        self.add(parse_run(content, folder), content)

    def runs(self) -> list[StoredRun]:
        """Return all runs, by date."""
        rows = self._rows(f"SELECT {_RUN} FROM runs ORDER BY date, id")
        with self._one_line_errors():
            return [_read_run(row) for row in rows]

    def cases(self) -> list[str]:
        """List the names of all cases in any run."""
        return [name for (name,) in self._rows("SELECT DISTINCT case_name FROM outcomes ORDER BY case_name")]

    def results(self, runs: Iterable[int], cases: Sequence[str] | None = None) -> list[StoredCase]:
        """Return the cases of some runs, in the order of the runs' ids; all cases unless given."""
        chosen = "SELECT run, outcome, case_name, lammps, reference FROM results JOIN outcomes ON outcome = outcomes.id"
        chosen += " WHERE run IN (SELECT value FROM json_each(?))"
        given = [json.dumps(sorted(runs))]
        if cases is not None:
            chosen += " AND case_name IN (SELECT value FROM json_each(?))"
            given.append(json.dumps(list(cases)))
        return [StoredCase(*row) for row in self._rows(f"{chosen} ORDER BY run, case_name", *given)]

    def slowest(self) -> dict[str, float]:
        """Return the longest time, in LAMMPS and in the reference, that each case took in any run."""
        longest = "SELECT case_name, max(lammps + reference) FROM results JOIN outcomes ON outcome = outcomes.id"
        return dict(self._rows(f"{longest} GROUP BY case_name ORDER BY case_name"))

    def outcomes(self, ids: Iterable[int], fields: bool = True) -> dict[int, CaseOutcome]:
        """Return outcomes by their ids, optionally without their fields."""
        given = json.dumps(sorted(set(ids)))
        among = "IN (SELECT value FROM json_each(?))"
        of: dict[int, list[FieldOutcome]] = {}
        if fields:
            names = "outcome, field, atom_type, verdict, max_over_bound, max_abs, digest, explained_by"
            for row in self._rows(f"SELECT {names} FROM fields WHERE outcome {among} ORDER BY outcome, place", given):
                of.setdefault(row[0], []).append(_read_field(row))
        rows = self._rows(f"SELECT {_OUTCOME} FROM outcomes WHERE id {among}", given)
        return {row[0]: _read_outcome(row, of.get(row[0], ())) for row in rows}

    def forget(self, before: str) -> int:
        """Delete the runs dated before an ISO date and free their space; return their number."""
        if self._connection is None:
            return 0
        with self._writing() as connection:
            dropped = connection.execute("DELETE FROM runs WHERE date < ?", (before,)).rowcount
            connection.execute("DELETE FROM outcomes WHERE id NOT IN (SELECT outcome FROM results)")
        if dropped:
            with self._one_line_errors():
                connection.execute("VACUUM")
        return dropped

    def _rows(self, query: str, *given: str) -> list[tuple[Any, ...]]:
        if self._connection is None:
            return []
        with self._one_line_errors():
            return self._connection.execute(query, given).fetchall()

    @contextmanager
    def _writing(self) -> Iterator[sqlite3.Connection]:
        """Hold a transaction, on a file that is created if needed."""
        with self._one_line_errors():
            if self._connection is None:
                self.path.parent.mkdir(parents=True, exist_ok=True)
                self._connection = self._opened("rwc")
            connection = self._connection
            connection.execute("BEGIN IMMEDIATE")
            try:
                if not _tables(connection):
                    _make(connection)
                damage = connection.execute("PRAGMA quick_check(1)").fetchone()[0]
                if damage != "ok":  # do not write to a damaged database
                    raise sqlite3.DatabaseError(damage)
                yield connection
                connection.execute("COMMIT")
            finally:
                if connection.in_transaction:
                    connection.execute("ROLLBACK")

    def _opened(self, mode: str) -> sqlite3.Connection:
        place = f"{self.path.resolve().as_uri()}?mode={mode}"
        connection = sqlite3.connect(place, uri=True, timeout=PATIENCE, isolation_level=None)
        try:
            connection.execute("PRAGMA foreign_keys = ON")
            self._check(connection)
        except BaseException:
            connection.close()
            raise
        return connection

    def _check(self, connection: sqlite3.Connection) -> None:
        """Reject a file of another program or of a later eos-ref."""
        connection.execute("BEGIN")  # a consistent state: another process may be making the tables
        whose = connection.execute("PRAGMA application_id").fetchone()[0]
        version = connection.execute("PRAGMA user_version").fetchone()[0]
        tables = _tables(connection)
        connection.execute("COMMIT")
        if whose != APPLICATION and (tables or whose):
            raise InputError("history", "is the database of another program", where=str(self.path))
        if version > VERSION:
            rule = f"must be of schema {VERSION} or older; a newer eos-ref wrote it"
            raise InputError("history", rule, version, str(self.path))

    @contextmanager
    def _one_line_errors(self) -> Iterator[None]:
        """Report errors of the system and of SQLite in one line."""
        try:
            yield
        except InputError:
            raise
        except (OSError, OverflowError, ValueError, TypeError, AttributeError, sqlite3.Error) as error:
            reason = error.strerror if isinstance(error, OSError) else str(error)
            raise InputError("history", f"cannot be used: {reason}", where=str(self.path)) from None


def _tables(connection: sqlite3.Connection) -> int:
    count: int = connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
    return count


def _make(connection: sqlite3.Connection) -> None:
    for statement in _SCHEMA.split(";"):
        connection.execute(statement)
    connection.execute(f"PRAGMA application_id = {APPLICATION}")
    connection.execute(f"PRAGMA user_version = {VERSION}")


def _row_of(run: StoredRun) -> tuple[str | float, ...]:
    engine = run.engine
    reference, machine, counts = (json.dumps(each, sort_keys=True) for each in (run.reference, run.machine, run.counts))
    library = engine.name, engine.distribution, engine.version_string, engine.git, engine.library_sha256
    how = run.command, run.strict, run.shard, run.seconds
    return (run.sha256, run.date, *library, run.revision, reference, machine, *how, counts)


def _read_run(row: tuple[Any, ...]) -> StoredRun:
    key, sha256, date, name, distribution, version, git, library, revision, *rest = row
    reference, machine, command, strict, shard, seconds, counts = rest
    engine = EngineRecord.model_construct(
        name=name, distribution=distribution, version_string=version, git=git, library_sha256=library
    )
    versions, computer, counts = (json.loads(text) for text in (reference, machine, counts))
    how = command, bool(strict), shard, seconds
    return StoredRun(key, sha256, date, engine, revision, versions, computer, *how, counts)


def _read_outcome(row: tuple[Any, ...], fields: Sequence[FieldOutcome]) -> CaseOutcome:
    key, case, verdict, expected, natoms, steps, message, explained, worst, worst_field = row
    return CaseOutcome(
        case,
        verdict,
        bool(expected),
        explained_by=tuple(finding_ids(explained)),
        message=message,
        fields={field.name: field for field in fields},
        natoms=natoms,
        steps=steps,
        worst=_number(worst),
        worst_field=worst_field,
        id=key,
    )


def _read_field(row: tuple[Any, ...]) -> FieldOutcome:
    _, field, atom_type, verdict, ratio, largest, digest, explained = row
    findings = tuple(finding_ids(explained))
    return FieldOutcome(field, verdict, findings, _number(ratio), digest, atom_type=atom_type, max_abs=_number(largest))


def _outcome(connection: sqlite3.Connection, case: CaseOutcome) -> int:
    """Return the id of an outcome, which is added if no earlier run had it."""
    size = case.natoms, case.steps
    findings = listed(case.explained_by)
    row = (case.case, case.verdict, case.expected, *size, case.message, findings, _stored(case.worst), case.worst_field)
    fields = [_field_row(field) for field in case.fields.values()]
    sha256 = hashlib.sha256(repr((row, fields)).encode()).digest()
    stored = connection.execute("SELECT id FROM outcomes WHERE sha256 = ?", (sha256,)).fetchone()
    if stored:
        return int(stored[0])
    number = connection.execute(f"INSERT INTO outcomes VALUES (NULL, ?{9 * ', ?'})", (sha256, *row)).lastrowid
    assert number is not None
    connection.executemany(
        "INSERT INTO fields VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)",
        [(number, place, *field) for place, field in enumerate(fields)],
    )
    return number


def _field_row(field: FieldOutcome) -> tuple[str | float | None, ...]:
    numbers = _stored(field.max_over_bound), _stored(field.max_abs)
    return (field.field, field.atom_type, field.verdict, *numbers, field.digest, listed(field.explained_by))


def _stored(number: float | None) -> float | str | None:
    """Store NaN as text: SQLite would turn it into NULL, like a missing number."""
    return "nan" if number is not None and math.isnan(number) else number


def _number(stored: float | str | None) -> float | None:
    return None if stored is None else float(stored)
