"""Particles, plan and commands of a scene: only what the scene needs."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

from lammps_cases.engine.session import Job
from lammps_cases.run import campaign, prepared_case
from lammps_cases.scene import casefile, models
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan

Write = Callable[..., Path]


def told(name: str) -> Job:
    (case,) = casefile.select(casefile.load(), [name])
    return job(case.scene, prepared_case.prepare(case).atoms, plan(case.scene))


@pytest.mark.parametrize("name", ["near-rho0.linear.2d", "evolved.ideal-gas", "ideal-gas.beside-tait", "summed.3d"])
def test_numbers_in_commands_round_trip_exactly(name: str) -> None:
    (case,) = casefile.select(casefile.load(), [name])
    (rheo,) = [command for command in told(name).commands if " rheo " in command and command.startswith("fix")]
    words = rheo.split()
    n = len(case.scene.types)
    at = words.index("density")
    assert tuple(map(float, words[at + 1 : at + 1 + n])) == case.scene.rho0
    at = words.index("speed/sound")
    assert tuple(map(float, words[at + 1 : at + 1 + n])) == case.scene.cs


def test_commands_contain_no_free_text_of_a_scene(case_file: Write) -> None:
    """Only numbers, type ranges and words of closed lists reach LAMMPS."""
    free_text = []
    for name, field in _text_fields():
        free_text.append(f"{name}.{field}")
    # types: a range that the reference's parser accepts, or a scene that expects refusal (digits, stars, hyphens);
    # extxyz, data, dump, csv and their columns: files read by the harness; refused: compared with LAMMPS' answer.
    assert sorted(free_text) == [
        "Columns.energy",
        "Columns.rho",
        "Displacement.types",
        "Expect.refused",
        "ForceSettings.types",
        "FromData.data",
        "FromDump.dump",
        "FromXYZ.extxyz",
        "LawSettings.types",
        "ShiftSettings.exclude",
        "ValueTable.column",
        "ValueTable.csv",
    ]
    assert casefile.load_file(case_file(pressure=[{"types": "*", "style": "linear"}]))
    for evil in ("1 linear\nshell date", "* linear fix", "${x}", "1;2", "all"):
        places: dict[str, dict[str, Any]] = {
            "types": {"pressure": [{"types": evil, "style": "linear"}]},
            "types ": {"forces": [{"style": "gravity", "vector": [0, -1], "types": evil}]},
            "types  ": {"evolve": {"steps": 1, "timestep": 0.1, "stops": [{"at": 1, "displace": {"types": evil}}]}},
            "exclude": {"rheo": {"shift": {"exclude": [evil]}}},
        }
        for place, changes in places.items():
            file = case_file(**changes, expect={"refused": "Invalid range string"})
            with pytest.raises(ValueError, match=place.strip()):
                casefile.load_file(file)


def _text_fields() -> list[tuple[str, str]]:
    return [
        (model.__name__, name)
        for model in models()
        for name, field in model.model_fields.items()
        if _holds_text(field.annotation)
    ]


def _holds_text(annotation: Any) -> bool:
    return annotation is str or any(
        _holds_text(part) for part in get_args(annotation) if isinstance(part, type) or get_args(part)
    )


def test_positions_depend_on_the_name_and_lie_in_the_box() -> None:
    cases = [case for case in casefile.load() if case.name.startswith(("near-rho0.linear", "ranges"))]
    built = {case.name: prepared_case.prepare(case).atoms for case in cases}
    for case in cases:
        again = prepared_case.prepare(case).atoms
        atoms = built[case.name]
        assert np.array_equal(again.x_nc, atoms.x_nc)
        assert again.rho_n is not None and np.array_equal(again.rho_n, atoms.rho_n)
        assert np.all(atoms.x_nc >= atoms.low_c) and np.all(atoms.x_nc < atoms.high_c)
    for one, other in itertools.combinations(sorted(name for name in built if name.startswith("ranges")), 2):
        if built[one].x_nc.shape == built[other].x_nc.shape:
            assert not np.array_equal(built[one].x_nc, built[other].x_nc)


@pytest.mark.slow
def test_types_have_equal_shares() -> None:
    atoms = prepared_case.prepare(casefile.select(casefile.load(), ["ranges.single"])[0]).atoms
    assert np.ptp(np.bincount(atoms.type_n)[1:]) <= 1
    blocks = prepared_case.prepare(casefile.select(casefile.load(), ["ranges.blocks"])[0]).atoms
    assert np.all(np.diff(blocks.type_n) >= 0)


@pytest.mark.lammps
def test_blind_spots_of_shipped_law_scenes_are_listed(tmp_path: Path) -> None:
    """All lint of these scenes is listed here: every other one detects each mistake in a law."""
    from lammps_cases.engine.installations import Engine

    run = campaign.run_cases(casefile.select(casefile.load(), tag="eos"), Engine(), 2, tmp_path / "report")
    blind = {case.case: set(case.lint) for case in run.cases if case.lint}
    same_law = {"types exchanged"}  # an ideal gas does not depend on rho0 and cs: its types differ in mass only
    ones = {"cs instead of cs^2", "cs ignored", "rho0 ignored", "rho0 and cs exchanged", "types exchanged"}
    assert blind == {
        "defaults.linear": ones,
        "defaults.tait-water": ones,
        "exponents.g-7": {"exponent 7 for every Tait law"},
        "ideal-gas.nearly-isothermal": same_law,
        "ideal-gas.negative-energy": same_law,
        "ideal-gas.stiff": same_law,
        "ideal-gas.three-dimensions": same_law,
        "prefactors.zero": {"linear instead of Tait or cubic"},
    }
