"""Which scenes a finding applies to, and the kernel of LAMMPS in one finding: by definition, without LAMMPS."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lammps_cases.findings import outcomes
from lammps_cases.findings.forces import has_means_of_zeros
from lammps_cases.findings.kernels import WENDLAND_C4, falls_back
from lammps_cases.run import prepared_case
from lammps_cases.scene import casefile
from lammps_cases.verdict.problems import problem_of
from tests.support.roundings import rounded

Write = Callable[..., Path]
THREE = [{"mass": 1.31, "rho0": 1.2, "cs": 3.1}] * 3
WALLS = {"interface_reconstruct": True}
CUBIC = [{"types": "*", "style": "cubic", "A3": 2.1}]


def stopped(by: str) -> dict[str, Any]:
    return {"steps": 2, "timestep": 0.001, "stops": [{"at": 1, "by": by}]}


@pytest.mark.parametrize(
    ("changes", "ends"),
    [
        ({}, {}),
        ({"rheo": {"rho_sum": True}, "rho": None}, {}),
        (
            {"rheo": {"rho_sum": True, "self_mass": True}, "rho": None},
            {"self-mass-missing": "Illegal fix rheo command: self/mass"},
        ),
        ({"rheo": {"shift": {"exclude": ["1", "3"]}}}, {"exclude-takes-one-range": "Illegal fix rheo command: 3"}),
        ({"rheo": {"shift": {"exclude": ["2"]}}}, {}),
        ({"rheo": {"shift": True}}, {}),
        (
            {"rheo": WALLS, "pressure": CUBIC},
            {"reconstruct-refuses-cubic": "interface reconstruction incompatible with pressure equation of state"},
        ),
        ({"pressure": CUBIC}, {}),
        ({"rheo": WALLS}, {}),
        ({"rheo": WALLS, "evolve": stopped("data")}, {"data-file-of-walls": "rheo_interface_fix_property_atom"}),
        ({"rheo": WALLS, "evolve": stopped("restart")}, {}),
        ({"evolve": stopped("data")}, {}),
        ({"compare": ["stress/t"]}, {"stress-without-pressure-segfault": "SIGSEGV"}),
        ({"compare": ["stress/t", "pressure"]}, {}),
        ({"compare": ["pressure"]}, {}),
    ],
)
def test_refused_scene_is_predicted(case_file: Write, changes: dict[str, Any], ends: dict[str, str]) -> None:
    (case,) = casefile.load((case_file(types=THREE, **{"compare": ["f"]} | changes),))
    foretold = {entry.id: entry.ends(case.scene) for entry in outcomes.ENTRIES}
    assert {name: text for name, text in foretold.items() if text} == ends


@pytest.mark.parametrize(
    ("harmonic", "eta", "conductivity", "steps", "applies"),
    [
        (True, 0.0, 0.7, (0,), True),
        (True, 0.4, 0.0, (0,), True),
        (True, 0.0, None, (0,), True),
        (True, 0.4, None, (0,), False),
        (True, 1.0, 1.0, (0,), False),
        (False, 0.0, 0.0, (0,), False),
        (True, 0.0, 0.0, (0, 3), True),
    ],
)
def test_means_of_zeros_are_harmonic_ones(
    harmonic: bool, eta: float, conductivity: float | None, steps: tuple[int, ...], applies: bool
) -> None:
    problem: Any = SimpleNamespace(
        model=SimpleNamespace(
            viscosity=[SimpleNamespace(eta=0.3), SimpleNamespace(eta=eta)],
            thermal=None if conductivity is None else [SimpleNamespace(conductivity=conductivity)],
            pair=SimpleNamespace(harmonic_means=harmonic),
        ),
        steps=steps,
    )
    assert bool(has_means_of_zeros(problem)) == applies


def test_particles_fall_back_where_neighbours_are_or_may_become_few() -> None:
    """With kernels that correct gradients: below zmin at once, in an open box after a step."""
    (case,) = casefile.select(casefile.load(), ["forces.all.rk1.2d"])
    given = problem_of(case.scene, prepared_case.prepare(case).atoms, "", (0,))
    fix = given.model.fix
    full = replace(given, model=replace(given.model, fix=replace(fix, zmin=3)))
    assert all(full.box.periodic) and not falls_back(full)
    assert falls_back(replace(full, model=replace(full.model, fix=replace(fix, zmin=len(given.state.x_nc)))))
    assert not falls_back(replace(full, steps=(0, 5)))
    opened = replace(full, box=replace(full.box, periodic=(True, False)))
    assert falls_back(replace(opened, steps=(0, 1)))
    (plain,) = casefile.select(casefile.load(), ["forces.all.quintic.2d"])
    assert not falls_back(problem_of(plain.scene, prepared_case.prepare(plain).atoms, "", (0,)))


@pytest.mark.parametrize("dimension", [2, 3])
def test_wendlands_kernel_is_normalised_and_has_its_slope(dimension: int) -> None:
    nodes, weights = np.polynomial.legendre.leggauss(16)  # exact for its degree
    cut = 2.4
    q = 1.5 * (nodes + 1)
    r, area = q * cut / 3, 2 * math.pi * (1 if dimension == 2 else 2)
    w = WENDLAND_C4.normalisation(dimension, cut) * WENDLAND_C4.shape(q)
    integral = (weights * cut / 2 * area * r ** (dimension - 1) * w).sum()
    assert integral == rounded(1.0, 32)  # positive terms: 15 sums, 17 roundings of each
    risen = np.array([(weights * q / 2 * WENDLAND_C4.slope(q * (nodes + 1) / 2)).sum() for q in (1.0, 2.9)])
    assert risen == rounded(WENDLAND_C4.shape(np.array([1.0, 2.9])) - 1.0, 32)  # the same of negative ones
    np.testing.assert_array_equal(WENDLAND_C4.shape(np.array([0.0, 3.0, 3.5])), [1.0, 0.0, 0.0])
    np.testing.assert_array_equal(WENDLAND_C4.slope(np.array([3.0, 3.5])), [0.0, 0.0])
