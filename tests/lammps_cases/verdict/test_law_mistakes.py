"""Mistakes in a law: which ones a scene can detect, and which it cannot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eos_ref import EOS, EOSTable
from eos_ref.eos import bounds
from lammps_cases.comparison.compare import EosState, evaluate
from lammps_cases.verdict.mistakes import LAW_MUTANTS, undetected_in_laws

ODD = EOSTable([EOS("cubic", 1.2, 3.1, 0.7, 0.3), EOS("tait/general", 0.9, 2.3, 4.1)])
PLAIN = EOSTable([EOS("linear", 1.0, 1.0)])


def state(table: EOSTable) -> EosState:
    n = 40
    type_n = np.arange(n) % len(table) + 1
    return EosState(np.arange(1, n + 1), type_n, np.linspace(0.71, 1.53, n), np.full(n, 1.3))


def blind(table: EOSTable) -> list[str]:
    scene = state(table)
    bound_n = bounds.comparison(table, scene.rho_n, scene.type_n, None)
    return undetected_in_laws(table, scene, evaluate(table, scene), bound_n)


def test_scene_of_odd_numbers_detects_every_mistake() -> None:
    assert blind(ODD) == []


def test_parameters_of_one_hide_mistakes_in_their_factors() -> None:
    assert blind(PLAIN) == ["cs instead of cs^2", "cs ignored", "rho0 ignored", "rho0 and cs exchanged"]


@pytest.mark.parametrize("name", ["types exchanged", "background dropped", "A3 dropped", "gamma instead of gamma - 1"])
def test_mistake_in_absent_parts_of_a_scene_does_not_apply(name: str) -> None:
    assert LAW_MUTANTS[name](PLAIN, state(PLAIN)) is None


LINEAR = EOS("linear", 1.2, 2.25, background=0.3)
CUBIC = EOS("cubic", 1.2, 2.25, 0.7, 0.3)
TAIT = EOS("tait/general", 1.2, 2.25, 4.1, 0.3)
WATER = EOS("tait/water", 1.2, 2.25, background=0.3)
GAS = EOS("ideal/gas", parameter=1.4, background=0.3)
# A law that each mistake applies to, the resulting law, and laws that it leaves unchanged.
MADE: dict[str, tuple[EOS, EOS, tuple[EOS, ...]]] = {
    "cs instead of cs^2": (LINEAR, EOS("linear", 1.2, 1.5, background=0.3), (GAS,)),
    "cs ignored": (CUBIC, EOS("cubic", 1.2, 1.0, 0.7, 0.3), (GAS,)),
    "rho0 ignored": (TAIT, EOS("tait/general", 1.0, 2.25, 4.1, 0.3), (GAS,)),
    "rho0 and cs exchanged": (WATER, EOS("tait/water", 2.25, 1.2, background=0.3), (GAS,)),
    "cs off by 1e-6": (LINEAR, EOS("linear", 1.2, 2.25 * (1 + 1e-6), background=0.3), (GAS,)),
    "background dropped": (GAS, EOS("ideal/gas", parameter=1.4), (EOS("linear"),)),
    "background subtracted": (GAS, EOS("ideal/gas", parameter=1.4, background=-0.3), (EOS("linear"),)),
    "A3 dropped": (CUBIC, EOS("cubic", 1.2, 2.25, 0.0, 0.3), (TAIT, GAS, EOS("cubic", parameter=0.0))),
    "A3 of the wrong sign": (CUBIC, EOS("cubic", 1.2, 2.25, -0.7, 0.3), (TAIT, GAS, EOS("cubic", parameter=0.0))),
    "exponent 7 for every Tait law": (TAIT, EOS("tait/general", 1.2, 2.25, 7.0, 0.3), (WATER, LINEAR, CUBIC, GAS)),
    "exponent off by one": (WATER, EOS("tait/general", 1.2, 2.25, 8.0, 0.3), (LINEAR, CUBIC, GAS)),
    "linear instead of Tait or cubic": (TAIT, LINEAR, (LINEAR, EOS("tait/general", parameter=1.0), GAS)),
    "gamma instead of gamma - 1": (GAS, EOS("ideal/gas", parameter=2.4, background=0.3), (TAIT, CUBIC)),
}


def with_energy(table: EOSTable, energy: float = 0.9) -> EosState:
    scene = state(table)
    return replace(scene, energy_n=np.linspace(energy, 2.1, len(scene.id_n)))


@pytest.mark.parametrize("name", MADE)
def test_mistake_turns_a_law_into_another(name: str) -> None:
    """This concerns the types that it applies to; without any such type there is no mistake."""
    law, wrong, others = MADE[name]
    for other in others:
        alone, both, mistaken = EOSTable([other]), EOSTable([law, other]), EOSTable([wrong, other])
        scene = with_energy(both)
        assert LAW_MUTANTS[name](alone, with_energy(alone)) is None
        np.testing.assert_array_equal(LAW_MUTANTS[name](both, scene), evaluate(mistaken, scene))


def test_exponent_off_by_one_is_never_zero() -> None:
    p_n = LAW_MUTANTS["exponent off by one"](EOSTable([EOS("tait/general", 1.2, parameter=-1.0)]), state(PLAIN))
    np.testing.assert_array_equal(p_n, evaluate(EOSTable([EOS("tait/general", 1.2, parameter=0.5)]), state(PLAIN)))


def test_mistakes_in_the_arguments_of_a_law() -> None:
    three = EOSTable([LINEAR, TAIT, GAS])
    scene = with_energy(three)
    p_n = evaluate(three, scene)
    for name, right_n in {
        "sign of the pressure": -p_n,
        "types exchanged": evaluate(EOSTable([TAIT, GAS, LINEAR]), scene),
        "energy not per unit mass": evaluate(three, replace(scene, mass_n=np.ones(40))),
        "density in float32": evaluate(three, replace(scene, rho_n=np.float64(np.float32(scene.rho_n)))),
        "pressure in float32": np.float64(np.float32(p_n)),
    }.items():
        made_n = LAW_MUTANTS[name](three, scene)
        np.testing.assert_array_equal(made_n, right_n, err_msg=name)
        assert made_n.dtype == np.float64


@pytest.mark.parametrize(
    ("name", "table", "scene"),
    [
        ("energy not per unit mass", EOSTable([LINEAR]), with_energy(PLAIN)),
        ("energy not per unit mass", EOSTable([GAS]), state(PLAIN)),
        ("types exchanged", EOSTable([LINEAR, GAS]), state(ODD)),
    ],
)
def test_no_mistake_in_the_energy_without_an_energy(name: str, table: EOSTable, scene: EosState) -> None:
    assert LAW_MUTANTS[name](table, scene) is None


def test_types_without_energy_can_be_exchanged() -> None:
    table = EOSTable([LINEAR, TAIT])
    exchanged_n = evaluate(EOSTable([TAIT, LINEAR]), state(table))
    np.testing.assert_array_equal(LAW_MUTANTS["types exchanged"](table, state(table)), exchanged_n)


@pytest.mark.parametrize(("bound", "seen"), [(0.5, True), (1.0, False), (2.0, False)])
def test_mistake_is_detected_by_a_particle_outside_its_bound(bound: float, seen: bool) -> None:
    """A pressure of one half with the wrong sign is off by one; particles at rho0 do not show it."""
    scene = EosState(np.arange(1, 4), np.ones(3, int), np.array([1.0, 1.5, 1.0]), np.ones(3))
    names = undetected_in_laws(PLAIN, scene, evaluate(PLAIN, scene), np.full(3, bound))
    assert ("sign of the pressure" in names) == (not seen)


def test_overflow_of_float32_is_detected_without_a_warning() -> None:
    table = EOSTable([EOS("linear", 1.0, 1e25)])
    scene = state(table)
    scene.rho_n[7] = 1e39
    assert np.isinf(LAW_MUTANTS["pressure in float32"](table, scene)).any()
    names = undetected_in_laws(table, scene, evaluate(table, scene), np.ones(40))
    assert not {"pressure in float32", "density in float32"} & set(names)


@pytest.mark.parametrize("name", LAW_MUTANTS)
def test_mistake_changes_the_pressure_or_does_not_apply(name: str) -> None:
    scene = state(ODD)
    p_n = LAW_MUTANTS[name](ODD, scene)
    assert p_n is None or not np.array_equal(p_n, evaluate(ODD, scene))
