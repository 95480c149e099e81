"""Every part of the findings' workarounds, in its words, and what runs it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Scene:
    """Changes of the finding's scene, each of which helps; other findings that show in it."""

    changes: tuple[Mapping[str, Any], ...]
    beside: tuple[str, ...] = ()


@dataclass(frozen=True)
class Deck:
    """Edits of the finding's deck."""

    edits: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Orders:
    """Commands before the last run of the finding's deck, each order of which helps; those that do not help."""

    good: tuple[str, ...]
    bad: tuple[str, ...] = ()


@dataclass(frozen=True)
class Test:
    """A test of the texts that runs it, as ``file::function``, ``test_texts_`` left out."""

    __test__ = False
    name: str


@dataclass(frozen=True)
class NoCommand:
    """Why there is nothing to run on this environment's LAMMPS."""

    why: str


How = Scene | Deck | Orders | Test | NoCommand

VERSIONS = Test("versions::test_versions_are_those_on_which_a_finding_was_seen")
ARGUMENTS = NoCommand("to check one's own arguments; the tests of the text run some that are right")
NEWER = NoCommand("the finding is of a newer LAMMPS")
UNITS = tuple({"units": units} for units in ("lj", "si", "cgs", "micro", "nano"))
QUINTIC: dict[str, Any] = {"rheo": {"kernel": "quintic"}}
OTHER_VOLUMES = {"types": [{"mass": 1.2, "rho0": 0.5, "cs": 2.0}] * 2, "rho": {"constant": 0.9, "per_type": None}}
CONTINUED = Scene(({"evolve": {"stops": None}},), ("force-per-volume",))
# Without a run after read_restart nothing is removed, however often and wherever fixes are defined and removed.
STAYS = (
    "write read pair define remove define others",
    "write read pair rheo remove_rheo define others",
    "write read rheo remove_rheo pair define others",
    "write read pair rheo remove_rheo rheo remove_rheo define others",
)
BEGUN_AGAIN = Orders(("remove define",), ("",))
BEFORE_WRITING = Orders(("remove define write read pair define others",), ("write read pair define others",))
AFTER_READING = Orders(("write read pair define others run remove define",), STAYS)

WORKAROUNDS: dict[str, dict[str, How]] = {
    "no-pressure-segfault": {
        "Define fix rheo/pressure before the first run": Test("refusals::test_no_pressure_segfault"),
        "2026.7.4 or newer refuses the run in all cases": VERSIONS,
    },
    "stress-without-pressure-segfault": {
        "Add pressure to the inputs of the same compute": Test("refusals::test_stress_without_pressure_segfault"),
        "use 2026.7.4 or newer": VERSIONS,
    },
    "self-mass-missing": {
        "Give all types the same mass, for which both sums are the same": Test("refusals::test_self_mass_missing"),
        "leave out rho/sum": Test("refusals::test_self_mass_missing"),
        "use 2026.7.4 or newer": VERSIONS,
    },
    "exclude-takes-one-range": {
        "Repeat the keyword: 'shift exclude/type 1 exclude/type 3'": Test("refusals::test_exclude_takes_one_range")
    },
    "reconstruct-refuses-cubic": {
        "Use the style linear, which has the same pressure, slope and curvature at rho0 and differs by c^2 A3 (rho - "
        "rho0)^3": Test("refusals::test_reconstruct_refuses_cubic"),
        "leave out interface/reconstruct": Test("refusals::test_reconstruct_refuses_cubic"),
    },
    "double-star-abort": {"Write a single star": Test("refusals::test_double_star_abort")},
    "long-range-abort": {
        "Keep the numbers of a range within 1 to N, especially if a variable computes them": Test(
            "refusals::test_long_range_abort"
        )
    },
    "hyphen-range-accepted": {"Write '1*2'": Test("refusals::test_hyphen_range_accepted")},
    "unknown-style-misnamed": {
        "Look at the word after the one that the message names": Test("refusals::test_unknown_style_misnamed")
    },
    "specific-heat-zero": {
        "Give a positive value": Test("refusals::test_specific_heat_zero"),
        "2026.7.4 or newer refuses 0": VERSIONS,
    },
    "example-surface-detection": {
        "Add a limit for splashes: 'surface/detection coordination 40 12'": Test(
            "refusals::test_examples_of_the_manual"
        )
    },
    "example-rhosum": {"Write 'rho/sum'": Test("refusals::test_examples_of_the_manual")},
    "style-taitwater": {"Write 'tait/water'": Test("refusals::test_style_taitwater")},
    "speed-sound-count": {"Give one value per type": Test("refusals::test_speed_sound_count")},
    "cubic-unit": {"Convert A3 as 1/density^2": Test("refusals::test_cubic_unit")},
    "support-unit": {
        "When all lengths grow by a factor s, divide wmin by s in 2D and by s^2 in 3D": Test(
            "refusals::test_support_unit"
        )
    },
    "force-per-volume": {
        "Choose masses and the unit of length so that m/rho0 is 1 for every type": Scene(
            ({"rho": {"values": [1.0, 1.0]}},)
        ),
        "the factor rho/rho0 remains": Test("rates::test_unit_volumes_leave_a_factor"),
    },
    "wall-velocity-lost": {
        "Keep walls at rest: use the frame of the wall": Test("walls::test_wall_velocity_lost"),
        "drive the fluid with addforce": Test("walls::test_wall_at_rest_and_fluid_driven"),
    },
    "heat-is-temperature-rate": {
        "Multiply the conductivity by m cv, with the same m/rho0 for every type; the factor rho/rho0 remains": Test(
            "rates::test_heat_with_another_conductivity"
        )
    },
    "heat-over-density": {
        "Multiply the conductivity by rho0, with the same rho0 for every type; the factor rho0 over the mean density "
        "of the pair remains": Test("rates::test_heat_over_density")
    },
    "temperature-without-mass": {
        "Multiply the specific heat by the mass of a particle": Test("rates::test_temperature_without_mass"),
        "use 2025.7.22.2.0 or newer": VERSIONS,
    },
    "cross-type-support": {
        "Multiply wmin by the W-weighted mean distance of neighbours: on a lattice with a cutoff of 3 spacings 0.38 "
        "times the cutoff in 2D and 0.42 times in 3D. Particles close to the threshold may still differ": Test(
            "particles::test_wmin_times_the_mean_distance"
        )
    },
    "cross-type-normal": {
        "Use 2026.7.4 or newer": VERSIONS,
        "exclude/type, which is not affected": Test("particles::test_exclude_type_is_not_affected"),
    },
    "walls-summed-after-setup": {
        "Look at solids after a step, not after run 0": Test("walls::test_walls_summed_after_setup")
    },
    "walls-after-rebuild": {
        "Rebuild lists only when necessary ('neigh_modify check yes', the default)": Scene(
            ({"engine": {"check": True}},)
        ),
        "and rarely, by using a large skin": Test("walls::test_walls_after_rebuild"),
    },
    "layer-depends-on-pair-order": {
        "Define the layer as the bulk particles whose surface/r is less than the cutoff": Test(
            "particles::test_layer_depends_on_pair_order"
        )
    },
    "walls-depend-on-pair-order": {
        "Use the quintic kernel": Test("walls::test_walls_depend_on_pair_order"),
        "2025.7.22.2.0 or newer": VERSIONS,
    },
    "stale-gradient-below-zmin": {
        "Set zmin to 0 if every particle has enough neighbours for its matrix, as without a free surface": Scene(
            ({"rheo": {"zmin": 0}},)
        ),
        "otherwise use the quintic kernel": Scene((QUINTIC,)),
    },
    "boundary-pairs-twice": {
        "Use the same newton setting for pairs and bonds; 'newton on off' is right too": Test(
            "exchange::test_the_other_settings_are_right"
        )
    },
    "units-unconverted": {"Use units lj, si, cgs, micro or nano, which need no conversion": Scene(UNITS)},
    "density-by-force-factor": {
        "Use units lj, si, cgs, micro or nano": Scene(UNITS),
        "Summed densities (rho/sum) have no rates, but are 0.6022 times the right ones (units-unconverted)": Test(
            "units::test_sums_have_no_rates_and_the_volumes_of_numbers_as_they_stand"
        ),
    },
    "harmonic-mean-undefined": {
        "Leave out harmonic/means": Test("rates::test_harmonic_means"),
        "use a viscosity and conductivity as small as 1e-100 instead of 0": Test("rates::test_harmonic_means"),
    },
    "walls-begin-with-pressure": {
        "Continue with 'run N pre no'": CONTINUED,
        "remove all RHEO fixes (unfix) and define them again, before the run": BEGUN_AGAIN,
        "before write_restart": BEFORE_WRITING,
        "after read_restart define them, 'run 0', remove them and define them again: without that run the forces "
        "stay": AFTER_READING,
        "Data files written with 'nofix' are not affected": Test(
            "walls_at_stops::test_what_begins_right_after_a_stop_beside_a_wall"
        ),
    },
    "data-file-of-walls": {"Write the file with 'nofix'": Test("refusals::test_data_file_of_walls")},
    "walls-begin-with-parts": {
        "As for walls-begin-with-pressure: use 'run N pre no'": CONTINUED,
        "remove the RHEO fixes and define them again before the run": BEGUN_AGAIN,
        "before write_restart": BEFORE_WRITING,
        "after read_restart with a 'run 0' before that": AFTER_READING,
    },
    "virial-of-places": {
        "Compare only pressures computed with the same origin": NoCommand("a choice of what to compare"),
        "use the quintic kernel and, where forces lack a volume (force-per-volume), particles of the same "
        "volume": Scene((QUINTIC, QUINTIC | OTHER_VOLUMES), ("force-per-volume",)),
    },
    "kernel-wendland-c4": {
        "Use the documented kernels": NoCommand("all other cases have them"),
        "with wendland/c4, multiply the limit of divergence by 22.76 or 22.92": Test(
            "kernels::test_surfaces_have_the_spline_with_another_factor"
        ),
    },
    "nbond-shell-segfault": {
        "Request nbond/shell only with fix rheo/oxidation": Test("outputs::test_nbond_shell_segfault"),
        "use 2026.7.4 or newer": VERSIONS,
    },
    "component-names-unchecked": {
        "Name components by one axis, by two axes, or by * alone": Test("outputs::test_component_names_unchecked")
    },
    "kernel-corrects-gradients-only": {
        "Use RK1 for gradients": Deck((("RK0", "RK1"),)),
        "and leave out rho/sum where the support is incomplete": Test(
            "statements::test_kernel_corrects_gradients_only"
        ),
    },
    "no-mass-diffusion": {
        "Use rho/damp of pair rheo where diffusion is wanted": Test("statements::test_no_mass_diffusion")
    },
    "solids-summed": {
        "Leave out rho/sum": Deck(((" rho/sum", ""),)),
        "use interface/reconstruct, with which no force is that of the sum": Test(
            "walls::test_walls_summed_after_setup"
        ),
    },
    "wall-density-stored": {
        "Set the densities of solids again before a run without the keyword": Test(
            "statements::test_a_density_set_again_after_interface_reconstruct"
        ),
        "in output use the larger of the density and rho0": Test("statements::test_walls_attract"),
    },
    "walls-attract": {
        "Add a background pressure that keeps the fluid's pressure above 0": Deck(
            (("* linear", "* linear * background 1.0"),)
        )
    },
    "gas-without-work": {
        "Treat the style as an isothermal gas of pressure (gamma - 1) rho e": Test("statements::test_gas_without_work")
    },
    "sum-includes-self": {"Read the sum as including j = i": Test("statements::test_sum_includes_self")},
    "rmin-unit": {"When all lengths grow by a factor s, divide rmin by s in 2D and by s^2 in 3D": NEWER},
    "gas-on-other-atoms": {
        "None is needed; with rheo/thermal the manual is right": NoCommand("there is nothing to work around")
    },
    "respa-refused": {"Use run_style verlet, the default": Test("statements::test_respa_refused")},
    "pair-cutoff-unsaid": {"Give both the same cutoff": Deck((("pair_style rheo 2.9", "pair_style rheo 3.0"),))},
    "pressure-takes-one-range": {
        "Give the law separately for each type: '1 linear 2 linear'": Test("statements::test_pressure_takes_one_range")
    },
    "wall-density-shared": {
        "Make walls between two fluids at least as thick as two cutoffs": Deck(
            (
                ("single 6 8 0 units box", "single 6 9 0 units box"),
                (
                    "single 6 4 0 units box",
                    "single 6 3 0 units box\n"
                    + "\n".join(f"create_atoms 2 single 6 {y} 0 units box" for y in (4, 5, 7, 8)),
                ),
            )
        )
    },
    "range-tail-ignored": {
        "Write a single star, and at most one number on either side": Test("inputs::test_range_tail_ignored")
    },
    "scales-unchecked": {"Check that all values of density and speed/sound are positive": ARGUMENTS},
    "law-arguments-unchecked": {"Check that gamma is not 0 for tait/general, and above 1 for ideal/gas": ARGUMENTS},
    "power-law-unchecked": {"Check that gd0 is positive, and that K and n are not negative": ARGUMENTS},
    "magnitudes-unchecked": {"Check that both are positive": ARGUMENTS},
    "shiftscale-no-fraction": {"Check that shiftscale lies between 0 and 1": ARGUMENTS},
    "component-stars-crash": {"Write a single star": Test("inputs::test_component_stars_crash")},
    "virials-cancel": {
        "Leave newton on for the pressure of the system": Test("virials::test_pressure_of_a_fluid_at_rest"),
        "for stress/atom and what is derived from it there is no workaround": NoCommand("there is none"),
    },
    "mass-of-first": {
        "Give particles of different mass different types ('mass')": Test(
            "masses::test_one_of_a_pair_has_the_mass_of_the_other"
        ),
        "the same mass to all particles that may become neighbours": Scene(({"mass": {"values": [1.25, 1.25]}},)),
    },
    "gas-of-mass-of-type": {
        "Give particles of a gas the mass of their type": Test("masses::test_the_pressure_of_a_gas"),
        "use 2025.7.22.2.0 or newer": VERSIONS,
    },
    "sound-of-mass-of-type": {
        "Give particles of a gas the mass of their type": Test("masses::test_the_sound_of_a_gas")
    },
    "created-with-forces-of-others": {
        "Remove the RHEO fixes (unfix) and define them again after create_atoms": Test(
            "walls_at_stops::test_created_with_forces_of_others"
        )
    },
    "images-left-behind": {
        "Keep the growth of an edge per step small compared with the smoothing length": Test(
            "exchange::test_the_error_of_a_step_shrinks_with_the_square_of_its_length"
        ),
        "change the box between runs with change_box": Scene(
            ({"evolve": {"deform": None, "stops": [{"at": 1, "stretch": {"x": 1.05}}]}},)
        ),
    },
    "cross-type-corrected": {"Use the kernel quintic, whose gradients are not corrected": NEWER},
    "cross-type-mass-of-type": {"Give particles of different mass different types ('mass'), without rmass": NEWER},
    "bonds-across-boundary": {
        "Keep freezing particles away from periodic boundaries": Test("statements::test_bonds_across_a_boundary"),
        "use a later version and count with compute property/local and compute reduce ('inputs local')": Test(
            "statements::test_bonds_across_a_boundary"
        ),
    },
    "aligned-pairs-twice": {
        "Set newton off": Scene(({"engine": {"newton": False}},)),
        "measure lengths in a unit in which particles are further apart than 0.01": Test(
            "exchange::test_which_pairs_are_close_and_aligned"
        ),
    },
    "special-bonds-remove-pairs": {
        "Use 'special_bonds lj 0 1 1 coul 1 1 1', as the page of bond bpm/spring does": Deck(
            (("coul 0 1 1", "coul 1 1 1"),)
        ),
        "any weight above 0": Deck((("lj 0 1 1 coul 0 1 1", "lj 1e-9 1 1 coul 0 1 1"),)),
    },
}
