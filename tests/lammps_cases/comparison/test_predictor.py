"""Cached predictions are reused only if nothing has changed, to the last bit, and give the same report."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eos_ref.evaluation import pairs
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.box import Box
from lammps_cases.comparison import store
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.problem import Problem
from lammps_cases.comparison.store import Store
from lammps_cases.comparison.trajectory import Prediction, input_spread, predict
from lammps_cases.findings.forces import ForcePerVolume
from lammps_cases.run import prepared_case
from lammps_cases.scene import casefile
from lammps_cases.verdict.problems import problem_of
from tests.support.outcome import Outcome

Run = Callable[..., Outcome]
ROOT = Path(store.__file__).parents[2]


def _scene(name: str = "thermal.latent.2d") -> Problem:
    case = casefile.select(casefile.load(), (name,))[0]
    return problem_of(case.scene, prepared_case.prepare(case).atoms, case.where, (0, 1))


@pytest.fixture(scope="module")
def problem() -> Problem:
    return _scene()


def test_foreign_variant_is_never_cached(problem: Problem, tmp_path: Path) -> None:
    class Foreign(ArrayEvaluator):
        pass

    for _ in range(2):
        predictor = Predictor(Store(tmp_path))
        predictor.predict(problem, (Foreign, Simulation))
        assert (predictor.computed, predictor.stored) == (1, 0)
    assert list(tmp_path.iterdir()) == []


def _bits(prediction: Prediction) -> list[bytes]:
    return [
        np.asarray(a).tobytes() for side in (prediction.fields, prediction.bounds) for at in side for a in at.values()
    ]


def test_cached_prediction_has_the_computed_bits(problem: Problem, tmp_path: Path) -> None:
    kept = Store(tmp_path, "context")
    made = ForcePerVolume, Simulation
    first, second, alone = Predictor(kept), Predictor(kept), Predictor()
    for predictor in (first, second, alone):
        predictor.predict(problem, seed=5)
        predictor.names("lint", problem, lambda: ["one"], 5)
    assert [(p.computed, p.stored) for p in (first, second, alone)] == [(2, 0), (0, 2), (2, 0)]
    for one, other in ((first, second), (first, alone)):
        assert _bits(one.predict(problem, seed=5)) == _bits(other.predict(problem, seed=5))
        assert _bits(one.predict(problem, made, 5)) == _bits(other.predict(problem, made, 5))
        assert one.names("lint", problem, list, 5) == other.names("lint", problem, list, 5) == ["one"]
        digits = [p.precise(problem) for p in (one, other)]
        assert all(np.array_equal(digits[0][f], digits[1][f], equal_nan=True) for f in problem.fields)
        assert all(digits[0][f].dtype == digits[1][f].dtype for f in problem.fields)
        for a, b in zip(one.values(problem, made), other.values(problem, made), strict=True):
            assert all(a[f].tobytes() == b[f].tobytes() for f in problem.fields)
    assert first.computed == alone.computed == 5
    assert _bits(first.predict(problem, seed=6)) != _bits(first.predict(problem, seed=5))
    assert Predictor(replace(kept, context="another")).store != kept


def test_spread_of_perturbed_input_is_cached_exactly(tmp_path: Path) -> None:
    problem, kept = _scene("twins-units.heat.real"), Store(tmp_path / "store")
    first, again = Predictor(kept), Predictor(kept)
    spreads = [each.input_spread(problem, each.predict(problem, seed=3), 3) for each in (first, again)]
    assert (first.computed, again.computed, again.stored) == (2, 0, 2)
    plain = input_spread(problem, ArrayEvaluator, Simulation, predict(problem, seed=3).fields, 3)
    for step, ours in enumerate(plain):
        assert np.max(ours["v"]) > 0 or not step
        for found in spreads:
            assert all(np.array_equal(found[step][field], ours[field]) for field in problem.fields)


@pytest.mark.parametrize("name", ["thermal.latent.2d", "walls.stored.damped"])
def test_shared_cache_changes_no_bit(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    problem, searches, search = _scene(name), list[Box](), pairs.directed_pairs

    def counted(x_nc: Any, box: Box, cut: float) -> Any:
        searches.append(box)
        return search(x_nc, box, cut)

    monkeypatch.setattr(pairs, "directed_pairs", counted)
    alone = [predict(problem, seed=5), predict(problem, ForcePerVolume, seed=5)]
    count = len(searches)
    searches.clear()
    predictor = Predictor()
    shared = [predictor.predict(problem, seed=5), predictor.predict(problem, (ForcePerVolume, Simulation), 5)]
    assert [*map(_bits, shared)] == [*map(_bits, alone)]
    assert len(searches) == 1 < count


def test_bounds_widen_to_those_of_all_perturbed_runs(problem: Problem, tmp_path: Path) -> None:
    """With the first, all or none of them cached."""
    made = ForcePerVolume, Simulation
    whole, kept = Predictor().predict(problem, made, 5), Store(tmp_path)
    for computed in ((1, 2), (0, 0), (1, 1)):
        predictor = Predictor(kept)
        one = next(growing := predictor.widening(problem, made, 5))
        assert predictor.computed == computed[0]
        assert [_bits(each) for each in growing] == [_bits(whole)]
        assert predictor.computed == computed[1]
        pairs_of = [(one.bounds[at][f], whole.bounds[at][f]) for at in range(2) for f in problem.fields]
        assert all(np.all(a <= b) for a, b in pairs_of) and any(np.any(a < b) for a, b in pairs_of)
        assert [np.array_equal(one.fields[1][f], whole.fields[1][f]) for f in ("v", "f")] == [True, True]
        if computed == (0, 0):
            kept = Store(tmp_path / "rest")
            Predictor(kept).predict(problem, made, 5)
    first_alone = replace(problem, steps=(0,))
    assert len(list(Predictor().widening(first_alone, made, 5))) == 1


def test_damaged_entry_is_computed_again(problem: Problem, tmp_path: Path) -> None:
    """One that is cut, or holds what belongs to another key."""
    kept = Store(tmp_path)
    right = _bits(Predictor(kept).predict(problem, seed=1))
    (file,) = tmp_path.iterdir()
    content = file.read_bytes()
    Predictor(kept).predict(problem, seed=2)
    (other,) = set(tmp_path.iterdir()) - {file}
    for spoilt in (content[:-1], other.read_bytes()):
        file.write_bytes(spoilt)
        again = Predictor(kept)
        assert _bits(again.predict(problem, seed=1)) == right
        assert (again.computed, again.stored) == (1, 0)
        assert file.read_bytes() == content


def test_context_and_fresh_hide_existing_entries(problem: Problem, tmp_path: Path) -> None:
    Predictor(Store(tmp_path, "a")).predict(problem)
    for kept in (Store(tmp_path, "b"), Store(tmp_path, "a", fresh=True)):
        predictor = Predictor(kept)
        predictor.predict(problem)
        assert (predictor.computed, predictor.stored) == (1, 0)


def test_unwritable_folder_loses_no_result(problem: Problem, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    predictor = Predictor(Store(tmp_path / "file" / "below"))
    assert _bits(predictor.predict(problem)) == _bits(Predictor().predict(problem))


def _document(path: Path) -> dict[str, Any]:
    document: dict[str, Any] = json.loads((path / "run.json").read_text())
    for key in ("seconds", "date", "command", "predictions"):
        document.pop(key)
    for case in document["cases"]:
        case.pop("seconds")
        case.pop("predictions")
    return document


@pytest.mark.lammps
def test_second_run_reports_every_prediction_as_cached(
    eos_ref_command: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(store.VARIABLE, str(tmp_path / "kept"))
    cases = (
        "forces.all.quintic.2d",
        "cross-type.both.2d",
        "zmin.some.rk1",
        "twins.walls.boost",
        "walls-summed.quintic",
    )
    counts = {}
    for out, arguments in {"cold": (), "warm": (), "fresh": ("--fresh",)}.items():
        code, said, _ = eos_ref_command("run", *cases, *arguments, "--out", tmp_path / out)
        assert code == 0
        counts[out] = json.loads((tmp_path / out / "run.json").read_text())["predictions"]
        assert ("from the cache" in said) == (out == "warm")
        assert ("from the cache" in (tmp_path / out / "report.html").read_text()) == (out == "warm")
        assert _document(tmp_path / out) == _document(tmp_path / "cold")
        for file in (tmp_path / "cold" / "fields").iterdir():
            assert file.read_bytes() == (tmp_path / out / "fields" / file.name).read_bytes(), file.name
    made = counts["cold"]["computed"]
    assert made > 10
    assert counts == {
        "cold": {"computed": made, "stored": 0, "judgements": 0},
        "warm": {"computed": 0, "stored": made, "judgements": len(cases)},
        "fresh": {"computed": made, "stored": 0, "judgements": 0},
    }
    doctor = json.loads(eos_ref_command("doctor", "--json").out)["checks"]
    assert any(check["what"] == "predictions" and str(tmp_path / "kept") in check["found"] for check in doctor)
