"""Predictions in blocks equal those of whole arrays, bit for bit, in values and bounds, for every kind of stage."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from eos_ref.evaluation import blocks, rounded_loops
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.model.box import Box
from eos_ref.numbers.rounded import Rounded
from lammps_cases.comparison.problem import Problem
from lammps_cases.comparison.trajectory import Prediction, precise_setup, predict
from lammps_cases.findings.forces import ForcePerVolume, MassOfFirst
from lammps_cases.run.prepared_case import prepare
from lammps_cases.scene import casefile
from lammps_cases.verdict.problems import problem_of

# Reproducing kernels, sums of densities, walls, surfaces, shifts between types, heat, tilted boxes, virials.
CASES = (
    *("cross-type.both.2d", "shift.rk2.3d", "shift.sum.2d", "surfaces.divergence.open", "surfaces.shifted.periodic"),
    *("thermal-walls.reconstructed.rk1", "thermal.freezing.3d", "status.reconstructed", "tilted-3d.every.walls"),
    "virials-twins.boost",
)


def problem(name: str) -> Problem:
    (case,) = (case for case in casefile.load() if case.name == name)
    steps = case.scene.snapshots if case.scene.dimension == 2 else tuple(k for k in case.scene.snapshots if k <= 2)
    return problem_of(case.scene, prepare(case).atoms, case.where, steps)


def arrays(of: Prediction) -> list[Any]:
    return [np.asarray(each[field]) for side in (of.fields, of.bounds) for each in side for field in each]


@pytest.fixture(params=[True, False], ids=["kept", "made again"])
def tiny(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Blocks of a few particles, whose pairs are kept between stages or computed again for each, by compiled loops."""
    monkeypatch.setattr(blocks, "ROWS", 7 if request.param else 29)
    monkeypatch.setattr(blocks, "KEPT", 2**30 if request.param else 0)
    monkeypatch.setattr(Rounded, "loops", None if request.param else rounded_loops)


@pytest.mark.slow
@pytest.mark.parametrize("stages", [ArrayEvaluator, ForcePerVolume])
@pytest.mark.parametrize("name", CASES)
def test_blocks_give_the_same_bits(name: str, stages: Any, tiny: None, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = problem(name)
    assert blocks.in_blocks(stages, len(scene.state.x_nc)) is not stages
    found, precise = predict(scene, stages, seed=3), precise_setup(scene)
    monkeypatch.setattr(blocks, "ROWS", 10**9)
    assert blocks.in_blocks(stages, len(scene.state.x_nc)) is stages
    for one, other in zip(arrays(found), arrays(predict(scene, stages, seed=3)), strict=True):
        np.testing.assert_array_equal(one, other)
    for field, exact in precise_setup(scene).items():
        np.testing.assert_array_equal(np.asarray(precise[field]), np.asarray(exact), err_msg=field)


def test_pairs_are_not_searched_twice_in_a_row() -> None:
    """Blocks stay valid for displacements up to half the skin, where the pairs equal those of a new search."""
    box, cut = Box((0.0, 0.0), (12.0, 9.0), (True, False)), 1.5
    random = np.random.default_rng(1)
    x_nc = random.uniform(0.0, [12.0, 9.0], (100, 2))
    first = blocks.listed(x_nc, box, cut, 30)
    near_nc = x_nc + random.uniform(-0.05, 0.05, x_nc.shape)
    assert blocks.listed(near_nc, box, cut, 30) is first
    assert blocks.listed(x_nc + 0.08, box, cut, 30) is not first
    again = blocks.listed(x_nc, box, cut, 30)
    assert again is not first and blocks.listed(x_nc, box, cut, 31) is not again


def test_neighbour_lists_of_lammps_are_used_without_blocks(tiny: None) -> None:
    assert blocks.in_blocks(MassOfFirst, 100) is MassOfFirst


def test_operations_are_compiled_once_many_particles_were_evaluated(monkeypatch: pytest.MonkeyPatch) -> None:
    loaded: list[bool] = []
    monkeypatch.setattr(blocks, "compile_loops", lambda: loaded.append(True))
    monkeypatch.setattr(blocks, "_rounded", 0)
    blocks.count_rounded(blocks.COMPILED_FROM - 1)
    assert not loaded
    blocks.count_rounded(1)
    assert not loaded
    blocks.count_rounded(1)
    assert loaded
