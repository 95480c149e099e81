"""LAMMPS' own example decks of RHEO, audited and taken apart: `eos-ref examples`.

Each deck is audited with its budgets, and its first pressure is printed on several ranks; the page shows its flow with
the closed solution, where its energy goes, and the logs that LAMMPS ships with it.
"""

from __future__ import annotations

import hashlib
import re
import shlex
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path

import matplotlib
from markupsafe import Markup
from matplotlib.figure import Figure

from eos_ref.errors import InputError, nearest
from lammps_cases.audit import budgets
from lammps_cases.audit.command import audit_into
from lammps_cases.audit.options import AuditOptions
from lammps_cases.audit.rerun import AS_IT_IS, FINER
from lammps_cases.comparison import store
from lammps_cases.engine import installations
from lammps_cases.engine.installations import Engine
from lammps_cases.engine.ranks import played
from lammps_cases.engine.workers import Failure, Workers
from lammps_cases.records.case_parts import ClosedRecord, SeriesRecord
from lammps_cases.records.deck_wording import effects
from lammps_cases.records.documents import SCHEMAS, Document
from lammps_cases.records.files import write_atomically
from lammps_cases.records.journal import Parts
from lammps_cases.records.progress import SILENT, Progress
from lammps_cases.records.run_record import CaseRecord, EngineRecord, RunRecord
from lammps_cases.records.wording import counted, number
from lammps_cases.report.findings import Outcome, outcome
from lammps_cases.report.pages import frame
from lammps_cases.report.pages.figures import BLUE, FAINT, INK, RED, THEMED, themed
from lammps_cases.run import provenance

LARGEST = 2**24  # bytes of a log
LOOP = re.compile(r"^Loop time of \S+ on (\d+) procs", re.MULTILINE)
VERSION = re.compile(r"^LAMMPS \((\d+ \w+ \d+)", re.MULTILINE)
SHORT, LOOKS = 400, 20  # steps of the shortened form, and its number of samples
FULL_EVERY = 200  # steps between two samples of a full deck, at which the decks print their thermo output
LIMIT = 300.0  # seconds for one pressure
# Colours of Okabe & Ito (2008), which colour-blind readers can distinguish.
PARTS = {
    "pressure": "#0072b2",
    "viscosity": "#d55e00",
    "artificial viscosity": "#e69f00",
    "density diffusion": "#009e73",
    "shifting": "#cc79a7",
    "other fixes": "#56b4e9",
}
ASSETS = Path(__file__).parent / "assets"


@dataclass(frozen=True)
class ExampleDeck:
    """A deck by the name of its folder, with the logs shipped with it, the newest last."""

    name: str
    path: Path
    logs: tuple[Path, ...] = ()


@dataclass(frozen=True)
class ShippedLog:
    """A log: the version of LAMMPS and ranks that wrote it, and its thermo output by column."""

    name: str
    version: str
    ranks: int
    columns: dict[str, list[float]]


def decks(engine: Engine, folder: Path | None, names: Sequence[str] = ()) -> list[ExampleDeck]:
    """Return decks of a folder, by default those that are installed with an engine.

    Raises
    ------
    InputError
        There is no deck, or no deck of a given name.
    """
    folder = folder or installations.examples(engine)
    if folder is None:
        rule = "are not installed with this LAMMPS: give the folder examples/rheo of its sources, --from DIR"
        raise InputError("example decks", rule, engine.name)
    every = [_deck(path, folder) for path in sorted({*folder.glob("*/in.*"), *folder.glob("in.*")}) if path.is_file()]
    if not every:
        raise InputError(
            "example decks", "must lie as in.* in the folder or its subfolders", str(folder), "option --from"
        )
    present = [deck.name for deck in every]
    for name in names:
        if name not in present:
            raise InputError("example", f"must be one of {', '.join(present)}{nearest(name, present)}", name)
    return [deck for deck in every if not names or deck.name in names]


def _deck(path: Path, folder: Path) -> ExampleDeck:
    alone = path.parent == folder or len(list(path.parent.glob("in.*"))) > 1
    logs = sorted(path.parent.glob("log.*.g++.*"), key=lambda log: log.stat().st_mtime)
    return ExampleDeck(path.name.removeprefix("in.") if alone else path.parent.name, path, () if alone else tuple(logs))


def shipped_log(path: Path) -> ShippedLog | None:
    """Return the content of a log; None if it cannot be read as one."""
    if path.stat().st_size > LARGEST:
        return None
    text = path.read_text(errors="replace")
    version, loop, columns = VERSION.search(text), LOOP.search(text), columns_of(text)
    return ShippedLog(path.name, version[1], int(loop[1]), columns) if version and loop and columns else None


def columns_of(text: str) -> dict[str, list[float]]:
    """Return the thermo output of the first run of a log by column; nothing if the run did not end."""
    loop = LOOP.search(text)
    head = re.search(r"^[ \t]*Step[ \t]+.*$", text, re.MULTILINE)
    if loop is None or head is None:
        return {}
    titles, rows = head[0].split(), []
    for line in text[head.end() : loop.start()].splitlines():
        try:
            row = [float(word) for word in line.split()]
        except ValueError:
            continue  # a warning in between
        if len(row) == len(titles):
            rows.append(row)
    return {title: [row[k] for row in rows] for k, title in enumerate(titles)} if rows else {}


@dataclass(frozen=True)
class FirstPressure:
    """The pressure that thermo prints before the first step: by which LAMMPS, or why it is missing."""

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
    """Return the journal ``decks.jsonl``, to which each deck is added when it is judged."""
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
    """Audit decks, each into its own folder, and return all that the page shows; finished audits are kept.

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
        origin = store.code(), who.library_sha256, options.words(), trust
        for at, deck in enumerate(decks):
            key = store.fingerprint(deck.name, digest(deck.path.parent), origin)
            example = kept.get(key)
            if example is not None and (folder / deck.name / "run.json").exists():
                examples.append(example)
                continue
            progress.advance(at, len(decks), deck.name)
            line = shlex.join(["eos-ref", "audit", str(deck.path), *options.words()])
            run = audit_into(folder / deck.name, deck.path, replace(options, progress=SILENT), engine, line, "new")
            logs = tuple(log for path in deck.logs if (log := shipped_log(path)))
            pressures = _pressures(deck, run.cases[0], logs, workers) if trust else ()
            case = run.cases[0].model_copy(update={"checks": []})  # every sample of every field is in the deck's report
            example = Example(deck.name, deck.name, case, pressures, logs)
            examples.append(kept.add(key, example))
        progress.advance(len(decks), len(decks), "")
    return Examples(command, full, who, time.perf_counter() - begin + kept.earlier, tuple(examples))


def digest(folder: Path) -> str:
    """Return the SHA-256 of the files of a folder."""
    digest = hashlib.sha256()
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        digest.update(f"{path.relative_to(folder)} {hashlib.sha256(path.read_bytes()).hexdigest()}\n".encode())
    return digest.hexdigest()


def _pressures(
    deck: ExampleDeck, case: CaseRecord, logs: Sequence[ShippedLog], workers: Workers
) -> tuple[FirstPressure, ...]:
    """Return the pressure on one rank, on those of the logs, and on one with newton on."""
    if not case.budgets or case.budgets[0].press is None:
        return ()
    pressures = []
    for count, newton in [*((count, None) for count in sorted({1, *(log.ranks for log in logs)})), (1, True)]:
        found = workers.outcome(workers.call(played, deck.path, count, 0, newton, time_limit=LIMIT))
        first = {} if isinstance(found, Failure) else columns_of(found)
        press = next(iter(first.get("Press", [])), None)
        message = found.message if isinstance(found, Failure) else "" if first else "not printed"
        pressures.append(FirstPressure(count, "on" if newton else "as in the deck", press, message))
    return tuple(pressures)


def picture(example: Example) -> Markup:
    """Return the figure of a deck: its flow, and where its energy goes; nothing without budgets."""
    case = example.case
    if len(case.budgets) < 2:
        return Markup("")
    with matplotlib.rc_context(THEMED):
        figure = Figure(figsize=(10.4, 3.0), layout="constrained")
        left, right = figure.subplots(1, 2)
        own, exact = budgets.measured(case), case.closed
        what = exact.quantity if exact else "kinetic energy"
        left.set_title(f"{what} (units of the deck)", color=INK)
        if exact is not None:
            left.plot(exact.steps, exact.values, color=FAINT, lw=3.0, alpha=0.5, label="closed solution")
        for series in case.series:
            if series.name in (AS_IT_IS, FINER) and series.steps:
                style = "-" if series.name == AS_IT_IS else "--"
                label = "reference" if series.name == AS_IT_IS else f"reference, {series.name}"
                left.plot(series.steps, _values(series, exact), style, color=BLUE, lw=1.2, label=label)
        left.plot(own.steps, _values(own, exact), "o", color=RED, ms=3.0, label="LAMMPS")
        left.set_xlabel("step", color=FAINT)
        left.legend(frameon=False, fontsize=8, labelcolor=INK)
        right.set_title("power of each part of the model (units of the deck)", color=INK)
        last = [of for of in case.budgets if of.run == case.budgets[-1].run]
        for name, colour in PARTS.items():
            powers = [sum(part.power + part.storage for part in of.parts if part.name == name) for of in last]
            if any(powers):
                right.plot([of.step for of in last], powers, color=colour, lw=1.3, label=name)
        right.set_xlabel("step", color=FAINT)
        right.legend(frameon=False, fontsize=8, labelcolor=INK)
    return themed(figure, f"figure-{example.name}", f"{example.name}: {what} and power, step by step", {})


def _values(series: SeriesRecord, exact: ClosedRecord | None) -> list[float]:
    """Return the quantity that the closed solution describes, else the kinetic energy."""
    if exact is None or exact.decays:
        return series.kinetic
    axis = "xyz".index(exact.quantity[-1])
    return [momentum[axis] for momentum in series.momentum]


@dataclass(frozen=True)
class View:
    """A deck as the page shows it."""

    example: Example

    @cached_property
    def fields(self) -> dict[str, int]:
        """How many fields have each verdict."""
        return dict(Counter(field.verdict for field in self.example.case.fields))

    @cached_property
    def conserved(self) -> list[budgets.Conserved]:
        """What the formulas conserve, or not."""
        return list(budgets.conserved(self.example.case.budgets))

    @cached_property
    def parts(self) -> list[budgets.Part]:
        """The parts of the difference to the closed solution."""
        return budgets.parts(self.example.case)

    @cached_property
    def powers(self) -> dict[str, float]:
        """The mean rates at which the parts of the model change the energy; that of pressure is 0 if it is rounding."""
        of_samples = self.example.case.budgets
        powers = budgets.dissipated(of_samples)
        rounding = max((of.bound.get("energy of pressure", -1.0) for of in of_samples), default=-1.0)
        if abs(powers.get("pressure", 0.0)) <= rounding:
            powers["pressure"] = 0.0
        return powers

    @cached_property
    def picture(self) -> Markup:
        """The figure, empty without budgets."""
        return picture(self.example)

    @property
    def effects(self) -> dict[str, str]:
        """What known findings do to the deck."""
        return effects(self.example.case)

    @property
    def press(self) -> float | None:
        """The pressure before the first step by the reference."""
        return self.example.case.budgets[0].press if self.example.case.budgets else None

    @property
    def press_findings(self) -> list[str]:
        """The findings that can change what LAMMPS prints of it."""
        return self.example.case.budgets[0].press_findings if self.example.case.budgets else []

    @property
    def why_not(self) -> str:
        """Reason why there are no budgets."""
        return self.example.case.unchecked.get("f", "the forces of pairs are not known in this deck")

    def logs(self) -> Iterator[tuple[ShippedLog, float | None, tuple[int, float] | None]]:
        """Yield the logs shipped, each with its first pressure, its last step and its deviation."""
        for log in self.example.logs:
            yield (
                log,
                next(iter(log.columns.get("Press", [])), None),
                budgets.log_deviation(self.example.case.closed, log.columns),
            )


def of_outcome(examples: Examples) -> Outcome:
    """Return the headline and exit code of all decks."""
    cases = [example.case for example in examples.examples]
    run = RunRecord(engine=examples.engine, reference={}, cases=cases, seconds=examples.seconds)
    return outcome(run.counted())


def write(examples: Examples, folder: Path) -> None:
    """Write ``report.html`` and ``examples.json``."""
    of_run = of_outcome(examples)
    engine = examples.engine.distribution or examples.engine.version_string
    html = frame.page(
        ASSETS,
        "examples",
        of_run.headline.look.css,
        engine=engine,
        of_run=of_run,
        examples=examples,
        facts=[
            ("LAMMPS", engine),
            ("form", "whole decks" if examples.full else f"first {SHORT} steps"),
            ("took", f"{examples.seconds:.0f} s"),
        ],
        views=[View(example) for example in examples.examples],
        percent=budgets.percent,
        filters={"share": partial(number, digits=2)},
    )
    DOCUMENT.write(folder / NAME, examples)
    write_atomically(folder / "report.html", html)


def lines(examples: Examples) -> Iterator[str]:
    """Yield what a terminal shows of every deck: its verdict, what is conserved, what makes up its difference."""
    for example in examples.examples:
        view, case = View(example), example.case
        counts = ", ".join(f"{count} {verdict}" for verdict, count in view.fields.items())
        yield f"{example.name}: {case.verdict}, {case.steps} steps, {counted(case.natoms, 'atom')}; fields: {counts}"
        for finding, does in view.effects.items():
            yield f"  known bug {finding}: {does}"
        yield from (f"  {line}" for line in budgets.lines(case))
        for first in example.pressures:
            shown = first.message if first.press is None else number(first.press, 6)
            yield f"  pressure before step 1, {counted(first.ranks, 'rank')}, newton {first.newton}: {shown}"
        if example.pressures:
            bugs = f"; known bugs that can change it: {', '.join(view.press_findings)}" if view.press_findings else ""
            yield f"  pressure before step 1, reference: {number(view.press, 6)}{bugs}"
        for log, press, away_of in view.logs():
            tail = f", {budgets.percent(away_of[1])} at step {away_of[0]}" if away_of else ""
            yield f"  {log.name} ({log.version}, {counted(log.ranks, 'rank')}): pressure {number(press, 6)}{tail}"
