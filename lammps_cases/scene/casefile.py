"""Case files: YAML, one case or a matrix of cases each.

A file holds ``name``, ``about``, ``tags``, a ``scene`` and, optionally, a ``matrix``: axes of named patches that are
merged into the scene (``key+`` appends to a list, null removes), every combination one case ``name.label1.label2``.
``exercises`` says which rules of the reference (`lammps_cases.rules`) its cases are for, by patterns of their labels.
"""

from __future__ import annotations

import fnmatch
import itertools
import math
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, WithJsonSchema

from eos_ref import InputError
from eos_ref.errors import nearest, unknown
from eos_ref.syntax.manual import Manual
from lammps_cases.records.yaml_files import read_yaml
from lammps_cases.rules import RULES
from lammps_cases.scene import Scene, check_name, models

MAX_CASES = 10_000  # of one file
SHIPPED = Path(__file__).parents[1] / "cases"
RuleName = Annotated[str, WithJsonSchema({"enum": list(RULES)})]  # for editors; checked by its own complaint


@dataclass(frozen=True)
class Case:
    """One case: a scene with a name, where it comes from, its seed (the name itself), and the rules it is for."""

    name: str
    about: str
    tags: tuple[str, ...]
    scene: Scene
    source: Path
    shipped: bool = field(default=True, compare=False)
    exercises: tuple[str, ...] = ()

    @property
    def where(self) -> str:
        """Return the place for messages: file and case."""
        return f"{self.source.name}, case {self.name}"

    def by(self, manual: Manual) -> Case:
        """Return the case with the manual's version that the reference is to follow."""
        if manual == self.scene.manual:
            return self
        return replace(self, scene=self.scene.model_copy(update={"manual": manual}))

    def reproduce(self, engine: str = "env") -> str:
        """Return the command that runs this case alone, on the same engine."""
        own = [] if self.shipped else ["--cases", str(self.source)]
        other = [] if engine == "env" else ["--engine", engine]
        return shlex.join(["eos-ref", "run", *own, *other, self.name])


class CaseFile(BaseModel):
    """The keys of a case file."""

    model_config = ConfigDict(extra="forbid")

    name: str
    about: str = Field(description="what the case is for, in a sentence or two")
    tags: list[str] = []
    exercises: dict[str, list[RuleName]] = Field(
        {}, description="pattern of labels (*, rk1.*): rules of the reference that these cases are for"
    )
    matrix: dict[str, dict[str, dict[str, Any]]] = Field({}, description="axis: {label: patch of the scene}")
    scene: dict[str, Any]


def merge(base: Any, patch: Any) -> Any:
    """Merge a patch into a base: mappings key by key, anything else replaced.

    A null removes a key; ``key+`` appends to the list ``key``.
    """
    if not (isinstance(base, Mapping) and isinstance(patch, Mapping)):
        return patch
    merged = dict(base)
    for key, value in patch.items():
        if value is None:
            merged.pop(key, None)
        elif isinstance(key, str) and key.endswith("+") and isinstance(value, list):
            before = merged.get(key[:-1], [])
            if not isinstance(before, list):
                raise InputError(key, "must append to a list", before)
            merged[key[:-1]] = [*before, *value]
        else:
            merged[key] = merge(base.get(key), value) if key in base else value
    return merged


def _validation_error(error: ValidationError, where: str, data: Any) -> InputError:
    """Return the first complaint of pydantic in one line: key, rule, value found, file."""
    first = error.errors(include_url=False)[0]
    # Parts with a space or a hyphen are pydantic's names of validators and alternatives, not keys of the file.
    place = [str(part) for part in first["loc"] if not set(" -") & set(str(part))]
    rule = first["msg"].removeprefix("Value error, ")
    if first["type"] == "extra_forbidden":
        keys = [*CaseFile.model_fields, *_scene_keys()]
        return InputError(".".join(place), f"unknown key{nearest(place[-1], keys)}", where=where)
    value = None if first["type"] in ("missing", "value_error") else first.get("input")
    return InputError(".".join(place) or "scene", rule, value, where)


def _scene_keys() -> Iterable[str]:
    for model in models():
        yield from model.model_fields


def load_file(path: Path, shipped: bool = False) -> list[Case]:
    """Return all cases of a file, sorted by name.

    Raises
    ------
    InputError
        Unreadable, unknown key, wrong type, bad value: one line with file and key.
    """
    data = read_yaml(path)
    if not isinstance(data, dict) or not data:
        raise InputError("case file", "must hold the keys name, about, scene", type(data).__name__, str(path))
    try:
        file = CaseFile.model_validate(data)
    except ValidationError as error:
        raise _validation_error(error, str(path), data) from None
    check_name(file.name, str(path))
    count = math.prod(len(axis) for axis in file.matrix.values())
    if not 1 <= count <= MAX_CASES:
        raise InputError("matrix", f"must make 1 to {MAX_CASES} cases", count, str(path))
    cases = []
    for combination in itertools.product(*(axis.items() for axis in file.matrix.values())):
        name = ".".join([file.name, *(check_name(label, str(path)) for label, _ in combination)])
        content: Any = file.scene
        for _, patch in combination:
            try:
                content = merge(content, patch)
            except InputError as error:
                raise error.at(f"{path}, case {name}") from None
        tags = list(file.tags)
        if isinstance(content.get("tags"), list):  # a patch may add tags
            content = dict(content)
            tags += content.pop("tags")
        case = _case(name, file.about, tags, content, path, shipped)
        cases.append(replace(case, exercises=_exercises(file, name)))
    _check_exercises(file, [case.name for case in cases], str(path))
    return sorted(cases, key=lambda case: case.name)


def _labels(name: str) -> str:
    """Return the labels of a case, without the name of its file."""
    return name.partition(".")[2]


def _exercises(file: CaseFile, name: str) -> tuple[str, ...]:
    """Return the rules that a file names for one of its cases, each once."""
    chosen = [rules for pattern, rules in file.exercises.items() if fnmatch.fnmatchcase(_labels(name), pattern)]
    return tuple(dict.fromkeys(itertools.chain.from_iterable(chosen)))


def _check_exercises(file: CaseFile, names: Sequence[str], where: str) -> None:
    """Check that a file's patterns are of its cases, and its rules of the reference.

    Raises
    ------
    InputError
    """
    for pattern, rules in file.exercises.items():
        for rule in rules:
            if rule not in RULES:
                raise unknown("rule", rule, RULES).at(f"{where}, exercises")
        if not fnmatch.filter(map(_labels, names), pattern):
            raise InputError("exercises", "a pattern must be of labels of the file's cases", pattern, where)


def _case(name: str, about: str, tags: Sequence[str], content: Any, path: Path, shipped: bool) -> Case:
    where = f"{path}, case {name}"
    try:
        scene = Scene.model_validate(content)
    except ValidationError as error:
        raise _validation_error(error, where, content) from None
    if scene.expect is None:
        eos = scene.eos(where)
        if eos.needs_energy and scene.energy is None and not hasattr(scene.positions, "extxyz"):
            raise InputError("energy", "ideal/gas needs the energy of every particle", where=where)
        if scene.rho is None and not scene.rho_sum and not hasattr(scene.positions, "extxyz"):
            raise InputError("rho", "must be given unless rho_sum is on or a file holds it", where=where)
    return Case(name, " ".join(about.split()), tuple(sorted(set(tags))), scene, path, shipped)


def load(paths: Sequence[Path] = ()) -> list[Case]:
    """Return all cases of some files and folders (default: those shipped), sorted by name.

    Raises
    ------
    InputError
        A bad file, no file at all, or two cases of one name.
    """
    shipped = not paths
    files: list[Path] = []
    for path in paths or [SHIPPED]:
        files += sorted([*path.rglob("*.yaml"), *path.rglob("*.yml")]) if path.is_dir() else [path]
    if not files:
        raise InputError("cases", "no case file (*.yaml) found", where=", ".join(map(str, paths)))
    cases = sorted((case for file in files for case in load_file(file, shipped)), key=lambda case: case.name)
    for one, other in itertools.pairwise(cases):
        if one.name == other.name:
            raise InputError("case name", "must be unique", one.name, f"{one.source} and {other.source}")
    return cases


def select(cases: Sequence[Case], names: Sequence[str] = (), tag: str | None = None) -> list[Case]:
    """Return the cases by name or wild-card pattern and by tag; without either, all that are not tagged long.

    A name also selects the cases below it: ``near-rho0`` selects ``near-rho0.linear.2d``.

    Raises
    ------
    InputError
        A name that matches no case (the nearest is suggested) or a tag that no case has.
    """
    names_chosen = set[str]().union(*(_names_like(name, cases) for name in names))
    chosen = [case for case in cases if not names or case.name in names_chosen]
    if tag is not None:
        chosen = [case for case in chosen if tag in case.tags]
        if not chosen:
            tags = sorted({each for case in cases for each in case.tags})
            raise InputError("tag", f"no case has it (tags: {', '.join(tags)})", tag)
    elif not names:
        chosen = [case for case in chosen if "long" not in case.tags]
    if not chosen:
        raise InputError("cases", "none is left to run (all are tagged long?)")
    return chosen


def _names_like(name: str, cases: Sequence[Case]) -> list[str]:
    """Return the names of cases that a name or pattern selects."""
    names = [c.name for c in cases if fnmatch.fnmatchcase(c.name, name) or c.name.startswith(f"{name}.")]
    if not names:
        candidates = sorted({part for c in cases for part in (c.name, c.name.split(".")[0])})
        raise unknown("case", name, candidates)
    return names
