"""Findings about reproducing kernels."""

from __future__ import annotations

import numpy as np

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.numbers.number import Array
from eos_ref.numbers.rounded import Decision, Rounded
from lammps_cases.comparison.trajectory import Problem
from lammps_cases.findings.entry import Finding, MapDifference
from lammps_cases.findings.variants import Variant

UNDEFINED = np.inf  # bound of what no reference can predict


class StaleGradient(ArrayEvaluator):
    """Below zmin the gradient is whatever the memory holds: nothing that depends on it can be predicted."""

    def correct(self, rho_n: Array) -> None:
        """Leave the gradients of particles below zmin without a bound."""
        super().correct(rho_n)
        if self.model.corrects_gradients:
            below = self.coordination_n < self.model.fix.zmin
            stale_p = (below.answer | below.open if isinstance(below, Decision) else below)[self.i]
            self.g = [
                Rounded(g_a.value, np.where(stale_p, UNDEFINED, g_a.error)) if isinstance(g_a, Rounded) else g_a
                for g_a in self.g
            ]


def falls_back(problem: Problem) -> bool:
    """Return whether some particle has fewer than zmin neighbours for a reproducing kernel."""
    model = problem.model
    if not model.corrects_gradients:
        return False
    stages = ArrayEvaluator(model, problem.box, problem.state.type_n, problem.state.solid_n)
    stages.move(problem.state.x_nc)
    return bool(np.any(stages.coordination_n < model.fix.zmin))


STALE_GRADIENT_BELOW_ZMIN = Finding(
    id="stale-gradient-below-zmin",
    number=28,
    title="A particle with fewer than zmin neighbours uses memory nobody wrote",
    severity="high",
    documented="fix rheo: if reproducing kernels are requested but a particle has fewer than zmin neighbours, it "
    "will revert to a non-reproducing quintic kernel until it gains more.",
    observed="With RK1 and RK2 the gradient of such a particle is not computed: it holds what an earlier pair, "
    "or an earlier use of the memory, left there. Sums of W do revert to the quintic kernel.",
    argument="Two lone particles with RK1 and zmin 5 have one velocity gradient in a fresh process and another one "
    "after a different scene; neither is that of the quintic kernel. In a free surface, where particles run out of "
    "neighbours, gradients are arbitrary. The variant predicts all particles with zmin neighbours or more, and no "
    "value for the rest.",
    workaround="zmin 0, if every particle has enough neighbours for its matrix, as without a free surface; else the "
    "quintic kernel.",
    scene="two particles, RK1, zmin 5",
    model_variant=Variant(falls_back, StaleGradient, undefined=True),
    expected_in_maps=(
        MapDifference(
            "matrices-zmin",
            "gradients of particles below zmin are memory that nobody wrote, so LAMMPS' end depends on what ran before",
            "RK2 run",
        ),
    ),
)

ENTRIES = (STALE_GRADIENT_BELOW_ZMIN,)
