"""Case files: YAML, one case or a matrix of cases each.

A file holds ``name``, ``about``, ``tags``, a ``scene`` and, optionally, a ``matrix``: axes of named patches that are
merged into the scene (``key+`` appends to a list, null removes), every combination one case ``name.label1.label2``.
``exercises`` names the changes of the reference (`lammps_cases.scene.changes`) that its cases must detect, by
patterns of their labels.
"""

from __future__ import annotations

import fnmatch
import functools
import itertools
import math
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from eos_ref import InputError
from eos_ref.errors import nearest, together, unknown
from eos_ref.syntax.manual import Manual
from lammps_cases.records.files import DATA
from lammps_cases.records.wording import some
from lammps_cases.records.yaml_files import flow, if_deck, read_yaml
from lammps_cases.scene import FromFile, Scene, check_name
from lammps_cases.scene.changes import catalogue
from lammps_cases.scene.complaints import Combination, Complaint, Keys, Source, complaints, explained, places, refused

MAX_CASES = 10_000  # of one file
SCENES = ("scene", "matrix")  # the keys that make scenes
SHIPPED = DATA / "cases"
BEYOND = DATA / "more.txt"
LONG, MORE = "long", "more"  # tags of cases that do not run by default; the rest sees all that those tagged more see
ALL = "all"  # in place of a tag: all cases that are not long


@dataclass(frozen=True)
class Case:
    """One case: a scene with a name, its source, its seed (from the name), and the changes that it must detect."""

    name: str
    about: str
    tags: tuple[str, ...]
    scene: Scene
    source: Path
    shipped: bool = field(default=True, compare=False)
    exercises: tuple[str, ...] = ()

    @property
    def labels(self) -> list[str]:
        """Return the labels of its place in the matrix."""
        return self.name.split(".")[1:]

    @property
    def where(self) -> str:
        """Return the location for messages: file and case."""
        return f"{self.source.name}, case {self.name}"

    def by(self, manual: Manual) -> Case:
        """Return the case for the version of the manual that the reference is to follow."""
        if manual == self.scene.manual:
            return self
        return replace(self, scene=self.scene.model_copy(update={"manual": manual}))

    def reproduce(self, engine: str = "env") -> str:
        """Return the command that runs this case alone, on the same engine."""
        own = [] if self.shipped else ["--cases", str(self.source)]
        other = [] if engine == "env" else ["--engine", engine]
        return shlex.join(["eos-ref", "run", *own, *other, self.name])


def _offer_changes(schema: dict[str, Any]) -> None:
    """Let editors complete the changes; the check of a wrong one has its own message."""
    schema["additionalProperties"]["items"]["enum"] = list(catalogue())


class CaseFile(BaseModel):
    """The keys of a case file."""

    model_config = ConfigDict(extra="forbid")

    name: str
    about: str = Field(description="what the case is for, in a sentence or two")
    tags: list[str] = []
    exercises: dict[str, list[str]] = Field(
        {},
        description="pattern of labels (*, rk1.*): changes of the reference that these cases have to see",
        json_schema_extra=_offer_changes,
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


@functools.cache
def _places() -> list[Keys]:
    file, scene = CaseFile.model_json_schema(), Scene.model_json_schema()
    return places({"properties": {**file["properties"], "scene": scene}, "$defs": scene["$defs"]})


def load_file(path: Path, shipped: bool = False) -> list[Case]:
    """Return all cases of a file, sorted by name.

    Raises
    ------
    InputError
        Unreadable, or unknown keys, wrong types, bad values: a line each, with key, line and column.
    """
    data = read_yaml(path)
    if not isinstance(data, dict) or not data:
        hint = if_deck(path, path.read_text(encoding="utf-8")) if isinstance(data, str) else ""
        raise InputError("case file", f"must hold the keys name, about, scene{hint}", flow(data), str(path))
    source = Source(path)
    try:
        file = CaseFile.model_validate(data)
    except ValidationError as error:
        raise refused(
            explained([*complaints(error, data, source), *_of_scenes(data, source)], _places()), source
        ) from None
    _check_name(file.name, source, ("name",))
    cases, wrong = [], []
    for each in _combined(file, source):
        try:
            cases.append(_case(file, each, source, shipped))
        except ValidationError as error:
            wrong += complaints(error, each, source)
    if wrong:
        raise refused(explained(wrong, _places()), source)
    _check_exercises(file, [case.name for case in cases], source)
    return sorted(cases, key=lambda case: case.name)


def _check_name(name: str, source: Source, keys: Keys, at_key: bool = False) -> None:
    try:
        check_name(name)
    except InputError as error:
        raise error.at(source.place(keys, at_key=at_key)) from None


def _of_scenes(data: Mapping[str, Any], source: Source) -> list[Complaint]:
    """Return the mistakes in the scenes of a file that also has other mistakes, as far as there are scenes."""
    try:
        file = CaseFile.model_validate({"name": "unnamed", "about": ""} | {k: data[k] for k in data if k in SCENES})
    except ValidationError:
        return []
    wrong = []
    for each in _combined(file, source):
        try:
            Scene.model_validate(each.content)
        except ValidationError as error:
            wrong += complaints(error, each, source)
    return wrong


def _combined(file: CaseFile, source: Source) -> Iterator[Combination]:
    """Yield the scenes that a file makes, as written.

    Raises
    ------
    InputError
        A bad label, too many cases, or a patch that does not fit.
    """
    count = math.prod(len(axis) for axis in file.matrix.values())
    if not 1 <= count <= MAX_CASES:
        raise InputError("matrix", f"must make 1 to {MAX_CASES} cases", count, source.place(("matrix",)))
    for axis, patches in file.matrix.items():
        for label in patches:
            _check_name(label, source, ("matrix", axis, label), at_key=True)
    for combination in itertools.product(*(axis.items() for axis in file.matrix.values())):
        labels = tuple(label for label, _ in combination)
        content: Any = file.scene
        for axis, (label, patch) in zip(file.matrix, combination, strict=True):
            try:
                content = merge(content, patch)
            except InputError as error:
                raise error.at(source.place(("matrix", axis, label))) from None
        tags = list(file.tags)
        if isinstance(content.get("tags"), list):  # a patch may add tags
            content = dict(content)
            tags += content.pop("tags")
        yield Combination(".".join((file.name, *labels)), labels, content, tuple(tags))


def _labels(name: str) -> str:
    return name.partition(".")[2]


def _exercises(file: CaseFile, name: str) -> tuple[str, ...]:
    chosen = [changes for pattern, changes in file.exercises.items() if fnmatch.fnmatchcase(_labels(name), pattern)]
    return tuple(dict.fromkeys(itertools.chain.from_iterable(chosen)))


def _check_exercises(file: CaseFile, names: Sequence[str], source: Source) -> None:
    """Check that a file's patterns match its cases, and that its changes are in the catalogue.

    Raises
    ------
    InputError
    """
    for pattern, changes in file.exercises.items():
        for change in changes:
            if change not in catalogue():
                place = source.place(("exercises", pattern, changes.index(change)))
                raise unknown("change", change, catalogue()).at(place)
        if not fnmatch.filter(map(_labels, names), pattern):
            place = source.place(("exercises", pattern), at_key=True)
            raise InputError("exercises", "a pattern must be of labels of the file's cases", pattern, place)


def _case(file: CaseFile, made: Combination, source: Source, shipped: bool) -> Case:
    def where(*keys: str) -> str:  # only for mistakes: finding a location takes as long as reading the file
        return source.place(keys, made.labels) + (f", case {made.case}" if made.labels else "")

    scene = Scene.model_validate(made.content)
    if scene.expect is None:
        try:
            eos = scene.eos()
        except InputError:
            eos = scene.eos(where("scene", "pressure"))
        given = not isinstance(scene.positions, FromFile)
        if eos.needs_energy and scene.energy is None and given:
            raise InputError(
                "energy", f"{eos.style_with_energy} needs the energy of every particle", where=where("scene")
            )
        if scene.rho is None and not scene.rho_sum and given:
            raise InputError("rho", "must be given unless rho_sum is on or a file holds it", where=where("scene"))
    about = " ".join(file.about.split())
    tags = tuple(sorted({*made.tags, *([MORE] if shipped and made.case in more() else [])}))
    return Case(made.case, about, tags, scene, source.path, shipped, _exercises(file, made.case))


@functools.cache
def more() -> frozenset[str]:
    """Return the shipped cases tagged more: those that see nothing more, by tests/workshop/default_cases.py."""
    return frozenset(BEYOND.read_text(encoding="utf-8").split())


def load(paths: Sequence[Path] = (), tag: str | None = None) -> list[Case]:
    """Return all cases of some files and folders (default: those shipped), sorted by name.

    With a ``tag``, shipped files that do not contain the word are not read.

    Raises
    ------
    InputError
        Bad files, no file at all, or two cases of one name.
    """
    if paths:
        return _load(_files(paths), shipped=False)
    if tag not in (None, ALL, MORE) and any(tag in case.tags for case in _shipped(tag)):
        return list(_shipped(tag))
    return list(_shipped())


@functools.cache
def _shipped(word: str = "") -> tuple[Case, ...]:
    """Return the cases that come with the package, fixed while it runs, from files that contain a word."""
    return tuple(_load([path for path in _files([SHIPPED]) if word in path.read_text(encoding="utf-8")], shipped=True))


def _files(paths: Sequence[Path]) -> list[Path]:
    """Return the case files among some paths and in folders.

    Raises
    ------
    InputError
        No case files.
    """
    files: list[Path] = []
    for path in paths:
        files += sorted([*path.rglob("*.yaml"), *path.rglob("*.yml")]) if path.is_dir() else [path]
    if not files:
        raise InputError("cases", "no case file (*.yaml) found", where=", ".join(map(str, paths)))
    return files


def _load(files: Sequence[Path], shipped: bool) -> list[Case]:
    every, wrong = list[Case](), list[InputError]()
    for file in files:
        try:
            every += load_file(file, shipped)
        except InputError as error:
            wrong.append(error)
    if wrong:
        raise together(wrong)
    cases = sorted(every, key=lambda case: case.name)
    for one, other in itertools.pairwise(cases):
        if one.name == other.name:
            raise InputError("case name", "must be unique", one.name, f"{one.source} and {other.source}")
    return cases


def select(cases: Sequence[Case], names: Sequence[str] = (), tag: str | None = None) -> list[Case]:
    """Return the cases by name or wildcard pattern and by tag; without either, all not tagged long or more.

    A name also selects the cases below it: ``near-rho0`` selects ``near-rho0.linear.2d``.

    Raises
    ------
    InputError
        A name that matches no case (the nearest is suggested) or a tag that no case has.
    """
    for name in names:
        if not names_like(name, cases):
            raise unknown_case("case", name, sorted({part for c in cases for part in (c.name, c.name.split(".")[0])}))
    names_chosen = set[str]().union(*(names_like(name, cases) for name in names))
    chosen = [case for case in cases if not names or case.name in names_chosen]
    if tag is not None:
        chosen = [case for case in chosen if tagged(case, tag)]
        if not chosen:
            tags = sorted({each for case in cases for each in case.tags})
            hint = nearest(tag, tags).strip(" ()")
            raise InputError("tag", f"no case has the tag {tag!r}{'; ' * bool(hint)}{hint} (tags: {', '.join(tags)})")
    elif not names:
        chosen = [case for case in chosen if by_default(case)]
    if not chosen:
        raise InputError("cases", "none left to run (are all tagged long?)")
    return chosen


def unknown_case(what: str, name: str, names: Iterable[str]) -> InputError:
    """Return the complaint that there is no such case, with the name or, for a file, the option that was meant."""
    if Path(name).suffix in (".yaml", ".yml"):
        return InputError(what, "must be a name; a file of cases is given by --cases", name)
    return unknown(what, name, names)


def by_default(case: Case) -> bool:
    """Return whether a case runs by default."""
    return not {LONG, MORE} & {*case.tags}


def tagged(case: Case, tag: str) -> bool:
    """Return whether a case has a tag; all: whether it is not long."""
    return LONG not in case.tags if tag == ALL else tag in case.tags


def only(cases: Sequence[Case], name: str) -> Case:
    """Return the one case that a name selects.

    Raises
    ------
    InputError
        No case, or more than one.
    """
    chosen = select(cases, (name,))
    if len(chosen) > 1:
        such = some([case.name for case in chosen], 2)
        raise InputError("case", f"must be a single case, but this name selects {len(chosen)} ({such})", name)
    return chosen[0]


def names_like(name: str, cases: Sequence[Case]) -> list[str]:
    """Return the names of cases that a name or pattern selects."""
    return [c.name for c in cases if fnmatch.fnmatchcase(c.name, name) or c.name.startswith(f"{name}.")]
