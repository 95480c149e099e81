"""The headline over everything that is judged: the only place that decides its state and its words.

`PASS` (green): no difference at all. `KNOWN BUGS` (amber): every difference is a known finding. `FAIL` (red):
something is new, unexplained, missing or broken, or a known finding is one that ``--fail-on`` rejects. A run that
compared nothing is `EMPTY`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from lammps_cases.records import deck_wording as deck
from lammps_cases.records import wording
from lammps_cases.records.levels import SEVERITIES, Severity, State, allowed, fails
from lammps_cases.records.run_record import CaseRecord, Level
from lammps_cases.records.wording import counted

__all__ = ["HERE", "LOOKS", "Headline", "Look", "State", "bugs", "headline", "how_severe", "of_decks", "strictest"]
NAMED = 2  # findings of a deck, or decks of a folder, in a headline; the others are counted
HERE = "seen in this LAMMPS"


@dataclass(frozen=True)
class Look:
    """The look of a state: class of a page's header, colour of a terminal, mark in Markdown, annotation of GitHub."""

    css: Literal["good", "known", "bad", "empty"]
    terminal: str
    mark: str
    level: Literal["error", "warning", "notice"]


LOOKS: Mapping[State, Look] = {
    "PASS": Look("good", "green", "🟢", "notice"),
    "KNOWN BUGS": Look("known", "yellow", "🟠", "warning"),
    "FAIL": Look("bad", "red", "🔴", "error"),
    "EMPTY": Look("empty", "white", "⚪", "warning"),
}


@dataclass(frozen=True)
class Headline:
    """A state, and the reason in one sentence."""

    state: State
    sentence: str

    @property
    def look(self) -> Look:
        """The look of the state."""
        return LOOKS[self.state]

    @property
    def markdown(self) -> str:
        """The state with its colour, as Markdown can show it."""
        return f"{self.look.mark} {self.state}"

    def __str__(self) -> str:
        return f"{self.state}: {self.sentence}"


def headline(
    known: Mapping[str, Severity],
    new: Sequence[str] = (),
    *,
    differences: str = "",
    same: str = "no difference",
    fail_on: Level = "new",
    compared: bool = True,
    whose: str = HERE,
    allowed: Collection[str] = (),
) -> Headline:
    """Return the headline of something judged.

    Parameters
    ----------
    known : mapping
        The findings that were seen, with their severities.
    new : sequence of str
        What is new, unexplained, missing or broken, in words.
    differences : str
        What differs and is known, in words, if more than the number of findings is to be reported.
    same : str
        The words if nothing differs.
    fail_on : {"high", "medium", "low", "new"}
        The least severe of the findings that fail.
    compared : bool
        Whether anything was compared at all.
    whose : str
        The LAMMPS in which the bugs were seen, in words.
    allowed : collection of str
        Findings that do not fail.
    """
    rejected = sum(fails(severity, fail_on) for name, severity in known.items() if name not in allowed)
    parts = [*new, *filter(None, [differences]), *([bugs(known, whose)] if known else [])]
    if rejected:
        parts.append(f"{rejected} rejected by --fail-on {fail_on}")
    if not new and parts:
        parts.append("nothing new")
    if new or rejected:
        return Headline("FAIL", "; ".join(parts))
    if parts:
        return Headline("KNOWN BUGS", "; ".join(parts))
    return Headline("PASS", same) if compared else Headline("EMPTY", "nothing was compared")


def of_decks(
    cases: Sequence[CaseRecord],
    new: Sequence[str] = (),
    *,
    fail_on: Level = "new",
    exempt: Collection[str] = (),
) -> Headline:
    """Return the headline of audited decks: what happens to one of them, or to which of several.

    Parameters
    ----------
    cases : sequence of CaseRecord
        Audits, at least one.
    new : sequence of str
        What else is new or missing, in words.
    fail_on : {"high", "medium", "low", "new"} or an effect
        The effect from which a known finding fails.
    exempt : collection of str
        Findings that do not fail.
    """
    failed = {case.case: why for case in cases if (why := _failure(case, fail_on, exempt))}
    known = {name for case in cases if case.case not in failed for name in case.findings}
    inside = {(case.case, field.field) for case in cases for field in case.fields if field.verdict in wording.INSIDE}
    state: State = "FAIL" if new or failed else "KNOWN BUGS" if known else "PASS" if inside else "EMPTY"
    if len(cases) == 1:
        (case,) = cases
        same = f"no difference in {counted(len(inside), 'field')}" if inside else deck.nothing(case)
        ended = failed.get(case.case) or _known(case, case.findings) or same
        return Headline(state, "; ".join([*new, ended, *deck.remarks(case)]))
    parts = list(new)
    if failed:
        parts.append(f"{len(failed)} of {len(cases)} decks: {_first([': '.join(each) for each in failed.items()])}")
    if known:
        under = sum(bool(case.findings) for case in cases if case.case not in failed)
        where = counted(under, "other") if failed else f"{under} of {len(cases)} decks"
        parts.append(f"{counted(len(known), 'known bug')} in {where}")
    same = f"no difference in {len(cases)} decks" if inside else "nothing was compared"
    return Headline(state, "; ".join(parts) or same)


def _failure(case: CaseRecord, fail_on: Level, exempt: Collection[str]) -> str:
    """Describe why a deck fails: how it ended, or the known findings with too large effects; empty if it passes."""
    if why := deck.failure(case):
        caused = case.outlook.findings if case.outlook else []
        others = _known(case, [name for name in case.findings if name not in caused], "other " if caused else "")
        return "; ".join(filter(None, [why, others]))
    rejected = [name for name in deck.rejected(case, fail_on) if name not in exempt]
    return f"{_known(case, rejected)}; rejected by --fail-on {fail_on}" if rejected else ""


def _known(case: CaseRecord, names: Sequence[str], other: str = "") -> str:
    """Name findings with their effects on a deck: 1 known bug: forces are 100 times too large."""
    said = [deck.what(case, name) for name in deck.bugs(case) if name in names]
    return f"{counted(len(said), f'{other}known bug')}: {_first(said)}" if said else ""


def _first(said: Sequence[str]) -> str:
    """Join the first of some clauses and count the others."""
    rest = len(said) - NAMED
    return "; ".join([*said[:NAMED], *([f"{rest} more"] if rest > 0 else [])])


def bugs(known: Mapping[str, Severity], whose: str = HERE) -> str:
    """Count known findings: 17 known bugs seen in this LAMMPS, 5 severe."""
    severe = sum(severity == "high" for severity in known.values())
    if len(known) == 1:
        return f"1 known bug {whose} ({'severe' if severe else 'not severe'})"
    return f"{counted(len(known), 'known bug')} {whose}, {severe or 'none'} severe"


def how_severe(known: Mapping[str, Severity]) -> str:
    """Count findings by their severities, the most severe first: 5 high, 8 medium, 4 low."""
    counts = Counter(known.values())
    return ", ".join(f"{counts[severity]} {severity}" for severity in SEVERITIES if counts[severity])


def strictest(levels: Sequence[Level]) -> Level:
    """Return the level at which most fails; new of none."""
    return min(levels, key=allowed, default="new")
