"""Findings about what processes, and particles and their periodic images, tell each other."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from eos_ref.model.parameters import Gradients
from eos_ref.numbers.columns import Axes
from eos_ref.numbers.elementary import where
from eos_ref.numbers.number import Array
from lammps_cases.comparison.trajectory import Problem
from lammps_cases.findings.entry import Finding
from lammps_cases.findings.neighbour_lists import CountingSteps, FollowingLists, lists_of_neighbours
from lammps_cases.findings.variants import Variant


class BoundaryPairsTwice(FollowingLists):
    """With newton off for pairs and on for bonds, some sums take a pair across a boundary twice.

    Such a pair is listed for each of its particles. What the image of a particle collects from it is added to the
    particle too, as is right where a pair is listed once.
    """

    twice: bool = False

    def total(self, term_p: Any) -> Any:
        """Return sums over the neighbours; those across a boundary count twice while ``twice`` is set."""
        if self.twice:
            term_p = where((self.forward_p >= 0) & (self.backward_p >= 0), 2 * term_p, term_p)
        return super().total(term_p)

    @contextmanager
    def _images_added(self) -> Iterator[None]:
        of_pairs, of_bonds = self.lists[self.at].newton
        self.twice = bool(of_bonds and not of_pairs)
        yield
        self.twice = False

    def kernel_sum(self, weight_n: Array | None = None) -> Array:
        """Return sums of the kernel, for densities."""
        with self._images_added():
            return super().kernel_sum(weight_n)

    def gradients(self, *arguments: Any, **options: Any) -> Gradients:
        """Return gradients of fields."""
        with self._images_added():
            return super().gradients(*arguments, **options)

    def wall_sums(self, pressure_n: Array, rho_n: Array, acceleration_nc: Array) -> tuple[Array, ...]:
        """Return sums for same-phase fractions and densities of walls."""
        with self._images_added():
            return super().wall_sums(pressure_n, rho_n, acceleration_nc)

    def surface_sums(self, rho_n: Array) -> tuple[Axes, Array]:
        """Return sums for divergences and normals."""
        with self._images_added():
            return super().surface_sums(rho_n)


def may_have_images(problem: Problem) -> bool:
    """Return whether particles may have periodic images, and neighbours among them."""
    return any(problem.box.periodic)


BOUNDARY_PAIRS_TWICE = Finding(
    id="boundary-pairs-twice",
    number=29,
    title="With 'newton off on' pairs across a boundary count twice",
    severity="high",
    effect="Densities and gradients at periodic boundaries, and between processes, are wrong",
    documented="newton: the flags for pairs and for bonds may differ, and results must not depend on them but for "
    "rounding.",
    observed="With 'newton off on' a pair across a periodic boundary, or one between processes, is listed for each of "
    "its particles, and counts twice in summed densities, in gradients, in same-phase fractions and "
    "densities of walls, and in divergences and normals of surfaces; once in coordination numbers, in the moments of "
    "RK1 and RK2, in shifts and in the terms of pair rheo. The other three settings agree with each other.",
    argument="Two particles of mass 1 at distance 1 (2D, cutoff 3) have summed densities of 0.4289 in the middle of a "
    "box, and of 0.5501 with a periodic boundary between them: where the box is cut must not matter. Only particles "
    "in reach of a boundary are wrong, so that a large box hides it.",
    workaround="Set newton on or off for pairs and bonds alike; 'newton on off' is right too.",
    scene="two particles with a periodic boundary between them, rho/sum, newton off on",
    model_variant=Variant(may_have_images, BoundaryPairsTwice, CountingSteps, lists_of_neighbours, lists=True),
)

ENTRIES = (BOUNDARY_PAIRS_TWICE,)
