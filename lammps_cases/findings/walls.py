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
from lammps_cases.findings.entry import AlarmDifference, Finding, Gap
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


WALL_VELOCITY_LOST = Finding(
    id="wall-velocity-lost",
    number=18,
    title="interface/reconstruct ignores the velocity of a moving wall",
    severity="high",
    effect="Fluid next to a moving wall sees a wrong velocity at any resolution: Couette flow is off by half",
    documented="fix rheo, interface/reconstruct: densities and velocities of solids are reconstructed to ensure "
    "no-slip boundaries; Takeda et al. 1994, Morris et al. 1997: v_s' = v_s + (v_s - v_f) d_s/d_f.",
    observed="The solid's velocity as seen by the fluid is (v_s - v_f) d_s/d_f: the term v_s is missing. The two "
    "agree only for a wall at rest.",
    argument="A fluid and its container that move together at velocity U must feel no viscous force; in LAMMPS the "
    "fluid sees the wall at 0 instead of U, so the forces depend on the frame of reference. A wall moving at U drags "
    "a fluid particle towards U d_s/(d_s + d_f), not U: one row of fluid over one row of solids towards 0.5 U, over "
    "two rows 0.6 U, and several rows of fluid towards 0.4 U and 0.5 U (spacing 1, cutoff 1.3), so a Couette flow "
    "depends on the arrangement of the particles.",
    workaround="Keep walls at rest: use the frame of the wall, or drive the fluid with addforce.",
    scene="fluid at rest over one moving row of solid particles",
    gaps=(
        Gap(
            lambda scene: scene.rheo.interface_reconstruct and scene.remaps_velocities,
            "since forces depend on the frame of reference, those across a boundary whose periodic images move (fix "
            "deform, remap v) belong to the frame of the particle that is first in LAMMPS' list",
        ),
    ),
    model_variant=Variant(has_moving_walls, WallVelocityLost, changes=("grad/v", "f")),
    acts=lambda setting: has_moving_walls(setting.problem),
)


WALLS_SUMMED_AFTER_SETUP = Finding(
    id="walls-summed-after-setup",
    number=24,
    title="After the set-up of a run, solids report a density that was not used",
    severity="low",
    effect="Densities of solids in the output of step 0 are not those used for the forces",
    documented="fix rheo, interface/reconstruct: the density of solids is reconstructed for the interaction with "
    "fluid; rho/sum sums densities.",
    observed="With both keywords the densities of solids reported after run 0 are the sums; the forces of the same "
    "step used the reconstructed ones, which every later step of the run reports. Each run without 'pre no' begins "
    "this way.",
    argument="Output and forces of one step belong to different densities: forces computed from the densities "
    "reported after run 0 differ from those of LAMMPS.",
    workaround="Look at solids after a step, not after run 0.",
    scene="fluid over solid particles with rho/sum, run 0",
    gaps=(
        Gap(
            lambda scene: not scene.whole_model and scene.rho_sum and scene.rheo.interface_reconstruct,
            "for an equation of state alone, the density that is reported is compared, not the one that was used",
        ),
    ),
    model_variant=Variant(sums_walls, stepping=WallsSummedAfterSetup, changes=("rho",)),
    acts=lambda setting: sums_walls(setting.problem),
)


WALLS_AFTER_REBUILD = Finding(
    id="walls-after-rebuild",
    number=25,
    title="Densities of walls are wrong in single steps after neighbour lists are rebuilt",
    severity="high",
    effect="Densities and forces of walls next to a periodic boundary jump in single steps",
    documented="fix rheo, interface/reconstruct: densities of solids follow from the fluid's (Adami et al. "
    "2012), whatever the neighbour lists; neigh_modify: settings of the lists must not change the physics.",
    observed="In a step in which atoms enter or leave the layer of periodic images, the extrapolation to solids "
    "reads accelerations from the slots of periodic images as numbered by the new list, while these slots still hold "
    "what the old list had in them: accelerations of other particles. Densities of solids that see fluid through a "
    "periodic boundary are wrong in that step, by 0.2 % in the scene open.walls-after-rebuild, and so are the "
    "forces; before the next step the slots are filled again, so only the trajectory keeps the error.",
    argument="The same run with other rebuild settings has another trajectory. With the accelerations taken from "
    "LAMMPS' own slots, as of the previous list and 0 in slots that it did not have, every density of the scene is "
    "reproduced to rounding, over 60 steps with a rebuild in each and different periodic images from step 6 on. "
    "Rebuilding lists with the same images in the same order, as before step 6, does no harm.",
    workaround="Rebuild lists only when necessary ('neigh_modify check yes', the default), and rarely, by using a "
    "large skin.",
    scene="fluid over fixed solids under gravity, periodic along the wall, lists rebuilt every step",
    model_variant=Variant(
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


WALLS_DEPEND_ON_PAIR_ORDER = Finding(
    id="walls-depend-on-pair-order",
    number=27,
    title="With RK1 and RK2, densities of walls depend on the order in which pairs are listed",
    severity="medium",
    effect="Runs that list the same pairs in a different order have different densities of walls",
    documented="fix rheo, interface/reconstruct: densities of solids follow from pressure and acceleration of the "
    "fluid (Adami et al. 2012), where the acceleration excludes that due to pressure.",
    observed="The pressure force that is subtracted from the acceleration is, for the first particle of every pair "
    "in the list, minus that of the second, computed with the second particle's gradient; with the quintic kernel "
    "the two are the same. With newton off, pairs across a boundary are listed for each particle, which then uses "
    "its own gradient, as all particles do from 2025.7.22.2.0 on.",
    argument="With the same four particles numbered in a different order, the solid has a different density from "
    "step 1 on: physics must not depend on which particle of a pair is listed first. With the order taken from "
    "LAMMPS' own lists, every density is reproduced to rounding.",
    workaround="Use the quintic kernel, or 2025.7.22.2.0 or newer.",
    scene="one solid and three fluid particles, RK1",
    model_variant=Variant(
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
