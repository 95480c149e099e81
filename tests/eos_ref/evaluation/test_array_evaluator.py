"""`ArrayEvaluator` against an independent double loop in scalar longdoubles, within the rounding bound."""

from __future__ import annotations

import numpy as np
import pytest

from eos_ref.numbers.rounded import error, value
from tests.support.double_loop import DoubleLoop
from tests.support.particle_scenes import RECIPES, recipe, results


@pytest.mark.parametrize("dimension", [2, pytest.param(3, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", RECIPES)
def test_every_field_of_an_evaluation(name: str, dimension: int) -> None:
    """Values within the bound, which is itself below 1e-10 of the largest value: it could hide no wrong formula."""
    built = recipe(name, dimension)
    random = np.random.default_rng(3)
    history_nc = random.uniform(-1, 1, built.state.x_nc.shape)  # as if left by a step: reaches Adami's g and a
    double = DoubleLoop(built)
    double.other = [[np.longdouble(c) for c in row] for row in history_nc]
    expected = double.evaluate()
    simulation = built.simulate()
    simulation.other_nc = history_nc
    bound = results(simulation.rounded())
    simulation.evaluate()
    found = results(simulation)
    assert found.keys() == bound.keys() == expected.keys()
    for field, values in found.items():
        true = np.array(expected[field], np.longdouble)
        errors = error(bound[field])
        assert np.array_equal(value(bound[field]), values), field
        assert (np.abs(values - true) <= errors).all(), f"{field}: {np.abs(values - true).max()} > {errors.max()}"
        assert errors.max() <= 1e-10 * max(np.abs(values).max(), 1.0), field
