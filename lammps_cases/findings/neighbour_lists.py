"""Variants that follow LAMMPS' own lists of neighbours: which of a pair stands first, and what its slots hold.

Slots number the atoms of a process and, after them, their periodic images. The lists are read at every step, only for
cases that differ and may be explained by such a variant.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.evaluation.array_evaluator import Plain
from eos_ref.evaluation.time_step import BULK, LAYER, Simulation
from eos_ref.model.parameters import BoolArray, IntArray, PairTerms
from eos_ref.numbers.columns import Number, axes, dot
from eos_ref.numbers.elementary import where
from eos_ref.numbers.rounded import value


@dataclass(frozen=True)
class Listed:
    """A list of neighbours, as LAMMPS' forces at one step used it.

    Attributes
    ----------
    row_s : the particle that each slot holds, by its row
    x_sc : where the slot has it
    pair_ps : the two slots of every pair, that under which the pair is listed first
    """

    row_s: IntArray
    x_sc: FloatArray
    pair_ps: IntArray


class FollowingLists(Plain):
    """Stages that find their pairs in LAMMPS' list.

    Attributes
    ----------
    lists : LAMMPS' list at every step
    at : the step whose list is in use
    kept_sc : accelerations in the slots of the list before
    forward_p, backward_p : entry of the list under i, and under j, for every directed pair; -1 if there is none
    reverse_p : the same pair as the other particle collects it; -1 if rounding puts it beyond the cutoff
    """

    lists: tuple[Listed, ...] = ()
    at: int = 0
    kept_sc: FloatArray = np.zeros((0, 0))

    def move(self, x_nc: Number) -> None:
        """Find the pairs, and each in LAMMPS' list."""
        super().move(x_nc)
        x, i, j, listed = value(x_nc).astype(float), self.i, self.j, self.lists[self.at]
        one_s, other_s = listed.pair_ps.T
        apart_pc = np.stack([value(x_p).astype(float) for x_p in self.x], axis=1)
        image_pc = self._periods(x[i] - x[j] - apart_pc)
        image_sc = self._periods(listed.x_sc[:, : x.shape[1]] - x[listed.row_s])
        own = np.column_stack([i, j, image_pc])
        other = np.column_stack([j, i, -image_pc])
        rows = listed.row_s[one_s], listed.row_s[other_s]
        entries = np.column_stack([*rows, image_sc[other_s] - image_sc[one_s]])
        self.forward_p, self.backward_p = _places(own, entries), _places(other, entries)
        self.reverse_p = _places(other, own)

    def _periods(self, distance_nc: FloatArray) -> IntArray:
        """Distances in whole periods, for particles that may have left the box; 0 along open axes."""
        turns_nc = np.where(self.box.periodic, np.round(distance_nc / np.array(self.box.edge_c)), 0.0)
        return np.asarray(turns_nc, np.int64)


def _places(wanted: IntArray, known: IntArray) -> IntArray:
    """Row of ``known`` that equals each row of ``wanted``; -1 where there is none."""
    names, name = np.unique(np.concatenate([known, wanted]), axis=0, return_inverse=True)
    place = np.full(len(names), -1)
    place[name.ravel()[: len(known)]] = np.arange(len(known))
    return place[name.ravel()[len(known) :]]


class GradientOfSecond(FollowingLists):
    """The pressure that is taken out of accelerations has, for both of a pair, the gradient of the second one.

    Without newton a pair across a boundary is listed twice, once for each particle, which then has its own gradient.
    """

    def pair_terms(self, *fields: Any, **options: Any) -> PairTerms:
        """All terms as they are, and the pressure force kept from exchanged gradients."""
        found, own = super().pair_terms(*fields, **options), self.g
        exchanged_p = (self.forward_p >= 0) & (self.backward_p < 0) & (self.reverse_p >= 0)
        self.g = [where(exchanged_p, -g_a[self.reverse_p], g_a) for g_a in own]
        kept = super().pair_terms(*fields, **options)
        self.g = own
        return replace(found, pressure_force_nc=kept.pressure_force_nc)


class AccelerationsOfOldImages(FollowingLists):
    """Right after lists were rebuilt, slots hold the accelerations of what was in them before, further slots 0."""

    def wall_sums(self, pressure_n: Number, rho_n: Number, acceleration_nc: Number) -> tuple[Number, ...]:
        """Sums as they are, and what other accelerations than the particles' own add to the last."""
        *sums, sum_n = super().wall_sums(pressure_n, rho_n, acceleration_nc)
        if not self.kept_sc.size:  # the set-up: nothing is kept yet
            return *sums, sum_n
        i, j = self.i, self.j
        present = [a_n[j] - a_n[i] for a_n in axes(acceleration_nc)]
        read = axes(self._read())
        wall_p = self.solid_n[i] & ~self.solid_n[j]
        stale_p = wall_p & np.logical_or.reduce([value(a) != b for a, b in zip(present, read, strict=True)])
        change = [where(stale_p, b - a, 0.0) for a, b in zip(present, read, strict=True)]
        return *sums, sum_n + self.total(where(stale_p, self.w * rho_n[j] * dot(change, self.x), 0.0))

    def _read(self) -> FloatArray:
        """Acceleration in the slot of j less that in the slot of i, for every pair; NaN for pairs not in the list."""
        listed = self.lists[self.at]
        new_sc = np.zeros((len(listed.row_s), self.model.dimension))[len(self.kept_sc) :]
        held_sc = np.concatenate([self.kept_sc, new_sc])
        under_i = self.forward_p >= 0
        entry_p = np.where(under_i, self.forward_p, self.backward_p)
        one, other = listed.pair_ps[entry_p].T
        difference_pc = (held_sc[other] - held_sc[one]) * np.where(under_i, 1.0, -1.0)[:, None]
        return np.where(entry_p[:, None] >= 0, difference_pc, np.nan)


class LayerOfFirst(FollowingLists):
    """Bulk beside a surface has the status of a layer only if it is the first of some pair with a surface particle."""

    def meets_as_first(self, surface_n: BoolArray) -> BoolArray:
        """Which particles are the first of a pair with one of some others."""
        return np.bincount(self.i[(self.forward_p >= 0) & surface_n[self.j]], minlength=self.n) > 0


class CountingSteps(Simulation):
    """Steps that tell the stages whose list is in use, and what the slots keep of the accelerations."""

    at: int = 0
    kept_sc: FloatArray = np.zeros((0, 0))

    def evaluate(self) -> dict[str, Any]:
        """With the list of the present step."""
        self.evaluator.at, self.evaluator.kept_sc = self.at, self.kept_sc
        return super().evaluate()

    def step(self, dt: float) -> None:
        """The evaluation at the end of the step uses the next list."""
        self.at += 1
        super().step(dt)

    def keep_forces(self) -> None:
        """Keep accelerations in the slots of the list in use."""
        super().keep_forces()
        self.kept_sc = self.other_nc[self.evaluator.lists[self.at - 1].row_s]
        self.evaluator.kept_sc = self.kept_sc


class StatusOfLayers(CountingSteps):
    """Steps whose status words take the layer from `LayerOfFirst`."""

    def output(self, field: str) -> Any:
        """Fields as they are, with fewer particles in the layer."""
        found = super().output(field)
        if field != "status" or "surface" not in self.fields:
            return found
        met_n = self.evaluator.meets_as_first(value(self.fields["surface"]) == 1)
        return np.where((found == LAYER) & ~met_n, float(BULK), found)
