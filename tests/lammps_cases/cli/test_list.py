"""The list of cases as JSON."""

from __future__ import annotations

import json
from collections.abc import Callable

from lammps_cases.scene import casefile
from tests.support.outcome import Outcome


def test_document_has_the_properties_that_select_cases(eos_ref_command: Callable[..., Outcome]) -> None:
    names = ("near-rho0.linear.2d", "walls.stored.damped", "refused.type-zero")
    code, out, _ = eos_ref_command("list", *names, "--json")
    listed = {case["case"]: case for case in json.loads(out)["cases"]}
    cases = {case.name: case for case in casefile.select(casefile.load(), names)}
    assert code == 0 and listed.keys() == cases.keys()
    for name, case in listed.items():
        of = cases[name]
        assert (case["about"], case["tags"], case["file"]) == (of.about, [*of.tags], str(of.source))
        assert (case["units"], case["dimension"]) == (of.scene.units, of.scene.dimension)
        assert case["atoms"] > 0
    linear, walls, refused = (listed[name] for name in names)
    assert (linear["laws"], linear["dimension"], linear["steps"]) == (["linear"], 2, 0)
    assert walls["steps"] > 0 and "rho" in walls["fields"] and refused["fields"] == []
