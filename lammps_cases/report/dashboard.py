"""``run.json`` of LAMMPS' dashboard: a run beside LAMMPS' own nightly ones.

The form is that of LAMMPS' tools/regression-tests/merge_results.py, as REPORTING.md beside it and the archive
lammps/lammps-test-results describe it: ``metadata`` with counts and properties, ``tests`` by class and name.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from typing import Any, Literal

from lammps_cases.records import wording
from lammps_cases.records.case_parts import FieldRecord
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.report import junit
from lammps_cases.report.findings import Outcome

Status = Literal["passed", "failed", "error", "runtest", "skipped"]
STATUSES: tuple[Status, ...] = ("passed", "failed", "error", "runtest", "skipped")  # runtest: nothing was compared
GOOD = ("exact", "pass")


def document(of_run: Outcome, title: str = "eos-ref") -> str:
    """Return a run in the dashboard's form.

    A known bug is a failure, as it is for who mends LAMMPS; its message begins with the names of the findings.
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
    # Tools write the commit that they are told, and the archive keeps it as sha.
    metadata |= {"commit": commit, "sha": commit, "branch": branch} if commit else {}
    return json.dumps({"metadata": metadata, "tests": tests}, indent=2) + "\n"


def key(case: CaseRecord) -> str:
    """Return class and name of a case, as they stand in junit.xml."""
    return f"eos-ref.{case.case.split('.')[0]}/{case.case}"


def _entry(case: CaseRecord) -> dict[str, Any]:
    status = _status(case)
    entry: dict[str, Any] = {"status": status, "time": round(case.seconds.total, 3), "message": _message(case, status)}
    outside = [field for field in case.fields if field.verdict not in GOOD]
    if status == "failed" and outside:
        entry["diverged"] = len(outside)
        first = [place for field in outside if (place := _first(field))]
        if first:
            entry["diverged_row"], entry["diverged_at"] = min(first)
        entry["details"] = junit.text(case)
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
    if case.verdict == "timeout":  # which the dashboard counts apart by these words
        return f"failed, timeout ({round(case.seconds.total)}s expired): {case.message}"
    known = f"known: {wording.listed(case.findings)}: " if case.verdict == "explained" and case.findings else ""
    return f"{known}{case.message}" or case.verdict


def _first(field: FieldRecord) -> tuple[int, int] | None:
    """Return at which of the looks a field leaves its bound first, and the step of that."""
    rows = [(row, look.step) for row, look in enumerate(field.steps) if look.verdict not in GOOD]
    return rows[0] if rows else None


def _git(text: str) -> tuple[str, str, str]:
    """Return branch, revision and commit of what LAMMPS says of its git, each empty if there is none."""
    match = re.fullmatch(r"(\S+) / (\S+) / ([0-9a-f]{40})", text)
    return (match[1], match[2], match[3]) if match else ("", "", "")
