"""Documents of ``eos-ref/run/1``, in which facts stood in sentences alone: the one place where sentences are parsed."""

from __future__ import annotations

import re
from typing import Any

from pydantic import BaseModel
from pydantic_core import from_json, to_json

SCHEMA = "eos-ref/run/1"
_Case = dict[str, Any]


class _Explained(BaseModel):
    explained_by: str | None = None


class _Judged(_Explained):
    verdict: str
    message: str = ""
    fields: list[_Explained] = []


class _Document(BaseModel):
    """What is read of a document here; the rest is checked when it is of schema 2."""

    cases: list[_Judged] = []


_PREDICTED = re.compile(r"(?P<verdict>\w+), as ledger entry \S+ predicts: ")
_ONLY_TWIN = re.compile(r"LAMMPS answers, and its twin \(\S+\) does not: ")
_OTHER_WORDS = re.compile(r"expected an error with .*?, LAMMPS said: ")
_ACCEPTED = "LAMMPS accepts what the manual refuses"
_LOST = re.compile(
    r"id \(stage input\): LAMMPS returned (?P<returned>\d+) of (?P<given>\d+) atoms; "
    r"first missing, foreign or doubled id: (?P<first_id>\d+)"
)
_STEPS = re.compile(r"LAMMPS counted steps \((?P<counted>[\d, ]*)\) where it was asked for \((?P<asked>[\d, ]*)\)")
_HARNESS = re.compile(r"(?:(?P<exception>\w+) in the harness|judging failed): (?P<text>.*)")
_TWIN = re.compile(r"LAMMPS against itself \(twin: \S+\): ")
_NOT_SAME = "; the reference differs as well, so the two are not the same problem"
_BLAME = re.compile(
    r"(?P<field>\S+) \(stage (?P<stage>\S+)\) leaves its bound (?:at step (?P<step>\d+) )?at (?P<outside>\d+) of "
    r"(?P<of>\d+) atoms, first atom (?P<atom>\d+)(?: \(type (?P<type>\d+), rho (?P<rho>\S+)\))?: "
    r"(?:LAMMPS|as given) (?P<lammps>\S+), (?:reference|as its \S+ twin) (?P<reference>\S+), bound (?P<bound>[^\s;]+)"
)
_AUDIT = re.compile(
    r"(?P<field>\S+) leaves its bound first at step (?P<step>\d+) \(run (?P<run>\d+)\), "
    r"(?:type (?P<type>\d+), )?atom (?P<atom>\d+): (?P<outside>\d+) of (?P<of>\d+) atoms outside, "
    r"\|LAMMPS - reference\| up to (?P<max_abs>\S+) = (?P<max_over_bound>\S+) x bound \(atom (?P<worst_id>\d+)\)(?:; )?"
)
_DIED = re.compile(r"SIG[A-Z]+|exit code \d+|exited with code \d+|out of memory")
_BEYOND = re.compile(r"; beyond (?P<findings>[^:]+): ")


def finding_ids(text: str | None) -> list[str]:
    """List the findings that one line of text names, as baselines and histories keep them."""
    return text.split(", ") if text else []


def upgraded(content: bytes) -> bytes:
    """Make a run.json of schema 2 from one of schema 1.

    Raises
    ------
    pydantic.ValidationError
    """
    _Document.model_validate_json(content)
    document = from_json(content) | {"schema": "eos-ref/run/2"}
    for case in document.get("cases", []):
        _upgrade(case)
    return to_json(document)


def _upgrade(case: _Case) -> None:
    for record in (case, *case.get("fields", [])):
        record["explained_by"] = finding_ids(record.get("explained_by"))
    text: str = case.get("message", "")
    case["ended"] = _ended(case, text)
    if case["ended"] == "unusable":
        case["unusable"] = _unusable(text)
    elif case["ended"] == "error" and (fault := _HARNESS.fullmatch(text)):
        case["harness_error"] = {name: value or "" for name, value in fault.groupdict().items()}
    elif case.get("fields"):
        case |= _blamed(text)
    elif case["ended"] != "accepted":
        for sentence, fact in ((_ONLY_TWIN, {"only_twin": True}), (_PREDICTED, {}), (_OTHER_WORDS, {})):
            if match := sentence.match(text):
                case |= fact
                text = text[match.end() :]
        case["engine_error"] = text
        if case["ended"] == "crashed" and (died := _DIED.search(text)):
            case["died"] = died[0].replace("exited with", "exit")


def _ended(case: _Case, text: str) -> str:
    """Return how LAMMPS ended a case, whatever was expected of it and whatever explains it."""
    verdict = case["verdict"]
    if verdict in ("refused", "crashed", "timeout", "error", "skipped"):
        return str(verdict)
    if case.get("fields"):
        return "answered"
    predicted = _PREDICTED.search(text)
    if predicted and predicted["verdict"] in ("refused", "crashed", "timeout", "error"):
        return predicted["verdict"]
    if _ACCEPTED in text:
        return "accepted"
    if _OTHER_WORDS.search(text):
        return "refused"
    return "unusable" if verdict == "differs" else "answered"


def _unusable(text: str) -> _Case | None:
    if lost := _LOST.fullmatch(text):
        return _numbers(lost)
    steps = _STEPS.fullmatch(text)
    return (
        {side: [n.strip() for n in steps[side].split(",") if n.strip()] for side in ("counted", "asked")}
        if steps
        else None
    )


def _blamed(text: str) -> _Case:
    """Parse a sentence about numbers; what follows the blame of an audit is how LAMMPS ended."""
    if audit := _AUDIT.match(text):
        return {"blame": _numbers(audit), "engine_error": text[audit.end() :]}
    start = _TWIN.match(text)
    first = _BLAME.match(text, start.end() if start else 0)
    if first is None:
        return {}
    facts: _Case = {"blame": _numbers(first), "not_same_problem": text.endswith(_NOT_SAME)}
    beyond = _BEYOND.match(text, first.end())
    rest = beyond and _BLAME.fullmatch(text, beyond.end())
    if beyond and rest:
        facts["beyond"] = {"findings": finding_ids(beyond["findings"]), "blame": _numbers(rest)}
    return facts


def _numbers(match: re.Match[str]) -> _Case:
    """Return groups as the model takes them: text that is a number is read by it."""
    return {name: value for name, value in match.groupdict().items() if value is not None}
