"""Commands of the properties: their meaning, and one-line messages for bad ones."""

from __future__ import annotations

import pytest

from eos_ref import InputError
from eos_ref.model.commands import parse_fix_rheo_thermal, parse_fix_rheo_viscosity, parse_pair_style_rheo
from eos_ref.model.parameters import PairRheo, Thermal, Viscosity

VISCOUS, HEATED = "fix 2 all rheo/viscosity ", "fix 5 all rheo/thermal "


def test_commands_of_the_manual() -> None:
    assert parse_pair_style_rheo("pair_style rheo 3.0 rho/damp 1.0 artificial/visc 2.0") == PairRheo(3.0, 2.0, 1.0)
    assert parse_pair_style_rheo("pair_style rheo 3.0 harmonic/means") == PairRheo(3.0, harmonic_means=True)
    assert parse_fix_rheo_viscosity(VISCOUS + "1 constant 1.0 2 power 0.1 5e-4 0.001 0.5", 2) == (
        Viscosity("constant", 1.0),
        Viscosity("power", 0.1, 5e-4, 0.001, 0.5),
    )
    text = HEATED + "conductivity * constant 1 specific/heat * constant 2 Tfreeze 2 constant 3 latent/heat 2 constant 4"
    assert parse_fix_rheo_thermal(text, 2) == (Thermal(1, 2), Thermal(1, 2, 4, 3))
    text = HEATED + "react 1.5 1 conductivity * constant 1 conductivity 2 constant 5 specific/heat * constant 2"
    assert parse_fix_rheo_thermal(text, 2) == (Thermal(1, 2), Thermal(5, 2)), "the last value counts"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("pair_style rheo", "cutoff of pair rheo: is missing"),
        ("pair_style rheo 0", "cutoff of pair rheo: must be positive"),
        ("pair_style RHEO 3.0", "pair style: must be one of rheo"),
        ("pair_style rheo 3.0 rho/damp", "rho/damp of pair rheo: is missing"),
        ("pair_style rheo 3.0 rho/damp -1", r"rho_damp of pair rheo: must be .* not negative, found -1.0 \(pair_style"),
        ("pair_style rheo 3.0 damp 1", "pair_style rheo: takes nothing more, found 'damp'"),
        (VISCOUS, "types and viscosity style: is missing"),
        (VISCOUS + "1 constant 1", "atom type 2: needs a viscosity"),
        (VISCOUS + "* newton 1", "viscosity style: must be one of constant, power"),
        (VISCOUS + "* power 1 1 1", "n of rheo/viscosity power: is missing"),
        (VISCOUS + "* power 1 1 1 -0.5", "n of rheo/viscosity: must not be negative, found -0.5"),
        (HEATED + "conductivity * constant 1", "atom type 1: needs a specific/heat"),
        (HEATED + "conductivity * 1", "style of conductivity: must be one of constant"),
        (HEATED + "conductivity * constant 1 specific/heat * constant 0", "specific/heat: must be positive, found 0.0"),
        (HEATED + "react 0 1", "cut of react: must be positive"),
        (HEATED + "react 1 0", "type of react: must be a bond type"),
        (HEATED + "heat * constant 1", "attribute of rheo/thermal: must be one of"),
    ],
)
def test_bad_commands(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        if text.startswith("pair"):
            parse_pair_style_rheo(text)
        elif text.startswith(VISCOUS):
            parse_fix_rheo_viscosity(text, 2)
        else:
            parse_fix_rheo_thermal(text, 2)
