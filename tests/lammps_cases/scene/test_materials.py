"""Atom types, and entries of fix rheo/pressure with one argument or none."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from eos_ref import EOS, resolve
from eos_ref.syntax.fixes import PressureEntry
from lammps_cases.scene.particles import AtomType, LawSettings, PowerLaw, entries


@pytest.mark.parametrize(
    ("law", "value", "needs_energy"),
    [
        ({"style": "linear"}, None, False),
        ({"style": "cubic", "A3": 2.5}, 2.5, False),
        ({"style": "tait/water"}, None, False),
        ({"style": "tait/general", "gamma": 3.0}, 3.0, False),
        ({"style": "ideal/gas", "gamma": 1.4}, 1.4, True),
        ({"style": "background", "P_b": -0.5}, -0.5, False),
    ],
)
def test_entry_has_the_argument_of_its_style(law: dict[str, Any], value: float | None, needs_energy: bool) -> None:
    settings = LawSettings(types="1*2", **law)
    assert (settings.value, settings.needs_energy) == (value, needs_energy)
    assert settings.entry == PressureEntry("1*2", law["style"], value)


@pytest.mark.parametrize(
    ("law", "rule"),
    [
        ({"style": "linear", "gamma": 7.0}, "linear does not take gamma"),
        ({"style": "cubic"}, "cubic needs A3"),
        ({"style": "cubic", "A3": 1.0, "P_b": 0.0}, "cubic does not take P_b"),
        ({"style": "tait/general", "A3": 1.0}, "tait/general does not take A3"),
        ({"style": "background"}, "background needs P_b"),
        ({"style": "cubic", "A3": float("nan")}, "must be a finite number, found nan"),
        ({"style": "tait"}, "Input should be 'linear'"),
    ],
)
def test_entry_refuses_other_arguments(law: dict[str, Any], rule: str) -> None:
    with pytest.raises(ValidationError, match=rule):
        LawSettings(types=1, **law)


@pytest.mark.parametrize(
    "law",
    [
        EOS("linear", 1.0, 1.0),
        EOS("cubic", 1.0, 1.0, 2.5),
        EOS("tait/general", 1.0, 1.0, 3.0, background=0.5),
        EOS("ideal/gas", parameter=1.4, background=-0.5),
    ],
)
def test_entries_of_a_law_resolve_to_it_for_all_types(law: EOS) -> None:
    settings = [LawSettings(**entry) for entry in entries(law)]
    assert len(settings) == 1 + bool(law.background)
    assert list(resolve([each.entry for each in settings], 2)) == [law, law]


def test_viscosity_is_a_number_or_a_power_law() -> None:
    law = {"eta": 0.1, "gd0": 0.2, "K": 0.3, "n": 0.7}
    assert AtomType(mass=1.0).viscosity == 0.1, "the manual's default of this harness"
    assert AtomType(mass=1.0, viscosity=0.0).viscosity == 0.0
    assert AtomType.model_validate({"mass": 1.0, "viscosity": law}).viscosity == PowerLaw(**law)
    for wrong in (-0.1, "thick", law | {"gd0": 0.0}, law | {"K": -1.0}, {"eta": 0.1}):
        with pytest.raises(ValidationError):
            AtomType.model_validate({"mass": 1.0, "viscosity": wrong})


def test_thermal_keys_make_a_type_thermal() -> None:
    assert not AtomType(mass=1.0, rho0=2.0, cs=3.0, phase="solid").thermal
    given = [{"conductivity": 0.1}, {"specific_heat": 1.0}, {"T_freeze": 0.0}, {"latent_heat": 0.5, "T_freeze": 0.1}]
    assert all(AtomType.model_validate({"mass": 1.0, **each}).thermal for each in given)
    with pytest.raises(ValidationError, match="latent_heat needs T_freeze"):
        AtomType(mass=1.0, latent_heat=0.5)
    for mass in (0.0, -1.0, float("inf")):
        with pytest.raises(ValidationError):
            AtomType(mass=mass)
