"""What there is of a report if its page or summary cannot be made: how the cases ended, and why there is no more."""

from __future__ import annotations

from html import escape

from lammps_cases.records import wording
from lammps_cases.records.headline import Headline
from lammps_cases.records.run_record import RunRecord


def headline(run: RunRecord) -> Headline:
    """Return the headline of a run whose findings are not known."""
    return Headline("FAIL", f"the report lacks {', '.join(fault.part for fault in run.faults)}")


def page(run: RunRecord) -> str:
    """Return the page, which needs no template."""
    title = escape(str(headline(run)))
    rows = [
        f"<tr><td>{'</td><td>'.join(escape(text) for text in (case.case, wording.kind(case), case.message))}</td></tr>"
        for case in run.cases
    ]
    date, engine = escape(run.date), escape(run.engine.label)
    about = f'data-command="report" data-status="bad" data-engine="{engine}" data-date="{date}" data-state="FAIL"'
    return "\n".join(
        [
            f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>eos-ref: {title}</title>',
            f'<meta name="eos-ref" {about} data-title="{title}"></head><body>',
            f'<nav class="bar"><!--bar--><!--/bar--></nav><h1>{title}</h1>',
            *(f"<p>{escape(line)}</p>" for line in _lines(run)),
            "<table><tr><th>case</th><th>verdict</th><th>message</th></tr>",
            *rows,
            "</table></body></html>\n",
        ]
    )


def summary(run: RunRecord) -> str:
    """Return the summary, in which texts are no HTML."""
    wrong = [f"{case.case}: {wording.kind(case)}: {case.message}" for case in run.cases if not case.as_expected]
    lines = [f"## eos-ref: {headline(run)}", *_lines(run), *wrong]
    return "\n\n".join(escape(" ".join(line.split()), quote=False) for line in lines) + "\n"


def _lines(run: RunRecord) -> list[str]:
    about = f"{wording.engine(run.engine)}. {wording.tally(run)}."
    return [*wording.lacks(run.faults), about, "All numbers are in run.json and fields."]
