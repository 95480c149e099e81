"""Findings about solids: their velocity and their densities as the fluid sees them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.box import BoolArray
from eos_ref.model.parameters import Model
from eos_ref.model.state import PairTerms
from eos_ref.numbers.columns import axes, dot
from eos_ref.numbers.elementary import where
from eos_ref.numbers.number import Array
from eos_ref.numbers.rounded import value
from lammps_cases.comparison.problem import Problem
from lammps_cases.findings.document import document
from lammps_cases.findings.entry import AlarmDifference, Gap, ModelFinding
from lammps_cases.findings.neighbour_lists import CountingSteps, FollowingLists, lists_of_neighbours
from lammps_cases.findings.variants import Variant


class WallVelocityLost(ArrayEvaluator):
    """The velocity that a fluid particle sees of a solid lacks the solid's own velocity."""

    def wall_velocity(self, v_solid: Array, v_fluid: Array, ratio: Array) -> Array:
        """Only the extrapolated difference."""
        return (v_solid - v_fluid) * ratio


def walls(problem: Problem) -> BoolArray:
    """Return which particles are reconstructed solids, or may freeze to one, (n,)."""
    model, state = problem.model, problem.state
    freezes_t = [properties.T_freeze is not None for properties in model.thermal or ()]
    wall_n = state.solid_n | (np.array(freezes_t)[state.type_n - 1] if any(freezes_t) else False)
    return wall_n & model.fix.interface_reconstruct


def has_moving_walls(problem: Problem) -> bool:
    """Return whether reconstructed solids move, or may come to move."""
    wall_n = walls(problem)
    free = wall_n & ~_held(problem.model, problem.state.type_n)
    return bool(np.any(problem.state.v_nc[wall_n]) or free.any())


def _held(model: Model, type_n: Any) -> Any:
    """Return which particles are left without any force, (n,); what is added after it was set to 0 moves them."""
    held_n = np.zeros(len(type_n), bool)
    for force in model.forces:
        if force.style == "setforce" and all(component == 0 for component in force.vector):
            held_n |= force.acts_on(type_n)
        elif any(force.vector):
            held_n &= ~force.acts_on(type_n)
    return held_n


class WallsSummedAfterSetup(Simulation):
    """After the set-up of a run solids show their summed density, not the one reconstructed and used for the forces."""

    def setup(self) -> None:
        """Sum once more at the end, if densities are asked for."""
        super().setup()
        s = self.state
        if "rho" in self.plan:
            s.rho_n = where(s.solid_n, self.evaluator.density_sum(), s.rho_n)


def sums_walls(problem: Problem) -> bool:
    """Return whether densities of reconstructed solids are summed as well, and looked at after the set-up."""
    begins = {0, *(stop.step for stop in problem.stops if not stop.continued)}
    looked_at = not begins.isdisjoint(problem.steps)
    return looked_at and problem.model.fix.rho_sum and bool(walls(problem).any())


class AccelerationsOfOldImages(FollowingLists):
    """Right after lists were rebuilt, slots hold the accelerations of what was in them before, further slots 0."""

    def wall_sums(self, pressure_n: Array, rho_n: Array, acceleration_nc: Array) -> tuple[Array, ...]:
        """Return the sums, to the last of which other accelerations than the particles' own add."""
        *sums, sum_n = super().wall_sums(pressure_n, rho_n, acceleration_nc)
        if not self.kept_sc.size:  # the set-up: nothing is kept yet
            return *sums, sum_n
        i, j = self.i, self.j
        present = [a_n[j] - a_n[i] for a_n in axes(acceleration_nc)]
        wall_p = self.solid_n[i] & ~self.solid_n[j]
        with self.images_added():
            read = axes(self._read())
            stale_p = wall_p & np.logical_or.reduce([value(a) != b for a, b in zip(present, read, strict=True)])
            change = [where(stale_p, b - a, 0.0) for a, b in zip(present, read, strict=True)]
            return *sums, sum_n + self.total(where(stale_p, self.w * rho_n[j] * dot(change, self.x), 0.0))

    def _read(self) -> FloatArray:
        """Acceleration in the slot of j less that in the slot of i, for every pair; NaN for pairs not in the list.

        Of a pair that counts twice, as each of its particles meets an image of the other: the mean.
        """
        listed = self.lists[self.at]
        new_sc = np.zeros((len(listed.row_s), self.model.dimension))[len(self.kept_sc) :]
        held_sc = np.concatenate([self.kept_sc, new_sc])
        one, other = listed.pair_ps.T
        difference_pc = np.vstack([held_sc[other] - held_sc[one], np.full((1, self.model.dimension), np.nan)])
        under_i, under_j = difference_pc[self.forward_p], -difference_pc[self.backward_p]
        read_pc = np.where(self.forward_p[:, None] >= 0, under_i, under_j)
        return np.where(self.twice_p()[:, None], (under_i + under_j) / 2, read_pc)


def has_kept_images(problem: Problem) -> bool:
    """Return whether accelerations are kept for walls that may have images."""
    return problem.has_images and keeps_forces(problem)


class GradientOfSecond(FollowingLists):
    """The pressure that is taken out of accelerations has, for both of a pair, the gradient of the second one.

    Without newton a pair across a boundary is listed twice, once for each particle, which then has its own gradient.
    One that counts twice has it once, as the second of the entry under the other particle.
    """

    def pair_terms(self, *fields: Any, **options: Any) -> PairTerms:
        """Return all terms as they are, and the pressure force kept from exchanged gradients."""
        terms, own = super().pair_terms(*fields, **options), self.g
        twice_p, known_p = self.twice_p(), self.reverse_p >= 0
        exchanged_p = (self.forward_p >= 0) & (self.backward_p < 0) & known_p
        self.g, self.exchanged = [], True
        for own_a in own:
            other_a = -own_a[self.reverse_p]
            self.g.append(where(twice_p & known_p, 0.5 * (own_a + other_a), where(exchanged_p, other_a, own_a)))
        kept = super().pair_terms(*fields, **options)
        self.g, self.exchanged = own, False
        return replace(terms, pressure_force_nc=kept.pressure_force_nc)


def keeps_corrected_forces(problem: Problem) -> bool:
    """Return whether accelerations without pressure are kept for walls, by a kernel whose pairs have two gradients."""
    return problem.model.corrects_gradients and keeps_forces(problem)


def keeps_forces(problem: Problem) -> bool:
    """Return whether accelerations are kept from step to step to reconstruct the densities of walls."""
    return problem.steps[-1] > 0 and bool(walls(problem).any())


WALL_VELOCITY_LOST = ModelFinding(
    **document("wall-velocity-lost"),
    gaps=(
        Gap(
            lambda scene: scene.rheo.interface_reconstruct and scene.remaps_velocities,
            "since forces depend on the frame of reference, those across a boundary whose periodic images move (fix "
            "deform, remap v) belong to the frame of the particle that is first in LAMMPS' list",
        ),
    ),
    variant=Variant(has_moving_walls, WallVelocityLost, changes=("grad/v", "f")),
    acts=lambda setting: has_moving_walls(setting.problem),
)


WALLS_SUMMED_AFTER_SETUP = ModelFinding(
    **document("walls-summed-after-setup"),
    gaps=(
        Gap(
            lambda scene: not scene.whole_model and scene.rho_sum and scene.rheo.interface_reconstruct,
            "for an equation of state alone, the density that is reported is compared, not the one that was used",
        ),
    ),
    variant=Variant(sums_walls, stepping=WallsSummedAfterSetup, changes=("rho",)),
    acts=lambda setting: sums_walls(setting.problem),
)


WALLS_AFTER_REBUILD = ModelFinding(
    **document("walls-after-rebuild"),
    variant=Variant(
        has_kept_images,
        AccelerationsOfOldImages,
        CountingSteps,
        lists_of_neighbours,
        lists=True,
        changes=("rho_wall",),
    ),
    acts=lambda setting: has_kept_images(setting.problem),
    expected_in_alarms=(
        AlarmDifference(
            ("rebuilt",),
            lambda problem: problem.rheo.interface_reconstruct,
            "the first wrong step is the first in which the list of periodic images changes, and the densities of "
            "solids are wrong in it; scenes whose periodic images stay the same are right",
        ),
    ),
)


WALLS_DEPEND_ON_PAIR_ORDER = ModelFinding(
    **document("walls-depend-on-pair-order"),
    variant=Variant(
        keeps_corrected_forces,
        GradientOfSecond,
        CountingSteps,
        lists_of_neighbours,
        lists=True,
        changes=("rho_wall",),
    ),
    acts=lambda setting: keeps_corrected_forces(setting.problem),
)

ENTRIES = (WALL_VELOCITY_LOST, WALLS_SUMMED_AFTER_SETUP, WALLS_AFTER_REBUILD, WALLS_DEPEND_ON_PAIR_ORDER)
