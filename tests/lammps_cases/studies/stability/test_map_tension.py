"""Tension makes particles clump, pressure does not; theory predicts where, and shift moves the boundary."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eos_ref.eos.bounds import EPS
from eos_ref.kernels.quintic import QUINTIC
from lammps_cases.studies.stability.maps import tension
from lammps_cases.studies.stability.model import ENGINES, Engine, FailureCriteria, MapCell
from lammps_cases.studies.stability.runs import open_run
from tests.support.roundings import rounded
from tests.support.stability_cells import living, outcome

pytestmark = pytest.mark.slow


@pytest.mark.lammps
@pytest.mark.parametrize("density", [0.8, 1.2])
@pytest.mark.parametrize("side", ENGINES)
def test_sign_of_the_pressure_decides(density: float, side: Engine) -> None:
    """The boundary follows the background pressure at which the total pressure is 0."""
    free = tension.TENSION.theory[0].x_of_y(density)
    assert outcome(tension.TENSION, free - 0.1, density, side=side).kind == "clumping"
    assert outcome(tension.TENSION, free + 0.05, density, side=side).kind == "stable"


@pytest.mark.parametrize("cut", tension.WIDE.lines)
def test_positive_pressure_pairs_no_particles(cut: float) -> None:
    assert outcome(tension.WIDE, 0.8, cut).kind == "stable"
    assert outcome(tension.WIDE, -0.2, cut).kind == "clumping"


def test_shift_tolerates_more_tension() -> None:
    assert outcome(tension.TENSION, -0.2, 1.0, "").kind == "clumping"
    assert outcome(tension.TENSION, -0.2, 1.0, "shift").kind == "stable"
    assert outcome(tension.TENSION, -0.6, 1.0, "shift").kind == "clumping"


def test_shift_raises_the_density_until_tension_vanishes() -> None:
    cell = MapCell("tension", -0.2, 1.0, "shift")
    start = tension.TENSION.start(cell)
    run = open_run(start, tension.TENSION.watch(cell), "reference", living())
    assert np.mean(run.snapshot().pressure_n) == rounded(-0.2, 8, terms=1.0)
    run.advance(start.steps[-1])
    assert np.mean(run.snapshot().rho_n) > 1.1
    assert np.mean(run.snapshot().pressure_n) > -0.1


def fastest(background: float) -> tuple[np.ndarray, np.ndarray]:
    """Return wave vector and direction of the wave that grows fastest."""
    stiffness_kab, g_kc, damping_k = tension.waves(3.0)
    value_kc, vector_kab = np.linalg.eigh(2 * background * stiffness_kab + g_kc[:, :, None] * g_kc[:, None, :])
    half_k = tension.NU * damping_k / 2
    k = int(np.argmax(-half_k + np.sqrt(np.maximum(half_k**2 - value_kc[:, 0], 0.0))))
    _, edges = tension.triangles(tension.WIDTH, tension.HEIGHT)
    p, q = divmod(k + 1, tension.HEIGHT)  # the wave of infinite length is left out
    return 2 * np.pi * np.array([p, q]) / edges, vector_kab[k, :, 0]


@pytest.mark.lammps
@pytest.mark.parametrize("side", ENGINES)
def test_wave_grows_at_the_rate_of_the_theory(side: Engine) -> None:
    """A small wave on the perfect lattice grows at the rate of the theory, to first order in the time step."""
    background, dt, size = -0.3, 0.01, 1e-5
    x_nc, edges = tension.triangles(tension.WIDTH, tension.HEIGHT)
    k_c, e_c = fastest(background)
    wave_n = np.cos((x_nc - x_nc[0]) @ k_c)
    start = tension.TENSION.start(MapCell("tension", background, 1.0, ""))
    flat_nc = np.hstack([np.mod(x_nc + size * wave_n[:, None] * e_c, edges), np.zeros((len(x_nc), 1))])
    start = replace(start, atoms=replace(start.atoms, x_nc=flat_nc), timestep=dt)
    scene = start.case.scene
    assert scene.evolve is not None
    timed = scene.model_copy(update={"evolve": scene.evolve.model_copy(update={"timestep": dt})})
    run = open_run(replace(start, case=replace(start.case, scene=timed)), FailureCriteria(), side, living())
    sizes = []
    for steps in (500, 500):
        run.advance(steps)
        moved_nc = run.snapshot().x_nc - x_nc
        moved_nc -= np.round(moved_nc / edges) * edges
        sizes.append(float(wave_n @ moved_nc @ e_c) / float(wave_n @ wave_n))
    rate = tension.growth_rate(background, 1.0, 3.0)
    assert size < sizes[1] < 1e-2  # it has grown, and is still small
    assert np.log(sizes[1] / sizes[0]) / (500 * dt) == pytest.approx(rate, rel=rate * dt)


def test_no_growth_without_tension() -> None:
    # The lower eigenvalue, 0, rounds like g^2, and the root of its sum with (Gamma/2)^2 like Gamma/2.
    _, g_kc, damping_k = tension.waves(3.0)
    half_k, size_k = tension.NU * damping_k / 2, (g_kc**2).sum(axis=1)
    rounding = float((8 * EPS * size_k / (2 * half_k) + 2 * EPS * half_k).max())
    assert tension.growth_rate(0.0, 1.0, 3.0) == pytest.approx(0, abs=rounding)
    assert tension.growth_rate(0.3, 1.0, 3.0) < 1e-3
    assert tension.growth_rate(-0.3, 1.0, 3.0) > tension.growth_rate(-0.1, 1.0, 3.0) > 0.05


def test_clumping_begins_where_the_fastest_wave_can_grow() -> None:
    """The estimate is linear and represents the disorder by one wave: it is accurate to 0.05 rho0 c^2."""
    expected = tension.clumps_below(1.0, 3.0)
    assert -0.05 < expected < 0
    assert outcome(tension.TENSION, expected - 0.05, 1.0).kind == "clumping"
    assert outcome(tension.TENSION, expected, 1.0).kind == "stable"


def test_stability_depends_on_the_whole_sum_of_neighbours() -> None:
    """With 6 spacings W'' < 0 at the nearest neighbours, but the lattice is unstable only under tension."""

    def bend(cut: float) -> float:
        h, step = cut / QUINTIC.support, 1e-4
        slopes = [QUINTIC.slope(tension.EDGE / h + side) for side in (-step, step)]
        return float(slopes[1] - slopes[0])

    assert bend(6.0) < 0 < bend(3.0)
    for cut in (3.0, 6.0):
        eigenvalues = np.linalg.eigvalsh(tension.waves(cut)[0])
        assert -0.01 * eigenvalues.max() < eigenvalues.min() < eigenvalues.max()
