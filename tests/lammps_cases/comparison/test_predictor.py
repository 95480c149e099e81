"""Cached predictions are reused only if nothing has changed, to the last bit, and give the same report."""

from __future__ import annotations

import ast
import json
import os
import platform
import shutil
from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
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
from lammps_cases.comparison.store import Store, Unnamed, fingerprint
from lammps_cases.comparison.trajectory import Prediction, input_spread, predict
from lammps_cases.findings.forces import ForcePerVolume
from lammps_cases.findings.shifting import NormalOfLastPair
from lammps_cases.findings.thermal import HeatOverDensity
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


def _leaves(value: Any, path: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    """Every number, string and array in nested dataclasses and tuples."""
    if is_dataclass(value) and not isinstance(value, type):
        return [leaf for f in fields(value) for leaf in _leaves(getattr(value, f.name), (*path, f.name))]
    if isinstance(value, tuple):
        return [leaf for i, each in enumerate(value) for leaf in _leaves(each, (*path, str(i)))]
    return [path]


def _nudged(value: Any, path: tuple[str, ...]) -> Any:
    """The same structure with one leaf changed by the smallest amount."""
    if path:
        if isinstance(value, tuple):
            at = int(path[0])
            return (*value[:at], _nudged(value[at], path[1:]), *value[at + 1 :])
        changed = object.__new__(type(value))  # without its checks, which a change may not pass
        for f in fields(value):
            object.__setattr__(changed, f.name, getattr(value, f.name))
        object.__setattr__(changed, path[0], _nudged(getattr(value, path[0]), path[1:]))
        return changed
    if isinstance(value, np.ndarray):
        other = value.copy()
        other.flat[-1] = _nudged(other.flat[-1].item(), ())
        return other
    match value:
        case None:
            return 0.0
        case bool():
            return not value
        case int():
            return value + 1
        case float():
            return float(np.nextafter(value, np.inf))
        case str():
            return value + "'"
    raise AssertionError(f"no change for {value!r}")


@pytest.mark.parametrize("name", ["thermal.latent.2d", "walls.reconstructed.gravity", "cross-type.both.2d"])
def test_any_change_of_the_problem_changes_the_key(name: str) -> None:
    problem = _scene(name)
    leaves = _leaves(problem)
    assert ("state", "x_nc") in leaves
    assert ("model", "eos", "laws", "0", "cs") in leaves
    found = {fingerprint(_nudged(problem, leaf)) for leaf in leaves}
    assert len(found | {fingerprint(problem)}) == len(leaves) + 1


def test_every_element_counts(problem: Problem) -> None:
    x_nc = problem.state.x_nc.copy()
    found = {fingerprint(x_nc)}
    for at in np.ndindex(x_nc.shape):
        moved_nc = x_nc.copy()
        moved_nc[at] = np.nextafter(moved_nc[at], np.inf)
        found.add(fingerprint(moved_nc))
    assert len(found) == x_nc.size + 1
    assert (
        len({fingerprint(x) for x in (0.0, -0.0, 0, False, None, "", (), ((),), np.zeros(1), np.zeros((1, 1)))}) == 10
    )


def test_variants_have_different_keys() -> None:
    fitted = [
        type("Fitted", (NormalOfLastPair,), {"pair": pair, "__module__": "lammps_cases.findings.variants"})
        for pair in ((1, 2), (2, 1))
    ]
    both = type("Evaluator", (ForcePerVolume, NormalOfLastPair), {"__module__": "lammps_cases.findings.variants"})
    kinds = [ArrayEvaluator, ForcePerVolume, HeatOverDensity, NormalOfLastPair, *fitted, both, Simulation, None]
    assert len({fingerprint(kind) for kind in kinds}) == len(kinds)


def test_foreign_variant_is_never_cached(problem: Problem, tmp_path: Path) -> None:
    class Foreign(ArrayEvaluator):
        pass

    with pytest.raises(Unnamed):
        fingerprint(Foreign)
    with pytest.raises(Unnamed):
        fingerprint(np.array([object()]))
    for _ in range(2):
        predictor = Predictor(Store(tmp_path))
        predictor.predict(problem, (Foreign, Simulation))
        assert (predictor.computed, predictor.stored) == (1, 0)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_any_byte_of_the_sources_changes_the_context(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    copied = ("eos_ref", "lammps_cases")
    for package in copied:
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__", "data"))
    assert store.context(tmp_path) == store.context()
    hashed = store.hashed(tmp_path)
    assert len(hashed) > 30
    for path in hashed:
        source = path.read_bytes()
        path.write_bytes(source[:-1] + b" ")
        assert store.context(tmp_path) != store.context(), path.name
        path.write_bytes(source)
    (tmp_path / "eos_ref" / "new.py").write_text("")
    assert store.context(tmp_path) != store.context()
    before = store.context()
    monkeypatch.setenv("NPY_DISABLE_CPU_FEATURES", "AVX2")
    assert store.context() != before


@pytest.mark.parametrize(
    ("where", "name"),
    [(store, "_version"), (store, "processor"), (np, "show_config"), (platform, "python_version")],
)
def test_libraries_and_processor_are_part_of_the_context(
    where: Any, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = store.context()
    monkeypatch.setattr(where, name, lambda *of, **options: {"SIMD Extensions": "another"} if options else "another")
    assert store.context() != before


def _imported(module: str) -> set[str]:
    """Return the modules of lammps_cases that a module imports anywhere, except for annotations only."""
    path = ROOT.joinpath(*module.split("."))
    text = (path / "__init__.py" if path.is_dir() else path.with_suffix(".py")).read_text()
    tree, imported = ast.parse(text), set()
    for_types = [node for node in ast.walk(tree) if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test)]
    annotations = {inner for node in for_types for inner in ast.walk(node)}
    for node in set(ast.walk(tree)) - annotations:
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("lammps_cases"):
            for name in [f"{node.module}.{alias.name}" for alias in node.names]:
                here = ROOT.joinpath(*name.split("."))
                imported.add(name if here.is_dir() or here.with_suffix(".py").exists() else str(node.module))
    return imported


def test_context_includes_every_module_used_by_predictions() -> None:
    reached, left = set(), {"lammps_cases.comparison.predictor", "lammps_cases.verdict.mistakes"}
    while left:
        name = left.pop()
        reached.add(name)
        left |= _imported(name) - reached
    rooms = {name.split(".")[1] for name in reached}
    assert "comparison" in rooms
    assert rooms <= set(store.ROOMS)
    assert all((ROOT / "lammps_cases" / room).is_dir() for room in store.ROOMS)


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


@pytest.mark.parametrize("spoil", ["truncated", "empty", "one bit", "another's"])
def test_damaged_entry_is_computed_again(spoil: str, problem: Problem, tmp_path: Path) -> None:
    kept = Store(tmp_path)
    right = _bits(Predictor(kept).predict(problem, seed=1))
    (file,) = tmp_path.iterdir()
    content = file.read_bytes()
    if spoil == "another's":
        Predictor(kept).predict(problem, seed=2)
        (other,) = set(tmp_path.iterdir()) - {file}
        file.write_bytes(other.read_bytes())
    else:
        middle = len(content) // 2
        flipped = content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]
        file.write_bytes({"truncated": content[:-1], "empty": b"", "one bit": flipped}[spoil])
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
    assert store.current(store.open_store())
    assert not store.current(Store(tmp_path, "sources of another time"))


def test_unwritable_folder_loses_no_result(problem: Problem, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    predictor = Predictor(Store(tmp_path / "file" / "below"))
    assert _bits(predictor.predict(problem)) == _bits(Predictor().predict(problem))


def test_least_recently_used_entry_is_removed_first(tmp_path: Path) -> None:
    kept = Store(tmp_path)
    for age, key in enumerate("abcd"):
        kept.write(key, {"x": np.zeros(100)})
        os.utime(kept._path(key), (1000 + age, 1000 + age))
    count, size = kept.size()
    assert count == 4
    assert kept.read("a") is not None  # used just now
    kept.trim(size // 2)
    assert [kept.read(key) is not None for key in "abcd"] == [True, False, False, True]
    kept.trim(0)
    assert kept.size() == (0, 0)
    assert Store(tmp_path / "absent").size() == (0, 0)


def test_oversized_entry_is_not_cached(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store, "LARGEST", 1600)
    kept = Store(tmp_path)
    for key, more in (("fits", 0), ("does not", 1)):
        kept.write(key, {"x": np.zeros(100), "y": np.zeros(100 + more)})
    assert [kept.read(key) is not None for key in ("fits", "does not")] == [True, False]


def test_entries_keep_type_shape_and_bits() -> None:
    arrays = {
        "none": np.zeros((0, 3)),
        "words": np.array(["a", "masses ignored"]),
        "no words": np.array([], dtype=str),
        "long": np.array([1, 3], np.longdouble) / 3,
        "flags": np.array([[True], [False]]),
        "columns": np.asfortranarray(np.arange(6.0).reshape(2, 3)),
        "special": np.array([np.nan, np.inf, -0.0]),
        "one": np.float64(2.5),
    }
    found = store.unpacked("name", store.packed("name", arrays))
    assert found is not None
    assert list(found) == list(arrays)
    for name, array in arrays.items():
        assert found[name].dtype == np.asarray(array).dtype
        assert found[name].shape == np.asarray(array).shape
        assert np.array_equal(found[name], array, equal_nan=np.asarray(array).dtype.kind == "f")
    assert np.signbit(found["special"][2])
    assert store.unpacked("other", store.packed("name", arrays)) is None
    with pytest.raises(TypeError):
        store.packed("name", {"x": np.array([{}])})


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
