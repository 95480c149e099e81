"""What every command, page and document says in the same way: verdicts, findings, numbers, names, sentences."""

from __future__ import annotations

import math
import re
from collections import Counter
from typing import Any, Literal

from lammps_cases.records.run_record import VERDICTS, CaseRecord, FieldRecord, RunRecord, Verdict, worst

INSIDE = ("exact", "pass")  # the verdicts of what lies within its bound
EXPECTED_REFUSAL = "refused as expected"


def verdict_kind(verdict: str, expected: bool) -> str:
    """The verdict, with an expected refusal kept apart from one that nobody expected."""
    return EXPECTED_REFUSAL if verdict == "refused" and expected else verdict


def finding_ids(explained_by: str | None) -> list[str]:
    """The findings that an ``explained_by`` names."""
    return explained_by.split(", ") if explained_by else []


def field_name(field: str, atom_type: int | None) -> str:
    """What a field is called; an audit has one per type of atoms."""
    return field if atom_type is None else f"{field} (type {atom_type})"


# --- numbers


def size(ratio: float | None) -> float:
    """A ratio for ordering: not a number is the worst there is, none the best."""
    return -1.0 if ratio is None else math.inf if math.isnan(ratio) else ratio


def number(value: float | None, digits: int = 3) -> str:
    """A number for reading; empty for None."""
    if value is None:
        return ""
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    return f"{value:.{digits}g}"


def brief(value: float | None) -> str:
    """A number of two digits for a narrow cell: 3.6e9, 0.12."""
    text = number(value, 2)
    mantissa, e, exponent = text.partition("e")
    return f"{mantissa}e{int(exponent)}" if e else text


def counted(count: int, noun: str) -> str:
    """A number of things: 1 case, 2 cases."""
    return f"{count} {noun}{'s' * (count != 1)}"


def plain(item: Any) -> Any:
    """An item as JSON has it: tuples as lists, and as text, as in run.json, the numbers for which JSON has none."""
    if isinstance(item, dict):
        return {name: plain(value) for name, value in item.items()}
    if isinstance(item, list | tuple):
        return [plain(value) for value in item]
    if isinstance(item, float) and not math.isfinite(item):
        return "NaN" if math.isnan(item) else "Infinity" if item > 0 else "-Infinity"
    return item


# --- names


def folder_name(text: str) -> str:
    """Text as the name of a folder on any system."""
    return re.sub(r"[^A-Za-z0-9.+]+", "-", text).strip("-.")[:100]


# --- runs and cases

# From best to worst, by the order in which `worst` of the records ranks them.
SEVERITY: dict[Verdict, int] = {v: sum(worst([v, other]) == v for other in VERDICTS) for v in VERDICTS}


def kind(case: CaseRecord) -> str:
    """The verdict, with an expected refusal kept apart from one that nobody expected."""
    return verdict_kind(case.verdict, case.as_expected)


def accepted(case: CaseRecord, run: RunRecord) -> bool:
    """Whether a case leaves this run green; a strict run does not accept `explained`."""
    return case.as_expected and not (run.strict and case.verdict == "explained")


def rank(case: CaseRecord, run: RunRecord) -> int:
    """Place of a case in a list by severity; all that is not accepted comes after all that is."""
    if kind(case) == EXPECTED_REFUSAL:
        return SEVERITY["pass"]
    return SEVERITY[case.verdict] + (0 if accepted(case, run) else len(VERDICTS))


def unaccepted(run: RunRecord) -> list[CaseRecord]:
    """The cases that turn a run red, worst first."""
    return sorted((c for c in run.cases if not accepted(c, run)), key=lambda c: -rank(c, run))


def counts(run: RunRecord) -> dict[str, int]:
    """Number of cases of each kind, in the order of severity; what was skipped comes last."""
    found = Counter(kind(case) for case in run.cases)
    first = {kind(case): rank(case, run) for case in run.cases}
    return {name: found[name] for name in sorted(found, key=lambda name: (name == "skipped", first[name]))}


def status(run: RunRecord) -> Literal["good", "bad", "empty"]:
    """Colour of a run; one that compared nothing is not green."""
    if unaccepted(run):
        return "bad"
    return "good" if any(case.verdict != "skipped" for case in run.cases) else "empty"


def stamp(run: RunRecord) -> str:
    """The run in one word."""
    return {"good": "PASS", "bad": "FAIL", "empty": "EMPTY"}[status(run)]


def sentence(run: RunRecord) -> str:
    """The run in one sentence."""
    total = counted(len(run.cases), "case")
    parts = ", ".join(f"{number} {name}" for name, number in counts(run).items())
    bad = len(unaccepted(run))
    end = {"good": "all as expected", "empty": "nothing was compared", "bad": f"{bad} not as expected"}[status(run)]
    strict = " (strict: explained differences are not accepted)" if run.strict else ""
    return f"{total}: {parts}; {end}{strict}." if parts else f"{total}; {end}."


def explained_by(case: CaseRecord) -> list[str]:
    """The ledger entries that explain a case, each once."""
    named = [case.explained_by, *(field.explained_by for field in case.fields)]
    return list(dict.fromkeys(entry for text in named for entry in finding_ids(text)))


def blame(case: CaseRecord) -> str:
    """The message without the ledger entries that it ends with, for where they stand beside it."""
    return case.message.removesuffix(f"; explained by {', '.join(explained_by(case))}")


def worst_field(case: CaseRecord) -> FieldRecord | None:
    """The field to blame: worst verdict, then largest difference in units of the bound."""
    return max(case.fields, key=lambda f: (SEVERITY[f.verdict], size(f.max_over_bound)), default=None)


def worst_ratio(case: CaseRecord) -> float | None:
    """Largest difference in units of the bound, over the fields and checks of a case."""
    ratios = [f.max_over_bound for f in case.fields if f.max_over_bound is not None]
    ratios += [check.max_over_bound for check in case.checks]
    return max(ratios, key=size, default=None)


def digits_lost(case: CaseRecord, side: Literal["lammps", "reference"]) -> float | None:
    """Decimal digits that a side loses in the worst field of a case."""
    lost = [getattr(field.digits_lost, side) for field in case.fields]
    return max((value for value in lost if value is not None), default=None)


def styles(case: CaseRecord) -> str:
    """The laws of a case, each named once, in the order of the types."""
    return ", ".join(dict.fromkeys(law.style for law in case.laws))


def engine(run: RunRecord) -> str:
    """Which LAMMPS answered, in one line."""
    parts = (run.engine.name, run.engine.distribution, run.engine.version_string, run.engine.git)
    return " · ".join(part for part in parts if part)
