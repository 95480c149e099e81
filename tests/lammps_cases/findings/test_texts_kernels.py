"""The finding about a kernel style that no page has: every number of its text, on LAMMPS."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from scipy.integrate import quad

from eos_ref.eos.bounds import EPS
from lammps_cases.comparison.trajectory import predict
from lammps_cases.findings import forces
from lammps_cases.findings.kernels import WENDLAND_C4, WendlandC4
from lammps_cases.findings.variants import Snapshot
from lammps_cases.verdict.case_arrays import read_snapshots
from tests.support.printed import printed, quoted, recomputes, works_around
from tests.support.small_scene import Engine, SmallScene, small_scene

pytestmark = pytest.mark.lammps

NAME = "kernel-wendland-c4"
WALLS = {"types": [{"mass": 1.2, "viscosity": 0.2}, {"mass": 0.9, "phase": "solid"}]}
OPTIONS: dict[str, dict[str, Any]] = {
    "terms": {"pair": {"rho_damp": 0.1, "artificial_visc": 0.5}, "compare": ["grad/v", "f", "drho", "pressure"]},
    "shift": {"rheo": {"shift": True}, "compare": ["shift/v", "x", "rho"], "evolve": {"steps": 1, "timestep": 0.01}},
    "sum": {"rheo": {"rho_sum": True}, "compare": ["rho", "f"], "rho": None},
    "surface": {
        "rheo": {"surface_detection": {"style": "divergence", "limit": 30.0, "splash": 3}},
        "compare": ["surface/divr", "surface", "surface/n", "surface/r"],
    },
    "walls": {"rheo": {"interface_reconstruct": True}, "compare": ["chi", "rho", "grad/v", "f"], **WALLS},
}


class Stages(WendlandC4, forces.ForcePerVolume):
    """What the LAMMPS of this environment does."""


def disorder(dimension: int, **options: Any) -> SmallScene:
    """Particles in disorder, walls at rest."""
    random = np.random.default_rng(dimension)
    n = 24
    x, v = random.uniform(2, 6, (n, dimension)), random.uniform(-1, 1, (n, dimension))
    kind = np.arange(n) % 2 + 1 if "types" in options else 1
    v[np.broadcast_to(kind, n) == 2] = 0.0
    given = {"rho": random.uniform(0.8, 1.2, n)} | options
    return small_scene(x, (8,) * dimension, v=v, kind=kind, **given)


def with_kernel(lammps: Engine, scene: SmallScene) -> list[Snapshot]:
    """LAMMPS' fields with the kernel of the text."""
    (name,) = quoted(NAME, "observed")
    edited = tuple(line.replace(" quintic ", f" {name} ") for line in scene.job.commands)
    return read_snapshots(scene.scene, lammps.answer(replace(scene.job, commands=edited)))


@pytest.mark.parametrize("option", OPTIONS)
@pytest.mark.parametrize("dimension", [2, 3])
def test_every_sum_is_reproduced(lammps: Engine, dimension: int, option: str) -> None:
    scene = disorder(dimension, **OPTIONS[option])
    found, variant = with_kernel(lammps, scene), predict(scene.problem, Stages)
    for at in range(len(scene.scene.snapshots)):
        for field in scene.scene.compare:
            far = np.abs(found[at][field] - variant.fields[at][field])
            assert np.all(far <= variant.bounds[at][field]), field
    plain = scene.predicted().fields[0]
    assert any(not np.allclose(found[0][field], plain[field]) for field in scene.scene.compare)


@works_around(NAME, 2)
@pytest.mark.parametrize("dimension", [2, 3])
@recomputes(NAME, "factor_2d factor_3d", some=True)
def test_surfaces_have_the_spline_with_another_factor(lammps: Engine, dimension: int) -> dict[str, Any]:
    factor = vars(printed(NAME))[f"factor_{dimension}d"]
    scene = disorder(dimension, **OPTIONS["surface"])
    (found,), spline = with_kernel(lammps, scene), scene.predicted()
    spline_n, bound_n = spline.fields[0]["surface/divr"], spline.bounds[0]["surface/divr"]
    ratio_n = found["surface/divr"] / spline_n
    rounding_n = bound_n / np.abs(spline_n)  # of the same sums on both sides; to first order, so twice is enough
    assert np.all(np.abs(ratio_n / ratio_n[0] - 1) <= 2 * (rounding_n + rounding_n[0]))
    # The workaround: with a limit that many times as high LAMMPS finds the surface of the spline.
    limits = [{"style": "divergence", "limit": limit, "splash": 3} for limit in (0.9, 0.9 * factor)]
    ours, theirs = (disorder(dimension, rheo={"surface_detection": one}, compare=["surface"]) for one in limits)
    surface_n = ours.predicted().fields[0]["surface"]
    assert len(np.unique(surface_n)) > 1
    np.testing.assert_array_equal(with_kernel(lammps, theirs)[0]["surface"], surface_n)
    return {f"factor_{dimension}d": ratio_n[0]}


@recomputes(NAME, "inside reported")
def test_the_divergence_inside_a_fluid(lammps: Engine) -> dict[str, Any]:
    grid = np.stack(np.meshgrid(*[np.arange(8.0)] * 2), axis=-1).reshape(-1, 2)
    scene = small_scene(grid, (8, 8), **OPTIONS["surface"])
    (found,) = with_kernel(lammps, scene)
    return {"inside": scene.predicted().fields[0]["surface/divr"], "reported": found["surface/divr"][0]}


@pytest.mark.parametrize("dimension", [2, 3])
def test_it_is_wendlands(dimension: int) -> None:
    """Its integral is 1, its slope the derivative of its shape; it ends at the cutoff."""
    normalisation = WENDLAND_C4.normalisation(dimension, 2.0)

    def shell(r: float) -> float:
        area = 2 * math.pi * r if dimension == 2 else 4 * math.pi * r**2
        return normalisation * float(WENDLAND_C4.shape(r / (2.0 / 3))) * area

    integral, error = quad(shell, 0, 2.0)
    assert abs(integral - 1) <= error < 1e-6
    u = Polynomial([0.0, 1 / 3])
    derivative = ((1 - u) ** 6 * (1 + 6 * u + 35 / 3 * u**2)).deriv()
    q = np.linspace(0.0, 3.0, 50)
    # Every coefficient is a sum of at most 8 products of as many factors: 16 roundings of the same with u for -u.
    rounding = 16 * EPS * ((1 + u) ** 6 * (1 + 6 * u + 35 / 3 * u**2)).deriv()(q)
    assert np.all(np.abs(WENDLAND_C4.slope(q) - derivative(q)) <= rounding)
    assert WENDLAND_C4.shape(3.0) == 0 and WENDLAND_C4.slope(3.0) == 0
