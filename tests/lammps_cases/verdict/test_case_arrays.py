"""Arrays saved for a case: fields at other steps, a sample of very many atoms, pairs of the atoms in a report."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lammps_cases.comparison import pair_sums
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.trajectory import halted
from lammps_cases.records.case_parts import Blame, FieldRecord, StepRecord
from lammps_cases.records.run_record import CaseRecord, EngineRecord
from lammps_cases.run.prepared_case import prepare
from lammps_cases.scene import casefile
from lammps_cases.verdict import case_arrays
from lammps_cases.verdict.case_arrays import looked_at, pair_arrays, sampled
from lammps_cases.verdict.cases import compare_case
from lammps_cases.verdict.problems import problem_of
from tests.support import made_answers


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


def test_sample_and_worst_atoms_are_saved_from_very_many(monkeypatch: pytest.MonkeyPatch) -> None:
    n = 1000
    zero_n, f_nc, rho_n = np.zeros(n), np.zeros((n, 2)), np.random.default_rng(1).permutation(n) / n
    f_nc[123, 1], rho_n[877] = 1.0, np.nan
    sides = {"f.lammps": f_nc, "f.reference": 0 * f_nc, "f.bound": 0 * f_nc + 2.0, "@1 lammps f": f_nc}
    sides |= {"rho.lammps": rho_n, "rho.reference": zero_n, "rho.bound": zero_n + 2.0}
    arrays = {"id": np.arange(1, n + 1), "box": np.zeros((2, 3)), "periodic": np.ones(3, bool), **sides}
    arrays["@pairs sum"] = np.zeros((2, 4))
    monkeypatch.setattr(case_arrays, "ALL_KEPT", n)
    assert sampled(arrays) is arrays
    for name, number in (("ALL_KEPT", n - 1), ("SAMPLE", 10), ("WORST", 1)):
        monkeypatch.setattr(case_arrays, name, number)
    kept, even = sampled(arrays), {1, 112, 223, 334, 445, 556, 667, 778, 889, 1000}
    assert set(kept["id"].tolist()) == even | {124, 878}
    assert kept["f.lammps"][kept["id"] == 124].tolist() == [[0.0, 1.0]]
    assert {len(kept[name]) for name in sides} == {12}
    assert [kept[name].shape for name in ("box", "periodic", "@pairs sum")] == [(2, 3), (3,), (2, 4)]
    assert sampled({}) == {}


def test_differing_field_is_saved_at_its_other_steps(case_file: Callable[..., Path]) -> None:
    """This is in addition to its worst step; a field that agrees throughout is saved once."""
    run = {"steps": 2, "timestep": 0.001, "compare_at": [0, 1, 2]}
    path = case_file(compare=["coordination", "f"], velocity={"random": 0.3}, evolve=run)
    ready = prepare(casefile.load((path,))[0])
    answer = made_answers.of_model(ready.case.scene, ready.atoms)
    last = answer.snapshots[2] | {"f": answer.snapshots[2]["f"] + [[1.0, 0.0, 0.0]]}
    answer = replace(answer, snapshots=(*answer.snapshots[:2], last))
    _, arrays = compare_case(ready.case, ready.eos, ready.atoms, answer, EngineRecord())
    names = [name for name in arrays if name.startswith("@")]
    assert names == [f"@{step} {side} f" for step in (0, 1) for side in ("lammps", "reference", "bound")]
    np.testing.assert_array_equal(arrays["@1 lammps f"], answer.snapshots[1]["f"][:, :2])
    np.testing.assert_array_equal(arrays["f.lammps"], last["f"][:, :2])
    np.testing.assert_array_equal(arrays["mass"], ready.atoms.mass_n)
    assert arrays["periodic"].tolist() == list(ready.atoms.periodic)
