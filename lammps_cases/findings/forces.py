"""Findings about the forces of pairs."""

from __future__ import annotations

import numpy as np

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.numbers.number import Array
from lammps_cases.comparison.trajectory import Problem
from lammps_cases.findings.entry import Finding, MapDifference
from lammps_cases.findings.variants import Variant


class ForcePerVolume(ArrayEvaluator):
    """Pair forces lack the volume of the particle that they act on."""

    def collecting_volume(self, rho_i: Array) -> Array:
        """No volume."""
        return 0 * rho_i + 1.0


def _unit_volumes(problem: Problem) -> bool:
    mass_n = problem.model.mass[problem.state.type_n - 1]
    return bool(np.all(mass_n == problem.state.rho_n)) and not problem.model.fix.rho_sum


def has_forces(problem: Problem) -> bool:
    """Return whether forces show, and particles have, or come to have, volumes other than 1."""
    return problem.steps[-1] > 0 or ("f" in problem.fields and not _unit_volumes(problem))


_VOLUME = "volumes leave 1 as the fluid is compressed or drawn out, and LAMMPS' forces lack the volume m/rho"
FORCE_PER_VOLUME = Finding(
    id="force-per-volume",
    number=17,
    title="Pair forces lack the volume of the particle they act on",
    severity="high",
    documented="pair rheo, as published (Palermo et al. 2024; Clemmer et al. 2024): the pressure force on i is "
    "-sum V_i V_j (P_i + P_j) grad W, the viscous one sum 2 eta V_i V_j (x.grad W)/r^2 v_ij.",
    observed="Since 2025.7.22.2.0 the factor V_i = m_i/rho_i is missing from the pressure, viscous and artificial "
    "viscous force on i: the array f holds a force per volume and is divided by the mass all the same. The "
    "accelerations are wrong by the factor 1/V_i; nothing shows where every volume is 1.",
    argument="The forces of a pair no longer cancel: two particles of mass 1 and densities 1.4 and 1.35 at distance 1 "
    "(2D, cutoff 3, linear law with rho0 = c = 1) feel -0.12948 and +0.12486 in place of -0.09249 and +0.09249, so "
    "the pair accelerates itself. The factor depends on the resolution: with half the spacing in 2D, a quarter of each "
    "mass, it is 4 times larger, while the acceleration by gravity stays right.",
    workaround="Choose masses and the unit of length so that m/rho0 is 1 for every type; the factor rho/rho0 remains.",
    scene="two particles of volume other than 1",
    model_variant=Variant(has_forces, ForcePerVolume),
    replaces=("collecting_volume",),
    expected_in_maps=(
        MapDifference("tension", _VOLUME, "shift"),
        MapDifference("phases", _VOLUME, "continuity"),
        MapDifference("wall-thickness", _VOLUME),
        MapDifference("wall-stiffness", _VOLUME),
        MapDifference("wall-viscosity", _VOLUME),
        MapDifference("dam-break", _VOLUME),
        MapDifference("column", _VOLUME),
        MapDifference("falling-drop", _VOLUME),
        MapDifference("summed-surface", _VOLUME, "rho/sum"),
    ),
)

ENTRIES = (FORCE_PER_VOLUME,)
