"""Thermo output of LAMMPS' example decks against the logs that LAMMPS ships with them: `eos-ref logs`.

Each deck runs unmodified except for its number of steps, on one rank and on several, with every digit printed; on one
rank of the first engine once more with all atoms moved by about one ulp, which shows how fast rounding grows.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from eos_ref.errors import InputError
from lammps_cases.audit.examples import ExampleDeck, ShippedLog, columns_of, digest, shipped_log
from lammps_cases.comparison import store
from lammps_cases.engine.installations import Engine
from lammps_cases.engine.ranks import played
from lammps_cases.engine.workers import Failure, Workers
from lammps_cases.records.documents import SCHEMAS, Document
from lammps_cases.records.journal import Parts
from lammps_cases.records.progress import SILENT, Progress
from lammps_cases.records.wording import counted, number
from lammps_cases.run import provenance

Columns = Mapping[str, Sequence[float]]
DIGITS = 8  # that LAMMPS prints by default
ULP = 1e-14  # of positions of 32 to 128, rounded up
LIMIT = 3600.0  # seconds for one run of a deck
COUNTS = ("Step", "Time", "Atoms")  # columns that no force changes
NAME = "logs.json"


@dataclass(frozen=True)
class Played:
    """A deck run by a LAMMPS: on how many ranks, by how much its atoms were moved, thermo output or why not."""

    deck: str
    engine: str
    ranks: int
    moved: float = 0.0
    columns: dict[str, list[float]] = field(default_factory=dict)
    message: str = ""


@dataclass(frozen=True)
class Departure:
    """Where a column of two runs differs first, and by how much: there, and at the last step of both.

    Attributes
    ----------
    first, last : steps
    there, then : differences relative to the larger number
    """

    column: str
    first: int
    there: float
    last: int
    then: float


@dataclass(frozen=True)
class LogRow:
    """Two runs of a deck compared, on one engine; a message if one of them is missing."""

    deck: str
    what: str
    engine: str
    departures: tuple[Departure, ...]
    message: str = ""


@dataclass(frozen=True)
class Logs:
    """All comparisons, as ``logs.json`` holds them."""

    command: str
    steps: int
    rows: tuple[LogRow, ...]
    schema: str = SCHEMAS["logs"]


DOCUMENT = Document("logs", Logs)


def runs(folder: Path) -> Parts[Played]:
    """Return the journal ``runs.jsonl``, to which each run is added when it ends."""
    return Parts(folder / "runs.jsonl", Played)


def departures(one: Columns, other: Columns, digits: int | None = None) -> tuple[Departure, ...]:
    """Return where the columns of two runs differ, at the steps that both have.

    Parameters
    ----------
    digits : int, optional
        Digits that one of them was printed with: a unit in the last is no difference. By default all count.
    """
    mine, theirs = ({step: k for k, step in enumerate(run["Step"])} for run in (one, other))
    steps = sorted(mine.keys() & theirs.keys())
    found = []
    for column in (name for name in one if name in other and name not in COUNTS):
        pairs = [(one[column][mine[step]], other[column][theirs[step]]) for step in steps]
        away = [difference(a, b, digits) for a, b in pairs]
        if any(away):
            first = next(k for k, each in enumerate(away) if each)
            found.append(Departure(column, int(steps[first]), away[first], int(steps[-1]), away[-1]))
    return tuple(found)


def difference(a: float, b: float, digits: int | None = None) -> float:
    """Return the difference of two numbers relative to the larger; 0 if it is at most a unit in the last digit."""
    if a == b or (math.isnan(a) and math.isnan(b)):
        return 0.0
    if not math.isfinite(a - b):
        return math.inf
    larger = max(abs(a), abs(b))
    unit = 10.0 ** (math.floor(math.log10(larger)) + 1 - digits) if digits else 0.0
    return 0.0 if abs(a - b) <= 1.001 * unit else abs(a - b) / larger  # 1.001: of digits read as doubles


def collect(
    decks: Sequence[ExampleDeck],
    engines: Sequence[Engine],
    ranks: int,
    steps: int,
    folder: Path,
    command: str,
    progress: Progress = SILENT,
) -> Logs:
    """Run decks with every engine, on one rank and on several, and compare the runs; finished runs are kept.

    Raises
    ------
    InputError, EngineMissing
    """
    if ranks < 2:
        raise InputError("ranks", "must be 2 or more, as one is always run", ranks, "option --ranks")
    kept, rows = runs(folder), list[LogRow]()
    made = dict[str, dict[tuple[str, int, float], Played]]()
    for at, engine in enumerate(engines):
        forms = [(1, 0.0), (ranks, 0.0), *([(1, ULP)] if at == 0 else [])]
        with Workers(engine.site, 1) as workers:
            who = provenance.engine_record(engine, workers.identify().result())
            name = who.distribution or who.version_string
            for deck, (count, moved) in itertools.product(decks, forms):
                progress.advance(at, len(engines), f"{deck.name}, {counted(count, 'rank')}")
                key = store.fingerprint(deck.name, digest(deck.path.parent), who.library_sha256, count, steps, moved)
                run = kept.get(key)
                if run is None:
                    given = deck.path, count, steps, None, moved, LIMIT
                    found = workers.outcome(workers.call(played, *given, time_limit=LIMIT))
                    columns, message = ({}, found.message) if isinstance(found, Failure) else (columns_of(found), "")
                    run = kept.add(key, Played(deck.name, name, count, moved, columns, message))
                made.setdefault(deck.name, {})[name, count, moved] = run
    for deck in decks:
        rows += _rows(deck.name, [log for path in deck.logs if (log := shipped_log(path))], made[deck.name], ranks)
    return Logs(command, steps, tuple(rows))


def _rows(
    deck: str, logs: Sequence[ShippedLog], runs: Mapping[tuple[str, int, float], Played], ranks: int
) -> Iterator[LogRow]:
    names = list(dict.fromkeys(name for name, _, _ in runs))
    for name in names:
        alone = runs[name, 1, 0.0]
        for log in logs:
            for count in (1, ranks):
                what = f"log of {log.version} ({counted(log.ranks, 'rank')}), {counted(count, 'rank')}"
                yield _row(deck, what, runs[name, count, 0.0], log.columns, DIGITS)
        yield _row(deck, f"1 rank, {ranks} ranks", runs[name, ranks, 0.0], alone.columns)
        if name == names[0]:
            yield _row(deck, "1 rank, atoms moved by an ulp", runs[name, 1, ULP], alone.columns)
        else:
            yield _row(deck, f"1 rank, {names[0]}", alone, runs[names[0], 1, 0.0].columns)


def _row(deck: str, what: str, run: Played, other: Columns, digits: int | None = None) -> LogRow:
    usable = run.columns and other
    found = departures(other, run.columns, digits) if usable else ()
    return LogRow(deck, what, run.engine, found, "" if usable else run.message or "no run to compare with")


def table(logs: Logs) -> Iterator[str]:
    """Yield a table of Markdown: a row for each comparison, a column for each engine."""
    names = list(dict.fromkeys(row.engine for row in logs.rows))
    yield f"| deck | compared | {' | '.join(names)} |"
    yield f"|{(2 + len(names)) * '---|'}"
    cells = {(row.deck, row.what, row.engine): _cell(row) for row in logs.rows}
    for deck, what in dict.fromkeys((row.deck, row.what) for row in logs.rows):
        yield f"| {deck} | {what} | {' | '.join(cells.get((deck, what, name), '') for name in names)} |"


def _cell(row: LogRow) -> str:
    parts = [
        f"{each.column} {each.first}: {number(each.there, 2)}, {each.last}: {number(each.then, 2)}"
        for each in row.departures
    ]
    return row.message or "; ".join(parts) or "same"
