"""`audit`: what ``eos-ref audit`` does, as a function that returns the result and prints nothing.

A deck is audited, all decks of a folder, a few at a time, or what a deck has written. ``eos-ref.toml`` in the folder of
the decks holds how they are audited, and which known findings are accepted, why and until when.
"""

from __future__ import annotations

import calendar
import os
import re
import shlex
import shutil
import tempfile
import time
import tomllib
from collections.abc import Collection, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import replace
from datetime import UTC, date, datetime
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

from eos_ref.errors import InputError, unknown
from lammps_cases.audit.arrays import arrays_of
from lammps_cases.audit.finished import audit_dump
from lammps_cases.audit.messages import DeckSetups, RunSetup
from lammps_cases.audit.options import AuditOptions, AuditResult, DeckLevelOptions, FinishedOptions
from lammps_cases.audit.place import DeckPlace, copy_folder, find, nested_folder
from lammps_cases.audit.supervise import audit_deck, case_name, described
from lammps_cases.engine import installations
from lammps_cases.engine.installations import Engine
from lammps_cases.findings import LEDGER
from lammps_cases.records.checked import checked
from lammps_cases.records.files import MIB, read_text, write_arrays
from lammps_cases.records.options import flat
from lammps_cases.records.progress import SILENT
from lammps_cases.records.run_record import CaseRecord, EngineRecord, Level, RunRecord
from lammps_cases.records.yaml_files import DECK
from lammps_cases.report.findings import outcome
from lammps_cases.run import provenance, report_files
from lammps_cases.run.command import Result, report_folder
from lammps_cases.run.report_files import output_folder

DECK_NAMES = ("in.*", "*.in", "*.lmp")
HEAD = 2**16  # bytes of a file that are searched for a command
RESTART_NAME = "eosref_restart"  # the copy's name, among the deck's files
SETTINGS = "eos-ref.toml"
UNTIL = re.compile(r"until (\d{4})-(\d{2})(?:-(\d{2}))?, (\S.*)")


@checked
@flat
def audit(
    deck: str | Path,
    *,
    finished: FinishedOptions,
    options: AuditOptions,
    level: DeckLevelOptions,
    out: str | Path | None = None,
) -> Result:
    """Check every atom while LAMMPS runs an unchanged input deck in a copy of its folder, as ``eos-ref audit`` does.

    Parameters
    ----------
    deck : path
        The input script.
    out : path, optional
        See `lammps_cases.run.command.run`.
    (options)

    Raises
    ------
    InputError
        Bad input, in one line.
    EngineMissing
        There is no LAMMPS with RHEO.
    """
    chosen, deck = installations.resolve(level.engine), Path(deck)
    options = replace(options, engine=chosen.site)
    words = [word for name, file in vars(finished).items() if file for word in (f"--{name}", str(file))]
    command = shlex.join(["eos-ref", "audit", str(deck), *words, *options.words()])
    with report_folder(out) as (folder, temporary):
        run = audit_into(folder, deck, options, chosen, command, level.level, finished)
        return Result(run, folder, temporary)


def audit_into(
    directory: Path,
    deck: Path,
    options: AuditOptions,
    engine: Engine,
    command: str,
    fail_on: Level,
    finished: FinishedOptions | None = None,
) -> RunRecord:
    """Audit a deck, all decks of a folder, or what a deck has written, and write the report into a folder.

    Options that are not given, and allowances of findings, are those of `SETTINGS` in the folder of the decks.
    """
    dump, restart = (finished.dump, finished.restart) if finished else (None, None)
    if dump is not None and restart is not None:
        raise InputError("dump", "and restart must not be given together")
    begin, of_decks = time.perf_counter(), read_settings(deck if deck.is_dir() else deck.parent)
    with output_folder(directory) as folder:
        own = options if deck.is_dir() else of_decks.options(deck.name, options)
        if dump is not None:
            results = [audit_dump(dump, deck, own)]
        elif restart is not None:
            results = [audit_restart(restart, deck, own)]
        else:
            results = audit_folder(deck, own, of_decks) if deck.is_dir() else [audit_deck(deck, own)]
        who = next((result.who for result in results if result.who), {})
        run = provenance.run_record(provenance.engine_record(engine, who), command)
        run.cases, run.seconds = [result.record.cases[0] for result in results], time.perf_counter() - begin
        run.fail_on = fail_on
        run.allowed, run.notes = of_decks.allowed({*outcome(run).known}, datetime.now(UTC).date())
        for case, result in zip(run.cases, results, strict=True):
            if result.arrays:
                write_arrays(folder / "fields" / f"{case.case}.npz", result.arrays)
            if result.kept:
                write_arrays(folder / "fields" / f"{case.case}@kept.npz", arrays_of(result.kept))
        report_files.write_run(run.counted(), folder)
    return run


def decks(folder: Path, settings: Settings) -> list[str]:
    """Return the decks below a folder by their paths in it, sorted: files named as such, and those of the settings.

    Files that hold no command of a deck (data files are named *.lmp as well) and hidden folders are left out.

    Raises
    ------
    InputError
        No deck, or the settings name one that does not exist.
    """
    for name in settings.decks:
        if not (folder / name).is_file():
            raise InputError("decks", "no such file", name, str(folder))
    found = {path.relative_to(folder) for pattern in DECK_NAMES for path in folder.rglob(pattern) if _is_deck(path)}
    names = {path.as_posix() for path in found if not any(part.startswith(".") for part in path.parts)}
    names = {name for name in names if not any(matches(name, pattern) for pattern in settings.skip)}
    if not names | {*settings.decks}:
        raise InputError("decks", f"must be files named {', '.join(DECK_NAMES)}", where=str(folder))
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
            return audit_deck(folder / name, settings.options(name, replace(options, progress=SILENT)))
        except InputError as error:
            message = " ".join(str(error).split())
            case = CaseRecord(case="deck", tags=["audit"], verdict="error", ended="error", message=message)
            return AuditResult(RunRecord(engine=EngineRecord(), reference={}, cases=[case]), {}, {})

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


def audit_restart(restart: Path, deck: Path, options: AuditOptions) -> AuditResult:
    """Have LAMMPS read a restart file, define the deck's fixes, evaluate the forces once (``run 0``), and judge them.

    The definitions are those that the deck makes before the run that the file's step belongs to.

    Parameters
    ----------
    restart : Path
    deck : Path
        The deck that has written it.
    options : AuditOptions

    Raises
    ------
    InputError
        No such file; LAMMPS does not read it; a step that the deck does not reach.
    EngineMissing
    """
    if not restart.is_file():
        raise InputError("restart", "must be a readable file", where=str(restart))
    _, setups = described(deck, options)
    run = setups.runs[-1]
    result = _audited_restart(restart, deck, setups, run, options)
    step = result.record.cases[0].checks[0].step
    of_step = _run_of(step, setups.runs, restart)
    if of_step.before != run.before:
        result = _audited_restart(restart, deck, setups, of_step, options)
    case = result.record.cases[0]
    case.case, case.source = case_name(restart), str(restart)
    case.about = "a restart file of your input deck: the state that LAMMPS reads from it, before a step"
    words = ["--restart", str(restart), "--deck", str(deck), *options.words()]
    case.reproduce = shlex.join(["eos-ref", "audit", *words])
    return result


def _run_of(step: int, runs: Sequence[RunSetup], restart: Path) -> RunSetup:
    within = [run for run in runs if run.first <= step <= run.last]
    if not within:
        steps = ", ".join(f"{run.first} to {run.last}" for run in runs)
        raise InputError("step", f"must be one of the deck's runs (steps {steps})", step, str(restart))
    return within[0]


def _audited_restart(
    restart: Path, deck: Path, setups: DeckSetups, run: RunSetup, options: AuditOptions
) -> AuditResult:
    place = find(deck, options.root, options.var)
    with tempfile.TemporaryDirectory(prefix="eos-ref-restart-") as made:
        root = nested_folder(place.root, Path(made).resolve()) if options.trust else Path(made).resolve()
        copy_folder(place.root, root, links_out=options.trust)
        folder = root / place.within
        shutil.copyfile(restart, folder / RESTART_NAME)
        commands = setups.commands[: run.before]
        early = [command for command in commands if command.startswith("newton")]
        rest = [command for command in commands if command not in early]
        script = folder / f"in.{RESTART_NAME}"
        script.write_text("\n".join([*early, f"read_restart {RESTART_NAME}", *rest, "run 0", ""]), encoding="utf-8")
        result = audit_deck(script, replace(options, steps=None, progress=SILENT), DeckPlace(root, folder))
    case = result.record.cases[0]
    if case.engine_error:
        message = case.engine_error.replace(f"in.{RESTART_NAME}", "the restart")
        raise InputError("restart", f"must be readable by LAMMPS with the deck's fixes ({message})", where=str(restart))
    return result


class DeckLimits(BaseModel):
    """How decks are audited: those options of the same names that are set here."""

    model_config = ConfigDict(extra="forbid", strict=True)

    every: int | None = None
    steps: int | None = None
    timeout: float | None = None
    fields: list[str] | None = None

    def values(self) -> dict[str, Any]:
        """Return the values that are set, as `AuditOptions` has them.

        Raises
        ------
        InputError
            A value that the option may not have.
        """
        names = [name for name in DeckLimits.model_fields if getattr(self, name) is not None]
        options = AuditOptions(**{name: getattr(self, name) for name in names})
        return {name: getattr(options, name) for name in names}


class Settings(DeckLimits):
    """The content of the file.

    Attributes
    ----------
    decks : further decks of the folder, by their paths in it
    skip : patterns of names of files that are not decks
    allow : by finding ``until DATE, REASON``; the day or the month is the last
    deck : by pattern of names, what is set for these decks
    """

    decks: list[str] = []
    skip: list[str] = []
    allow: dict[str, str] = {}
    deck: dict[str, DeckLimits] = {}

    def options(self, name: str, options: AuditOptions) -> AuditOptions:
        """Return the options for a deck; options other than the defaults override the file."""
        values = self.values()
        for pattern, limits in self.deck.items():
            if matches(name, pattern):
                values |= limits.values()
        default = {name for name in values if getattr(options, name) == getattr(AuditOptions, name)}
        return replace(options, **{name: value for name, value in values.items() if name in default})

    def allowed(self, shown: Collection[str], today: date) -> tuple[dict[str, str], list[str]]:
        """Return the valid allowances, and notes on the others: expired, or of a finding that no deck shows."""
        held, notes = {}, []
        for finding, text in self.allow.items():
            last, reason = allowance(finding, text)
            if today > last:
                notes.append(f"{SETTINGS}: the allowance of {finding} expired on {last}: {reason}")
            elif finding not in shown:
                notes.append(
                    f"{SETTINGS}: the allowance of {finding} is unused: no deck of this run shows it ({reason})"
                )
            else:
                held[finding] = f"until {last}, {reason}"
        return held, notes


def matches(name: str, pattern: str) -> bool:
    """Return whether a pattern matches a deck: its path in the folder, or its name alone."""
    return fnmatchcase(name, pattern) or fnmatchcase(Path(name).name, pattern)


def allowance(finding: str, text: str) -> tuple[date, str]:
    """Return the last day and the reason of an allowance.

    Raises
    ------
    InputError
    """
    ids = [entry.id for entry in LEDGER]
    if finding not in ids:
        raise unknown("finding", finding, ids).at("allow")
    parts = UNTIL.fullmatch(text)
    try:
        if parts is None:
            raise ValueError
        year, month = int(parts[1]), int(parts[2])
        last = date(year, month, int(parts[3]) if parts[3] else calendar.monthrange(year, month)[1])
    except ValueError:  # also calendar's error about a month
        rule = "must be 'until YEAR-MONTH, REASON', or until a day"
        raise InputError(f"allow.{finding}", rule, text) from None
    return last, parts[4]


def read_settings(folder: Path) -> Settings:
    """Return the settings of a folder of decks; empty without a file.

    Raises
    ------
    InputError
        Not TOML, an unknown key, a value that is not allowed: file, key and rule.
    """
    path = folder / SETTINGS
    if not path.exists():
        return Settings()
    try:
        settings = Settings.model_validate(tomllib.loads(read_text(path, "settings", MIB)))
        for finding, text in settings.allow.items():
            allowance(finding, text)
        for limits in (settings, *settings.deck.values()):
            limits.values()
    except tomllib.TOMLDecodeError as error:
        raise InputError("settings", f"must be TOML: {error}", where=str(path)) from None
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = ".".join(map(str, first["loc"]))
        raise InputError(key, first["msg"], first["input"], str(path)) from None
    except InputError as error:
        raise InputError(error.what, error.rule, error.found, str(path)) from None
    return settings
