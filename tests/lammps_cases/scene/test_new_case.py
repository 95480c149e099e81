"""A new case is complete with its YAML and a line that says why no claim names it."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.walk import walk

CASE = """# yaml-language-server: $schema=../scene/scene.schema.json
name: walked
about: A gas and water in one box.
tags: [eos]
exercises: {"*": [gas-without-rho, water-of-six]}
scene:
  dimension: 2
  types: [{mass: 1.3, rho0: 1.2, cs: 7.9}, {mass: 0.8, rho0: 0.9, cs: 5.1}]
  positions:
    lattice: sq
    spacing: 0.7
    cells: [9, 8]
    regions: [{type: 1, low: [0, 0], high: [1, 1]}, {type: 2, low: [0, 0], high: [0.5, 1]}]
  pressure: [{types: 1, style: tait/water}, {types: 2, style: ideal/gas, gamma: 1.39}]
  energy: {range: [0.3, 3.7]}
  rho: {ratio: [0.8, 1.2]}
"""
EDITS = {
    "lammps_cases/data/cases/walked.yaml": lambda text: CASE,
    "lammps_cases/data/claims/unclaimed.yaml": lambda text: f"{text}walked: a walk of the tests\n",
}


@pytest.mark.lammps
@pytest.mark.slow
def test_new_case_is_complete_in_two_files(tmp_path: Path) -> None:
    assert len(EDITS) <= 2
    assert walk(tmp_path, EDITS, "use_new_case.py") == "walked"
