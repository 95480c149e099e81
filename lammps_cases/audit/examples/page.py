"""The page of the examples, and what the command prints."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from markupsafe import Markup

from lammps_cases.audit import balance
from lammps_cases.audit.examples import collect, draw
from lammps_cases.audit.examples.collect import Example, Examples
from lammps_cases.audit.examples.decks import ShippedLog
from lammps_cases.records.deck_wording import effects
from lammps_cases.records.files import write_atomically
from lammps_cases.records.run_record import RunRecord
from lammps_cases.records.wording import counted, number
from lammps_cases.report.findings import Outcome, outcome
from lammps_cases.report.pages import frame

ASSETS = Path(__file__).parent / "assets"


@dataclass(frozen=True)
class View:
    """A deck as the page shows it."""

    example: Example

    @cached_property
    def fields(self) -> dict[str, int]:
        """How many fields have each verdict."""
        return dict(Counter(field.verdict for field in self.example.case.fields))

    @cached_property
    def conserved(self) -> list[balance.Conserved]:
        """What the formulas conserve, or not."""
        return list(balance.conserved(self.example.case.budgets))

    @cached_property
    def parts(self) -> list[balance.Part]:
        """The parts of the difference to the closed solution."""
        return balance.parts(self.example.case)

    @cached_property
    def powers(self) -> dict[str, float]:
        """The mean rates at which the parts of the model change the energy; that of pressure is 0 if it is rounding."""
        budgets = self.example.case.budgets
        powers = balance.dissipated(budgets)
        rounding = max((of.bound.get("energy of pressure", -1.0) for of in budgets), default=-1.0)
        if abs(powers.get("pressure", 0.0)) <= rounding:
            powers["pressure"] = 0.0
        return powers

    @cached_property
    def picture(self) -> Markup:
        """The figure, empty without budgets."""
        return draw.picture(self.example)

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
        """Why there are no budgets."""
        return self.example.case.unchecked.get("f", "the forces of pairs are not known in this deck")

    def logs(self) -> Iterator[tuple[ShippedLog, float | None, tuple[int, float] | None]]:
        """Go through the logs shipped: each with its first pressure, and its last step and deviation."""
        for log in self.example.logs:
            yield (
                log,
                next(iter(log.columns.get("Press", [])), None),
                balance.log_deviation(self.example.case.closed, log.columns),
            )


def run_of(examples: Examples) -> RunRecord:
    """Return all decks as one run."""
    cases = [example.case for example in examples.examples]
    return RunRecord(engine=examples.engine, reference={}, cases=cases, seconds=examples.seconds).counted()


def write(examples: Examples, folder: Path) -> None:
    """Write ``report.html`` and ``examples.json``."""
    of_run = outcome(run_of(examples))
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
            ("form", "whole decks" if examples.full else f"first {collect.SHORT} steps"),
            ("took", f"{examples.seconds:.0f} s"),
        ],
        views=[View(example) for example in examples.examples],
        percent=balance.percent,
        filters={"share": share},
    )
    collect.DOCUMENT.write(folder / collect.NAME, examples)
    write_atomically(folder / "report.html", html)


def share(of: float) -> str:
    """Write a share of a sum."""
    return number(of, 2)


def lines(examples: Examples) -> Iterator[str]:
    """Yield what a terminal shows of every deck: its verdict, what is conserved, what makes up its difference."""
    for example in examples.examples:
        view, case = View(example), example.case
        counts = ", ".join(f"{count} {verdict}" for verdict, count in view.fields.items())
        yield f"{example.name}: {case.verdict}, {case.steps} steps, {counted(case.natoms, 'atom')}; fields: {counts}"
        for finding, does in view.effects.items():
            yield f"  known bug {finding}: {does}"
        yield from (f"  {line}" for line in balance.lines(case))
        for first in example.pressures:
            shown = first.message if first.press is None else number(first.press, 6)
            yield f"  pressure before step 1, {counted(first.ranks, 'rank')}, newton {first.newton}: {shown}"
        if example.pressures:
            bugs = f"; known bugs that can change it: {', '.join(view.press_findings)}" if view.press_findings else ""
            yield f"  pressure before step 1, reference: {number(view.press, 6)}{bugs}"
        for log, press, away_of in view.logs():
            tail = f", {balance.percent(away_of[1])} at step {away_of[0]}" if away_of else ""
            yield f"  {log.name} ({log.version}, {counted(log.ranks, 'rank')}): pressure {number(press, 6)}{tail}"


def of_outcome(examples: Examples) -> Outcome:
    """Return the headline and exit code of all decks."""
    return outcome(run_of(examples))
