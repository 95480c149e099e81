"""Texts of the findings about virials, checked with LAMMPS and the reference."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.support.printed import printed, recomputes
from tests.support.small_scene import Engine, Floats, SmallScene, agree, small_scene

pytestmark = pytest.mark.lammps

CANCEL, PLACES = "virials-cancel", "virial-of-places"
FIELDS = ["f", "stress/atom", "virial", "press"]
OPEN = {"lattice": "sq", "spacing": 1.0, "cells": [1, 1], "periodic": [False, False]}
NO_NEWTON = {"newton": False}


def at_rest(x: Any, box: list[float], p: float, **options: Any) -> SmallScene:
    """Particles of volume 1 at a pressure, of a linear law with rho0 = c = 1."""
    return small_scene(x, box, rho=1 + p, types=[{"mass": 1 + p, "viscosity": 0.0}], compare=FIELDS, **options)


@recomputes(CANCEL, "distance cut force stress shown", given="pressure")
def test_virials_of_two_particles_cancel(lammps: Engine) -> dict[str, Any]:
    p = printed(CANCEL).pressure
    found: dict[str, Any] = {"force": [], "stress": [], "shown": []}
    for engine in ({}, NO_NEWTON):
        scene = at_rest([[4.0, 4.0], [5.0, 4.0]], [9, 9], p, positions=OPEN, engine=engine)
        (snapshot,), right = lammps.fields(scene), scene.predicted().fields[0]
        assert agree(snapshot["f"], scene.predicted(), "f")
        assert snapshot["f"][0, 0] == -snapshot["f"][1, 0] and not snapshot["stress/atom"].any()
        found["force"].append(snapshot["f"][1, 0])
        found["stress"].append(right["stress/atom"][:, 0, 0])
        found["shown"].append(snapshot["stress/atom"])
        assert agree(snapshot["virial"], scene.predicted(), "virial") == (not engine)
    return found | {"distance": 1.0, "cut": scene.problem.model.cut}


def lattice(size: int, p: float, **engine: Any) -> SmallScene:
    """A square lattice, with a kernel whose gradients are exact."""
    x = np.stack(np.meshgrid(np.arange(size) + 0.5, np.arange(size) + 0.5), axis=-1).reshape(-1, 2)
    return at_rest(x, [size, size], p, rheo={"kernel": "RK1"}, engine=engine)


@recomputes(CANCEL, "without", given="pressure virial size")
def test_pressure_of_a_fluid_at_rest(lammps: Engine) -> dict[str, Any]:
    n = printed(CANCEL)
    p, virial, without, size = n.pressure, n.virial, n.without, n.size
    found = [lammps.fields(lattice(n, p, newton=False))[0]["virial"][0] for n in (int(size), 2 * int(size))]
    assert all(found[1][a, a] < 0.6 * without for a in (0, 1))
    scene = lattice(int(size), p)
    right = scene.predicted()
    (snapshot,) = lammps.fields(scene)
    for pressures in (snapshot, right.fields[0]):  # each within the bound of the number, and of the reference's
        assert np.all(np.abs(pressures["press"] - virial) <= 2 * right.bounds[0]["press"])
        assert np.all(np.abs(pressures["virial"] - virial * np.eye(2)) <= 2 * right.bounds[0]["virial"])
    assert agree(snapshot["virial"], right, "virial") and agree(snapshot["press"], right, "press")
    # The sum of all virials of particles is that of the system.
    total, bound = (of[0]["stress/atom"].sum(axis=0) / size**2 for of in (right.fields, right.bounds))
    assert np.all(np.abs(-total - virial * np.eye(2)) <= bound)
    return {"without": np.diag(found[0])}


def disordered(displacement: Floats, kernel: str = "RK1", compressed: float = 1.0, **engine: Any) -> SmallScene:
    """Particles of volume 1, or those of one type of less, in an open box, moved together."""
    places = np.stack(np.meshgrid(np.arange(4) + 3.5, np.arange(4) + 3.5), axis=-1).reshape(-1, 2)
    x = places + 0.1 * np.sin(7 * places[:, ::-1] + places**2) + displacement
    kind = np.arange(16) // 3 % 2
    rho = np.array([1.25, 1.4])
    return small_scene(
        x,
        [12, 12],
        rho=(rho * [1.0, compressed])[kind],
        kind=kind + 1,
        types=[{"mass": m, "viscosity": 0.0} for m in rho],
        compare=FIELDS,
        positions=OPEN,
        rheo={"kernel": kernel, "zmin": 6},
        engine=engine,
    )


def test_the_virial_changes_by_displacement_times_force(lammps: Engine) -> None:
    by = np.array([1.0, -0.5])
    places = [np.zeros(2), by]
    first, moved = (lammps.fields(disordered(place), every_step=True)[0] for place in places)
    right = [disordered(place).predicted() for place in places]
    total = first["f"].sum(axis=0)
    assert np.all(np.abs(total) > 1e3 * right[0].bounds[0]["f"].max())
    change = np.outer(by, total) / 144
    change[1, 0] = change[0, 1]
    explained = [
        disordered(place).predicted(CANCEL, PLACES, snapshot=of)
        for place, of in zip(places, (first, moved), strict=True)
    ]
    bound = sum(each.bounds[0]["virial"][0] for each in explained)
    assert np.all(np.abs(moved["virial"][0] - first["virial"][0] - change) <= bound)
    assert agree(right[1].fields[0]["virial"], right[0], "virial")
    assert not agree(first["virial"], right[0], "virial")


def test_virials_of_a_pair_depend_on_the_order_of_the_list(lammps: Engine) -> None:
    """The same particles in reverse order have different virials where forces do not cancel."""
    scene = disordered(np.zeros(2))
    arrays = {name: getattr(scene.atoms, name)[::-1].copy() for name in ("x_nc", "type_n", "rho_n", "mass_n")}
    (one,), (other,) = (
        lammps.fields(each) for each in (scene, SmallScene(scene.scene, replace(scene.atoms, **arrays)))
    )
    assert agree(one["f"], scene.predicted(), "f") and agree(other["f"][::-1], scene.predicted(), "f")
    largest = np.abs(one["stress/atom"]).max()
    assert largest > 0 and np.abs(other["stress/atom"][::-1] - one["stress/atom"]).max() > 0.1 * largest


@pytest.mark.parametrize("engine", [{}, NO_NEWTON])
def test_the_variants_reproduce_both(lammps: Engine, engine: dict[str, bool]) -> None:
    scene = disordered(np.zeros(2), **engine)
    snapshot, *_ = lammps.fields(scene, every_step=True)
    found = scene.predicted(CANCEL, PLACES, snapshot=snapshot)
    for field in ("stress/atom", "virial", "press"):
        assert agree(snapshot[field], found, field), field


@pytest.mark.parametrize("compressed", [1.0, 1.2])
def test_the_virial_of_the_quintic_kernel(lammps: Engine, compressed: float) -> None:
    """Right, whatever the origin, if all particles have the same volume."""
    scene = disordered(np.zeros(2), "quintic", compressed)
    snapshot, *_ = lammps.fields(scene, every_step=True)
    assert agree(snapshot["virial"], scene.predicted("force-per-volume"), "virial") == (compressed == 1)
    assert agree(snapshot["virial"], scene.predicted("force-per-volume", PLACES, snapshot=snapshot), "virial")
