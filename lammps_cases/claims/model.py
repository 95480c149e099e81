"""The model of a claim, and the files of claims: one for each manual page."""

from __future__ import annotations

import fnmatch
import functools
from collections.abc import Sequence
from typing import Any, Literal, get_args

from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError, model_validator

from eos_ref import InputError
from eos_ref.errors import unknown
from lammps_cases.records.files import DATA
from lammps_cases.records.yaml_files import OfManual, read_yaml

FOLDER = DATA / "claims"
Page = Literal["fix rheo", "fix rheo/pressure"]
Kind = Literal[
    "syntax",
    "style",
    "keyword",
    "argument",
    "types",
    "unit",
    "formula",
    "behaviour",
    "default",
    "restriction",
    "example",
    "output",
    "reference",
    "wording",
    "page",
]
KINDS: tuple[Kind, ...] = get_args(Kind)
_FILES: dict[Page, str] = {"fix rheo": "rheo.yaml", "fix rheo/pressure": "pressure.yaml"}


class Claim(OfManual):
    """One testable statement of a manual page.

    Attributes
    ----------
    id : a stable name
    page, section : where the manual makes it
    kind : its subject
    text : the statement, paraphrased
    consequence : what would be observed if the statement were false, and where the evidence looks for it
    cases : patterns of the cases, and of the probes (``probes.ID``), that would show it to be false
    fields : the fields of these cases that carry it; all by default
    refuted_by : ids of the findings that contradict it
    untestable : why no LAMMPS can show it; then without cases
    argument : for kind page: why the statement stands or falls by the words of the page alone; then without cases
    falls : whether it falls
    remark : additional information for readers of the verdict
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    id: str
    page: Page
    section: str
    kind: Kind
    text: str
    consequence: str
    cases: tuple[str, ...] = ()
    fields: tuple[str, ...] = ()
    refuted_by: tuple[str, ...] = ()
    untestable: str = ""
    argument: str = ""
    falls: bool = False
    remark: str = ""

    @model_validator(mode="after")
    def _judged(self) -> Claim:
        if sum(map(bool, (self.cases, self.untestable, self.argument))) != 1:
            raise ValueError(f"claim {self.id} needs one of cases, untestable and argument")
        if bool(self.argument) != (self.kind == "page") or (self.falls and not self.argument):
            raise ValueError(f"claim {self.id}: an argument goes with the kind page, and what falls has one")
        if not self.consequence:
            raise ValueError(f"claim {self.id} needs a consequence")
        return self


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    page: Page
    sections: dict[str, tuple[dict[str, Any], ...]]


@functools.cache
def claims() -> tuple[Claim, ...]:
    """Return all claims, in the order of the pages.

    Raises
    ------
    InputError
        A file with an unknown key, or a claim twice.
    """
    every: list[Claim] = []
    for page, name in _FILES.items():
        file = _read(name, _File)
        rows = [{**row, "page": page, "section": section} for section, of in file.sections.items() for row in of]
        every += _checked(rows, tuple[Claim, ...], name)
    ids: set[str] = set()
    for claim in every:
        if claim.id in ids:
            raise InputError("claim", "must have an id of its own", claim.id)
        ids.add(claim.id)
    return tuple(every)


@functools.cache
def without_claim() -> dict[str, str]:
    """Return patterns of cases that no claim names, with the reasons."""
    return dict(_read("unclaimed.yaml", dict[str, str]))


def _read(name: str, kind: Any) -> Any:
    return _checked(read_yaml(FOLDER / name), kind, name)


def _checked(data: Any, kind: Any, name: str) -> Any:
    try:
        return TypeAdapter(kind).validate_python(data)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise InputError("claims", f"{where}: {first['msg']}", where=name) from None


def select(names: Sequence[str]) -> list[Claim]:
    """Return claims by id or wildcard pattern, by page, by kind, or by a case; all without names.

    Raises
    ------
    InputError
        A name without a match; the nearest is suggested.
    """
    every = claims()
    if not names:
        return list(every)
    wanted: set[str] = set()
    for name in names:
        hits = [
            c.id
            for c in every
            if fnmatch.fnmatchcase(c.id, name)
            or name in (c.page, c.kind)
            or any(fnmatch.fnmatchcase(name, pattern) for pattern in c.cases)
        ]
        if not hits:
            raise unknown("claim", name, (c.id for c in every))
        wanted.update(hits)
    return [claim for claim in every if claim.id in wanted]
