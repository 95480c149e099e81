"""Every rule of the reference has two witnesses in different scenes, in 2D and in 3D; a witness depends on the rule."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from lammps_cases.comparison.predictor import Predictor
from lammps_cases.run.prepared_case import prepare
from lammps_cases.scene import casefile
from lammps_cases.scene.casefile import Case
from lammps_cases.scene.rules import RULES, Rule
from tests.workshop.faults import witnesses
from tests.workshop.faults.schedule import in_order
from tests.workshop.faults.witnesses import ENOUGH, CaseRules, ExaminedCase, RuleRow

SURFACE: dict[str, Any] = {
    "positions": {
        **{"lattice": "sq", "spacing": 0.9, "cells": [9, 6], "disorder": 0.1},
        "regions": [{"type": None, "low": [0.5, 0], "high": [1, 1]}],
    },
    "pressure": [{"types": "*", "style": "linear"}],
    "rheo": {"surface_detection": {"style": "coordination", "limit": 16, "splash": 5}},
    "compare": ["surface", "surface/n"],
}
NAMED = ["surface-normal", "surface-distance", "rho0"]


@pytest.fixture
def surface(case_file: Callable[..., Path]) -> Callable[..., Case]:
    def case(**changes: Any) -> Case:
        path = case_file(**{**SURFACE, **changes})
        path.write_text(yaml.safe_dump(yaml.safe_load(path.read_text()) | {"exercises": {"*": NAMED}}))
        (made,) = casefile.load_file(path)
        return made

    return case


def _depends(case: Case) -> list[str]:
    """The rules that a case depends on, without those that have no formula of their own."""
    return [name for name in witnesses.examine(case).depends if RULES[name].faults]


@pytest.mark.slow
def test_a_case_depends_on_what_it_compares(surface: Callable[..., Case]) -> None:
    """Normals are seen where they are compared, or shift particles; distances to the surface are not looked at here."""
    assert _depends(surface()) == ["surface-normal"]
    assert _depends(surface(compare=["surface", "surface/r"])) == ["surface-distance"]
    shifted = surface(rheo=SURFACE["rheo"] | {"shift": True}, compare=["surface", "shift/v"], velocity={"random": 0.3})
    assert _depends(shifted) == ["surface-normal"]


def test_a_case_without_the_branch_has_nothing_to_say_of_it(surface: Callable[..., Case]) -> None:
    full = surface(positions={"lattice": "sq", "spacing": 0.9, "cells": [9, 6], "disorder": 0.1})
    of_case = witnesses.examine(full)
    assert of_case.counts["surface-normal"] == 0 and "surface-normal" not in of_case.depends
    complaints = list(witnesses.complaints([full], [of_case], rules=False))
    assert complaints[0] == "case mine says it exercises surface-normal, but no particle of it does"


def test_a_twin_is_no_witness_and_no_complaint(surface: Callable[..., Case]) -> None:
    twin = surface(twin={"relabel": True})
    of_case = witnesses.examine(twin)
    assert of_case.counts["surface-normal"] > 0 and of_case.depends == ()
    said = list(witnesses.complaints([twin], [of_case], rules=False))
    assert said == ["case mine says it exercises rho0, but no particle of it does"]


def test_a_law_is_broken_in_its_own_states(case_file: Callable[..., Path]) -> None:
    path = case_file(pressure=[{"types": "*", "style": "linear"}])
    named = {"*": ["law-linear", "below-rho0", "rho0", "laws-by-type"]}
    path.write_text(yaml.safe_dump(yaml.safe_load(path.read_text()) | {"exercises": named}))
    (case,) = casefile.load_file(path)
    assert _depends(case) == ["law-linear", "below-rho0", "rho0"]


def test_cases_that_differ_in_what_is_compared_are_one_scene() -> None:
    """Twins and ranks of a scene are no second witness."""
    of = {case.name: witnesses.scene_of(case) for case in casefile.load()}
    assert of["twins.fluid.boost"] == of["twins.fluid.ranks"] != of["twins.rk1.boost"]


def test_the_table_says_what_is_missing() -> None:
    said = [
        CaseRules("a.one", "scene 1", 3, {"layer": 4}, ("layer",)),
        CaseRules("a.two", "scene 1", 3, {"layer": 4, "rho0": 9}, ("layer", "rho0")),
        CaseRules("b", "scene 2", 2, {"layer": 2, "rho0": 0}, ("layer", "rho0")),
    ]
    rows = {row.rule: row for row in witnesses.rows(said)}
    layer = rows["layer"]
    assert (layer.cases, layer.scenes, layer.taken) == ({2: ("b",), 3: ("a.one", "a.two")}, {2: 1, 3: 1}, 3)
    assert layer.missing == "1 of 2 witnesses in 2D, 1 of 2 witnesses in 3D"
    assert rows["rho0"].missing == "", "laws know no dimension"


# --- the cases there are


@pytest.fixture(scope="module")
def naming() -> dict[str, list[Case]]:
    """The cases that name each rule and can be its witnesses, the cheapest first."""
    cases = [case for case in in_order(casefile.load()) if witnesses.can_witness(case)]

    def names(case: Case, rule: str) -> bool:
        return rule in case.exercises or rule.removeprefix("field/") in case.scene.compare

    return {rule: [case for case in cases if names(case, rule)] for rule in RULES}


@pytest.fixture(scope="module")
def examined() -> dict[str, ExaminedCase]:
    return {}


@pytest.mark.slow
@pytest.mark.parametrize("rule", RULES.values(), ids=RULES)
def test_rule_has_witnesses(rule: Rule, naming: dict[str, list[Case]], examined: dict[str, ExaminedCase]) -> None:
    """Cases that name it are put to its mistakes until two scenes of every dimension depend on it."""
    found: dict[int, set[str]] = {2: set(), 3: set()}
    for case in naming[rule.name]:
        dimension = case.scene.dimension
        if len(found[dimension]) < ENOUGH and witnesses.scene_of(case) not in found[dimension]:
            if case.name not in examined:
                examined[case.name] = ExaminedCase(prepare(case), Predictor())
            if examined[case.name].depends(rule):
                found[dimension].add(witnesses.scene_of(case))
    scenes = {dimension: len(of) for dimension, of in found.items()}
    assert RuleRow(rule.name, rule.sentence, {2: (), 3: ()}, scenes, 0).missing == ""
