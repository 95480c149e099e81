"""CI annotations next to the code: GitHub's workflow commands and job summary, GitLab's code quality.

The functions are pure except `announce`, which writes where the service that runs this job requires.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import re
import shlex
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Literal

import yaml

from lammps_cases.records import wording
from lammps_cases.records.files import read_text, write_atomically
from lammps_cases.records.headline import LOOKS
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.records.yaml_files import LARGEST
from lammps_cases.report.findings import Outcome
from lammps_cases.report.markdown import summary
from lammps_cases.scene.casefile import SHIPPED

MOST = 10  # annotations of one level that GitHub shows of a step; it drops the rest silently
SUMMARY_LIMIT = 1_048_576  # bytes of a job summary; GitHub refuses a longer one altogether
CODE_QUALITY = "gl-code-quality-report.json"

Level = Literal["error", "warning", "notice"]
Severity = Literal["info", "minor", "major", "critical", "blocker"]
SEVERITY: dict[str, Severity] = {"explained": "minor", "differs": "major", "refused": "major"}  # others: critical


# --- the location of a case


def case_lines(path: Path) -> dict[str, int]:
    """Return the line, from 1, of each case of a case file; empty if the file cannot be read.

    A case of a matrix is located at its label, in the axis with the most labels, the most specific one.
    """
    try:
        root = yaml.compose(read_text(path, "case file", LARGEST), yaml.SafeLoader)
    except (ValueError, RecursionError, yaml.YAMLError):
        return {}
    keys = _children(root)
    if "name" not in keys:
        return {}
    name, line = str(keys["name"][1].value), keys["name"][0].start_mark.line + 1
    axes = []
    for _, axis in _children(keys["matrix"][1]).values() if "matrix" in keys else ():
        axes.append({label: key.start_mark.line + 1 for label, (key, _) in _children(axis).items()})
    longest = max(range(len(axes)), key=lambda at: len(axes[at]), default=None)
    return {
        ".".join((name, *labels)): line if longest is None else axes[longest][labels[longest]]
        for labels in itertools.product(*axes)
    }


def _children(node: yaml.Node | None) -> dict[str, tuple[yaml.Node, yaml.Node]]:
    pairs = node.value if isinstance(node, yaml.MappingNode) else []
    return {str(key.value): (key, value) for key, value in pairs}


def source_of(case: CaseRecord) -> Path | None:
    """Return the case file, or the audited deck, of a record; None if it names none."""
    try:
        words = shlex.split(case.reproduce)
    except ValueError:  # an unclosed quote, in a record made elsewhere
        return None
    if words[1:2] == ["audit"] and len(words) > 2:
        return Path(words[2])
    if not case.source:
        return None
    return Path(case.source) if "--cases" in words else SHIPPED / case.source


def place(case: CaseRecord, root: Path) -> tuple[str, int] | None:
    """Return file (relative to the repository at ``root``) and line of a case; None if it lies elsewhere."""
    source = source_of(case)
    if source is None:
        return None
    line = case_lines(source).get(case.case, 1)
    if "audit" in case.tags:
        source, line = deck_place(case, source)
    try:
        inside = source.resolve().relative_to(root.resolve())
    except ValueError:
        return None
    return inside.as_posix(), line


_AT = re.compile(r"\(([^():\s]+):([0-9]{1,9})\)\s*$")  # in LAMMPS' error: file, from the deck's folder, and line
_FIX = re.compile(r"\bfix (\S+) \(([\w/]+)\)")  # in warnings and findings


def deck_place(case: CaseRecord, deck: Path) -> tuple[Path, int]:
    """Return file and line of a deck at which LAMMPS stopped, or of the fix that a warning names, or the first line."""
    if (at := _AT.search(case.engine_error)) and (file := deck.parent / at[1]).is_file():
        return file, int(at[2])
    try:
        commands = [line.split() for line in read_text(deck, "deck", LARGEST).splitlines()]
    except ValueError:
        return deck, 1
    for warned in _FIX.finditer("\n".join(case.warnings)):
        for number, words in enumerate(commands, 1):
            if words[:2] == ["fix", warned[1]] and words[3:4] == [warned[2]]:
                return deck, number
    return deck, 1


# --- GitHub


def workflow_commands(of_run: Outcome, root: Path) -> list[str]:
    """Return GitHub's annotations of a run: its headline, errors for cases not accepted, worst first, then the notes.

    If there are more than GitHub shows, the last one counts them.
    """
    cases, headline = of_run.unaccepted, of_run.headline
    words = f"{headline.sentence}\n{wording.engine(of_run.run.engine)}"
    lines = [command(headline.look.level, words, {"title": f"eos-ref: {headline.state}"})]
    room = MOST - 1  # one is the headline
    for case in cases[: room if len(cases) <= room else room - 1]:
        at = place(case, root)
        where = {"file": at[0], "line": str(at[1])} if at else {}
        words = "\n".join(filter(None, (of_run.sentence(case), case.reproduce)))
        lines.append(command("error", words, {**where, "title": f"{wording.kind(case)}: {case.case}"}))
    if len(cases) > room:
        rest = f"{len(cases) - room + 1} more cases are not as expected: see the job summary"
        lines.append(command("error", rest, {"title": "eos-ref"}))
    return [*lines, *(command("notice", note, {"title": "eos-ref"}) for note in of_run.run.notes[:room])]


def command(level: Level, message: str, properties: Mapping[str, str]) -> str:
    """Return one workflow command, escaped for GitHub's runner."""
    given = ",".join(f"{name}={_escaped(value, of_property=True)}" for name, value in properties.items())
    return f"::{level} {given}::{_escaped(message)}"


def _escaped(text: str, of_property: bool = False) -> str:
    characters = {"%": "%25", "\r": "%0D", "\n": "%0A"} | ({":": "%3A", ",": "%2C"} if of_property else {})
    return "".join(characters.get(c, c) for c in text)


def fitted(summary: str, taken: int, limit: int = SUMMARY_LIMIT) -> str:
    """Keep as many whole lines of a summary as fit with ``taken`` bytes, and a note about the omitted ones."""
    room = limit - taken
    if len(summary.encode()) <= room:
        return summary
    last = "\n… cut here: a job summary must stay below 1 MiB; all of it is in summary.md of the report.\n"
    lines, used = [], len(last.encode())
    for line in summary.splitlines(keepends=True):
        used += len(line.encode())
        if used > room:
            break
        lines.append(line)
    return "".join([*lines, last]) if len(last.encode()) <= room else ""


# --- GitLab


def code_quality(of_run: Outcome, root: Path) -> str:
    """Return GitLab's code quality report: an entry for each case not accepted, worst first."""
    return json.dumps([_entry(of_run, case, root) for case in of_run.unaccepted], indent=1) + "\n"


def _entry(of_run: Outcome, case: CaseRecord, root: Path) -> dict[str, object]:
    path, line = place(case, root) or (case.source or case.case, 1)
    identity = "\n".join((path, case.case, case.verdict))  # GitLab tells old from new by it: no numbers in it
    return {
        "description": f"{case.case}: {of_run.sentence(case)}",
        "check_name": f"eos-ref/{case.verdict}",
        "fingerprint": hashlib.sha256(identity.encode()).hexdigest(),
        "severity": SEVERITY.get(case.verdict, "critical"),
        "location": {"path": path, "lines": {"begin": line}},
    }


# --- output for the service


def announce(of_run: Outcome, directory: Path, environ: Mapping[str, str]) -> None:
    """Report a run, whose report lies in ``directory``, to the CI service that runs this job, if any.

    On GitHub the annotations are printed and the summary joins the job's; on GitLab `CODE_QUALITY` is written into the
    project's folder.
    """
    if environ.get("GITHUB_ACTIONS") == "true":
        root = Path(environ.get("GITHUB_WORKSPACE") or ".")
        _say(workflow_commands(of_run, root))
        if environ.get("GITHUB_STEP_SUMMARY"):
            _append(Path(environ["GITHUB_STEP_SUMMARY"]), _summary(of_run, directory))
    if environ.get("GITLAB_CI") == "true":
        root = Path(environ.get("CI_PROJECT_DIR") or ".")
        write_atomically(root / CODE_QUALITY, code_quality(of_run, root))


def announce_changes(changes: Sequence[str], environ: Mapping[str, str]) -> None:
    """Report to GitHub how a run differs from its accepted baseline, a line each."""
    if not changes or environ.get("GITHUB_ACTIONS") != "true":
        return
    title = {"title": "eos-ref: changed against the baseline"}
    _say(command("error", change, title) for change in changes[:MOST])
    if environ.get("GITHUB_STEP_SUMMARY"):
        listed = "\n".join(f"- {change}" for change in changes)
        _append(
            Path(environ["GITHUB_STEP_SUMMARY"]), f"### {LOOKS['FAIL'].mark} Changed against the baseline\n\n{listed}\n"
        )


def _say(lines: Iterable[str]) -> None:
    for line in lines:
        print(line, flush=True)


def _summary(of_run: Outcome, directory: Path) -> str:
    written = directory / "summary.md"
    return written.read_text(encoding="utf-8") if written.is_file() else summary(of_run)


def _append(file: Path, summary: str) -> None:
    taken = file.stat().st_size if file.exists() else 0
    with file.open("a", encoding="utf-8") as end:
        end.write(fitted(summary, taken))
