"""Findings about what compute rheo/property/atom takes for an attribute."""

from __future__ import annotations

from lammps_cases.findings.entry import Finding

NBOND_SHELL_SEGFAULT = Finding(
    id="nbond-shell-segfault",
    number=38,
    title="Asking for nbond/shell without fix rheo/oxidation ends in a segmentation fault",
    severity="medium",
    effect="LAMMPS crashes in place of an error message",
    documented="compute rheo/property/atom: nbond/shell is one of the attributes, the number of oxide bonds; many "
    "attributes require that their fixes be defined.",
    observed="Without fix rheo/oxidation a run with compute rheo/property/atom 'nbond/shell' ends in SIGSEGV. From "
    "2026.7.4 on it is refused.",
    argument="Other attributes that lack their fix are refused. A crash ends the process, and with it a program that "
    "uses LAMMPS as a library, without a message; the error would have named the cause.",
    workaround="Ask for nbond/shell only with fix rheo/oxidation, or use 2026.7.4 or newer.",
    applies_to=("probes.property-nbond-shell",),
    expected_inputs=("compute-*.nbond-shell",),
    outcome="crashed",
    engine_error="SIGSEGV",
)

COMPONENT_NAMES = Finding(
    id="component-names-unchecked",
    number=39,
    title="Only the last letters of a component's name count, and a star beside them overwrites memory",
    severity="medium",
    effect="A misspelt component is taken for another one, or overwrites memory, without a message",
    documented="compute rheo/property/atom: a component is named by the axis of a vector, both axes of a tensor, or *.",
    observed="Letters in front of the last one of a vector, and the last two of a tensor, are passed over: "
    "'grad/v/xyx' is yx, 'shift/v/yx' is x. 'grad/v/x*' and 'grad/v/**' count as all components but are stored as "
    "fewer: memory is overwritten, and the process dies then or later.",
    argument="A name that is none is refused elsewhere ('grad/v/x'). A row of a tensor, 'grad/v/x*', is what somebody "
    "may well try; a run that survives it has written over other data.",
    workaround="Name components by one axis, by two, or by * alone.",
    applies_to=("probes.property-component-of-three", "probes.property-component-of-two"),
    expected_inputs=("compute-*.one-component-more",),
    outcome="differs",
    ended="accepted",
)

ENTRIES = (NBOND_SHELL_SEGFAULT, COMPONENT_NAMES)
