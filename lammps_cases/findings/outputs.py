"""Findings about what compute rheo/property/atom takes for an attribute."""

from __future__ import annotations

from eos_ref.model.quantities import QUANTITIES
from lammps_cases.findings.entry import Finding

NBOND_SHELL_SEGFAULT = Finding(
    id="nbond-shell-segfault",
    number=38,
    title="Requesting nbond/shell without fix rheo/oxidation causes a segmentation fault",
    severity="medium",
    effect="LAMMPS crashes instead of printing an error message",
    documented="compute rheo/property/atom: nbond/shell is one of the attributes, the number of oxide bonds; many "
    "attributes require that their fixes be defined.",
    observed="Without fix rheo/oxidation, a run with compute rheo/property/atom 'nbond/shell' ends with SIGSEGV. "
    "From 2026.7.4 on it is refused.",
    argument="Other attributes that lack their fix are refused. A crash ends the process, including any program that "
    "uses LAMMPS as a library, without a message; the error would have named the cause.",
    workaround="Request nbond/shell only with fix rheo/oxidation, or use 2026.7.4 or newer.",
    applies_to=("probes.property-nbond-shell",),
    expected_inputs=("compute-*.nbond-shell",),
    outcome="crashed",
    engine_error="SIGSEGV",
)


def is_misspelt(attribute: str) -> bool:
    """Return whether an attribute has more letters for a component than the quantity has axes."""
    stem, _, component = attribute.rpartition("/")
    rank = QUANTITIES[stem].rank if stem in QUANTITIES else 0
    return rank > 0 and component != "*" and len(component) > rank


COMPONENT_NAMES = Finding(
    id="component-names-unchecked",
    number=39,
    title="Only the last letters of a component's name count, and a star next to them overwrites memory",
    severity="medium",
    effect="A misspelt component is read as another one, or overwrites memory, without a message",
    documented="compute rheo/property/atom: a component is named by the axis of a vector, both axes of a tensor, or *.",
    observed="Letters before the last one for a vector, and before the last two for a tensor, are ignored: "
    "'grad/v/xyx' is read as yx, 'shift/v/yx' as x. 'grad/v/x*' and 'grad/v/**' count as all components but are "
    "stored as fewer: memory is overwritten, and the process crashes then or later.",
    argument="Other invalid names are refused ('grad/v/x'). A row of a tensor, 'grad/v/x*', is a plausible thing to "
    "try; a run that survives it has overwritten other data.",
    acts=lambda setting: any(is_misspelt(word) for word in setting.shown),
    workaround="Name components by one axis, by two axes, or by * alone.",
    applies_to=("probes.property-component-of-three", "probes.property-component-of-two"),
    expected_inputs=("compute-*.one-component-more",),
    outcome="differs",
    ended="accepted",
)

ENTRIES = (NBOND_SHELL_SEGFAULT, COMPONENT_NAMES)
