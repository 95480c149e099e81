"""Findings about input: what LAMMPS refuses, accepts or does not survive."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lammps_cases.findings.entry import Finding, MapDifference

if TYPE_CHECKING:
    from lammps_cases.scene import Scene


def _without_pressure(scene: Scene) -> str:
    return "SIGSEGV" if "stress/t" in scene.compare and "pressure" not in scene.compare else ""


def _own_mass(scene: Scene) -> str:
    return "Illegal fix rheo command: self/mass" if scene.rheo.self_mass else ""


def _second_range(scene: Scene) -> str:
    excluded = scene.rheo.shifting.exclude if scene.rheo.shifting else ()
    return f"Illegal fix rheo command: {excluded[1]}" if len(excluded) > 1 else ""


def _cubic_beside_walls(scene: Scene) -> str:
    cubic = scene.rheo.interface_reconstruct and any(entry.style == "cubic" for entry in scene.pressure)
    return "interface reconstruction incompatible with pressure equation of state" if cubic else ""


def _section_of_walls(scene: Scene) -> str:
    written = scene.evolve is not None and any(stop.by == "data" for stop in scene.evolve.stops)
    return "rheo_interface_fix_property_atom" if written and scene.rheo.interface_reconstruct else ""


HYPHEN_RANGE_ACCEPTED = Finding(
    id="hyphen-range-accepted",
    number=8,
    title="In a type range, a hyphen after a number and the digits behind it are ignored",
    severity="medium",
    effect="Types after the hyphen keep another law, without a message",
    documented="fix rheo/pressure, description of types: the forms are *, n, *n, m* and m*n.",
    observed="'1-2' is read as '1', '1-' as '1', '1-1*2' as '1*2' and '*1-2' as '*1', without a message: '* linear 1-2 "
    "tait/water' leaves type 2 linear. '1-2 linear' alone is refused because type 2 has no law ('Must specify pressure "
    "for atom type 2'), not for the range. A hyphen in front of a number is refused.",
    argument="A user who writes '1-2' means both types, and is not told that one of them has another law; '1;2', "
    "'0*', '-1' and '1*-2' are refused ('Invalid range string').",
    workaround="Write '1*2'.",
    applies_to=("refused.range-hyphen",),
    expected_inputs=("range-with-hyphen", "*.types*.hyphen", "*.exclude.hyphen"),
    outcome="differs",
    ended="accepted",
)

ENTRIES: tuple[Finding, ...] = (
    Finding(
        id="no-pressure-segfault",
        number=1,
        title="Requesting the pressure without fix rheo/pressure causes a segmentation fault",
        severity="medium",
        effect="LAMMPS crashes instead of printing an error message",
        documented="fix rheo, Restrictions: must be used in conjunction with fix rheo/pressure.",
        observed="Without fix rheo/pressure and without pair style rheo, a run is refused with 'Missing fix "
        "rheo/pressure', unless a compute rheo/property/atom requests the pressure: the run then ends with SIGSEGV "
        "before that check. With pair style rheo it is refused in either case ('Need to define fix rheo/pressure').",
        argument="The same omission gives an error or a crash depending on whether the pressure is requested. A "
        "crash ends the process, including any program that uses LAMMPS as a library, without a message; the error "
        "would have named the cause.",
        workaround="Define fix rheo/pressure before the first run; 2026.7.4 or newer refuses the run in all cases.",
        applies_to=("refused.no-fix-pressure-read",),
        outcome="crashed",
        engine_error="SIGSEGV",
    ),
    Finding(
        id="stress-without-pressure-segfault",
        number=2,
        title="Requesting stress/t without the pressure causes a segmentation fault",
        severity="medium",
        effect="LAMMPS crashes when stress/t is requested on its own",
        documented="compute rheo/property/atom: inputs may be given in any combination; stress/t is the total stress.",
        observed="A run with compute rheo/property/atom 'stress/t/*' or 'stress/t/xx' ends with SIGSEGV unless "
        "pressure is also an input of the same compute; requesting it in another compute does not help.",
        argument="The total stress contains the pressure, and no page says that it has to be requested as well. A "
        "crash ends the process, including any program that uses LAMMPS as a library, without a message.",
        workaround="Add pressure to the inputs of the same compute, or use 2026.7.4 or newer.",
        applies_to=("strain.unasked.*",),
        ends=_without_pressure,
        outcome="crashed",
        engine_error="SIGSEGV",
    ),
    Finding(
        id="self-mass-missing",
        number=3,
        title="The keyword self/mass does not exist",
        severity="medium",
        effect="A documented way to sum densities cannot be used",
        documented="fix rheo, syntax: rho/sum takes the optional argument self/mass, with which a particle uses its "
        "own mass in the summation; an example has it too.",
        observed="'rho/sum self/mass' is refused: 'Illegal fix rheo command: self/mass'. No word order is accepted, "
        "and neither is the spelling rhosum of the manual's example.",
        argument="Two fluids with different particle masses need it: with sum m_j W_ij the density of a particle of "
        "mass 1.5 at distance 1 from one of mass 0.7 (2D, cutoff 2.2) is 0.926, while its own mass gives 1.003, an "
        "error of 8 % that a linear law multiplies by c^2.",
        workaround="Give all types the same mass, for which both sums are the same, leave out rho/sum, or use "
        "2026.7.4 or newer.",
        applies_to=("undocumented.self-mass*", "edges-newton.self-mass*", "probes.rheo-self-mass-keyword"),
        ends=_own_mass,
        expected_inputs=("self-mass-alone",),
        expected_in_maps=(MapDifference("phases", "LAMMPS refuses the keyword", "rho/sum self/mass"),),
        outcome="refused",
        engine_error="Illegal fix rheo command: self/mass",
    ),
    Finding(
        id="exclude-takes-one-range",
        number=4,
        title="shift exclude/type takes one range, not a list of types",
        severity="low",
        effect="A command written according to the manual is refused",
        documented="fix rheo, syntax: exclude/type values = types, types = list of types.",
        observed="'shift exclude/type 1 2' is refused: 'Illegal fix rheo command: 2'. One range ('1', '1*2', '*') "
        "is accepted, and the keyword may be repeated.",
        argument="No range contains just types 1 and 3 of three, and the list with which the manual would exclude "
        "them is refused.",
        workaround="Repeat the keyword: 'shift exclude/type 1 exclude/type 3'.",
        applies_to=("undocumented.exclude-list",),
        ends=_second_range,
        outcome="refused",
        engine_error="Illegal fix rheo command: 2",
    ),
    Finding(
        id="reconstruct-refuses-cubic",
        number=5,
        title="interface/reconstruct refuses the cubic law, even for the fluid alone",
        severity="low",
        effect="Walls cannot be reconstructed if any type has a cubic law",
        documented="fix rheo and fix rheo/pressure: no law is excluded from interface/reconstruct.",
        observed="If any type has the style cubic, or had it until a later entry replaced it, a run with "
        "interface/reconstruct ends with 'RHEO interface reconstruction incompatible with pressure equation of "
        "state'.",
        argument="For A3 > 0 the cubic law is monotone, so every pressure corresponds to one density and the "
        "reconstruction is well defined; the reference computes it. Only the solid's law has to be inverted: a fluid "
        "with the cubic law next to linear walls needs no inverse.",
        workaround="Use the style linear, which has the same pressure, slope and curvature at rho0 and differs by "
        "c^2 A3 (rho - rho0)^3; or leave out interface/reconstruct.",
        applies_to=("undocumented.walls-cubic", "undocumented.fluid-cubic"),
        ends=_cubic_beside_walls,
        outcome="refused",
        engine_error="incompatible with pressure equation of state",
    ),
    Finding(
        id="double-star-abort",
        number=6,
        title="A type range whose first star is followed by another one aborts the process",
        severity="low",
        effect="LAMMPS aborts instead of printing an error message",
        documented="fix rheo/pressure, description of types: the forms are *, n, *n, m* and m*n.",
        observed="'1;2', '0*' and 'x' are refused ('Invalid range string'); '**' ends with SIGABRT with an uncaught "
        "std::invalid_argument, as do '***', '1**2', '-' and '\"\"'.",
        argument="A mistyped argument is an input error like any other. An abort ends any program that uses LAMMPS "
        "as a library, and no message names the range.",
        workaround="Write a single star.",
        applies_to=("refused.range-two-stars",),
        expected_inputs=(
            "range-of-two-stars",
            *("*.types*.two-stars*", "*.exclude.two-stars*", "*.types*.three-stars", "*.exclude.three-stars"),
            *("*.types*.hyphen-alone", "*.exclude.hyphen-alone", "*.types*.empty", "*.exclude.empty"),
        ),
        outcome="crashed",
        engine_error="SIGABRT",
    ),
    Finding(
        id="long-range-abort",
        number=7,
        title="A type range with a number of 20 digits aborts the process",
        severity="low",
        effect="LAMMPS aborts instead of printing an error message, or uses another type",
        documented="fix rheo/pressure, description of types: ranges lie within the types 1 to N.",
        observed="With two types, '*3' is refused ('Numeric index 3 is out of bounds'); '*99999999999999999999' ends "
        "with SIGABRT with an uncaught std::out_of_range. A shorter number may be taken modulo 2^32: '*4294967298' "
        "is accepted as '*2'.",
        argument="A number too large for an integer is just another number beyond N. An abort ends any program that "
        "uses LAMMPS as a library, and no message names the range.",
        workaround="Keep the numbers of a range within 1 to N, especially if a variable computes them.",
        applies_to=("refused.range-20-digits",),
        expected_inputs=(
            "range-of-20-digits",
            *("*.types*.*twenty-digits", "*.exclude.*twenty-digits"),
            *("*.types*.*two-to-the-32-and-*", "*.exclude.*two-to-the-32-and-*"),
        ),
        outcome="crashed",
        engine_error="SIGABRT",
    ),
    HYPHEN_RANGE_ACCEPTED,
    Finding(
        id="unknown-style-misnamed",
        number=9,
        title="The error for an unknown pressure style names the types instead",
        severity="low",
        effect="The error message names the wrong word",
        documented="fix rheo/pressure, syntax: pstyle is one of linear, tait/water, tait/general, cubic, ideal/gas, "
        "background.",
        observed="'* taitwater' is refused with 'Illegal fix command, *'; from 2025.7.22.2.0 on the message names "
        "taitwater.",
        argument="The types '*' are legal and the style is not: the message names the wrong word of the command.",
        workaround="Look at the word after the one that the message names.",
        applies_to=("refused.unknown-style",),
        outcome="differs",
        ended="refused",
        engine_error="Illegal fix command, *",
    ),
    Finding(
        id="specific-heat-zero",
        number=10,
        title="A specific heat of 0 is accepted and causes NaN",
        severity="medium",
        effect="Temperatures and energies become NaN, with ideal/gas everything, without a message",
        documented="fix rheo/thermal: the specific heat, by which energies are divided; LAMMPS' own error for a "
        "negative value: 'The specific heat must be positive'.",
        observed="'specific/heat * constant 0.0' is accepted without a message; after three steps temperatures and "
        "energies are NaN. With ideal/gas, whose pressure follows from the energy, so are positions, velocities, "
        "densities and pressures; with the other laws these are right.",
        argument="0 is not positive, and T = e/cv is undefined for it. A variable left at 0 ruins the run, whereas a "
        "negative value is refused immediately.",
        workaround="Give a positive value; 2026.7.4 or newer refuses 0.",
        applies_to=("probes.specific-heat-zero",),
        expected_inputs=("specific-heat-zero", "fix-rheo-thermal.needed.specific-heat.*zero"),
        outcome="differs",
        ended="accepted",
        accepts=("specific/heat",),
    ),
    Finding(
        id="example-surface-detection",
        number=11,
        title="The manual's example of surface/detection is refused",
        severity="low",
        effect="The manual's example cannot be copied",
        documented="fix rheo, second example: 'shift surface/detection coordination 40'.",
        observed="'Illegal fix rheo surface/detection command: missing argument(s)'.",
        argument="The syntax on the same page has three values: a style, a limit and a limit for splashes; the "
        "example lacks the third. LAMMPS follows the syntax: the example is wrong.",
        workaround="Add a limit for splashes: 'surface/detection coordination 40 12'.",
        applies_to=("examples.rheo-2",),
        outcome="refused",
        engine_error="surface/detection command: missing argument",
    ),
    Finding(
        id="example-rhosum",
        number=12,
        title="The manual's example of rho/sum is refused",
        severity="low",
        effect="The manual's example cannot be copied",
        documented="fix rheo, third example: 'rhosum self/mass'.",
        observed="'Illegal fix rheo command: rhosum'.",
        argument="The syntax and the description on the same page call the keyword rho/sum. LAMMPS follows them: the "
        "example is wrong, and would also be refused because of its self/mass (self-mass-missing).",
        workaround="Write 'rho/sum'.",
        applies_to=("examples.rheo-3",),
        outcome="refused",
        engine_error="Illegal fix rheo command: rhosum",
    ),
    Finding(
        id="style-taitwater",
        number=13,
        title="The description names a pressure style that does not exist",
        severity="low",
        effect="The style cannot be written as in the description",
        documented="fix rheo/pressure, description: the options are linear, taitwater and cubic.",
        observed="'* taitwater' is refused: 'Illegal fix command'.",
        argument="The syntax on the same page has tait/water, and three more styles. LAMMPS follows the syntax: the "
        "sentence is wrong.",
        workaround="Write 'tait/water'.",
        applies_to=("probes.pressure-taitwater",),
        outcome="refused",
        engine_error="Illegal fix command",
    ),
    Finding(
        id="speed-sound-count",
        number=14,
        title="The syntax lists one speed of sound too many",
        severity="low",
        effect="A command written according to the syntax is refused",
        documented="fix rheo, syntax: speed/sound values = cs0, ... csN, which are N + 1 values.",
        observed="Three values for two types are refused: 'Illegal fix rheo command'.",
        argument="The description on the same page has one value for each of the N types, and numbers types from 1. "
        "LAMMPS follows the description: the syntax is wrong.",
        workaround="Give one value per type.",
        applies_to=("probes.rheo-sound-cs0-to-csn",),
        outcome="refused",
        engine_error="Illegal fix rheo command",
    ),
    Finding(
        id="cubic-unit",
        number=15,
        title="The documented unit of the cubic prefactor does not fit its formula",
        severity="medium",
        effect="A prefactor converted according to its documented unit gives wrong pressures",
        documented="fix rheo/pressure, syntax: cubic prefactor A3 (pressure/density^2).",
        observed="The cubic term is c^2 A3 (rho - rho0)^3, as in the formula on the same page, so A3 has the unit "
        "1/density^2: in other units the pressures agree if A3 is converted accordingly, and not as the syntax says.",
        argument="c^2 (rho - rho0) is a pressure, so A3 (rho - rho0)^2 is dimensionless. Converting A3 of water from "
        "SI to cgs units according to the syntax makes the cubic term wrong by a factor of ten.",
        workaround="Convert A3 as 1/density^2.",
        applies_to=("probes.pressure-unit-a3",),
        outcome="differs",
        ended="answered",
        differing="pressure",
    ),
    Finding(
        id="support-unit",
        number=16,
        title="The threshold wmin has a unit, although the syntax calls it unitless",
        severity="low",
        effect="In a rescaled scene the shift is turned off for other particles",
        documented="fix rheo, syntax: wmin = minimum local same-type support (unitless).",
        observed="In a fluid of twice the size, with everything else scaled, the same wmin turns off the shift of "
        "other particles.",
        argument="By the formula on the same page, wmin is compared with sum W_ij, and W has the unit 1/volume. What "
        "LAMMPS sums has an additional factor of length (cross-type-support): its unit is 1/length in 2D and "
        "1/length^2 in 3D.",
        workaround="When all lengths grow by a factor s, divide wmin by s in 2D and by s^2 in 3D.",
        applies_to=("probes.rheo-unit-wmin",),
        outcome="differs",
        ended="answered",
        differing="q",
    ),
    Finding(
        id="data-file-of-walls",
        number=34,
        title="A data file written with reconstructed walls cannot be read back",
        severity="low",
        effect="A data file written by LAMMPS cannot be read back",
        documented="fix rheo: no information about this fix is written to restart files; the page does not say that "
        "a data file contains anything about it, or that read_data would have to be told.",
        observed="With interface/reconstruct, write_data adds a section rheo_interface_fix_property_atom, and "
        "read_data stops at it with 'Unknown identifier in data file'.",
        argument="LAMMPS cannot read what it has written. The section belongs to a fix that the user neither defined "
        "nor can define before the atoms are read: fix rheo creates it.",
        workaround="Write the file with 'nofix'.",
        applies_to=("runs-walls.*.data",),
        ends=_section_of_walls,
        outcome="refused",
        engine_error="Unknown identifier in data file: rheo_interface_fix_property_atom",
    ),
)
