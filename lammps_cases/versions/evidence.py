"""Evidence of the findings in the accepted runs: ``python -m lammps_cases.versions.evidence`` writes it.

``findings/shown_by.json`` holds the cases that show each finding, ``findings/engines.json`` the versions it was seen
on, ``docs/findings.md`` a table of all findings and the order in which to fix them, ``docs/versions.md`` and
``README.md`` one of the severe findings by version. `eos-ref accept` and `eos-ref adopt` write them again after they
have changed the baselines of this repository.
"""

from __future__ import annotations

import json
from collections import Counter, defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from packaging.version import Version

from lammps_cases.findings import KNOWN, LEDGER, SHOWN_BY, Finding, by_cause, engines
from lammps_cases.findings.document import SECTIONS
from lammps_cases.records.files import write_atomically
from lammps_cases.records.wording import by_file
from lammps_cases.report.markdown import text
from lammps_cases.versions import baseline

ROOT = Path(__file__).parents[2]
BASELINES = ROOT / "reports" / "accepted"
TABLE = ROOT / "docs" / "findings.md"
SOURCES = "../lammps_cases/data/findings"  # of the texts, as docs/findings.md links them
VERSIONS = (ROOT / "docs" / "versions.md", ROOT / "README.md")
BEGIN, END = "<!-- {}:begin -->\n", "<!-- {}:end -->\n"  # of a table that is generated


@dataclass(frozen=True)
class AcceptedEvidence:
    """Evidence in the accepted runs.

    Attributes
    ----------
    engines : versions of LAMMPS that are known, oldest first
    cases : by finding, the cases that show it, each with the engines that have the finding but do not show it there
    seen_on : by finding, the engines that it was seen on; for one that only probes show, also by an earlier adoption
    newest : by case, the findings that explain it on the newest engine with an accepted run
    """

    engines: tuple[str, ...]
    cases: dict[str, dict[str, list[str]]]
    seen_on: dict[str, tuple[str, ...]]
    newest: dict[str, frozenset[str]]


def collect(baselines: Path, ledger: Sequence[Finding] = LEDGER) -> AcceptedEvidence:
    """Collect the evidence of the findings in the accepted runs.

    Raises
    ------
    InputError
        A damaged baseline.
    """
    cases: dict[str, dict[str, set[str]]] = defaultdict(lambda: defaultdict(set))
    seen_on: dict[str, set[str]] = defaultdict(set, {entry.id: set(entry.engines) for entry in ledger})
    versions = set(KNOWN)
    explained: dict[str, dict[str, frozenset[str]]] = defaultdict(dict)
    for identity in sorted(baselines.glob(f"[!.]*/{baseline.IDENTITY}")):
        side = baseline.read(identity.parent)
        version = side.engine.distribution
        versions |= {version} - {""}
        for case in side.cases.values():
            of_fields = (finding for field in case.fields.values() for finding in field.explained_by)
            explained[version][case.case] = frozenset((*case.explained_by, *of_fields))
            for finding in explained[version][case.case]:
                cases[finding][case.case].add(version)
                seen_on[finding] |= {version} - {""}
    order = tuple(sorted(versions, key=Version))
    having = {entry.id: tuple(engine for engine in order if engine in seen_on[entry.id]) for entry in ledger}
    shown = {
        name: {case: [engine for engine in engines if engine not in cases[name][case]] for case in sorted(cases[name])}
        for name, engines in having.items()
    }
    newest = next((explained[version] for version in reversed(order) if version in explained), {})
    return AcceptedEvidence(order, shown, having, newest)


def table(evidence: AcceptedEvidence, ledger: Sequence[Finding] = LEDGER) -> str:
    """Return the findings as a table in Markdown, by their causes."""
    lines = ["| cause | severity | finding | versions | cases |\n", "|---|---|---|---|---|\n"]
    for entry in by_cause(evidence.cases, ledger):
        seen_on = evidence.seen_on[entry.id]
        versions = "all" if seen_on == evidence.engines else ", ".join(map(_short, seen_on))
        count = len(evidence.cases[entry.id])
        link = f"[`{entry.id}`]({SOURCES}/{entry.id}.md)"
        lines.append(f"| {entry.cause} | {entry.severity} | {entry.title} ({link}) | {versions} | {count} |\n")
    return "".join(lines)


def severe(evidence: AcceptedEvidence, ledger: Sequence[Finding] = LEDGER) -> str:
    """Return the severe findings as a table in Markdown: a column for all versions that have the same of them."""
    high = [entry for entry in ledger if entry.severity == "high"]
    groups: dict[tuple[bool, ...], list[str]] = defaultdict(list)
    for engine in evidence.engines:
        groups[tuple(engine in evidence.seen_on[entry.id] for entry in high)].append(engine)
    everywhere = [entry for entry in high if evidence.seen_on[entry.id] == evidence.engines]
    head = ["severe finding", *(", ".join([names[0], *map(_short, names[1:])]) for names in groups.values())]
    rows = [
        [f"{entry.effect} (`{entry.id}`)", *("**yes**" if has[at] else "no" for has in groups)]
        for at, entry in enumerate(high)
        if entry not in everywhere
    ]
    rows.append([f"{len(everywhere)} findings of every version", *("**yes**" for _ in groups)])
    rows.append(["in all", *(str(sum(has)) for has in groups)])
    return "".join(f"| {' | '.join(row)} |\n" for row in (head, ["---"] * len(head), *rows))


def _short(version: str) -> str:
    return version.removeprefix("2025.7.22")


@dataclass(frozen=True)
class Fix:
    """A finding in the order of fixing: the cases that its fix turns green alone, and that the fixes up to it do."""

    finding: str
    alone: int
    so_far: int


def order_of_fixes(explained: Collection[frozenset[str]]) -> list[Fix]:
    """Return the findings that explain cases, each the one that turns most of the remaining cases green.

    A case is green if all findings that explain it are fixed. Among findings that turn equally many green the one
    that is in most of the remaining cases comes first.
    """
    alone = Counter(name for names in explained if len(names) == 1 for name in names)
    left, fixes = [names for names in explained if names], list[Fix]()
    red = len(left)
    while left:
        shown = Counter(name for names in left for name in names)
        last = Counter(name for names in left if len(names) == 1 for name in names)
        best = min(shown, key=lambda name: (-last[name], -shown[name], name))
        left = [rest for names in left if (rest := names - {best})]
        fixes.append(Fix(best, alone[best], red - len(left)))
    return fixes


def fixes_table(evidence: AcceptedEvidence, ledger: Sequence[Finding] = LEDGER) -> str:
    """Return the order of fixing on the newest engine as a table in Markdown, with the remedies."""
    entries = {entry.id: entry for entry in ledger}
    lines = ["| finding | cause | remedy | alone | so far |\n", "|---|---|---|---|---|\n"]
    for fix in order_of_fixes(evidence.newest.values()):
        entry = entries[fix.finding]
        lines.append(f"| `{entry.id}` | {entry.cause} | {text(entry.remedy)} | {fix.alone} | {fix.so_far} |\n")
    return "".join(lines)


def page(entry: Finding, evidence: AcceptedEvidence) -> str:
    """Return the page of a finding in Markdown: its text, with the versions and cases that show it."""
    cases = evidence.cases[entry.id]
    parts = [
        f"# {text(entry.title)}\n\n`{entry.id}`, severity {entry.severity}\n\n**Effect:** {text(entry.effect)}.\n",
        *(f"## {heading}\n\n{text(getattr(entry, part))}\n" for part, heading in SECTIONS.items()),
        f"## Remedy\n\n{text(entry.remedy)}\n",
        f"## Versions\n\n{_versions(evidence.seen_on[entry.id], evidence.engines)}\n",
        "## Show it\n",
        f"`eos-ref report-bug {entry.id}` writes an input deck for LAMMPS alone, the text of an issue, and a test for",
        "LAMMPS' own tree, or why its forms of tests cannot show it.\n",
        *([f"Shown by {text(by_file(list(cases)))}.\n"] if cases else []),
    ]
    return "\n".join(parts)


def _versions(seen_on: Sequence[str], tried: Sequence[str]) -> str:
    others = [version for version in tried if version not in seen_on]
    if not others:
        return f"Seen on every version tried: {', '.join(tried)}."
    return f"Seen on {', '.join(seen_on) or 'none'}; not on {', '.join(others)}."


def documents(baselines: Path = BASELINES, ledger: Sequence[Finding] = LEDGER) -> dict[Path, str]:
    """Return the files that follow from the ledger and the accepted runs, with their content."""
    evidence = collect(baselines, ledger)
    return {
        SHOWN_BY: _shown(evidence.cases),
        engines.FILE: engines.document(evidence.engines, evidence.seen_on),
        TABLE: _with(TABLE, findings=table(evidence, ledger), fixes=fixes_table(evidence, ledger)),
        **{path: _with(path, versions=severe(evidence, ledger)) for path in VERSIONS},
    }


def _with(path: Path, **tables: str) -> str:
    """Return a document in which the tables of some names are replaced."""
    document = path.read_text(encoding="utf-8")
    for name, content in tables.items():
        begin, end = BEGIN.format(name), END.format(name)
        head, _, rest = document.partition(begin)
        document = f"{head}{begin}{content}{end}{rest.partition(end)[2]}"
    return document


def _shown(cases: Mapping[str, Mapping[str, Sequence[str]]]) -> str:
    """Return the text of ``shown_by.json``, a line for each case."""
    lines = (f"{json.dumps(name)}: {json.dumps(of)}" for name, of in cases.items())
    return "{\n" + ",\n".join(lines).replace("], ", "],\n ") + "\n}\n"


def publish() -> None:
    """Write the files that follow from the ledger and the accepted runs of this repository."""
    for path, content in documents().items():
        write_atomically(path, content)


if __name__ == "__main__":
    publish()
