"""``junit.xml``: a run as CI servers read it."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET

from lammps_cases.records import deck_wording, wording
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.report.findings import Outcome
from lammps_cases.report.statements import statements

# XML 1.0 has no way to write most control characters, and LAMMPS echoes whatever a deck contains.
_ILLEGAL = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def document(of_run: Outcome) -> bytes:
    """Return a run as JUnit XML: one testcase per case, in the class of the first part of its name."""
    run = of_run.run
    outcomes = [_outcome(case, of_run) for case in run.cases]
    attributes = {"name": "eos-ref", "tests": str(len(run.cases))}
    for outcome in ("failure", "error", "skipped"):
        attributes[outcome if outcome == "skipped" else f"{outcome}s"] = str(outcomes.count(outcome))
    attributes["time"] = f"{run.seconds:.6f}"
    root = ET.Element("testsuites", attributes)
    suite = ET.SubElement(root, "testsuite", attributes)
    if run.date:
        suite.set("timestamp", _legal(run.date))
    properties = ET.SubElement(suite, "properties")
    for name, value in _properties(of_run).items():
        ET.SubElement(properties, "property", {"name": _legal(name), "value": _legal(value)})
    for case, outcome in zip(run.cases, outcomes, strict=True):
        _add(suite, case, outcome, _legal(of_run.sentence(case)))
    ET.indent(root)
    return bytes(ET.tostring(root, encoding="utf-8", xml_declaration=True)) + b"\n"


def _outcome(case: CaseRecord, of_run: Outcome) -> str:
    if case.verdict == "skipped":
        return "skipped"
    if of_run.accepted(case):
        return "passed"
    return "failure" if case.verdict in ("differs", "explained") else "error"


def _add(suite: ET.Element, case: CaseRecord, outcome: str, sentence: str) -> None:
    name = _legal(case.case)
    attributes = {"classname": f"eos-ref.{name.split('.')[0]}", "name": name, "time": f"{case.seconds.total:.6f}"}
    testcase = ET.SubElement(suite, "testcase", attributes)
    said = text(case)
    if outcome == "passed":
        if said and (case.verdict in ("explained", "refused") or "audit" in case.tags):
            ET.SubElement(testcase, "system-out").text = said
        return
    result = ET.SubElement(testcase, outcome, {"message": sentence})
    if outcome != "skipped":
        result.set("type", case.verdict)
        result.text = said


def text(case: CaseRecord) -> str:
    """Return what is said of a case: how it ended, each field with its worst atom, how to run it alone."""
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


def _properties(of_run: Outcome) -> dict[str, str]:
    run = of_run.run
    properties = {"headline": str(of_run.headline)}
    properties |= {f"engine.{name}": str(value) for name, value in run.engine.model_dump().items() if value}
    properties |= {f"reference.{name}": version for name, version in run.reference.items()}
    return properties | ({"command": run.command} if run.command else {})


def _legal(text: str) -> str:
    return _ILLEGAL.sub("", text)
