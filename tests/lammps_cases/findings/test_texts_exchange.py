"""Texts of the findings about exchange between processes and images, checked with LAMMPS and the reference."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from eos_ref.eos.bounds import EPS
from tests.support.printed import ENTRIES, printed, recomputes
from tests.support.small_scene import Engine, SmallScene, agree, is_multiple, small_scene

pytestmark = pytest.mark.lammps

TWICE, BEHIND, ALIGNED = "boundary-pairs-twice", "images-left-behind", "aligned-pairs-twice"
APART = {"newton": False, "newton_bond": True}  # newton off on


def two(first: float, **options: Any) -> SmallScene:
    """Two particles at distance 1 in a periodic box of 8, the first at some x."""
    return small_scene([[first, 4.0], [(first + 1) % 8, 4.0]], (8, 8), **options)


@recomputes(TWICE, "distance cut", given="inside across")
def test_boundary_pairs_twice(lammps: Engine) -> dict[str, Any]:
    n = printed(TWICE)
    summed: dict[str, Any] = {"rheo": {"rho_sum": True}, "compare": ["rho"], "rho": None}
    for first, number in ((3.0, n.inside), (7.5, n.across)):
        scene = two(first, engine=APART, **summed)
        (snapshot,) = lammps.fields(scene, every_step=True)
        assert all(map(number.is_rounded, snapshot["rho"]))
        assert agree(snapshot["rho"], scene.predicted(TWICE, snapshot=snapshot), "rho")
        assert all(map(n.inside.is_rounded, scene.predicted().fields[0]["rho"]))
    return {"distance": 1.0, "cut": scene.problem.model.cut}


def test_pairs_between_processes_count_twice(lammps: Engine) -> None:
    """Without any periodic boundary, too."""
    inside = {"lattice": "sq", "spacing": 1.0, "cells": [1, 1], "periodic": [False, False]}
    scene = two(3.5, engine=APART | {"ranks": 2}, positions=inside, rheo={"rho_sum": True}, compare=["rho"], rho=None)
    (snapshot,) = lammps.fields(scene, every_step=True)
    variant = ENTRIES[TWICE].model_variant
    assert variant and variant.applies(scene.problem)
    assert agree(snapshot["rho"], scene.predicted(TWICE, snapshot=snapshot), "rho")
    assert not agree(snapshot["rho"], scene.predicted(), "rho")


@pytest.mark.parametrize("newton", [(True, True), (True, False), (False, False)])
def test_the_other_settings_are_right(lammps: Engine, newton: tuple[bool, bool]) -> None:
    """The settings that the workaround names, for sums and for gradients."""
    engine = dict(zip(("newton", "newton_bond"), newton, strict=True))
    scene = two(7.5, engine=engine, rheo={"rho_sum": True}, compare=["rho", "grad/v"], rho=None, v=[[0.3, 0], [0, 0]])
    (snapshot,) = lammps.fields(scene)
    assert agree(snapshot["rho"], scene.predicted(), "rho") and agree(snapshot["grad/v"], scene.predicted(), "grad/v")


def test_quantities_counted_twice_or_once(lammps: Engine) -> None:
    """Every quantity that the finding names, with fluid over solids at rest between two periodic boundaries."""
    twice = ["chi", "grad/v", "surface/n", "surface/divr", "rho"]
    once = ["coordination", "drho"]
    places = np.stack(np.meshgrid(np.arange(4) + 0.5, np.arange(6) + 1.0), axis=-1).reshape(-1, 2)
    solid_n = places[:, 1] < 3
    scene = small_scene(
        places + 0.1 * np.sin(7 * places[:, ::-1] + places),
        (4, 8),
        v=np.where(solid_n[:, None], 0.0, np.cos(places)),
        rho=1.1 + 0.05 * np.sin(3 * places[:, 0]),
        kind=np.where(solid_n, 2, 1),
        types=[{"mass": 1.0}, {"mass": 1.0, "phase": "solid"}],
        positions={"lattice": "sq", "spacing": 1.0, "cells": [1, 1], "periodic": [True, False]},
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
    assert not any(agree(snapshot[field], right, field) for field in twice)
    assert all(agree(snapshot[field], right, field) for field in once)


def parting(first: float, engine: dict[str, bool] | None = None, **evolve: Any) -> SmallScene:
    """Two particles at distance 1 that separate in a box of 8 that grows by 5 % a step."""
    grows = {"steps": 2, "timestep": 0.05, "deform": {"x": 1.0}} | evolve
    velocities = [[-1.0, 0.0], [1.0, 0.0]]
    return two(first, v=velocities, compare=["coordination", "rho"], forces=[HELD], evolve=grows, engine=engine or {})


HELD = {"style": "setforce", "vector": [0.0, 0.0]}


@recomputes(BEHIND, "volume distance cut speed length percent timestep", given="inside across")
def test_images_left_behind(lammps: Engine) -> dict[str, Any]:
    n = printed(BEHIND)
    for first, number in ((3.5, n.inside), (7.5, n.across)):
        scene = parting(first)
        found = lammps.fields(scene, every_step=True)
        assert all(map(number.is_rounded, found[2]["rho"]))
        assert all(map(n.inside.is_rounded, scene.predicted().fields[2]["rho"]))
        assert agree(found[2]["rho"], scene.predicted(), "rho", 2) == (first == 3.5), "the middle agrees"
        assert agree(found[2]["rho"], scene.predicted(BEHIND, snapshot=found[0]), "rho", 2)
    return {
        "volume": scene.problem.model.mass[0] / scene.atoms.rho_n,
        "distance": 1.0,
        "cut": scene.problem.model.cut,
        "speed": np.ptp(scene.atoms.v_nc),
        "length": scene.atoms.high_c[:2],
        "percent": 100 * scene.scene.evolve.timestep * scene.scene.evolve.deform.x,
        "timestep": scene.scene.evolve.timestep,
    }


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
    scene = small_scene(
        [[7.0, 4.0], [2.2, 4.0]],
        (8, 8),
        rheo=rheo,
        compare=["coordination"],
        forces=[HELD],
        evolve={"steps": 1, "timestep": 0.05, "deform": {"x": 2.0}},
    )
    found = lammps.fields(scene, every_step=True)
    assert [list(at["coordination"]) for at in found] == [[0, 0], [1, 0] if late else [0, 0]]
    assert agree(found[1]["coordination"], scene.predicted(BEHIND, snapshot=found[0]), "coordination", 1)


def aligned(distance: float, across: bool = True, off: float = 0.0, lean: float = 2.0, **options: Any) -> SmallScene:
    """Two particles, ``off`` from the same x, optionally with a boundary of a tilted box between them."""
    apart, x = 8 * distance if across else 0.0, 2 * distance
    second = [x + (lean * distance if across else 0.0) + off, 0.5 * distance - distance + apart]
    first = [x, 0.5 * distance] if across else [x, 2.5 * distance]
    second = second if across else [x + off, 1.5 * distance]
    tilt = {"tilt": [lean * distance]} if lean else {}
    inside = {"lattice": "sq", "spacing": distance, "cells": [1, 1], **tilt}
    rheo = {"cut": 3 * distance} | options.pop("rheo", {"rho_sum": True})
    mass = {"types": [{"mass": distance**2}]}
    given: dict[str, Any] = mass | {"compare": ["rho"], "rho": None, "positions": inside} | options
    return small_scene([first, second], (8 * distance, 8 * distance), rheo=rheo, **given)


@recomputes(ALIGNED, "cut", given="mass distance inside across far")
def test_aligned_pairs_twice(lammps: Engine) -> dict[str, Any]:
    n = printed(ALIGNED)
    mass, distance, middle, across, far = n.mass, n.distance, n.inside, n.across, n.far
    for scale, number, own in ((1, across, mass), (10, middle, far)):
        assert np.isclose(own, (scale * distance) ** 2, rtol=EPS, atol=0)
        for place, shown in ((True, number), (False, middle)):
            scene = aligned(scale * distance, place)
            (snapshot,) = lammps.fields(scene, every_step=True)
            assert all(map(shown.is_rounded, snapshot["rho"]))
            assert agree(snapshot["rho"], scene.predicted(ALIGNED, snapshot=snapshot), "rho")
            assert all(map(middle.is_rounded, scene.predicted().fields[0]["rho"]))
    return {"cut": 3 * distance}


def shearing(rate: float) -> dict[str, Any]:
    """One step, at whose end the box grows, and tilts if there is a rate."""
    return {"steps": 1, "timestep": 1e-9, "compare_at": [0, 1], "deform": {"x": 0.1, "xy": rate}}


def beside(limit: float, side: int) -> float:
    """The next distance of six bits below or above a limit: a few multiples of it are exact."""
    fraction, exponent = math.frexp(limit)
    return math.ldexp((math.floor(fraction * 64) if side < 0 else math.ceil(fraction * 64)) / 64, exponent)


@pytest.mark.parametrize(
    ("scene", "twice"),
    [
        *[
            (aligned(beside(limit, side), units=units), side < 0)
            for units, limit in (
                ("lj", float(printed(ALIGNED).near)),
                ("nano", 1e-3),
                ("micro", 1e-6),
                ("cgs", 1e-10),
                ("si", 1e-12),
            )
            for side in (-1, 1)
        ],
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
    twice = ["grad/v", "shift/v", "f"]
    fluid: dict[str, Any] = {"compare": ["coordination", *twice], "v": [[0.3, 0.1], [0.0, -0.2]], "rho": [1.0, 1.3]}
    scene = aligned(0.008, rheo={"shift": True}, **fluid)
    (snapshot,) = lammps.fields(scene, every_step=True)
    right, lacking = scene.predicted(), scene.predicted("force-per-volume", snapshot=snapshot)
    variant = scene.predicted("force-per-volume", ALIGNED, snapshot=snapshot)
    for field in fluid["compare"]:
        assert agree(snapshot[field], variant, field)
        assert agree(snapshot[field], lacking, field) == (field == "coordination")
    assert is_multiple(snapshot["grad/v"], 2.0, right, variant, "grad/v")
