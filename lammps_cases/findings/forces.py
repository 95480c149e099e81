"""Findings about the forces of pairs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.model import quantities
from eos_ref.model.parameters import IntArray
from eos_ref.model.state import masses
from eos_ref.numbers.elementary import where
from eos_ref.numbers.number import Array
from eos_ref.numbers.rounded import Rounded, error, value
from lammps_cases.comparison.problem import Problem
from lammps_cases.findings.document import document
from lammps_cases.findings.entry import Gap, MapDifference, ModelFinding, multiplied
from lammps_cases.findings.neighbour_lists import UNDEFINED, CountingSteps, FollowingLists, lists_of_neighbours
from lammps_cases.findings.variants import Variant

if TYPE_CHECKING:
    from lammps_cases.scene import Scene


class ForcePerVolume(ArrayEvaluator):
    """Pair forces lack the volume of the particle that they act on."""

    def collecting_volume(self, rho_i: Array) -> Array:
        """Return no volume."""
        return 0 * rho_i + 1.0


def has_masses(problem: Problem) -> bool:
    """Return whether neighbours may have individual masses that differ."""
    mass_n = problem.state.mass_n
    return mass_n is not None and bool(np.ptp(mass_n))


def _unit_volumes(problem: Problem) -> bool:
    mass_n, fix, s = masses(problem.model, problem.state), problem.model.fix, problem.state
    alike = bool(np.all(mass_n == s.rho_n)) and not has_masses(problem)
    walls = fix.interface_reconstruct and bool(s.solid_n.any())  # whose densities follow from the fluid
    return alike and not fix.rho_sum and not walls


def has_forces(problem: Problem) -> bool:
    """Return whether forces or virials are output, and volumes are, or become, other than 1."""
    shown = "f" in quantities.required(problem.model, problem.fields)
    return problem.steps[-1] > 0 or (shown and not _unit_volumes(problem))


def force_factors(problem: Problem) -> list[float]:
    """Return, by type, the ratio of a force to its correct value at the equilibrium density; 1 for gases.

    Particles with individual masses are left out.
    """
    model, state = problem.model, problem.state
    if state.mass_n is not None:
        return []
    of_type = [state.rho_n[state.type_n == t] for t, _ in enumerate(model.mass_t, 1)]
    return [
        (float(np.median(rho_n)) if law.needs_energy and rho_n.size else law.rho0) / mass
        for law, mass, rho_n in zip(model.eos.laws, model.mass_t, of_type, strict=True)
    ]


_VOLUME = "volumes deviate from 1 as the fluid is compressed or stretched, and LAMMPS' forces lack the volume m/rho"
FORCE_PER_VOLUME = ModelFinding(
    **document("force-per-volume"),
    applies_to=("probes.sound.*", "probes.sound-3d"),
    outcome="differs",
    ended="answered",
    differing="speed of sound",
    variant=Variant(has_forces, ForcePerVolume, changes=("f", "stress/atom", "virial", "press")),
    acts=lambda setting: multiplied("forces of pairs", force_factors(setting.problem)),
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
        MapDifference("matrices-row", _VOLUME, "RK1 run"),
    ),
)


def _lacks_a_coefficient(scene: Scene) -> bool:
    return any(0 in (t.conductivity, getattr(t.viscosity, "eta", t.viscosity)) for t in scene.types)


class MeanOfZeros(ArrayEvaluator):
    """The harmonic mean of two coefficients that are 0 is NaN.

    A run that continues has no bound: after a step positions are NaN, and LAMMPS decides which pairs remain.
    """

    goes_on: bool = False

    def mean(self, of_i: Array, of_j: Array) -> Array:
        """Return the mean, or NaN."""
        zeros, mean = (value(of_i) == 0) & (value(of_j) == 0), super().mean(of_i, of_j)
        if not self.goes_on:
            return where(zeros, np.nan, mean)
        rounded = isinstance(self.r, Rounded)  # coefficients may still be constants
        return Rounded(value(mean), np.where(zeros, UNDEFINED, error(mean))) if rounded else mean


def has_means_of_zeros(problem: Problem) -> bool:
    """Return whether harmonic means are taken and some viscosity or conductivity is 0."""
    model = problem.model
    thin = any(law.eta == 0 for law in model.viscosity)
    insulating = any(each.conductivity == 0 for each in model.thermal or ())
    return model.pair.harmonic_means and (thin or insulating)


HARMONIC_MEAN_UNDEFINED = ModelFinding(
    **document("harmonic-mean-undefined"),
    applies_to=("probes.pair-harmonic-of-zeros", "probes.pair-harmonic-of-zero-conductivities"),
    outcome="refused",
    engine_error="Non-numeric atom coords",
    variant=Variant(
        has_means_of_zeros,
        MeanOfZeros,
        fit=lambda problem, *_: {"goes_on": problem.goes_on},
        undefined=True,
        changes=("f", "heatflow"),
    ),
    gaps=(
        Gap(
            lambda scene: scene.pair.harmonic_means and scene.evolve is not None and _lacks_a_coefficient(scene),
            "after a step positions are NaN, and which pairs remain is up to LAMMPS",
        ),
    ),
)


class MassOfFirst(FollowingLists):
    """In the terms of a pair both particles have the mass of the one that is listed first."""

    def pair_masses(self) -> tuple[Array, Array]:
        """Return that mass twice."""
        first = where(self.forward_p >= 0, self.mass_n[self.i], self.mass_n[self.j])
        return first, first


MASS_OF_FIRST = ModelFinding(
    **document("mass-of-first"),
    variant=Variant(
        has_masses, MassOfFirst, CountingSteps, lists_of_neighbours, lists=True, changes=("f", "drho", "heatflow")
    ),
    acts=lambda setting: has_masses(setting.problem),
)


class ListedPairs(FollowingLists):
    """Pairs that are not in LAMMPS' list are not neighbours."""

    def pairs(self, x_nc: FloatArray, cut: float) -> tuple[IntArray, IntArray, FloatArray]:
        """Return the directed pairs in the list that are closer than a cutoff."""
        i, j, shift_pc = super().pairs(x_nc, cut)
        if not self.lists:
            return i, j, shift_pc
        forward_p, backward_p = self.entries(x_nc, *self.directed(i, j, shift_pc))
        listed = (forward_p >= 0) | (backward_p >= 0)
        return i[listed], j[listed], shift_pc[listed]


SPECIAL_BONDS_REMOVE_PAIRS = ModelFinding(
    **document("special-bonds-remove-pairs"),
    applies_to=("probes.pair-special-bonds",),
    outcome="differs",
    ended="answered",
    differing="neighbours of a bonded particle",
    variant=Variant(
        lambda problem: problem.unlists_bonded,
        ListedPairs,
        CountingSteps,
        lists_of_neighbours,
        lists=True,
        changes=("pairs", "rho"),
    ),
    acts=lambda setting: setting.problem.unlists_bonded,
)

ENTRIES = (FORCE_PER_VOLUME, HARMONIC_MEAN_UNDEFINED, MASS_OF_FIRST, SPECIAL_BONDS_REMOVE_PAIRS)
