"""Pairs at the cutoff: open where rounding decides, and nowhere else."""

from __future__ import annotations

import numpy as np

from eos_ref.evaluation.cutoff import AtCutoff
from eos_ref.model.box import Box
from eos_ref.numbers.rounded import error, value
from tests.support.particle_scenes import recipe

# Two particles exactly a cutoff apart, one that has a neighbour well within, which is the second's too, and one alone.
PLACES = np.array([[1.0, 1.0], [4.0, 1.0], [3.0, 1.0], [1.0, 9.0]])


def test_pair_at_the_cutoff_leaves_only_its_particles_open() -> None:
    model, open_box = recipe("walls", 2).model, Box((0.0, 0.0), (20.0, 20.0), (False, False))
    evaluator = AtCutoff(model, open_box, np.ones(4, int), np.zeros(4, bool))
    far = PLACES * model.cut / 3.0
    evaluator.move(far)
    assert error(evaluator.counted()).tolist() == [1.0, 1.0, 0.0, 0.0]
    chi_n = evaluator.same_phase()
    assert value(chi_n).tolist() == [1.0, 1.0, 1.0, 0.0], "the particle alone has none, whatever others have"
    assert np.isfinite(error(chi_n)).all()
