"""Findings about virials."""

from __future__ import annotations

import numpy as np

from eos_ref.numbers.columns import Axes, axes, joined, summed, symmetric
from eos_ref.numbers.elementary import where
from eos_ref.numbers.number import Array
from eos_ref.numbers.rounded import value
from lammps_cases.comparison.problem import Problem
from lammps_cases.findings.document import document
from lammps_cases.findings.entry import ModelFinding
from lammps_cases.findings.neighbour_lists import CountingSteps, FollowingLists, lists_of_neighbours
from lammps_cases.findings.variants import Variant

OVERALL = ("virial", "press")


class VirialsCancel(FollowingLists):
    """The virial of a pair contains the sum of its two forces instead of their difference.

    A pair across a boundary, which is listed for each of its particles if newton is off, has one force each time. With
    newton off the virial of all is the sum of these. Listed so with newton on, it has both forces each time, at
    opposite distances.
    """

    def virials(self, force: Axes) -> tuple[Array, Array]:
        """Return sums of half of the distance of the pair, as listed, times the sum of the forces on both."""
        whole_ncc = super().virials(force)[1]
        forward_p, backward_p = self.forward_p >= 0, self.backward_p >= 0
        listed_twice_p = forward_p & backward_p
        newton = bool(self.lists[self.at].newton[0])
        distance = [where(listed_twice_p & newton, 0.0, where(forward_p, x_a, -x_a)) for x_a in self.x]
        alone_p = listed_twice_p | (self.reverse_p < 0)
        both = [f_b + where(alone_p, 0.0, f_b[self.reverse_p]) for f_b in force]
        virial = symmetric([[0.5 * self.total(x_a * f_b) for f_b in both] for x_a in distance])
        if not newton:
            whole_ncc = joined([[summed(w_n) for w_n in row] for row in virial])
        return joined(virial), whole_ncc


class VirialOfPlaces(FollowingLists):
    """With newton the virial of all is the sum of position times force, images included, whatever the origin."""

    def move(self, x_nc: Array) -> None:
        """Find the pairs, and the positions of the particles that LAMMPS lists for them."""
        super().move(x_nc)
        x, listed = value(x_nc).astype(float), self.lists[self.at]
        image_sc = self.box.periods(listed.x_sc[:, : x.shape[1]] - x[listed.row_s])
        first_p = listed.pair_ps[self.forward_p, 0]  # the slot of i in the entry under i, and in that under j
        second_p = listed.pair_ps[self.backward_p, 1]
        forward_p, backward_p = self.forward_p >= 0, self.backward_p >= 0
        shift_pc = self.box.shift(
            0.5 * (image_sc[np.where(forward_p, first_p, second_p)] + image_sc[np.where(backward_p, second_p, first_p)])
        )
        self.place = [x_n[self.i] + shift_pc[:, a] for a, x_n in enumerate(axes(x_nc))]

    def virials(self, force: Axes) -> tuple[Array, Array]:
        """Return the sums, that of all from positions."""
        virial_ncc, whole_ncc = super().virials(force)
        if self.lists[self.at].newton[0]:
            whole = symmetric([[summed(self.total(x_a * f_b)) for f_b in force] for x_a in self.place])
            whole_ncc = joined(whole)
        return virial_ncc, whole_ncc


def shows_virials(problem: Problem) -> bool:
    """Return whether a virial is compared."""
    return "stress/atom" in problem.fields or shows_sums(problem)


def shows_sums(problem: Problem) -> bool:
    """Return whether the virial of all particles is compared."""
    return not set(OVERALL).isdisjoint(problem.fields)


VIRIALS_CANCEL = ModelFinding(
    **document("virials-cancel"),
    variant=Variant(
        shows_virials, VirialsCancel, CountingSteps, lists_of_neighbours, lists=True, changes=("stress/atom", *OVERALL)
    ),
    acts=lambda setting: (
        "compute stress/atom" in setting.shown or ("press" in setting.shown and not setting.problem.newton[0])
    ),
)

VIRIAL_OF_PLACES = ModelFinding(
    **document("virial-of-places"),
    variant=Variant(shows_sums, VirialOfPlaces, CountingSteps, lists_of_neighbours, lists=True, changes=OVERALL),
    acts=lambda setting: (
        setting.problem.newton[0] and not setting.shown.isdisjoint(("thermo_style press", "compute pressure"))
    ),
)

ENTRIES = (VIRIALS_CANCEL, VIRIAL_OF_PLACES)
