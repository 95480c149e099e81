"""Maps of the time step: the linear theory drawn over them is that of the scheme."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from lammps_cases.engine.session import Session
from lammps_cases.studies.stability import kinds
from lammps_cases.studies.stability.maps import timestep
from lammps_cases.studies.stability.maps.timestep import (
    acoustic_criterion,
    box,
    growth,
    growth_limit,
    sound_limit,
    viscous_criterion,
    viscous_limit,
    watch,
)
from lammps_cases.studies.stability.model import ENGINES, Engine, MapCell
from lammps_cases.studies.stability.probe import follow
from lammps_cases.studies.stability.runs import open_run
from tests.support.roundings import rounded

TINY = 1e-9  # Mach number at which the scheme is linear


@pytest.fixture(scope="module")
def living() -> Session:
    return Session()


@pytest.mark.lammps
@pytest.mark.parametrize("side", ENGINES)
@pytest.mark.parametrize(
    ("fraction", "ratio", "cut"), [(1.5, 0.1, 3.0), (4.3, 1.0, 3.0), (4.5, 3.0, 2.5), (0.5, 1.0, 4.0)]
)
def test_energy_is_that_of_the_linearised_scheme(
    side: Engine, fraction: float, ratio: float, cut: float, living: Session
) -> None:
    start = box(fraction, ratio, cut, TINY)
    of, run = kinds.subject(start), open_run(start, watch(TINY), side, living)
    first = kinds.kinetic_energy(of.mass_n, run.snapshot().v_nc)
    measured = []
    for _ in range(5):
        run.advance(4)
        measured.append(kinds.kinetic_energy(of.mass_n, run.snapshot().v_nc) / first)
    # In a box of 10 spacings positions round by 1e-15; particles move by 2e-10 or more in a step: 5e-6 of it, and the
    # energy is a square.
    assert measured == pytest.approx(growth(fraction, ratio, cut, 4, 5), rel=1e-5)


@pytest.mark.lammps
@pytest.mark.parametrize("ratio", [0.1, 1.0, 10.0])
@pytest.mark.parametrize("side", ENGINES)
def test_runs_fail_beyond_the_growth_limit(side: Engine, ratio: float, living: Session) -> None:
    limit = growth_limit(ratio, 3.0)
    for fraction, kind in ((0.97 * limit, "stable"), (1.01 * limit, "energy growth")):
        start = box(fraction, ratio, 3.0, 1e-4)
        watched = watch(1e-4)
        found = follow(partial(open_run, start, watched, side, living), kinds.subject(start), watched, start.steps[-1])
        assert found.outcome.kind == kind


def test_waves_grow_beyond_the_limits() -> None:
    """The largest eigenvalue of a step crosses 1 at the lower of the two limits."""
    of = timestep.waves(3.0)
    for ratio, limit in ((0.1, sound_limit), (10.0, viscous_limit)):
        at = limit(ratio, 3.0)
        sizes = []
        for fraction in (0.95 * at, 1.2 * at):
            dt, nu = timestep.step_of(fraction, ratio, 3.0), timestep.viscosity(ratio, 3.0)
            s_k, q_k = of.d_k * dt, nu * of.l_k * dt
            # Eigenvalues of [[1 - s^2/2 - q, -i s], [-i s, 1]]: z^2 - trace z + det
            trace_k, det_k = 2 - s_k**2 / 2 - q_k, 1 + s_k**2 / 2 - q_k
            root_k = np.sqrt(trace_k**2 / 4 - det_k + 0j)
            sizes.append(float(np.abs([trace_k / 2 + root_k, trace_k / 2 - root_k]).max()))
        assert sizes[0] <= 1 + 1e-12 < sizes[1]


def test_criteria_meet_where_viscosity_and_sound_limit_equally() -> None:
    for cut in (2.0, 3.0, 4.0):
        assert acoustic_criterion(1.0, cut) == rounded(1.0, 8) == viscous_criterion(1.0, cut)
        assert acoustic_criterion(3.0, cut) == rounded(3.0, 8)
        assert viscous_criterion(0.2, cut) == rounded(5.0, 8)


def test_every_run_has_the_same_number_of_steps() -> None:
    for of in timestep.MAPS:
        for y in of.lines:
            assert of.start(MapCell(of.id, 1.0, y)).steps == (timestep.STEPS,)
