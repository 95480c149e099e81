"""A table of what LAMMPS does with bad input, each in a process of its own, beside what the reference says of it."""

from __future__ import annotations

import fnmatch
import functools
import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from eos_ref.errors import unknown
from lammps_cases.claims.probes import run
from lammps_cases.claims.probes.probe import ERRORS, Input, Reaction, reaction
from lammps_cases.claims.probes.run import Reply
from lammps_cases.engine.workers import Workers
from lammps_cases.findings import LEDGER
from lammps_cases.records.progress import SILENT, Progress
from lammps_cases.versions.inputs.generate import generated
from lammps_cases.versions.inputs.scenes import bad_inputs

TIME_LIMIT = 10.0  # seconds that LAMMPS has for an input; the decks take 0.01

Agreement = Literal["both refuse", "both take it", "the reference alone refuses it", "LAMMPS alone refuses it"]


class BadWords(Protocol):
    """What is put to LAMMPS and to the reference; see `Generated` and `BadInput`."""

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
        """What the manual says about it, if anything."""

    @property
    def refusal(self) -> str:
        """What the reference says; empty if it takes it."""

    @property
    def clear(self) -> tuple[str, ...]:
        """Words of which a clear error has one."""

    @property
    def others(self) -> tuple[str, ...]:
        """Words by which an error speaks of something else."""

    @property
    def input(self) -> Input:
        """What LAMMPS is given."""

    @property
    def control(self) -> Input:
        """The same without what is wrong."""


@functools.cache
def every() -> tuple[BadWords, ...]:
    """Return all inputs: those generated, then those by hand."""
    return (*generated(), *bad_inputs())


def select(patterns: Sequence[str]) -> tuple[BadWords, ...]:
    """Return the inputs that patterns of their ids fit; all without patterns.

    Raises
    ------
    InputError
        A pattern that fits none.
    """
    for pattern in patterns:
        if not any(fnmatch.fnmatchcase(one.id, pattern) for one in every()):
            raise unknown("input", pattern, (one.id for one in every()))
    return tuple(
        one for one in every() if not patterns or any(fnmatch.fnmatchcase(one.id, pattern) for pattern in patterns)
    )


@dataclass(frozen=True)
class InputRow:
    """One input, and what LAMMPS does with it.

    Attributes
    ----------
    area, about : command (or part of a scene), and its argument or keyword
    kind, mutation : what kind of argument, and what became of it
    words : the input as a deck would hold it
    refusal : error message of the reference; empty if it takes the input
    reaction, text : what LAMMPS does, and its message, or the numbers with which it goes on
    taken_for : words of a legal input with the same numbers, if LAMMPS goes on
    promise : what LAMMPS' manual says about it, if anything
    candidate : whether LAMMPS goes on, or dies, where its manual promises otherwise
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
        """Whether LAMMPS and the reference take the input."""
        refused = self.reaction in ERRORS
        if self.refusal:
            return "both refuse" if refused else "the reference alone refuses it"
        return "LAMMPS alone refuses it" if refused else "both take it"


def row(bad: BadWords, reply: Reply, control: Reply | None = None) -> InputRow:
    """Return the row of an input from LAMMPS' reply, and that to the same without what is wrong."""
    kind, text = reaction(reply, bad.clear, bad.others, control)
    # A pattern speaks of what LAMMPS takes or dies of, an id of whatever becomes of the input.
    named = (pattern for pattern in _expected() if pattern == bad.id or (kind not in ERRORS and _fits(bad.id, pattern)))
    finding = next((_expected()[pattern] for pattern in named), "")
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
    """Return the findings by the patterns of the inputs that LAMMPS treats as they say."""
    return {pattern: entry.id for entry in LEDGER for pattern in entry.expected_inputs}


def _fits(id: str, pattern: str) -> bool:
    return fnmatch.fnmatchcase(id, pattern)


def table(
    workers: Workers, progress: Progress = SILENT, inputs: Sequence[BadWords] = (), time_limit: float = TIME_LIMIT
) -> list[InputRow]:
    """Run inputs, by default all, in LAMMPS.

    Parameters
    ----------
    workers : Workers
        Processes from which those are forked in which LAMMPS may die.
    progress : Progress, optional
        Advances with every input.
    time_limit : float
        Seconds that LAMMPS has for each.
    """
    chosen = tuple(inputs) or every()
    controls = [Hashed(one.control) for one in chosen]
    distinct = list(dict.fromkeys(controls))
    replies = run.put(workers, [*(c.given for c in distinct), *(one.input for one in chosen)], time_limit, alone=True)
    of_control = {control: next(replies) for control in distinct}
    rows: list[InputRow] = []
    results: list[str] = []
    for k, (bad, control, reply) in enumerate(zip(chosen, controls, replies, strict=True), 1):
        rows.append(row(bad, reply, of_control[control]))
        results.append(digest(reply))
        progress.advance(k, len(chosen), "bad inputs")
    return _with_readings(rows, results)


class Hashed:
    """An input by identity, or by its words: jobs hold arrays, which have no hash."""

    def __init__(self, given: Input) -> None:
        self.given = given
        self._key: object = given if isinstance(given, tuple) else id(given)

    def __hash__(self) -> int:
        """Return the hash of the words."""
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        """Return whether two are the same."""
        return isinstance(other, Hashed) and self._key == other._key


def digest(reply: Reply) -> str:
    """Return a hash of the numbers with which LAMMPS ends; empty if it does not."""
    if reply.ended != "answered":
        return ""
    hashed = hashlib.sha256()
    for name, values in sorted(reply.arrays.items()):
        hashed.update(name.encode())
        hashed.update(np.ascontiguousarray(values).tobytes())
    return hashed.hexdigest()


def _with_readings(rows: Sequence[InputRow], results: Iterable[str]) -> list[InputRow]:
    """Say of every bad input that LAMMPS takes which legal one of the same form has its numbers."""
    from dataclasses import replace

    pairs = list(zip(rows, results, strict=True))
    legal: dict[tuple[str, str], str] = {}
    for one, result in pairs:
        if result and not one.refusal:
            legal.setdefault((_form(one), result), one.words)
    return [
        replace(one, taken_for=legal.get((_form(one), result), "")) if result and one.refusal else one
        for one, result in pairs
    ]


def _form(one: InputRow) -> str:
    return ".".join(one.id.split(".")[:2])


def counts(rows: Sequence[InputRow]) -> Mapping[tuple[str, str], Mapping[str, int]]:
    """Return how many inputs of each argument end in each way; those that the reference takes apart."""
    by_argument: dict[tuple[str, str], dict[str, int]] = {}
    for one in rows:
        of = by_argument.setdefault((one.area, one.about), {})
        kind = one.reaction if one.refusal else one.agreement
        of[kind] = of.get(kind, 0) + 1
    return by_argument
