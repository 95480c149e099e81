"""Findings about the shift of particles."""

from __future__ import annotations

from typing import Any

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.cutoff import rounding_at
from eos_ref.evaluation.evaluator import Evaluator
from eos_ref.evaluation.pairs import separations
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model import quantities
from eos_ref.model.parameters import IntArray
from eos_ref.model.state import State
from eos_ref.numbers.columns import Axes, axes, dot, joined
from eos_ref.numbers.elementary import sqrt, where
from eos_ref.numbers.number import Array
from eos_ref.numbers.rounded import error, value
from lammps_cases.comparison.problem import Problem
from lammps_cases.findings.document import document
from lammps_cases.findings.entry import AlarmDifference, ModelFinding
from lammps_cases.findings.neighbour_lists import CountingSteps, FollowingLists, lists_of_neighbours, unbounded
from lammps_cases.findings.variants import Snapshot, Variant

ROUNDING = 1e-9  # of a shift, below which nothing was removed from it


class SupportTimesDistance(ArrayEvaluator):
    """The same-type support of scale/cross/type sums W r in place of W."""

    def same_type_support(self, other: Any) -> Any:
        """Sum of W r over neighbours of the same type."""
        return self.total(where(other, 0.0, self.w * self.r))


def asks_for_support(problem: Problem) -> bool:
    """Return whether shifting needs support by particles of the same type."""
    shift = problem.model.fix.shift
    if shift is None or shift.scale_cross_type is None or shift.weighs_distance:
        return False
    return shift.scale_cross_type[2] > 0


def any_where_cancelled(normal: Axes, gradient: Axes) -> Axes:
    """Return normals, of undefined direction where only rounding is left of the gradient."""
    cancel_n = np.all([np.abs(value(c)) <= error(c) for c in gradient], axis=0)
    cancel_n &= np.any([error(c) > 0 for c in gradient], axis=0)
    return [unbounded(n, cancel_n) for n in normal]


class ColorMassOfType(FollowingLists):
    """In the gradient of the color function the second of a pair sees the first with the mass of its type."""

    def sloping_volume(self, volume_n: Array) -> Array:
        """Return the volumes, for the first of a pair by the mass of its type."""
        own_p, of_type_n = super().sloping_volume(volume_n), self.of_type(self.model.mass)
        if not self.lists or np.array_equal(of_type_n, self.mass_n):
            return own_p
        return where(self.forward_p >= 0, own_p, (volume_n * (of_type_n / self.mass_n))[self.j])


class NormalOfLastPair(ColorMassOfType):
    """The gradient of the color function takes for all pairs the kernel gradients of the last one in the list.

    There is one for the first of a pair and one for the second; every process has its own list. Where lists were not
    read, ``pair`` holds the indices of that pair, and ``apart`` the displacement from the second to the first when the
    pair was found, which distinguishes images of the second.
    """

    pair: tuple[int, int] = (-1, -1)
    apart: tuple[float, ...] = ()

    def pairs(self, x_nc: FloatArray, cut: float) -> tuple[IntArray, IntArray, FloatArray]:
        """Return the pairs; those at the cutoff, which count like all others, by LAMMPS' own distances."""
        if not self.lists or cut != self.model.cut:
            return super().pairs(x_nc, cut)
        width = rounding_at(cut, x_nc, self.box)
        i, j, shift_pc = super().pairs(x_nc, cut + width)
        r = separations(x_nc, i, j, shift_pc)
        inside, open_ = r < cut, np.flatnonzero(r > cut - width)
        if open_.size:
            listed = self.lists[self.at]
            forward_o, backward_o = self.entries(x_nc, *self.directed(i[open_], j[open_], shift_pc[open_]))
            entry_o = np.where(forward_o < 0, backward_o, forward_o)
            known_o = entry_o >= 0
            one_oc, other_oc = listed.x_sc[listed.pair_ps[entry_o[known_o]].T]
            inside[open_[known_o]] = ((one_oc - other_oc) ** 2).sum(axis=1) <= cut * cut
        return i[inside], j[inside], shift_pc[inside]

    def color_sums(self, volume_n: Array) -> tuple[Axes, Array, Array]:
        """Return the sums, with the gradient left by LAMMPS' loop over its list."""
        own = self.gradw
        self.gradw = self._left() if self.lists else own
        sums = ArrayEvaluator.color_sums(self, volume_n)  # other variants would change the gradients
        self.gradw = own
        return sums

    def _left(self) -> Axes:
        """Return for every pair the gradient of the last pair of its list on the same side."""
        listed, first_p = self.lists[self.at], self.forward_p >= 0
        met_p = ~(self.solid_n[self.i] & self.solid_n[self.j])  # the loop skips pairs of solids
        rank_p = listed.rank_s[listed.pair_ps[np.where(first_p, self.forward_p, self.backward_p), 0]]
        left_p = np.full(len(self.i), -1)
        for rank in np.unique(rank_p):
            last = int(np.argmax(np.where(first_p & met_p & (rank_p == rank), self.forward_p, -1)))
            left_p[rank_p == rank] = np.where(first_p, last, self.reverse_p[last])[rank_p == rank]
        return [where(left_p < 0, 0.0, g_a[left_p]) for g_a in self.g]

    def cross_type_normal(self, gradient: Axes) -> Axes:
        """Return the direction of the sums, undefined where they cancel; without lists that of the pair.

        The pair's direction is that of its present position; 0 until a pair is known.
        """
        if self.lists:
            return any_where_cancelled(super().cross_type_normal(gradient), gradient)
        if self.pair == (-1, -1):
            return [np.zeros(self.n) for _ in self.x]
        here = np.flatnonzero((self.i == self.pair[0]) & (self.j == self.pair[1]))
        if not here.size:  # it has left the cutoff: the new last pair is unknown
            return [np.full(self.n, np.nan) for _ in self.x]
        far_k = sum(
            ((value(x_p)[here] - c) ** 2 for x_p, c in zip(self.x, self.apart, strict=True)), np.zeros(len(here))
        )
        p = int(here[np.argmin(far_k)])
        x = [x_p[p : p + 1] for x_p in self.x]
        size = sqrt(dot(x, x))
        same = np.zeros(self.n, int)
        return [(x_a / size)[same] for x_a in x]


class CorrectedColor(ArrayEvaluator):
    """The gradient of the color function uses the reproducing kernel; the color function itself does not."""

    def color_sums(self, volume_n: Array) -> tuple[Axes, Array, Array]:
        """Return the sums, with the gradient from corrected kernel gradients."""
        own, self.gradw = self.gradw, self.g
        sums = super().color_sums(volume_n)
        self.gradw = own
        return sums

    def cross_type_normal(self, gradient: Axes) -> Axes:
        """Return the direction of the sums, undefined where they cancel."""
        return any_where_cancelled(super().cross_type_normal(gradient), gradient)


class CorrectingFirst(Simulation):
    """Steps that correct gradients whichever fields are compared, as shifts use them too."""

    def _start(self, state: State, evaluator: Evaluator, fields: tuple[str, ...]) -> None:
        super()._start(state, evaluator, fields)
        if self.model.corrects_gradients:
            self.plan = quantities.required(self.model, (*self.fields_needed, "correction"))


class CorrectingShifts(CorrectingFirst, CountingSteps):
    """The same with LAMMPS' own lists."""


def scales_across_types(problem: Problem) -> bool:
    """Return whether shifts are output and scaled along the normal between types."""
    shift = problem.model.fix.shift
    scaled = shift is not None and shift.scale_cross_type is not None and shift.scale_cross_type[0] != 1
    return scaled and "shift/v" in quantities.required(problem.model, problem.wanted)


def corrects_across_types(problem: Problem) -> bool:
    """Return whether shifts are output and scaled along the normal between types, with a reproducing kernel."""
    return problem.model.corrects_gradients and scales_across_types(problem)


def has_masses_across_types(problem: Problem) -> bool:
    """Return whether shifts of particles with their own masses are output and scaled along the normal between types."""
    return problem.state.mass_n is not None and scales_across_types(problem)


def last_pair(problem: Problem, stages: type[ArrayEvaluator], snapshot: Snapshot) -> dict[str, Any] | None:
    """Return LAMMPS' lists; else find the pair whose direction is removed from the shift of the most changed particle.

    With a kernel whose pairs have two gradients no pair can be found.
    """
    if "lists" in snapshot:
        return lists_of_neighbours(problem, stages, snapshot)
    if "shift/v" not in snapshot or problem.model.corrects_gradients:
        return None
    first = problem.steps[0]
    fields = ("shift/v", *(problem.wanted if first else ()))
    sim = Simulation(problem.model, problem.box, problem.state, fields, stages)
    with np.errstate(invalid="ignore"):
        sim.run(first, problem.timestep)
    plain = sim.evaluator
    assert isinstance(plain, ArrayEvaluator)
    unscaled_nc = value(joined(plain.raw_shift(axes(sim.state.v_nc), sim.state.rho_n)))
    moves_n = np.any(snapshot["shift/v"] != 0, axis=1, keepdims=True)
    change_nc = np.where(moves_n, unscaled_nc - snapshot["shift/v"], 0.0)
    change_nc[np.abs(change_nc) < ROUNDING * np.abs(unscaled_nc).max(initial=0.0)] = 0.0
    n_c = change_nc[np.argmax((change_nc**2).sum(axis=1))]
    if not plain.i.size:
        return None
    if not n_c.any():  # nothing was removed from any shift, so that no direction is needed
        return {}
    x_pc = value(joined(plain.x))
    along_p = np.abs(x_pc @ n_c) / np.linalg.norm(x_pc, axis=1)
    p = int(np.argmax(along_p))
    return {"pair": (int(plain.i[p]), int(plain.j[p])), "apart": tuple(x_pc[p].tolist())}


CROSS_TYPE_SUPPORT = ModelFinding(
    **document("cross-type-support"),
    variant=Variant(asks_for_support, SupportTimesDistance),
    acts=lambda setting: asks_for_support(setting.problem),
    replaces=("same_type_support",),
)


CROSS_TYPE_NORMAL = ModelFinding(
    **document("cross-type-normal"),
    variant=Variant(
        scales_across_types,
        NormalOfLastPair,
        CorrectingShifts,
        last_pair,
        undefined=True,
        lists=True,
        changes=("shift/v",),
    ),
    acts=lambda setting: scales_across_types(setting.problem),
    replaces=("cross_type_normal",),
    expected_in_alarms=(
        AlarmDifference(
            ("ranks",),
            lambda problem: problem.rheo.shifting is not None and problem.rheo.shifting.scale_cross_type is not None,
            "on several ranks every particle has its own mixture of directions; neighbour lists are not read here",
        ),
    ),
)

CROSS_TYPE_CORRECTED = ModelFinding(
    **document("cross-type-corrected"),
    variant=Variant(corrects_across_types, CorrectedColor, CorrectingFirst, undefined=True, changes=("shift/v",)),
    acts=lambda setting: corrects_across_types(setting.problem),
)

CROSS_TYPE_MASS_OF_TYPE = ModelFinding(
    **document("cross-type-mass-of-type"),
    variant=Variant(
        has_masses_across_types, ColorMassOfType, CountingSteps, lists_of_neighbours, lists=True, changes=("shift/v",)
    ),
    acts=lambda setting: has_masses_across_types(setting.problem),
)

ENTRIES = (CROSS_TYPE_SUPPORT, CROSS_TYPE_NORMAL, CROSS_TYPE_CORRECTED, CROSS_TYPE_MASS_OF_TYPE)
