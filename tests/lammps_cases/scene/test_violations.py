"""Rules that a scene breaks on purpose: each changes its own commands and no others, in any scene."""

from __future__ import annotations

import difflib

import pytest

from lammps_cases.claims.probes.probe import load_scene
from lammps_cases.scene import casefile
from lammps_cases.scene.manual import VIOLATIONS, with_broken_rule
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan

WARM, ATOMS = load_scene("warm", {"types": [{"mass": 1.2, "rho0": 1.2, "cs": 3.1, "phase": "solid"}]})


def changes(violation: str) -> list[str]:
    """Return the commands that a violation removes and adds, each cut to 24 characters."""
    scenes = (WARM.scene, WARM.scene.model_copy(update={"violate": violation}))
    before, after = (job(scene, ATOMS, plan(scene)) for scene in scenes)
    lines = difflib.ndiff([*before.setup, *before.commands], [*after.setup, *after.commands])
    return [line[:24].rstrip() for line in lines if line[0] in "+-"]


@pytest.mark.parametrize(
    ("violation", "wanted"),
    {
        "atom-style-atomic": ["- atom_style rheo/thermal", "+ atom_style atomic", "- set type 1 rheo/status 1"],
        "atom-style-rheo": ["- atom_style rheo/thermal", "+ atom_style rheo"],
        "no-fix-rheo": ["- fix rheo all"],
        "no-fix-pressure": ["- fix pressure all", "- compute q all"],
        "no-fix-pressure-read": ["- fix pressure all"],
        "no-fix-viscosity": ["- fix viscosity all"],
        "no-fix-thermal": ["- fix thermal all"],
        "pressure-before-rheo": ["+ fix pressure all", "- fix pressure all"],
        "pressure-group": ["+ group some id 1", "- fix pressure all", "+ fix pressure some"],
        "pressure-twice": ["+ fix pressure2 all"],
        "rheo-group": ["+ group some id 1", "- fix rheo all", "+ fix rheo some"],
        "rheo-twice": ["+ fix rheo2 all"],
        "unknown-pressure-style": ["- fix pressure all", "+ fix pressure all"],
        "missing-argument": ["- fix pressure all", "+ fix pressure all"],
    }.items(),
)
def test_violation_changes_its_commands_alone(violation: str, wanted: list[str]) -> None:
    found = changes(violation)
    assert len(found) == len(wanted)
    assert all(line.startswith(start[:24]) for line, start in zip(found, wanted, strict=True)), found


def test_every_violation_has_a_shipped_case() -> None:
    assert {case.scene.violate for case in casefile.load()} - {None} == set(VIOLATIONS)


def test_violations_of_arguments_and_styles() -> None:
    line = "fix pressure all rheo/pressure * cubic 1.0"
    assert with_broken_rule([line], "missing-argument") == (line.removesuffix(" 1.0"),)
    assert with_broken_rule([line], "unknown-pressure-style") == (line.replace("cubic", "taitwater"),)
    assert with_broken_rule(["fix rheo all rheo 3.0 RK1 4 shift"], "no-fix-thermal") == (
        "fix rheo all rheo 3.0 RK1 4 thermal shift",
    )
    assert with_broken_rule([line], None) == (line,)


def test_requested_arrays_follow_the_atom_style() -> None:
    for style, arrays in (("atom-style-atomic", []), ("atom-style-rheo", ["rho"]), (None, ["rho", "esph"])):
        scene = WARM.scene.model_copy(update={"violate": style})
        assert list(job(scene, ATOMS, plan(scene)).per_atom) == arrays
