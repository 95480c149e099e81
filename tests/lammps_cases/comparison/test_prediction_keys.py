"""Keys of predictions: inputs that differ in one bit have different keys, and unsupported objects are refused."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eos_ref import EOS
from eos_ref.evaluation.evaluator import Evaluator
from eos_ref.model.box import Box
from lammps_cases.comparison import store
from lammps_cases.comparison.store import Unnamed, fingerprint
from lammps_cases.records import measure

NEXT = float(np.nextafter(1.0, 2.0))
BOX = Box((0.0, 0.0), (1.0, 1.0), (True, True))


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (1.0, NEXT),
        (0.0, -0.0),
        (1, 1.0),
        (True, 1),
        ("1", 1),
        (None, ""),
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


@dataclass
class OfThisTest:
    value: float = 1.0


@pytest.mark.parametrize("part", [object(), {1: 2}, {1}, lambda: 1, np.array([None]), OfThisTest, b"1"])
def test_objects_without_a_key_are_refused(part: Any) -> None:
    with pytest.raises(Unnamed):
        fingerprint(part)


def test_local_class_has_no_separate_source() -> None:
    class Inner(Evaluator):
        __module__ = "eos_ref.evaluation.evaluator"

    with pytest.raises(Unnamed, match="Inner is not part of the reference"):
        fingerprint(Inner)


def test_context_depends_on_sources_and_switches(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "eos_ref").mkdir()
    source = tmp_path / "eos_ref" / "one.py"
    source.write_text("a = 1\n")
    (tmp_path / "eos_ref" / "data.yaml").write_text("")
    for room in ("comparison", "cli"):  # predictions go through one of them
        (tmp_path / "lammps_cases" / room).mkdir(parents=True)
        (tmp_path / "lammps_cases" / room / "two.py").write_text("")
    assert store.hashed(tmp_path) == [source, tmp_path / "lammps_cases" / "comparison" / "two.py"]
    first = store.context(tmp_path)
    assert store.context(tmp_path) == first
    source.write_text("a = 2\n")
    second = store.context(tmp_path)
    monkeypatch.setenv("NPY_DISABLE_CPU_FEATURES", "AVX2")
    third = store.context(tmp_path)
    source.rename(source.with_name("two.py"))
    assert len({first, second, third, store.context(tmp_path)}) == 4


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
    facts = measure.cpuinfo()
    assert facts == {"processor": "0", "model name": "One: two \ufffd", "flags": "fpu avx", "": ""}
