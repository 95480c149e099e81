"""What shows a finding best: a scene as small as can be, and the number to look at in it.

The data stand beside the findings (``demonstrations.yaml``).
A finding about input has none: the first case or probe that it applies to is put to LAMMPS as it is, or smaller.
"""

from __future__ import annotations

import functools
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel, ConfigDict

from lammps_cases import findings
from lammps_cases.records.yaml_files import OfManual, read_yaml
from lammps_cases.scene import casefile
from lammps_cases.scene.casefile import Case

FILE = Path(findings.__file__).with_name("demonstrations.yaml")


class AtomNumber(BaseModel):
    """A component of a field of an atom, after the last step of a scene or another."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    field: str
    atom: int
    axes: tuple[int, ...] = ()
    step: int | None = None


class Demonstration(OfManual, BaseModel):
    """What a deck for a finding does.

    Attributes
    ----------
    scene : the keys of a scene
    number : what is looked at in it
    hand : the same by hand: formulas of `lammps_cases.bugs.hand.symbols`, the last of them that of the number
    other : what a second scene changes, which must give the same number
    times : but for this factor
    smaller : what is changed of the case that the finding applies to
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    scene: dict[str, Any] = {}
    number: AtomNumber | None = None
    hand: dict[str, str] = {}
    other: dict[str, Any] = {}
    times: float = 1.0
    smaller: dict[str, Any] = {}


@functools.cache
def demonstrations() -> dict[str, Demonstration]:
    """Return the demonstrations by finding."""
    content = read_yaml(FILE, "demonstrations")
    return {name: Demonstration.model_validate(one) for name, one in content.items()}


def case_of(name: str, about: str, scene: Mapping[str, Any]) -> Case:
    """Return a scene as a case, read as case files are.

    Raises
    ------
    InputError
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"{name}.yaml"
        file.write_text(yaml.safe_dump({"name": name, "about": about, "scene": dict(scene)}))
        return casefile.load_file(file)[0]


def smaller(case: Case, changes: Mapping[str, Any]) -> Case:
    """Return a case with changes of its scene."""
    if not changes:
        return case
    scene = case.scene.model_dump(mode="json", exclude_unset=True)
    return case_of(case.name.split(".")[0], case.about, casefile.merge(scene, changes))
