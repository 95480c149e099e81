"""The common wording of commands, pages and documents: verdicts, findings, numbers, names, sentences."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Literal

from lammps_cases.records.case_parts import BY_SEVERITY, FieldRecord, Predictions, Verdict
from lammps_cases.records.faults import MissingPart
from lammps_cases.records.run_record import HASH, CarriedOver, CaseRecord, EngineRecord, RunRecord, TriageGroup

# The meaning of each verdict, as in docs/verdicts.md.
MEANINGS: dict[Verdict, str] = {
    "exact": "the numbers are those of the reference, evaluated in LAMMPS' order of operations, bit for bit",
    "pass": "every atom is within the bound",
    "explained": "some atoms are outside, and one or more findings, put into the reference as variants, bring every "
    "atom of every field at every step back inside",
    "differs": "some atoms are outside, and no set of findings explains them",
    "refused": (_ended := "how LAMMPS ended instead of answering; refused is right where a case expects the refusal"),
    "crashed": _ended,
    "timeout": _ended,
    "error": "the case, or the harness, is at fault: this says nothing about LAMMPS",
    "skipped": "this LAMMPS was built without what the case needs, or does not have a style or keyword of it (exit "
    "code 1); the reason is given",
}
INSIDE = ("exact", "pass")  # the verdicts of numbers within their bounds
EXPECTED_REFUSAL = "refused as expected"
GIVEN = "given"  # in brackets after a quantity: input of a scene
FACTOR = 10  # a difference of this many times a value, or more, is written as a factor
MOST_NAMES = 8  # of cases, beyond which they are counted


def verdict_kind(verdict: str, expected: bool) -> str:
    """Return the verdict, with an expected refusal kept apart from an unexpected one."""
    return EXPECTED_REFUSAL if verdict == "refused" and expected else verdict


def one_line(text: str) -> str:
    """Join a text into one line with single spaces."""
    return " ".join(text.split())


def listed(findings: Iterable[str]) -> str:
    """Return findings in a line of text."""
    return ", ".join(findings)


def finding_ids(line: str | None) -> list[str]:
    """Return the findings listed in a line, as baselines and histories keep them."""
    return line.split(", ") if line else []


def field_name(field: str, atom_type: int | None) -> str:
    """Return the name of a field; an audit has one per type of atoms."""
    return field if atom_type is None else f"{field} (type {atom_type})"


def given(quantity: str) -> str:
    """Name the input of a scene: ``rho (given)``."""
    return f"{quantity} ({GIVEN})"


def after_stop(quantity: str, by: str, step: int) -> str:
    """Name the state after a stop, continued by a route: ``rho (restart at 2)``."""
    return f"{quantity} ({by} at {step})"


def parted(name: str) -> tuple[str, str]:
    """Return the quantity, and which input it is: `GIVEN`, the route and step of a stop; empty for other fields."""
    quantity, _, which = name.partition(" (")
    return quantity, which.removesuffix(")")


# --- numbers


def size(ratio: float | None) -> float:
    """Return a ratio for ordering: NaN is the largest there is, None the smallest."""
    return -1.0 if ratio is None else math.inf if math.isnan(ratio) else ratio


def number(value: float | None, digits: int = 3) -> str:
    """Format a number for reading; empty for None."""
    if value is None:
        return ""
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    return f"{value:.{digits}g}"


def brief(value: float | None) -> str:
    """Format a number with two digits for a narrow cell: 3.6e9, 0.12."""
    text = number(value, 2)
    mantissa, e, exponent = text.partition("e")
    return f"{mantissa}e{int(exponent)}" if e else text


def times(value: float) -> str:
    """Format a factor for reading, from 1000 on with two digits: 1.25, 101, 40 000, 1.2e13."""
    if not 1000 <= abs(value) < 1e6:
        return number(value) if abs(value) < 1000 else brief(value)
    return f"{float(f'{value:.2g}'):,.0f}".replace(",", " ")


def carried(of: CarriedOver) -> str:
    """Describe the findings confirmed, gone or unknown on a new or changed engine."""
    kinds = (
        (len(of.first_seen), "new"),
        (len(of.partly), "gone in some cases"),
        (len(of.gone), "gone"),
    )
    first = next((at for at, (count, _) in enumerate(kinds) if count), 0)
    parts = [f"{counted(n, 'finding') if at == first else n} {how}" for at, (n, how) in enumerate(kinds) if n]
    parts.append(f"{counted(of.unexplained, 'difference')} unexplained")
    return f"LAMMPS {of.version}, carried over from {of.nearest}: {', '.join(parts)}"


def carried_rows(of: CarriedOver) -> list[tuple[str, str, int]]:
    """Return rows of finding, status and number of cases."""
    kinds = ((f"new, not in {of.nearest}", of.first_seen), ("gone in some cases", of.partly), ("gone", of.gone))
    return [(name, how, count) for how, findings in kinds for name, count in findings.items()]


def counted(count: int, noun: str) -> str:
    """Count things: 1 case, 2 cases."""
    return f"{count} {noun}{'s' * (count != 1)}"


def by_file(cases: Sequence[str]) -> str:
    """Name cases; count them by their files, of which those with the most are named, if they are many."""
    if len(cases) <= MOST_NAMES:
        return ", ".join(cases)
    counts = Counter(case.partition(".")[0] for case in cases)
    files = some([f"{count} {file}.*" for file, count in counts.most_common()], of="file")
    return f"{counted(len(cases), 'case')} ({files})"


def predictions(of: Predictions) -> str:
    """Describe how many predictions and judgements a run has taken from the store."""
    judgements = f"{counted(of.judgements, 'judgement')} and " if of.judgements else ""
    total = counted(of.stored + of.computed, "reference prediction")
    return f"{judgements}{of.stored} of {total} taken from the cache"


def plain(item: Any) -> Any:
    """Return an item as JSON has it: tuples as lists; as text, as in run.json, the numbers for which JSON has none."""
    if isinstance(item, dict):
        return {name: plain(value) for name, value in item.items()}
    if isinstance(item, list | tuple):
        return [plain(value) for value in item]
    if isinstance(item, float) and not math.isfinite(item):
        return "NaN" if math.isnan(item) else "Infinity" if item > 0 else "-Infinity"
    return item


def lacks(faults: Iterable[MissingPart], how: str = "not in this report") -> list[str]:
    """Describe which parts of a report are missing, and why: a line for each cause."""
    parts: dict[str, list[str]] = {}
    for fault in faults:
        place = f" ({fault.trace[-1]})" if fault.trace else ""
        of = f" of {by_file(fault.cases)}" if fault.cases else ""
        parts.setdefault(f"{fault.exception}: {fault.text}{place}", []).append(f"{fault.part}{of}")
    return [f"{how}: {listed(names)}: {why}" for why, names in parts.items()]


def notes(run: RunRecord) -> list[str]:
    """Describe what concerns a run as a whole, such as judgements made by other code."""
    if not run.older:
        return run.notes
    changed = sorted(case for case, what in run.older.items() if what == "reference")
    line = f"{len(run.older)} of {counted(len(run.cases), 'case')} judged by other code, before --resume continued"
    line += f": {by_file(sorted(run.older))}"
    since = "; the reference has changed since"
    line += since if len(changed) == len(run.older) else f"{since} {by_file(changed)}" if changed else ""
    return [line, *run.notes]


# --- triage


HYPOTHESES = (
    "Hypotheses say what reproduces LAMMPS on every atom of every case of a group; none counts as an explanation, or "
    "makes a case pass."
)


def cause(group: TriageGroup) -> str:
    """Describe the first cause of the cases of a group."""
    if not group.field:
        return f"{group.verdict}: {one_line(group.text)}"
    step = "" if group.step is None else f" at step {group.step}"
    return f"{group.field} (stage {group.stage}) leaves its bound first{step}"


def in_common(group: TriageGroup) -> str:
    """Describe the features common to the failing group and rare among passing scenes."""
    all_of = "the only scene" if len(group.cases) == 1 else f"all {len(group.cases)} scenes"
    if not group.green:
        return f"{all_of}; no green one to compare with"
    if not group.common:
        return f"{all_of}: nothing that fewer of the {group.green} green ones have"
    others = f"{group.green_with or 'none'} of {group.green} others"
    return f"{all_of} with {' and '.join(group.common)}; {others}"


def hypotheses(group: TriageGroup) -> list[str]:
    """Describe what reproduces LAMMPS in a group, one hypothesis a line; or that nothing tried does."""
    lines = [f"as if {each.sentence}" for each in group.hypotheses]
    if group.more:
        lines.append(f"and {group.more} more that say the same in these scenes")
    if not lines and group.tried:
        cut = ", as the allowed work was spent" if group.cut_short else ""
        lines.append(f"no hypothesis: none of {counted(group.tried, 'change')} of the formulas reproduces it{cut}")
    return lines or ["no hypothesis: nothing to try formulas on"]


def triage_lines(run: RunRecord) -> Iterator[str]:
    """Yield the triage of a run as lines of text, hypotheses marked as such."""
    for at, group in enumerate(run.triage.groups if run.triage else (), 1):
        yield f"triage {at} of {len(run.triage.groups)}: {counted(len(group.cases), 'case')}, {cause(group)}"  # type: ignore[union-attr]
        yield f"  scenes: {in_common(group)}"
        for line in hypotheses(group):
            yield f"  hypothesis: {line}" if group.hypotheses else f"  {line}"
        yield f"  cases: {some(group.cases)}"


def some(names: Sequence[str], listed: int = 6, of: str = "") -> str:
    """Name the first of some things and the number of the others, ``of`` what if that is not plain."""
    rest = len(names) - listed
    more = counted(rest, f"more {of}") if of else f"{rest} more"
    return ", ".join(names[:listed]) + (f", {more}" if rest > 0 else "")


# --- runs and cases

SEVERITY: dict[str, int] = {verdict: k for k, verdict in enumerate(BY_SEVERITY, 1)}
_SKIPPED, _EXACT, _PASS, *_WORSE = BY_SEVERITY
KINDS = (_EXACT, _PASS, EXPECTED_REFUSAL, *_WORSE, _SKIPPED)  # of verdicts, in the order of lists


def kind(case: CaseRecord) -> str:
    """Return the verdict, with an expected refusal kept apart from an unexpected one."""
    return verdict_kind(case.verdict, case.as_expected)


def rank(case: CaseRecord, accepted: bool) -> int:
    """Return the rank of a case by severity; all cases that are not accepted come after those that are."""
    if kind(case) == EXPECTED_REFUSAL:
        return SEVERITY["pass"]
    return SEVERITY[case.verdict] + (0 if accepted else len(BY_SEVERITY))


def counts(run: RunRecord) -> dict[str, int]:
    """Count the cases of each kind in the order of severity, skipped ones last."""
    return by_severity(Counter(kind(case) for case in run.cases))


def by_severity(counts_of_kinds: Mapping[str, int]) -> dict[str, int]:
    """Sort the counts of kinds of verdicts by severity, without zeros."""
    return {name: counts_of_kinds[name] for name in KINDS if counts_of_kinds.get(name)}


def tally(run: RunRecord) -> str:
    """Count the cases of a run and their verdicts, in one line."""
    parts = ", ".join(f"{number} {name}" for name, number in counts(run).items())
    total = counted(len(run.cases), "case")
    return f"{total}: {parts}" if parts else total


def worst_field(case: CaseRecord) -> FieldRecord | None:
    """Return the field to blame: worst verdict, then largest difference in units of the bound."""
    return max(case.fields, key=how_bad, default=None)


def how_bad(field: FieldRecord) -> tuple[int, float]:
    """Return the sort key of fields: the verdict, then the largest difference in units of the bound."""
    return SEVERITY[field.verdict], size(field.max_over_bound)


def worst_ratio(case: CaseRecord) -> float | None:
    """Return the largest difference in units of the bound, over the fields and checks of a case."""
    ratios = [f.max_over_bound for f in case.fields if f.max_over_bound is not None]
    ratios += [check.max_over_bound for check in case.checks]
    return max(ratios, key=size, default=None)


def digits_lost(case: CaseRecord, side: Literal["lammps", "reference"]) -> float | None:
    """Return the decimal digits that a side loses in the worst field of a case."""
    lost = [getattr(field.digits_lost, side) for field in case.fields]
    return max((value for value in lost if value is not None), default=None)


def styles(case: CaseRecord) -> str:
    """List the laws of a case, each once, in the order of the types."""
    return ", ".join(dict.fromkeys(law.style for law in case.laws))


def engine(who: EngineRecord) -> str:
    """Describe the LAMMPS that answered in one sentence: version, library, compiler and MPI, as far as known."""
    dated = f" ({who.version_string})" if who.version_string else ""
    named = "" if who.name == "env" else f", {who.name}"
    compiler = f"compiled by {who.compiler}" if who.compiler else ""
    mpi = "without MPI" if who.mpi == "serial" else f"with {who.mpi}" if who.mpi else ""
    library = f"library {who.library_sha256[:HASH]}" if who.library_sha256 else ""
    facts = [
        part for part in (library, "" if who.release else who.git, " ".join(filter(None, (compiler, mpi)))) if part
    ]
    return ", ".join([f"LAMMPS {who.distribution}".rstrip() + dated + named, *facts])
