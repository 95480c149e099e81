"""Texts of the findings about masses of particles, checked with LAMMPS and the reference."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from lammps_cases.findings.shifting import ColorMassOfType
from tests.support.printed import Printed, printed, recomputes
from tests.support.small_scene import Engine, SmallScene, agree, engine, is_multiple, small_scene

pytestmark = pytest.mark.lammps

FIRST, GAS, SOUND = "mass-of-first", "gas-of-mass-of-type", "sound-of-mass-of-type"
NORMAL = "cross-type-mass-of-type"
PAIR = [[4.0, 4.0], [5.0, 4.0]]
OPEN = {"lattice": "sq", "spacing": 1.0, "cells": [1, 1], "periodic": [False, False]}


def two(rho: Any, **options: Any) -> SmallScene:
    """Two particles at distance 1, of one type or two, of a linear law with rho0 = c = 1."""
    return small_scene(PAIR, [9, 9], rho=rho, positions=OPEN, **options)


@recomputes(FIRST, "distance cut type_1 type_2 own_1 own_2", given="mass_1 mass_2 rho_1 rho_2")
def test_one_of_a_pair_has_the_mass_of_the_other(lammps: Engine) -> dict[str, Any]:
    n = printed(FIRST)
    masses, rho1, rho2 = [n.mass_1, n.mass_2], n.rho_1, n.rho_2
    up, down = masses
    types = [{"mass": float(m), "viscosity": 0.0} for m in masses]
    single = [{"mass": 7.0, "viscosity": 0.0}]

    def x_of(order: int, *factors: float) -> tuple[Any, Any]:
        """Forces along x with masses of types and with those of particles, in one order of places or the other."""
        at = slice(None, None, order)
        rho, m = [rho1, rho2][at], masses[at]
        kinds = two(rho, kind=[1, 2][at], types=types)
        own = two(rho, own=m, types=single)
        (right,), (found, *_) = lammps.fields(kinds), lammps.fields(own, every_step=True)
        assert agree(right["f"], own.predicted("force-per-volume"), "f")
        first = own.predicted(FIRST, "force-per-volume", snapshot=found)
        assert agree(found["f"], first, "f")
        assert is_multiple(found["f"], np.array(factors)[:, None], own.predicted("force-per-volume"), first, "f")
        return right["f"][:, 0], found["f"][:, 0]

    right_n, found_n = x_of(1, up / down, 1.0)
    x_of(-1, down / up, 1.0)
    return {
        "distance": np.ptp(PAIR, axis=0)[0],
        "cut": two(1.0).problem.model.cut,
        **dict(zip(("type_1", "type_2", "own_1", "own_2"), (*right_n, *found_n), strict=True)),
    }


@recomputes(GAS, "e right", given="mass energy rho gamma heavy wrong_heavy light wrong_light")
def test_the_pressure_of_a_gas(lammps: Engine) -> dict[str, Any]:
    n = printed(GAS)
    mass, energy, rho, gamma, right = n.mass, n.energy, n.rho, n.gamma, n.right

    def scene(of_type: Printed) -> SmallScene:
        law = [{"types": "*", "style": "ideal/gas", "gamma": float(gamma)}]
        types = [{"mass": float(of_type)}]
        compare = ["pressure", "phase"]
        return small_scene(
            [[4.0, 4.0]], [9, 9], rho=rho, e=energy, own=mass, types=types, pressure=law, compare=compare
        )

    assert n.e == energy / mass
    with engine("pypi:2025.7.22.1.0") as old:
        for of_type, wrong in ((n.heavy, n.wrong_heavy), (n.light, n.wrong_light), (mass, right)):
            (found,), (now,) = old.fields(scene(of_type)), lammps.fields(scene(of_type))
            assert wrong.is_rounded(found["pressure"][0]) and agree(
                found["pressure"], scene(of_type).predicted(GAS), "pressure"
            )
            assert right.is_rounded(now["pressure"][0]) and agree(
                now["pressure"], scene(of_type).predicted(), "pressure"
            )
    return {"e": energy / mass, "right": (gamma - 1) * rho * n.e}


@recomputes(SOUND, "distance cut", given="mass rho energy speed gamma zeta heavy light wrong right")
def test_the_sound_of_a_gas(lammps: Engine) -> dict[str, Any]:
    n = printed(SOUND)
    m, rho, energy, speed, gamma, zeta = n.mass, n.rho, n.energy, n.speed, n.gamma, n.zeta
    law = [{"types": "*", "style": "ideal/gas", "gamma": float(gamma)}]
    for of_type, force in ((n.heavy, n.wrong), (n.light, n.right)):
        types = [{"mass": float(of_type), "viscosity": 0.0}]
        v = np.array([[0.5, 0.0], [-0.5, 0.0]]) * speed
        pair = {"artificial_visc": float(zeta)}
        scene = two(rho, own=m, v=v, e=energy, types=types, pressure=law, pair=pair)
        (found,) = lammps.fields(scene)
        assert force.is_rounded(found["f"][1, 0]) and force.is_rounded(-found["f"][0, 0])
        assert agree(found["f"], scene.predicted(SOUND), "f")
        assert agree(found["f"], scene.predicted(), "f") == (of_type == m)
    return {"distance": np.ptp(PAIR, axis=0)[0], "cut": scene.problem.model.cut}


def test_the_repulsion_by_a_wall_of_gas(lammps: Engine) -> None:
    x = [[2 + 0.5 * i, 2 + 0.5 * j] for i in range(8) for j in range(8)] + [[5.85, 3.8]]
    of_type = {"mass": 4.0, "viscosity": 0.0}
    types = [of_type, of_type | {"phase": "solid"}]
    law = [{"types": "*", "style": "ideal/gas", "gamma": 1.4}]
    walls = {"interface_reconstruct": True}
    scene = small_scene(
        x, [12, 12], e=2.0, own=1.0, kind=[2] * 64 + [1], types=types, pressure=law, rheo=walls, positions=OPEN
    )
    (found,) = lammps.fields(scene)
    assert agree(found["f"], scene.predicted(SOUND), "f") and not agree(found["f"], scene.predicted(), "f")


# --- cross-type-mass-of-type


def across(keep: float, order: int = 1, **options: Any) -> SmallScene:
    """A particle and two of another fluid, along x and along y, whose labels rise or fall."""
    x, own, kind = np.array([[4.0, 4.0], [5.0, 4.0], [4.0, 5.0]]), np.array([1.0, 2.0, 1.0]), np.array([1, 2, 2])
    rheo = {"shift": {"scale_cross_type": [keep, 0.0, 0.0]}} | options.pop("rheo", {})
    types, engine = [{"mass": 3.0}, {"mass": 3.0}], {"sort": 0}
    more: dict[str, Any] = {"types": types, "engine": engine, "rheo": rheo, "positions": OPEN, "compare": ["shift/v"]}
    at = slice(None, None, order)
    return small_scene(x[at], [9, 9], v=np.array([[0.3, 0.1]] * 3), own=own[at], kind=kind[at], **more, **options)


@recomputes(NORMAL, "own_1 own_2 of_type", given="right_x right_y wrong_x wrong_y")
def test_the_normal_of_masses_and_of_those_of_types(lammps: Engine) -> dict[str, Any]:
    n = printed(NORMAL)
    for order, normal in ((1, (n.right_x, n.right_y)), (-1, (n.wrong_x, n.wrong_y))):
        at = 0 if order == 1 else 2
        scene = across(0.0, order)
        own_1, own_2 = scene.atoms.mass_n[[1, 1 + order]]
        assert (own_1, own_2) == (n.own_1, n.own_2)
        (found,), whole = lammps.fields(scene, every_step=True), across(1.0, order).predicted()
        scaled = scene.predicted(NORMAL, snapshot=found)
        taken_c = whole.fields[0]["shift/v"][at] - scaled.fields[0]["shift/v"][at]
        bound = whole.bounds[0]["shift/v"][at].sum() + scaled.bounds[0]["shift/v"][at].sum()
        assert np.any(np.abs(taken_c) > bound)
        assert abs(taken_c[0] * normal[1] - taken_c[1] * normal[0]) <= max(normal) * bound
    return {"own_1": own_1, "own_2": own_2, "of_type": [t.mass for t in scene.scene.types]}


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
