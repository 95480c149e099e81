"""Every kind of failure is detected in particles made for it, and none in sound ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lammps_cases.studies.flows.flow import Snapshot
from lammps_cases.studies.stability import kinds
from lammps_cases.studies.stability.kinds import ParticleFailure
from lammps_cases.studies.stability.model import KINDS, FailureCriteria
from tests.support.roundings import rounded
from tests.support.stability_scenes import brute_moments, channel

START = channel()
OF = kinds.subject(START)
FLUID = np.flatnonzero(~OF.solid_n)
N = len(OF.id_n)
X = START.atoms.x_nc[:, :2]
V = np.full((N, 2), 0.1)
ENERGY = kinds.kinetic_energy(OF.mass_n, V)
WATCH = FailureCriteria(
    growth=4.0, closest=0.5, hyperbolic=True, pressure=True, behind=(1, 1.7), surface={10: 0, 60: 1}, condition=1e12
)

LOOK = Snapshot(7, X, V, np.ones(N), np.full(N, 0.5), None, np.where(OF.id_n == 60, 1.0, 0.0))
K = 40  # a fluid particle far from all faces
WALL = int(np.flatnonzero(OF.solid_n)[0])


def put(**rows: tuple[int, object]) -> Snapshot:
    """Return the sound snapshot with one row of some arrays replaced."""
    changed = {}
    for name, (k, value) in rows.items():
        changed[name] = np.array(getattr(LOOK, name), float)
        changed[name][k] = value
    return replace(LOOK, **changed)


def seen(look: Snapshot, watch: FailureCriteria = WATCH, energy: float | None = ENERGY) -> ParticleFailure | None:
    return kinds.first(OF, watch, look, energy)


def test_sound_particles_have_no_failure() -> None:
    assert not OF.solid_n[K]
    assert seen(LOOK) is None


def apart(distance: float) -> Any:
    """A distance up to roundings of positions up to 14, of the squares, their sum and its root."""
    return rounded(distance, 4, terms=14.0)


NAN = pytest.approx(np.nan, nan_ok=True)
PLANTED: dict[str, Callable[[], tuple[Snapshot, ParticleFailure]]] = {
    "lost": lambda: (put(x_nc=(K, (3.0, 13.25))), ParticleFailure("lost particles", K + 1, 0.25)),
    "nan density": lambda: (put(rho_n=(K, np.nan)), ParticleFailure("non-finite", K + 1, NAN)),
    "nan pressure": lambda: (put(pressure_n=(K, np.nan)), ParticleFailure("non-finite", K + 1, NAN)),
    "infinite velocity": lambda: (put(v_nc=(K, (0.0, np.inf))), ParticleFailure("non-finite", K + 1, NAN)),
    "nan position": lambda: (put(x_nc=(K, (np.nan, 1.0))), ParticleFailure("non-finite", K + 1, NAN)),
    "infinite pressure": lambda: (put(pressure_n=(K, np.inf)), ParticleFailure("overflow", K + 1, np.inf)),
    "infinite density": lambda: (put(rho_n=(K, -np.inf)), ParticleFailure("overflow", K + 1, -np.inf)),
    "negative density": lambda: (put(rho_n=(K, -0.25)), ParticleFailure("negative density", K + 1, -0.25)),
    "vanishing density": lambda: (put(rho_n=(K, 0.01)), ParticleFailure("vanishing density", K + 1, 0.01)),
    "penetration": lambda: (put(x_nc=(K, (3.0, 1.65))), ParticleFailure("wall penetration", K + 1, 1.65)),
    "energy": lambda: (
        put(v_nc=(K, (3.0, 4.0))),
        # Two sums of 2 N squares, and the expression here.
        ParticleFailure("energy growth", K + 1, rounded((12.5 + 0.01 * (N - 1)) / (0.01 * N), 2 * (2 * N + 2) + 5)),
    ),
    "overlap": lambda: (
        put(x_nc=(K, X[K + 1] - (0.001, 0.0))),
        ParticleFailure("overlap", K + 1, apart(0.001)),
    ),
    "clumping": lambda: (
        put(x_nc=(K, X[K + 1] - (0.375, 0.0))),
        ParticleFailure("clumping", K + 1, apart(0.375)),
    ),
    "pressure": lambda: (put(pressure_n=(K, -0.125)), ParticleFailure("negative pressure", K + 1, -0.125)),
    "hyperbolic": lambda: (
        put(rho_n=(K, 1.75)),
        ParticleFailure("loss of hyperbolicity", K + 1, -0.6875),
    ),
    "surface": lambda: (put(surface_n=(9, 2.0)), ParticleFailure("misclassified surface", 10, 2.0)),
}


@pytest.mark.parametrize("name", PLANTED)
def test_each_kind_is_detected(name: str) -> None:
    look, expected = PLANTED[name]()
    assert seen(look) == expected


@pytest.mark.parametrize("name", ["penetration", "energy", "overlap", "clumping", "pressure", "hyperbolic", "surface"])
def test_unwatched_kinds_are_not_detected(name: str) -> None:
    assert seen(PLANTED[name]()[0], FailureCriteria()) is None


def test_growth_needs_an_energy() -> None:
    assert seen(PLANTED["energy"]()[0], energy=None) is None


def test_solids_may_lie_behind_a_wall_and_close_together() -> None:
    assert X[WALL, 1] < 1.7
    assert seen(put(x_nc=(WALL, X[WALL + 1] - (0.2, 0.0)))) is None


def test_clumping_is_detected_across_a_periodic_face() -> None:
    first = int(FLUID[np.argmin(np.where(np.abs(X[FLUID, 1] - 4.5) < 0.3, X[FLUID, 0], np.inf))])
    look = put(x_nc=(first + 3, (X[first, 0] - 0.25 + 8.0, X[first, 1])))
    assert seen(look) == ParticleFailure("clumping", first + 1, rounded(0.25, 4, terms=8.0))


def test_penetration_is_detected_in_any_image() -> None:
    of = replace(OF, box=replace(OF.box, periodic=(True, True)))
    look = put(x_nc=(K, (3.0, 1.65 - 14.0)))
    assert kinds.FailureDetectors(of, WATCH, look, None).wall_penetration() == ParticleFailure(
        "wall penetration", K + 1, rounded(1.65, 2, terms=14.0)
    )


def test_worst_kind_comes_first() -> None:
    look = replace(put(rho_n=(K, -1.0)), pressure_n=put(pressure_n=(K + 2, np.nan)).pressure_n)
    found = seen(look)
    assert found is not None and (found.kind, found.atom) == ("non-finite", K + 3)
    assert seen(put(rho_n=(K, -1.0))) == ParticleFailure("negative density", K + 1, -1.0)


def test_detectors_are_in_the_order_of_the_kinds() -> None:
    order = [KINDS.index(seen(look()[0]).kind) for look in PLANTED.values()]
    assert order == sorted(order, reverse=True)


def test_extreme_particle_is_reported() -> None:
    look = put(rho_n=(K, -1.0))
    look.rho_n[K + 5] = -2.0
    look.rho_n[K + 6] = -2.0
    assert seen(look) == ParticleFailure("negative density", K + 6, -2.0)
    look = put(x_nc=(K, (3.0, 13.25)))
    look.x_nc[K + 5, 1] = 14.0
    assert seen(look) == ParticleFailure("lost particles", K + 6, 1.0)


# --- moment matrices

# Roundings of the elements of two matrices (of the kernel 20, of products and volumes 10, of sums of 36 images) and of
# their eigenvalues, for each of the six. An eigenvalue changes by no more than the matrix: by that of its norm.
COUNT = 6 * 2 * (20 + 10 + 36)


def test_condition_equals_an_independent_computation() -> None:
    ends = START.atoms.low_c[:2], START.atoms.high_c[:2]
    conditions = [np.linalg.cond(brute_moments(X, ends, 3.0, k)) for k in range(N)]
    worst = int(np.argmax(conditions))
    watch = replace(WATCH, condition=conditions[worst] * 0.999)
    assert seen(LOOK, watch) == ParticleFailure(
        "ill-conditioned matrix", worst + 1, rounded(conditions[worst], COUNT * conditions[worst])
    )
    assert seen(LOOK, replace(WATCH, condition=conditions[worst] * 1.001)) is None


def collinear() -> Snapshot:
    """One fluid particle with five neighbours, all on a line, so without a second derivative across it."""
    x_nc = X.copy()
    x_nc[FLUID[-6:]] = [(1.0 + 0.75 * k, 12.0) for k in range(6)]
    return replace(LOOK, x_nc=x_nc)


def test_failed_matrix_has_no_cholesky_factor() -> None:
    found = seen(collinear())
    assert found is not None
    assert found.kind == "failed matrix" and found.atom in FLUID[-6:] + 1
    matrix = brute_moments(collinear().x_nc, (START.atoms.low_c[:2], START.atoms.high_c[:2]), 3.0, found.atom - 1)
    assert found.value == rounded(np.linalg.eigvalsh(matrix)[0], COUNT, terms=np.linalg.norm(matrix))
    with pytest.raises(np.linalg.LinAlgError):
        np.linalg.cholesky(matrix)


def test_matrices_below_zmin_are_not_used() -> None:
    assert OF.model is not None
    model = replace(OF.model, fix=replace(OF.model.fix, zmin=9))
    assert kinds.first(replace(OF, model=model), WATCH, collinear(), ENERGY) is None


# --- laws alone


def test_law_alone_is_not_blamed_for_its_given_density() -> None:
    alone = replace(OF, moves=False)
    look = put(rho_n=(K, -0.25))
    assert kinds.first(alone, FailureCriteria(), look, None) is None
    stiff = kinds.first(alone, FailureCriteria(hyperbolic=True), look, None)
    assert stiff is not None and stiff.kind == "loss of hyperbolicity"
