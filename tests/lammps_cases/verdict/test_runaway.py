"""The cause of a divergence, determined from all particles of a deck and from those around one of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eos_ref.evaluation.pairs import directed_pairs
from lammps_cases.records import case_wording
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.verdict import runaway
from lammps_cases.verdict.runaway import Attempts, cut_out, likeliest
from tests.support.vortices import EDGE, vortices

ENGINE = "2025.7.22.4.0"
FEW = 600  # of the 1024 particles: inside a rim of two cutoffs some can still move


@pytest.mark.parametrize("words", ["quintic 0", "RK1 0", "RK1 0 shift"])
@pytest.mark.parametrize("around", [0, 300])
def test_forces_in_a_cut_out_equal_those_in_the_whole(words: str, around: int) -> None:
    """The centre of a cut-out may lie at a periodic boundary."""
    problem = vortices(words=words)
    part = cut_out(problem, around, FEW)
    assert FEW <= len(part.rows_k) < FEW + 20 and 0 < (~part.held_k).sum() < len(part.rows_k)
    i, j, _ = directed_pairs(problem.state.x_nc, problem.box, problem.model.cut)
    moving = part.rows_k[~part.held_k]
    assert np.isin(j[np.isin(i, moving)], part.rows_k).all()
    forces = []
    for of in (problem, part.problem):
        sim = of.simulation()
        sim.setup()
        forces.append(sim.output("f"))
    np.testing.assert_array_equal(forces[0][moving], forces[1][~part.held_k])


def test_likeliest_is_the_fastest_fluid_or_has_the_largest_force() -> None:
    problem = vortices()
    state = problem.state
    fast_nc, solid_n = state.v_nc.copy(), state.solid_n.copy()
    fast_nc[7], fast_nc[8], solid_n[8] = 0.2, 0.3, True
    assert likeliest(replace(problem, state=replace(state, v_nc=fast_nc, solid_n=solid_n))) == 7
    rho_n = state.rho_n.copy()
    rho_n[100] = 3.0
    assert likeliest(replace(problem, state=replace(state, v_nc=0 * state.v_nc, rho_n=rho_n))) in {
        100 - EDGE,
        99,
        101,
        100 + EDGE,
    }


@pytest.mark.parametrize(
    ("words", "changed", "cause"),
    [
        ("quintic 0", {"mass": 0.01}, "findings"),
        ("quintic 0", {"timestep": 4.0}, "time step"),
        ("quintic 0", {}, "not understood"),
        ("quintic 0 shift", {"timestep": 4.0}, "time step"),
        ("quintic 0 rho/sum", {"mass": 0.01}, "findings"),
    ],
)
def test_cut_out_has_the_same_cause_as_the_whole(
    words: str, changed: dict[str, float], cause: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = vortices(words=words, **changed)
    id_n = np.arange(len(problem.state.x_nc)) + 1
    whole = Attempts(problem, 10, id_n).cause(ENGINE, 1, 0)
    monkeypatch.setattr(runaway, "MOST", FEW)
    cut = Attempts(problem, 10, id_n).cause(ENGINE, 1, 0)
    assert whole.cause == cause and whole.around is None
    assert (cut.cause, cut.findings, cut.steps) == (whole.cause, whole.findings, 50)
    assert cut.of_particles == len(id_n) and cut.around == likeliest(problem) + 1
    said = case_wording.outlook(CaseRecord(case="in.deck", verdict="refused", outlook=cut))
    assert f"(in {cut.particles} of 1024 particles around atom {cut.around})" in said


def test_forces_of_other_fixes_stay_with_their_particles(monkeypatch: pytest.MonkeyPatch) -> None:
    """A force on the central particle alone makes the set-up diverge, in the whole and in a cut-out."""
    monkeypatch.setattr(runaway, "MOST", FEW)
    problem = vortices()
    n, at = len(problem.state.x_nc), likeliest(problem)
    pushed_n = np.where(np.arange(n) == at, 1e5, 0.0)

    def push(force_nc: np.ndarray, mass_n: np.ndarray, rows_k: np.ndarray) -> np.ndarray:
        return force_nc + pushed_n[rows_k, None]

    assert Attempts(problem, 10, np.arange(n), push).cause(ENGINE, 1, 0).cause == "set-up"
