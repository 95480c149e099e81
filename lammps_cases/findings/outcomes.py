"""Findings that no variant reproduces: how LAMMPS ends on an input, and sentences that measurements refute.

LAMMPS refuses, accepts or does not survive an input contrary to the manual; or a small deck measures a number other
than the one stated. In the second case the reference computes what LAMMPS does, as published or for want of another
definition: the sentence is wrong, or incomplete.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from eos_ref.model.quantities import QUANTITIES
from lammps_cases.comparison.problem import Problem
from lammps_cases.findings.document import document
from lammps_cases.findings.entry import MapDifference, OutcomeFinding

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


def corrects_nothing(problem: Problem) -> bool:
    """Return whether sums of a reproducing kernel are those of the quintic spline."""
    fix = problem.model.fix
    return fix.kernel == "RK0" or (problem.model.corrects_gradients and fix.rho_sum)


def pulls_walls(problem: Problem) -> bool:
    """Return whether solids are reconstructed next to fluid of less than its equilibrium density."""
    state, model = problem.state, problem.model
    rare_n = (state.rho_n < model.rho0[state.type_n - 1]) & ~state.solid_n
    return model.fix.interface_reconstruct and bool(state.solid_n.any() and rare_n.any())


def sums_solids(problem: Problem) -> bool:
    """Return whether the densities of solids are summed, which should stay as they are."""
    fix = problem.model.fix
    return fix.rho_sum and not fix.interface_reconstruct and bool(problem.state.solid_n.any())


def is_misspelt(attribute: str) -> bool:
    """Return whether an attribute has more component letters than the quantity has axes."""
    stem, _, component = attribute.rpartition("/")
    rank = QUANTITIES[stem].rank if stem in QUANTITIES else 0
    return rank > 0 and component != "*" and len(component) > rank


HYPHEN_RANGE_ACCEPTED = OutcomeFinding(
    **document("hyphen-range-accepted"),
    applies_to=("refused.range-hyphen",),
    expected_inputs=("range-with-hyphen", "*.types*.hyphen", "*.exclude.hyphen"),
    outcome="differs",
    ended="accepted",
)

GAS_WITHOUT_WORK = OutcomeFinding(
    **document("gas-without-work"),
    acts=lambda setting: setting.problem.model.eos.needs_energy,
    applies_to=("probes.sound-gas-adiabatic",),
    outcome="differs",
    ended="answered",
    differing="adiabatic speed of sound",
)

ENTRIES: tuple[OutcomeFinding, ...] = (
    OutcomeFinding(
        **document("no-pressure-segfault"),
        applies_to=("refused.no-fix-pressure-read",),
        outcome="crashed",
        engine_error="SIGSEGV",
    ),
    OutcomeFinding(
        **document("stress-without-pressure-segfault"),
        applies_to=("strain.unasked.*",),
        ends=_without_pressure,
        refuses=r"^SIGSEGV\n.*\ncompute \S+ \S+ rheo/property/atom (?![^\n]*\bpressure\b)[^\n]*stress/t",
        outcome="crashed",
        engine_error="SIGSEGV",
    ),
    OutcomeFinding(
        **document("self-mass-missing"),
        applies_to=("undocumented.self-mass*", "edges-newton.self-mass*", "probes.rheo-self-mass-keyword"),
        ends=_own_mass,
        expected_inputs=("self-mass-alone",),
        expected_in_maps=(MapDifference("phases", "LAMMPS refuses the keyword", "rho/sum self/mass"),),
        refuses=r"Illegal fix rheo command: self/mass",
        outcome="refused",
        engine_error="Illegal fix rheo command: self/mass",
    ),
    OutcomeFinding(
        **document("exclude-takes-one-range"),
        applies_to=("undocumented.exclude-list",),
        ends=_second_range,
        refuses=r"Illegal fix rheo command: ([\d*]+) .*exclude/type \S+ \1 ",
        outcome="refused",
        engine_error="Illegal fix rheo command: 2",
    ),
    OutcomeFinding(
        **document("reconstruct-refuses-cubic"),
        applies_to=("undocumented.walls-cubic", "undocumented.fluid-cubic"),
        ends=_cubic_beside_walls,
        refuses=r"incompatible with pressure equation of state.*\nfix \S+ \S+ rheo/pressure [^\n]*\bcubic ",
        outcome="refused",
        engine_error="incompatible with pressure equation of state",
    ),
    OutcomeFinding(
        **document("double-star-abort"),
        applies_to=("refused.range-two-stars",),
        expected_inputs=(
            "range-of-two-stars",
            *("*.types*.two-stars*", "*.exclude.two-stars*", "*.types*.three-stars", "*.exclude.three-stars"),
            *("*.types*.hyphen-alone", "*.exclude.hyphen-alone", "*.types*.empty", "*.exclude.empty"),
        ),
        outcome="crashed",
        engine_error="SIGABRT",
    ),
    OutcomeFinding(
        **document("long-range-abort"),
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
    OutcomeFinding(
        **document("unknown-style-misnamed"),
        applies_to=("refused.unknown-style",),
        outcome="differs",
        ended="refused",
        engine_error="Illegal fix command, *",
    ),
    OutcomeFinding(
        **document("specific-heat-zero"),
        applies_to=("probes.specific-heat-zero",),
        expected_inputs=("specific-heat-zero", "fix-rheo-thermal.needed.specific-heat.*zero"),
        outcome="differs",
        ended="accepted",
        accepts=("specific/heat",),
    ),
    OutcomeFinding(
        **document("example-surface-detection"),
        applies_to=("examples.rheo-2",),
        refuses=r"surface/detection command: missing argument",
        outcome="refused",
        engine_error="surface/detection command: missing argument",
    ),
    OutcomeFinding(
        **document("example-rhosum"),
        applies_to=("examples.rheo-3",),
        refuses=r"Illegal fix rheo command: rhosum",
        outcome="refused",
        engine_error="Illegal fix rheo command: rhosum",
    ),
    OutcomeFinding(
        **document("style-taitwater"),
        applies_to=("probes.pressure-taitwater",),
        outcome="refused",
        engine_error="Illegal fix command",
    ),
    OutcomeFinding(
        **document("speed-sound-count"),
        applies_to=("probes.rheo-sound-cs0-to-csn",),
        outcome="refused",
        engine_error="Illegal fix rheo command",
    ),
    OutcomeFinding(
        **document("cubic-unit"),
        applies_to=("probes.pressure-unit-a3",),
        outcome="differs",
        ended="answered",
        differing="pressure",
    ),
    OutcomeFinding(
        **document("support-unit"),
        applies_to=("probes.rheo-unit-wmin",),
        outcome="differs",
        ended="answered",
        differing="q",
    ),
    OutcomeFinding(
        **document("data-file-of-walls"),
        applies_to=("runs-walls.*.data",),
        ends=_section_of_walls,
        refuses=r"Unknown identifier in data file: rheo_interface_fix_property_atom",
        outcome="refused",
        engine_error="Unknown identifier in data file: rheo_interface_fix_property_atom",
    ),
    OutcomeFinding(
        **document("nbond-shell-segfault"),
        applies_to=("probes.property-nbond-shell",),
        expected_inputs=("compute-*.nbond-shell",),
        refuses=r"^SIGSEGV\n(?!.* rheo/oxidation ).* nbond/shell\b",
        outcome="crashed",
        engine_error="SIGSEGV",
    ),
    OutcomeFinding(
        **document("component-names-unchecked"),
        acts=lambda setting: any(is_misspelt(word) for word in setting.shown),
        applies_to=("probes.property-component-of-three", "probes.property-component-of-two"),
        expected_inputs=("compute-*.one-component-more",),
        outcome="differs",
        ended="accepted",
    ),
    OutcomeFinding(
        **document("kernel-corrects-gradients-only"),
        acts=lambda setting: corrects_nothing(setting.problem),
        applies_to=("probes.order-zero.rk0", "probes.order-zero-3d.rk0", "probes.sum-of-constant.*"),
        outcome="differs",
        ended="answered",
        differing="error of a constant field",
    ),
    OutcomeFinding(
        **document("no-mass-diffusion"),
        applies_to=("probes.density-diffuses",),
        outcome="differs",
        ended="answered",
        differing="part of a density profile that has diffused",
    ),
    OutcomeFinding(
        **document("solids-summed"),
        acts=lambda setting: sums_solids(setting.problem),
        applies_to=("probes.solid-density-summed",),
        outcome="differs",
        ended="answered",
        differing="density of a solid",
    ),
    OutcomeFinding(
        **document("wall-density-stored"),
        acts=lambda setting: pulls_walls(setting.problem),
        applies_to=("probes.solid-density-floor", "probes.solid-density-temporary"),
        outcome="differs",
        ended="answered",
        differing="density of a solid",
    ),
    OutcomeFinding(
        **document("walls-attract"),
        acts=lambda setting: pulls_walls(setting.problem),
        applies_to=("probes.walls-do-not-attract",),
        outcome="differs",
        ended="answered",
        differing="attraction by a solid",
    ),
    GAS_WITHOUT_WORK,
    OutcomeFinding(
        **document("sum-includes-self"),
        applies_to=("probes.sum-of-neighbours",),
        outcome="differs",
        ended="answered",
        differing="density of a lone particle",
    ),
    OutcomeFinding(
        **document("rmin-unit"),
        applies_to=("probes.rheo-unit-rmin",),
        outcome="differs",
        ended="answered",
        differing="q",
    ),
    OutcomeFinding(
        **document("gas-on-other-atoms"),
        applies_to=("probes.pressure-gas-hybrid",),
        outcome="differs",
        ended="accepted",
    ),
    OutcomeFinding(
        **document("respa-refused"),
        applies_to=("probes.rheo-respa",),
        refuses=r"Missing fix rheo/viscosity.*\nrun_style respa .*\nfix \S+ \S+ rheo/viscosity ",
        outcome="refused",
        engine_error="Missing fix rheo/viscosity",
    ),
    OutcomeFinding(
        **document("pair-cutoff-unsaid"),
        applies_to=("probes.rheo-cut-of-pair",),
        outcome="refused",
        engine_error="does not agree with fix rheo cutoff",
    ),
    OutcomeFinding(
        **document("pressure-takes-one-range"),
        applies_to=("probes.pressure-types-list",),
        refuses=r"Invalid range string: \S+,\S+ .*rheo/pressure ",
        outcome="refused",
        engine_error="Invalid range string: 1,2",
    ),
    OutcomeFinding(
        **document("wall-density-shared"),
        applies_to=("probes.solid-density-of-every-pair",),
        outcome="differs",
        ended="answered",
        differing="force of a solid on a fluid particle",
    ),
    OutcomeFinding(
        **document("range-tail-ignored"),
        applies_to=("refused.range-three-numbers",),
        expected_inputs=(
            *("*.types*.two-ranges", "*.exclude.two-ranges"),
            *("*.types*.star-first-and-last", "*.exclude.star-first-and-last"),
        ),
        outcome="differs",
        ended="accepted",
        accepts=("type range",),
    ),
    OutcomeFinding(
        **document("scales-unchecked"),
        applies_to=("probes.rheo-density-zero", "probes.rheo-density-negative", "probes.rheo-sound-zero"),
        expected_inputs=("fix-rheo.kernel.rho0-*", "fix-rheo.kernel.cs-*"),
        outcome="differs",
        ended="accepted",
        accepts=("density", "speed/sound"),
    ),
    OutcomeFinding(
        **document("law-arguments-unchecked"),
        applies_to=("probes.pressure-tait-general-zero", "probes.pressure-gas-below-1"),
        expected_inputs=("fix-rheo-pressure.tait.gamma.*", "fix-rheo-pressure.gas.gamma-of-a-gas.*"),
        expected_in_maps=(MapDifference("laws-gas-gamma", "the reference refuses a heat capacity ratio of 1 or less"),),
        outcome="differs",
        ended="accepted",
        accepts=("gamma of tait/general", "gamma of ideal/gas"),
    ),
    OutcomeFinding(
        **document("power-law-unchecked"),
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
    OutcomeFinding(
        **document("magnitudes-unchecked"),
        applies_to=("probes.pair-damping-negative", "probes.pair-viscosity-negative"),
        expected_inputs=("pair-style-rheo.damped.rho-damp.*", "pair-style-rheo.damped.artificial-visc.*"),
        outcome="differs",
        ended="accepted",
        accepts=("rho_damp of pair rheo", "artificial_viscosity of pair rheo"),
    ),
    OutcomeFinding(
        **document("shiftscale-no-fraction"),
        applies_to=("probes.rheo-shiftscale-negative", "probes.rheo-shiftscale-above-1"),
        expected_inputs=("fix-rheo.scale.shiftscale.*",),
        outcome="differs",
        ended="accepted",
        accepts=("shiftscale",),
    ),
    OutcomeFinding(
        **document("component-stars-crash"),
        acts=lambda setting: any("**" in word for word in setting.shown),
        applies_to=("probes.compute-component-stars",),
        expected_inputs=("compute-*.star-twice",),
        outcome="crashed",
        engine_error="SIG",
    ),
    OutcomeFinding(
        **document("bonds-across-boundary"),
        acts=lambda setting: setting.reacts and any(setting.problem.box.periodic),
        applies_to=("probes.thermal-react-count",),
        outcome="differs",
        ended="answered",
        differing="number of bonds",
    ),
)
