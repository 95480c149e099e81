"""Compiled sums over pairs, by themselves."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eos_ref.compiled.evaluator import CompiledEvaluator
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.numbers.rounded import Rounded, error, value
from tests.support.particle_scenes import scene

pytestmark = pytest.mark.slow


def test_loops_import_the_compiled_elementary_functions() -> None:
    """In a fresh process, as cached code needs no compilation and other modules import them, too."""
    code = (
        "from eos_ref.compiled import loops\n"
        "from eos_ref.jit import inline\n"
        "from eos_ref.kernels.quintic import QUINTIC\n"
        "assert inline(QUINTIC.shape)(0.0) == 66.0\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=Path(__file__).parents[3], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def flat(sums: Any) -> list[Any]:
    """Return the arrays of a result, which may be one, or tuples and lists of them."""
    return [array for part in sums for array in flat(part)] if isinstance(sums, tuple | list) else [sums]


@pytest.mark.parametrize("dimension", [2, 3])
def test_sums_are_those_of_the_arrays(dimension: int) -> None:
    """Each sum of its own, within the rounding bound of the array evaluator."""
    built = scene(dimension, walls=True)
    s = built.state
    plain, compiled = (
        kind(built.model, built.box, s.type_n, s.solid_n) for kind in (ArrayEvaluator, CompiledEvaluator)
    )
    plain.move(Rounded(s.x_nc))
    compiled.move(s.x_nc)
    assert np.array_equal(compiled.coordination_n, plain.coordination_n)
    random = np.random.default_rng(5)
    weight_n, a_nc = random.uniform(0.5, 1.5, compiled.n), random.uniform(-1, 1, s.x_nc.shape)
    arguments: dict[str, tuple[Any, ...]] = {
        "kernel_sum": (weight_n,),
        "wall_sums": (weight_n, s.rho_n, a_nc),
        "shift_sums": (weight_n, 0.25),
        "color_sums": (weight_n,),
        "surface_sums": (s.rho_n,),
        "nearest": (np.arange(compiled.n) % 5,),
    }
    for name, given in arguments.items():
        found, expected = (flat(getattr(evaluator, name)(*given)) for evaluator in (compiled, plain))
        assert len(found) == len(expected), name
        for sum_n, bounded_n in zip(found, expected, strict=True):
            assert np.any(sum_n != 0), name
            assert (np.abs(sum_n - value(bounded_n)) <= error(bounded_n)).all(), name
