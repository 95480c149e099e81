"""Findings about solids: their velocity and their densities as the fluid sees them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

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
from lammps_cases.findings.neighbour_lists import CountingSteps, FollowingLists, after_deletion, lists_of_neighbours
from lammps_cases.findings.variants import Variant

if TYPE_CHECKING:
    from lammps_cases.scene import Scene


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
    begins = {0, *(stop.step for stop in problem.stops)}
    looked_at = not begins.isdisjoint(problem.steps)
    return looked_at and problem.model.fix.rho_sum and bool(walls(problem).any())


class PressureForceKept(Simulation):
    """A run that is not the first begins with the pressure forces of the evaluation before, taken for accelerations.

    A minimisation evaluates them with the positions and densities that it finds, and with the pressures of the
    evaluation before but for solids, whose pressures follow from the energies that it finds.
    """

    used_n: Array

    def force_pressure(self) -> Array:
        """Return the pressure that forces take, and keep it."""
        self.used_n = super().force_pressure()
        return self.used_n

    def minimize(self) -> None:
        """Keep the pressure forces of the minimisation, which has the images of its positions."""
        super().minimize()
        if self.model.deform:  # else particles are where the evaluation had them
            assert isinstance(self.evaluator, ArrayEvaluator)
            ArrayEvaluator.follow(self.evaluator, self.state.x_nc)
        pressure_n = where(self.evaluator.solid_n, super().force_pressure(), self.used_n)
        self.pressure_force_nc = self.evaluator.pair_terms(self.pair_input(pressure_n)).pressure_force_nc

    def kept_at_stop(self, new_n: BoolArray) -> Array:
        """Return the pressure force on every particle that is not new."""
        assert self.pressure_force_nc is not None
        return where(new_n[:, None], 0.0, self.pressure_force_nc)


def begins_again_with_walls(problem: Problem) -> bool:
    """Return whether a run with reconstructed walls ends and another begins, of the same fixes."""
    kept = any(stop.step <= problem.steps[-1] and not stop.new_n.all() for stop in problem.stops)
    return kept and bool(walls(problem).any())


def minimises_beside_walls(scene: Scene) -> bool:
    """Return whether a minimisation may keep other forces for walls: it corrects the kernel, or slots are of images."""
    stops = scene.evolve.stops if scene.evolve else ()
    if not (scene.rheo.interface_reconstruct and any(stop.by == "minimize" for stop in stops)):
        return False
    periodic = getattr(scene.positions, "periodic", None)  # None: all axes; of files it may not be known
    has_images = periodic is None or any(periodic) or scene.engine.ranks > 1
    return has_images or scene.rheo.kernel in ("RK1", "RK2")


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


class PartsInSlots(AccelerationsOfOldImages):
    """When a run begins, slots of images hold the pressure forces of the pairs that list them second, not the sums.

    An image of which further images were made has what these gathered too.

    Attributes
    ----------
    parts_pc : pressure force on the first of every pair of the last evaluation, by axes
    """

    parts_pc: tuple[FloatArray, ...] = ()
    recording: bool = False

    def pair_terms(self, *fields: Any, **options: Any) -> PairTerms:
        """Return all terms, of which the first sums, those of pressure, are kept pair by pair."""
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
        for slot in np.flatnonzero(source_s >= 0)[::-1]:  # sums come back the way that places went out
            sum_sc[source_s[slot]] += sum_sc[slot]
        return sum_sc


class BeginningWithParts(PressureForceKept, CountingSteps):
    """Steps whose runs begin with pressure forces, of images with parts of them."""

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
    """Particles created anew begin a run with what the memory that they get has held: forces of other particles."""

    def kept_at_stop(self, new_n: BoolArray) -> Array:
        """Return the pressure forces kept, of new particles those of the particles that had their slots."""
        kept_nc = super().kept_at_stop(new_n)
        if new_n.all() or not new_n.any() or not self.evaluator.lists:
            return kept_nc
        old = self.evaluator.lists[self.at - 1]
        old_s = old.row_s[old.own_s]
        left_nc = value(kept_nc).copy()
        left_nc[new_n] = value(self.pressure_force_nc)[after_deletion(old_s, new_n)[-new_n.sum() :]]
        return left_nc


def creates_beside_walls(problem: Problem) -> bool:
    """Return whether some particles are created anew before a run that is not the first of its fixes."""
    some = any(stop.new_n.any() and not stop.new_n.all() for stop in problem.stops if stop.step <= problem.steps[-1])
    return some and begins_again_with_walls(problem)


def begins_again_with_images(problem: Problem) -> bool:
    """Return whether a run with reconstructed walls ends and another begins, among images."""
    return problem.has_images and begins_again_with_walls(problem)


class GradientOfSecond(FollowingLists):
    """The pressure that is taken out of accelerations has, for both of a pair, the gradient of the second one.

    Without newton a pair across a boundary is listed twice, once for each particle, which then has its own gradient.
    """

    def pair_terms(self, *fields: Any, **options: Any) -> PairTerms:
        """Return all terms as they are, and the pressure force kept from exchanged gradients."""
        terms, own = super().pair_terms(*fields, **options), self.g
        exchanged_p = (self.forward_p >= 0) & (self.backward_p < 0) & (self.reverse_p >= 0)
        self.g, self.exchanged = [where(exchanged_p, -g_a[self.reverse_p], g_a) for g_a in own], True
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
    title="interface/reconstruct forgets that a wall moves",
    severity="high",
    effect="Fluid beside a moving wall gets a wrong velocity at any resolution: Couette flow is off by half",
    documented="fix rheo, interface/reconstruct: densities and velocities of solids are reconstructed to ensure "
    "no-slip boundaries; Takeda et al. 1994, Morris et al. 1997: v_s' = v_s + (v_s - v_f) d_s/d_f.",
    observed="The solid's velocity as the fluid sees it is (v_s - v_f) d_s/d_f: the term v_s is missing. The two "
    "agree for a wall at rest only.",
    argument="A fluid and its container that move together with velocity U must feel no viscous force; in LAMMPS the "
    "fluid sees the wall at 0 in place of U, so that the forces depend on the frame. A wall moved at U drags a fluid "
    "particle towards U d_s/(d_s + d_f), not U: over one row of solids 0.5 U, over two rows 0.6 U (spacing 1, cutoff "
    "1.3), so that a Couette flow depends on how the particles of the wall lie.",
    workaround="Keep walls at rest: choose the frame of the wall, or drive the fluid by addforce.",
    scene="fluid at rest over one row of solid particles that moves",
    gaps=(
        Gap(
            lambda scene: scene.rheo.interface_reconstruct and scene.remaps_velocities,
            "as forces depend on the frame, those across a boundary whose images move (fix deform, remap v) are those "
            "of the frame of the particle that LAMMPS' list has first",
        ),
    ),
    model_variant=Variant(has_moving_walls, WallVelocityLost),
)


WALLS_SUMMED_AFTER_SETUP = Finding(
    id="walls-summed-after-setup",
    number=24,
    title="After the set-up of a run solids show a density that was not used",
    severity="low",
    effect="Densities of solids in the output of step 0 are not those that forces used",
    documented="fix rheo, interface/reconstruct: the density of solids is reconstructed for the interaction with "
    "fluid; rho/sum sums densities.",
    observed="With both keywords the densities of solids reported after run 0 are the sums; the forces of the same "
    "step used the reconstructed ones, and every later step of the run reports these. Each run without 'pre no' begins "
    "so again.",
    argument="Output and forces of one step belong to different densities: who computes the forces from the densities "
    "reported after run 0 gets other ones.",
    workaround="Look at solids after a step, not after run 0.",
    scene="fluid over solid particles with rho/sum, run 0",
    gaps=(
        Gap(
            lambda scene: not scene.whole_model and scene.rho_sum and scene.rheo.interface_reconstruct,
            "of an equation of state alone the density is compared that is reported, not the one that was used",
        ),
    ),
    model_variant=Variant(sums_walls, stepping=WallsSummedAfterSetup),
)


WALLS_AFTER_REBUILD = Finding(
    id="walls-after-rebuild",
    number=25,
    title="Densities of walls are wrong in single steps after neighbour lists are rebuilt",
    severity="high",
    effect="Densities and forces of walls beside a periodic boundary jump in single steps",
    documented="fix rheo, interface/reconstruct: densities of solids follow from the fluid's (Adami et al. "
    "2012), whatever the neighbour lists; neigh_modify: settings of the lists must not change the physics.",
    observed="In a step in which atoms enter or leave the layer of periodic images, the extrapolation to solids "
    "reads accelerations by the slots of images that the new list numbers, while the slots still hold what the old "
    "list had in them: accelerations of other particles. Densities of solids that see fluid through a periodic "
    "boundary are wrong in that step, by 0.2 % in the scene open.walls-after-rebuild, and with them the forces; before "
    "the next step the slots are filled anew, so that only the trajectory keeps the error.",
    argument="The same run with other rebuild settings has another trajectory. With the accelerations taken from "
    "LAMMPS' own slots, as of the list before and 0 in slots that it did not have, every density of the scene is "
    "reproduced to rounding, over 60 steps with a rebuild in each and other images from step 6 on. Lists rebuilt with "
    "the same images in the same order, as before step 6, do no harm.",
    workaround="Let lists be rebuilt only when they must ('neigh_modify check yes', the default), and seldom, by a "
    "large skin.",
    scene="fluid over fixed solids under gravity, periodic along the wall, lists rebuilt every step",
    model_variant=Variant(
        has_kept_images,
        AccelerationsOfOldImages,
        CountingSteps,
        lists_of_neighbours,
        lists=True,
    ),
    expected_in_alarms=(
        AlarmDifference(
            ("rebuilt",),
            lambda problem: problem.rheo.interface_reconstruct,
            "the first step that is wrong is the first in which the list of periodic images changes, and it is "
            "densities of solids that are wrong in it; scenes whose images stay the same are right",
        ),
    ),
)


WALLS_DEPEND_ON_PAIR_ORDER = Finding(
    id="walls-depend-on-pair-order",
    number=27,
    title="With RK1 and RK2, densities of walls depend on the order in which pairs are listed",
    severity="medium",
    effect="Runs that list the same pairs in another order have other densities of walls",
    documented="fix rheo, interface/reconstruct: densities of solids follow from pressure and acceleration of the "
    "fluid (Adami et al. 2012), the acceleration being the one not due to pressure.",
    observed="The pressure force that is taken out of the acceleration is, for the first particle of every pair "
    "in the list, minus that of the second, made with the second particle's gradient; with the quintic kernel the "
    "two are the same. With newton off pairs across a boundary are listed for each particle, which then has its "
    "own gradient, as all have from 2025.7.22.2.0 on.",
    argument="With the same four particles numbered in another order the solid has another density from step 1 on: "
    "physics must not depend on which of a pair a list names first. With the order of LAMMPS' own lists every "
    "density is reproduced to rounding.",
    workaround="Use the quintic kernel, or 2025.7.22.2.0 or newer.",
    scene="one solid and three fluid particles, RK1",
    model_variant=Variant(
        keeps_corrected_forces,
        GradientOfSecond,
        CountingSteps,
        lists_of_neighbours,
        lists=True,
    ),
)

WALLS_BEGIN_WITH_PRESSURE = Finding(
    id="walls-begin-with-pressure",
    number=33,
    title="Every run but the first begins with wrong densities of walls",
    severity="high",
    effect="The second run of a script, or one after read_restart, begins with wrong forces at walls",
    documented="fix rheo, interface/reconstruct: densities of solids follow from pressure and acceleration of the "
    "fluid (Adami et al. 2012), the acceleration being the one not due to pressure; fix rheo: no information about "
    "the fix is written to restart files.",
    observed="In the set-up of a run that is not the first of its fix rheo, the extrapolation to solids takes for "
    "the accelerations without pressure of all particles, walls included, the pressure forces of the evaluation "
    "before, neither taken out of the force nor divided by the mass. After minimize they are those that it evaluates, "
    "from the positions, densities and energies that it finds and, of the fluid, from pressures of the evaluation "
    "before. They are kept in restart files too, so that a run after read_restart begins with them, and displace_atoms "
    "and change_box are refused there. Densities of solids are wrong until the first step recomputes them, and with "
    "them the forces that this step begins with.",
    argument="Between two runs of 0 steps nothing happens, and yet the forces differ. A fluid particle at distance 1 "
    "of a solid (2D, cutoff 3, linear, both of mass, rho0, c and density 1, background -0.3, the solid held by "
    "setforce): after 'run 0' the solid has the density 1, after a second 'run 0' 1.280 = 1 + 2 * 0.3 * 2 * 0.2331, "
    "the sum of the pressure forces on either times the distance.",
    workaround="Continue with 'run N pre no'; or take all RHEO fixes away (unfix) and define them anew before the "
    "run, after read_restart too (define and take away fix rheo once); data files written with 'nofix' do no harm.",
    scene="a fluid particle beside a solid one, run 0 twice",
    model_variant=Variant(begins_again_with_walls, stepping=PressureForceKept),
    gaps=(
        Gap(
            minimises_beside_walls,
            "where the slots of images are others than in the step before, or the kernel is RK1 or RK2, a minimisation "
            "keeps other forces for walls than those of its positions; which, is not known",
        ),
    ),
)

WALLS_BEGIN_WITH_PARTS = Finding(
    id="walls-begin-with-parts",
    number=35,
    title="Runs begin with other forces on periodic images of particles beside walls than on the particles",
    severity="high",
    effect="The second run of a script begins with wrong forces at walls beside a periodic boundary",
    documented="fix rheo, interface/reconstruct: densities of solids follow from the fluid's (Adami et al. "
    "2012); newton: the flag must not change the physics; a periodic image is its particle.",
    observed="In the set-up of a run that is not the first of its fix rheo, where particles have the pressure forces "
    "of the evaluation before in place of accelerations, their periodic images have others: with newton on the sum "
    "over the pairs that list the image, or an image made of it, as the second one, with newton off and after "
    "read_restart 0. With 'newton off on', where the pair counts twice, it does so with the image of either particle. "
    "If the set-up sorts particles, the first image has the force of one that was moved.",
    argument="The scene of walls-begin-with-pressure, with the periodic boundary between its two particles: after a "
    "second 'run 0' the solid has the density 1.280 with newton on, as inside the box, but 1.140 with newton off, "
    "where only its own force is seen, and the same after read_restart. With more particles newton on differs too, as "
    "an image has only part of the force.",
    workaround="As for walls-begin-with-pressure: 'run N pre no', or the RHEO fixes defined anew before a run.",
    scene="a fluid particle beside a solid one across a periodic boundary, newton off, run 0 twice",
    model_variant=Variant(begins_again_with_images, PartsInSlots, BeginningWithParts, lists_of_neighbours, lists=True),
)

CREATED_WITH_FORCES_OF_OTHERS = Finding(
    id="created-with-forces-of-others",
    number=64,
    title="Particles created between two runs begin with the forces of others, where there are walls",
    severity="medium",
    effect="After delete_atoms and create_atoms the next run begins with wrong forces at walls",
    documented="fix rheo, interface/reconstruct: densities of solids follow from pressure and acceleration of the "
    "fluid (Adami et al. 2012); create_atoms: new particles have the properties that the page lists, and no past.",
    observed="Particles that create_atoms makes begin the next run, in place of accelerations without pressure, with "
    "what is left in the memory that they get: the pressure forces of the particles that lay there before delete_atoms "
    "moved the last ones into the places of those deleted.",
    argument="The scene of walls-begin-with-pressure, with the solid at (4, 4) and fluid particles at (4, 5) and "
    "(3, 4), the last of which is deleted and created where it was between two 'run 0': the solid should have the "
    "density 1, and has 1.210, as the new particle has the force of the other one; it has 1.335 if nothing is created, "
    "and would have 1.238 if the new particle had no force.",
    workaround="Take the RHEO fixes away (unfix) and define them anew after create_atoms.",
    scene="two fluid particles beside a solid one, one of them created anew between run 0 and run 0",
    model_variant=Variant(creates_beside_walls, FollowingLists, LeftInMemory, lists_of_neighbours, lists=True),
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
