"""How each part of the findings' workarounds is run: a part is a line of that section of the document."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Scene:
    """Changes of the finding's scene, each of them effective; other findings that show in it."""

    changes: tuple[Mapping[str, Any], ...]
    beside: tuple[str, ...] = ()


@dataclass(frozen=True)
class Deck:
    """Edits of the finding's deck."""

    edits: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Orders:
    """Commands before the last run of the finding's deck: orders that are effective, and orders that are not."""

    good: tuple[str, ...]
    bad: tuple[str, ...] = ()


@dataclass(frozen=True)
class Test:
    """A test of the texts that runs it, as ``file::function`` without ``test_texts_``."""

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
# Without a run after read_restart nothing is removed, independent of where fixes are defined and removed.
STAYS = (
    "write read pair define remove define others",
    "write read pair rheo remove_rheo define others",
    "write read rheo remove_rheo pair define others",
    "write read pair rheo remove_rheo rheo remove_rheo define others",
)
BEGUN_AGAIN = Orders(("remove define",), ("",))
BEFORE_WRITING = Orders(("remove define write read pair define others",), ("write read pair define others",))
AFTER_READING = Orders(("write read pair define others run remove define",), STAYS)

WORKAROUNDS: dict[str, tuple[How, ...]] = {
    "no-pressure-segfault": (Test("refusals::test_no_pressure_segfault"), VERSIONS),
    "stress-without-pressure-segfault": (Test("refusals::test_stress_without_pressure_segfault"), VERSIONS),
    "self-mass-missing": (Test("refusals::test_self_mass_missing"), Test("refusals::test_self_mass_missing"), VERSIONS),
    "exclude-takes-one-range": (Test("refusals::test_exclude_takes_one_range"),),
    "reconstruct-refuses-cubic": (
        Test("refusals::test_reconstruct_refuses_cubic"),
        Test("refusals::test_reconstruct_refuses_cubic"),
    ),
    "double-star-abort": (Test("refusals::test_double_star_abort"),),
    "long-range-abort": (Test("refusals::test_long_range_abort"),),
    "hyphen-range-accepted": (Test("refusals::test_hyphen_range_accepted"),),
    "unknown-style-misnamed": (Test("refusals::test_unknown_style_misnamed"),),
    "specific-heat-zero": (Test("refusals::test_specific_heat_zero"), VERSIONS),
    "example-surface-detection": (Test("refusals::test_examples_of_the_manual"),),
    "example-rhosum": (Test("refusals::test_examples_of_the_manual"),),
    "style-taitwater": (Test("refusals::test_style_taitwater"),),
    "speed-sound-count": (Test("refusals::test_speed_sound_count"),),
    "cubic-unit": (Test("refusals::test_cubic_unit"),),
    "support-unit": (Test("refusals::test_support_unit"),),
    "force-per-volume": (Scene(({"rho": {"values": [1.0, 1.0]}},)), Test("rates::test_unit_volumes_leave_a_factor")),
    "wall-velocity-lost": (Test("walls::test_wall_velocity_lost"), Test("walls::test_wall_at_rest_and_fluid_driven")),
    "heat-is-temperature-rate": (Test("rates::test_heat_with_another_conductivity"),),
    "heat-over-density": (Test("rates::test_heat_over_density"),),
    "temperature-without-mass": (Test("rates::test_temperature_without_mass"), VERSIONS),
    "cross-type-support": (Test("particles::test_wmin_times_the_mean_distance"),),
    "cross-type-normal": (VERSIONS, Test("particles::test_exclude_type_is_not_affected")),
    "walls-summed-after-setup": (Test("walls::test_walls_summed_after_setup"),),
    "walls-after-rebuild": (Scene(({"engine": {"check": True}},)), Test("walls::test_walls_after_rebuild")),
    "layer-depends-on-pair-order": (Test("particles::test_layer_depends_on_pair_order"),),
    "walls-depend-on-pair-order": (Test("walls::test_walls_depend_on_pair_order"), VERSIONS),
    "stale-gradient-below-zmin": (Scene(({"rheo": {"zmin": 0}},)), Scene((QUINTIC,))),
    "boundary-pairs-twice": (Test("exchange::test_the_other_settings_are_right"),),
    "units-unconverted": (Scene(UNITS),),
    "density-by-force-factor": (
        Scene(UNITS),
        Test("units::test_sums_have_no_rates_and_the_volumes_of_numbers_as_they_stand"),
    ),
    "harmonic-mean-undefined": (Test("rates::test_harmonic_means"), Test("rates::test_harmonic_means")),
    "walls-begin-with-pressure": (
        CONTINUED,
        BEGUN_AGAIN,
        BEFORE_WRITING,
        AFTER_READING,
        Test("walls_at_stops::test_forces_kept_right_after_a_stop_next_to_a_wall"),
    ),
    "data-file-of-walls": (Test("refusals::test_data_file_of_walls"),),
    "walls-begin-with-parts": (CONTINUED, BEGUN_AGAIN, BEFORE_WRITING, AFTER_READING),
    "virial-of-places": (
        NoCommand("a choice of what to compare"),
        Scene((QUINTIC, QUINTIC | OTHER_VOLUMES), ("force-per-volume",)),
    ),
    "kernel-wendland-c4": (
        NoCommand("all other cases have them"),
        Test("kernels::test_surfaces_have_the_spline_with_another_factor"),
    ),
    "nbond-shell-segfault": (Test("outputs::test_nbond_shell_segfault"), VERSIONS),
    "component-names-unchecked": (Test("outputs::test_component_names_unchecked"),),
    "kernel-corrects-gradients-only": (
        Deck((("RK0", "RK1"),)),
        Test("statements::test_kernel_corrects_gradients_only"),
    ),
    "no-mass-diffusion": (Test("statements::test_no_mass_diffusion"),),
    "solids-summed": (Deck(((" rho/sum", ""),)), Test("walls::test_walls_summed_after_setup")),
    "wall-density-stored": (
        Test("statements::test_a_density_set_again_after_interface_reconstruct"),
        Test("statements::test_walls_attract"),
    ),
    "walls-attract": (Deck((("* linear", "* linear * background 1.0"),)),),
    "gas-without-work": (Test("statements::test_gas_without_work"),),
    "sum-includes-self": (Test("statements::test_sum_includes_self"),),
    "rmin-unit": (NEWER,),
    "gas-on-other-atoms": (NoCommand("there is nothing to work around"),),
    "respa-refused": (Test("statements::test_respa_refused"),),
    "pair-cutoff-unsaid": (Deck((("pair_style rheo 2.9", "pair_style rheo 3.0"),)),),
    "pressure-takes-one-range": (Test("statements::test_pressure_takes_one_range"),),
    "wall-density-shared": (
        Deck(
            (
                ("single 6 8 0 units box", "single 6 9 0 units box"),
                (
                    "single 6 4 0 units box",
                    "single 6 3 0 units box\n"
                    + "\n".join(f"create_atoms 2 single 6 {y} 0 units box" for y in (4, 5, 7, 8)),
                ),
            )
        ),
    ),
    "range-tail-ignored": (Test("inputs::test_range_tail_ignored"),),
    "scales-unchecked": (ARGUMENTS,),
    "law-arguments-unchecked": (ARGUMENTS,),
    "power-law-unchecked": (ARGUMENTS,),
    "magnitudes-unchecked": (ARGUMENTS,),
    "shiftscale-no-fraction": (ARGUMENTS,),
    "component-stars-crash": (Test("inputs::test_component_stars_crash"),),
    "virials-cancel": (Test("virials::test_pressure_of_a_fluid_at_rest"), NoCommand("there is no workaround")),
    "mass-of-first": (
        Test("masses::test_one_of_a_pair_has_the_mass_of_the_other"),
        Scene(({"mass": {"values": [1.25, 1.25]}},)),
    ),
    "gas-of-mass-of-type": (Test("masses::test_the_pressure_of_a_gas"), VERSIONS),
    "sound-of-mass-of-type": (Test("masses::test_the_sound_of_a_gas"),),
    "created-with-forces-of-others": (Test("walls_at_stops::test_created_with_forces_of_others"),),
    "images-left-behind": (
        Test("exchange::test_the_error_of_a_step_shrinks_with_the_square_of_its_length"),
        Scene(({"evolve": {"deform": None, "stops": [{"at": 1, "stretch": {"x": 1.05}}]}},)),
    ),
    "cross-type-corrected": (NEWER,),
    "cross-type-mass-of-type": (NEWER,),
    "bonds-across-boundary": (
        Test("statements::test_bonds_across_a_boundary"),
        Test("statements::test_bonds_across_a_boundary"),
    ),
    "aligned-pairs-twice": (
        Scene(({"engine": {"newton": False}},)),
        Test("exchange::test_which_pairs_are_close_and_aligned"),
    ),
    "special-bonds-remove-pairs": (
        Deck((("coul 0 1 1", "coul 1 1 1"),)),
        Deck((("lj 0 1 1 coul 0 1 1", "lj 1e-9 1 1 coul 0 1 1"),)),
    ),
}
