"""Files from elsewhere: never a traceback, a hang, or more memory than stated; one line reports the error."""

from __future__ import annotations

import copy
import io
import os
import time
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from eos_ref import InputError
from lammps_cases.records import files
from lammps_cases.records.documents import SCHEMAS, Document
from lammps_cases.records.files import csv_text, read_arrays, read_bytes, write_arrays
from lammps_cases.records.run_record import CaseRecord, RunRecord, read_run
from lammps_cases.report.annotations import source_of
from lammps_cases.run import shards
from lammps_cases.scene.casefile import load_file
from tests.support import made_runs
from tests.support.hostile import SCENE, leaves, made, outcome, readers

READERS = readers()
QUICK = settings(max_examples=30, deadline=None, suppress_health_check=list(HealthCheck), database=None)
PIECES = tuple(
    piece.encode()
    for piece in (
        *("1e400", "-1", "9" * 30, "nan", "null", "'", '"', "&a ", "*a", "{", "[", "]", "- ", "? ", ": ", "\n", "\x00"),
        *("\u200b", "$", "${x}", "!!int ", "<<: ", "a b: 1\n", "&", ",", "0x", "*", "1*", "true", ";"),
    )
)


@st.composite
def damaged(draw: st.DrawFn, seeds: tuple[bytes, ...]) -> bytes:
    """Valid content that is cut off, or with parts removed, doubled or replaced; or nothing but random bytes."""
    content = draw(st.sampled_from(seeds))
    how = draw(st.sampled_from(["parts", "parts", "cut", "random"]))
    if how == "random":
        return draw(st.binary(max_size=60))
    if how == "cut":
        return content[: draw(st.integers(0, len(content)))]
    for _ in range(draw(st.integers(1, 4))):
        first = draw(st.integers(0, len(content)))
        last = min(len(content), first + draw(st.integers(0, 12)))
        new = draw(st.one_of(st.binary(max_size=6), st.sampled_from(PIECES), st.just(content[first:last] * 2)))
        content = content[:first] + new + content[last:]
    return content


@pytest.mark.parametrize("name", READERS)
@QUICK
@given(data=st.data())
def test_damaged_files_are_refused_in_a_line(name: str, tmp_path_factory: pytest.TempPathFactory, data: Any) -> None:
    reader = READERS[name]
    outcome(reader, data.draw(damaged(reader.seeds)), tmp_path_factory.getbasetemp())


def test_undamaged_files_are_read(tmp_path: Path) -> None:
    """So the test above damages files that are read to their end."""
    for name in READERS.keys() - {"shard", "message"}:
        assert {outcome(READERS[name], seed, tmp_path) for seed in READERS[name].seeds} == {""}, name


# --- documents and arrays


@dataclass(frozen=True)
class Entry:
    name: str
    value: float


@dataclass(frozen=True)
class Content:
    entries: tuple[Entry, ...]
    schema: str = SCHEMAS["chart"]


@pytest.mark.parametrize(
    ("damage", "complaint"),
    [
        (lambda text: text[:30], "document: Invalid JSON"),
        (lambda text: "[]", "document: Input should be an object"),
        (lambda text: text.replace("chart/2", "chart/9"), "schema: must be eos-ref/chart/2, found 'eos-ref/chart/9'"),
        (lambda text: text.replace('"schema"', '"scheme"'), "schema: must be eos-ref/chart/2"),
        (lambda text: text.replace("2.5", '"much"'), r"entries.0.value: Input should be a valid number"),
        (None, "chart: cannot be read: No such file"),
    ],
)
def test_damaged_document_is_refused_by_key_and_rule(
    tmp_path: Path, damage: Callable[[str], str] | None, complaint: str
) -> None:
    document, path = Document("chart", Content), tmp_path / "deep" / "chart.json"
    document.write(path, Content((Entry("a", 2.5),)))
    assert document.read(path) == Content((Entry("a", 2.5),))
    before = path.read_text()
    if damage:
        path.write_text(damage(before))
        assert path.read_text() != before
    else:
        path.unlink()
    with pytest.raises(InputError, match=rf"^{complaint}.*chart.json\)$"):  # . is no end of a line
        document.read(path)


def test_csv_quotes_what_must_be() -> None:
    assert csv_text([("a", 1.5), ('x,"y"', None)]) == 'a,1.5\n"x,""y""",\n'
    assert csv_text([("a,b", "c\td")], "\t") == 'a,b\t"c\td"\n'


def test_arrays_are_read_as_numpy_reads_them(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    written = {"f.lammps": np.array([np.nan, -0.0, 1e-310]), "x": np.asfortranarray(np.arange(6.0).reshape(2, 3))}
    written |= {"id": np.arange(3), "type": np.arange(3, dtype=np.int32), "none": np.empty((0, 3))}
    write_arrays(path, written)
    found = read_arrays(path)
    with np.load(path) as loaded:
        assert found.keys() == set(loaded.files) == written.keys()
        for name in loaded.files:
            np.testing.assert_array_equal(found[name], loaded[name])
            assert found[name].dtype == loaded[name].dtype


def test_sizes_are_limited_and_objects_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.npz"

    def archive(content: bytes) -> Path:
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
            file.writestr("a.npy", content)
        return path

    with monkeypatch.context() as patch:
        patch.setattr(files, "LARGEST", 2**20)
        with pytest.raises(InputError, match="are damaged: unpacked they have 16 MiB"):
            read_arrays(archive(bytes(2**24)))
    pickled = io.BytesIO()
    np.save(pickled, np.array([{}], object), allow_pickle=True)
    for content in (
        b"\x93NUMPY\x01\x00" + bytes([200, 0]) + b"{'descr': '<f8', 'shape': (2**40,)}",
        pickled.getvalue(),
    ):
        with pytest.raises(InputError, match="are damaged"):
            read_arrays(archive(content))
    path.write_bytes(bytes(2**21))
    with pytest.raises(InputError, match="must be at most 1 MiB"):
        read_bytes(path, "file", 2**20)


# --- scenes

VALUES = [
    *(None, True, 0, -1, 1.0e308, 1e-320, float("nan"), float("inf"), 10**30, 2**63, "", "a b", "1-2", [], {}, [[]]),
    *({"a b": 1}, {"a-b": 1}, {1: 2}, {None: 1}, {True: 1}, [1e9, 1e9], [10**9] * 2, "x" * 500, -5, 1e-300, 1e300),
]
KEYS = ["a b", "a-b", "", 1, None, True, 1.5, "x" * 400, "rho+"]


def changed(content: Any, place: tuple[Any, ...], new: Any, as_key: bool) -> Any:
    """A scene in which the value at a place, or its key, is another."""
    content = copy.deepcopy(content)
    *above, last = place
    part = content
    for key in above:
        part = part[key]
    if as_key and isinstance(part, dict):
        part[new] = part.pop(last)
    else:
        part[last] = new
    return content


@pytest.mark.slow
@settings(QUICK, max_examples=150)
@given(data=st.data())
def test_changed_scenes_are_refused_in_a_line(data: Any, tmp_path_factory: pytest.TempPathFactory) -> None:
    content = yaml.safe_load(SCENE)
    for _ in range(data.draw(st.integers(1, 2))):
        place = data.draw(st.sampled_from([place for place in leaves(content) if place]))
        as_key = data.draw(st.booleans())
        content = changed(content, place, data.draw(st.sampled_from(KEYS if as_key else VALUES)), as_key)
    outcome(READERS["case file"], yaml.safe_dump(content).encode(), tmp_path_factory.getbasetemp())


NOT_YAML = {
    "bomb": "a: &a [x,x,x,x,x,x,x,x,x]\n"
    + "".join(f"{b}: &{b} [{', '.join(9 * [f'*{a}'])}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)),
    "deep": "[" * 100_000,
    "endless": "a: &a [*a]",
    "digits": "a: " + "9" * 5000,
    "hexadecimal": "a: 0x" + "f" * 5000,
    "key is a list": "? [a]\n: b",
    "key is a mapping": "? {a: b}\n: c",
    "timestamp": "a: !!timestamp b",
    "object": "a: !!python/object/apply:os.system [touch made]",
    "not UTF-8": "\udcff",
    "null": "\x00",
}


@pytest.mark.parametrize("name", NOT_YAML)
def test_yaml_is_limited(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    begin = time.monotonic()
    content = NOT_YAML[name].encode("utf-8", "surrogateescape")
    assert outcome(READERS["case file"], content, tmp_path) and time.monotonic() - begin < 5.0
    assert not (tmp_path / "made").exists()


SMUGGLED = ["shell smuggled", "1\nshell smuggled", "1; shell smuggled", "1 &\nsmuggled", "${smuggled}", "' smuggled '"]
SMUGGLED += ["$(smuggled)", "1 # smuggled", "\u200bsmuggled", "1\rsmuggled", "1 smuggled", "*\tsmuggled"]


@pytest.mark.slow
def test_no_scene_smuggles_a_command(tmp_path: Path) -> None:
    """Every value and every key of a scene is replaced by text that would add a command."""
    content, path, taken = yaml.safe_load(SCENE), tmp_path / "case.yaml", 0
    del content["matrix"]
    places = [(place, text, as_key) for place in leaves(content) if place for text in SMUGGLED for as_key in (0, 1)]
    for place, text, as_key in places:
        path.write_text(yaml.safe_dump(changed(content, place, text, as_key)), encoding="utf-8")
        try:
            jobs = [made(case) for case in load_file(path)]
        except InputError:
            continue
        taken += 1
        told = [line for job in jobs for line in (*job.setup, *job.commands, *map(str, job.runs))]
        assert told and not any("smuggled" in line for line in told), (place, text)
    assert taken  # texts for people are accepted as they are


@pytest.mark.parametrize(
    ("name", "before", "after", "said"),
    [
        ("dump", b"\n1 2 ", b"\n" + 30 * b"9" + b" 2 ", "column id: must hold whole numbers"),
        ("extxyz", b"2\n", 50 * b"6" + b"\n", "it ends before the particles that its first line counts"),
    ],
)
def test_numbers_out_of_range_are_refused(name: str, before: bytes, after: bytes, said: str, tmp_path: Path) -> None:
    """For an id that fits no integer numpy raises OverflowError; ASE reads on past the end of a file."""
    seed = READERS[name].seeds[0]
    assert seed.count(before) == 1
    assert said in outcome(READERS[name], seed.replace(before, after), tmp_path)


NO_FILE: dict[str, Callable[[Path], Any]] = {
    "fifo": os.mkfifo,
    "device": lambda path: path.symlink_to("/dev/zero"),
    "folder": lambda path: path.mkdir(),
    "absent": lambda path: None,
}


@pytest.mark.parametrize("what", NO_FILE)
def test_no_reader_waits_for_a_fifo_or_reads_a_device(what: str, tmp_path: Path) -> None:
    by_path = READERS.keys() - {"fix rheo", "fix rheo/pressure", "shard", "message", "extxyz"}
    for name in by_path - ({"history"} if what == "absent" else set()):  # an absent history is empty
        path = tmp_path / name.replace("/", " ") / READERS[name].name
        path.parent.mkdir()
        NO_FILE[what](path)
        begin = time.monotonic()
        with pytest.raises(InputError):
            READERS[name].read(path)
        assert time.monotonic() - begin < 2.0, name


# --- values of a run.json


@pytest.mark.parametrize(
    "shard", ["1/1000000000", "1/x", "1/1e400", "x", "1/0", "-1/2", "1/" + "9" * 400, "\u0661/\u0662"]
)
def test_shards_of_any_kind_end_in_a_line(shard: str, tmp_path: Path) -> None:
    for name in ("a", "b"):
        run = made_runs.run(cases=[made_runs.case(name)])
        run.shard = shard
        (tmp_path / name).mkdir()
        (tmp_path / name / "run.json").write_text(run.to_json())
    begin = time.monotonic()
    with pytest.raises(InputError, match="shard") as told:
        shards.merge([tmp_path / "a", tmp_path / "b"], tmp_path / "out")
    assert time.monotonic() - begin < 2.0 and len(str(told.value)) < 400
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["../a", "a/b", ".a", "", "a\nb", "a\x00b", "x" * 300, "-rf"])
def test_names_that_become_files_are_checked(name: str, tmp_path: Path) -> None:
    text = made_runs.run(cases=[made_runs.case("one")]).to_json()
    (tmp_path / "run.json").write_text(text.replace('"case": "one"', f'"case": {name!r}'.replace("'", '"')))
    with pytest.raises(InputError):
        read_run(tmp_path)


def test_unclosed_quotes_are_no_command() -> None:
    assert source_of(CaseRecord(case="a", verdict="pass", reproduce="eos-ref audit 'in.deck")) is None


@pytest.mark.slow
def test_many_cases_are_read(tmp_path: Path) -> None:
    run = made_runs.run(cases=[made_runs.case(f"case-{k}") for k in range(5_000)])
    Document("run", RunRecord).write(tmp_path / "run.json", run)
    begin = time.process_time()
    assert len(read_run(tmp_path).cases) == 5_000 and time.process_time() - begin < 5.0
