"""Detectors: what is wrong with the particles of a run, the worst first, with the atom and the number that show it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from eos_ref import InputError
from eos_ref.eos.table import EOSTable, FloatArray
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.pairs import directed_pairs
from eos_ref.model.parameters import BoolArray, Box, IntArray, Model
from eos_ref.numbers.matrices import cholesky
from lammps_cases.setup import reference_side
from lammps_cases.studies.flows.flow import Start
from lammps_cases.studies.stability.model import FailureCriteria, Kind

VANISHING = 0.01  # of rho0
ON_TOP = 0.01  # spacings: particles nearer than this lie on top of each other


@dataclass(frozen=True)
class Observation:
    """Particles after a step, by id.

    Attributes
    ----------
    x_nc, v_nc : (n, d)
        Positions in any periodic image, velocities.
    rho_n, pressure_n : (n,)
    energy_n : (n,), optional
        Energy of the particle.
    surface_n : (n,), optional
        Class of the field ``surface``: 0 bulk, 1 surface, 2 splash.
    """

    step: int
    x_nc: FloatArray
    v_nc: FloatArray
    rho_n: FloatArray
    pressure_n: FloatArray
    energy_n: FloatArray | None = None
    surface_n: FloatArray | None = None


@dataclass(frozen=True)
class ParticleFailure:
    """A failure in one look: the particle (id) and the number that show it."""

    kind: Kind
    atom: int | None = None
    value: float | None = None


@dataclass(frozen=True)
class Subject:
    """What is looked at: the particles that do not change, and the laws they follow.

    ``eos`` and ``model`` are None where the reference refuses them; what needs them is then not watched. ``moves`` is
    false where a law alone acts on densities that are given.
    """

    id_n: IntArray
    type_n: IntArray
    mass_n: FloatArray
    rho0_n: FloatArray
    solid_n: BoolArray
    spacing: float
    box: Box
    moves: bool
    eos: EOSTable | None
    model: Model | None


def subject(start: Start) -> Subject:
    """Return the particles and laws to observe in a run."""
    scene, atoms = start.case.scene, start.atoms
    of_type = atoms.type_n - 1
    eos: EOSTable | None = None
    model: Model | None = None
    try:
        eos = scene.eos()
        model = reference_side.model(scene, atoms, start.case.where) if scene.interacts else None
    except InputError:
        pass  # an engine that takes it all the same is still watched for the rest
    return Subject(
        atoms.id_n,
        atoms.type_n,
        atoms.mass_n,
        np.array(scene.rho0 or (1.0,) * len(scene.types))[of_type],
        np.array([t.phase == "solid" for t in scene.types])[of_type],
        atoms.spacing,
        reference_side.box(scene, atoms),
        scene.interacts,
        eos,
        model,
    )


def kinetic_energy(mass_n: FloatArray, v_nc: FloatArray) -> float:
    """Return the sum of m v^2/2."""
    with np.errstate(all="ignore"):
        return float(0.5 * np.sum(mass_n[:, None] * np.square(v_nc)))


def first(of: Subject, watch: FailureCriteria, look: Observation, energy: float | None) -> ParticleFailure | None:
    """Return the worst failure of a look, in the order of `KINDS`; None if the particles are sound.

    Parameters
    ----------
    energy : float or None
        Kinetic energy that the scene can supply; None: not known yet, so that its growth is not watched.
    """
    with np.errstate(all="ignore"):
        for detect in DETECTORS:
            failure = detect(of, watch, look, energy)
            if failure is not None:
                return failure
    return None


def _worst(of: Subject, kind: Kind, bad_n: BoolArray, size_n: Any, highest: bool = False) -> ParticleFailure | None:
    """Return the particle among the bad ones whose number is lowest (or highest), the first of equals."""
    if not bad_n.any():
        return None
    at = np.flatnonzero(bad_n)
    k = at[np.argmax(size_n[at]) if highest else np.argmin(size_n[at])]
    return ParticleFailure(kind, int(of.id_n[k]), float(size_n[k]))


def lost(of: Subject, watch: FailureCriteria, look: Observation, energy: float | None) -> ParticleFailure | None:
    """Detect a particle beyond a face of the box that is not periodic; the value is how far."""
    low_c, high_c = np.array(of.box.low_c), np.array(of.box.high_c)
    beyond_nc = np.where(of.box.periodic, 0.0, np.maximum(low_c - look.x_nc, look.x_nc - high_c))
    far_n = beyond_nc.max(axis=1)
    bad_n = (far_n > 0) & np.isfinite(far_n)
    return _worst(of, "lost particles", bad_n, far_n, highest=True) if of.moves else None


def non_finite(of: Subject, watch: FailureCriteria, look: Observation, energy: float | None) -> ParticleFailure | None:
    """Detect a density or pressure that is NaN; a position or velocity that is no finite number. The value is NaN."""
    bad_n: BoolArray = np.isnan(look.rho_n) | np.isnan(look.pressure_n)
    if of.moves:
        # An infinite position or velocity makes NaN in the next sum over pairs.
        bad_n = bad_n | ~np.isfinite(look.x_nc).all(axis=1) | ~np.isfinite(look.v_nc).all(axis=1)
    return _worst(of, "non-finite", bad_n, np.full(len(bad_n), np.nan))


def overflow(of: Subject, watch: FailureCriteria, look: Observation, energy: float | None) -> ParticleFailure | None:
    """Detect an infinite density or pressure."""
    worst_n = np.where(np.isinf(look.rho_n), look.rho_n, look.pressure_n)
    return _worst(of, "overflow", np.isinf(worst_n), worst_n)


def negative_density(
    of: Subject, watch: FailureCriteria, look: Observation, energy: float | None
) -> ParticleFailure | None:
    """Detect a negative density; those that a law alone is given are no failure."""
    return _worst(of, "negative density", look.rho_n < 0, look.rho_n) if of.moves else None


def vanishing_density(
    of: Subject, watch: FailureCriteria, look: Observation, energy: float | None
) -> ParticleFailure | None:
    """Detect a density of at most a hundredth of rho0."""
    return _worst(of, "vanishing density", look.rho_n <= VANISHING * of.rho0_n, look.rho_n) if of.moves else None


def wall_penetration(
    of: Subject, watch: FailureCriteria, look: Observation, energy: float | None
) -> ParticleFailure | None:
    """Detect a fluid particle below the face of a wall; the value is its coordinate."""
    if watch.behind is None:
        return None
    axis, face = watch.behind
    x_n = wrapped(of.box, look.x_nc)[:, axis]
    return _worst(of, "wall penetration", ~of.solid_n & (x_n < face), x_n)


def wrapped(box: Box, x_nc: FloatArray) -> FloatArray:
    """Return the positions moved into the box along its periodic axes."""
    low_c, edge_c = np.array(box.low_c), np.array(box.edge_c)
    with np.errstate(all="ignore"):
        return np.where(box.periodic, x_nc - np.floor((x_nc - low_c) / edge_c) * edge_c, x_nc)


def energy_growth(
    of: Subject, watch: FailureCriteria, look: Observation, energy: float | None
) -> ParticleFailure | None:
    """Detect kinetic energy beyond what the scene can supply; the atom with most of it, the value a ratio."""
    if watch.growth is None or energy is None:
        return None
    now = kinetic_energy(of.mass_n, look.v_nc)
    if now <= watch.growth * energy:
        return None
    own_n = of.mass_n * np.square(look.v_nc).sum(axis=1)
    return ParticleFailure("energy growth", int(of.id_n[np.argmax(own_n)]), now / energy if energy else np.inf)


def too_close(of: Subject, watch: FailureCriteria, look: Observation, energy: float | None) -> ParticleFailure | None:
    """Detect two particles, not both solid, much nearer than they began; the value is distance over spacing."""
    if watch.closest is None:
        return None
    i, j, shift_pc = directed_pairs(look.x_nc, of.box, max(watch.closest, ON_TOP) * of.spacing)
    # Each pair once: both of its particles get the same distance, and the first by id is named.
    once = (i <= j) & ~(of.solid_n[i] & of.solid_n[j])
    i, j, shift_pc = i[once], j[once], shift_pc[once]
    r_p = np.sqrt(np.square(look.x_nc[i] - (look.x_nc[j] + shift_pc)).sum(axis=1)) / of.spacing
    r_n = np.full(len(of.id_n), np.inf)
    for k in (i, j):
        np.minimum.at(r_n, k, r_p)
    return _worst(of, "overlap", r_n < ON_TOP, r_n) or _worst(of, "clumping", r_n < watch.closest, r_n)


def negative_pressure(
    of: Subject, watch: FailureCriteria, look: Observation, energy: float | None
) -> ParticleFailure | None:
    """Detect a negative pressure of the fluid, where a map watches for it."""
    bad_n = (look.pressure_n < 0) & ~of.solid_n
    return _worst(of, "negative pressure", bad_n, look.pressure_n) if watch.pressure else None


def loss_of_hyperbolicity(
    of: Subject, watch: FailureCriteria, look: Observation, energy: float | None
) -> ParticleFailure | None:
    """Detect a fluid particle at a density at which dP/drho is not positive; the value is dP/drho."""
    if not watch.hyperbolic or of.eos is None:
        return None
    if of.eos.needs_energy and look.energy_n is None:
        return None
    e_n = None if look.energy_n is None else look.energy_n / of.mass_n
    stiffness_n = np.full(len(of.id_n), np.inf)
    for t, law in enumerate(of.eos, 1):
        mine = (of.type_n == t) & ~of.solid_n
        stiffness_n[mine] = law.stiffness(look.rho_n[mine], e_n[mine] if law.needs_energy and e_n is not None else None)
    return _worst(of, "loss of hyperbolicity", ~(stiffness_n > 0), stiffness_n)


def bad_matrix(of: Subject, watch: FailureCriteria, look: Observation, energy: float | None) -> ParticleFailure | None:
    r"""Detect a moment matrix without a Cholesky factor, or a badly conditioned one.

    The matrices are those of `eos_ref.evaluation.array_evaluator.ArrayEvaluator.moments` for the positions and
    densities of the look, whichever engine made them. Particles with fewer than zmin neighbours use none. Values: the
    lowest eigenvalue of a matrix that has no factor; the condition number in the 2-norm,
    :math:`\lambda_{max}/\lambda_{min}`.
    """
    if watch.condition is None or of.model is None or of.model.order < 0:
        return None
    m_nbb, definite_n, used_n = moment_matrices(of, look)
    eigenvalue_nb = np.linalg.eigvalsh(m_nbb)
    failed = _worst(of, "failed matrix", used_n & ~definite_n, eigenvalue_nb[:, 0])
    if failed is not None:
        return failed
    condition_n = np.where(eigenvalue_nb[:, 0] > 0, eigenvalue_nb[:, -1] / eigenvalue_nb[:, 0], np.inf)
    bad_n = used_n & ~(condition_n <= watch.condition)
    return _worst(of, "ill-conditioned matrix", bad_n, condition_n, highest=True)


def moment_matrices(of: Subject, look: Observation) -> tuple[FloatArray, BoolArray, BoolArray]:
    """Moment matrices of all particles (n, b, b), which have a Cholesky factor, and which are used (zmin)."""
    assert of.model is not None
    plain = ArrayEvaluator(of.model, of.box, of.type_n, of.solid_n)
    plain.move(look.x_nc)
    _, rows = plain.moments(look.rho_n)
    size = len(rows)
    m_nbb = np.empty((len(of.id_n), size, size))
    for a in range(size):
        for b in range(a + 1):
            m_nbb[:, a, b] = m_nbb[:, b, a] = rows[a][b]
    definite_n: Any = cholesky(rows)[1]
    return m_nbb, definite_n, plain.coordination_n >= of.model.fix.zmin


def misclassified_surface(
    of: Subject, watch: FailureCriteria, look: Observation, energy: float | None
) -> ParticleFailure | None:
    """Detect a particle of another class than expected; the value is the class found. The first by id."""
    if not watch.surface or look.surface_n is None:
        return None
    expected_n = np.array([watch.surface.get(k, -1) for k in of.id_n.tolist()])
    wrong = np.flatnonzero((expected_n >= 0) & (look.surface_n != expected_n))
    if not wrong.size:
        return None
    return ParticleFailure("misclassified surface", int(of.id_n[wrong[0]]), float(look.surface_n[wrong[0]]))


def lost_digits(of: Subject, watch: FailureCriteria, look: Observation, energy: float | None) -> ParticleFailure | None:
    """Detect a pressure with too few correct digits, by the law in ball arithmetic; the value is their number."""
    if watch.digits is None or of.eos is None:
        return None
    from eos_ref.eos import rigorous

    digits_n = np.empty(len(of.id_n))
    e_n = [None] * len(of.id_n) if look.energy_n is None else (look.energy_n / of.mass_n).tolist()
    for k, (rho, e, p) in enumerate(zip(look.rho_n.tolist(), e_n, look.pressure_n.tolist(), strict=True)):
        exact = rigorous.pressure(of.eos[int(of.type_n[k])], rho, e)
        digits_n[k] = -np.log10(rigorous.error(p, exact) / abs(float(exact.mid())))
    return _worst(of, "lost digits", digits_n < watch.digits, digits_n)


Detector = Callable[[Subject, FailureCriteria, Observation, float | None], ParticleFailure | None]
# From the worst on, as in `KINDS`: a later one may trust what an earlier one has found to be sound.
DETECTORS: tuple[Detector, ...] = (
    lost,
    non_finite,
    overflow,
    negative_density,
    vanishing_density,
    wall_penetration,
    energy_growth,
    too_close,
    negative_pressure,
    loss_of_hyperbolicity,
    bad_matrix,
    misclassified_surface,
    lost_digits,
)
