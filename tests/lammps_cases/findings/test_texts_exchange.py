"""What the findings about exchange between processes and images say, by LAMMPS and by the reference."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.support.told import ENTRIES, Engine, Told, agree, quoted, said, told

pytestmark = pytest.mark.lammps

TWICE = "boundary-pairs-twice"
APART = {"newton": False, "newton_bond": True}  # newton off on


def two(first: float, **options: Any) -> Told:
    """Two particles at distance 1 in a periodic box of 8, the first at some x."""
    return told([[first, 4.0], [(first + 1) % 8, 4.0]], (8, 8), **options)


def test_boundary_pairs_twice(lammps: Engine) -> None:
    distance, d, cut, within, across = said(
        TWICE, "argument", r"at distance # \(#D, cutoff #\) have summed densities of # in the middle .* and of # with"
    )
    assert (distance, d, cut) == (1, 2, 3)
    summed: dict[str, Any] = {"rheo": {"rho_sum": True}, "compare": ["rho"], "rho": None}
    for first, number in ((3.0, within), (7.5, across)):
        scene = two(first, engine=APART, **summed)
        (snapshot,) = lammps.fields(scene, every_step=True)
        assert all(map(number.is_rounded, snapshot["rho"]))
        assert agree(snapshot["rho"], scene.predicted(TWICE, snapshot=snapshot), "rho")
        assert all(map(within.is_rounded, scene.predicted().fields[0]["rho"]))


@pytest.mark.parametrize("newton", [(True, True), (True, False), (False, False)])
def test_the_other_settings_are_right(lammps: Engine, newton: tuple[bool, bool]) -> None:
    """Those that the workaround names, for sums and for gradients."""
    assert quoted(TWICE, "workaround") == ["newton on off"]
    assert ENTRIES[TWICE].observed.endswith("The other three settings agree with each other.")
    engine = dict(zip(("newton", "newton_bond"), newton, strict=True))
    scene = two(7.5, engine=engine, rheo={"rho_sum": True}, compare=["rho", "grad/v"], rho=None, v=[[0.3, 0], [0, 0]])
    (snapshot,) = lammps.fields(scene)
    assert agree(snapshot["rho"], scene.predicted(), "rho") and agree(snapshot["grad/v"], scene.predicted(), "grad/v")


def test_what_counts_twice_and_what_once(lammps: Engine) -> None:
    """Every quantity that the finding names, with fluid over solids at rest between two periodic boundaries."""
    twice = ["chi", "grad/v", "surface/n", "surface/divr", "rho"]
    once = ["coordination", "drho"]
    places = np.stack(np.meshgrid(np.arange(4) + 0.5, np.arange(6) + 1.0), axis=-1).reshape(-1, 2)
    solid_n = places[:, 1] < 3
    scene = told(
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
