"""``summary.md``: a run on one screen, fit for a GitHub job summary."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from lammps_cases.records import wording
from lammps_cases.records.faults import part
from lammps_cases.records.run_record import CaseRecord, RunRecord
from lammps_cases.records.wording import counted
from lammps_cases.report import findings
from lammps_cases.report.findings import Outcome, RunFinding
from lammps_cases.report.statements import statements

LISTED = 100  # rows of the table of failures: GitHub refuses summaries above 1 MiB
LONGEST = 300  # characters of a message
EXTREMES = 5  # rows of the tables of extremes


def summary(of_run: Outcome) -> str:
    """Return a run as GitHub-flavoured Markdown."""
    run = of_run.run
    blocks = [
        *_head(of_run),
        _known(of_run),
        _failures(of_run.unaccepted),
        *map(_statements, run.cases),
        _triage(run),
        _carried(run),
        "\n".join(f"> **Note:** {text(note)}" for note in [*wording.lacks(run.faults), *wording.notes(run)]),
        "" if of_run.of_decks else _unseen(of_run.findings),
        *part(
            "agreement in summary.md",
            run.faults,
            lambda: [_twins(m) if m.twins else _agreement(m) for m in findings.matrices(run)],
            [],
        ),
        _slowest(run),
        _worst_conditioned(run),
        _provenance(run),
    ]
    return "\n\n".join(block for block in blocks if block) + "\n"


def news(of_run: Outcome) -> str:
    """Return the news of a run as GitHub-flavoured Markdown: its headline, and the unexpected results."""
    blocks = [*_head(of_run), _failures(of_run.unaccepted), _triage(of_run.run)]
    return "\n\n".join(block for block in blocks if block) + "\n"


def _head(of_run: Outcome) -> Sequence[str]:
    engine, tally = text(wording.engine(of_run.run.engine)), text(wording.tally(of_run.run))
    return f"## eos-ref: {of_run.headline.markdown}", f"{text(of_run.headline.sentence)}.", f"{engine}. {tally}."


def _carried(run: RunRecord) -> str:
    if run.carried is None:
        return ""
    rows = ((code(name), what, str(cases)) for name, what, cases in wording.carried_rows(run.carried))
    return f"### {text(wording.carried(run.carried))}\n\n{table(('finding', 'on this version', 'cases'), rows)}"


def _triage(run: RunRecord) -> str:
    if run.triage is None:
        return ""
    groups = []
    for group in run.triage.groups:
        said = [f"scenes: {text(wording.in_common(group))}", *map(text, wording.hypotheses(group))]
        said.append(f"cases: {', '.join(map(code, group.cases[:LISTED]))}")
        head = f"* **{wording.counted(len(group.cases), 'case')}**: {text(wording.cause(group))}"
        groups.append("\n".join([head, *(f"  * {line}" for line in said)]))
    return f"### Triage\n\n{wording.HYPOTHESES}\n\n" + "\n".join(groups)


def _failures(cases: Sequence[CaseRecord]) -> str:
    if not cases:
        return ""
    head = ("case", "verdict", "field", "stage", "first atom", "largest difference/bound", "message")
    more = f"\n\n… and {len(cases) - LISTED} more, see report.html." if len(cases) > LISTED else ""
    return f"### Not accepted\n\n{table(head, map(_failure, cases[:LISTED]))}{more}"


def _failure(case: CaseRecord) -> Sequence[str]:
    first = case.headline
    blame = (text(first.field), text(first.stage), str(first.atom)) if first else ("", "", "")
    message = case.message if len(case.message) <= LONGEST else case.message[:LONGEST] + "…"
    return (code(case.case), wording.kind(case), *blame, wording.number(wording.worst_ratio(case)), text(message))


def _known(of_run: Outcome) -> str:
    rows = [
        (
            of_run.known[f.entry.id],
            f"**{text(f.entry.title)}** {text(of_run.effect(f))}.",
            text(f.entry.since),
            len(f.cases),
            code(of_run.report_bug(f.entry)),
        )
        for f in of_run.shown
    ]
    head = ("severity", "what is wrong, and its effect", "since", "cases", "deck and issue for LAMMPS")
    return f"### Known bugs\n\n{table(head, rows)}" if rows else ""


def _statements(case: CaseRecord) -> str:
    lines = [f"* {text(str(line))}" for line in statements(case)]
    return f"### {text(case.case)}\n\n" + "\n".join(lines) if lines else ""


def _unseen(of_run: Sequence[RunFinding]) -> str:
    rows = [(f.entry.severity, code(f.entry.id), text(f.entry.title), len(f.unseen)) for f in of_run if f.unseen]
    absent = sum(f.status == "absent" for f in of_run)
    rest = f"{counted(absent, 'finding')} of the ledger not applicable in this run." if absent else ""
    head = ("severity", "finding", "what LAMMPS did", "cases")
    return "\n\n".join(filter(None, [f"### Not seen where they apply\n\n{table(head, rows)}" if rows else "", rest]))


def _agreement(matrix: findings.Matrix) -> str:
    """Tabulate fields against steps: cases inside the bound with the largest difference/bound, then those outside."""
    rows = [(text(row.field), *map(_cell, row.cells)) for row in matrix.rows if not row.exact]
    same = [row.field for row in matrix.rows if row.exact]
    blocks = [
        f"### Agreement: {matrix.title} ({counted(matrix.cases, 'case')})",
        "Cases inside the bound (largest difference/bound); of explained ones the variants are inside.",
        table(("field", *(f"step {step}" for step in matrix.steps)), rows) if rows else "",
        f"Bit-identical in every case: {', '.join(map(text, same))}." if same else "",
    ]
    return "\n\n".join(block for block in blocks if block)


def _twins(matrix: findings.Matrix) -> str:
    cells = [cell for row in matrix.rows for cell in row.cells if cell is not None]
    exact, inside, explained, outside = (
        sum(of.cases for of in column)
        for column in zip(*((c.exact, c.inside, c.explained, c.outside) for c in cells), strict=True)
    )
    largest = max((c.inside.ratio for c in cells if c.inside.ratio is not None), default=0.0)
    counts = f"{exact} bit-identical, {inside} inside the bound (largest difference/bound {wording.brief(largest)})"
    counts += f", {explained} explained, {outside} outside" if explained + outside else ""
    return f"{matrix.title} ({counted(matrix.cases, 'case')}), fields at steps: {counts}."


def _cell(cell: findings.AgreementCell | None) -> str:
    if cell is None:
        return ""
    words = [f"{cell.agree} ({wording.brief(cell.inside.ratio) or 0})"] if cell.agree else []
    for name, worst in (("explained", cell.explained), ("**differ**", cell.outside)):
        if worst.cases:
            words.append(f"{worst.cases} {name} ({wording.brief(worst.ratio)})")
    return ", ".join(words)


def _slowest(run: RunRecord) -> str:
    cases = sorted(run.cases, key=lambda c: -c.seconds.total)[:EXTREMES]
    rows = [
        (code(c.case), c.natoms, *(f"{s:.3f}" for s in (c.seconds.total, c.seconds.lammps, c.seconds.reference)))
        for c in cases
        if c.seconds.total > 0
    ]
    head = ("case", "atoms", "total s", "LAMMPS s", "reference s")
    return folded("Slowest", table(head, rows)) if rows else ""


def _worst_conditioned(run: RunRecord) -> str:
    lost = [(wording.digits_lost(c, "lammps") or 0.0, wording.digits_lost(c, "reference") or 0.0, c) for c in run.cases]
    worst = sorted((row for row in lost if max(row[:2]) > 0), key=lambda row: -max(row[:2]))[:EXTREMES]
    rows = [(code(c.case), wording.kind(c), f"{lammps:.1f}", f"{own:.1f}") for lammps, own, c in worst]
    head = ("case", "verdict", "digits lost, LAMMPS", "digits lost, reference")
    return folded("Most digits lost", table(head, rows)) if rows else ""


def _provenance(run: RunRecord) -> str:
    parts = [" ".join(f"{name} {version}" for name, version in run.reference.items())]
    if run.engine.library_sha256:
        parts.append(f"library sha256 {run.engine.library_sha256[:16]}…")
    parts += [run.date, f"{run.seconds:.2f} s"]
    line = "; ".join(text(part) for part in parts if part)
    return f"{line}\n\n{code(run.command)}" if run.command else line


def folded(title: str, block: str) -> str:
    """Return a block that opens on a click."""
    return f"<details><summary>{title}</summary>\n\n{block}\n\n</details>"


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table; the cells are already Markdown: made by `text` and `code`, or numbers."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(str(cell) for cell in line) + " |" for line in lines)


def text(words: str) -> str:
    """Return plain text for a table cell, with all markup escaped."""
    flat = _flat(words).replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    return re.sub(r"([\\`*_\[\]|~#])", r"\\\1", flat)


def code(words: str) -> str:
    """Return words in a fixed-width font; empty for empty text."""
    return "`" + _flat(words).replace("`", "'").replace("|", r"\|") + "`" if words else ""


def _flat(words: str) -> str:
    """Return one line without control characters, which LAMMPS echoes from a deck."""
    return " ".join("".join(c if c.isprintable() else " " for c in words).split())
