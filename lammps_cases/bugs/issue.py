"""``issue.md``: a report in the form of LAMMPS' template for bugs."""

from __future__ import annotations

import platform
import re
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from importlib.metadata import version

from lammps_cases.bugs.deck import DATA, DECK, Ending
from lammps_cases.bugs.report import Report
from lammps_cases.bugs.upstream.finding_tests import FindingTest
from lammps_cases.comparison.pair_sums import ParticleValues, Sum
from lammps_cases.findings import KNOWN, Finding
from lammps_cases.records.wording import counted


def text(report: Report, ending: Ending, test: FindingTest | str = "", versions: Sequence[str] = KNOWN) -> str:
    """Return the text of a report, with LAMMPS' result for its deck, and the test of its finding or why it has none."""
    sections = {
        "Summary": _summary(report),
        "LAMMPS Version and Platform": _versions(report.finding, ending, versions),
        "Expected Behavior": _expected(report, ending),
        "Actual Behavior": _actual(report, ending),
        "Steps to Reproduce": _steps(report, ending),
        "Workaround": [report.finding.workaround if report.finding else "None is known."],
        "Further Information, Files, and Links": _further(report, ending, test),
    }
    blocks = [f"# [BUG] {report.title}"]
    for heading, lines in sections.items():
        blocks += [f"**{heading}**", "\n".join(lines)]
    return "\n\n".join(blocks) + "\n"


def _summary(report: Report) -> Iterable[str]:
    if report.finding:
        yield report.finding.observed
    if report.record and report.record.message != report.title:
        yield report.record.message


def _versions(finding: Finding | None, ending: Ending, versions: Sequence[str]) -> Iterable[str]:
    yield f"This report was made with LAMMPS ({ending.version}) on {platform.system()} {platform.machine()}."
    if finding is None:
        return
    yield ""
    yield from _table(("version", ""), [(of, "bad" if of in finding.engines else "good") for of in versions])
    yield ""
    yield turns(finding, versions)


def turns(finding: Finding, versions: Sequence[str] = KNOWN) -> str:
    """Name, of the tested versions, the first bad one, the last good one before it and the first good one after it."""
    bad = [version in finding.engines for version in versions]
    if True not in bad:
        return "Good in every version tried."
    first, last = bad.index(True), len(bad) - 1 - bad[::-1].index(True)
    before = f"the last good one {versions[first - 1]}" if first else "no good one before it was tried"
    after = f"good again from {versions[last + 1]} on" if last + 1 < len(bad) else "still bad in the newest one tried"
    return f"First bad version {versions[first]}, {before}; {after}."


def _expected(report: Report, ending: Ending) -> Iterable[str]:
    if report.finding:
        yield report.finding.documented
        yield ""
        yield report.finding.argument
        yield ""
    if report.number is None:
        refused = report.deck.refused
        yield f"LAMMPS stops with an error that holds: `{refused}`." if refused else "LAMMPS runs the deck."
        return
    yield f"In the deck below, {_subject(report)}: {ending.printed('expected') or 'see the deck'}."
    if report.sum:
        yield ""
        yield from _by_hand(report.sum)
    if report.lines:
        yield ""
        yield "```"
        for line in report.lines:
            numbers = re.sub(r"\$\{(\w+)\}", r"\1", line.numbers)
            yield f"{line.name} = {line.formula} = {numbers} = {_number(line.value)}"
        yield "```"


def _subject(report: Report) -> str:
    assert report.number is not None
    component = "".join("xyz"[axis] for axis in report.number.axes)
    return f"`{report.number.field}`{f' ({component})' if component else ''} of atom {report.number.atom}"


def _by_hand(given: Sum) -> Iterable[str]:
    """Yield the calculation by hand: the particle, and all terms summed over its pairs."""
    own = given.particle
    nearest = "" if given.count == len(given.pairs) else f" ({len(given.pairs)} nearest shown)"
    yield f"By hand, atom {own.id} with {counted(given.count, 'neighbour')} within the cutoff{nearest}: V = m/rho, P by"
    yield "the pressure law, W and grad W of the kernel at x_ij = x_i - x_j."
    yield ""
    yield from _table(
        ("atom", "type", "x", "v", "m", "rho", "V", "P"), [_row(own), *(_row(p.other) for p in given.pairs)]
    )
    if given.pairs:
        yield ""
        pairs = [(p.other.id, _vector(p.x), _number(p.r), _number(p.w), _vector(p.gradient)) for p in given.pairs]
        yield from _table(("j", "x_ij", "r", "W", "grad W"), pairs)


def _row(one: ParticleValues) -> tuple[object, ...]:
    numbers = (one.mass, one.rho, one.volume, one.pressure)
    phase = f"{one.type}{' (solid)' * one.solid}"
    return one.id, phase, _vector(one.x), _vector(one.v), *map(_number, numbers)


def _actual(report: Report, ending: Ending) -> Iterable[str]:
    if ending.code:
        yield f"LAMMPS ends with exit code {ending.code}: `{ending.error}`"
    elif report.number is not None:
        yield f"In the deck below, {_subject(report)}: {ending.printed('obtained')}."
    else:
        yield "LAMMPS runs the deck to its end."


def _steps(report: Report, ending: Ending) -> Iterable[str]:
    files = f"`{DECK}`" + (f" and `{DATA}` (attached)" if report.deck.data else "")
    must = "must stop with an error" if report.deck.refused else "prints PASS where LAMMPS is right, and FAIL otherwise"
    yield f"With {files}, `lmp -in {DECK}` {must}."
    yield ""
    yield "```"
    yield report.deck.text.rstrip("\n")
    yield "```"
    yield ""
    yield f"It ends with {ending.verdict(report.deck)}."


def _further(report: Report, ending: Ending, test: FindingTest | str) -> Iterable[str]:
    if report.finding:
        yield f"Remedy: {report.finding.remedy}"
        yield ""
    if isinstance(test, FindingTest):
        files = ", ".join(f"`{name}`" for name in test.files)
        yield f"Test for LAMMPS' own tree, red until this is fixed: {files} (attached) in `{test.folder}`; after CMake:"
        yield f"`{test.ctest}`."
        yield ""
    elif test:
        yield f"There is no test for LAMMPS' own tree: {test}."
        yield ""
    yield f"Made by eos-ref {version('eos-ref')} on {datetime.now(UTC):%Y-%m-%d} with LAMMPS ({ending.version})."
    yield "Expected numbers are those of an independent reference that follows the manual and the papers it cites; none"
    yield "was taken from a LAMMPS."


def _table(columns: Sequence[str], rows: Iterable[Sequence[object]]) -> Iterable[str]:
    yield f"| {' | '.join(columns)} |"
    yield "|" + "---|" * len(columns)
    for row in rows:
        yield f"| {' | '.join(map(str, row))} |"


def _number(value: float) -> str:
    return f"{value:.15g}"


def _vector(values: Sequence[float]) -> str:
    return ", ".join(map(_number, values))
