"""The parts of a report, a run in the formats of other programs, and bare forms of parts that fail.

`junit` returns ``junit.xml``, as CI servers read it; `dashboard` the ``run.json`` of LAMMPS' dashboard, in the form of
LAMMPS' tools/regression-tests/merge_results.py, as REPORTING.md in that folder and the archive
lammps/lammps-test-results describe it: ``metadata`` with counts and properties, ``tests`` by class and name.
"""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any, Literal

from lammps_cases.findings import LEDGER, Finding
from lammps_cases.records import deck_wording, wording
from lammps_cases.records.faults import part
from lammps_cases.records.files import write_atomically
from lammps_cases.records.headline import Headline
from lammps_cases.records.run_record import CaseRecord, HeadlineRecord, RunRecord
from lammps_cases.report import markdown, page
from lammps_cases.report.findings import Outcome, outcome
from lammps_cases.report.history import Past
from lammps_cases.report.statements import statements

# XML 1.0 cannot represent most control characters, and LAMMPS echoes whatever a deck contains.
_ILLEGAL = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
Status = Literal["passed", "failed", "error", "runtest", "skipped"]
STATUSES: tuple[Status, ...] = ("passed", "failed", "error", "runtest", "skipped")  # runtest: nothing was compared
GOOD = ("exact", "pass")


def write_report(
    run: RunRecord,
    directory: Path,
    ledger: Sequence[Finding] = LEDGER,
    history: Past | None = None,
    making: page.Making | None = None,
) -> Path:
    """Write ``summary.md``, ``junit.xml`` and ``report.html`` into a report folder.

    Parameters
    ----------
    run : RunRecord
        The run, of cases or of an audit.
    directory : Path
        Report folder; ``fields/CASE.npz`` is read from it where a case has fields and the file exists.
    ledger : sequence of Finding, optional
        The findings to look for in the run; the project's own unless given.
    history : Past, optional
        The runs before this one, from `lammps_cases.report.history.past`; without them the page lacks that
        part.
    making : Making, optional
        Makes the articles of cases, such as other processes; this one unless given.

    Returns
    -------
    Path
        The page. The same input gives the same bytes. A part that cannot be made is noted in the run's faults and
        missing from the report; without its own page or summary the report has a bare one.
    """

    def judged() -> Outcome:
        of_run = outcome(run, ledger)
        run.headline = HeadlineRecord(state=of_run.headline.state, sentence=of_run.headline.sentence)
        return of_run

    def made() -> tuple[str, str, bytes | None]:
        of_run = part("findings", run.faults, judged, Outcome(run, []))
        begun = lambda: page.RunPage(of_run, directory / "fields", history, making or page.here)  # noqa: E731
        of_cases = part("list of cases", run.faults, begun, None)
        summary = part("summary.md", run.faults, lambda: markdown.summary(of_run), None)
        document = part("junit.xml", run.faults, lambda: junit(of_run), None)
        html = part("page", run.faults, of_cases.render, None) if of_cases else None
        return html or bare_page(run), summary or bare_summary(run), document

    before = [fault.part for fault in run.faults]
    html, summary, document = made()
    if [fault.part for fault in run.faults] != before:  # each lists what the others lack
        html, summary, document = made()
    write_atomically(directory / "summary.md", summary)
    (directory / "junit.xml").unlink(missing_ok=True)
    if document:
        write_atomically(directory / "junit.xml", document)
    path = directory / "report.html"
    write_atomically(path, html)
    return path


def bare_headline(run: RunRecord) -> Headline:
    """Return the headline of a run whose findings are unknown."""
    return Headline("FAIL", f"the report lacks {', '.join(fault.part for fault in run.faults)}")


def bare_page(run: RunRecord) -> str:
    """Return a page that needs no template."""
    title = escape(str(bare_headline(run)))
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
            *(f"<p>{escape(line)}</p>" for line in _bare_lines(run)),
            "<table><tr><th>case</th><th>verdict</th><th>message</th></tr>",
            *rows,
            "</table></body></html>\n",
        ]
    )


def bare_summary(run: RunRecord) -> str:
    """Return a summary whose texts contain no HTML."""
    wrong = [f"{case.case}: {wording.kind(case)}: {case.message}" for case in run.cases if not case.as_expected]
    lines = [f"## eos-ref: {bare_headline(run)}", *_bare_lines(run), *wrong]
    return "\n\n".join(escape(" ".join(line.split()), quote=False) for line in lines) + "\n"


def _bare_lines(run: RunRecord) -> list[str]:
    about = f"{wording.engine(run.engine)}. {wording.tally(run)}."
    return [*wording.lacks(run.faults), about, "All numbers are in run.json and fields."]


def junit(of_run: Outcome) -> bytes:
    """Return a run as JUnit XML: one testcase per case, in the class of the first part of its name."""
    run = of_run.run
    outcomes = [_junit_outcome(case, of_run) for case in run.cases]
    attributes = {"name": "eos-ref", "tests": str(len(run.cases))}
    for kind in ("failure", "error", "skipped"):
        attributes[kind if kind == "skipped" else f"{kind}s"] = str(outcomes.count(kind))
    attributes["time"] = f"{run.seconds:.6f}"
    root = ET.Element("testsuites", attributes)
    suite = ET.SubElement(root, "testsuite", attributes)
    if run.date:
        suite.set("timestamp", _legal(run.date))
    properties = ET.SubElement(suite, "properties")
    for name, value in _junit_properties(of_run).items():
        ET.SubElement(properties, "property", {"name": _legal(name), "value": _legal(value)})
    for case, kind in zip(run.cases, outcomes, strict=True):
        _add(suite, case, kind, _legal(of_run.sentence(case)))
    ET.indent(root)
    return bytes(ET.tostring(root, encoding="utf-8", xml_declaration=True)) + b"\n"


def _junit_outcome(case: CaseRecord, of_run: Outcome) -> str:
    if case.verdict == "skipped":
        return "skipped"
    if of_run.accepted(case):
        return "passed"
    return "failure" if case.verdict in ("differs", "explained") else "error"


def _add(suite: ET.Element, case: CaseRecord, outcome: str, sentence: str) -> None:
    name = _legal(case.case)
    attributes = {"classname": f"eos-ref.{name.split('.')[0]}", "name": name, "time": f"{case.seconds.total:.6f}"}
    testcase = ET.SubElement(suite, "testcase", attributes)
    said = case_text(case)
    if outcome == "passed":
        if said and (case.verdict in ("explained", "refused") or "audit" in case.tags):
            ET.SubElement(testcase, "system-out").text = said
        return
    result = ET.SubElement(testcase, outcome, {"message": sentence})
    if outcome != "skipped":
        result.set("type", case.verdict)
        result.text = said


def case_text(case: CaseRecord) -> str:
    """Return the text of a case: how it ended, each field with its worst atom, how to run it alone."""
    lines = [f"{wording.kind(case)}: {case.message}" if case.message else wording.kind(case)]
    if case.expects:
        lines.append(f"expected refusal: {case.expects}")
    if case.explained_by:
        lines.append(f"explained by {wording.listed(case.explained_by)}")
    for field in case.fields:
        ratio = wording.number(field.max_over_bound)
        line = f"{field.field} (stage {field.stage}): {deck_wording.verdict(field)}, difference/bound {ratio}"
        line += "" if field.worst_id is None else f", atom {field.worst_id}"
        lines.append(line + (f", explained by {wording.listed(field.explained_by)}" if field.explained_by else ""))
    lines += map(str, statements(case))
    if case.reproduce:
        lines.append(f"reproduce: {case.reproduce}")
    return _legal("\n".join(lines))


def _junit_properties(of_run: Outcome) -> dict[str, str]:
    run = of_run.run
    properties = {"headline": str(of_run.headline)}
    properties |= {f"engine.{name}": str(value) for name, value in run.engine.model_dump().items() if value}
    properties |= {f"reference.{name}": version for name, version in run.reference.items()}
    return properties | ({"command": run.command} if run.command else {})


def _legal(text: str) -> str:
    return _ILLEGAL.sub("", text)


def dashboard(of_run: Outcome, title: str = "eos-ref") -> str:
    """Return a run in the dashboard's form.

    A known bug is a failure, as it is for LAMMPS' developers; its message begins with the names of the findings.
    """
    run = of_run.run
    tests = {key(case): _entry(case) for case in run.cases}
    counts = Counter(test["status"] for test in tests.values())
    branch, revision, commit = _git(run.engine.git)
    properties = {"headline": str(of_run.headline)}
    properties |= {"git_info": f"Git info ({branch} / {revision})"} if branch else {}
    properties |= {"compiler": f"Compiler: {run.engine.compiler}"} if run.engine.compiler else {}
    properties |= {"lammps": run.engine.version_string, "eos-ref": run.reference.get("eos-ref", "")}
    metadata: dict[str, Any] = {
        "title": title,
        "generated": run.date,
        "properties": properties,
        "counts": {
            "tests": len(tests),
            **{status: counts[status] for status in STATUSES},
            "time": round(sum(test["time"] for test in tests.values()), 3),
        },
    }
    # Tools write the commit that they get, and the archive keeps it as sha.
    metadata |= {"commit": commit, "sha": commit, "branch": branch} if commit else {}
    return json.dumps({"metadata": metadata, "tests": tests}, indent=2) + "\n"


def key(case: CaseRecord) -> str:
    """Return class and name of a case, as in junit.xml."""
    return f"eos-ref.{case.case.split('.')[0]}/{case.case}"


def _entry(case: CaseRecord) -> dict[str, Any]:
    status = _status(case)
    entry: dict[str, Any] = {"status": status, "time": round(case.seconds.total, 3), "message": _message(case, status)}
    outside = [field for field in case.fields if field.verdict not in GOOD]
    if status == "failed" and outside:
        entry["diverged"] = len(outside)
        looks = [(row, look) for field in outside for row, look in enumerate(field.steps)]
        first = [(row, look.step) for row, look in looks if look.verdict not in GOOD]
        if first:
            entry["diverged_row"], entry["diverged_at"] = min(first)
        entry["details"] = case_text(case)
    return entry


def _status(case: CaseRecord) -> Status:
    if case.verdict == "skipped":
        return "skipped"
    if case.verdict in ("explained", "differs"):
        return "failed"
    return "passed" if case.as_expected else "error"


def _message(case: CaseRecord, status: Status) -> str:
    if status == "passed":
        return ""
    if case.verdict == "timeout":  # the dashboard counts these words separately
        return f"failed, timeout ({round(case.seconds.total)}s expired): {case.message}"
    known = f"known: {wording.listed(case.findings)}: " if case.verdict == "explained" and case.findings else ""
    return f"{known}{case.message}" or case.verdict


def _git(text: str) -> tuple[str, str, str]:
    """Return branch, revision and commit from LAMMPS' text about its git, each empty if missing."""
    match = re.fullmatch(r"(\S+) / (\S+) / ([0-9a-f]{40})", text)
    return (match[1], match[2], match[3]) if match else ("", "", "")
