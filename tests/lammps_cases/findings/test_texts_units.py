"""What the findings about units say: every number of their texts, by LAMMPS and by the reference."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from eos_ref.model.units import UNITS, UnitStyle
from tests.support.told import Engine, Told, agree, is_multiple, said, told

pytestmark = pytest.mark.lammps

RAW, DENSITY, VOLUME = "units-unconverted", "density-by-force-factor", "force-per-volume"
CUBE = np.stack(np.meshgrid(*[[2.0, 3.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
NAMES: tuple[UnitStyle, ...] = ("real", "metal")
CHARGE, MOLE = 1.602176634e-19, 6.02214076e23  # C, 1/mol (SI since 2019)
# How far LAMMPS' constants may lie from today's: Avogadro's constant and the charge of CODATA 2006, added.
SINCE_2006 = abs(6.02214179e23 / MOLE - 1) + abs(1.602176487e-19 / CHARGE - 1)


def water(units: UnitStyle, rho: float = 1.05, **options: Any) -> Told:
    """Eight particles of water, 6.7 Angstrom apart, at rest, with the speed of sound of the text."""
    per_time = UNITS["real"].time / UNITS[units].time
    given: dict[str, Any] = {
        "units": units,
        "types": [{"mass": 181.1, "rho0": 1.0, "cs": 0.015 / per_time, "viscosity": 0.0}],
        "rheo": {"cut": 14.0},
        "compare": ["grad/v", "pressure", "f", "v", "rho"],
    } | options
    return told(6.7 * CUBE, (40.2,) * 3, rho=rho, **given)


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


def test_virials_are_converted(lammps: Engine) -> None:
    """By hand, from LAMMPS' own forces on two particles, beside the factors that the manual's units have."""
    factors = said(RAW, "observed", r"show # times .* in real, # times in metal")
    for name, factor in zip(NAMES, factors, strict=True):
        assert factor.is_rounded(UNITS[name].energy / UNITS[name].pressure)
        types = [{"mass": 181.1, "rho0": 1.0, "cs": 0.015 * UNITS["real"].time / UNITS[name].time, "viscosity": 0.0}]
        scene = told(
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


def test_what_is_not_converted(lammps: Engine) -> None:
    volumes, real, metal = said(RAW, "observed", r"are # times the right ones.* applied, # in real and # in metal")
    assert real.is_rounded(UNITS["real"].energy) and metal.is_rounded(UNITS["metal"].energy)
    assert volumes.is_rounded(UNITS["real"].density)
    v = np.zeros((8, 3)) + [1e-6, 0, 0] * (CUBE[:, :1] > 2.5)
    for name in NAMES:
        scene = water(name, v=v)
        (found,) = lammps.fields(scene)
        variant = scene.predicted(RAW, VOLUME)
        assert is_multiple(found["grad/v"], UNITS[name].density, scene.predicted(), variant, "grad/v")
        assert all(agree(found[field], variant, field) for field in scene.scene.compare)
        assert not agree(found["f"], scene.predicted(VOLUME), "f")


def test_pressures_of_water(lammps: Engine) -> None:
    over, rho, c, due, reported = said(
        RAW,
        "argument",
        r"# % above its density \(# g/cm\^3, # Angstrom/fs\) has a pressure of # atm; LAMMPS reports #\.",
    )
    of_metal, bars = said(RAW, "argument", r"it reports # instead of # bar")
    assert (over, rho, c) == (5, 1, 0.015)
    for name, right, wrong in (("real", due, reported), ("metal", bars, of_metal)):
        scene = water(name)
        (found,) = lammps.fields(scene)
        assert right.is_rounded(scene.predicted().fields[0]["pressure"][0])
        # c^2 (rho - rho0): four roundings of the terms c^2 (rho + rho0), which are so much larger.
        larger = (2 + over / 100) / (over / 100)
        assert found["pressure"][0] == pytest.approx(float(wrong), rel=4 * 2.0**-53 * larger, abs=0)
        assert agree(found["pressure"], scene.predicted(RAW), "pressure")


def test_accelerations_and_the_speed_of_sound() -> None:
    slow, fast = said(RAW, "argument", r"accelerate by # of what .* and by # times")
    sound = said(RAW, "argument", r"travels at # and # times")
    for name, ratio, speed in zip(NAMES, (slow, fast), sound, strict=True):
        scene = water(name, evolve={"steps": 1, "timestep": 1e-5, "compare_at": [1]})
        factor_nc = scene.predicted(RAW).fields[0]["v"] / scene.predicted().fields[0]["v"]
        assert all(ratio.is_rounded(factor) for factor in factor_nc.ravel())
        assert speed.is_rounded(np.sqrt(factor_nc.mean()))


def divergence(units: UnitStyle, apart: float = 2.0) -> float:
    """Of the velocity of two particles of density 1, at the first one, which moves towards the other with speed 1."""
    x, v = [[10.0, 10.0, 10.0], [10.0 + apart, 10.0, 10.0]], [[1.0, 0, 0], [0.0, 0, 0]]
    still = told(x, (20.0,) * 3, v=v, units=units, rheo={"cut": 6.0}, compare=["grad/v"])
    return float(np.trace(still.predicted(RAW).fields[0]["grad/v"][0]))


def approaching(units: UnitStyle, **options: Any) -> Told:
    """The same with the div v of the text, in a step of its time."""
    per_ns = 1e-9 / UNITS[units].time
    rate = divergence(units)
    return told(
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


def test_densities_by_the_factor_of_forces(lammps: Engine) -> None:
    factors = said(DENSITY, "observed", r"an acceleration: # in real, # in metal")
    assert factors == said(RAW, "observed", r"applied, # in real and # in metal")
    rho, rate, right, time, real, metal = said(
        DENSITY,
        "argument",
        r"density # that .* div v = #/ns should be denser by # after # ns; in real it is #, and in metal #\.",
    )
    assert (rho, rate, time) == (1, -0.1, 0.001)
    for name, wrong in (("real", real), ("metal", metal)):
        scene = approaching(name)
        (found,) = lammps.fields(scene)
        assert agree(found["rho"], scene.predicted(RAW, DENSITY), "rho")
        assert not agree(found["rho"], scene.predicted(RAW), "rho")
        # The particles come closer in the step, by which the rate of its second half differs; more is of second order.
        later = divergence(name, 2.0 - rate * time / divergence(name)) / divergence(name)
        mean, more = (1 + later) / 2, (later - 1) ** 2
        assert scene.predicted(RAW).fields[0]["rho"][0] - 1 == pytest.approx(right * mean, rel=more, abs=0)
        assert found["rho"][0] - 1 == pytest.approx(wrong * mean, rel=0, abs=wrong * more + wrong.half_unit)


def test_sums_have_no_rates_and_the_volumes_of_numbers_as_they_stand(lammps: Engine) -> None:
    """What the workaround of density-by-force-factor says of rho/sum."""
    (factor,) = said(DENSITY, "workaround", r"\(rho/sum\) have no rates, but are # times the right ones")
    for name in NAMES:
        scene = water(name, rho=None, rheo={"cut": 14.0, "rho_sum": True}, compare=["rho"])
        (found,), right, raw = lammps.fields(scene), scene.predicted(), scene.predicted(RAW)
        assert factor.is_rounded(UNITS[name].density)
        assert is_multiple(found["rho"], UNITS[name].density, right, raw, "rho") and agree(found["rho"], raw, "rho")
