"""The findings about units: every number of their texts, by LAMMPS and by the reference."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from eos_ref.model.units import UNITS, UnitStyle
from tests.support.printed import printed, recomputes
from tests.support.small_scene import Engine, SmallScene, agree, is_multiple, small_scene

pytestmark = pytest.mark.lammps

RAW, DENSITY, VOLUME = "units-unconverted", "density-by-force-factor", "force-per-volume"
CUBE = np.stack(np.meshgrid(*[[2.0, 3.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
NAMES: tuple[UnitStyle, ...] = ("real", "metal")
CHARGE, MOLE = 1.602176634e-19, 6.02214076e23  # C, 1/mol (SI since 2019)
# How far LAMMPS' constants may lie from today's: Avogadro's constant and the charge of CODATA 2006, added.
SINCE_2006 = abs(6.02214179e23 / MOLE - 1) + abs(1.602176487e-19 / CHARGE - 1)


def water(units: UnitStyle, rho: float = 1.05, **options: Any) -> SmallScene:
    """Eight particles of water, 6.7 Angstrom apart, at rest, with the speed of sound of the text."""
    per_time = UNITS["real"].time / UNITS[units].time
    given: dict[str, Any] = {
        "units": units,
        "types": [{"mass": 181.1, "rho0": 1.0, "cs": 0.015 / per_time, "viscosity": 0.0}],
        "rheo": {"cut": 14.0},
        "compare": ["grad/v", "pressure", "f", "v", "rho"],
    } | options
    return small_scene(6.7 * CUBE, (40.2,) * 3, rho=rho, **given)


def test_the_factors_are_those_of_lammps_and_of_nature(lammps: Engine) -> None:
    """The ratio of an acceleration to force over mass; and the constants, as far as LAMMPS' older ones can be."""
    calorie, bar, atm = 4.184, 1e5, 101325.0
    for name, joule, pascal in (("real", 1000 * calorie / MOLE, atm), ("metal", CHARGE, bar)):
        u = UNITS[name]
        consistent = u.mass * u.length**2 / u.time**2
        exact = {"energy": joule / consistent, "pressure": pascal / (consistent / u.length**3)}
        exact |= {"density": 1000 * u.length**3 / u.mass, "viscosity": 0.1 * u.length * u.time / u.mass}
        assert {kind: getattr(u, kind) for kind in exact} == pytest.approx(exact, rel=SINCE_2006)
    for name in NAMES:
        moved = water(
            name,
            rho=1.0,
            forces=[{"style": "setforce", "vector": [0.3, -0.2, 0.1]}],
            evolve={"steps": 1, "timestep": 0.5, "compare_at": [0, 1]},
            compare=["f", "v"],
        )
        at_first, at_last = lammps.fields(moved)
        np.testing.assert_allclose(at_last["v"], 0.5 * (at_first["f"] / 181.1) * UNITS[name].energy, rtol=6 * 2.0**-53)
        assert agree(at_last["v"], moved.predicted(), "v", 1), "this factor is right"


@recomputes(RAW, "virial_real virial_metal")
def test_virials_are_converted(lammps: Engine) -> dict[str, Any]:
    """By hand, from LAMMPS' own forces on two particles and the factors of the manual's units."""
    n = printed(RAW)
    factors = n.virial_real, n.virial_metal
    for name, factor in zip(NAMES, factors, strict=True):
        types = [{"mass": 181.1, "rho0": 1.0, "cs": 0.015 * UNITS["real"].time / UNITS[name].time, "viscosity": 0.0}]
        scene = small_scene(
            [[20.0, 20.0, 20.0], [26.0, 20.0, 20.0]],
            (40.2,) * 3,
            v=[[0.0, 0.01, 0.0], [0.0, -0.01, 0.0]],
            rho=1.05,
            units=name,
            types=types,
            rheo={"cut": 14.0},
            compare=["f", "virial", "press", "stress/atom"],
        )
        found, *_ = lammps.fields(scene, every_step=True)
        by_hand = 6.0 * found["f"][1, 0] / 40.2**3 * factor
        # Ten operations at most on either side, half an EPS each: products, the volume, the factor.
        np.testing.assert_allclose(found["virial"][0, 0, 0], by_hand, rtol=2 * 10 * 2.0**-53)
        kinetic = 2 * 181.1 * 1e-4 / UNITS[name].pressure / 40.2**3
        # Of positive terms: three operations more.
        assert by_hand > 0
        np.testing.assert_allclose(found["press"][0], (by_hand + kinetic) / 3, rtol=2 * 13 * 2.0**-53)
        variant = scene.predicted(RAW, VOLUME, "virials-cancel", "virial-of-places", snapshot=found)
        assert all(agree(found[field], variant, field) for field in scene.scene.compare)
        assert not agree(found["virial"], scene.predicted(VOLUME), "virial")
    return {f"virial_{name}": UNITS[name].energy / UNITS[name].pressure for name in NAMES}


@recomputes(RAW, "volumes real metal")
def test_what_is_not_converted(lammps: Engine) -> dict[str, Any]:
    v = np.zeros((8, 3)) + [1e-6, 0, 0] * (CUBE[:, :1] > 2.5)
    for name in NAMES:
        scene = water(name, v=v)
        (found,) = lammps.fields(scene)
        variant = scene.predicted(RAW, VOLUME)
        assert is_multiple(found["grad/v"], UNITS[name].density, scene.predicted(), variant, "grad/v")
        assert all(agree(found[field], variant, field) for field in scene.scene.compare)
        assert not agree(found["f"], scene.predicted(VOLUME), "f")
    return {"volumes": [UNITS[name].density for name in NAMES], **{name: UNITS[name].energy for name in NAMES}}


@recomputes(RAW, "right_real right_metal", given="percent rho c wrong_real wrong_metal")
def test_pressures_of_water(lammps: Engine) -> dict[str, Any]:
    n = printed(RAW)
    assert (n.percent, n.rho, n.c) == (5, 1, 0.015)
    right = {}
    for name, wrong in (("real", n.wrong_real), ("metal", n.wrong_metal)):
        scene = water(name)
        (found,) = lammps.fields(scene)
        right[f"right_{name}"] = scene.predicted().fields[0]["pressure"][0]
        # c^2 (rho - rho0): four roundings of the terms c^2 (rho + rho0), which are so much larger.
        larger = (2 + n.percent / 100) / (n.percent / 100)
        assert found["pressure"][0] == pytest.approx(float(wrong), rel=4 * 2.0**-53 * larger, abs=0)
        assert agree(found["pressure"], scene.predicted(RAW), "pressure")
    return right


@recomputes(RAW, "slow fast sound_real sound_metal")
def test_accelerations_and_the_speed_of_sound() -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, ratio in zip(NAMES, ("slow", "fast"), strict=True):
        scene = water(name, evolve={"steps": 1, "timestep": 1e-5, "compare_at": [1]})
        factor_nc = scene.predicted(RAW).fields[0]["v"] / scene.predicted().fields[0]["v"]
        found |= {ratio: factor_nc, f"sound_{name}": np.sqrt(factor_nc.mean())}
    return found


def divergence(units: UnitStyle, apart: float = 2.0) -> float:
    """Of the velocity of two particles of density 1, at the first one, which moves towards the other with speed 1."""
    x, v = [[10.0, 10.0, 10.0], [10.0 + apart, 10.0, 10.0]], [[1.0, 0, 0], [0.0, 0, 0]]
    still = small_scene(x, (20.0,) * 3, v=v, units=units, rheo={"cut": 6.0}, compare=["grad/v"])
    return float(np.trace(still.predicted(RAW).fields[0]["grad/v"][0]))


def approaching(units: UnitStyle, **options: Any) -> SmallScene:
    """The same with the div v of the text, in a step of its time."""
    per_ns = 1e-9 / UNITS[units].time
    rate = divergence(units)
    return small_scene(
        [[10.0, 10.0, 10.0], [12.0, 10.0, 10.0]],
        (20.0,) * 3,
        v=[[-0.1 / (rate * per_ns), 0, 0], [0.0, 0, 0]],
        units=units,
        types=[{"mass": 1.0, "cs": 1e-9, "viscosity": 0.0}],
        rheo={"cut": 6.0},
        evolve={"steps": 1, "timestep": 0.001 * per_ns, "compare_at": [1]},
        compare=["rho", "x"],
        **options,
    )


@recomputes(DENSITY, "real metal slowly", given="rho rate right time changed_real changed_metal")
def test_densities_by_the_factor_of_forces(lammps: Engine) -> dict[str, Any]:
    n = printed(DENSITY)
    rate, right, time = n.rate, n.right, n.time
    assert (n.rho, rate, time) == (1, -0.1, 0.001)
    for name, wrong in (("real", n.changed_real), ("metal", n.changed_metal)):
        scene = approaching(name)
        (found,) = lammps.fields(scene)
        assert agree(found["rho"], scene.predicted(RAW, DENSITY), "rho")
        assert not agree(found["rho"], scene.predicted(RAW), "rho")
        # The particles come closer in the step, by which the rate of its second half differs; more is of second order.
        later = divergence(name, 2.0 - rate * time / divergence(name)) / divergence(name)
        mean, more = (1 + later) / 2, (later - 1) ** 2
        assert scene.predicted(RAW).fields[0]["rho"][0] - 1 == pytest.approx(right * mean, rel=more, abs=0)
        assert found["rho"][0] - 1 == pytest.approx(wrong * mean, rel=0, abs=wrong * more + wrong.half_unit)
    return {name: UNITS[name].energy for name in NAMES} | {"slowly": 1 / UNITS["real"].energy}


@recomputes(DENSITY, "volumes")
def test_sums_have_no_rates_and_the_volumes_of_numbers_as_they_stand(lammps: Engine) -> dict[str, Any]:
    """The workaround of density-by-force-factor with rho/sum."""
    for name in NAMES:
        scene = water(name, rho=None, rheo={"cut": 14.0, "rho_sum": True}, compare=["rho"])
        (found,), right, raw = lammps.fields(scene), scene.predicted(), scene.predicted(RAW)
        assert is_multiple(found["rho"], UNITS[name].density, right, raw, "rho") and agree(found["rho"], raw, "rho")
    return {"volumes": [UNITS[name].density for name in NAMES]}
