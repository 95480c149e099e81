"""Findings about solids where a run ends and another begins: what is left of the forces before."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.box import BoolArray
from eos_ref.model.state import PairTerms
from eos_ref.numbers.elementary import where
from eos_ref.numbers.number import Array
from eos_ref.numbers.rounded import value
from lammps_cases.comparison.problem import Problem
from lammps_cases.findings.document import document
from lammps_cases.findings.entry import Gap, ModelFinding
from lammps_cases.findings.neighbour_lists import CountingSteps, FollowingLists, after_deletion, lists_of_neighbours
from lammps_cases.findings.variants import Variant
from lammps_cases.findings.walls import AccelerationsOfOldImages, walls

if TYPE_CHECKING:
    from lammps_cases.scene import Scene


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


WALLS_BEGIN_WITH_PRESSURE = ModelFinding(
    **document("walls-begin-with-pressure"),
    variant=Variant(begins_again_with_walls, stepping=PressureForceKept, changes=("chi",)),
    acts=lambda setting: setting.again and bool(walls(setting.problem).any()),
    gaps=(
        Gap(
            minimises_beside_walls,
            "where the slots of images are others than in the step before, or the kernel is RK1 or RK2, a minimisation "
            "keeps other forces for walls than those of its positions; which, is not known",
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

ENTRIES = (WALLS_BEGIN_WITH_PRESSURE, WALLS_BEGIN_WITH_PARTS, CREATED_WITH_FORCES_OF_OTHERS)
