"""A table of what LAMMPS does with every input that the project refuses, each in a process that it may kill."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from lammps_cases.engine.workers import Workers
from lammps_cases.findings import LEDGER
from lammps_cases.probes import run
from lammps_cases.probes.probe import Probe, base, commands, load
from lammps_cases.probes.reaction import Reaction, offending, reaction
from lammps_cases.probes.run import Reply
from lammps_cases.records.files import write_atomically
from lammps_cases.records.progress import SILENT, Progress
from lammps_cases.studies.stability.refusals import refusal

TIME_LIMIT = 10.0  # seconds that LAMMPS has for an input; the scenes take 0.01


class BadInput(Probe):
    """An input that the project refuses, its id the name of the refusal in words joined by hyphens.

    Attributes
    ----------
    area : subject of the input
    names : the manual's words for the quantity that is wrong; a clear error has one of them, or the offending word
    promise : what LAMMPS' manual says about it, if anything
    scene : keys of the equivalent scene; without them, and without a check, the edited fixes are parsed
    """

    base: str = "one"
    area: str
    names: tuple[str, ...]
    promise: str = ""
    scene: dict[str, Any] | None = None

    @property
    def refusal(self) -> str:
        """Error message of this project."""
        return refusal(self, self.scene)

    @property
    def words(self) -> str:
        """Commands in which it differs from its base, as a deck would hold them."""
        before = set(commands(base(self.base)))
        lines = [line for line in commands(self.input) if line not in before]
        return "; ".join(lines) or f"without {', '.join(self.drop)}"


@functools.cache
def bad_inputs() -> tuple[BadInput, ...]:
    """Return all inputs, in the order of the list."""
    return load("inputs.yaml", BadInput)


@dataclass(frozen=True)
class InputRow:
    """One input, and what LAMMPS does with it.

    Attributes
    ----------
    words : the input as a deck would hold it
    refusal : error message of this project
    reaction, text : what LAMMPS does, and its message, or the numbers with which it goes on
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
    promise: str = ""
    candidate: bool = False
    ledger: str = ""


_ADAPTER = TypeAdapter(list[InputRow])


def row(bad: BadInput, reply: Reply) -> InputRow:
    """Return the row of an input from LAMMPS' reply."""
    kind, text = reaction(reply, (*bad.names, *offending(bad)))
    finding = next((entry.id for entry in LEDGER if bad.id in entry.expected_inputs), "")
    candidate = bool(bad.promise) and kind not in ("clear error", "misleading error")
    return InputRow(bad.id, bad.area, bad.words, bad.refusal, kind, text, bad.promise, candidate, finding)


def table(
    workers: Workers, progress: Progress = SILENT, inputs: Sequence[BadInput] = (), time_limit: float = TIME_LIMIT
) -> list[InputRow]:
    """Run inputs, by default all, in LAMMPS.

    Parameters
    ----------
    workers : Workers
        Processes in which LAMMPS may die.
    progress : Progress, optional
        Advances with every input.
    time_limit : float
        Seconds that LAMMPS has for each.
    """
    chosen = tuple(inputs) or bad_inputs()
    replies = run.put(workers, [bad.input for bad in chosen], time_limit)
    rows = []
    for k, (bad, reply) in enumerate(zip(chosen, replies, strict=True), 1):
        rows.append(row(bad, reply))
        progress.advance(k, len(chosen), "bad inputs")
    return rows


def write(folder: Path, site: str | None, jobs: int, progress: Progress = SILENT) -> list[InputRow]:
    """Run every bad input in LAMMPS, and write the table beside an atlas: ``inputs.json``."""
    with Workers(site, jobs) as workers:
        rows = table(workers, progress)
    write_atomically(folder / "inputs.json", _ADAPTER.dump_json(rows, indent=1) + b"\n")
    return rows


def read(folder: Path) -> list[InputRow]:
    """Return the table of a folder; empty where there is none."""
    try:
        return _ADAPTER.validate_json((folder / "inputs.json").read_bytes())
    except (OSError, ValidationError):
        return []
