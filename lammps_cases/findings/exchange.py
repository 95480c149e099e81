"""Findings about the exchange between processes, and between particles and their periodic images."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.evaluation.pairs import directed_pairs
from eos_ref.model.box import BoolArray, Box, Deform
from eos_ref.model.parameters import IntArray
from eos_ref.model.state import Gradients
from eos_ref.model.units import UNITS
from eos_ref.numbers.columns import Axes
from eos_ref.numbers.elementary import where
from eos_ref.numbers.number import Array
from eos_ref.numbers.rounded import value
from lammps_cases.comparison.problem import Problem
from lammps_cases.findings.document import document
from lammps_cases.findings.entry import ModelFinding
from lammps_cases.findings.neighbour_lists import CountingSteps, FollowingLists, NeighbourList, lists_of_neighbours
from lammps_cases.findings.variants import Variant

SUMS = ("rho", "chi", "grad/v", "grad/rho", "grad/energy", "surface")  # over neighbours, in addition to pair rheo's


class BoundaryPairsTwice(FollowingLists):
    """With newton off for pairs and on for bonds, some sums take a pair across a boundary twice.

    Such a pair is listed for each of its particles. What the image of a particle collects from it is added to the
    particle too, as is right where a pair is listed once.
    """

    twice: bool = False

    def total(self, term_p: Any) -> Any:
        """Return sums over the neighbours; those across a boundary count twice while ``twice`` is set."""
        if self.twice:
            term_p = where(self.twice_p(), 2 * term_p, term_p)
        return super().total(term_p)

    def tells_particles(self) -> bool:
        """Return whether particles receive what their images collect from pairs that both particles list."""
        of_pairs, of_bonds = self.lists[self.at].newton
        return bool(of_bonds and not of_pairs)

    @contextmanager
    def images_added(self) -> Iterator[None]:
        """Sum as where particles receive what their images collect."""
        before, self.twice = self.twice, self.tells_particles() and not self.each_listing
        yield
        self.twice = before

    def twice_p(self) -> BoolArray:
        """Return which pairs count twice now, (p,): those that both particles list, while ``twice`` is set."""
        return (self.forward_p >= 0) & (self.backward_p >= 0) & self.twice

    def kernel_sum(self, weight_n: Array | None = None) -> Array:
        """Return sums of the kernel, for densities."""
        with self.images_added():
            return super().kernel_sum(weight_n)

    def gradients(self, *arguments: Any, **options: Any) -> Gradients:
        """Return gradients of fields."""
        with self.images_added():
            return super().gradients(*arguments, **options)

    def wall_sums(self, pressure_n: Array, rho_n: Array, acceleration_nc: Array) -> tuple[Array, ...]:
        """Return sums for same-phase fractions and densities of walls."""
        with self.images_added():
            return super().wall_sums(pressure_n, rho_n, acceleration_nc)

    def surface_sums(self, rho_n: Array) -> tuple[Axes, Array]:
        """Return sums for divergences and normals."""
        with self.images_added():
            return super().surface_sums(rho_n)


class AlignedPairsTwice(FollowingLists):
    """With newton on for pairs, a pair that both its particles list counts twice.

    This holds for all sums except the moments of kernels, for which every particle has its own neighbours.
    """

    own_neighbours: bool = False

    def total(self, term_p: Any) -> Any:
        """Return sums over the neighbours; some count twice."""
        return super().total(where(self.twice_p(), 2 * term_p, term_p) if self.lists else term_p)

    def twice_p(self) -> BoolArray:
        """Return which pairs count twice now, (p,): those that both particles list."""
        counts = bool(self.lists[self.at].newton[0]) and not self.own_neighbours
        return super().twice_p() | ((self.forward_p >= 0) & (self.backward_p >= 0) & counts)

    def moments(self, rho_n: Array) -> tuple[list[Array], list[list[Array]]]:
        """Return sums over the neighbours that every particle has."""
        self.own_neighbours = True
        found = super().moments(rho_n)
        self.own_neighbours = False
        return found


class ImagesLeftBehind(FollowingLists):
    """The first half of a step in a growing box pairs particles with images at the positions of the last forces.

    The same holds for copies of another process' particles; a process' own particles are at their present positions.

    Attributes
    ----------
    at_forces : positions and box of the last forces
    behind : rows and distances of pairs between moved particles and images left behind, while there are any
    """

    at_forces: tuple[FloatArray, Box]
    behind: tuple[IntArray, IntArray, FloatArray] | None = None

    def move(self, x_nc: Array) -> None:
        """Remember the positions of the particles at the forces."""
        if self.behind is None:
            self.at_forces, self.each_listing = (value(x_nc).astype(float), self.box), False
        super().move(x_nc)

    def follow(self, x_nc: Array) -> None:
        """Find the pairs of particles that have moved with the box and of images that have not."""
        if self.lists:
            self.behind, self.each_listing = self._behind(value(x_nc).astype(float)), True
        super().follow(x_nc)
        self.behind = None

    def pairs(self, x_nc: FloatArray, cut: float) -> tuple[IntArray, IntArray, FloatArray]:
        """Return the directed pairs closer than a cutoff."""
        if self.behind is None:
            return super().pairs(x_nc, cut)
        i, j, apart_pc = self.behind
        near = (apart_pc**2).sum(axis=1) < cut**2
        return i[near], j[near], (x_nc[i] - x_nc[j] - apart_pc)[near]

    def _behind(self, x_nc: FloatArray) -> tuple[IntArray, IntArray, FloatArray]:
        """Return the pairs and their distances; in a pair with an image the first particle has moved."""
        listed, before_sc, moved_sc = self._moved(x_nc)
        one, other = listed.pair_ps.T
        apart_pc = before_sc[one] - before_sc[other] + moved_sc[one] - moved_sc[other] * listed.own_s[other, None]
        both = listed.newton[0] | listed.own_s[other] | self.tells_particles()  # else the other one lists it itself
        i, j = listed.row_s[one], listed.row_s[other]
        return np.append(i, j[both]), np.append(j, i[both]), np.append(apart_pc, -apart_pc[both], axis=0)

    def _moved(self, x_nc: FloatArray) -> tuple[NeighbourList, FloatArray, FloatArray]:
        """Return the list in use, the positions of its slots at the last forces, and their particles' displacements."""
        listed, (seen_nc, box) = self.lists[self.at], self.at_forces
        found_sc, row_s = listed.x_sc[:, : x_nc.shape[1]], listed.row_s
        before_sc, now_sc = (
            places_nc[row_s] + around.shift(around.periods(found_sc - places_nc[row_s]))
            for places_nc, around in ((seen_nc, box), (x_nc, self.box))
        )
        own = np.flatnonzero(listed.own_s)
        own_n = own[np.argsort(row_s[own])]
        return listed, before_sc, (now_sc - before_sc)[own_n][row_s]

    def counted_late(self, x_nc: FloatArray) -> IntArray:
        """Return the numbers of neighbours after the box has grown: particles have moved, none of their images has."""
        listed, before_sc, moved_sc = self._moved(x_nc)
        count_n = np.zeros(self.n, int)
        for i, j in (listed.pair_ps.T, listed.pair_ps.T[::-1]):
            inner = listed.own_s[i] & listed.own_s[j]
            apart_pc = before_sc[i] - before_sc[j] + moved_sc[i] - moved_sc[j] * inner[:, None]
            near = ((apart_pc**2).sum(axis=1) < self.model.cut**2) & (listed.newton[0] | listed.own_s[i])
            count_n += np.bincount(listed.row_s[i[near]], minlength=self.n)
        return count_n


class CountingLate(CountingSteps):
    """Steps after which coordination numbers are those of moved particles and images left behind.

    Unless the evaluation has counted already: for a reproducing kernel, or to detect surfaces.
    """

    evaluator: ImagesLeftBehind

    def deform(self, by: Deform, dt: float) -> None:
        """Count once more."""
        super().deform(by, dt)
        late = self.model.order < 0 and self.model.fix.surface_detection is None
        if late and self.evaluator.lists and "coordination" in self.fields:
            self.fields["coordination"] = self.evaluator.counted_late(self.state.x_nc)


def grows(problem: Problem) -> bool:
    """Return whether the box changes while particles move, and images only at the ends of steps."""
    deform = problem.model.deform
    return deform is not None and deform.changes and deform.remap != "v" and problem.steps[-1] > 0


def lists_pairs_twice(problem: Problem) -> bool:
    """Return whether pairs are listed for each particle although particles receive what their images collect."""
    return problem.has_images and problem.newton == (False, True)


def has_close_images(problem: Problem) -> bool:
    """Return whether particles of a box that is or becomes tilted are (nearly) so close that pairs count twice."""
    if not (problem.leans and problem.has_images and problem.newton[0]):
        return False
    units = problem.model.units
    reach = 0.01 if units == "lj" else 1e-12 / UNITS[units].length
    return len(directed_pairs(problem.state.x_nc, problem.box, min(2 * reach, problem.model.cut))[0]) > 0


BOUNDARY_PAIRS_TWICE = ModelFinding(
    **document("boundary-pairs-twice"),
    variant=Variant(
        lists_pairs_twice,
        BoundaryPairsTwice,
        CountingSteps,
        lists_of_neighbours,
        lists=True,
        changes=SUMS,
    ),
    acts=lambda setting: lists_pairs_twice(setting.problem),
)

IMAGES_LEFT_BEHIND = ModelFinding(
    **document("images-left-behind"),
    variant=Variant(
        grows, ImagesLeftBehind, CountingLate, lists_of_neighbours, lists=True, changes=("coordination", "x")
    ),
    acts=lambda setting: setting.deforms and any(setting.problem.box.periodic) and setting.problem.steps[-1] > 0,
)

ALIGNED_PAIRS_TWICE = ModelFinding(
    **document("aligned-pairs-twice"),
    variant=Variant(
        has_close_images,
        AlignedPairsTwice,
        CountingSteps,
        lists_of_neighbours,
        lists=True,
        changes=(*SUMS, "shift/v", "heatflow", "drho", "f"),
    ),
    acts=lambda setting: has_close_images(setting.problem),
)

ENTRIES = (BOUNDARY_PAIRS_TWICE, IMAGES_LEFT_BEHIND, ALIGNED_PAIRS_TWICE)
