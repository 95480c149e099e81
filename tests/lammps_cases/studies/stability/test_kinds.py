"""Every kind of failure is detected in particles made for it, and none in sound ones."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lammps_cases.studies.flows.flow import Snapshot
from lammps_cases.studies.stability import kinds
from lammps_cases.studies.stability.kinds import ParticleFailure
from lammps_cases.studies.stability.model import KINDS, FailureCriteria, Kind
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
GROWN = rounded(
    (12.5 + 0.01 * (N - 1)) / (0.01 * N), 2 * (2 * N + 2) + 5
)  # two sums of 2 N squares, and this expression
# Kind, value, and the array of the fluid particle K that shows it; from the worst on.
PLANTED: list[tuple[Kind, Any, str, Any]] = [
    ("lost particles", 0.25, "x_nc", (3.0, 13.25)),
    ("non-finite", NAN, "rho_n", np.nan),
    ("non-finite", NAN, "pressure_n", np.nan),
    ("non-finite", NAN, "v_nc", (0.0, np.inf)),
    ("non-finite", NAN, "x_nc", (np.nan, 1.0)),
    ("overflow", np.inf, "pressure_n", np.inf),
    ("overflow", -np.inf, "rho_n", -np.inf),
    ("negative density", -0.25, "rho_n", -0.25),
    ("vanishing density", 0.01, "rho_n", 0.01),
    ("wall penetration", 1.65, "x_nc", (3.0, 1.65)),
    ("energy growth", GROWN, "v_nc", (3.0, 4.0)),
    ("overlap", apart(0.001), "x_nc", X[K + 1] - (0.001, 0.0)),
    ("clumping", apart(0.375), "x_nc", X[K + 1] - (0.375, 0.0)),
    ("negative pressure", -0.125, "pressure_n", -0.125),
    ("loss of hyperbolicity", -0.6875, "rho_n", 1.75),
    ("misclassified surface", 2.0, "surface_n", 2.0),
]


@pytest.mark.parametrize(("kind", "value", "array", "planted"), PLANTED)
def test_each_kind_is_detected_if_it_is_watched(kind: Kind, value: Any, array: str, planted: Any) -> None:
    k = 9 if kind == "misclassified surface" else K
    look = put(**{array: (k, planted)})
    assert seen(look) == ParticleFailure(kind, k + 1, value)
    always = KINDS.index(kind) >= KINDS.index("vanishing density")
    assert (seen(look, FailureCriteria()) is not None) == always
    if kind == "energy growth":
        assert seen(look, energy=None) is None


def test_detectors_are_in_the_order_of_the_kinds() -> None:
    """The worst kind comes first, whichever particle shows it."""
    order = [KINDS.index(kind) for kind, *_ in PLANTED]
    assert order == sorted(order, reverse=True)
    look = replace(put(rho_n=(K, -1.0)), pressure_n=put(pressure_n=(K + 2, np.nan)).pressure_n)
    found = seen(look)
    assert found is not None and (found.kind, found.atom) == ("non-finite", K + 3)


def test_solids_may_lie_behind_a_wall_and_close_together() -> None:
    assert X[WALL, 1] < 1.7
    assert seen(put(x_nc=(WALL, X[WALL + 1] - (0.2, 0.0)))) is None


def test_clumping_is_detected_across_a_periodic_face_and_penetration_in_any_image() -> None:
    first = int(FLUID[np.argmin(np.where(np.abs(X[FLUID, 1] - 4.5) < 0.3, X[FLUID, 0], np.inf))])
    look = put(x_nc=(first + 3, (X[first, 0] - 0.25 + 8.0, X[first, 1])))
    assert seen(look) == ParticleFailure("clumping", first + 1, rounded(0.25, 4, terms=8.0))
    of = replace(OF, box=replace(OF.box, periodic=(True, True)))
    found = kinds.first(of, FailureCriteria(behind=WATCH.behind), put(x_nc=(K, (3.0, 1.65 - 14.0))), None)
    assert found == ParticleFailure("wall penetration", K + 1, rounded(1.65, 2, terms=14.0))


def test_extreme_particle_is_reported_the_first_of_equals() -> None:
    look = put(rho_n=(K, -1.0))
    look.rho_n[K + 5] = look.rho_n[K + 6] = -2.0
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
