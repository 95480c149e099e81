"""Detectors of failures of the particles of a run, the worst first, with the atom and the number that show them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from eos_ref import InputError
from eos_ref.eos.table import EOSTable, FloatArray
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.pairs import directed_pairs
from eos_ref.model.box import BoolArray, Box
from eos_ref.model.parameters import IntArray, Model
from eos_ref.numbers.matrices import cholesky
from eos_ref.numbers.rounded import value
from lammps_cases.setup import reference_side
from lammps_cases.studies.flows.flow import Snapshot, Start
from lammps_cases.studies.stability.model import FailureCriteria, Kind

VANISHING = 0.01  # of rho0
ON_TOP = 0.01  # spacings: nearer particles lie on top of each other


@dataclass(frozen=True)
class ParticleFailure:
    """A failure in one observation: the particle (id) and the number that show it."""

    kind: Kind
    atom: int | None = None
    value: float | None = None


@dataclass(frozen=True)
class Subject:
    """Properties of the particles that do not change in a run, and the laws that they follow.

    ``eos`` and ``model`` are None where the reference refuses them; what needs them is then not watched. ``moves`` is
    false where a law alone acts on given densities.
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
        pass  # an engine that accepts it anyway is still watched for the rest
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


def wrapped(box: Box, x_nc: FloatArray) -> FloatArray:
    """Return the positions moved into the box along its periodic axes, shape (n, d)."""
    with np.errstate(all="ignore"):
        return x_nc - box.shift(box.images(x_nc))


def moment_matrices(evaluator: ArrayEvaluator, rho_n: FloatArray) -> tuple[FloatArray, BoolArray, BoolArray]:
    """Return the moment matrices of all particles (n, b, b), which have a Cholesky factor, and which are used (zmin).

    Positions are those of the evaluator, densities are given, from either engine.
    """
    _, rows = evaluator.moments(rho_n)
    size = len(rows)
    m_nbb = np.empty((len(rho_n), size, size))
    for a in range(size):
        for b in range(a + 1):
            m_nbb[:, a, b] = m_nbb[:, b, a] = value(rows[a][b])
    definite_n: BoolArray = cholesky(rows)[1]
    return m_nbb, definite_n, value(evaluator.coordination_n) >= evaluator.model.fix.zmin


def first(of: Subject, watch: FailureCriteria, look: Snapshot, energy: float | None) -> ParticleFailure | None:
    """Return the worst failure in an observation, in the order of `KINDS`; None if the particles are sound.

    Parameters
    ----------
    energy : float or None
        Kinetic energy that the scene can supply; None: not known yet, so that its growth is not watched.
    """
    found = FailureDetectors(of, watch, look, energy)
    # From the worst on, as in `KINDS`: a detector may rely on the earlier ones.
    detectors = (
        found.lost,
        found.non_finite,
        found.overflow,
        found.negative_density,
        found.vanishing_density,
        found.wall_penetration,
        found.energy_growth,
        found.too_close,
        found.negative_pressure,
        found.loss_of_hyperbolicity,
        found.bad_matrix,
        found.misclassified_surface,
        found.lost_digits,
    )
    with np.errstate(all="ignore"):
        return next((failure for detect in detectors if (failure := detect()) is not None), None)


@dataclass(frozen=True)
class FailureDetectors:
    """Detectors of failures in one observation; each returns the worst particle, or None."""

    of: Subject
    watch: FailureCriteria
    look: Snapshot
    energy: float | None

    def _worst(self, kind: Kind, bad_n: BoolArray, size_n: Any, highest: bool = False) -> ParticleFailure | None:
        """Return the particle among the bad ones whose number is lowest (or highest), the first of equals."""
        if not bad_n.any():
            return None
        at = np.flatnonzero(bad_n)
        k = at[np.argmax(size_n[at]) if highest else np.argmin(size_n[at])]
        return ParticleFailure(kind, int(self.of.id_n[k]), float(size_n[k]))

    def lost(self) -> ParticleFailure | None:
        """Detect a particle beyond a face of the box that is not periodic; the value is how far."""
        box, x_nc = self.of.box, self.look.x_nc
        beyond_nc = np.where(box.periodic, 0.0, np.maximum(np.array(box.low_c) - x_nc, x_nc - np.array(box.high_c)))
        far_n = beyond_nc.max(axis=1)
        bad_n = (far_n > 0) & np.isfinite(far_n)
        return self._worst("lost particles", bad_n, far_n, highest=True) if self.of.moves else None

    def non_finite(self) -> ParticleFailure | None:
        """Detect a density or pressure that is NaN, a position or velocity that is not finite. The value is NaN."""
        look = self.look
        bad_n: BoolArray = np.isnan(look.rho_n) | np.isnan(look.pressure_n)
        if self.of.moves:
            # An infinite position or velocity makes NaN in the next sum over pairs.
            bad_n = bad_n | ~np.isfinite(look.x_nc).all(axis=1) | ~np.isfinite(look.v_nc).all(axis=1)
        return self._worst("non-finite", bad_n, np.full(len(bad_n), np.nan))

    def overflow(self) -> ParticleFailure | None:
        """Detect an infinite density or pressure."""
        worst_n = np.where(np.isinf(self.look.rho_n), self.look.rho_n, self.look.pressure_n)
        return self._worst("overflow", np.isinf(worst_n), worst_n)

    def negative_density(self) -> ParticleFailure | None:
        """Detect a negative density; for a law alone it is not a failure."""
        rho_n = self.look.rho_n
        return self._worst("negative density", rho_n < 0, rho_n) if self.of.moves else None

    def vanishing_density(self) -> ParticleFailure | None:
        """Detect a density of at most a hundredth of rho0."""
        rho_n = self.look.rho_n
        return self._worst("vanishing density", rho_n <= VANISHING * self.of.rho0_n, rho_n) if self.of.moves else None

    def wall_penetration(self) -> ParticleFailure | None:
        """Detect a fluid particle below the face of a wall; the value is its coordinate."""
        if self.watch.behind is None:
            return None
        axis, face = self.watch.behind
        x_n = wrapped(self.of.box, self.look.x_nc)[:, axis]
        return self._worst("wall penetration", ~self.of.solid_n & (x_n < face), x_n)

    def energy_growth(self) -> ParticleFailure | None:
        """Detect kinetic energy beyond what the scene can supply; the atom with most of it, the value a ratio."""
        of, v_nc, supplied = self.of, self.look.v_nc, self.energy
        if self.watch.growth is None or supplied is None:
            return None
        energy = kinetic_energy(of.mass_n, v_nc)
        if energy <= self.watch.growth * supplied:
            return None
        own_n = of.mass_n * np.square(v_nc).sum(axis=1)
        return ParticleFailure(
            "energy growth", int(of.id_n[np.argmax(own_n)]), energy / supplied if supplied else np.inf
        )

    def too_close(self) -> ParticleFailure | None:
        """Detect two particles, not both solid, much nearer than at the start; the value is distance over spacing."""
        of, x_nc, closest = self.of, self.look.x_nc, self.watch.closest
        if closest is None:
            return None
        i, j, shift_pc = directed_pairs(x_nc, of.box, max(closest, ON_TOP) * of.spacing)
        # Each pair once: both of its particles get the same distance, and the lower id is named.
        once = (i <= j) & ~(of.solid_n[i] & of.solid_n[j])
        i, j, shift_pc = i[once], j[once], shift_pc[once]
        r_p = np.sqrt(np.square(x_nc[i] - (x_nc[j] + shift_pc)).sum(axis=1)) / of.spacing
        r_n = np.full(len(of.id_n), np.inf)
        for k in (i, j):
            np.minimum.at(r_n, k, r_p)
        return self._worst("overlap", r_n < ON_TOP, r_n) or self._worst("clumping", r_n < closest, r_n)

    def negative_pressure(self) -> ParticleFailure | None:
        """Detect a negative pressure of the fluid, where a map watches for it."""
        pressure_n = self.look.pressure_n
        bad_n = (pressure_n < 0) & ~self.of.solid_n
        return self._worst("negative pressure", bad_n, pressure_n) if self.watch.pressure else None

    def loss_of_hyperbolicity(self) -> ParticleFailure | None:
        """Detect a fluid particle at a density at which dP/drho is not positive; the value is dP/drho."""
        of, rho_n, energy_n = self.of, self.look.rho_n, self.look.energy_n
        if not self.watch.hyperbolic or of.eos is None or (of.eos.needs_energy and energy_n is None):
            return None
        stiffness_n = np.full(len(of.id_n), np.inf)
        for t, law in enumerate(of.eos, 1):
            own_n = (of.type_n == t) & ~of.solid_n
            e_n = (energy_n / of.mass_n)[own_n] if law.needs_energy and energy_n is not None else None
            stiffness_n[own_n] = law.stiffness(rho_n[own_n], e_n)
        return self._worst("loss of hyperbolicity", ~(stiffness_n > 0), stiffness_n)

    def bad_matrix(self) -> ParticleFailure | None:
        r"""Detect a moment matrix without a Cholesky factor, or a badly conditioned one.

        Particles with fewer than zmin neighbours use none. Values: the lowest eigenvalue of a matrix that has no
        factor; the condition number in the 2-norm, :math:`\lambda_{max}/\lambda_{min}`.
        """
        of, model, look = self.of, self.of.model, self.look
        if self.watch.condition is None or model is None or model.order < 0:
            return None
        evaluator = ArrayEvaluator(model, of.box, of.type_n, of.solid_n)
        evaluator.move(look.x_nc)
        m_nbb, definite_n, used_n = moment_matrices(evaluator, look.rho_n)
        eigenvalue_nb = np.linalg.eigvalsh(m_nbb)
        failure = self._worst("failed matrix", used_n & ~definite_n, eigenvalue_nb[:, 0])
        if failure is not None:
            return failure
        condition_n = np.where(eigenvalue_nb[:, 0] > 0, eigenvalue_nb[:, -1] / eigenvalue_nb[:, 0], np.inf)
        bad_n = used_n & ~(condition_n <= self.watch.condition)
        return self._worst("ill-conditioned matrix", bad_n, condition_n, highest=True)

    def misclassified_surface(self) -> ParticleFailure | None:
        """Detect a particle of another class than expected; the value is its class. The first by id."""
        surface_n, id_n = self.look.surface_n, self.of.id_n
        if not self.watch.surface or surface_n is None:
            return None
        expected_n = np.array([self.watch.surface.get(k, -1) for k in id_n.tolist()])
        wrong = np.flatnonzero((expected_n >= 0) & (surface_n != expected_n))
        if not wrong.size:
            return None
        return ParticleFailure("misclassified surface", int(id_n[wrong[0]]), float(surface_n[wrong[0]]))

    def lost_digits(self) -> ParticleFailure | None:
        """Detect a pressure with too few correct digits, by the law in ball arithmetic; the value is their number."""
        of, look = self.of, self.look
        if self.watch.digits is None or of.eos is None:
            return None
        from eos_ref.eos import rigorous

        digits_n = np.empty(len(of.id_n))
        e_n = [None] * len(of.id_n) if look.energy_n is None else (look.energy_n / of.mass_n).tolist()
        for k, (rho, e, p) in enumerate(zip(look.rho_n.tolist(), e_n, look.pressure_n.tolist(), strict=True)):
            exact = rigorous.pressure(of.eos[int(of.type_n[k])], rho, e)
            digits_n[k] = -np.log10(rigorous.error(p, exact) / abs(float(exact.mid())))
        return self._worst("lost digits", digits_n < self.watch.digits, digits_n)
