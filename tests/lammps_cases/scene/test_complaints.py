"""Errors of a case file are reported in the words of the file, all at once, with line and column."""

from __future__ import annotations

import copy
import math
import re
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from eos_ref import InputError
from lammps_cases.run.prepared_case import prepare
from lammps_cases.scene import casefile
from lammps_cases.scene.atoms import build
from tests.conftest import BASE
from tests.support.bad_scenes import BAD, OTHERS
from tests.support.outcome import Outcome

MANY = """name: many
about: mistakes
scene:
  dimension: 2
  types: [{mass: heavy}]
  positions: {lattice: sq, spacin: 0.8, cells: 5, tilt: [1, 2]}
  pressure:
  - {types: "*", style: linaer, gama: 3}
  - {types: [1, 2], style: linear}
  rho: {ratio: [0.8]}
  rho0: 3
  compare: [presure, f]
  rheo: {shift: 'on', cut: null, kernel: true}
evolve: {steps: 1, timestep: 0.01}
"""
SAID = """
positions.spacin: unknown key (did you mean 'spacing'?) (line 6, column 28)
pressure.0.gama: unknown key (did you mean 'gamma'?) (line 8, column 33)
rho0: unknown key (belongs under types:) (line 11, column 3)
evolve: unknown key (belongs under scene:) (line 14, column 1)
types.0.mass: must be a number, found 'heavy' (line 5, column 18)
positions.cells: must be a list, found 5 (line 6, column 48)
positions.tilt: must have at most 1 member or 3 members, found [1, 2] (line 6, column 57)
pressure.0.style: must be 'linear', 'cubic', 'tait/water', 'tait/general', 'ideal/gas' or 'background' \
(did you mean 'linear'?), found 'linaer' (line 8, column 25)
pressure.1.types: must be a range of types: *, n, *n, n* or m*n, found [1, 2] (line 9, column 13)
rho.ratio: must have 2 members, found [0.8] (line 10, column 16)
compare.0: must be a known name (did you mean 'pressure'?), found 'presure' (line 12, column 13)
rheo.shift: must be true or false, found 'on' (line 13, column 17)
rheo.kernel: must be 'quintic', 'RK0', 'RK1' or 'RK2', found true (line 13, column 42)
""".strip().split("\n")


def _refused(path: Path, text: str) -> list[str]:
    path.write_text(text)
    with pytest.raises(InputError) as refusal:
        casefile.load_file(path)
    return [str(error).replace(f"{path}, ", "") for error in refusal.value.errors]


def test_all_errors_are_reported_at_once_unknown_keys_first(tmp_path: Path) -> None:
    assert _refused(tmp_path / "many.yaml", MANY) == SAID


def test_terminal_shows_one_line_per_error(eos_ref_command: Callable[..., Outcome], tmp_path: Path) -> None:
    for name in ("many", "more"):
        (tmp_path / f"{name}.yaml").write_text(MANY)
    code, out, err = eos_ref_command("list", "--cases", tmp_path)
    lines = err.splitlines()
    assert (code, out) == (2, "")
    assert all(line.startswith("eos-ref: ") for line in lines)
    assert [sum(f"{name}.yaml" in line for line in lines) for name in ("many", "more")] == [len(SAID)] * 2


MATRIX = """name: matrix
about: mistakes in patches
matrix:
  law:
    a: {pressure+: [{types: "2", style: linear, gama: 1}], rho: {rato: [1, 2]}}
    b: {pressure: [{types: "*", style: linaer}]}
  size:
    s: {positions: {cells: [0, 2]}}
    t: {positions: {cells: null}}
    u: {velocity: {uniform: [1, 2, 3]}}
scene:
  dimension: 2
  types: [{mass: 1}, {mass: 2}]
  pressure: [{types: "1", style: linear}]
  positions: {lattice: sq, spacing: 0.8, cells: [5, 4]}
  rho: {ratio: [0.8, 1]}
"""


def test_error_in_a_patch_is_located_there_and_reported_once(tmp_path: Path) -> None:
    said = _refused(tmp_path / "matrix.yaml", MATRIX)
    assert [line[line.rindex("(") :] for line in said] == [
        "(line 5, column 49, case matrix.a.s)",
        "(line 5, column 66, case matrix.a.s)",
        "(line 6, column 40, case matrix.b.s)",
        "(line 8, column 28, case matrix.a.s)",
        "(line 9, column 28, case matrix.a.t)",
    ]
    mended = MATRIX.replace("gama: 1", "").replace("linaer", "linear").replace("rato", "ratio")
    mended = mended.replace("[0, 2]", "[1, 2]").replace("cells: null", "cells: [2, 2]")
    (said_of_vector,) = _refused(tmp_path / "matrix.yaml", mended)
    assert "velocity.uniform needs 2 components, found 3 (line 10, column 29, case matrix.a.u)" in said_of_vector


WHOLE = """name: whole
about: rules of a scene as a whole
scene:
  dimension: 2
  types: [{mass: 1, rho0: 1}, {mass: 1}]
  positions: {lattice: sq, spacing: 0.8, cells: [5, 4]}
  pressure: [{types: "*", style: linear}]
  rho: {constant: 1}
  compare: [f]
"""
STOPPING = "  evolve: {steps: 4, timestep: 0.1, stops: [{at: 1, stretch: {z: 2}}]}\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (WHOLE, "rho0 must be given for every type or for none (fix rheo takes N values) (line 5, column 10)"),
        (
            WHOLE.replace("[5, 4]", "[5, 4, 3]"),
            "cells needs 2 numbers for sq, a lattice in 2D, found 3 (line 6, column 49)",
        ),
        (WHOLE.replace("sq", "sc").replace("[5, 4]", "[5, 4, 3]"), "does not fit dimension 2 (line 6, column 24)"),
        (
            WHOLE.replace(", rho0: 1", "") + "  forces: [{style: addforce, vector: [0, 0, 1]}]\n",
            "forces.vector needs 2 components, found 3 (line 10, column 38)",
        ),
        (
            WHOLE.replace(", rho0: 1", "") + "  forces: [{style: addforce, types: 3, vector: [0, 0]}]\n",
            "type range must lie within the atom types 1 to 2, found '3' (line 10, column 37)",
        ),
        (WHOLE.replace(", rho0: 1", "") + STOPPING, "stretch.z must be 1 in 2D, found 2.0 (line 10, column 44)"),
    ],
)
def test_error_across_keys_is_located_at_the_key_it_names(tmp_path: Path, text: str, said: str) -> None:
    (line,) = _refused(tmp_path / "whole.yaml", text)
    assert line.endswith(said)


LISTED: dict[str, Any] = {"x": [[0.2, 0.2], [0.6, 0.6]], "low": [0, 0], "high": [1, 1]}
OUTSIDE = LISTED | {"x": [[0.2, 0.2], [2, 2]], "periodic": [False, False]}


@pytest.mark.parametrize(
    ("key", "values", "rule", "where"),
    [
        ("rho", {"values": [1.0, 1.1]}, r"one value per particle \(20\)", ", rho"),
        ("rho", {"constant": -1.0}, "is defined within", ", atom 1"),
        ("mass", {"constant": -1.0}, "mass: must be positive", ", atom 1"),
        (
            "energy",
            {"table": {"csv": "none.csv", "column": "e"}},
            "table: cannot be read: No such file.*none.csv",
            ", energy",
        ),
        ("velocity", {"values": [[1.0, 0.0]]}, "one value per particle", ", velocity"),
        ("positions", LISTED | {"types": [1, 2]}, "type: must lie within 1 to 1, found 2", ""),
        ("positions", OUTSIDE, "position: must lie in the box", ", atom 2"),
        ("positions", {"dump": "none.dump"}, "file: cannot be read: No such file", ", none.dump"),
        ("positions", {"extxyz": "none.xyz"}, "extxyz: cannot be read: No such file", ""),
    ],
)
def test_error_while_building_particles_has_line_and_column(
    key: str, values: dict[str, Any], rule: str, where: str, case_file: Callable[..., Path]
) -> None:
    path = case_file(**{key: values}, compare=["f"])
    (case,) = casefile.load_file(path)
    with pytest.raises(InputError, match=rule) as refused:
        build(case, case.scene.eos())
    at = re.search(r"\(mine\.yaml, line (\d+), column \d+, case mine(.*)\)$", str(refused.value))
    assert at is not None and at[2] == where, refused.value
    of_key = path.read_text().splitlines().index(f"  {key}:") + 1
    assert int(at[1]) in (of_key, of_key + 1), "the key, or the first one below it"


@pytest.mark.parametrize(("changes", "parts"), [*BAD.values(), *OTHERS])
def test_bad_scene_is_refused_in_one_line_with_its_location(
    changes: dict[str, Any], parts: tuple[str, ...], case_file: Callable[..., Path]
) -> None:
    with pytest.raises(InputError) as refusal:
        for case in casefile.load_file(case_file(**changes)):
            prepare(case)
    (line,) = str(refusal.value).splitlines()
    assert all(part in line for part in parts), line
    assert re.search(r"mine\.yaml, line \d+, column \d+\b", line)


# Words of pydantic and Python that are foreign to YAML.
FOREIGN = re.compile(
    r"\b(tuple|dict|dictionary|NoneType|None|True|False|literal|instance|pydantic|str|float|int|bool|boolean|input|"
    r"Field|Value|valid|object|validation|extra|forbidden|permitted|discriminator|tag|parse|type=)\b",
)
SHIPPED = [case.scene.model_dump(mode="json", exclude_unset=True) for case in casefile.load()[::7]]
RICH: dict[str, Any] = {  # keys that few cases have
    **BASE,
    "types": [{"mass": 1.3, "rho0": 1.2, "cs": 3.0, "viscosity": {"eta": 0.1, "gd0": 0.2, "K": 0.1, "n": 0.5}}],
    "positions": {"lattice": "sq", "spacing": 0.8, "cells": [5, 4], "periodic": [True, True], "tilt": [0.1]},
    "energy": {"offset": {"low": 0.1, "high": 0.2}},
    "velocity": {"uniform": [1.0, 0.0]},
    "rheo": {"kernel": "RK1", "shift": {"exclude": ["1"], "scale_cross_type": [1.0, 0.1, 0.2]}},
    "forces": [{"style": "setforce", "vector": [0.0, None]}],
    "evolve": {"steps": 2, "timestep": 0.01, "compare_at": [0, 2], "stops": [{"at": 1, "displace": {"x": 0.1}}]},
    "engine": {"newton": True, "skin": 0.2, "processors": [1, 1, 1], "boundary": "f"},
    "twin": {"relabel": True},
    "expect": {"refused": "a long refusal"},
}
WRONG = ("word", "", 1.5, -3, 0, 1e300, math.nan, -math.inf, True, None, [], {}, [None], [[1]], {"odd": 1}, ["a"] * 4)


def _places(content: Any, keys: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    for key, value in content.items() if isinstance(content, dict) else enumerate(content):
        yield (*keys, key)
        if isinstance(value, dict | list):
            yield from _places(value, (*keys, key))


@st.composite
def edited_files(draw: st.DrawFn) -> dict[str, Any]:
    """A case file in which one key or member has another value, another name or none, or is there several times."""
    scene = copy.deepcopy(draw(st.sampled_from([RICH, *SHIPPED])))
    file = {"name": "mine", "about": "of the tests", "tags": ["a"], "matrix": {"axis": {"one": {"units": "lj"}}}}
    content: dict[str, Any] = file | {"scene": scene}
    *above, last = draw(st.sampled_from([*_places(content)]))
    at: Any = content
    for key in above:
        at = at[key]
    edit = draw(st.sampled_from(["value", "value", "name", "none", "longer"]))
    if edit == "value":
        at[last] = draw(st.sampled_from(WRONG))
    elif isinstance(at, list):
        at[last : last + 1] = at[last : last + 1] * (3 * (edit == "longer"))
    else:
        value = at.pop(last)
        if edit == "longer":
            at[last] = [value] * 4
        elif edit == "name":
            at[draw(st.sampled_from([f"{last}s", last[1:], "wibble"]))] = value
    return content


@given(edited_files())
@settings(max_examples=200, deadline=None)
def test_edited_scene_is_valid_or_refused_in_lines_with_a_location(content: dict[str, Any]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mine.yaml"
        path.write_text(yaml.safe_dump(content, sort_keys=False))
        try:
            casefile.load_file(path)
        except InputError as error:
            for line in (str(each) for each in error.errors):
                assert re.search(r"mine\.yaml, line \d+, column \d+", line) and "\n" not in line
                assert not FOREIGN.search(line.partition(", found ")[0]), "a word of Python"


@pytest.mark.parametrize(
    ("key", "under"),
    [("tags", "belongs under no other key"), ("cells", "belongs under positions:"), ("wibble", "unknown key (")],
)
def test_misplaced_key_gets_a_hint_where_it_belongs(key: str, under: str, case_file: Callable[..., Path]) -> None:
    with pytest.raises(InputError, match=re.escape(f"{key}: unknown key")) as refusal:
        casefile.load_file(case_file(**{key: 1}))
    assert under in str(refusal.value)


def test_misplaced_key_is_not_also_reported_missing(tmp_path: Path) -> None:
    text = "name: a\nabout: b\npressure: []\nscene: {dimension: 2, types: [{mass: 1}], positions: {extxyz: a.xyz}}\n"
    assert _refused(tmp_path / "a.yaml", text) == ["pressure: unknown key (belongs under scene:) (line 3, column 1)"]
