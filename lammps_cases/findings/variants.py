"""Variants of the reference's particle model: each replaces one small method and reproduces a finding of the ledger.

A variant is a class to put before `eos_ref.evaluation.array_evaluator.Plain` (``stages``) or
`eos_ref.evaluation.time_step.Simulation` (``stepping``), and tells which scenes it makes a difference to. None of
this is part of the reference.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from eos_ref.evaluation.array_evaluator import Plain
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.parameters import Model
from eos_ref.numbers.columns import Axes, Number, axes, dot
from eos_ref.numbers.elementary import sqrt, where
from eos_ref.numbers.rounded import Decision, Rounded, value
from lammps_cases.comparison.trajectory import Particles
from lammps_cases.findings.neighbour_lists import Listed

# LAMMPS' fields at one step, by the names of `eos_ref.model.quantities`; the first one may hold `lists`, of all steps.
Snapshot = dict[str, Any]
UNDEFINED = np.inf  # bound of what no reference can predict


class ForcePerVolume(Plain):
    """Pair forces lack the volume of the particle that they act on."""

    def collecting_volume(self, rho_i: Number) -> Number:
        """No volume."""
        return 0 * rho_i + 1.0


class WallVelocityLost(Plain):
    """The velocity that a fluid particle sees of a solid lacks the solid's own velocity."""

    def wall_velocity(self, v_solid: Number, v_fluid: Number, ratio: Number) -> Number:
        """Only the extrapolated difference."""
        return (v_solid - v_fluid) * ratio


class HeatAsTemperatureRate(Plain):
    """The heat flow is that of the diffusivity kappa/(rho0 cv), without the volume of the particle heated."""

    def heated_volume(self, rho_i: Number, rho_j: Number) -> Number:
        """No volume."""
        return 0 * rho_i + 1.0

    def conduction(self) -> Number:
        """Thermal diffusivity at the equilibrium density."""
        assert self.model.thermal is not None
        cv_n = self.of_type(p.specific_heat for p in self.model.thermal)
        return super().conduction() / (self.rho0_n * cv_n)


class HeatOverDensity(Plain):
    """The heat flow of a pair is divided by its mean density."""

    def heated_volume(self, rho_i: Number, rho_j: Number) -> Number:
        """Volume over the mean density."""
        return super().heated_volume(rho_i, rho_j) / (0.5 * (rho_i + rho_j))


class TemperatureWithoutMass(Plain):
    """The temperature is that of the energy of the particle, not per unit mass."""

    def specific_energy(self, energy_n: Number) -> Number:
        """The energy as it is stored."""
        return energy_n


class SupportTimesDistance(Plain):
    """The same-type support of scale/cross/type sums W r in place of W."""

    def same_type_support(self, other: Any) -> Number:
        """Sum of W r over neighbours of the same type."""
        return self.total(where(other, 0.0, self.w * self.r))


class NormalOfLastPair(Plain):
    """The normal of scale/cross/type is, for every particle, the direction of one and the same pair.

    ``pair`` holds the indices of the pair; which one it is follows from LAMMPS' order of neighbours.
    """

    pair: tuple[int, int] = (-1, -1)

    def cross_type_normal(self, gradient: Axes) -> Axes:
        """Direction of the pair, in its present place."""
        here = np.flatnonzero((self.i == self.pair[0]) & (self.j == self.pair[1]))
        if not here.size:  # it has left the cutoff: which pair is the last one now is not known
            return [np.full(self.n, np.nan) for _ in self.x]
        p = int(here[0])
        x = [x_p[p : p + 1] for x_p in self.x]
        size = sqrt(dot(x, x))
        same = np.zeros(self.n, int)
        return [(x_a / size)[same] for x_a in x]


class StaleGradient(Plain):
    """Below zmin the gradient is whatever the memory holds: nothing that depends on it can be predicted."""

    def correct(self, rho_n: Number) -> None:
        """Leave the gradients of particles below zmin without a bound."""
        super().correct(rho_n)
        if self.model.corrects_gradients:
            below = self.coordination_n < self.model.fix.zmin
            stale_p = (below.answer | below.open if isinstance(below, Decision) else below)[self.i]
            self.g = [
                Rounded(g_a.value, np.where(stale_p, UNDEFINED, g_a.error)) if isinstance(g_a, Rounded) else g_a
                for g_a in self.g
            ]


class WallsSummedAfterSetup(Simulation):
    """After the set-up of a run solids show their summed density, not the one reconstructed and used for the forces."""

    def setup(self) -> None:
        """Sum once more at the end."""
        super().setup()
        s = self.state
        s.rho_n = where(s.solid_n, self.evaluator.density_sum(), s.rho_n)


@dataclass(frozen=True)
class Variant:
    """A change of the reference, and the scenes that it changes.

    Attributes
    ----------
    applies : whether it makes a difference to a scene
    stages, stepping : class to put before the evaluator's or the simulation's
    fit : sets what only LAMMPS' numbers can tell, from its first snapshot
    undefined : whether it leaves values without a bound
    lists : whether it follows LAMMPS' lists of neighbours, which are read for it alone
    """

    applies: Callable[[Particles], bool]
    stages: type[Plain] | None = None
    stepping: type[Simulation] | None = None
    fit: Callable[[Particles, type[Plain], Snapshot], dict[str, Any] | None] | None = None
    undefined: bool = False
    lists: bool = False


def combined(
    variants: Sequence[Variant], scene: Particles, snapshot: Snapshot
) -> tuple[type[Plain], type[Simulation]] | None:
    """Evaluator and simulation with several variants at once; None if one cannot be fitted to LAMMPS' numbers."""
    stages: type[Plain] = _joined("Stages", (v.stages for v in variants), Plain)
    for variant in variants:
        if variant.fit:
            fitted = variant.fit(scene, stages, snapshot)
            if fitted is None:
                return None
            stages = type("Fitted", (stages,), {**fitted, "__module__": __name__})
    return stages, _joined("Stepping", (v.stepping for v in variants), Simulation)


def _joined(name: str, parts: Iterable[type | None], base: type) -> Any:
    given = dict.fromkeys(part for part in parts if part is not None)
    bases = tuple(part for part in given if not any(part in other.__mro__[1:] for other in given))
    # Named, as a prediction is kept only if the module of its stages is known.
    return type(name, bases, {"__module__": __name__}) if bases else base


# --- which scenes a variant changes


def _unit_volumes(scene: Particles) -> bool:
    mass_n = scene.model.mass[scene.state.type_n - 1]
    return bool(np.all(mass_n == scene.state.rho_n)) and not scene.model.fix.rho_sum


def has_forces(scene: Particles) -> bool:
    """Whether forces show, and particles have, or come to have, volumes other than 1."""
    return scene.steps[-1] > 0 or ("f" in scene.fields and not _unit_volumes(scene))


def has_moving_walls(scene: Particles) -> bool:
    """Whether reconstructed solids move, or may come to move."""
    solid_n = scene.state.solid_n
    free = solid_n & ~_held(scene.model, scene.state.type_n)
    return scene.model.fix.interface_reconstruct and bool(np.any(scene.state.v_nc[solid_n]) or free.any())


def _held(model: Model, type_n: Any) -> Any:
    held_n = np.zeros(len(type_n), bool)
    for force in model.forces:
        if force.style == "setforce" and all(component == 0 for component in force.vector):
            held_n |= force.acts_on(type_n)
    return held_n


def has_heat(scene: Particles) -> bool:
    """Whether heat is conducted."""
    return scene.model.thermal is not None


def scales_across_types(scene: Particles) -> bool:
    """Whether shifting is scaled along the normal between types, with a kernel whose gradient has one direction."""
    shift = scene.model.fix.shift
    return (
        not scene.model.corrects_gradients
        and shift is not None
        and shift.scale_cross_type is not None
        and shift.scale_cross_type[0] != 1
    )


def asks_for_support(scene: Particles) -> bool:
    """Whether shifting needs support by particles of the same type."""
    shift = scene.model.fix.shift
    return shift is not None and shift.scale_cross_type is not None and shift.scale_cross_type[2] > 0


def sums_walls(scene: Particles) -> bool:
    """Whether densities of reconstructed solids are summed as well, and looked at after the set-up."""
    fix = scene.model.fix
    return 0 in scene.steps and fix.rho_sum and fix.interface_reconstruct and bool(scene.state.solid_n.any())


def falls_back(scene: Particles) -> bool:
    """Whether some particle has fewer than zmin neighbours for a reproducing kernel."""
    model = scene.model
    if not model.corrects_gradients:
        return False
    stages = Plain(model, scene.box, scene.state.type_n, scene.state.solid_n)
    stages.move(scene.state.x_nc)
    return bool(np.any(stages.coordination_n < model.fix.zmin))


def keeps_corrected_forces(scene: Particles) -> bool:
    """Whether accelerations without pressure are kept for walls, with a kernel whose pairs have two gradients."""
    return scene.model.corrects_gradients and keeps_forces(scene)


def has_kept_images(scene: Particles) -> bool:
    """Whether accelerations are kept for walls that may have periodic images."""
    return any(scene.box.periodic) and keeps_forces(scene)


def keeps_forces(scene: Particles) -> bool:
    """Whether accelerations are kept from step to step to reconstruct the densities of walls."""
    return scene.model.fix.interface_reconstruct and scene.steps[-1] > 0 and bool(scene.state.solid_n.any())


def shows_layers(scene: Particles) -> bool:
    """Whether the status of particles beside a surface shows."""
    return "status" in scene.fields and scene.model.fix.surface_detection is not None


# --- what LAMMPS' numbers tell


def last_pair(scene: Particles, stages: type[Plain], snapshot: Snapshot) -> dict[str, Any] | None:
    """The pair whose direction LAMMPS took out of the shift of the particle that changed most."""
    if "shift/v" not in snapshot:
        return None
    sim = Simulation(scene.model, scene.box, scene.state, ("shift/v",), stages)
    with np.errstate(invalid="ignore"):
        sim.setup()
    plain = sim.evaluator
    unscaled_nc = value(np.stack(plain.raw_shift(axes(sim.state.v_nc), sim.state.rho_n), axis=1))
    moves_n = np.any(snapshot["shift/v"] != 0, axis=1, keepdims=True)
    change_nc = np.where(moves_n, unscaled_nc - snapshot["shift/v"], 0.0)
    n_c = change_nc[np.argmax((change_nc**2).sum(axis=1))]
    if not plain.i.size:
        return None
    if not n_c.any():  # nothing was taken out of any shift, so that no direction has to be known
        return {}
    x_pc = np.stack(plain.x, axis=1)
    along_p = np.abs(x_pc @ n_c) / np.linalg.norm(x_pc, axis=1)
    p = int(np.argmax(along_p))
    return {"pair": (int(plain.i[p]), int(plain.j[p]))}


def lists_of_neighbours(scene: Particles, stages: type[Plain], snapshot: Snapshot) -> dict[str, Any] | None:
    """LAMMPS' list at every step, if they were read; see `lammps_cases.findings.neighbour_lists`."""
    lists: tuple[Listed, ...] = snapshot.get("lists", ())
    return {"lists": lists} if len(lists) > scene.steps[-1] else None
