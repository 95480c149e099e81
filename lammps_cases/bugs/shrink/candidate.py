"""The object of shrinking: a scene as the data of its case file, with every particle written out.

Also how a case fails, and whether two cases fail in the same way.
"""

from __future__ import annotations

import dataclasses
import math
import re
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from pydantic import ValidationError

from eos_ref import InputError
from eos_ref.syntax.ranges import type_range
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.records.yaml_files import yaml_text
from lammps_cases.run.prepared_case import prepare
from lammps_cases.scene import Scene
from lammps_cases.scene.casefile import Case
from lammps_cases.setup import reference_side

Content = dict[str, Any]
Path = tuple[str | int, ...]  # keys and indices from the scene down
PER_PARTICLE: tuple[Path, ...] = (("positions", "x"), ("positions", "types"))
VALUES = ("mass", "rho", "energy", "velocity")  # their key ``values`` holds one per particle
_NUMBER = re.compile(r"[-+]?\d[\d.]*(?:e[-+]?\d+)?")


def written_out(case: Case) -> Content:
    """Return the scene of a case with explicit positions, types, masses, velocities, densities and energies.

    Raises
    ------
    InputError
    """
    scene, atoms = case.scene, prepare(case).atoms
    d = scene.dimension
    content: Content = scene.model_dump(mode="json", exclude_unset=True)
    content.pop("arrangement", None)
    content["positions"] = {
        "x": atoms.x_nc[:, :d].tolist(),
        "types": atoms.type_n.tolist(),
        "low": atoms.low_c[:d].tolist(),
        "high": atoms.high_c[:d].tolist(),
        "periodic": [bool(flag) for flag in atoms.periodic[:d]],
        "spacing": float(atoms.spacing),
    }
    if any(atoms.tilt):
        content["positions"]["tilt"] = list(atoms.box(d).tilt)
    per_atom = {"rho": atoms.rho_n, "velocity": None if atoms.v_nc is None else atoms.v_nc[:, :d]}
    if scene.mass:
        per_atom["mass"] = atoms.mass_n
    if scene.thermal:
        per_atom["energy"] = None if atoms.energy_n is None else atoms.energy_n / atoms.mass_n
    for name in VALUES:
        content.pop(name, None)
        if (given := per_atom.get(name)) is not None:
            content[name] = {"values": given.tolist()}
    for atom_type in content["types"]:
        atom_type.pop("velocity", None)  # of its current particles
    return content


def as_case(content: Content, like: Case) -> Case | None:
    """Return the case of a content, with the name, and so the seeds, of another; None if it is not a scene."""
    try:
        scene = Scene.model_validate(content)
    except (ValidationError, InputError):
        return None
    return Case(like.name, like.about, like.tags, scene, like.source, shipped=False)


def document(content: Content, name: str, about: str) -> str:
    """Return the text of the case file; the axes of its matrix only give the case its whole name."""
    first, *labels = name.split(".")
    data: dict[str, Any] = {"name": first, "about": about}
    if labels:
        data["matrix"] = {f"part {k}": {label: {}} for k, label in enumerate(labels, 2)}
    return yaml_text(data | {"scene": content})


@dataclass(frozen=True)
class Size:
    """The size of a scene: particles, types, keys, time steps, and digits of all its numbers."""

    particles: int
    types: int
    keywords: int
    steps: int
    digits: int


def size(content: Content) -> Size:
    """Return the size of a scene that is written out."""
    values = [(path, value) for path, value in leaves(content) if not isinstance(value, str)]
    numbers = [value for _, value in values if isinstance(value, int | float) and not isinstance(value, bool)]
    return Size(
        particles=len(content["positions"]["x"]),
        types=len(content["types"]),
        keywords=sum(1 for _ in keys(content)),
        steps=content.get("evolve", {}).get("steps", 0),
        digits=sum(digits(number) for number in numbers),
    )


def digits(number: float) -> int:
    """Return how many significant digits a number has as it is written; 0 of zero."""
    mantissa = f"{number!r}".lower().partition("e")[0]
    plain = mantissa.replace("-", "").replace(".", "").strip("0")
    return len(plain)


def leaves(part: Any, path: Path = ()) -> Iterator[tuple[Path, Any]]:
    """Yield the place and the value of every leaf."""
    if isinstance(part, dict | list):
        for key, value in part.items() if isinstance(part, dict) else enumerate(part):
            yield from leaves(value, (*path, key))
    else:
        yield path, part


def keys(part: Any, path: Path = ()) -> Iterator[Path]:
    """Yield the place of every key, and of every member of a list of mappings or words: the outer ones first."""
    if isinstance(part, dict):
        for key, value in part.items():
            yield (*path, key)
            yield from keys(value, (*path, key))
    elif isinstance(part, list):
        for k, value in enumerate(part):
            if isinstance(value, dict | str):
                yield (*path, k)
            yield from keys(value, (*path, k))


def at(content: Content, path: Path) -> Any:
    """Return the part of a content at some place."""
    part: Any = content
    for key in path:
        part = part[key]
    return part


def replaced(content: Content, path: Path, value: Any) -> Content:
    """Return a content with another part at some place; shared parts of the old one are not changed."""
    new: Content = _replaced(content, path, value)
    return new


def without(content: Content, path: Path) -> Content:
    """Return a content without the part at some place."""
    holder = at(content, path[:-1])
    rest = [v for k, v in enumerate(holder) if k != path[-1]] if isinstance(holder, list) else dict(holder)
    if isinstance(rest, dict):
        rest.pop(path[-1])
    return replaced(content, path[:-1], rest)


def _replaced(part: Any, path: Path, value: Any) -> Any:
    if not path:
        return value
    new: Any = list(part) if isinstance(part, list) else dict(part)
    new[path[0]] = _replaced(part[path[0]], path[1:], value)
    return new


def per_particle(content: Content) -> list[Path]:
    """Return the places of the lists that hold one entry per particle."""
    paths = [path for path in PER_PARTICLE if path[-1] in content["positions"]]
    return paths + [(name, "values") for name in VALUES if "values" in content.get(name, {})]


def only_particles(content: Content, rows: Sequence[int]) -> Content:
    """Return a content with some of its particles."""
    for path in per_particle(content):
        every = at(content, path)
        content = replaced(content, path, [every[row] for row in rows])
    return content


def apart_from_particles(content: Content) -> Content:
    """Return a content without its particles and time steps."""
    return {key: value for key, value in content.items() if key not in ("positions", "evolve", *VALUES)}


def types_of(content: Content) -> list[int]:
    """Return the type of every particle."""
    positions = content["positions"]
    return list(positions.get("types") or [1] * len(positions["x"]))


def only_types(content: Content, kept: Sequence[int], type_n: Sequence[int]) -> Content:
    """Return a content with some of its types, in order; the particles have the types ``type_n`` (old numbers).

    Raises
    ------
    InputError
        A bad range.
    """
    n = len(content["types"])
    number = {old: new for new, old in enumerate(kept, 1)}

    def ranges(types: str | int) -> list[str]:
        """Return the ranges of new types that replace an old range."""
        new = [number[t] for t in type_range(str(types), n) if t in number]
        if len(new) == len(kept):
            return ["*"]
        return [str(t) for t in new]

    def entries(every: Sequence[Content]) -> list[Content]:
        return [entry | {"types": types} for entry in every for types in ranges(entry["types"])]

    new = dict(content)
    new["types"] = [content["types"][t - 1] for t in kept]
    new["positions"] = content["positions"] | {"types": [number[t] for t in type_n]}
    new["pressure"] = entries(content["pressure"])
    if "forces" in content:
        bare = [force for force in content["forces"] if force.get("types") is None]
        new["forces"] = [f for force in content["forces"] for f in ([force] if force in bare else entries([force]))]
    shift = content.get("rheo", {}).get("shift")
    if isinstance(shift, dict) and shift.get("exclude"):
        excluded = [types for each in shift["exclude"] for types in ranges(each)]
        new = replaced(new, ("rheo", "shift", "exclude"), excluded)
    return new


@dataclass(frozen=True)
class FailureMode:
    """How a case fails. Two are equal if they fail in the same way, whichever step and atom show it first.

    Attributes
    ----------
    field, stage : the blame, beyond the findings that the scene shows; empty if LAMMPS gave no numbers
    finding : id of the finding to preserve, whichever field shows it; empty for a difference
    error : LAMMPS' error without its numbers, or how its process ended
    bounded : whether the reference and its bound are finite there; a scene decided by rounding is another failure
    shown_in, step, atom : field, step and atom where it first shows
    """

    verdict: str
    ended: str = "answered"
    field: str = ""
    stage: str = ""
    finding: str = ""
    error: str = ""
    bounded: bool = True
    shown_in: str = dataclasses.field(default="", compare=False)
    step: int | None = dataclasses.field(default=None, compare=False)
    atom: int | None = dataclasses.field(default=None, compare=False)

    @property
    def words(self) -> str:
        """Return in words how the case fails."""
        if self.finding:
            return f"shows {self.finding}"
        if self.field:
            return f"{self.verdict} in {self.field}" + f" (stage {self.stage})" * bool(self.stage)
        return f"{self.verdict}" + f": {self.error}" * bool(self.error)

    def document(self) -> dict[str, Any]:
        """Return the parts that are given, as data."""
        return {key: value for key, value in asdict(self).items() if value not in ("", None)}


def failure_mode(record: CaseRecord, finding: str = "") -> FailureMode | None:
    """Return how a case fails, or that it shows a finding; None if neither."""
    blame = record.headline
    place: dict[str, Any] = {"shown_in": blame.field, "step": blame.step, "atom": blame.atom} if blame else {}
    place["bounded"] = not blame or all(v is None or math.isfinite(v) for v in (blame.reference, blame.bound))
    if finding:
        shown = record.verdict == "explained" and finding in record.findings
        return FailureMode("explained", record.ended, finding=finding, **place) if shown else None
    if record.as_expected:
        return None
    if record.ended == "answered" and blame:
        return FailureMode(record.verdict, record.ended, blame.field, blame.stage, **place)
    lost = type(record.unusable).__name__ if record.unusable else ""
    fault = record.harness_error.exception if record.harness_error else ""
    return FailureMode(record.verdict, record.ended, error=lost or fault or _kind(record))


def rule_broken(scene: Scene) -> tuple[str, ...]:
    """Return the rule broken by a scene that LAMMPS should refuse; empty if it should not, or if none is known.

    A scene that breaks no rule may be accepted, which would not be the same failure.
    """
    if scene.expect is None:
        return ()
    if scene.violate:
        return (scene.violate,)
    try:
        reference_side.with_cut(scene, scene.rheo.cut or 1.0)
    except InputError as error:
        return error.what, _raised_in(error)
    return ()


def _raised_in(error: BaseException) -> str:
    """Return the line of the reference that refuses, as the same rule has other numbers in another scene."""
    while isinstance(error.__context__, InputError):  # before places were added in front
        error = error.__context__
    last = traceback.extract_tb(error.__traceback__)[-1]
    return f"{last.filename}:{last.lineno}"


def _kind(record: CaseRecord) -> str:
    """Return an error without its numbers; for a dead process how it ended."""
    if record.ended in ("crashed", "timeout"):
        return record.died
    return _NUMBER.sub("#", record.engine_error)
