"""Findings about free surfaces."""

from __future__ import annotations

from typing import Any

import numpy as np

from eos_ref.evaluation.time_step import BULK, LAYER
from eos_ref.model.box import BoolArray
from eos_ref.numbers.elementary import where
from eos_ref.numbers.rounded import value
from lammps_cases.comparison.problem import Problem
from lammps_cases.findings.document import document
from lammps_cases.findings.entry import AlarmDifference, ModelFinding
from lammps_cases.findings.neighbour_lists import CountingSteps, FollowingLists, lists_of_neighbours
from lammps_cases.findings.variants import Variant


class LayerOfFirst(FollowingLists):
    """Bulk next to a surface has the status of a layer only if it is the first of some pair with a surface particle."""

    def meets_as_first(self, surface_n: BoolArray) -> BoolArray:
        """Return which particles are the first of a pair with one of ``surface_n``, (n,)."""
        return np.bincount(self.i[(self.forward_p >= 0) & surface_n[self.j]], minlength=self.n) > 0


class StatusOfLayers(CountingSteps):
    """Steps whose status words take the layer from `LayerOfFirst`."""

    evaluator: LayerOfFirst

    def output(self, field: str) -> Any:
        """Return fields unchanged, but with fewer particles in the layer."""
        values = super().output(field)
        if field != "status" or "surface" not in self.fields:
            return values
        met_n = self.evaluator.meets_as_first(value(self.fields["surface"]) == 1)
        return where((value(values) == LAYER) & ~met_n, float(BULK), values)


def shows_layers(problem: Problem) -> bool:
    """Return whether the status of particles next to a surface is output."""
    return "status" in problem.fields and problem.model.fix.surface_detection is not None


LAYER_DEPENDS_ON_PAIR_ORDER = ModelFinding(
    **document("layer-depends-on-pair-order"),
    variant=Variant(
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
