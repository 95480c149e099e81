"""What the pairs of a particle add is all that it gets, in the units of the scene."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lammps_cases.comparison.pair_sums import added_up, terms
from lammps_cases.comparison.trajectory import predict
from lammps_cases.run.prepared_case import prepare
from lammps_cases.scene import casefile
from lammps_cases.verdict.model_cases import problem_of

PARTS = {"f": "force", "drho": "drho", "heatflow": "heat"}


@pytest.mark.parametrize(
    ("name", "fields"), [("forces.all.rk1.3d", ("f", "drho")), ("thermal.arithmetic.3d", ("f", "heatflow"))]
)
def test_pairs_add_up_to_the_fields(name: str, fields: tuple[str, ...]) -> None:
    (case,) = casefile.select(casefile.load(), [name])
    problem = problem_of(case.scene, prepare(case).atoms, "", (0,))
    problem = replace(problem, model=replace(problem.model, units="real", forces=()), fields=(*fields, "pressure"))
    prediction = predict(problem)
    (values,), (bounds,) = prediction.fields, prediction.bounds
    state = problem.state
    for row in (0, 7, len(state.rho_n) - 1):
        of = terms(problem, 0, row + 1, len(state.rho_n) ** 2, forces=True)
        assert len(of.pairs) == of.count > 0 and of.pairs[0].r == min(pair.r for pair in of.pairs)
        added = added_up(of.pairs)
        for field in fields:
            assert (np.abs(added[PARTS[field]] - values[field][row]) <= bounds[field][row]).all(), field
        for one in (of.particle, *(pair.other for pair in of.pairs)):
            at = one.id - 1
            assert (one.type, one.solid, one.x) == (state.type_n[at], state.solid_n[at], tuple(state.x_nc[at]))
            assert one.v == tuple(state.v_nc[at])
            assert one.mass == problem.model.mass_t[one.type - 1]
        assert all(pair.r == pytest.approx(np.linalg.norm(pair.x)) and pair.w > 0 for pair in of.pairs)
