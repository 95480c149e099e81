"""The findings about forces and heat: every number of their texts, by LAMMPS and by the reference."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from eos_ref.eos.bounds import EPS
from lammps_cases.claims.probes.manual import probes
from lammps_cases.claims.probes.probe import edited
from tests.support.printed import ENTRIES, printed, recomputes
from tests.support.small_scene import Engine, SmallScene, agree, is_multiple, small_scene

pytestmark = pytest.mark.lammps

APART = np.array([[4.0, 4.0], [5.0, 4.0]])  # at distance 1


def pair(x: Any = APART, **options: Any) -> SmallScene:
    """Two particles, with the cutoff of the texts."""
    options = {"kind": [1, 2], "rheo": {"cut": 3.0}} | options
    return small_scene(x, (12, 12), **options)


# --- force-per-volume

FORCES = "force-per-volume"
PARTS: dict[str, dict[str, Any]] = {
    "pressure": {"types": [{"mass": 1.0, "viscosity": 0.0}] * 2},
    "viscous": {"types": [{"mass": 1.0, "cs": 1e-9, "viscosity": 0.3}] * 2, "v": [[0.2, 0.1], [0.0, 0.0]]},
    "artificial viscous": {
        "types": [{"mass": 1.0, "cs": 1e-3, "viscosity": 0.0}] * 2,
        "v": [[0.2, 0.1], [0.0, 0.0]],
        "pair": {"artificial_visc": 0.7},
    },
}


@pytest.mark.parametrize("part", PARTS)
def test_forces_lack_a_volume_each(lammps: Engine, part: str) -> None:
    """f is the right force over V_i; the acceleration is f over the mass; with volumes of 1 nothing shows."""
    rho = np.array([1.4, 1.35])
    given = PARTS[part]
    wrong = pair(**given, rho=rho)
    found = lammps.fields(wrong)[0]["f"]
    assert is_multiple(found, rho[:, None], wrong.predicted(), wrong.predicted(FORCES), "f")
    assert np.abs(found).max() > 0 and agree(found, wrong.predicted(FORCES), "f")
    heavy = given["types"][0] | {"mass": 2.5}
    moved = pair(**given | {"types": [heavy] * 2}, rho=rho, compare=["v"], evolve={"steps": 1, "timestep": 0.004})
    assert agree(lammps.fields(moved)[-1]["v"], moved.predicted(FORCES), "v", -1)
    assert not agree(lammps.fields(moved)[-1]["v"], moved.predicted(), "v", -1)
    unit = pair(**given, rho=1.0)
    assert agree(lammps.fields(unit)[0]["f"], unit.predicted(), "f")


@recomputes(FORCES, "mass distance cut wrong_1 wrong_2 right_1 right_2", given="rho_1 rho_2")
def test_force_per_volume(lammps: Engine) -> dict[str, Any]:
    n = printed(FORCES)
    scene = pair(types=[{"mass": 1.0}] * 2, rho=[n.rho_1, n.rho_2])
    lammps_n, right = lammps.fields(scene)[0]["f"][:, 0], scene.predicted().fields[0]["f"][:, 0]
    variant = scene.predicted(FORCES).fields[0]["f"][:, 0]
    return {
        "mass": scene.atoms.mass_n,
        "distance": np.diff(APART[:, 0]),
        "cut": scene.problem.model.cut,
        **{f"wrong_{k + 1}": (lammps_n[k], variant[k]) for k in (0, 1)},
        **{f"right_{k + 1}": right[k] for k in (0, 1)},
    }


@recomputes(FORCES, given="times")
def test_the_missing_volume_depends_on_the_resolution(lammps: Engine) -> dict[str, Any]:
    factor = printed(FORCES).times
    errors, relative = [], np.zeros(2)
    gravity = [{"style": "gravity", "vector": [0.0, -0.75]}]
    for size in (1.0, 0.5):
        types = [{"mass": 1.3 * size**2}] * 2
        fluid = pair(APART * size, types=types, rho=[1.4, 1.35], rheo={"cut": 3.0 * size})
        right, wrong = fluid.predicted(), fluid.predicted(FORCES)
        along = [(side.fields[0]["f"][:, 0], side.bounds[0]["f"][:, 0]) for side in (right, wrong)]
        errors.append(lammps.fields(fluid)[0]["f"][:, 0] / along[0][0])
        relative += sum(bound / np.abs(f) for f, bound in along) + 2 * EPS
        pulled = pair([[2.0, 2.0], [8.0, 8.0]], types=types, forces=gravity, rheo={"cut": 3.0 * size})
        assert agree(lammps.fields(pulled)[0]["f"], pulled.predicted(), "f")
    assert np.all(np.abs(errors[1] / (factor * errors[0]) - 1) <= relative)
    return {}


def test_unit_volumes_leave_a_factor(lammps: Engine) -> None:
    rho, rho0 = np.array([1.47, 0.79]), np.array([1.4, 0.8])
    scene = pair(types=[{"mass": r, "rho0": r, "cs": 3.0} for r in rho0], rho=rho, v=[[0.2, 0.1], [0.0, 0.0]])
    found = lammps.fields(scene)[0]["f"]
    assert is_multiple(found, (rho / rho0)[:, None], scene.predicted(), scene.predicted(FORCES), "f")


# --- heat

HEAT, OVER, MASS = "heat-is-temperature-rate", "heat-over-density", "temperature-without-mass"


def warm(
    mass: Any, energy: Any, kappa: Any = (1.0, 1.0), cv: Any = (1.0, 1.0), rho0: Any = (1.0, 1.0), **options: Any
) -> SmallScene:
    """Two particles with energies."""
    values = zip(mass, kappa, cv, rho0, strict=True)
    types = [
        {"mass": float(m), "conductivity": float(k), "specific_heat": float(c), "rho0": float(r), "cs": 1.0}
        for m, k, c, r in values
    ]
    options = {"compare": ["temperature", "heatflow"]} | options
    return pair(types=types, e=list(energy), **options)


@recomputes(HEAT, "distance cut wrong_1 wrong_2 right_1 right_2 capacity", given="mass_1 mass_2 T_1 T_2")
def test_heat_is_temperature_rate(lammps: Engine) -> dict[str, Any]:
    n = printed(HEAT)
    m = np.array([n.mass_1, n.mass_2])
    scene = warm(m, m * [n.T_1, n.T_2])
    found, right = lammps.fields(scene)[0], scene.predicted().fields[0]
    np.testing.assert_array_equal(found["temperature"], [n.T_1, n.T_2])
    assert is_multiple(found["heatflow"], 1 / m, scene.predicted(), scene.predicted(HEAT), "heatflow")
    assert m[0] == 2, "heat flows half as fast"
    return {
        "distance": np.diff(APART[:, 0]),
        "cut": scene.problem.model.cut,
        "capacity": m[0],
        **{f"wrong_{k + 1}": found["heatflow"][k] for k in (0, 1)},
        **{f"right_{k + 1}": right["heatflow"][k] for k in (0, 1)},
    }


DIFFERENT: dict[str, Any] = {"cv": (1.5, 0.8), "kappa": (0.7, 0.3), "rho0": (1.27, 0.81), "rho": [1.3, 0.79]}


@pytest.mark.parametrize("harmonic", [False, True])
def test_heat_flow_is_that_of_the_formula(lammps: Engine, harmonic: bool) -> None:
    """D is the mean of kappa/(rho0 cv), the volume that of the other particle; the energy grows by it."""
    mass = np.array([1.31, 0.62])
    options = DIFFERENT | {"pair": {"harmonic_means": harmonic}}
    scene = warm(mass, (2.0, 0.9), **options)
    found, right = lammps.fields(scene)[0]["heatflow"], scene.predicted()
    kappa, cv, rho0, rho = (np.array(options[name]) for name in ("kappa", "cv", "rho0", "rho"))

    def mean(values: Any) -> Any:
        return 2 / (1 / values[0] + 1 / values[1]) if harmonic else values.mean()

    change = mean(kappa / (rho0 * cv)) / (mean(kappa) * mass / rho)
    assert is_multiple(found, change, right, scene.predicted(HEAT), "heatflow", roundings=16)
    steps = {"steps": 1, "timestep": 0.004}
    moved = warm(mass, (2.0, 0.9), **options, evolve=steps, compare=["energy", "temperature"])
    assert agree(lammps.fields(moved)[-1]["energy"], moved.predicted(HEAT, FORCES), "energy", -1)
    assert not agree(lammps.fields(moved)[-1]["energy"], moved.predicted(FORCES), "energy", -1)


@pytest.mark.parametrize("harmonic", [False, True])
def test_heat_with_another_conductivity(lammps: Engine, harmonic: bool) -> None:
    rho0, rho, cv, kappa = np.array([1.27, 0.81]), np.array([1.3, 0.79]), np.array([1.5, 0.8]), np.array([0.7, 0.3])
    mass, means = 0.6 * rho0, {"pair": {"harmonic_means": harmonic}}
    options: dict[str, Any] = {"cv": cv, "rho0": rho0, "rho": rho} | means
    around = warm(mass, (2.0, 0.9), kappa * mass * cv, **options)
    found, right = lammps.fields(around)[0]["heatflow"], warm(mass, (2.0, 0.9), kappa, **options).predicted()
    # The conductivities are products that round on both sides of every mean.
    assert is_multiple(found, rho / rho0, right, around.predicted(HEAT), "heatflow", roundings=16)


@pytest.mark.slow
@recomputes(OVER, given="density part whole water")
def test_heat_over_density(older: Engine) -> dict[str, Any]:
    """Giving cv times the mass corrects the temperature of this LAMMPS, which takes E/cv for it."""
    n = printed(OVER)

    def flows(expected: float, mass: Any, rho: Any, **options: Any) -> bool:
        """Whether the heat flow is this part of the right one, within its bound and the roundings of the input."""
        mass, energy = np.array(mass), np.array([2.0, 0.9])
        cv, factor = options.pop("cv", np.ones(2)), options.pop("factor", 1.0)
        right = warm(mass, energy, options.get("kappa", (1.0, 1.0)), cv, rho=rho, rho0=options.get("rho0", (1.0, 1.0)))
        kappa = factor * np.array(options.get("kappa", (1.0, 1.0)))
        asked = warm(mass, energy, kappa, cv * mass, rho=rho, rho0=options.get("rho0", (1.0, 1.0)))
        found = older.fields(asked)[0]["heatflow"]
        return is_multiple(found, expected, right.predicted(), asked.predicted(OVER, MASS), "heatflow", roundings=16)

    assert flows(n.part / n.whole, (1.0, 1.0), [n.density] * 2)
    assert flows(1e-3, (900.0, 1100.0), [n.water] * 2)
    assert flows(2 / (1.3 + 0.8), (1.3, 0.6), [1.3, 0.8], kappa=(0.7, 0.3))
    rho0, cv = 1.25, np.array([1.5, 0.8])
    around = {"kappa": (0.7, 0.3), "rho0": (rho0, rho0), "factor": rho0, "cv": cv}
    assert flows(rho0 / (0.5 * (1.3 + 1.2)), (1.3, 0.6), [1.3, 1.2], **around)
    return {}


@pytest.mark.slow
@recomputes(MASS, "wrong_1 wrong_2", given="mass_1 mass_2 energy_1 energy_2 cv right_1 part whole")
def test_temperature_without_mass(lammps: Engine, older: Engine) -> dict[str, Any]:
    n = printed(MASS)
    cv = n.cv
    mass, energy = np.array([n.mass_1, n.mass_2]), np.array([n.energy_1, n.energy_2])
    temperature = {"compare": ["temperature"]}
    scene = warm(mass, energy, cv=(cv, cv), **temperature)
    right = [n.right_1, n.part / n.whole]
    # A product and a quotient, and the quotient that is expected.
    np.testing.assert_allclose(scene.predicted().fields[0]["temperature"], right, rtol=3 * 2.0**-53)
    wrong = older.fields(scene)[0]["temperature"]
    np.testing.assert_array_equal(wrong, [n.wrong_1, n.wrong_2])
    assert agree(lammps.fields(scene)[0]["temperature"], scene.predicted(), "temperature")
    around = warm(mass, energy, cv=mass * cv, **temperature)
    assert agree(older.fields(around)[0]["temperature"], scene.predicted(), "temperature")
    fine = warm(mass / 4, energy / 4, cv=(cv, cv), **temperature)
    np.testing.assert_array_equal(older.fields(fine)[0]["temperature"], wrong / 4)
    np.testing.assert_array_equal(fine.predicted().fields[0]["temperature"], scene.predicted().fields[0]["temperature"])
    gas = warm(mass, energy, compare=["pressure"], pressure=[{"types": "*", "style": "ideal/gas", "gamma": 1.4}])
    assert agree(older.fields(gas)[0]["pressure"], gas.predicted(), "pressure"), "E/m is the energy per mass"
    return {"wrong_1": wrong[0], "wrong_2": wrong[1]}


# --- harmonic-mean-undefined

HARMONIC = "harmonic-mean-undefined"


def coefficients(what: str, a: float, b: float, harmonic: bool = True) -> SmallScene:
    """Two fluids of some viscosity or conductivity each, at different velocities and temperatures."""
    per_type = [{"mass": 1.0, "viscosity": 0.3, "conductivity": 0.2, what: value} for value in (a, b)]
    moving = {"v": [[0.2, 0.1], [0.0, 0.0]], "e": np.array([2.0, 1.0]), "types": per_type, "rho": 1.0}
    return pair(**moving, pair={"harmonic_means": harmonic}, compare=["f", "heatflow"])


@pytest.mark.parametrize(("what", "field"), [("viscosity", "f"), ("conductivity", "heatflow")])
@recomputes(HARMONIC, given="large small tiny")
def test_harmonic_means(lammps: Engine, what: str, field: str) -> dict[str, Any]:
    """NaN of two zeros alone; infinite and 0 where the product leaves the range; right between."""
    n = printed(HARMONIC)
    large, small, workaround = n.large, n.small, n.tiny

    def found(a: float, b: float, harmonic: bool = True) -> Any:
        return lammps.fields(coefficients(what, a, b, harmonic))[0][field]

    def right(a: float, b: float) -> Any:
        return coefficients(what, a, b).predicted().fields[0][field]

    assert np.isnan(found(0.0, 0.0)).any() and np.isfinite(found(0.0, 0.0, harmonic=False)).all()
    assert not right(0.0, 0.0).any()
    assert not found(0.0, 1.0).any() and not right(0.0, 1.0).any()
    assert np.isinf(found(large, large)).any() and np.isfinite(right(large, large)).all()
    assert not found(small, small).any() and right(small, small).any()
    assert agree(found(workaround, workaround), coefficients(what, workaround, workaround).predicted(), field)
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


def test_variant_is_nan_where_lammps_is(lammps: Engine) -> None:
    """One coefficient that is not 0 is enough for a number; after a step there are no neighbours."""
    gap = 1e-9
    given: dict[str, Any] = {"rho": 1.0, "v": [[0.2, 0.1], [0.0, 0.0]], "pair": {"harmonic_means": True}}
    for fluids, fine in (((0.0, 0.0), False), ((0.0, 0.3), True), ((gap, gap), True)):
        scene = pair(types=[{"mass": 1.0, "viscosity": eta} for eta in fluids], **given)
        found = lammps.fields(scene)[0]["f"]
        assert np.isfinite(found).all() == fine and np.isfinite(scene.predicted().fields[0]["f"]).all()
        assert fine or np.isnan(found).all() == np.isnan(scene.predicted(HARMONIC).fields[0]["f"]).all()
    plain = pair(types=[{"mass": 1.0, "viscosity": 0.0}] * 2, **given | {"pair": {}})
    assert agree(lammps.fields(plain)[0]["f"], plain.predicted(), "f")
    later = pair(
        types=[{"mass": 1.0, "viscosity": 0.0}] * 2,
        compare=["x", "coordination"],
        evolve={"steps": 1, "timestep": 0.004},
        **given,
    )
    moved = lammps.fields(later)[-1]
    assert np.isnan(moved["x"]).all() and (moved["coordination"] == 0).all()
