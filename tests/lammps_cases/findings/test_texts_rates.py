"""Findings about forces, heat, means and units: what the numbers in their documents do not show."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from eos_ref.eos.bounds import EPS
from eos_ref.model.units import UNITS, UnitStyle
from lammps_cases.claims.probes.manual import probes
from lammps_cases.claims.probes.probe import edited
from tests.support.printed import ENTRIES, printed, recomputes, works_around
from tests.support.small_scene import Engine, SmallScene, agree, is_multiple, small_scene

pytestmark = pytest.mark.lammps

FORCES, HEAT, OVER = "force-per-volume", "heat-is-temperature-rate", "heat-over-density"
MASS, HARMONIC, RAW, DENSITY = (
    "temperature-without-mass",
    "harmonic-mean-undefined",
    "units-unconverted",
    "density-by-force-factor",
)
APART = np.array([[4.0, 4.0], [5.0, 4.0]])  # at distance 1
MOVING = {"v": [[0.2, 0.1], [0.0, 0.0]]}
STEP = {"steps": 1, "timestep": 0.004}


def pair(x: Any = APART, **options: Any) -> SmallScene:
    """Two particles, with the cutoff of the texts."""
    return small_scene(x, (12, 12), **{"kind": [1, 2], "rheo": {"cut": 3.0}} | options)


# --- force-per-volume

PARTS: dict[str, dict[str, Any]] = {
    "pressure": {"types": [{"mass": 1.0, "viscosity": 0.0}] * 2},
    "viscous": {"types": [{"mass": 1.0, "cs": 1e-9, "viscosity": 0.3}] * 2, **MOVING},
    "artificial": {
        "types": [{"mass": 1.0, "cs": 1e-3, "viscosity": 0.0}] * 2,
        "pair": {"artificial_visc": 0.7},
        **MOVING,
    },
}


@pytest.mark.parametrize("part", PARTS)
def test_forces_lack_a_volume_each(lammps: Engine, part: str) -> None:
    """f is the right force over V_i; the acceleration is f over the mass; with volumes of 1 nothing shows."""
    rho, given = np.array([1.4, 1.35]), PARTS[part]
    wrong = pair(**given, rho=rho)
    found = lammps.fields(wrong)[0]["f"]
    assert is_multiple(found, rho[:, None], wrong.predicted(), wrong.predicted(FORCES), "f")
    assert np.abs(found).max() > 0 and agree(found, wrong.predicted(FORCES), "f")
    heavy = [given["types"][0] | {"mass": 2.5}] * 2
    moved = pair(**given | {"types": heavy}, rho=rho, compare=["v"], evolve=STEP)
    v = lammps.fields(moved)[-1]["v"]
    assert agree(v, moved.predicted(FORCES), "v", -1) and not agree(v, moved.predicted(), "v", -1)
    unit = pair(**given, rho=1.0)
    assert agree(lammps.fields(unit)[0]["f"], unit.predicted(), "f")


@recomputes(FORCES, given="times")
def test_the_missing_volume_depends_on_the_resolution(lammps: Engine) -> dict[str, Any]:
    factor = printed(FORCES).times
    errors, relative = [], np.zeros(2)
    gravity = [{"style": "gravity", "vector": [0.0, -0.75]}]
    for size in (1.0, 0.5):
        given: dict[str, Any] = {"types": [{"mass": 1.3 * size**2}] * 2, "rheo": {"cut": 3.0 * size}}
        fluid = pair(APART * size, rho=[1.4, 1.35], **given)
        along = [
            (side.fields[0]["f"][:, 0], side.bounds[0]["f"][:, 0])
            for side in (fluid.predicted(), fluid.predicted(FORCES))
        ]
        errors.append(lammps.fields(fluid)[0]["f"][:, 0] / along[0][0])
        relative += sum(bound / np.abs(f) for f, bound in along) + 2 * EPS
        pulled = pair([[2.0, 2.0], [8.0, 8.0]], forces=gravity, **given)
        assert agree(lammps.fields(pulled)[0]["f"], pulled.predicted(), "f")
    assert np.all(np.abs(errors[1] / (factor * errors[0]) - 1) <= relative)
    return {}


@works_around(FORCES, 2)
def test_unit_volumes_leave_a_factor(lammps: Engine) -> None:
    rho, rho0 = np.array([1.47, 0.79]), np.array([1.4, 0.8])
    scene = pair(types=[{"mass": r, "rho0": r, "cs": 3.0} for r in rho0], rho=rho, **MOVING)
    found = lammps.fields(scene)[0]["f"]
    assert is_multiple(found, (rho / rho0)[:, None], scene.predicted(), scene.predicted(FORCES), "f")


# --- heat


def warm(
    mass: Any, energy: Any = (2.0, 0.9), kappa: Any = (1, 1), cv: Any = (1, 1), rho0: Any = (1, 1), **options: Any
) -> SmallScene:
    """Two particles with energies."""
    types = [
        {"mass": float(m), "conductivity": float(k), "specific_heat": float(c), "rho0": float(r), "cs": 1.0}
        for m, k, c, r in zip(mass, kappa, cv, rho0, strict=True)
    ]
    return pair(types=types, e=list(energy), **{"compare": ["temperature", "heatflow"]} | options)


CV, KAPPA, RHO0, RHO = (np.array(pair) for pair in ((1.5, 0.8), (0.7, 0.3), (1.27, 0.81), (1.3, 0.79)))


@pytest.mark.parametrize("harmonic", [False, True])
def test_heat_flow_is_that_of_the_formula(lammps: Engine, harmonic: bool) -> None:
    """D is the mean of kappa/(rho0 cv), the volume that of the other particle; the energy grows by it."""
    mass, means = np.array([1.31, 0.62]), {"pair": {"harmonic_means": harmonic}}
    options: dict[str, Any] = {"cv": CV, "kappa": KAPPA, "rho0": RHO0, "rho": RHO, **means}

    def mean(values: Any) -> Any:
        return 2 / (1 / values[0] + 1 / values[1]) if harmonic else values.mean()

    scene = warm(mass, **options)
    found, right = lammps.fields(scene)[0]["heatflow"], scene.predicted()
    change = mean(KAPPA / (RHO0 * CV)) / (mean(KAPPA) * mass / RHO)
    assert is_multiple(found, change, right, scene.predicted(HEAT), "heatflow", roundings=16)
    moved = warm(mass, **options, evolve=STEP, compare=["energy", "temperature"])
    energy = lammps.fields(moved)[-1]["energy"]
    assert agree(energy, moved.predicted(HEAT, FORCES), "energy", -1)
    assert not agree(energy, moved.predicted(FORCES), "energy", -1)


@works_around(HEAT, 1)
@pytest.mark.parametrize("harmonic", [False, True])
def test_heat_with_another_conductivity(lammps: Engine, harmonic: bool) -> None:
    mass = 0.6 * RHO0
    options: dict[str, Any] = {"cv": CV, "rho0": RHO0, "rho": RHO, "pair": {"harmonic_means": harmonic}}
    around = warm(mass, kappa=KAPPA * mass * CV, **options)
    found, right = lammps.fields(around)[0]["heatflow"], warm(mass, kappa=KAPPA, **options).predicted()
    # The conductivities are products that round on both sides of every mean.
    assert is_multiple(found, RHO / RHO0, right, around.predicted(HEAT), "heatflow", roundings=16)


N_OVER = printed(OVER)


@pytest.mark.slow
@works_around(OVER, 1)
@pytest.mark.parametrize(
    ("expected", "mass", "rho", "kappa", "rho0", "cv"),
    [
        (N_OVER.part / N_OVER.whole, (1.0, 1.0), [N_OVER.density] * 2, (1, 1), 1.0, (1, 1)),
        (1e-3, (900.0, 1100.0), [N_OVER.water] * 2, (1, 1), 1.0, (1, 1)),
        (2 / (1.3 + 0.8), (1.3, 0.6), [1.3, 0.8], KAPPA, 1.0, (1, 1)),
        (1.25 / (0.5 * (1.3 + 1.2)), (1.3, 0.6), [1.3, 1.2], KAPPA, 1.25, CV),  # the workaround: kappa times rho0
    ],
)
@recomputes(OVER, given="density part whole water")
def test_heat_over_density(
    older: Engine, expected: float, mass: Any, rho: Any, kappa: Any, rho0: float, cv: Any
) -> dict[str, Any]:
    """Giving cv times the mass corrects the temperature of this LAMMPS, which takes E/cv for it."""
    options: dict[str, Any] = {"rho": rho, "rho0": (rho0, rho0)}
    right = warm(mass, kappa=kappa, cv=cv, **options).predicted()
    asked = warm(mass, kappa=rho0 * np.array(kappa), cv=np.array(cv) * mass, **options)
    found = older.fields(asked)[0]["heatflow"]
    assert is_multiple(found, expected, right, asked.predicted(OVER, MASS), "heatflow", roundings=16)
    return {}


@pytest.mark.slow
@works_around(MASS, 1)
def test_temperature_without_mass(lammps: Engine, older: Engine) -> None:
    mass, energy = np.array([2.0, 3.0]), np.array([2.0, 1.0])
    scene, around, fine = (
        warm(*given, compare=["temperature"])
        for given in ((mass, energy), (mass, energy, (1, 1), mass), (mass / 4, energy / 4))
    )
    right = scene.predicted()
    assert agree(lammps.fields(scene)[0]["temperature"], right, "temperature")
    assert agree(older.fields(around)[0]["temperature"], right, "temperature"), "the workaround"
    wrong, finer = (older.fields(each)[0]["temperature"] for each in (scene, fine))
    np.testing.assert_array_equal(finer, wrong / 4)
    np.testing.assert_array_equal(fine.predicted().fields[0]["temperature"], right.fields[0]["temperature"])
    gas = warm(mass, energy, compare=["pressure"], pressure=[{"types": "*", "style": "ideal/gas", "gamma": 1.4}])
    assert agree(older.fields(gas)[0]["pressure"], gas.predicted(), "pressure"), "E/m is the energy per mass"


# --- harmonic-mean-undefined


def coefficients(what: str, a: float, b: float, harmonic: bool = True) -> SmallScene:
    """Two fluids of some viscosity or conductivity each, at different velocities and temperatures."""
    per_type = [{"mass": 1.0, "viscosity": 0.3, "conductivity": 0.2, what: value} for value in (a, b)]
    given: dict[str, Any] = {"types": per_type, "rho": 1.0, "pair": {"harmonic_means": harmonic}, **MOVING}
    return pair(e=np.array([2.0, 1.0]), compare=["f", "heatflow"], **given)


@works_around(HARMONIC, 1, 2)
@pytest.mark.parametrize(("what", "field"), [("viscosity", "f"), ("conductivity", "heatflow")])
@recomputes(HARMONIC, given="large small tiny")
def test_harmonic_means(lammps: Engine, what: str, field: str) -> dict[str, Any]:
    """NaN of two zeros alone; infinite and 0 where the product leaves the range; right between."""
    n = printed(HARMONIC)

    def found(a: float, b: float, harmonic: bool = True) -> Any:
        return lammps.fields(coefficients(what, a, b, harmonic))[0][field]

    def right(a: float, b: float) -> Any:
        return coefficients(what, a, b).predicted().fields[0][field]

    assert np.isnan(found(0.0, 0.0)).any() and np.isfinite(found(0.0, 0.0, harmonic=False)).all()
    assert not right(0.0, 0.0).any()
    assert not found(0.0, 1.0).any() and not right(0.0, 1.0).any()
    assert np.isinf(found(n.large, n.large)).any() and np.isfinite(right(n.large, n.large)).all()
    assert not found(n.small, n.small).any() and right(n.small, n.small).any()
    assert agree(found(n.tiny, n.tiny), coefficients(what, n.tiny, n.tiny).predicted(), field)
    return {}


def test_probes_of_harmonic_means_detect_it(lammps: Engine) -> None:
    """And nothing else: without the keyword all numbers are finite."""
    (keyword,) = {"harmonic/means"} & set(ENTRIES[HARMONIC].title.split())
    chosen = [probe for probe in probes() if ENTRIES[HARMONIC].covers(probe.name)]
    assert len(chosen) == 2
    for probe in chosen:
        plain = tuple(edit for edit in probe.edits if keyword not in edit[1])
        ours, theirs = lammps.replies(probe.input, edited(probe.base, plain))
        assert ours.ended == "refused" and ENTRIES[HARMONIC].engine_error in ours.error
        assert all(np.isfinite(values).all() for values in theirs.arrays.values())


@pytest.mark.parametrize(("fluids", "fine"), [((0.0, 0.0), False), ((0.0, 0.3), True), ((1e-9, 1e-9), True)])
def test_variant_is_nan_where_lammps_is(lammps: Engine, fluids: tuple[float, float], fine: bool) -> None:
    """One coefficient that is not 0 is enough for a number; after a step there are no neighbours."""
    given: dict[str, Any] = {"types": [{"mass": 1.0, "viscosity": eta} for eta in fluids], "rho": 1.0, **MOVING}
    harmonic = {"pair": {"harmonic_means": True}}
    scene = pair(**given, **harmonic)
    found = lammps.fields(scene)[0]["f"]
    assert np.isfinite(found).all() == fine and np.isfinite(scene.predicted().fields[0]["f"]).all()
    if not fine:
        assert np.isnan(found).all() == np.isnan(scene.predicted(HARMONIC).fields[0]["f"]).all()
        plain = pair(**given)
        assert agree(lammps.fields(plain)[0]["f"], plain.predicted(), "f")
        moved = lammps.fields(pair(compare=["x", "coordination"], evolve=STEP, **given, **harmonic))[-1]
        assert np.isnan(moved["x"]).all() and (moved["coordination"] == 0).all()


# --- units

CUBE = np.stack(np.meshgrid(*[[2.0, 3.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
NAMES: tuple[UnitStyle, ...] = ("real", "metal")
CHARGE, MOLE = 1.602176634e-19, 6.02214076e23  # C, 1/mol (SI since 2019)
# How far LAMMPS' constants may lie from today's: Avogadro's constant and the charge of CODATA 2006, added.
SINCE_2006 = abs(6.02214179e23 / MOLE - 1) + abs(1.602176487e-19 / CHARGE - 1)


def water(units: UnitStyle, rho: float = 1.05, x: Any = 6.7 * CUBE, **options: Any) -> SmallScene:
    """Particles of water, by default eight, 6.7 Angstrom apart, at rest, with the speed of sound of the text."""
    cs = 0.015 * UNITS[units].time / UNITS["real"].time
    given: dict[str, Any] = {
        "types": [{"mass": 181.1, "rho0": 1.0, "cs": cs, "viscosity": 0.0}],
        "rheo": {"cut": 14.0},
        "compare": ["grad/v", "pressure", "f", "v", "rho"],
    } | options
    return small_scene(x, (40.2,) * 3, rho=rho, units=units, **given)


@pytest.mark.parametrize("name", NAMES)
def test_the_factors_are_those_of_lammps_and_of_nature(lammps: Engine, name: UnitStyle) -> None:
    """The ratio of an acceleration to force over mass; and the constants, as far as LAMMPS' older ones can be."""
    joule, pascal = {"real": (1000 * 4.184 / MOLE, 101325.0), "metal": (CHARGE, 1e5)}[name]
    u = UNITS[name]
    consistent = u.mass * u.length**2 / u.time**2
    exact = {"energy": joule / consistent, "pressure": pascal / (consistent / u.length**3)}
    exact |= {"density": 1000 * u.length**3 / u.mass, "viscosity": 0.1 * u.length * u.time / u.mass}
    assert {kind: getattr(u, kind) for kind in exact} == pytest.approx(exact, rel=SINCE_2006)
    force, evolve = [{"style": "setforce", "vector": [0.3, -0.2, 0.1]}], {"steps": 1, "timestep": 0.5}
    moved = water(name, rho=1.0, forces=force, evolve=evolve | {"compare_at": [0, 1]}, compare=["f", "v"])
    at_first, at_last = lammps.fields(moved)
    np.testing.assert_allclose(at_last["v"], 0.5 * (at_first["f"] / 181.1) * u.energy, rtol=6 * 2.0**-53)
    assert agree(at_last["v"], moved.predicted(), "v", 1), "this factor is right"


@pytest.mark.parametrize("name", NAMES)
@recomputes(RAW, "virial_real virial_metal", some=True)
def test_virials_are_converted(lammps: Engine, name: UnitStyle) -> dict[str, Any]:
    """By hand, from LAMMPS' own forces on two particles and the factors of the manual's units."""
    factor, fields = vars(printed(RAW))[f"virial_{name}"], ["f", "virial", "press", "stress/atom"]
    x, v = [[20.0, 20.0, 20.0], [26.0, 20.0, 20.0]], [[0.0, 0.01, 0.0], [0.0, -0.01, 0.0]]
    scene = water(name, x=x, v=v, compare=fields)
    found, *_ = lammps.fields(scene, every_step=True)
    by_hand = 6.0 * found["f"][1, 0] / 40.2**3 * factor
    # Ten operations at most on either side, half an EPS each: products, the volume, the factor.
    np.testing.assert_allclose(found["virial"][0, 0, 0], by_hand, rtol=2 * 10 * 2.0**-53)
    kinetic = 2 * 181.1 * 1e-4 / UNITS[name].pressure / 40.2**3
    # Of positive terms: three operations more.
    assert by_hand > 0
    np.testing.assert_allclose(found["press"][0], (by_hand + kinetic) / 3, rtol=2 * 13 * 2.0**-53)
    variant = scene.predicted(RAW, FORCES, "virials-cancel", "virial-of-places", snapshot=found)
    assert all(agree(found[field], variant, field) for field in fields)
    assert not agree(found["virial"], scene.predicted(FORCES), "virial")
    return {f"virial_{name}": UNITS[name].energy / UNITS[name].pressure}


@pytest.mark.parametrize("name", NAMES)
@recomputes(RAW, "volumes real metal", some=True)
def test_what_is_not_converted(lammps: Engine, name: UnitStyle) -> dict[str, Any]:
    scene = water(name, v=np.zeros((8, 3)) + [1e-6, 0, 0] * (CUBE[:, :1] > 2.5))
    (found,), variant = lammps.fields(scene), scene.predicted(RAW, FORCES)
    assert is_multiple(found["grad/v"], UNITS[name].density, scene.predicted(), variant, "grad/v")
    assert all(agree(found[field], variant, field) for field in scene.scene.compare)
    assert not agree(found["f"], scene.predicted(FORCES), "f")
    return {"volumes": UNITS[name].density, name: UNITS[name].energy}


def divergence(units: UnitStyle, apart: float = 2.0) -> float:
    """Of the velocity of two particles of density 1, at the first one, which moves towards the other with speed 1."""
    x, v = [[10.0, 10.0, 10.0], [10.0 + apart, 10.0, 10.0]], [[1.0, 0, 0], [0.0, 0, 0]]
    still = small_scene(x, (20.0,) * 3, v=v, units=units, rheo={"cut": 6.0}, compare=["grad/v"])
    return float(np.trace(still.predicted(RAW).fields[0]["grad/v"][0]))


@pytest.mark.parametrize("name", NAMES)
@recomputes(DENSITY, "real metal slowly", given="rho rate right time changed_real changed_metal", some=True)
def test_densities_by_the_factor_of_forces(lammps: Engine, name: UnitStyle) -> dict[str, Any]:
    """Two particles approaching each other with the div v of the text, in a step of its time."""
    n, per_ns = printed(DENSITY), 1e-9 / UNITS[name].time
    wrong = vars(n)[f"changed_{name}"]
    assert (n.rho, n.rate, n.time) == (1, -0.1, 0.001)
    scene = small_scene(
        [[10.0, 10.0, 10.0], [12.0, 10.0, 10.0]],
        (20.0,) * 3,
        v=[[n.rate / (divergence(name) * per_ns), 0, 0], [0.0, 0, 0]],
        units=name,
        types=[{"mass": 1.0, "cs": 1e-9, "viscosity": 0.0}],
        rheo={"cut": 6.0},
        evolve={"steps": 1, "timestep": n.time * per_ns, "compare_at": [1]},
        compare=["rho", "x"],
    )
    (found,), right = lammps.fields(scene), scene.predicted(RAW)
    assert agree(found["rho"], scene.predicted(RAW, DENSITY), "rho") and not agree(found["rho"], right, "rho")
    # The particles come closer in the step, by which the rate of its second half differs; more is of second order.
    later = divergence(name, 2.0 - n.rate * n.time / divergence(name)) / divergence(name)
    mean, more = (1 + later) / 2, (later - 1) ** 2
    assert right.fields[0]["rho"][0] - 1 == pytest.approx(n.right * mean, rel=more, abs=0)
    assert found["rho"][0] - 1 == pytest.approx(wrong * mean, rel=0, abs=wrong * more + wrong.half_unit)
    return {name: UNITS[name].energy, "slowly": 1 / UNITS["real"].energy}


@works_around(DENSITY, 2)
@pytest.mark.parametrize("name", NAMES)
@recomputes(DENSITY, "volumes")
def test_sums_have_no_rates_and_the_volumes_of_numbers_as_they_stand(lammps: Engine, name: UnitStyle) -> dict[str, Any]:
    scene = water(name, rho=None, rheo={"cut": 14.0, "rho_sum": True}, compare=["rho"])
    (found,), right, raw = lammps.fields(scene), scene.predicted(), scene.predicted(RAW)
    assert is_multiple(found["rho"], UNITS[name].density, right, raw, "rho") and agree(found["rho"], raw, "rho")
    return {"volumes": UNITS[name].density}
