"""Findings about values and words that have no meaning, and that LAMMPS takes without a word or does not survive."""

from __future__ import annotations

from lammps_cases.findings.entry import Finding, MapDifference

ENTRIES: tuple[Finding, ...] = (
    Finding(
        id="range-tail-ignored",
        number=53,
        title="Stars and digits after the upper number of a type range are ignored",
        severity="low",
        effect="Types after the upper number keep another law, without a message",
        documented="fix rheo/pressure, description of types: the forms are *, n, *n, m* and m*n.",
        observed="'1*1*2' is read as '1*1', '*1*' as '*1' and '1*2*3' as '1*2', without a message: '* linear 1*1*2 "
        "tait/water' leaves type 2 linear.",
        argument="A range of three numbers is a typing error, and '1*x', '1*1x' and '1*1*x' are refused ('Invalid "
        "range string'). What remains of it may omit types that the user meant, and '1*2*3' hides a type that does not "
        "exist.",
        workaround="Write a single star, and at most one number on either side.",
        applies_to=("refused.range-three-numbers",),
        expected_inputs=(
            *("*.types*.two-ranges", "*.exclude.two-ranges"),
            *("*.types*.star-first-and-last", "*.exclude.star-first-and-last"),
        ),
        outcome="differs",
        ended="accepted",
        accepts=("type range",),
    ),
    Finding(
        id="scales-unchecked",
        number=54,
        title="Equilibrium densities and speeds of sound of 0 or below are accepted",
        severity="medium",
        effect="A mistyped density or speed of sound causes NaN or removes the pressure, without a message",
        documented="fix rheo: density gives equilibrium densities and speed/sound speeds of sound; fix rheo/pressure: "
        "Tait's equation divides by the former.",
        observed="'density 1.2 0.0' with tait/water for type 2 is accepted without a message; after three steps "
        "positions, velocities, densities and pressures are NaN. 'density -1.2 0.7' is accepted too, and so is "
        "'speed/sound 0.0 8.0', with which type 1 has no pressure at any density.",
        argument="Densities and speeds of sound are positive by definition; a mass of 0 is refused ('Invalid atom "
        "mass value'). A variable left at 0 ruins the run, or silently removes the pressure of a fluid.",
        workaround="Check that all values of density and speed/sound are positive.",
        applies_to=("probes.rheo-density-zero", "probes.rheo-density-negative", "probes.rheo-sound-zero"),
        expected_inputs=("fix-rheo.kernel.rho0-*", "fix-rheo.kernel.cs-*"),
        outcome="differs",
        ended="accepted",
        accepts=("density", "speed/sound"),
    ),
    Finding(
        id="law-arguments-unchecked",
        number=55,
        title="An exponent of 0 and a heat capacity ratio below 1 are accepted",
        severity="medium",
        effect="A mistyped exponent causes NaN or negative pressures, without a message",
        documented="fix rheo/pressure: tait/general divides by its exponent gamma; gamma of ideal/gas is the heat "
        "capacity ratio.",
        observed="'tait/general 0.0' is accepted without a message; after three steps positions, velocities, densities "
        "and pressures are NaN. With 'ideal/gas 0.5' all pressures are negative, with 'ideal/gas 1.0' they are 0.",
        argument="The formula of tait/general is undefined at 0. A ratio of heat capacities exceeds 1, because the "
        "one at constant pressure includes the work of expansion; below 1 a gas pulls its particles together, and "
        "the square of its speed of sound, gamma (gamma - 1) e, is negative.",
        workaround="Check that gamma is not 0 for tait/general, and above 1 for ideal/gas.",
        applies_to=("probes.pressure-tait-general-zero", "probes.pressure-gas-below-1"),
        expected_inputs=("fix-rheo-pressure.tait.gamma.*", "fix-rheo-pressure.gas.gamma-of-a-gas.*"),
        expected_in_maps=(MapDifference("laws-gas-gamma", "the reference refuses a heat capacity ratio of 1 or less"),),
        outcome="differs",
        ended="accepted",
        accepts=("gamma of tait/general", "gamma of ideal/gas"),
    ),
    Finding(
        id="power-law-unchecked",
        number=56,
        title="Among the arguments of a power law only the viscosity is checked",
        severity="medium",
        effect="A mistyped power law causes NaN or negative viscosities, without a message",
        documented="fix rheo/viscosity: gd0 is a critical strain rate, which avoids divergences; K is the consistency "
        "index. LAMMPS' own error for a negative eta: 'The viscosity must be positive'.",
        observed="'power 0.3 0.05 -20.0 0.5' is accepted without a message, and the viscosities of all particles are "
        "negative after three steps. With 'power 0.3 -0.05 0.2 0.5' positions, velocities, densities and pressures "
        "are NaN.",
        argument="A negative viscosity adds energy to the flow, which is why LAMMPS refuses it as eta; through K it "
        "is just as wrong. A strain rate is not negative, and gd0^n of a negative one is undefined.",
        workaround="Check that gd0 is positive, and that K and n are not negative.",
        applies_to=("probes.viscosity-consistency-negative", "probes.viscosity-rate-negative"),
        expected_inputs=(
            "fix-rheo-viscosity.power.gd0.*",
            "fix-rheo-viscosity.power.K.*",
            "fix-rheo-viscosity.power.n.*",
        ),
        outcome="differs",
        ended="accepted",
        accepts=("K of rheo/viscosity", "gd0 of rheo/viscosity"),
    ),
    Finding(
        id="magnitudes-unchecked",
        number=57,
        title="Negative damping and negative artificial viscosity are accepted",
        severity="medium",
        effect="With a mistyped sign, damping drives the flow, without a message",
        documented="pair_style rheo: rho/damp gives the magnitude of a damping term, artificial/visc that of an "
        "artificial viscosity, which help stabilize simulations.",
        observed="'rho/damp -1.0' is accepted without a message; in two fluids of the same equilibrium density, "
        "densities then spread over a wider range after three steps than without it. With 'artificial/visc -1.0' the "
        "kinetic energy is higher than without it.",
        argument="A magnitude is not negative. With the other sign both terms amplify what they are meant to damp: "
        "diffusion backwards in time is unstable at every wavelength.",
        workaround="Check that both are positive.",
        applies_to=("probes.pair-damping-negative", "probes.pair-viscosity-negative"),
        expected_inputs=("pair-style-rheo.damped.rho-damp.*", "pair-style-rheo.damped.artificial-visc.*"),
        outcome="differs",
        ended="accepted",
        accepts=("rho_damp of pair rheo", "artificial_viscosity of pair rheo"),
    ),
    Finding(
        id="shiftscale-no-fraction",
        number=58,
        title="A shift fraction below 0 or above 1 is accepted",
        severity="low",
        effect="A mistyped fraction reverses or enlarges the shift, without a message",
        documented="fix rheo, syntax: shiftscale = fraction of shifting in normal direction to preserve; description: "
        "0 implies no shifting in the normal direction, 1 no change.",
        observed="'scale/cross/type -0.5 0.05 0.01' is accepted without a message, and so is 'scale/cross/type 1.5 "
        "0.05 0.01': the shift along the normal is reversed, or enlarged by half.",
        argument="A fraction lies between 0 and 1. Below 0, particles are shifted into the other fluid; above 1, the "
        "option that should restrain shifts across an interface enlarges them.",
        workaround="Check that shiftscale lies between 0 and 1.",
        applies_to=("probes.rheo-shiftscale-negative", "probes.rheo-shiftscale-above-1"),
        expected_inputs=("fix-rheo.scale.shiftscale.*",),
        outcome="differs",
        ended="accepted",
        accepts=("shiftscale",),
    ),
    Finding(
        id="component-stars-crash",
        number=59,
        title="Two stars for the components of a vector or tensor cause a crash",
        severity="medium",
        effect="LAMMPS overwrites memory and crashes",
        documented="compute rheo/property/atom: a wild card * includes all components.",
        observed="'grad/v/**' ends with SIGSEGV or SIGABRT because memory was overwritten, and so does 'shift/v/**'.",
        argument="A mistyped argument is an input error like any other: 'grad/v/xq' is refused ('Invalid compute "
        "rheo/property/atom property'). A crash ends any program that uses LAMMPS as a library, without a message, "
        "and overwritten memory may also go unnoticed.",
        workaround="Write a single star.",
        acts=lambda setting: any("**" in word for word in setting.shown),
        applies_to=("probes.compute-component-stars",),
        expected_inputs=("compute-*.star-twice",),
        outcome="crashed",
        engine_error="SIG",
    ),
)
