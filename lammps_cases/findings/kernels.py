"""Findings about reproducing kernels."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from typing import Any

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.blocks import in_blocks
from eos_ref.evaluation.evaluator import PairInput
from eos_ref.kernels.kernel import Kernel
from eos_ref.kernels.quintic import QUINTIC
from eos_ref.kernels.styles import KERNELS
from eos_ref.model.parameters import Model
from eos_ref.model.state import Gradients, PairTerms
from eos_ref.numbers.columns import Axes
from eos_ref.numbers.elementary import maximum
from eos_ref.numbers.number import Array
from eos_ref.numbers.rounded import Decision, Rounded, error, value
from lammps_cases.comparison.problem import Problem
from lammps_cases.findings.document import document
from lammps_cases.findings.entry import Gap, MapDifference, ModelFinding, OutcomeFinding
from lammps_cases.findings.neighbour_lists import (
    UNDEFINED,
    CountingSteps,
    FollowingLists,
    lists_of_neighbours,
    unbounded,
)
from lammps_cases.findings.variants import Snapshot, Variant

Left = tuple[FloatArray, ...]  # components of the gradients that the last pair leaves for its first and second


class StaleGradient(FollowingLists):
    """A gradient that is not computed equals the one that the last pair before it in LAMMPS' list left on its side.

    Without lists, and before the first pair whose gradient is computed, it has no bound.

    Attributes
    ----------
    computed_n : whether the gradients of a particle are computed
    own : gradients of all pairs, as if all were computed
    left : gradients that the last pair leaves; None at first
    """

    computed_n: Any
    own: list[Array]
    left: Left | None = None

    def corrects(self, definite_n: Any) -> Any:
        """Remember the particles whose gradients are computed."""
        self.computed_n = super().corrects(definite_n)
        return self.computed_n

    def corrected_gradients(self, h: list[Array]) -> None:
        """Remember the gradients of all pairs."""
        super().corrected_gradients(h)
        self.own = self.g

    def gradients(self, *fields: Any, **options: Any) -> Gradients:
        """Return the gradients of fields, from the gradients of LAMMPS' loop over its list."""
        self._loop()
        return super().gradients(*fields, **options)

    def pair_terms(self, fields: PairInput) -> PairTerms:
        """Return all terms, from the gradients of LAMMPS' loop over its list."""
        if not self.exchanged:
            self._loop()
        return super().pair_terms(fields)

    def _loop(self) -> None:
        """Set the gradients to those in a loop over the list, and keep those left at its end."""
        if not self.model.corrects_gradients:
            return
        computed_p = Decision.of(self.computed_n)[self.i]
        if not self.lists:
            stale_p = ~computed_p.answer | computed_p.open
            self.g = [unbounded(g_a, stale_p) for g_a in self.own]
            return
        left = np.full((2, len(self.own)), np.nan) if self.left is None else np.array(self.left)  # NaN: unknown
        g = [(value(g_a).copy(), np.array(error(g_a))) for g_a in self.own]
        for side, entry_p in enumerate((self.forward_p, self.backward_p)):
            at = np.flatnonzero(entry_p >= 0)
            at = at[np.argsort(entry_p[at])]
            writes = computed_p.answer[at] | computed_p.open[at]
            last = np.maximum.accumulate(np.where(writes, np.arange(len(at)), -1)) + 1  # 0: what was left before
            start = UNDEFINED if np.isnan(left[side]).any() else 0.0
            known = np.concatenate([[start], np.where(computed_p.open[at], UNDEFINED, 0.0)])[last]
            used = (self.forward_p[at] >= 0) == (side == 0)
            for a, g_a in enumerate(self.own):
                values = np.concatenate([np.nan_to_num(left[side, a : a + 1]), value(g_a)[at]])[last]
                errors = np.concatenate([[0.0], error(g_a)[at]])[last] + known
                g[a][0][at[used]], g[a][1][at[used]] = values[used], errors[used]
                if len(at):
                    left[side, a] = np.nan if known[-1] else values[-1]
        self.left = tuple(left)
        self.g = [
            Rounded(*parts) if isinstance(g_a, Rounded) else parts[0] for parts, g_a in zip(g, self.own, strict=True)
        ]


class LeavingGradients(CountingSteps):
    """Steps that pass to an evaluation the gradients left by earlier loops."""

    evaluator: StaleGradient
    before: Left | None = None

    def evaluate(self) -> dict[str, Any]:
        """Start with the gradients left before, also in other stages that evaluate the same state again."""
        stages = self.evaluator
        stages.left = self.before if stages.left is None else stages.left
        self.before = stages.left
        return super().evaluate()


def lists_if_read(problem: Problem, stages: type[ArrayEvaluator], snapshot: Snapshot) -> dict[str, Any]:
    """Return LAMMPS' list at every step; empty if they were not read, as in an audit."""
    return lists_of_neighbours(problem, stages, snapshot) or {}


def falls_back(problem: Problem) -> bool:
    """Return whether a particle has fewer than zmin neighbours or a matrix without factor, or may get there."""
    model = problem.model
    if not model.corrects_gradients:
        return False
    if problem.steps[-1] > 0 and not all(problem.box.periodic):
        return True
    state = problem.state
    stages = in_blocks(ArrayEvaluator, len(state.x_nc))(model, problem.box, state.type_n, state.solid_n)
    stages.move(state.x_nc)
    stages.correct(state.rho_n)
    return not stages.corrected_n.all()


def _factor(dimension: int, h: float) -> float:
    cut = 3 * h
    return 9 / (math.pi * cut**2) if dimension == 2 else 495 / (32 * math.pi * cut**3)


def _shape(q: Any) -> Any:
    u = q / 3
    a = maximum(1 - u, 0.0)
    return (a * a * a) * (a * a * a) * (1 + 6 * u + 35 / 3 * (u * u))


def _slope(q: Any) -> Any:
    u = q / 3
    a = maximum(1 - u, 0.0)
    return -56 / 9 * u * (1 + 5 * u) * ((a * a) * (a * a) * a)


# Wendland, Adv. Comput. Math. 4, 389 (1995); Dehnen & Aly, MNRAS 425, 1068 (2012), table 1. LAMMPS' h is cut/3 here.
WENDLAND_C4 = Kernel("Wendland C4", support=3.0, factor=_factor, shape=_shape, slope=_slope)


class _WendlandModel(Model):
    """A model with Wendland's kernel, whatever its style."""

    @property
    def kernel(self) -> Kernel:
        """Return the kernel of most sums."""
        return WENDLAND_C4


class WendlandC4(ArrayEvaluator):
    """Wendland's C4 kernel; surfaces and walls have the quintic spline with Wendland's factors.

    The slope of surfaces lacks the factor 3 of cut/h in addition.
    """

    def __post_init__(self) -> None:
        self.model = _WendlandModel(**{f.name: getattr(self.model, f.name) for f in fields(self.model)})
        super().__post_init__()

    def move(self, x_nc: Array) -> None:
        """Find the pairs, and evaluate both kernels."""
        super().move(x_nc)
        model, q = self.model, self.r / self.model.h
        sigma = self.constant(WENDLAND_C4.normalisation(model.dimension, model.cut))
        self.spline = sigma * QUINTIC.shape(q)
        slope = sigma / model.cut * QUINTIC.slope(q)
        self.spline_slope = [slope * x_p / self.r for x_p in self.x]

    def surface_sums(self, rho_n: Array) -> tuple[Axes, Array]:
        """Return the sums of the spline."""
        own, self.gradw = self.gradw, self.spline_slope
        sums = super().surface_sums(rho_n)
        self.gradw = own
        return sums

    def wall_sums(self, pressure_n: Array, rho_n: Array, acceleration_nc: Array) -> tuple[Array, ...]:
        """Return the sums of the spline."""
        own, self.w = self.w, self.spline
        sums = super().wall_sums(pressure_n, rho_n, acceleration_nc)
        self.w = own
        return sums


STALE_GRADIENT_BELOW_ZMIN = ModelFinding(
    **document("stale-gradient-below-zmin"),
    variant=Variant(
        falls_back,
        StaleGradient,
        LeavingGradients,
        lists_if_read,
        undefined=True,
        lists=True,
        changes=("grad/v", "grad/rho", "grad/energy", "heatflow", "drho", "f"),
    ),
    acts=lambda setting: falls_back(replace(setting.problem, steps=(0,))),
    gaps=(
        Gap(
            lambda scene: KERNELS[scene.rheo.kernel].corrects_gradients and scene.rheo.zmin > 0,
            "on several ranks lists are not read, and before the first computed gradient nothing is known",
        ),
    ),
    expected_in_maps=(
        MapDifference(
            "matrices-zmin",
            "gradients of particles below zmin are uninitialised memory, so the outcome of LAMMPS depends on what "
            "ran before",
            "RK2 run",
        ),
        MapDifference(
            "matrices-surface",
            "matrices cannot be factorised, or rounding decides whether they can, and LAMMPS uses gradients of other "
            "pairs",
            "RK1 run",
        ),
    ),
)

KERNEL_WENDLAND_C4 = OutcomeFinding(
    **document("kernel-wendland-c4"),
    applies_to=("probes.rheo-kernel-wendland",),
    outcome="differs",
    ended="accepted",
    accepts=("kstyle",),
)

ENTRIES = (STALE_GRADIENT_BELOW_ZMIN, KERNEL_WENDLAND_C4)
