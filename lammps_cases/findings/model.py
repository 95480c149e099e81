"""Findings about the particle model: numbers that differ from what is documented and published."""

from __future__ import annotations

from lammps_cases.findings import neighbour_lists, variants
from lammps_cases.findings.entry import ALL, Entry
from lammps_cases.findings.variants import Variant

# Wheels in which the forces and the heat flow changed.
SINCE_2 = ("2025.7.22.2.0", "2025.7.22.4.0")
BEFORE_2 = ("2025.7.22.0.1", "2025.7.22.1.0")

ENTRIES: tuple[Entry, ...] = (
    Entry(
        id="force-per-volume",
        title="Pair forces lack the volume of the particle they act on",
        severity="high",
        documented="pair rheo, as published (Palermo et al. 2024; Clemmer et al. 2024): the pressure force on i is "
        "-sum V_i V_j (P_i + P_j) grad W, the viscous one sum 2 eta V_i V_j (x.grad W)/r^2 v_ij.",
        observed="Since 2025.7.22.2.0 the factor V_i = m_i/rho_i is missing from pressure, viscous and artificial "
        "viscous force on i: the array f holds a force per volume and is divided by the mass all the same. The "
        "accelerations are wrong by the factor 1/V_i; nothing shows where every volume is 1, as in all example "
        "decks.",
        argument="The forces of a pair no longer cancel: two particles of mass 1 and densities 1.4 and 1.35 feel "
        "-1.10812 and +1.06855 in place of -0.79152 and +0.79152, so the pair accelerates itself. A fluid resolved "
        "twice as finely in 2D (a quarter of each mass) gets 4 times the acceleration from the same pressure field, "
        "while gravity, which multiplies by the mass, stays as it is.",
        workaround="Choose the unit of length so that m/rho0 is 1 for every type.",
        cases=("forces.*",),
        engines=SINCE_2,
        scene="two particles of volume other than 1",
        particles=Variant(variants.has_forces, variants.ForcePerVolume),
    ),
    Entry(
        id="wall-velocity-lost",
        title="interface/reconstruct forgets that a wall moves",
        severity="high",
        documented="fix rheo, interface/reconstruct: densities and velocities of solids are reconstructed to ensure "
        "no-slip boundaries; Takeda et al. 1994, Morris et al. 1997: v_s' = v_s + (v_s - v_f) d_s/d_f.",
        observed="The solid's velocity as the fluid sees it is (v_s - v_f) d_s/d_f: the term v_s is missing. The two "
        "agree for a wall at rest only.",
        argument="A fluid and its container that move together with velocity U must feel no viscous force; LAMMPS "
        "sees the wall at 0 in place of U. A wall moved at U drags the fluid towards U d_s/(d_s + d_f), not U, so "
        "that a Couette flow depends on how the particles of the wall lie. Not Galilean invariant.",
        workaround="Keep walls at rest: choose the frame of the wall, or drive the fluid by addforce.",
        cases=("walls-moving.*",),
        engines=ALL,
        scene="fluid at rest over one row of solid particles that moves",
        particles=Variant(variants.has_moving_walls, variants.WallVelocityLost),
    ),
    Entry(
        id="heat-is-temperature-rate",
        title="The heat flow is a rate of temperature that is added to the energy",
        severity="high",
        documented="fix rheo/thermal: conductivity in power/(length temperature); Cleary & Monaghan 1999: the energy "
        "of a particle changes by sum 2 kappa V_i V_j (T_i - T_j) (x.grad W)/r^2.",
        observed="Since 2025.7.22.2.0 the output heatflow is sum 2 D V_j (T_i - T_j) (x.grad W)/r^2 with D the mean "
        "of kappa/(rho0 cv): the rate of T, for the volume of one particle, at the equilibrium density. It is then "
        "integrated as if it were the rate of the energy of the particle, which is m cv times larger.",
        argument="Where m cv = 2 heat flows half as fast as the conductivity says. Two particles of volumes 2 and 3 "
        "exchange -0.565 and +0.377: energy is not conserved.",
        workaround="Use m = rho0 cv = 1 per type, with the diffusivity for the conductivity.",
        cases=("thermal.*",),
        engines=SINCE_2,
        scene="two particles of different temperature and volume, cv other than 1",
        particles=Variant(variants.has_heat, variants.HeatAsTemperatureRate),
    ),
    Entry(
        id="heat-over-density",
        title="The heat flow of a pair is divided by its mean density",
        severity="high",
        documented="fix rheo/thermal: conductivity in power/(length temperature); Cleary & Monaghan 1999: the energy "
        "of a particle changes by sum 2 kappa V_i V_j (T_i - T_j) (x.grad W)/r^2.",
        observed="Every term of the sum is divided by (rho_i + rho_j)/2. From 2025.7.22.2.0 on the heat flow is "
        "another one (heat-is-temperature-rate).",
        argument="The flow between two particles of volume 2/3 and density 1.5 is 2/3 of what the conductivity says; "
        "the unit of the result is power over density. Water in SI units conducts a thousand times too little.",
        workaround="Give the conductivity times the density.",
        cases=("thermal.*", "thermal-walls.*"),
        engines=BEFORE_2,
        scene="two particles of different temperature and a density other than 1",
        particles=Variant(variants.has_heat, variants.HeatOverDensity),
    ),
    Entry(
        id="temperature-without-mass",
        title="The temperature is taken from the energy of the particle, not per mass",
        severity="high",
        documented="fix rheo/thermal: specific heat in energy/(mass temperature), so T = E/(m cv) for the energy E "
        "of a particle.",
        observed="T = E/cv, while the heat flow changes E and ideal/gas takes E/m for the energy per mass. From "
        "2025.7.22.2.0 on T = E/(m cv).",
        argument="Two particles of masses 2 and 3 with energies 2 and 1 and cv = 1 have T = 1 and 1/3; LAMMPS "
        "reports 2 and 1. A temperature that is measured in experiments depends on how finely the fluid is resolved.",
        workaround="Use masses of 1, or a newer LAMMPS.",
        cases=("thermal.*", "thermal-walls.*"),
        engines=BEFORE_2,
        scene="one particle of mass other than 1",
        particles=Variant(variants.has_heat, variants.TemperatureWithoutMass),
    ),
    Entry(
        id="cross-type-support",
        title="shift scale/cross/type sums W r for the same-type support",
        severity="medium",
        documented="fix rheo, scale/cross/type: W_same = sum W_ij delta_ij over particles of the same type.",
        observed="The sum that is compared with wmin is sum W_ij r_ij delta_ij.",
        argument="wmin is documented without dimension beyond that of W, yet the sum has one of length more: at "
        "twice the spacing, everything else scaled, shifting goes on and off at other particles. The nearest "
        "neighbours, which support most, count least.",
        workaround="Multiply wmin by the mean distance of neighbours weighted by W, about 0.4 times the cutoff.",
        cases=("cross-type.*",),
        engines=ALL,
        scene="two types in disorder, wmin of half the full support",
        particles=Variant(variants.asks_for_support, variants.SupportTimesDistance),
    ),
    Entry(
        id="cross-type-normal",
        title="shift scale/cross/type uses one direction for all interfaces",
        severity="high",
        documented="fix rheo, scale/cross/type: a color function estimates the local interfacial normal; shifting "
        "along it is scaled by shiftscale.",
        observed="The direction that is scaled is the same for all particles: that of the pair that LAMMPS' loop "
        "over neighbours ended with. Now and then a particle has it to 9 digits only, as if it were multiplied by a "
        "sum with both signs and divided by it again. With RK1 and RK2, whose pairs have two gradients, and on several "
        "ranks every particle has a mixture of its own, which no variant reproduces.",
        argument="A flat interface normal to x and one normal to y lose the same component of the shift. Relabelling "
        "the atoms turns the direction, although nothing physical has changed; so does another skin or number of "
        "ranks.",
        workaround="Do not use scale/cross/type; exclude/type is not affected.",
        cases=("cross-type.*",),
        engines=ALL,
        scene="two types in disorder, shiftscale 0",
        particles=Variant(variants.scales_across_types, variants.NormalOfLastPair, fit=variants.last_pair),
    ),
    Entry(
        id="walls-summed-after-setup",
        title="After the set-up of a run solids show a density that was not used",
        severity="low",
        documented="fix rheo, interface/reconstruct: the density of solids is reconstructed for the interaction with "
        "fluid; rho/sum sums densities.",
        observed="With both keywords the densities (and pressures) of solids reported after run 0 are the sums; the "
        "forces of the same step used the reconstructed ones, and every later step reports these.",
        argument="Output and forces of one step belong to different densities: a restart or a check of P(rho) after "
        "run 0 sees a state that the dynamics never had.",
        workaround="Look at solids from the first step on.",
        cases=("walls-summed.*",),
        engines=ALL,
        scene="fluid over solid particles with rho/sum, run 0",
        particles=Variant(variants.sums_walls, stepping=variants.WallsSummedAfterSetup),
    ),
    Entry(
        id="walls-after-rebuild",
        title="Densities of walls are wrong in single steps after neighbour lists are rebuilt",
        severity="high",
        documented="fix rheo, interface/reconstruct: densities of solids follow from the fluid's (Adami et al. "
        "2012), whatever the neighbour lists; neigh_modify: settings of the lists must not change the physics.",
        observed="In a step in which atoms enter or leave the layer of periodic images, the extrapolation to solids "
        "reads accelerations by the slots of images that the new list numbers, while the slots still hold what the old "
        "list had in them: accelerations of other particles. Densities of solids that see fluid through a periodic "
        "boundary are off by up to 1 % in that step, and with them the forces; before the next step the slots are "
        "filled anew, so that only the trajectory keeps the error.",
        argument="The same run with another skin or other rebuild settings has another trajectory. With the "
        "accelerations taken from LAMMPS' own slots, as of the list before, every density is reproduced to rounding, "
        "over 200 steps with 35 changes of the list; slots beyond those of the old list hold zeros. Lists that are "
        "rebuilt with the same images in the same order do no harm.",
        workaround="A large skin, so that lists are rebuilt seldom.",
        cases=("open.walls-after-rebuild",),
        engines=ALL,
        scene="fluid over fixed solids under gravity, periodic along the wall, lists rebuilt every step",
        particles=Variant(
            variants.has_kept_images,
            neighbour_lists.AccelerationsOfOldImages,
            neighbour_lists.CountingSteps,
            variants.lists_of_neighbours,
            lists=True,
        ),
    ),
    Entry(
        id="layer-depends-on-pair-order",
        title="Which particles beside a surface are its layer depends on the order in which pairs are listed",
        severity="low",
        documented="fix rheo, surface/detection: particles are classified as bulk, surface or splash; neigh_modify, "
        "newton and the number of processors must not change the physics. The layer beside a surface is not "
        "documented; its status is listed by compute rheo/property/atom.",
        observed="A bulk particle has the status of the layer (8) only if it is the first of some "
        "pair, in the list, with a surface particle within the cutoff; one that is second in all such pairs keeps the "
        "status of bulk (4), although surface/r of the same step holds its distance.",
        argument="With newton off, or on two ranks, other particles of the same state have the status. With the order "
        "of LAMMPS' own lists every status is predicted; on several ranks these are not read.",
        workaround="surface/r for the layer.",
        cases=("open-layers.*", "power-status.*"),
        engines=ALL,
        scene="a block of fluid beside vacuum",
        particles=Variant(
            variants.shows_layers,
            neighbour_lists.LayerOfFirst,
            neighbour_lists.StatusOfLayers,
            variants.lists_of_neighbours,
            lists=True,
        ),
    ),
    Entry(
        id="walls-depend-on-pair-order",
        title="With RK1 and RK2, densities of walls depend on the order in which pairs are listed",
        severity="medium",
        documented="fix rheo, interface/reconstruct: densities of solids follow from pressure and acceleration of the "
        "fluid (Adami et al. 2012), the acceleration being the one not due to pressure.",
        observed="The pressure force that is taken out of the acceleration is, for the first particle of every pair "
        "in the list, minus that of the second, made with the second particle's gradient; with the quintic kernel the "
        "two are the same. With newton off pairs across a boundary are listed for each particle, which then has its "
        "own gradient, as all have from 2025.7.22.2.0 on.",
        argument="The twins that relabel the atoms or change newton, skin or frame give other densities from step 1 "
        "on, by up to 6e-3: physics must not depend on which of a pair a list names first. With the order of LAMMPS' "
        "own lists every density is reproduced to rounding at every step.",
        workaround="The quintic kernel, or a newer LAMMPS.",
        cases=(
            "walls.reconstructed.rk*",
            "walls-3d.reconstructed.rk*",
            "walls-moving.*.rk1",
            "walls-summed.rk*",
            "thermal-walls.reconstructed.rk1",
            "twins.walls.*",
        ),
        engines=BEFORE_2,
        scene="one solid and three fluid particles, RK1",
        particles=Variant(
            variants.keeps_corrected_forces,
            neighbour_lists.GradientOfSecond,
            neighbour_lists.CountingSteps,
            variants.lists_of_neighbours,
            lists=True,
        ),
    ),
    Entry(
        id="stale-gradient-below-zmin",
        title="A particle with fewer than zmin neighbours uses memory nobody wrote",
        severity="high",
        documented="fix rheo: if reproducing kernels are requested but a particle has fewer than zmin neighbours, it "
        "will revert to a non-reproducing quintic kernel until it gains more.",
        observed="With RK1 and RK2 the gradient of such a particle is not computed: it holds what an earlier pair, "
        "or an earlier use of the memory, left there. Sums of W do revert to the quintic kernel.",
        argument="Two lone particles with RK1 have a velocity gradient of 1e-277 or 3e-321 in a fresh process, and "
        "another one after a different scene. In a free surface, where particles run out of neighbours, forces there "
        "are arbitrary. The variant predicts all particles with zmin neighbours or more, and no value for the rest.",
        workaround="zmin 0, if the fluid has no free surface; else the quintic kernel.",
        cases=("zmin.*",),
        engines=ALL,
        scene="two particles, RK1, zmin 5",
        particles=Variant(variants.falls_back, variants.StaleGradient, undefined=True),
    ),
)
