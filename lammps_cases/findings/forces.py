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
from lammps_cases.findings.entry import Finding, Gap, MapDifference, multiplied
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
    """Return whether neighbours may have masses of their own that differ."""
    mass_n = problem.state.mass_n
    return mass_n is not None and bool(np.ptp(mass_n))


def _unit_volumes(problem: Problem) -> bool:
    mass_n, fix, s = masses(problem.model, problem.state), problem.model.fix, problem.state
    alike = bool(np.all(mass_n == s.rho_n)) and not has_masses(problem)
    walls = fix.interface_reconstruct and bool(s.solid_n.any())  # whose densities follow from the fluid
    return alike and not fix.rho_sum and not walls


def has_forces(problem: Problem) -> bool:
    """Return whether forces, or virials made of them, show, and volumes are, or come to be, other than 1."""
    shown = "f" in quantities.required(problem.model, problem.fields)
    return problem.steps[-1] > 0 or (shown and not _unit_volumes(problem))


def force_factors(problem: Problem) -> list[float]:
    """Return, by type, how many times its forces are what they should be at the equilibrium density; gases: as it is.

    Particles with masses of their own are left out.
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
FORCE_PER_VOLUME = Finding(
    id="force-per-volume",
    number=17,
    title="Pair forces lack the volume of the particle they act on",
    severity="high",
    effect="Pressure and viscosity accelerate particles rho/m times too much: 100 times if m/rho is 0.01",
    documented="pair rheo, as published (Palermo et al. 2024; Clemmer et al. 2024): the pressure force on i is "
    "-sum V_i V_j (P_i + P_j) grad W, the viscous one sum 2 eta V_i V_j (x.grad W)/r^2 v_ij.",
    observed="Since 2025.7.22.2.0 the factor V_i = m_i/rho_i is missing from the pressure, viscous and artificial "
    "viscous force on i: the array f holds a force per volume but is still divided by the mass. The accelerations "
    "are wrong by the factor 1/V_i; the error vanishes where every volume is 1.",
    argument="The forces of a pair no longer cancel: two particles of mass 1 and densities 1.4 and 1.35 at distance "
    "1 (2D, cutoff 3, linear law with rho0 = c = 1) feel -0.12948 and +0.12486 instead of -0.09249 and +0.09249, so "
    "the pair accelerates itself. The factor depends on the resolution: at half the spacing in 2D, with a quarter of "
    "each mass, it is 4 times larger, while the acceleration by gravity stays right. Sound travels at c/sqrt(V): "
    "with volumes of 0.64 at 6.25 for c = 5.",
    workaround="Choose masses and the unit of length so that m/rho0 is 1 for every type; the factor rho/rho0 remains.",
    scene="two particles of volume other than 1",
    applies_to=("probes.sound.*", "probes.sound-3d"),
    outcome="differs",
    ended="answered",
    differing="speed of sound",
    model_variant=Variant(has_forces, ForcePerVolume, changes=("f", "stress/atom", "virial", "press")),
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
    """The harmonic mean of two coefficients that are 0 is no number.

    In a run that goes on it has no bound: after a step positions are no numbers, and LAMMPS decides which pairs remain.
    """

    goes_on: bool = False

    def mean(self, of_i: Array, of_j: Array) -> Array:
        """Return the mean, or no number."""
        zeros, mean = (value(of_i) == 0) & (value(of_j) == 0), super().mean(of_i, of_j)
        if not self.goes_on:
            return where(zeros, np.nan, mean)
        rounded = isinstance(self.r, Rounded)  # coefficients may be constants all the same
        return Rounded(value(mean), np.where(zeros, UNDEFINED, error(mean))) if rounded else mean


def has_means_of_zeros(problem: Problem) -> bool:
    """Return whether harmonic means are taken and some viscosity or conductivity is 0."""
    model = problem.model
    thin = any(law.eta == 0 for law in model.viscosity)
    insulating = any(each.conductivity == 0 for each in model.thermal or ())
    return model.pair.harmonic_means and (thin or insulating)


HARMONIC_MEAN_UNDEFINED = Finding(
    id="harmonic-mean-undefined",
    number=32,
    title="Two coefficients of 0 with harmonic/means make forces and heat flows NaN",
    severity="medium",
    effect="Forces become NaN and atoms are lost if two viscosities or conductivities are 0",
    documented="pair rheo: harmonic/means averages viscosities and conductivities harmonically; a viscosity or "
    "conductivity of 0 is allowed.",
    observed="The mean is evaluated as 2ab/(a + b): NaN for two particles whose viscosities, or conductivities, are "
    "both 0, and so is every force, or heat flow, of particles that have such a neighbour; positions are lost in the "
    "next step. Where the product ab exceeds the range of doubles, as for two of 1e200, the mean is infinite, and "
    "for two of 1e-200 it is 0.",
    argument="The harmonic mean of two equal numbers is that number, 0 included: between two particles of viscosity "
    "0 no viscous force acts, as in LAMMPS itself with arithmetic means, and with harmonic means of 0 and 1.",
    workaround="Leave out harmonic/means, or use a viscosity and conductivity as small as 1e-100 instead of 0.",
    applies_to=("probes.pair-harmonic-of-zeros", "probes.pair-harmonic-of-zero-conductivities"),
    outcome="refused",
    engine_error="Non-numeric atom coords",
    scene="two particles with viscosity 0 and harmonic/means",
    model_variant=Variant(
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


MASS_OF_FIRST = Finding(
    id="mass-of-first",
    number=61,
    title="With per-particle masses, both particles of a pair get the mass of the first one listed",
    effect="Forces and heat flows between particles of unequal rmass are wrong by the ratio of their masses",
    severity="high",
    documented="pair rheo, as published: forces, density damping and heat exchange of a pair go with the volumes "
    "m/rho of both particles; fix property/atom: rmass gives every particle its own mass, which replaces that of its "
    "type; neigh_modify and newton must not change the physics.",
    observed="In pair rheo the second particle of a pair has the mass of the first, in the order of the neighbour "
    "list: in the pressure, viscous and artificial forces, in rho/damp and in the heat flow. Everything else (summed "
    "densities, gradients, kernels, shift but for the normal of scale/cross/type, surfaces, walls, temperatures, "
    "accelerations) uses the particle's own mass, and with per-type masses pair rheo does, too.",
    argument="Two particles of masses 2 and 3 and densities 1.4 and 1.35 at distance 1 (2D, cutoff 3, linear law "
    "with rho0 = c = 1) feel -0.388 and 0.250 if these are the masses of two types, and -0.259 and 0.250 if they are "
    "per-particle masses: one has 2/3 of its force. With the two swapped in the list, the heavier one has 3/2 of its "
    "force instead: the neighbour list alone decides. (Both also lack the volume, see force-per-volume.)",
    workaround="Give particles of different mass different types ('mass'), or the same mass to all particles that may "
    "become neighbours.",
    scene="two particles of one type with different rmass",
    model_variant=Variant(
        has_masses, MassOfFirst, CountingSteps, lists_of_neighbours, lists=True, changes=("f", "drho", "heatflow")
    ),
    acts=lambda setting: has_masses(setting.problem),
)


class ListedPairs(FollowingLists):
    """Pairs that are not in LAMMPS' list are no neighbours."""

    def pairs(self, x_nc: FloatArray, cut: float) -> tuple[IntArray, IntArray, FloatArray]:
        """Return the directed pairs closer than a cutoff that the list has."""
        i, j, shift_pc = super().pairs(x_nc, cut)
        if not self.lists:
            return i, j, shift_pc
        forward_p, backward_p = self.entries(x_nc, *self.directed(i, j, shift_pc))
        listed = (forward_p >= 0) | (backward_p >= 0)
        return i[listed], j[listed], shift_pc[listed]


SPECIAL_BONDS_REMOVE_PAIRS = Finding(
    id="special-bonds-remove-pairs",
    number=70,
    title="With LAMMPS' default special_bonds, bonded particles are no neighbours in the fluid",
    severity="medium",
    effect="Bonded particles do not count as neighbours of each other: forces, densities and gradients lack them",
    documented="Howto rheo (4 Jul 2026): unlike typical pair styles, pair rheo ignores the special bond settings, and "
    "determines by the status of particles whether to calculate forces.",
    observed="A pair of particles one, two or three bonds apart, whose weights of special_bonds are 0 for both lj and "
    "coul, as by default, is not in the neighbour list, and missing in coordination numbers, densities, gradients and "
    "forces. Weights above 0 change nothing, as documented, nor does a weight of 0 for one of the two.",
    argument="Three fluid particles within the cutoff, two of them bonded: with 'special_bonds lj 0 1 1 coul 0 1 1' "
    "the bonded ones have 1 neighbour each instead of 2, with 'coul 1 1 1' they have 2. All three are fluid, so that "
    "by their status every pair interacts.",
    workaround="Use 'special_bonds lj 0 1 1 coul 1 1 1', as the page of bond bpm/spring does, or any weight above 0.",
    applies_to=("probes.pair-special-bonds",),
    outcome="differs",
    ended="answered",
    differing="neighbours of a bonded particle",
    scene="two bonded fluid particles and a third one, special_bonds lj 0 1 1 coul 0 1 1",
    model_variant=Variant(
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
