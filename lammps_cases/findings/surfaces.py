"""Findings about free surfaces."""

from __future__ import annotations

from typing import Any

import numpy as np

from eos_ref.evaluation.time_step import BULK, LAYER
from eos_ref.model.box import BoolArray
from eos_ref.numbers.elementary import where
from eos_ref.numbers.rounded import value
from lammps_cases.comparison.problem import Problem
from lammps_cases.findings.entry import AlarmDifference, Finding
from lammps_cases.findings.neighbour_lists import CountingSteps, FollowingLists, lists_of_neighbours
from lammps_cases.findings.variants import Variant


class LayerOfFirst(FollowingLists):
    """Bulk beside a surface has the status of a layer only if it is the first of some pair with a surface particle."""

    def meets_as_first(self, surface_n: BoolArray) -> BoolArray:
        """Return which particles are the first of a pair with one of some others, (n,)."""
        return np.bincount(self.i[(self.forward_p >= 0) & surface_n[self.j]], minlength=self.n) > 0


class StatusOfLayers(CountingSteps):
    """Steps whose status words take the layer from `LayerOfFirst`."""

    evaluator: LayerOfFirst

    def output(self, field: str) -> Any:
        """Return fields as they are, with fewer particles in the layer."""
        values = super().output(field)
        if field != "status" or "surface" not in self.fields:
            return values
        met_n = self.evaluator.meets_as_first(value(self.fields["surface"]) == 1)
        return where((value(values) == LAYER) & ~met_n, float(BULK), values)


def shows_layers(problem: Problem) -> bool:
    """Return whether the status of particles beside a surface shows."""
    return "status" in problem.fields and problem.model.fix.surface_detection is not None


LAYER_DEPENDS_ON_PAIR_ORDER = Finding(
    id="layer-depends-on-pair-order",
    number=26,
    title="Which particles belong to the layer beside a surface depends on the order in which pairs are listed",
    severity="low",
    effect="Runs that list the same pairs in a different order have different surface layers",
    documented="fix rheo, surface/detection: particles are classified as bulk, surface or splash; neigh_modify, "
    "newton and the number of processors must not change the physics. The layer beside a surface is not "
    "documented; its status is listed by compute rheo/property/atom.",
    observed="A bulk particle has the status of the layer (8) only if it is listed first in some pair with a surface "
    "particle within the cutoff; one that is listed second in all such pairs keeps the status of bulk (4), although "
    "surface/r of the same step holds its distance.",
    argument="With newton off, or with the atoms numbered in reverse order, other particles of the same state have "
    "the status. With the order taken from LAMMPS' own lists, every status is predicted; on several ranks the lists "
    "are not read.",
    workaround="Define the layer as the bulk particles whose surface/r is less than the cutoff.",
    scene="a block of fluid beside vacuum",
    model_variant=Variant(
        shows_layers,
        LayerOfFirst,
        StatusOfLayers,
        lists_of_neighbours,
        lists=True,
        changes=("status",),
    ),
    acts=lambda setting: "status" in setting.shown and setting.problem.model.fix.surface_detection is not None,
    expected_in_alarms=(
        AlarmDifference(
            ("relabelled", "reordered", "unsorted", "newton", "skin", "rebuilt", "ranks", "seed"),
            lambda problem: "status" in problem.compare and problem.rheo.surface_detection is not None,
            "which of two particles is listed first decides whether one of them belongs to the layer; neighbour "
            "lists are not read here",
        ),
    ),
)

ENTRIES = (LAYER_DEPENDS_ON_PAIR_ORDER,)
