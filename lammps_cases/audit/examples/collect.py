"""An audit of every example deck, with its budgets, and the pressures that LAMMPS prints on several ranks."""

from __future__ import annotations

import hashlib
import shlex
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from lammps_cases.audit.command import audit_into
from lammps_cases.audit.examples.decks import ExampleDeck, ShippedLog, shipped_log
from lammps_cases.audit.options import AuditOptions
from lammps_cases.comparison import prediction_keys
from lammps_cases.engine.installations import Engine
from lammps_cases.engine.ranks import first_pressure
from lammps_cases.engine.workers import Failure, Workers
from lammps_cases.records.documents import SCHEMAS, Document
from lammps_cases.records.journal import Parts
from lammps_cases.records.progress import SILENT, Progress
from lammps_cases.records.run_record import CaseRecord, EngineRecord
from lammps_cases.run import case_journal, provenance

SHORT, LOOKS = 400, 20  # steps of the shortened form, and looks at them
FULL_EVERY = 200  # steps between two looks at a deck in full, as the decks print their thermo output
LIMIT = 300.0  # seconds for one pressure


@dataclass(frozen=True)
class FirstPressure:
    """The pressure that thermo prints before the first step: as which LAMMPS, or why there is none."""

    ranks: int
    newton: str  # as in the deck, or on
    press: float | None
    message: str = ""


@dataclass(frozen=True)
class Example:
    """A deck: its audit, the folder of that report, the first pressures, the logs shipped with it."""

    name: str
    folder: str
    case: CaseRecord
    pressures: tuple[FirstPressure, ...] = ()
    logs: tuple[ShippedLog, ...] = ()


@dataclass(frozen=True)
class Examples:
    """All decks, as ``examples.json`` holds them."""

    command: str
    full: bool
    engine: EngineRecord
    seconds: float
    examples: tuple[Example, ...]
    schema: str = SCHEMAS["examples"]


DOCUMENT = Document("examples", Examples)
NAME = "examples.json"


def judged(folder: Path) -> Parts[Example]:
    """Return ``decks.jsonl``: decks as they are judged."""
    return Parts(folder / "decks.jsonl", Example)


def collect(
    decks: Sequence[ExampleDeck],
    engine: Engine,
    folder: Path,
    command: str,
    *,
    full: bool = False,
    trust: bool = False,
    progress: Progress = SILENT,
) -> Examples:
    """Audit decks, each into a folder of its own, and return all that the page shows; those judged before are kept.

    Parameters
    ----------
    full : bool
        Run every deck to its end, in place of `SHORT` steps.
    trust : bool
        Let decks run uncontained; several ranks run those alone.

    Raises
    ------
    InputError, EngineMissing
    """
    begin, kept = time.perf_counter(), judged(folder)
    every, steps = (FULL_EVERY, None) if full else (SHORT // LOOKS, SHORT)
    options = AuditOptions(every, steps, float("inf") if full else 3600.0, trust, engine.site, budgets=True)
    examples = []
    with Workers(engine.site, 1) as workers:
        who = provenance.engine_record(engine, workers.identify().result())
        origin = case_journal.code(), who.library_sha256, options.words(), trust
        for at, deck in enumerate(decks):
            key = prediction_keys.fingerprint(deck.name, _digest(deck.path.parent), origin)
            example = kept.get(key)
            if example is not None and (folder / deck.name / "run.json").exists():
                examples.append(example)
                continue
            progress.advance(at, len(decks), deck.name)
            line = shlex.join(["eos-ref", "audit", str(deck.path), *options.words()])
            run = audit_into(folder / deck.name, deck.path, replace(options, progress=SILENT), engine, line, "new")
            logs = tuple(log for path in deck.logs if (log := shipped_log(path)))
            pressures = _pressures(deck, run.cases[0], logs, workers) if trust else ()
            example = Example(deck.name, deck.name, _brief(run.cases[0]), pressures, logs)
            examples.append(kept.add(key, example))
        progress.advance(len(decks), len(decks), "")
    return Examples(command, full, who, time.perf_counter() - begin + kept.earlier, tuple(examples))


def _digest(folder: Path) -> str:
    """Hash the files of a folder."""
    digest = hashlib.sha256()
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        digest.update(f"{path.relative_to(folder)} {hashlib.sha256(path.read_bytes()).hexdigest()}\n".encode())
    return digest.hexdigest()


def _brief(case: CaseRecord) -> CaseRecord:
    """Return a case without every look at every field, which the deck's own report has."""
    return case.model_copy(update={"checks": []})


def _pressures(
    deck: ExampleDeck, case: CaseRecord, logs: Sequence[ShippedLog], workers: Workers
) -> tuple[FirstPressure, ...]:
    """Ask for the pressure on one rank, on those of the logs, and on one with newton on."""
    if not case.budgets or case.budgets[0].press is None:
        return ()
    ranks = sorted({1, *(log.ranks for log in logs)})
    settings = [(count, None) for count in ranks] + [(1, True)]
    pressures = []
    for count, newton in settings:
        task = workers.call(first_pressure, deck.path, count, newton, time_limit=LIMIT)
        outcome = workers.outcome(task)
        how = "on" if newton else "as in the deck"
        if isinstance(outcome, Failure):
            pressures.append(FirstPressure(count, how, None, outcome.message))
        else:
            pressures.append(FirstPressure(count, how, outcome))
    return tuple(pressures)
