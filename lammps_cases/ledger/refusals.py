"""Findings about input: what LAMMPS refuses, accepts or does not survive."""

from __future__ import annotations

from lammps_cases.ledger.entry import ALL, Entry

ENTRIES: tuple[Entry, ...] = (
    Entry(
        id="no-pressure-segfault",
        title="Asking for the pressure without fix rheo/pressure ends in a segmentation fault",
        severity="medium",
        documented="fix rheo, Restrictions: must be used in conjunction with fix rheo/pressure.",
        observed="Without fix rheo/pressure a run is refused with 'Missing fix rheo/pressure', unless a compute "
        "rheo/property/atom asks for the pressure: then the run ends in SIGSEGV before that check.",
        argument="The same omission gives an error or a crash depending on whether it is looked at. A crash loses "
        "the output buffers and, where LAMMPS is a library, the host program; the error would have named the cause.",
        workaround="Define fix rheo/pressure before the first run.",
        cases=("refused.no-fix-pressure-read",),
        engines=ALL,
        outcome="crashed",
        outcome_text="SIGSEGV",
    ),
    Entry(
        id="stress-without-pressure-segfault",
        title="Asking for stress/t without the pressure ends in a segmentation fault",
        severity="medium",
        documented="compute rheo/property/atom: inputs may be given in any combination; stress/t is the total stress.",
        observed="'compute rheo/property/atom stress/t' ends in SIGSEGV, unless pressure is another input of the "
        "same compute.",
        argument="The total stress contains the pressure, and nothing documents that it has to be asked for as well. "
        "A crash loses the output buffers and, where LAMMPS is a library, the host program.",
        workaround="Name pressure among the inputs of the same compute.",
        cases=("strain.unasked.*",),
        engines=ALL,
        outcome="crashed",
        outcome_text="SIGSEGV",
    ),
    Entry(
        id="self-mass-missing",
        title="The keyword self/mass does not exist",
        severity="medium",
        documented="fix rheo, syntax: rho/sum takes the optional argument self/mass, with which a particle uses its "
        "own mass in the summation; an example has it too.",
        observed="'rho/sum self/mass' is refused: 'Illegal fix rheo command: self/mass'. No order of the words, nor "
        "the spelling rhosum of the manual's example, is accepted.",
        argument="Two fluids of different particle masses need it: with sum m_j W_ij the density of a particle of "
        "mass 1.5 beside one of mass 0.7 comes out at 0.903 where its own mass gives 0.954, an error of 5 % that the "
        "equation of state multiplies by c^2.",
        workaround="Equal masses of all types, or densities by continuity.",
        cases=("undocumented.self-mass",),
        engines=ALL,
        outcome="refused",
        outcome_text="Illegal fix rheo command: self/mass",
    ),
    Entry(
        id="exclude-takes-one-range",
        title="shift exclude/type takes one range, not a list of types",
        severity="low",
        documented="fix rheo, syntax: exclude/type values = types, types = list of types.",
        observed="'shift exclude/type 1 2' is refused: 'Illegal fix rheo command: 2'. One range (n, m*n, *) is "
        "accepted.",
        argument="Types 1 and 3 of three cannot be excluded together, as no range holds just these two.",
        workaround="Order the types so that those excluded are adjacent, and write a range.",
        cases=("undocumented.exclude-list",),
        engines=ALL,
        outcome="refused",
        outcome_text="Illegal fix rheo command: 2",
    ),
    Entry(
        id="reconstruct-refuses-cubic",
        title="interface/reconstruct refuses the cubic law, even for the fluid alone",
        severity="low",
        documented="fix rheo and fix rheo/pressure: no law is excluded from interface/reconstruct.",
        observed="If any type has the style cubic, a run with interface/reconstruct ends with 'RHEO interface "
        "reconstruction incompatible with pressure equation of state'.",
        argument="The reconstruction needs the inverse of the solid's law only; for A3 > 0 the cubic is monotone and "
        "has one. A fluid with a cubic law over linear walls needs no inverse of it at all.",
        workaround="tait/general with an exponent of the same curvature, or linear.",
        cases=("undocumented.walls-cubic", "undocumented.fluid-cubic"),
        engines=ALL,
        outcome="refused",
        outcome_text="incompatible with pressure equation of state",
    ),
    Entry(
        id="double-star-abort",
        title="A type range of two stars aborts the process",
        severity="low",
        documented="fix rheo/pressure, description of types: the forms are *, n, *n, m* and m*n.",
        observed="Other malformed ranges are refused ('Invalid range string'); '**' ends in SIGABRT with an uncaught "
        "std::invalid_argument.",
        argument="A mistyped argument is an input error like any other. An abort cannot be caught by a program that "
        "uses LAMMPS as a library, and no message names the line of the input.",
        workaround="Write a single star.",
        cases=("refused.range-two-stars",),
        engines=ALL,
        outcome="crashed",
        outcome_text="SIGABRT",
    ),
    Entry(
        id="hyphen-range-accepted",
        title="A type range with a hyphen is taken for its first number",
        severity="medium",
        documented="fix rheo/pressure, description of types: the forms are *, n, *n, m* and m*n.",
        observed="'1-2 linear' sets the law of type 1 alone, without a message; '* linear 1-2 tait/water' leaves "
        "type 2 linear. Only if type 2 has no law at all is the command refused, for that reason.",
        argument="A user who writes 1-2 means both types. A law silently dropped for one of them changes its "
        "stiffness by any factor, while '1;2' or '0*' are refused as invalid.",
        workaround="Write 1*2.",
        cases=("refused.range-hyphen",),
        engines=ALL,
        outcome="differs",
        outcome_text="accepts what the manual refuses",
    ),
    Entry(
        id="unknown-style-misnamed",
        title="The error for an unknown pressure style names the types instead",
        severity="low",
        documented="fix rheo/pressure, syntax: pstyle is one of linear, tait/water, tait/general, cubic, ideal/gas, "
        "background.",
        observed="'* taitwater' is refused with 'Illegal fix command, *'; from 2025.7.22.2.0 on the message names "
        "taitwater.",
        argument="The types '*' are legal and the style is not: the message points at the wrong word of the command.",
        workaround="Look at the word after the one that the message names.",
        cases=("refused.unknown-style",),
        engines=("2025.7.22.0.1", "2025.7.22.1.0"),
        outcome="differs",
        outcome_text="Illegal fix command, *",
    ),
)
