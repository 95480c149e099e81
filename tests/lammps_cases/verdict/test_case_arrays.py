"""Pairs of the atoms shown in a report: the choice of atoms; the same sums as in a separate run."""

from __future__ import annotations

import numpy as np
import pytest

from lammps_cases.comparison import pair_sums
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.trajectory import halted
from lammps_cases.records.case_parts import Blame, FieldRecord, StepRecord
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.run.prepared_case import prepare
from lammps_cases.scene import casefile
from lammps_cases.verdict.case_arrays import looked_at, pair_arrays
from lammps_cases.verdict.problems import problem_of


def record(*places: tuple[int, int]) -> CaseRecord:
    """Return a case whose fields are worst at these steps and atoms."""
    steps = [StepRecord(step=0, verdict="explained", max_abs=1.0, max_over_bound=2.0)]
    fields = [
        FieldRecord(field=f"f{k}", stage="pair", verdict="explained", worst_step=step, worst_id=atom, steps=steps)
        for k, (step, atom) in enumerate(places)
    ]
    return CaseRecord(case="made", verdict="explained", fields=fields)


def test_first_and_worst_atoms_are_chosen() -> None:
    made = record((10, 7), (0, 3), (10, 7))
    made.fields.append(made.fields[0].model_copy(update={"verdict": "pass", "worst_id": 99}))
    values = {"lammps": 1.0, "reference": 0.0, "bound": 0.1, "outside": 1, "of": 9}
    made.blame = Blame(field="f", stage="pair", step=3, atom=5, **values)
    assert looked_at(made, (0, 10)) == [(10, 7), (0, 3)]  # step 3 is not compared
    made.blame.step = 10
    assert looked_at(made, (0, 10)) == [(10, 5), (10, 7), (0, 3)]


@pytest.mark.parametrize("name", ["forces.all.rk1.2d", "thermal.arithmetic.2d", "walls.stored.gravity"])
def test_pairs_of_a_verdict_equal_those_of_a_separate_run(name: str) -> None:
    (case,) = (case for case in casefile.load() if case.name == name)
    atoms, steps = prepare(case).atoms, case.scene.snapshots
    problem = problem_of(case.scene, atoms, case.where, steps)
    predictor = Predictor()
    predictor.predict(problem)
    made = record((steps[-1], 5), (0, 9))
    found = pair_arrays(made, case.scene, atoms, case.where, steps, predictor)
    assert found["@pairs step"].tolist() == [steps[-1], 0] and found["@pairs atom"].tolist() == [5, 9]
    begin = 0
    for k, (step, atom) in enumerate(looked_at(made, steps)):
        alone = pair_sums.terms(problem, step, atom, len(atoms) ** 2, forces=True)
        rows = slice(begin, begin + alone.count)
        begin += alone.count
        assert found["@pairs id"][rows].tolist() == [pair.other.id for pair in alone.pairs]
        columns = pair_sums.columns([(step, alone)])
        for column in ("pair", "sum"):
            own = found[f"@pairs {column}"][rows if column == "pair" else slice(k, k + 1)]
            np.testing.assert_array_equal(own, columns[column])
    assert begin == len(found["@pairs r"])
    halts = halted(problem, steps)  # all snapshots are still unchanged
    for step in (0, steps[-1]):
        assert pair_sums.sums(halts[step], (4,)) == [pair_sums.terms(problem, step, 5)]


def test_large_scene_has_no_pairs(monkeypatch: pytest.MonkeyPatch) -> None:
    (case,) = (case for case in casefile.load() if case.name == "forces.all.rk1.2d")
    atoms = prepare(case).atoms
    monkeypatch.setattr("lammps_cases.verdict.case_arrays.LARGEST", len(atoms) - 1)
    assert pair_arrays(record((0, 5)), case.scene, atoms, case.where, case.scene.snapshots, Predictor()) == {}
