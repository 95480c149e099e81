"""The manual's example lines in scenes: LAMMPS gets them verbatim, and the scene has to agree."""

from __future__ import annotations

from typing import Any

import pytest
import yaml

from eos_ref import InputError
from lammps_cases.run import prepared_case
from lammps_cases.scene import casefile
from lammps_cases.scene.casefile import Case
from lammps_cases.scene.manual import EXAMPLES

CASES: dict[str, Case] = {case.name: case for case in casefile.load() if case.name.startswith("examples.")}


def changed(tmp_path: Any, name: str, **changes: Any) -> Case:
    data = yaml.safe_load((casefile.SHIPPED / "examples.yaml").read_text())
    scene = casefile.merge(casefile.merge(data["scene"], data["matrix"]["line"][name]), changes)
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump({"name": "mine", "about": "A scene.", "scene": scene}))
    return casefile.load_file(path)[0]


def test_every_line_has_a_case() -> None:
    assert set(CASES) == {f"examples.{page}-{k}" for page in EXAMPLES for k in (1, 2, 3)}


@pytest.mark.parametrize("name", CASES)
def test_lammps_gets_the_line_verbatim(name: str) -> None:
    page, number = name.removeprefix("examples.").split("-")
    line = EXAMPLES["rheo" if page == "rheo" else "pressure"][int(number) - 1]
    told = prepared_case.prepare(CASES[name]).jobs[0].commands
    assert told.count(line) == 1
    assert sum(f" all {line.split()[3]} " in command for command in told) == 1  # and no second fix of the style


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("pressure-1", {"pressure": [{"types": "*", "style": "tait/water"}]}),
        ("pressure-3", {"pressure": [{"types": "*", "style": "linear"}]}),
        ("rheo-1", {"types": [{"mass": 0.1, "rho0": 0.1, "cs": 10.0}, {"mass": 0.1, "rho0": 0.2, "cs": 1.0}]}),
        ("rheo-1", {"rheo": {"cut": 2.9}}),
        ("rheo-1", {"rheo": {"shift": True}}),
    ],
)
def test_scene_agrees_with_the_line(tmp_path: Any, name: str, changes: dict[str, Any]) -> None:
    with pytest.raises(InputError, match="must say what the manual's line says"):
        changed(tmp_path, name, **changes)


@pytest.mark.parametrize(
    ("example", "text"),
    [
        ({"rheo": 4}, "must be at most 3"),
        ({"rheo": 1, "pressure": 1}, "exactly one"),
        ({"rheo": None, "pressure": None}, "exactly one"),
        ({"rheo": "shell rm"}, "must be a whole number"),
    ],
)
def test_only_a_place_is_accepted(tmp_path: Any, example: dict[str, Any], text: str) -> None:
    with pytest.raises(InputError, match=text):
        changed(tmp_path, "pressure-1", example=dict.fromkeys(("rheo", "pressure")) | {"style": None} | example)


def test_not_together_with_a_changed_line(tmp_path: Any) -> None:
    with pytest.raises(InputError, match="neither twin nor violate"):
        changed(tmp_path, "pressure-1", twin={"relabel": True})
