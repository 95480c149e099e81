"""A whole scene: keys that must agree with each other, and properties derived from them."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from eos_ref import InputError
from lammps_cases.scene import Scene, casefile, check_name
from tests.conftest import BASE

LATTICE = BASE["positions"]
MODEL = {"compare": ["f"]}
TWO = {"types": [{"mass": 1.0, "rho0": 1.0}, {"mass": 2.0}]}
BAD: list[tuple[dict[str, Any], str]] = [
    ({"method": "auto"}, "method is no key of a scene.*EOS.pressure"),
    ({"dimension": 3}, "lattice sq does not fit dimension 3"),
    ({"positions": LATTICE | {"cells": [100_000, 100_000]}}, "at most .* particles, found 10000000000"),
    ({"rho": {"per_type": [1.0, 2.0]}}, "rho.per_type needs 1 values, found 2"),
    (TWO, "rho0 must be given for every type or for none"),
    ({"violate": "missing_law"}, "violate"),
    ({"compare": ["f", "f"]}, "compare must name each field once"),
    ({"compare": ["shift/v"]}, "compare: shift/v needs rheo.shift"),
    ({"twin": {"relabel": True}}, "twin compares fields of the whole model"),
    (MODEL | {"rheo": {"shift": True}, "twin": {"boost": [1.0, 0.0]}}, "twin.boost: shifting"),
    ({"evolve": {"steps": 1, "timestep": 0.1, "deform": {"x": 0.1}}}, "deform compares fields of the whole model"),
]


def scene(**changes: Any) -> Scene:
    return Scene.model_validate(BASE | changes)


@pytest.mark.parametrize(("changes", "rule"), BAD)
def test_inconsistent_keys_are_refused(changes: dict[str, Any], rule: str) -> None:
    with pytest.raises(ValidationError, match=rule):
        scene(**changes)


def test_law_is_compared_at_the_end_and_model_at_requested_steps() -> None:
    evolve = {"steps": 4, "timestep": 0.01}
    law, model = scene(evolve=evolve), scene(**MODEL, evolve=evolve | {"compare_at": [0, 4]})
    assert (scene().snapshots, law.snapshots, model.snapshots) == ((0,), (4,), (0, 4))
    assert [one.whole_model for one in (scene(), law, model)] == [False, False, True]
    assert [one.interacts for one in (scene(), law, model)] == [False, True, True]


def test_only_defaults_in_use_are_listed() -> None:
    bare = {"types": [{"mass": 1.0}]}
    gas = {"pressure": [{"types": "*", "style": "ideal/gas", "gamma": 1.4}], "energy": {"constant": 1.0}}
    assert scene().defaults == ()
    assert scene(**bare).defaults == ("rho0 = 1", "cs = 1")
    assert scene(**bare, **gas).defaults == ("rho0 = 1",), "an ideal gas takes no speed of sound"
    assert scene(**bare, **MODEL).defaults == ("rho0 = 1", "cs = 1", "viscosity = 0.1")
    assert scene(**gas).thermal and not scene().thermal


def test_type_without_a_law_is_refused_with_its_location() -> None:
    types = [{"mass": 1.0}] * 2
    with pytest.raises(InputError, match=r"\(here\)"):
        scene(types=types, pressure=[{"types": "1", "style": "linear"}]).eos("here")
    assert len(scene(types=types, pressure=[{"types": "*", "style": "linear"}]).eos().laws) == 2


@pytest.mark.parametrize("name", ["", "A", "a.b", "a--b", "-a", "a b", "a" * 61])
def test_names_are_words_joined_by_hyphens(name: str) -> None:
    check_name("near-rho0+2d")
    with pytest.raises(InputError, match="name: "):
        check_name(name)


def test_tag_skips_files_but_no_tagged_case() -> None:
    for tag in {tag for case in casefile.load() for tag in case.tags}:
        assert casefile.select(casefile.load(tag=tag), tag=tag) == casefile.select(casefile.load(), tag=tag)
    assert len({case.source for case in casefile.load(tag="eos")}) < len({case.source for case in casefile.load()}) / 2
    assert casefile.load(tag="particle") == casefile.load(tag="no such word") == casefile.load(), "a word, but no tag"


def test_shipped_cases_are_cached_and_each_caller_gets_its_own_list() -> None:
    mine = casefile.load()
    mine.clear()
    assert casefile.load() and casefile.load()[0] is casefile.load()[0]
