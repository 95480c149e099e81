"""The store of predictions: keys that name every input to the last bit, its context, entries cut anywhere."""

from __future__ import annotations

import ast
import os
import platform
import shutil
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as some

from eos_ref import EOS
from eos_ref.cache import cache_folder
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.evaluator import Evaluator
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.box import Box
from lammps_cases.comparison import store
from lammps_cases.comparison.store import (
    Store,
    Unnamed,
    context,
    fingerprint,
    open_store,
    packed,
    store_folder,
    unpacked,
)
from lammps_cases.findings.forces import ForcePerVolume
from lammps_cases.findings.shifting import NormalOfLastPair
from lammps_cases.findings.thermal import HeatOverDensity
from lammps_cases.records import measure
from lammps_cases.run import prepared_case
from lammps_cases.scene import casefile
from lammps_cases.verdict.problems import problem_of

ROOT = Path(store.__file__).parents[2]
NEXT = float(np.nextafter(1.0, 2.0))
BOX = Box((0.0, 0.0), (1.0, 1.0), (True, True))


# --- keys


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (1.0, NEXT),
        (0.0, -0.0),
        (1, 1.0),
        (True, 1),
        ("1", 1),
        (None, ""),
        ((), ((),)),
        ((1, 2), (2, 1)),
        (((1,), 2), (1, (2,))),
        (np.array([1.0]), np.array([NEXT])),
        (np.array([1.0]), np.array([1.0], np.float32)),
        (np.zeros((2, 3)), np.zeros((3, 2))),
        (np.array([1.0]), (1.0,)),
        (BOX, replace(BOX, tilt=(0.0,))),
        (EOS("linear", 1.0, 1.0), EOS("tait/water", 1.0, 1.0)),
        (Evaluator, Box),
        ({"a": 1.0}, {"a": NEXT}),
        ({"a": 1.0}, {"b": 1.0}),
        ({"a": 1.0}, ("a", 1.0)),
    ],
)
def test_different_inputs_have_different_keys(one: Any, other: Any) -> None:
    assert fingerprint(one) != fingerprint(other)
    assert fingerprint(one) == fingerprint(one)


def test_equal_inputs_have_equal_keys() -> None:
    assert fingerprint(np.float64(1.5)) == fingerprint(1.5) and fingerprint(np.int64(2)) == fingerprint(2)
    assert fingerprint([1, 2]) == fingerprint((1, 2))
    assert fingerprint({"a": 1, "b": 2}) == fingerprint({"b": 2, "a": 1})
    array_nc = np.arange(6.0).reshape(2, 3)
    assert fingerprint(array_nc.T) == fingerprint(np.ascontiguousarray(array_nc.T)), "in whatever order it lies"
    assert fingerprint(float("nan")) == fingerprint(-float("nan")), "one NaN is as good as another"
    assert fingerprint(1, 2) != fingerprint((1, 2)) != fingerprint(12)


def _leaves(value: Any, path: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    """Every number, string and array in nested dataclasses and tuples."""
    if is_dataclass(value) and not isinstance(value, type):
        return [leaf for f in fields(value) for leaf in _leaves(getattr(value, f.name), (*path, f.name))]
    if isinstance(value, tuple):
        return [leaf for i, each in enumerate(value) for leaf in _leaves(each, (*path, str(i)))]
    return [path]


def _nudged(value: Any, path: tuple[str, ...]) -> Any:
    """The same structure with one leaf changed by the smallest amount."""
    if path and isinstance(value, tuple):
        at = int(path[0])
        return (*value[:at], _nudged(value[at], path[1:]), *value[at + 1 :])
    if path:
        changed = object.__new__(type(value))  # without its checks, which a change may not pass
        for f in fields(value):
            object.__setattr__(changed, f.name, getattr(value, f.name))
        object.__setattr__(changed, path[0], _nudged(getattr(value, path[0]), path[1:]))
        return changed
    match value:
        case np.ndarray():
            other = value.copy()
            other.flat[-1] = _nudged(other.flat[-1].item(), ())
            return other
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
    (case,) = casefile.select(casefile.load(), [name])
    problem = problem_of(case.scene, prepared_case.prepare(case).atoms, case.where, (0, 1))
    leaves = _leaves(problem)
    assert {("state", "x_nc"), ("model", "eos", "laws", "0", "cs")} <= set(leaves)
    found = {fingerprint(_nudged(problem, leaf)) for leaf in leaves}
    assert len(found | {fingerprint(problem)}) == len(leaves) + 1


@given(some.arrays(float, some.array_shapes(min_side=1, max_side=4)), st.data())
def test_every_element_counts(values: Any, data: Any) -> None:
    at, changed = data.draw(st.sampled_from(list(np.ndindex(values.shape)))), values.copy()
    changed[at] = np.nextafter(values[at], 1.0) if np.isfinite(values[at]) and values[at] != 1.0 else 0.5
    assert fingerprint(changed) != fingerprint(values) == fingerprint(values.copy())


def test_variants_have_different_keys() -> None:
    module = {"__module__": "lammps_cases.findings.variants"}
    fitted = [type("Fitted", (NormalOfLastPair,), {"pair": pair} | module) for pair in ((1, 2), (2, 1))]
    both = type("Evaluator", (ForcePerVolume, NormalOfLastPair), module)
    kinds = [ArrayEvaluator, ForcePerVolume, HeatOverDensity, NormalOfLastPair, *fitted, both, Simulation, None]
    assert len({fingerprint(kind) for kind in kinds}) == len(kinds)


@dataclass
class OfThisTest:
    value: float = 1.0


@pytest.mark.parametrize(
    "part", [object(), {1: 2}, {1}, lambda: 1, np.array([None]), np.array([object()]), OfThisTest, b"1"]
)
def test_objects_without_a_key_are_refused(part: Any) -> None:
    with pytest.raises(Unnamed):
        fingerprint(part)


def test_local_class_has_no_separate_source() -> None:
    class Inner(Evaluator):
        __module__ = "eos_ref.evaluation.evaluator"

    with pytest.raises(Unnamed, match="Inner is not part of the reference"):
        fingerprint(Inner)


# --- the context


def test_context_depends_on_sources_and_switches(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "eos_ref").mkdir()
    source = tmp_path / "eos_ref" / "one.py"
    source.write_text("a = 1\n")
    (tmp_path / "eos_ref" / "data.yaml").write_text("")
    for room in ("comparison", "cli"):  # predictions go through one of them
        (tmp_path / "lammps_cases" / room).mkdir(parents=True)
        (tmp_path / "lammps_cases" / room / "two.py").write_text("")
    assert store.hashed(tmp_path) == [source, tmp_path / "lammps_cases" / "comparison" / "two.py"]
    first = context(tmp_path)
    assert context(tmp_path) == first
    source.write_text("a = 2\n")
    second = context(tmp_path)
    monkeypatch.setenv("NPY_DISABLE_CPU_FEATURES", "AVX2")
    third = context(tmp_path)
    source.rename(source.with_name("two.py"))
    assert len({first, second, third, context(tmp_path)}) == 4


@pytest.mark.slow
def test_any_byte_of_the_sources_changes_the_context(tmp_path: Path) -> None:
    for package in ("eos_ref", "lammps_cases"):
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__", "data"))
    (tmp_path / "lammps_cases" / "data").mkdir()
    shutil.copy(ROOT / "lammps_cases" / store.CATALOGUE[1], tmp_path / "lammps_cases" / "data")
    right = context()
    assert context(tmp_path) == right
    hashed = store.hashed(tmp_path)
    assert len(hashed) > 30
    for path in hashed:
        source = path.read_bytes()
        path.write_bytes(source[:-1] + b" ")
        assert context(tmp_path) != right, path.name
        path.write_bytes(source)
    (tmp_path / "eos_ref" / "new.py").write_text("")
    assert context(tmp_path) != right


@pytest.mark.parametrize(
    ("where", "name"),
    [(store, "_version"), (store, "processor"), (np, "show_config"), (platform, "python_version")],
)
def test_libraries_and_processor_are_part_of_the_context(
    where: Any, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = context()
    monkeypatch.setattr(where, name, lambda *of, **options: {"SIMD Extensions": "another"} if options else "another")
    assert context() != before


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
    hashed, left = set(store.hashed(ROOT)), {"lammps_cases.comparison.predictor", "lammps_cases.verdict.mistakes"}
    reached = set[str]()
    while left:
        name = left.pop()
        reached.add(name)
        path = ROOT.joinpath(*name.split("."))
        assert (path / "__init__.py" if path.is_dir() else path.with_suffix(".py")) in hashed, name
        left |= _imported(name) - reached
    assert "lammps_cases.findings.variants" in reached


def test_processor_is_identified_by_its_instruction_set(monkeypatch: pytest.MonkeyPatch) -> None:
    facts = {"model name": "Made up", "flags": "fpu fma sse avx avx2x"}
    monkeypatch.setattr(store, "cpuinfo", lambda: facts)
    assert store.processor().split(", ")[:2] == ["Made up", "avx fma"]
    monkeypatch.setattr("os.confstr", {"CS_GNU_LIBC_VERSION": "glibc 2.99"}.__getitem__)
    assert store.processor() == "Made up, avx fma, glibc 2.99"
    facts.pop("flags")
    facts["Features"] = "fp asimd sve2"
    assert store.processor() == "Made up, asimd, glibc 2.99", "as Linux names them on Arm"

    def unknown(name: str) -> str:
        raise ValueError(name)

    monkeypatch.setattr("os.confstr", unknown)
    facts.pop("Features")
    assert store.processor() == "Made up", "another C library has no such name"
    monkeypatch.setattr(store, "cpuinfo", dict)
    monkeypatch.setattr("platform.machine", lambda: "vax")
    assert store.processor() == "vax", "another system says nothing more"


def test_linux_description_of_the_first_processor(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    there, read_text = tmp_path / "cpuinfo", Path.read_text
    there.write_bytes(
        b"processor\t: 0\nmodel name\t: One: two \xff\nflags\t\t: fpu avx\n\nprocessor\t: 1\nflags\t: vmx\n"
    )
    places = {"/proc/cpuinfo": there}
    monkeypatch.setattr(Path, "read_text", lambda path, **options: read_text(places[str(path)], **options))
    assert measure.cpuinfo() == {"processor": "0", "model name": "One: two \ufffd", "flags": "fpu avx", "": ""}


# --- entries


ARRAYS = st.one_of(
    *(some.arrays(kind, some.array_shapes(min_dims=0, min_side=0, max_side=4)) for kind in (float, int, bool, "U7"))
)


@settings(max_examples=40, deadline=None)
@given(st.dictionaries(st.text(max_size=9), ARRAYS, max_size=3), st.data())
def test_entry_is_read_as_written_or_not_at_all(arrays: dict[str, Any], data: Any) -> None:
    """Type, shape and bits are kept; an entry of another name, cut or changed anywhere, counts as absent."""
    content = packed("name", arrays)
    found = unpacked("name", content)
    assert found is not None and list(found) == list(arrays)
    for name, array in arrays.items():
        assert (found[name].dtype, found[name].shape, found[name].tobytes()) == (
            array.dtype,
            array.shape,
            array.tobytes(),
        )
    at = data.draw(st.integers(0, len(content) - 1))
    flipped = content[:at] + bytes([content[at] ^ data.draw(st.integers(1, 255))]) + content[at + 1 :]
    assert unpacked("other", content) is unpacked("name", content[:at]) is unpacked("name", flipped) is None


def test_entries_hold_every_kind_of_number_but_no_objects() -> None:
    kinds = {
        "long": np.array([1, 3], np.longdouble) / 3,
        "columns": np.asfortranarray(np.arange(6.0).reshape(2, 3)),
        "special": np.array([np.nan, np.inf, -0.0]),
        "one": np.float64(2.5),
    }
    found = unpacked("name", packed("name", kinds))
    assert found is not None and np.signbit(found["special"][2])
    for name, array in kinds.items():
        assert found[name].dtype == np.asarray(array).dtype
        np.testing.assert_array_equal(found[name], array)
    for bad in (np.array([None]), np.array([{}])):
        with pytest.raises(TypeError, match="y holds Python objects"):
            packed("name", {"x": np.zeros(1), "y": bad})


# --- the folder


def test_default_store_is_in_the_named_folder_or_the_users_cache(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(store.VARIABLE, str(tmp_path))
    assert open_store() == Store(tmp_path, context(), fresh=False)
    assert open_store(fresh=True) == Store(tmp_path, context(), fresh=True)
    monkeypatch.setenv(store.VARIABLE, "")
    assert store_folder() == cache_folder("predictions")
    assert store.current(open_store()) and not store.current(Store(tmp_path, "sources of another time"))


def test_least_recently_used_excess_is_removed_first(tmp_path: Path) -> None:
    kept = Store(tmp_path)
    for age, key in enumerate("abcd"):
        kept.write(key, {"x": np.zeros(100)})
        os.utime(kept._path(key), (1000 + age, 1000 + age))
    count, size = kept.size()
    kept.trim(size)
    assert kept.size() == (count, size) == (4, size)
    assert kept.read("a") is not None  # used just now
    kept.trim(size // 2)
    assert [kept.read(key) is not None for key in "abcd"] == [True, False, False, True]
    kept.trim(size // 2 - 1)
    assert kept.size() == (1, size // 4)
    kept.trim(0)
    assert kept.size() == (0, 0) == Store(tmp_path / "absent").size()


def test_files_removed_by_another_run_are_skipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = Store(tmp_path)
    kept.write("a", {"x": np.zeros(100)})
    (tmp_path / "gone").symlink_to(tmp_path / "nowhere")  # listed, but without a size
    assert kept.size()[0] == 1
    files = store._files(tmp_path)
    monkeypatch.setattr(store, "_files", lambda folder: [(0, 1, str(tmp_path / "removed")), *files])
    kept.trim(0)
    assert kept.read("a") is None


def test_entry_is_read_although_its_use_cannot_be_recorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = Store(tmp_path)
    kept.write("a", {"x": np.ones(3)})

    def refuse(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr("os.utime", refuse)
    read = kept.read("a")
    assert read is not None and read["x"].tolist() == [1.0, 1.0, 1.0]


def test_oversized_entry_is_not_cached(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store, "LARGEST", 1600)
    kept = Store(tmp_path)
    for key, more in (("fits", 0), ("does not", 1)):
        kept.write(key, {"x": np.zeros(100), "y": np.zeros(100 + more)})
    assert [kept.read(key) is not None for key in ("fits", "does not")] == [True, False]
