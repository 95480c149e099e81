"""``summary.md``: a run on one screen, fit for a GitHub job summary."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from lammps_cases.records import CaseRecord, RunRecord
from lammps_cases.report import wording

LISTED = 100  # rows of the table of failures: GitHub refuses summaries above 1 MiB
LONGEST = 300  # characters of a message
EXTREMES = 5  # rows of the tables of extremes


def summary(run: RunRecord) -> str:
    """A run as GitHub-flavoured Markdown."""
    blocks = [
        f"## eos-ref: {wording.stamp(run)}",
        _text(wording.sentence(run)),
        _table(("verdict", "cases"), wording.counts(run).items()) if run.cases else "",
        _failures(run),
        _slowest(run),
        _worst_conditioned(run),
        _provenance(run),
    ]
    return "\n\n".join(block for block in blocks if block) + "\n"


def _failures(run: RunRecord) -> str:
    cases = wording.unaccepted(run)
    if not cases:
        return ""
    head = ("case", "verdict", "field", "stage", "worst atom", "difference/bound", "message")
    more = f"\n\n… and {len(cases) - LISTED} more, see report.html." if len(cases) > LISTED else ""
    return f"### Not as expected\n\n{_table(head, map(_failure, cases[:LISTED]))}{more}"


def _failure(case: CaseRecord) -> Sequence[str]:
    field = wording.worst_field(case)
    blame = ("", "", "")
    if field is not None:
        atom = "" if field.worst_id is None else str(field.worst_id)
        blame = (_text(field.field), _text(field.stage), atom)
    message = case.message if len(case.message) <= LONGEST else case.message[:LONGEST] + "…"
    return (
        _code(case.case),
        wording.kind(case),
        *blame,
        wording.number(wording.worst_ratio(case)),
        _text(message),
    )


def _slowest(run: RunRecord) -> str:
    cases = sorted(run.cases, key=lambda c: -c.seconds.total)[:EXTREMES]
    rows = [
        (
            _code(c.case),
            c.natoms,
            *(f"{s:.3f}" for s in (c.seconds.total, c.seconds.lammps, c.seconds.reference)),
        )
        for c in cases
        if c.seconds.total > 0
    ]
    head = ("case", "atoms", "total s", "LAMMPS s", "reference s")
    return f"### Slowest\n\n{_table(head, rows)}" if rows else ""


def _worst_conditioned(run: RunRecord) -> str:
    lost = [(wording.digits_lost(c, "lammps") or 0.0, wording.digits_lost(c, "reference") or 0.0, c) for c in run.cases]
    worst = sorted((row for row in lost if max(row[:2]) > 0), key=lambda row: -max(row[:2]))[:EXTREMES]
    rows = [(_code(c.case), wording.kind(c), f"{lammps:.1f}", f"{own:.1f}") for lammps, own, c in worst]
    head = ("case", "verdict", "digits lost, LAMMPS", "digits lost, reference")
    return f"### Most digits lost\n\n{_table(head, rows)}" if rows else ""


def _provenance(run: RunRecord) -> str:
    parts = [wording.engine(run), " ".join(f"{name} {version}" for name, version in run.reference.items())]
    if run.engine.library_sha256:
        parts.append(f"library sha256 {run.engine.library_sha256[:16]}…")
    parts += [run.date, f"{run.seconds:.2f} s"]
    line = "; ".join(_text(part) for part in parts if part)
    return f"{line}\n\n{_code(run.command)}" if run.command else line


def _table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(str(cell) for cell in line) + " |" for line in lines)


def _text(text: str) -> str:
    """Plain text inside a table cell: nothing in it is markup."""
    flat = _flat(text).replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    return re.sub(r"([\\`*_\[\]|~#])", r"\\\1", flat)


def _code(text: str) -> str:
    return "`" + _flat(text).replace("`", "'").replace("|", r"\|") + "`" if text else ""


def _flat(text: str) -> str:
    """One line without control characters, which LAMMPS echoes from a deck."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())
