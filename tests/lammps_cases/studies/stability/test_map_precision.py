"""Float32 and float64: a layer of the reference alone, computed entirely in float32, fails earlier."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from lammps_cases.setup import reference_side
from lammps_cases.studies.stability.maps import timestep
from lammps_cases.studies.stability.model import ENGINES, Kind, MapCell, StabilityMap
from lammps_cases.studies.stability.runs import ReferenceRun, open_run, single_simulation
from tests.support.stability_cells import living, outcome

pytestmark = pytest.mark.slow


def kind(of: StabilityMap, x: float, y: float, layer: str) -> Kind:
    return outcome(of, x, y, layer).kind


def test_all_arrays_are_float32() -> None:
    """After some steps no array of the state or the fields is float64; one would widen all others."""
    cell = MapCell("", 1.0, 0.03, "float32")
    start = timestep.PRECISION_STEP.start(cell)
    run = open_run(start, timestep.PRECISION_STEP.watch(cell), "reference", living())
    assert isinstance(run, ReferenceRun)
    run.advance(3)
    simulation = run.simulation
    arrays: dict[str, Any] = {**vars(simulation.state), **simulation.fields, "p": simulation.output("pressure")}
    floats = {name: array.dtype for name, array in arrays.items() if getattr(array, "dtype", None) in (float, "f4")}
    assert len(floats) >= 7
    assert set(floats.values()) == {np.dtype(np.float32)}, floats


def test_float32_is_the_same_model() -> None:
    """Forces of both types agree to a few float32 roundings of their terms."""
    start = timestep.PRECISION_STEP.start(MapCell("", 1.0, 0.3, "float64"))
    x_nc = start.atoms.x_nc + np.random.default_rng(1).uniform(-0.1, 0.1, start.atoms.x_nc.shape) * (1, 1, 0)
    short = timestep.single(replace(start, atoms=replace(start.atoms, x_nc=x_nc))).atoms
    doubles = {name: getattr(short, name).astype(float) for name in ("x_nc", "v_nc", "rho_n")}
    half = single_simulation(start.case.scene, short)
    long = reference_side.simulation(start.case.scene, replace(short, **doubles), evaluator=ArrayEvaluator)
    found = long.evaluate()["f"], half.evaluate()["f"]
    scale = np.abs(found[0]).max()
    error = np.abs(found[0] - found[1]).max() / scale
    assert 0 < error < 1e-5


def test_only_the_reference_has_float32() -> None:
    for of in timestep.PRECISION_MAPS:
        assert of.engines("float64") == ENGINES
        assert of.engines("float32") == ("reference",)


@pytest.mark.parametrize("layer", ["float64", "float32"])
def test_origin(layer: str) -> None:
    """Particles coincide where whole numbers are the densest."""
    limit = next(t for t in timestep.ORIGIN.theory if t.layer == layer).x_of_y(0.3)
    assert kind(timestep.ORIGIN, limit / 2, 0.3, layer) == "stable"
    assert kind(timestep.ORIGIN, limit, 0.3, layer) == "error"
    assert timestep.ORIGIN.x.low < limit < timestep.ORIGIN.x.high


def test_compression() -> None:
    """Float32 turns a wave that float64 resolves into noise, and has no wave below a rounding of the density."""
    assert kind(timestep.COMPRESSION, 3e-7, 1.0, "float64") == "stable"
    assert kind(timestep.COMPRESSION, 3e-7, 1.0, "float32") == "energy growth"
    start = timestep.COMPRESSION.start(MapCell("", 2.0**-26, 1.0, "float32"))
    assert start.atoms.rho_n is not None and set(start.atoms.rho_n.tolist()) == {1.0}
