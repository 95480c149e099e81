"""The headline over everything that is judged: the one place that decides its state and makes its words.

`PASS` (green): no difference at all. `KNOWN BUGS` (amber): every difference is a known finding. `FAIL` (red):
something is new, unexplained, missing or broken, or a known finding is one that ``--fail-on`` rejects. What compared
nothing is `EMPTY`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from lammps_cases.records.levels import SEVERITIES, FailOn, Severity, fails
from lammps_cases.records.wording import counted

State = Literal["PASS", "KNOWN BUGS", "FAIL", "EMPTY"]
HERE = "seen in this LAMMPS"


@dataclass(frozen=True)
class Look:
    """How a state looks: class of a page's header, colour of a terminal, mark in Markdown, annotation of GitHub."""

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
    """A state, and why it is that, in one sentence."""

    state: State
    sentence: str

    @property
    def look(self) -> Look:
        """How the state looks."""
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
    fail_on: FailOn = "new",
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
        What differs and is known, in words, if there is more to say than how many findings were seen.
    same : str
        What to say where nothing differs.
    fail_on : {"high", "medium", "low", "new"}
        The least severe of the findings that fail.
    compared : bool
        Whether anything was compared at all.
    whose : str
        Where the bugs were seen.
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


def strictest(levels: Sequence[FailOn]) -> FailOn:
    """Return the level at which most fails; new of none."""
    return max(levels, key=("new", *SEVERITIES).index, default="new")
