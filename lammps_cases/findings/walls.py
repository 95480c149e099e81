"""Findings about solids: their velocity and densities as seen by the fluid, in steps and at the start of runs."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from eos_ref.kernels.styles import KERNELS
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
from lammps_cases.findings.neighbour_lists import CountingSteps, FollowingLists, after_deletion, lists_of_neighbours
from lammps_cases.findings.variants import Variant

if TYPE_CHECKING:
    from lammps_cases.scene import Scene


class WallVelocityLost(ArrayEvaluator):
    """The velocity of a solid as seen by a fluid particle lacks the solid's own velocity."""

    def wall_velocity(self, v_solid: Array, v_fluid: Array, ratio: Array) -> Array:
        """Return only the extrapolated difference."""
        return (v_solid - v_fluid) * ratio


def walls(problem: Problem) -> BoolArray:
    """Return which particles are reconstructed solids, or may become one by freezing, (n,)."""
    model, state = problem.model, problem.state
    freezes_t = [properties.T_freeze is not None for properties in model.thermal or ()]
    wall_n = state.solid_n | (np.array(freezes_t)[state.type_n - 1] if any(freezes_t) else False)
    return wall_n & model.fix.interface_reconstruct


def has_moving_walls(problem: Problem) -> bool:
    """Return whether reconstructed solids move, or may start to move."""
    wall_n = walls(problem)
    free = wall_n & ~_held(problem.model, problem.state.type_n)
    return bool(np.any(problem.state.v_nc[wall_n]) or free.any())


def _held(model: Model, type_n: Any) -> Any:
    """Return which particles have no force, (n,); forces added after it was set to 0 move them."""
    held_n = np.zeros(len(type_n), bool)
    for force in model.forces:
        if force.style == "setforce" and all(component == 0 for component in force.vector):
            held_n |= force.acts_on(type_n)
        elif any(force.vector):
            held_n &= ~force.acts_on(type_n)
    return held_n


class WallsSummedAfterSetup(Simulation):
    """After the set-up of a run solids show their summed density, not the reconstructed one used for the forces."""

    def setup(self) -> None:
        """Sum again at the end, if densities are requested."""
        super().setup()
        s = self.state
        if "rho" in self.plan:
            s.rho_n = where(s.solid_n, self.evaluator.density_sum(), s.rho_n)


def sums_walls(problem: Problem) -> bool:
    """Return whether densities of reconstructed solids are also summed, and compared after the set-up."""
    begins = {0, *(stop.step for stop in problem.stops if not stop.continued)}
    looked_at = not begins.isdisjoint(problem.steps)
    return looked_at and problem.model.fix.rho_sum and bool(walls(problem).any())


class AccelerationsOfOldImages(FollowingLists):
    """Right after lists were rebuilt, slots hold the accelerations of their previous content, further slots 0."""

    def wall_sums(self, pressure_n: Array, rho_n: Array, acceleration_nc: Array) -> tuple[Array, ...]:
        """Return the sums; accelerations other than the particles' own add to the last one."""
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
        """Return the acceleration in the slot of j minus that in the slot of i, for every pair; NaN if not in the list.

        For a pair that counts twice, as each of its particles meets an image of the other, it is the mean.
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
    """The pressure force subtracted from accelerations uses, for both particles of a pair, the second one's gradient.

    Without newton a pair across a boundary is listed twice, once for each particle, which then has its own gradient.
    A pair that counts twice has it once, as the second of the entry under the other particle.
    """

    def pair_terms(self, *fields: Any, **options: Any) -> PairTerms:
        """Return all terms unchanged, and the kept pressure force from exchanged gradients."""
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


class PressureForceKept(Simulation):
    """A run that is not the first begins with the pressure forces of the evaluation before, taken for accelerations.

    A minimisation evaluates them with its final positions and densities, and with the pressures of the evaluation
    before, except those of solids, which follow from its final energies.
    """

    used_n: Array

    def force_pressure(self) -> Array:
        """Return the pressure that forces use, and keep it."""
        self.used_n = super().force_pressure()
        return self.used_n

    def minimize(self) -> None:
        """Keep the pressure forces of the minimisation, which has the images of its positions."""
        super().minimize()
        if self.model.deform:  # else particles are still at the positions of the evaluation
            assert isinstance(self.evaluator, ArrayEvaluator)
            ArrayEvaluator.follow(self.evaluator, self.state.x_nc)
        pressure_n = where(self.evaluator.solid_n, super().force_pressure(), self.used_n)
        self.pressure_force_nc = self.evaluator.pair_terms(self.pair_input(pressure_n)).pressure_force_nc

    def kept_at_stop(self, new_n: BoolArray) -> Array:
        """Return the pressure force on every particle that is not new."""
        assert self.pressure_force_nc is not None
        return where(new_n[:, None], 0.0, self.pressure_force_nc)


def begins_again_with_walls(problem: Problem) -> bool:
    """Return whether a run with reconstructed walls ends and another begins, with the same fixes."""
    kept = any(stop.step <= problem.steps[-1] and not stop.new_n.all() for stop in problem.stops)
    return kept and bool(walls(problem).any())


def minimises_beside_walls(scene: Scene) -> bool:
    """Return whether a minimisation may keep other forces for walls: it corrects the kernel, or slots hold images."""
    stops = scene.evolve.stops if scene.evolve else ()
    if not (scene.rheo.interface_reconstruct and any(stop.by == "minimize" for stop in stops)):
        return False
    periodic = getattr(scene.positions, "periodic", None)  # None: all axes; unknown for files
    has_images = periodic is None or any(periodic) or scene.engine.ranks > 1
    return has_images or KERNELS[scene.rheo.kernel].corrects_gradients


class PartsInSlots(AccelerationsOfOldImages):
    """When a run begins, slots of images hold the pressure forces of the pairs that list them second, not the sums.

    An image that was copied to further images also holds what these gathered.

    Attributes
    ----------
    parts_pc : pressure force on the first of every pair of the last evaluation, by axes
    """

    parts_pc: tuple[FloatArray, ...] = ()
    recording: bool = False

    def pair_terms(self, *fields: Any, **options: Any) -> PairTerms:
        """Return all terms; the first sums, those of pressure, are kept pair by pair."""
        self.recording, self.parts_pc = True, ()
        terms = super().pair_terms(*fields, **options)
        self.recording = False
        return terms

    def total(self, term_p: Any) -> Any:
        """Return the sum of a term of the pairs."""
        if self.recording and len(self.parts_pc) < self.model.dimension:
            self.parts_pc = (*self.parts_pc, np.asarray(value(term_p), float))
        return super().total(term_p)

    def parts(self) -> FloatArray:
        """Return the sum, in every slot of the last list used, over the pairs that list it second."""
        listed = self.lists[self.at]
        second_p = self.backward_p >= 0
        sum_sc = np.zeros((len(listed.row_s), self.model.dimension))
        np.add.at(sum_sc, listed.pair_ps[self.backward_p[second_p], 1], np.column_stack(self.parts_pc)[second_p])
        source_s = listed.sources(self.box)
        for slot in np.flatnonzero(source_s >= 0)[::-1]:  # sums return in the reverse order of the copies
            sum_sc[source_s[slot]] += sum_sc[slot]
        return sum_sc


class BeginningWithParts(PressureForceKept, CountingSteps):
    """Steps whose runs begin with pressure forces, for images with parts of them."""

    evaluator: PartsInSlots

    def slots_at_stop(self, new_n: BoolArray, read_back: bool) -> FloatArray:
        """Return the pressure force on every particle, and in the slots of images what pairs have added there."""
        old, new = self.evaluator.lists[self.at - 1 : self.at + 1]
        slots_sc = self.evaluator.parts()
        if read_back or new_n.all() or not old.newton[0]:
            slots_sc[:] = 0.0
        own_nc = np.asarray(value(self.kept_at_stop(new_n)), float)
        slots_sc[old.own_s] = own_nc[old.row_s[old.own_s]]
        return old.left_to(new, slots_sc, own_nc, new_n)


class LeftInMemory(PressureForceKept, CountingSteps):
    """Particles created again begin a run with the old content of their memory: forces of other particles."""

    def kept_at_stop(self, new_n: BoolArray) -> Array:
        """Return the pressure forces kept, for new particles those of the particles that had their slots."""
        kept_nc = super().kept_at_stop(new_n)
        if new_n.all() or not new_n.any() or not self.evaluator.lists:
            return kept_nc
        old = self.evaluator.lists[self.at - 1]
        old_s = old.row_s[old.own_s]
        left_nc = value(kept_nc).copy()
        left_nc[new_n] = value(self.pressure_force_nc)[after_deletion(old_s, new_n)[-new_n.sum() :]]
        return left_nc


def creates_beside_walls(problem: Problem) -> bool:
    """Return whether some particles are created again before a run that is not the first of its fixes."""
    some = any(stop.new_n.any() and not stop.new_n.all() for stop in problem.stops if stop.step <= problem.steps[-1])
    return some and begins_again_with_walls(problem)


def begins_again_with_images(problem: Problem) -> bool:
    """Return whether a run with reconstructed walls ends and another begins, with images."""
    return problem.has_images and begins_again_with_walls(problem)


WALLS_BEGIN_WITH_PRESSURE = ModelFinding(
    **document("walls-begin-with-pressure"),
    variant=Variant(begins_again_with_walls, stepping=PressureForceKept, changes=("chi",)),
    acts=lambda setting: setting.again and bool(walls(setting.problem).any()),
    gaps=(
        Gap(
            minimises_beside_walls,
            "where the slots of images differ from those of the step before, or the kernel is RK1 or RK2, a "
            "minimisation keeps other forces for walls than those of its positions; which, is not known",
        ),
    ),
)

WALLS_BEGIN_WITH_PARTS = ModelFinding(
    **document("walls-begin-with-parts"),
    variant=Variant(
        begins_again_with_images,
        PartsInSlots,
        BeginningWithParts,
        lists_of_neighbours,
        lists=True,
        changes=("rho_wall",),
    ),
    acts=lambda setting: setting.again and setting.problem.has_images and bool(walls(setting.problem).any()),
)

CREATED_WITH_FORCES_OF_OTHERS = ModelFinding(
    **document("created-with-forces-of-others"),
    variant=Variant(
        creates_beside_walls, FollowingLists, LeftInMemory, lists_of_neighbours, lists=True, changes=("rho_wall",)
    ),
    acts=lambda setting: setting.again and setting.created and bool(walls(setting.problem).any()),
)

ENTRIES = (
    WALL_VELOCITY_LOST,
    WALLS_SUMMED_AFTER_SETUP,
    WALLS_AFTER_REBUILD,
    WALLS_DEPEND_ON_PAIR_ORDER,
    WALLS_BEGIN_WITH_PRESSURE,
    WALLS_BEGIN_WITH_PARTS,
    CREATED_WITH_FORCES_OF_OTHERS,
)
