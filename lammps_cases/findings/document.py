"""The text of a finding: a Markdown file in ``lammps_cases/data/findings``, its source.

The front matter holds the id, the place in the ledger, what a list of findings shows, and the numbers of the text by
name, as they are printed. Four headings follow, each with a paragraph, in which a backslash removes the Markdown
meaning of the next character. A fifth may follow, with a block of YAML: the smallest scene, how the numbers follow
from it, and what runs the workaround (`lammps_cases.bugs.report.Demonstration`).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields
from pathlib import Path
from typing import Any

from eos_ref import InputError
from lammps_cases.records.files import MIB, read_text
from lammps_cases.records.levels import SEVERITIES, Severity
from lammps_cases.records.yaml_files import parse_yaml

FOLDER = Path(__file__).parents[1] / "data" / "findings"
SECTIONS = {
    "documented": "What is documented",
    "observed": "What LAMMPS does",
    "argument": "Why this is wrong",
    "workaround": "Workaround",
}
_ESCAPED = re.compile(r"\\([!-/:-@\[-`{-~])")  # as in CommonMark
_BLOCK = re.compile(r"^## Demonstration\n\n```yaml\n(.*)^```\n\Z", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True, kw_only=True)
class FindingText:
    """What the document of a finding holds.

    Attributes
    ----------
    number : place in the ledger; variants are tried and named in the order in which they were added
    effect : what it does to a user, in one line
    remedy : what LAMMPS would have to compute, check or say instead, as a formula or in one sentence;
        begins with "Words only:" where only the manual has to change
    cause : what several findings have in common, by which a list groups them
    documented, observed : what the manual says (with its place), what LAMMPS does
    argument : why the documented behaviour is the right one
    workaround : what a user can do until it is fixed
    upstream : its status at LAMMPS: unreported, the address of an issue, or "fixed in VERSION"
    scene : the smallest scene that shows it
    numbers : the numbers of the text by their names, as they are printed
    formulas : what the site sets as a formula: LaTeX by the words of the text
    """

    id: str
    number: int
    title: str
    severity: Severity
    effect: str
    remedy: str
    documented: str
    observed: str
    argument: str
    workaround: str
    cause: str = ""
    upstream: str = "unreported"
    scene: str = ""
    numbers: Mapping[str, str] = field(default_factory=dict, hash=False)
    formulas: Mapping[str, str] = field(default_factory=dict, hash=False)


_TABLES = ("numbers", "formulas")
_KEYS = {each.name: each.default is MISSING and each.name not in _TABLES for each in fields(FindingText)}


def document(name: str, folder: Path = FOLDER) -> dict[str, Any]:
    """Return the fields of the text of a finding.

    Raises
    ------
    InputError
        No such file, or a damaged one; the message names the key.
    """
    path = folder / f"{name}.md"
    front, end, body = _BLOCK.sub("", read_text(path, "finding", MIB)).partition("\n---\n")
    data = parse_yaml(front, path, "finding") if end else None
    if not isinstance(data, dict):
        raise InputError("finding", "must begin with front matter between two lines of ---", where=str(path))
    heads, texts = re.findall(r"^## (.*)$", body, re.MULTILINE), re.split(r"^## .*$", body, flags=re.MULTILINE)
    if heads != list(SECTIONS.values()):
        raise InputError("headings", f"must be {', '.join(SECTIONS.values())}", heads, str(path))
    data |= {key: _ESCAPED.sub(r"\1", " ".join(text.split())) for key, text in zip(SECTIONS, texts[1:], strict=True)}
    _check(data, name, path)
    return data


def demonstration(name: str, folder: Path = FOLDER) -> dict[str, Any]:
    """Return the data of the last section of a document; empty without one.

    Raises
    ------
    InputError
        No such file, or a block that is not YAML.
    """
    path = folder / f"{name}.md"
    block = _BLOCK.search(read_text(path, "finding", MIB))
    return dict(parse_yaml(block[1], path, "demonstration of a finding")) if block else {}


def _check(data: Mapping[str, Any], name: str, path: Path) -> None:
    for key, value in data.items():
        if key not in _KEYS:
            raise InputError(key, f"is no key of a finding; these are {', '.join(_KEYS)}", where=str(path))
        kind = dict if key in _TABLES else int if key == "number" else str
        if type(value) is not kind or not value:
            raise InputError(key, "must be a whole number" if kind is int else "must be text", value, str(path))
    missing = [key for key, needed in _KEYS.items() if needed and key not in data]
    if missing:
        raise InputError(missing[0], "is missing", where=str(path))
    for table in _TABLES:
        for key, value in data.get(table, {}).items():
            if not (isinstance(key, str) and isinstance(value, str)):
                raise InputError(f"{table}.{key}", "must be a name and text in quotes", value, str(path))
    if data["severity"] not in SEVERITIES:
        raise InputError("severity", f"must be {', '.join(SEVERITIES)}", data["severity"], str(path))
    if data["id"] != name:
        raise InputError("id", f"must be {name}, as the file", data["id"], str(path))
