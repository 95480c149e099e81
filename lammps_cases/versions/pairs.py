"""Two or more sides, compared in pairs, as one document, a summary, and lines for a terminal."""

from __future__ import annotations

import itertools
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from lammps_cases.findings import severities
from lammps_cases.records.documents import SCHEMAS
from lammps_cases.records.headline import Headline, headline
from lammps_cases.records.levels import FailOn, Severity
from lammps_cases.records.wording import counted, plain
from lammps_cases.report import markdown
from lammps_cases.versions.change import ChangeGroup, Policy, SideChange, groups
from lammps_cases.versions.changes import Changes, compare
from lammps_cases.versions.outcomes import Side
from lammps_cases.versions.sources import LABELS
from lammps_cases.versions.timing import Speed, Turns, of_saved

LISTED = 100  # rows of the table of changed fields in the summary
PRINTED = 10  # faults listed on a terminal


@dataclass(frozen=True)
class Pair:
    """Two sides by their labels, the changes from the first to the second, and their times."""

    a: str
    b: str
    changes: Changes
    speeds: tuple[Speed, ...] = ()

    @property
    def name(self) -> str:
        """Name of the pair in tables."""
        return f"{self.a}-{self.b}"

    @property
    def names(self) -> dict[str, str]:
        """Labels of the sides named A and B in changes."""
        return {"A": self.a, "B": self.b}

    @property
    def tally(self) -> tuple[int, int, int]:
        """Number of fields that are the same, within bounds, and changed beyond them."""
        different, within = len(self.changes.different), self.changes.counts.get("within bounds", 0)
        return len(self.changes.fields) - different, within, different - within

    @property
    def groups(self) -> list[ChangeGroup]:
        """The changes, in a few lines."""
        return groups(self.changes.fields)


@dataclass(frozen=True)
class SideComparison:
    """All sides, A first, and all pairs of them; ``fail_on`` None: any change makes the exit code 1."""

    sides: dict[str, Side]
    pairs: tuple[Pair, ...]
    command: str = ""
    notes: tuple[str, ...] = field(default=())
    fail_on: FailOn | None = None

    @property
    def faults(self) -> list[SideChange]:
        """The changes that count, of all pairs."""
        return [change for pair in self.pairs for change in pair.changes.faults]

    @property
    def moved(self) -> dict[str, Severity]:
        """The findings that came or went, with their severities."""
        return severities(finding for change in self.faults if change.known for finding in change.moved)

    @property
    def headline(self) -> Headline:
        """The headline: amber if every change is due to known findings gained or lost."""
        faults = self.faults
        unknown = [change for change in faults if not change.known]
        new = [*self.notes, *([f"{counted(len(unknown), 'change')} without a finding"] if unknown else [])]
        known = len(faults) - len(unknown)
        return headline(
            self.moved,
            new,
            differences=f"{counted(known, 'change')}, {'known' if new else 'all known'}" if known else "",
            same="no difference beyond the bounds",
            fail_on=self.fail_on or "new",
            compared=any(pair.changes.fields for pair in self.pairs),
            whose="that appeared or disappeared",
        )

    @property
    def next_command(self) -> str:
        """The next command: the comparison of the first case changed without a finding, or the worst finding moved.

        Empty if that case was compared alone, is on one side only, or comes from a file.
        """
        for pair in self.pairs:
            sides = [self.sides[label] for label in (pair.a, pair.b)]
            unknown = [change.case for change in pair.changes.faults if not change.known]
            if unknown:
                of_both = all(unknown[0] in side.cases for side in sides)
                leads_on = of_both and len(sides[0].cases) > 1 and not {"--cases", "--deck"} & {*self.command.split()}
                return (
                    ""
                    if not leads_on
                    else shlex.join(["eos-ref", "compare", *(side.name for side in sides), unknown[0]])
                )
        return shlex.join(["eos-ref", "findings", next(iter(self.moved))]) if self.moved else ""

    @property
    def alone(self) -> Pair | None:
        """The only pair, if there is one."""
        return self.pairs[0] if len(self.pairs) == 1 else None

    @property
    def exit_code(self) -> int:
        """0 nothing changed beyond the bounds, 1 something did, 3 an engine failed as a whole."""
        if not all(side.answered for side in self.sides.values()):
            return 3
        return int(bool(self.faults) if self.fail_on is None else self.headline.state == "FAIL")


def compared(
    sides: Sequence[Side],
    policy: Policy,
    turns: Turns | None,
    timing: bool,
    command: str,
    fail_on: FailOn | None = None,
) -> SideComparison:
    """Compare every pair of sides; times are those measured in turns, else those that the sides hold."""
    labelled = dict(zip(LABELS, sides, strict=False))
    pairs = []
    for a, b in itertools.combinations(labelled, 2):
        speeds: list[Speed] = []
        if timing and turns is not None:
            speeds = turns.against(a, b)
        elif timing and (saved := of_saved(labelled[a], labelled[b])):
            speeds = [saved]
        pairs.append(Pair(a, b, compare(labelled[a], labelled[b], policy), tuple(speeds)))
    failed = tuple(f"{side.title} failed as a whole" for side in sides if not side.answered)
    return SideComparison(labelled, tuple(pairs), command, failed, fail_on)


# --- one document


def document(comparison: SideComparison) -> dict[str, Any]:
    """Return the content of compare.json.

    For a single pair ``fields`` lists everything compared, for more pairs all differences, with the pair's name.
    """
    alone = comparison.alone
    return {
        "schema": SCHEMAS["compare"],
        "command": comparison.command,
        "sides": [
            {"label": label, "name": side.name, "engine": side.engine.model_dump(exclude={"library"})}
            for label, side in comparison.sides.items()
        ],
        "notes": list(comparison.notes),
        "pairs": [
            {
                "pair": pair.name,
                "counts": pair.changes.counts,
                "faults": len(pair.changes.faults),
                "groups": [_group(group, pair) for group in pair.groups],
                "time": [plain(asdict(speed)) for speed in pair.speeds],
                "notes": list(pair.changes.notes),
            }
            for pair in comparison.pairs
        ],
        "fields": [
            ({} if alone else {"pair": pair.name}) | row(change, pair.a, pair.b)
            for pair in comparison.pairs
            for change in (pair.changes.fields if alone else pair.changes.different)
        ],
    }


def _group(group: ChangeGroup, pair: Pair) -> dict[str, Any]:
    return {
        "change": group.kind,
        "trait": group.trait,
        "side": pair.names.get(group.side, ""),
        "count": group.count,
        "cases": list(group.cases),
        "fields": dict(group.fields),
        "sentence": group.sentence(pair.a, pair.b),
    }


def row(change: SideChange, a: str = "A", b: str = "B") -> dict[str, Any]:
    """Return a change as JSON: case, field, change and closer_to_reference always, the rest if not empty."""

    def both(values: tuple[Any, Any]) -> dict[str, Any] | None:
        return dict(zip((a, b), values, strict=True)) if any(values) else None

    rest: dict[str, Any] = {
        "stage": change.stage,
        "verdicts": both(change.verdicts),
        "findings": both(change.findings),
        "over_bound": both(change.over_bound),
        "first_step": change.step,
        "difference_over_bound": change.difference,
        "note": change.note,
        "fault": change.fault or None,
    }
    closer = {"A": a, "B": b}.get(change.closer, change.closer)
    head = {"case": change.case, "field": change.field, "change": change.kind, "closer_to_reference": closer}
    document: dict[str, Any] = plain(head | {key: value for key, value in rest.items() if value not in (None, "")})
    return document


# --- for a terminal


def lines(changes: Changes, a: str = "A", b: str = "B") -> Iterator[str]:
    """Yield lines that summarise the changes; ``a`` and ``b`` are the names of the sides."""
    yield ", ".join(f"{count} {kind}" for kind, count in changes.counts.items()) or "nothing to compare"
    yield from (f"  {group.sentence(a, b)}" for group in groups(changes.fields))
    yield from (f"  note: {note}" for note in changes.notes)


def faults(changes: Changes) -> Iterator[str]:
    """Yield the first of the changes that count, each in a line."""
    listed = changes.faults
    for change in listed[:PRINTED]:
        yield f"  {fault(change)}"
    if len(listed) > PRINTED:
        yield f"  ... and {len(listed) - PRINTED} more"


def checked(changes: Changes, accept: str) -> Iterator[str]:
    """Yield the lines that ``eos-ref run --baseline`` prints; ``accept`` is the command to accept a baseline."""
    first, *rest = lines(changes, "the baseline", "this run")
    yield f"baseline {changes.a.name}: {first}"
    yield from rest
    yield from faults(changes)
    if changes.faults:
        yield f"  if this is intended: {accept} --reason TEXT"


def fault(change: SideChange) -> str:
    """Describe a change in one line."""
    where = " ".join(part for part in (change.case, change.field) if part)
    at = "" if change.step is None else f" from step {change.step}"
    was, now = (_judgement(change, side) for side in (0, 1))
    verdicts = f" ({was or 'nothing'}, now {now or 'nothing'})" if was != now else f" ({was})" if was else ""
    note = f": {change.note}" if change.note else ""
    what = "different bits, within the bounds" if change.kind == "within bounds" else change.kind
    return f"{what}: {where}{at}{verdicts}{note}"


def _judgement(change: SideChange, side: int) -> str:
    findings = ", ".join(change.findings[side])
    return f"{change.verdicts[side]} by {findings}" if findings else change.verdicts[side]


# --- for a pull request


def summary(comparison: SideComparison) -> str:
    """Return ``summary.md``."""
    named = [f"{label} is {markdown.text(side.title)}" for label, side in comparison.sides.items()]
    headline = comparison.headline
    blocks = [
        f"## eos-ref compare: {headline.markdown}",
        f"{markdown.text(headline.sentence)}.",
        "; ".join(named) + ".",
    ]
    blocks += [f"> **Note:** {markdown.text(note)}" for note in comparison.notes]
    if not comparison.alone:
        head = ("pair", "same", "within bounds", "changed", "time of second over first")
        blocks.append(markdown.table(head, [(pair.name, *pair.tally, ratio(pair)) for pair in comparison.pairs]))
    for pair in comparison.pairs if comparison.alone else shown(comparison):
        blocks += list(_of_pair(pair, comparison.alone is None))
    return "\n\n".join(block for block in blocks if block) + "\n"


def shown(comparison: SideComparison) -> list[Pair]:
    """List the pairs that are shown in full: each side with the one before it."""
    return [pair for pair in comparison.pairs if ord(pair.b) == ord(pair.a) + 1]


def ratio(pair: Pair) -> str:
    """Describe the ratio of times of a pair; empty if none was measured."""
    if not pair.speeds:
        return ""
    speed = pair.speeds[0]
    r = speed.ratio
    return f"{r.median:.3f} [{r.low:.3f}, {r.high:.3f}], {speed.how}: {speed.answer}"


def _of_pair(pair: Pair, titled: bool) -> Iterator[str]:
    if titled:
        yield f"### {pair.name}"
    yield ", ".join(f"{count} {kind}" for kind, count in pair.changes.counts.items()) + "."
    yield "\n".join(f"- {markdown.text(group.sentence(pair.a, pair.b))}" for group in pair.groups)
    yield "\n".join(f"- {speed.sentence(pair.a, pair.b)}" for speed in pair.speeds)
    yield "\n".join(f"> **Note:** {markdown.text(note)}" for note in pair.changes.notes)
    listed = pair.changes.faults
    if listed:
        head = ("case", "field", "change", "first step", pair.a, pair.b, "closer to the reference", "note")
        rows = [
            (
                markdown.code(c.case),
                markdown.text(c.field),
                c.kind,
                "" if c.step is None else c.step,
                markdown.text(_judgement(c, 0)),
                markdown.text(_judgement(c, 1)),
                pair.names.get(c.closer, c.closer),
                markdown.text(c.note),
            )
            for c in listed[:LISTED]
        ]
        rest = f"\n\n… and {len(listed) - LISTED} more, see compare.html." if len(listed) > LISTED else ""
        yield markdown.folded(counted(len(listed), "change"), markdown.table(head, rows) + rest)
