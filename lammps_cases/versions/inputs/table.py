"""Reactions of LAMMPS and the reference to bad input, each in its own process: measured, on disk, on a page."""

from __future__ import annotations

import fnmatch
import functools
import hashlib
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, Protocol

import numpy as np

from eos_ref.errors import unknown
from lammps_cases.claims.probes import run
from lammps_cases.claims.probes.probe import ERRORS, REACTIONS, Input, Reaction, reaction
from lammps_cases.claims.probes.run import Reply
from lammps_cases.engine.workers import Failure, Workers
from lammps_cases.findings import LEDGER
from lammps_cases.findings.entry import OutcomeFinding
from lammps_cases.records.documents import SCHEMAS, Document
from lammps_cases.records.files import csv_text, write_atomically
from lammps_cases.records.progress import SILENT, Progress
from lammps_cases.report.pages import frame
from lammps_cases.report.pages.frame import TableCell, TableRow
from lammps_cases.versions.inputs.generate import generated
from lammps_cases.versions.inputs.refusals import bad_inputs

TIME_LIMIT = 10.0  # seconds for an input in LAMMPS; the decks take 0.01
Agreement = Literal["both refuse", "both take it", "the reference alone refuses it", "LAMMPS alone refuses it"]
COLUMNS = (
    *("id", "area", "about", "kind", "mutation", "words", "refusal", "reaction", "text", "taken_for"),
    *("promise", "candidate", "ledger"),
)
ASSETS = Path(__file__).parent / "assets"
ALONE = "LAMMPS alone refuses it"
ABOUT = {
    "clear error": "an error that names the argument, its keyword or the value",
    "vague error": "an error that names none of the words",
    "misleading error": "an error that names other words of the command",
    "warning": "continues, with a warning in the log",
    "no effect": "continues silently; results are bit-identical to those without the bad argument",
    "silent acceptance": "continues silently, with different numbers",
    "silent NaN": "continues silently, to numbers that are not finite",
    "crash": "the process crashes",
    "hang": "the process does not end",
}


class BadWords(Protocol):
    """An input given to LAMMPS and to the reference; see `Generated` and `BadInput`."""

    @property
    def id(self) -> str:
        """Name."""

    @property
    def area(self) -> str:
        """Subject: the command, or part of a scene."""

    @property
    def words(self) -> str:
        """The commands that are wrong."""

    @property
    def promise(self) -> str:
        """The manual's statement about it, if any."""

    @property
    def refusal(self) -> str:
        """The reference's message; empty if it accepts the input."""

    @property
    def clear(self) -> tuple[str, ...]:
        """Words of which a clear error contains one."""

    @property
    def others(self) -> tuple[str, ...]:
        """Words by which an error names something else."""

    @property
    def input(self) -> Input:
        """The input of LAMMPS."""

    @property
    def control(self) -> Input:
        """The same without the mistake."""


@functools.cache
def every() -> tuple[BadWords, ...]:
    """Return all inputs: generated ones, then hand-written ones."""
    return (*generated(), *bad_inputs())


def select(patterns: Sequence[str]) -> tuple[BadWords, ...]:
    """Return the inputs whose ids match patterns; all without patterns.

    Raises
    ------
    InputError
        A pattern without a match.
    """
    for pattern in patterns:
        if not any(fnmatch.fnmatchcase(one.id, pattern) for one in every()):
            raise unknown("input", pattern, (one.id for one in every()))
    return tuple(one for one in every() if not patterns or any(fnmatch.fnmatchcase(one.id, of) for of in patterns))


@dataclass(frozen=True)
class InputRow:
    """One input, and LAMMPS' reaction.

    Attributes
    ----------
    area, about : command (or part of a scene), and its argument or keyword
    kind, mutation : kind of the argument, and how it was changed
    words : the input as a deck would hold it
    refusal : error message of the reference; empty if it accepts the input
    reaction, text : LAMMPS' reaction, and its message, or the numbers with which it continues
    taken_for : words of a legal input with the same numbers, if LAMMPS continues
    promise : the statement of LAMMPS' manual about it, if any
    candidate : whether LAMMPS continues, or dies, contrary to its manual
    ledger : id of the finding about it, if any
    """

    id: str
    area: str
    words: str
    refusal: str
    reaction: Reaction
    text: str
    about: str = ""
    kind: str = "scene"
    mutation: str = ""
    taken_for: str = ""
    promise: str = ""
    candidate: bool = False
    ledger: str = ""

    @property
    def agreement(self) -> Agreement:
        """Whether LAMMPS and the reference accept the input."""
        refused = self.reaction in ERRORS
        if self.refusal:
            return "both refuse" if refused else "the reference alone refuses it"
        return "LAMMPS alone refuses it" if refused else "both take it"


def row(bad: BadWords, reply: Reply, control: Reply | None = None) -> InputRow:
    """Return the row of an input from LAMMPS' reply to it, and to its control without the mistake."""
    kind, text = reaction(reply, bad.clear, bad.others, control)
    # A pattern matches inputs that LAMMPS accepts or dies of, an id an input with any ending.
    finding = next(
        (
            finding
            for pattern, finding in _expected().items()
            if pattern == bad.id or (kind not in ERRORS and fnmatch.fnmatchcase(bad.id, pattern))
        ),
        "",
    )
    refusal = bad.refusal
    return InputRow(
        bad.id,
        bad.area,
        bad.words,
        refusal,
        kind,
        text,
        about=getattr(bad, "about", ""),
        kind=getattr(bad, "kind", "scene"),
        mutation=getattr(bad, "mutation", ""),
        promise=bad.promise,
        candidate=bool(refusal and bad.promise) and kind not in (*ERRORS, "warning"),
        ledger=finding,
    )


@functools.cache
def _expected() -> Mapping[str, str]:
    """Return the findings by the patterns of the inputs that LAMMPS treats as they state."""
    of_inputs = (entry for entry in LEDGER if isinstance(entry, OutcomeFinding))
    return {pattern: entry.id for entry in of_inputs for pattern in entry.expected_inputs}


def table(
    workers: Workers, progress: Progress = SILENT, inputs: Sequence[BadWords] = (), time_limit: float = TIME_LIMIT
) -> list[InputRow]:
    """Run inputs, by default all, in LAMMPS.

    Parameters
    ----------
    workers : Workers
        Processes from which those with LAMMPS, which may die, are forked.
    progress : Progress, optional
        Advances with every input.
    time_limit : float
        Seconds for each input.
    """
    chosen = tuple(inputs) or every()
    controls = [one.control for one in chosen]
    keys = [one if isinstance(one, tuple) else id(one) for one in controls]  # jobs hold arrays, which are not hashable
    distinct = dict(zip(keys, controls, strict=True))
    replies = run.put(workers, [*distinct.values(), *(one.input for one in chosen)], time_limit, alone=True)
    of_control = {key: next(replies) for key in distinct}
    rows: list[InputRow] = []
    results: list[str] = []
    for k, (bad, key, reply) in enumerate(zip(chosen, keys, replies, strict=True), 1):
        rows.append(row(bad, reply, of_control[key]))
        results.append(digest(reply))
        progress.advance(k, len(chosen), "bad inputs")
    return _with_readings(rows, results)


def digest(reply: Reply) -> str:
    """Return a hash of the numbers with which LAMMPS ends; empty without numbers."""
    if reply.ended != "answered":
        return ""
    hashed = hashlib.sha256()
    for name, values in sorted(reply.arrays.items()):
        hashed.update(name.encode())
        hashed.update(np.ascontiguousarray(values).tobytes())
    return hashed.hexdigest()


def _with_readings(rows: Sequence[InputRow], results: Iterable[str]) -> list[InputRow]:
    """Name, for every bad input that LAMMPS accepts, the legal one of the same form with the same numbers."""
    of_form = [(one, (".".join(one.id.split(".")[:2]), result)) for one, result in zip(rows, results, strict=True)]
    legal: dict[tuple[str, str], str] = {}
    for one, key in of_form:
        if not one.refusal:
            legal.setdefault(key, one.words)
    return [replace(one, taken_for=legal.get(key, "")) if key[1] and one.refusal else one for one, key in of_form]


def counts(rows: Sequence[InputRow]) -> Mapping[tuple[str, str], Mapping[str, int]]:
    """Return how many inputs of each argument end in each way; those that the reference accepts separately."""
    by_argument: dict[tuple[str, str], dict[str, int]] = {}
    for one in rows:
        of = by_argument.setdefault((one.area, one.about), {})
        kind = one.reaction if one.refusal else one.agreement
        of[kind] = of.get(kind, 0) + 1
    return by_argument


@dataclass(frozen=True)
class InputTable:
    """All rows, and their LAMMPS."""

    command: str
    engine: dict[str, str]
    seconds: float
    rows: tuple[InputRow, ...]
    schema: str = SCHEMAS["inputs"]

    @property
    def reactions(self) -> Mapping[str, int]:
        """How many of the inputs that the reference refuses end in each way, the best first."""
        ends = Counter(row.reaction for row in self.rows if row.refusal)
        return {kind: ends[kind] for kind in REACTIONS if ends[kind]}

    @property
    def agreements(self) -> Mapping[str, int]:
        """How many inputs both sides accept, only one, or neither."""
        return dict(Counter(row.agreement for row in self.rows).most_common())

    @property
    def unexplained(self) -> tuple[InputRow, ...]:
        """Rows that contradict the manual, without a finding."""
        return tuple(row for row in self.rows if row.candidate and not row.ledger)


DOCUMENT = Document("inputs", InputTable)


def write(table: InputTable, folder: Path) -> None:
    """Write ``inputs.json``, ``inputs.csv`` and ``report.html``, one file that opens offline."""
    rows = ([getattr(row, name) for name in COLUMNS] for row in table.rows)
    write_atomically(folder / "inputs.csv", csv_text([COLUMNS, *rows]))
    DOCUMENT.write(folder / "inputs.json", table)
    write_atomically(folder / "report.html", _page(table))


def read(folder: Path) -> InputTable:
    """Return the table of a folder.

    Raises
    ------
    InputError
        No table, or one of another schema.
    """
    return DOCUMENT.read(folder / "inputs.json")


def changes(before: Sequence[InputRow], after: Sequence[InputRow]) -> list[tuple[InputRow, InputRow]]:
    """Return the inputs of both tables that end differently, or with another reading."""
    old = {row.id: row for row in before}
    pairs = [(old[row.id], row) for row in after if row.id in old]
    return [(a, b) for a, b in pairs if (a.reaction, a.taken_for) != (b.reaction, b.taken_for)]


def measure(
    chosen: Sequence[BadWords], site: str | None, jobs: int, command: str, progress: Progress = SILENT
) -> InputTable:
    """Give inputs to a LAMMPS (folder ``site``; None: of this environment) and to the reference."""
    begin = time.perf_counter()
    with Workers(site, jobs) as workers:
        who = workers.outcome(workers.identify())
        rows = table(workers, progress, chosen)
    seconds = round(time.perf_counter() - begin, 1)
    return InputTable(command, {} if isinstance(who, Failure) else who, seconds, tuple(rows))


def _page(table: InputTable) -> str:
    kinds = [kind for kind in REACTIONS if kind in table.reactions]
    return frame.page(
        ASSETS,
        "inputs",
        "bad" if table.unexplained else "good",
        engine=table.engine.get("distribution", ""),
        scripts=[frame.FILTER],
        table=table,
        about=ABOUT,
        facts=[
            ("LAMMPS", table.engine.get("distribution") or table.engine.get("version_string", "")),
            ("inputs", len(table.rows)),
            ("took", f"{table.seconds:.0f} s"),
        ],
        columns=["argument", *(f"#{kind}" for kind in kinds), f"#{ALONE}"],
        arguments=list(_arguments(table, kinds)),
        # Ordinary rows are left out: refused by both with a clear error, or accepted by both.
        rows=[row for row in table.rows if not (row.agreement == "both take it" or row.reaction == "clear error")]
        + [row for row in table.rows if row.agreement == ALONE and row.reaction == "clear error"],
    )


def _arguments(table: InputTable, kinds: Sequence[str]) -> Iterator[TableRow]:
    """Yield a row for every argument: the endings of its bad inputs."""
    for (area, about), ends in counts(table.rows).items():
        cells = [TableCell(ends.get(kind, ""), "number") for kind in (*kinds, ALONE)]
        yield TableRow(f"{area}: {about}" if about and about != area else area, cells)
