"""Findings about pairs: how often they count, where images are, whose masses they have, and their virials."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from lammps_cases.findings.shifting import ColorMassOfType
from tests.support.printed import ENTRIES, printed, recomputes, works_around
from tests.support.small_scene import Engine, Floats, SmallScene, agree, is_multiple, small_scene

pytestmark = pytest.mark.lammps

TWICE, BEHIND, ALIGNED = "boundary-pairs-twice", "images-left-behind", "aligned-pairs-twice"
FORCES, FIRST, SOUND, NORMAL = "force-per-volume", "mass-of-first", "sound-of-mass-of-type", "cross-type-mass-of-type"
CANCEL, PLACES = "virials-cancel", "virial-of-places"
APART = {"newton": False, "newton_bond": True}  # newton off on
OPEN = {"lattice": "sq", "spacing": 1.0, "cells": [1, 1], "periodic": [False, False]}
HELD = {"style": "setforce", "vector": [0.0, 0.0]}


# --- boundary-pairs-twice


def two(first: float, **options: Any) -> SmallScene:
    """Two particles at distance 1 in a periodic box of 8, the first at some x."""
    return small_scene([[first, 4.0], [(first + 1) % 8, 4.0]], (8, 8), **options)


def test_pairs_between_processes_count_twice(lammps: Engine) -> None:
    """Without any periodic boundary, too."""
    scene = two(3.5, engine=APART | {"ranks": 2}, positions=OPEN, rheo={"rho_sum": True}, compare=["rho"], rho=None)
    (snapshot,) = lammps.fields(scene, every_step=True)
    variant = ENTRIES[TWICE].model_variant
    assert variant and variant.applies(scene.problem)
    assert agree(snapshot["rho"], scene.predicted(TWICE, snapshot=snapshot), "rho")
    assert not agree(snapshot["rho"], scene.predicted(), "rho")


@works_around(TWICE, 1)
@pytest.mark.parametrize("newton", [(True, True), (True, False), (False, False)])
def test_the_other_settings_are_right(lammps: Engine, newton: tuple[bool, bool]) -> None:
    """For sums and for gradients."""
    engine = dict(zip(("newton", "newton_bond"), newton, strict=True))
    scene = two(7.5, engine=engine, rheo={"rho_sum": True}, compare=["rho", "grad/v"], rho=None, v=[[0.3, 0], [0, 0]])
    (snapshot,) = lammps.fields(scene)
    assert all(agree(snapshot[field], scene.predicted(), field) for field in scene.scene.compare)


def test_quantities_counted_twice_or_once(lammps: Engine) -> None:
    """Every quantity that the finding names, with fluid over solids at rest between two periodic boundaries."""
    twice, once = ["chi", "grad/v", "surface/n", "surface/divr", "rho"], ["coordination", "drho"]
    places = np.stack(np.meshgrid(np.arange(4) + 0.5, np.arange(6) + 1.0), axis=-1).reshape(-1, 2)
    solid_n = places[:, 1] < 3
    scene = small_scene(
        places + 0.1 * np.sin(7 * places[:, ::-1] + places),
        (4, 8),
        v=np.where(solid_n[:, None], 0.0, np.cos(places)),
        rho=1.1 + 0.05 * np.sin(3 * places[:, 0]),
        kind=np.where(solid_n, 2, 1),
        types=[{"mass": 1.0}, {"mass": 1.0, "phase": "solid"}],
        positions=OPEN | {"periodic": [True, False]},
        rheo={
            "cut": 2.0,
            "interface_reconstruct": True,
            "surface_detection": {"style": "coordination", "limit": 9, "splash": 0},
        },
        pair={"rho_damp": 0.1},
        compare=[*twice, *once],
        engine=APART,
    )
    (snapshot,) = lammps.fields(scene, every_step=True)
    right, variant = scene.predicted(), scene.predicted(TWICE, snapshot=snapshot)
    assert all(agree(snapshot[field], variant, field) for field in (*twice, *once))
    assert [field for field in (*twice, *once) if agree(snapshot[field], right, field)] == once


# --- images-left-behind


def parting(first: float, engine: dict[str, bool] | None = None, **evolve: Any) -> SmallScene:
    """Two particles at distance 1 that separate in a box of 8 that grows by 5 % a step."""
    grows = {"steps": 2, "timestep": 0.05, "deform": {"x": 1.0}} | evolve
    velocities = [[-1.0, 0.0], [1.0, 0.0]]
    return two(first, v=velocities, compare=["coordination", "rho"], forces=[HELD], evolve=grows, engine=engine or {})


def test_without_remap_images_lag_by_the_growth_of_the_edges(lammps: Engine) -> None:
    scene = parting(7.5, deform={"x": 1.0, "remap": "none"})
    found = lammps.fields(scene, every_step=True)
    assert agree(found[2]["rho"], scene.predicted(BEHIND, snapshot=found[0]), "rho", 2)
    unmoved = parting(7.5, deform={})  # until the first half of the second step nothing has met an image elsewhere
    half = lammps.fields(unmoved)[1]["rho"]
    assert np.array_equal(found[1]["rho"], half) and not agree(found[2]["rho"], scene.predicted(), "rho", 2)


def test_pairs_that_count_twice_use_the_image_of_either_particle(lammps: Engine) -> None:
    """An image that is left behind lies at another distance than the particle that has moved, in either's list."""
    scene = parting(7.2, engine=APART)
    found = lammps.fields(scene, every_step=True)
    assert agree(found[2]["rho"], scene.predicted(TWICE, BEHIND, snapshot=found[0]), "rho", 2)
    for one in (TWICE, BEHIND):
        assert not agree(found[2]["rho"], scene.predicted(one, snapshot=found[0]), "rho", 2)


@works_around(BEHIND, 1)
def test_the_error_of_a_step_shrinks_with_the_square_of_its_length(lammps: Engine) -> None:
    def error(dt: float) -> float:
        scene = parting(7.5, timestep=dt)
        return float(np.abs(lammps.fields(scene)[2]["rho"] - scene.predicted().fields[2]["rho"]).max())

    # Of the next order: particles part by 1e-3 of their distance in the longer step, by fifth powers of which densities
    # fall, in two steps.
    assert error(0.0005) / error(0.00025) == pytest.approx(4.0, rel=2 * 5 * 1e-3)


@pytest.mark.parametrize(
    ("rheo", "late"),
    [
        ({}, True),
        ({"kernel": "RK0"}, False),
        ({"surface_detection": {"style": "divergence", "limit": 1, "splash": 0}}, False),
    ],
)
def test_coordination_numbers_are_late_unless_counted_before(lammps: Engine, rheo: dict[str, Any], late: bool) -> None:
    """Particles 3.2 apart across the boundary: one has moved towards the other's image, to 2.9; this one has not."""
    x, evolve = [[7.0, 4.0], [2.2, 4.0]], {"steps": 1, "timestep": 0.05, "deform": {"x": 2.0}}
    scene = small_scene(x, (8, 8), rheo=rheo, compare=["coordination"], forces=[HELD], evolve=evolve)
    found = lammps.fields(scene, every_step=True)
    assert [list(at["coordination"]) for at in found] == [[0, 0], [1, 0] if late else [0, 0]]
    assert agree(found[1]["coordination"], scene.predicted(BEHIND, snapshot=found[0]), "coordination", 1)


# --- aligned-pairs-twice


def aligned(distance: float, off: float = 0.0, lean: float = 2.0, **options: Any) -> SmallScene:
    """Two particles, ``off`` from the same x, with the boundary of a tilted box between them."""
    x = [[2 * distance, 0.5 * distance], [2 * distance + lean * distance + off, 7.5 * distance]]
    inside = {"lattice": "sq", "spacing": distance, "cells": [1, 1], **({"tilt": [lean * distance]} if lean else {})}
    rheo = {"cut": 3 * distance} | options.pop("rheo", {"rho_sum": True})
    mass = {"types": [{"mass": distance**2}]}
    given: dict[str, Any] = mass | {"compare": ["rho"], "rho": None, "positions": inside} | options
    return small_scene(x, (8 * distance, 8 * distance), rheo=rheo, **given)


def shearing(rate: float) -> dict[str, Any]:
    """One step, at whose end the box grows, and tilts if there is a rate."""
    return {"steps": 1, "timestep": 1e-9, "compare_at": [0, 1], "deform": {"x": 0.1, "xy": rate}}


def beside(limit: float, side: int) -> float:
    """The next distance of six bits below or above a limit: a few multiples of it are exact."""
    fraction, exponent = math.frexp(limit)
    return math.ldexp((math.floor(fraction * 64) if side < 0 else math.ceil(fraction * 64)) / 64, exponent)


LIMITS = {"lj": float(printed(ALIGNED).near), "nano": 1e-3, "micro": 1e-6, "cgs": 1e-10, "si": 1e-12}


@works_around(ALIGNED, 2)
@pytest.mark.parametrize(
    ("scene", "twice"),
    [
        *[(aligned(beside(limit, side), units=units), side < 0) for units, limit in LIMITS.items() for side in (-1, 1)],
        (aligned(0.008, off=1e-9), False),
        (aligned(0.008, lean=0.0), False),
        (aligned(0.008, lean=0.0, evolve=shearing(0.0)), False),
        (aligned(0.008, lean=0.0, evolve=shearing(0.1)), True),
        (aligned(0.008, engine={"newton": False}), False),
        (aligned(0.008, engine={"newton": True, "newton_bond": False}), True),
    ],
)
@recomputes(ALIGNED, given="near")
def test_which_pairs_are_close_and_aligned(lammps: Engine, scene: SmallScene, twice: bool) -> dict[str, Any]:
    snapshot, *_ = lammps.fields(scene, every_step=True)
    assert agree(snapshot["rho"], scene.predicted(), "rho") == (not twice)
    assert agree(snapshot["rho"], scene.predicted(ALIGNED, snapshot=snapshot), "rho")
    variant = ENTRIES[ALIGNED].model_variant
    assert variant and (variant.applies(scene.problem) or not twice)
    return {}


def test_quantities_of_aligned_pairs_counted_twice_or_once(lammps: Engine) -> None:
    """Every quantity that the finding names; forces also lack a volume."""
    fluid: dict[str, Any] = {"compare": ["coordination", "grad/v", "shift/v", "f"], "rho": [1.0, 1.3]}
    scene = aligned(0.008, rheo={"shift": True}, v=[[0.3, 0.1], [0.0, -0.2]], **fluid)
    (snapshot,) = lammps.fields(scene, every_step=True)
    right, lacking = scene.predicted(), scene.predicted(FORCES, snapshot=snapshot)
    variant = scene.predicted(FORCES, ALIGNED, snapshot=snapshot)
    for field in fluid["compare"]:
        assert agree(snapshot[field], variant, field)
        assert agree(snapshot[field], lacking, field) == (field == "coordination")
    assert is_multiple(snapshot["grad/v"], 2.0, right, variant, "grad/v")


# --- masses


@pytest.mark.parametrize(("order", "factors"), [(1, (2 / 3, 1.0)), (-1, (3 / 2, 1.0))])
def test_one_of_a_pair_has_the_mass_of_the_other(lammps: Engine, order: int, factors: tuple[float, float]) -> None:
    """The first in the list, whose place decides."""
    rho, m = [1.4, 1.35][::order], [2.0, 3.0][::order]
    own = small_scene(
        [[4.0, 4.0], [5.0, 4.0]], [9, 9], rho=rho, own=m, positions=OPEN, types=[{"mass": 7.0, "viscosity": 0.0}]
    )
    found, *_ = lammps.fields(own, every_step=True)
    first = own.predicted(FIRST, FORCES, snapshot=found)
    assert agree(found["f"], first, "f")
    assert is_multiple(found["f"], np.array(factors)[:, None], own.predicted(FORCES), first, "f")


def test_the_repulsion_by_a_wall_of_gas(lammps: Engine) -> None:
    x = [[2 + 0.5 * i, 2 + 0.5 * j] for i in range(8) for j in range(8)] + [[5.85, 3.8]]
    types = [{"mass": 4.0, "viscosity": 0.0}, {"mass": 4.0, "viscosity": 0.0, "phase": "solid"}]
    law, walls = [{"types": "*", "style": "ideal/gas", "gamma": 1.4}], {"interface_reconstruct": True}
    given: dict[str, Any] = {"types": types, "pressure": law, "rheo": walls, "positions": OPEN}
    scene = small_scene(x, [12, 12], e=2.0, own=1.0, kind=[2] * 64 + [1], **given)
    (found,) = lammps.fields(scene)
    assert agree(found["f"], scene.predicted(SOUND), "f") and not agree(found["f"], scene.predicted(), "f")


def across(keep: float, order: int) -> SmallScene:
    """A particle and two of another fluid, along x and along y, whose labels rise or fall."""
    n = printed(NORMAL)
    x, own = np.array([[4.0, 4.0], [5.0, 4.0], [4.0, 5.0]]), np.array([1.0, n.own_1, n.own_2])
    rheo, types = {"shift": {"scale_cross_type": [keep, 0.0, 0.0]}}, [{"mass": float(n.of_type)}] * 2
    more: dict[str, Any] = {"types": types, "engine": {"sort": 0}, "rheo": rheo, "positions": OPEN}
    at, kind = slice(None, None, order), np.array([1, 2, 2])
    return small_scene(x[at], [9, 9], v=[[0.3, 0.1]] * 3, own=own[at], kind=kind[at], compare=["shift/v"], **more)


@pytest.mark.parametrize(("order", "side"), [(1, "right"), (-1, "wrong")])
@recomputes(NORMAL, given="own_1 own_2 of_type right_x right_y wrong_x wrong_y")
def test_the_normal_of_masses_and_of_those_of_types(lammps: Engine, order: int, side: str) -> dict[str, Any]:
    n = vars(printed(NORMAL))
    normal, at = (n[f"{side}_x"], n[f"{side}_y"]), 0 if order == 1 else 2
    scene, whole = across(0.0, order), across(1.0, order).predicted()
    (found,) = lammps.fields(scene, every_step=True)
    scaled = scene.predicted(NORMAL, snapshot=found)
    taken_c = whole.fields[0]["shift/v"][at] - scaled.fields[0]["shift/v"][at]
    bound = whole.bounds[0]["shift/v"][at].sum() + scaled.bounds[0]["shift/v"][at].sum()
    assert np.any(np.abs(taken_c) > bound)
    assert abs(taken_c[0] * normal[1] - taken_c[1] * normal[0]) <= max(normal) * bound
    return {}


def test_sums_of_the_last_pair_have_the_masses_of_types(lammps: Engine, monkeypatch: pytest.MonkeyPatch) -> None:
    """With RK1, where the direction of that pair alone does not decide."""
    random = np.random.default_rng(3)
    x = np.indices((6, 6)).reshape(2, -1).T + 0.5 + random.uniform(-0.1, 0.1, (36, 2))
    rheo = {"kernel": "RK1", "shift": {"scale_cross_type": [0.0, 0.0, 0.0]}}
    more: dict[str, Any] = {"types": [{"mass": 3.0}, {"mass": 1.0}], "rheo": rheo, "compare": ["shift/v"]}
    v, own, kind = random.uniform(-1, 1, x.shape), random.uniform(1, 2, 36), random.integers(1, 3, 36)
    scene = small_scene(x, [6, 6], v=v, own=own, kind=kind, **more)
    (found,) = lammps.fields(scene, every_step=True)
    assert agree(found["shift/v"], scene.predicted("cross-type-normal", snapshot=found), "shift/v")
    monkeypatch.setattr(ColorMassOfType, "sloping_volume", ArrayEvaluator.sloping_volume)
    assert not agree(found["shift/v"], scene.predicted("cross-type-normal", snapshot=found), "shift/v")


# --- virials


def lattice(size: int, p: float, **engine: Any) -> SmallScene:
    """A fluid of volume 1 at rest, with a kernel whose gradients are exact; of a linear law with rho0 = c = 1."""
    x = np.stack(np.meshgrid(np.arange(size) + 0.5, np.arange(size) + 0.5), axis=-1).reshape(-1, 2)
    given: dict[str, Any] = {"types": [{"mass": 1 + p, "viscosity": 0.0}], "rheo": {"kernel": "RK1"}, "engine": engine}
    return small_scene(x, [size, size], rho=1 + p, compare=["f", "stress/atom", "virial", "press"], **given)


@works_around(CANCEL, 1)
@recomputes(CANCEL, "without", given="pressure virial size")
def test_pressure_of_a_fluid_at_rest(lammps: Engine) -> dict[str, Any]:
    n = printed(CANCEL)
    p, virial, size = n.pressure, n.virial, int(n.size)
    found = [lammps.fields(lattice(each, p, newton=False))[0]["virial"][0] for each in (size, 2 * size)]
    assert all(found[1][a, a] < 0.6 * n.without for a in (0, 1)), "less in a larger box"
    scene = lattice(size, p)
    (snapshot,), right = lammps.fields(scene), scene.predicted()
    for pressures in (snapshot, right.fields[0]):  # each within the bound of the number, and of the reference's
        assert np.all(np.abs(pressures["press"] - virial) <= 2 * right.bounds[0]["press"])
        assert np.all(np.abs(pressures["virial"] - virial * np.eye(2)) <= 2 * right.bounds[0]["virial"])
    assert agree(snapshot["virial"], right, "virial") and agree(snapshot["press"], right, "press")
    # The sum of all virials of particles is that of the system.
    total, bound = (of[0]["stress/atom"].sum(axis=0) / size**2 for of in (right.fields, right.bounds))
    assert np.all(np.abs(-total - virial * np.eye(2)) <= bound)
    return {"without": np.diag(found[0])}


def disordered(
    displacement: Floats, kernel: str = "RK1", compressed: float = 1.0, order: int = 1, **engine: Any
) -> SmallScene:
    """Particles of volume 1, or those of one type of less, in an open box, moved together."""
    places = np.stack(np.meshgrid(np.arange(4) + 3.5, np.arange(4) + 3.5), axis=-1).reshape(-1, 2)
    x = places + 0.1 * np.sin(7 * places[:, ::-1] + places**2) + displacement
    kind = (np.arange(16) // 3 % 2)[::order]
    rho = np.array([1.25, 1.4])
    return small_scene(
        x[::order],
        [12, 12],
        rho=(rho * [1.0, compressed])[kind],
        kind=kind + 1,
        types=[{"mass": m, "viscosity": 0.0} for m in rho],
        compare=["f", "stress/atom", "virial", "press"],
        positions=OPEN,
        rheo={"kernel": kernel, "zmin": 6},
        engine=engine,
    )


def test_the_virial_changes_by_displacement_times_force(lammps: Engine) -> None:
    by = np.array([1.0, -0.5])
    scenes = [disordered(place) for place in (np.zeros(2), by)]
    found = [lammps.fields(scene, every_step=True)[0] for scene in scenes]
    right = [scene.predicted() for scene in scenes]
    total = found[0]["f"].sum(axis=0)
    assert np.all(np.abs(total) > 1e3 * right[0].bounds[0]["f"].max())
    change = np.outer(by, total) / 144
    change[1, 0] = change[0, 1]
    explained = [scene.predicted(CANCEL, PLACES, snapshot=of) for scene, of in zip(scenes, found, strict=True)]
    bound = sum(each.bounds[0]["virial"][0] for each in explained)
    assert np.all(np.abs(found[1]["virial"][0] - found[0]["virial"][0] - change) <= bound)
    assert agree(right[1].fields[0]["virial"], right[0], "virial")
    assert not agree(found[0]["virial"], right[0], "virial")


def test_virials_of_a_pair_depend_on_the_order_of_the_list(lammps: Engine) -> None:
    """The same particles in reverse order have different virials where forces do not cancel."""
    scenes = [disordered(np.zeros(2), order=order) for order in (1, -1)]
    one, other = (lammps.fields(scene)[0] for scene in scenes)
    assert all(agree(found["f"], scene.predicted(), "f") for found, scene in zip((one, other), scenes, strict=True))
    largest = np.abs(one["stress/atom"]).max()
    assert largest > 0 and np.abs(other["stress/atom"][::-1] - one["stress/atom"]).max() > 0.1 * largest


@pytest.mark.parametrize("engine", [{}, {"newton": False}])
def test_the_variants_reproduce_both(lammps: Engine, engine: dict[str, bool]) -> None:
    scene = disordered(np.zeros(2), **engine)
    snapshot, *_ = lammps.fields(scene, every_step=True)
    found = scene.predicted(CANCEL, PLACES, snapshot=snapshot)
    assert all(agree(snapshot[field], found, field) for field in ("stress/atom", "virial", "press"))


@pytest.mark.parametrize("compressed", [1.0, 1.2])
def test_the_virial_of_the_quintic_kernel(lammps: Engine, compressed: float) -> None:
    """Right, whatever the origin, if all particles have the same volume."""
    scene = disordered(np.zeros(2), "quintic", compressed)
    snapshot, *_ = lammps.fields(scene, every_step=True)
    assert agree(snapshot["virial"], scene.predicted(FORCES), "virial") == (compressed == 1)
    assert agree(snapshot["virial"], scene.predicted(FORCES, PLACES, snapshot=snapshot), "virial")
