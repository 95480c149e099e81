"""The reference model of a scene has the scene's numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eos_ref.errors import InputError
from eos_ref.model.parameters import Force, Thermal, Viscosity
from eos_ref.syntax.fixes import Shift, SurfaceDetection
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import Atoms, build
from lammps_cases.scene.casefile import Case
from lammps_cases.setup import reference_side

SCENE: dict[str, Any] = {
    "dimension": 2,
    "types": [
        {"mass": 1.5, "rho0": 1.25, "cs": 10.0, "viscosity": 0.25},
        {"mass": 2.5, "rho0": 1.5, "cs": 12.0, "phase": "solid"},
    ],
    "positions": {"lattice": "sq", "spacing": 0.5, "cells": [4, 3], "periodic": [True, False]},
    "pressure": [{"types": "*", "style": "linear"}],
    "rho": {"ratio": [0.9, 1.1]},
    "compare": ["f"],
}


def sides(**keys: Any) -> tuple[Scene, Atoms]:
    scene = Scene.model_validate(SCENE | keys)
    return scene, build(Case("case", "", (), scene, Path("case.yaml")), None)


def test_parameters_of_types_and_of_fix_rheo() -> None:
    rheo = {
        "kernel": "RK1",
        "zmin": 7,
        "shift": {"exclude": "2", "scale_cross_type": [0.5, 0.25, 0.125]},
        "surface_detection": {"style": "coordination", "limit": 20, "splash": 3},
    }
    scene, atoms = sides(rheo=rheo, pair={"artificial_visc": 0.75, "harmonic_means": True})
    model = reference_side.model(scene, atoms, "")
    assert model.mass_t == (1.5, 2.5)
    assert (model.fix.rho0, model.fix.cs) == ((1.25, 1.5), (10.0, 12.0))
    assert model.cut == model.pair.cut == 1.5, "3 spacings"
    assert (model.fix.kernel, model.fix.zmin) == ("RK1", 7)
    assert model.fix.shift == Shift(("2",), (0.5, 0.25, 0.125))
    assert model.fix.surface_detection == SurfaceDetection("coordination", 20.0, 3)
    assert (model.pair.artificial_viscosity, model.pair.rho_damp, model.pair.harmonic_means) == (0.75, 0.0, True)
    assert model.viscosity == (Viscosity("constant", 0.25), Viscosity("constant", 0.1))
    assert model.thermal is None


def test_forces_heat_and_power_laws() -> None:
    hot = {
        "mass": 1.5,
        "specific_heat": 2.0,
        "T_freeze": 0.5,
        "viscosity": {"eta": 0.5, "gd0": 1.5, "K": 0.25, "n": 2.0},
    }
    force = {"style": "setforce", "vector": [None, 2.0], "types": "2"}
    scene, atoms = sides(types=[hot, {"mass": 1.0}], energy={"constant": 2.0}, forces=[force])
    model = reference_side.model(scene, atoms, "")
    assert model.thermal == (Thermal(0.1, 2.0, 0.0, 0.5), Thermal(0.1, 1.0))
    assert model.viscosity[0] == Viscosity("power", 0.5, 1.5, 0.25, 2.0)
    assert model.forces == (Force("setforce", (None, 2.0), (2,)),)
    state = reference_side.state(scene, atoms)
    assert np.array_equal(state.energy_n, 2.0 * model.mass[state.type_n - 1]), "of the particle, not per mass"


def test_reference_and_lammps_get_the_same_box_and_particles() -> None:
    scene, atoms = sides(velocity={"random": 0.5})
    box, state = reference_side.box(scene, atoms), reference_side.state(scene, atoms)
    assert (box.low_c, box.high_c, box.periodic) == ((0.0, -0.5), (2.0, 2.0), (True, False))
    assert atoms.v_nc is not None
    for mine_nc, given_nc in ((state.x_nc, atoms.x_nc), (state.v_nc, atoms.v_nc)):
        assert np.array_equal(mine_nc, given_nc[:, :2])
        assert not np.shares_memory(mine_nc, given_nc)
    assert state.rho_n.tolist() == (atoms.rho_n if atoms.rho_n is not None else np.empty(0)).tolist()
    assert np.array_equal(state.solid_n, atoms.type_n == 2)


def test_summed_density_starts_at_equilibrium() -> None:
    scene, atoms = sides(rho=None, rheo={"rho_sum": True})
    state = reference_side.state(scene, atoms)
    assert np.array_equal(state.rho_n, np.where(atoms.type_n == 1, 1.25, 1.5))


def test_errors_name_their_location() -> None:
    scene, atoms = sides()
    atoms.x_nc[3, 2] = 0.25
    with pytest.raises(InputError, match=r"position: must have z = 0 in 2D, found 0\.25 \(here\)"):
        reference_side.state(scene, atoms, "here")
    with pytest.raises(InputError, match=r"cut: must be positive, found -1\.0 \(here\)"):
        reference_side.with_cut(scene, -1.0, "here")
