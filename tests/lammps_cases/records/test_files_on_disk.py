"""Documents, journals and folders on disk, and the effect of damage and kills on them."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from filelock import FileLock

from eos_ref import InputError
from lammps_cases.records import folders
from lammps_cases.records.documents import SCHEMAS, Document
from lammps_cases.records.files import csv_text, read_arrays, write_arrays
from lammps_cases.records.journal import Journal


@dataclass(frozen=True)
class Entry:
    name: str
    value: float


@dataclass(frozen=True)
class Content:
    entries: tuple[Entry, ...]
    schema: str = SCHEMAS["chart"]


CONTENT = Document("chart", Content)


# --- documents


@pytest.mark.parametrize(
    ("damage", "complaint"),
    [
        (lambda text: text[:30], "document: Invalid JSON"),
        (lambda text: "[]", "document: Input should be an object"),
        (lambda text: text.replace("chart/1", "chart/9"), "schema: must be eos-ref/chart/1, found 'eos-ref/chart/9'"),
        (lambda text: text.replace('"schema"', '"scheme"'), "schema: must be eos-ref/chart/1"),
        (lambda text: text.replace("2.5", '"much"'), r"entries.0.value: Input should be a valid number"),
    ],
)
def test_a_damaged_document_is_refused_in_one_line(
    tmp_path: Path, damage: Callable[[str], str], complaint: str
) -> None:
    path = tmp_path / "deep" / "chart.json"
    CONTENT.write(path, Content((Entry("a", 2.5),)))
    assert CONTENT.read(path) == Content((Entry("a", 2.5),))
    before = path.read_text()
    path.write_text(damage(before))
    assert path.read_text() != before
    with pytest.raises(InputError, match=f"^{complaint}.*chart.json") as raised:
        CONTENT.read(path)
    assert "\n" not in str(raised.value)
    path.unlink()
    with pytest.raises(InputError, match=r"^chart: cannot be read: No such file.*chart.json"):
        CONTENT.read(path)


# --- journals


def test_a_journal_outlives_a_kill_in_the_middle_of_a_line(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "deep" / "journal.jsonl", Entry)
    assert journal.entries() == []
    one, two, three = (Entry(name, value) for name, value in (("one", 1.0), ("two", 0.1), ("drei", -3.0)))
    journal.append(one)
    with journal.file.open("ab") as file:
        file.write(b'{"name": "cut", "val')
    journal.append(two)
    journal.append(three)
    assert journal.entries() == [one, two, three]
    assert list(journal.lines()) == [one, None, two, three]


# --- folders


def _folder(path: Path, content: str) -> Path:
    path.mkdir(parents=True)
    (path / "file").write_text(content)
    return path


def test_folder_is_replaced_only_by_a_swap(tmp_path: Path) -> None:
    target = _folder(tmp_path / "target", "old")
    with folders.replacement(target) as partial:
        (partial / "file").write_text("never")
    assert (target / "file").read_text() == "old"
    with folders.replacement(target) as partial:
        (partial / "file").write_text("new")
        folders.swap(partial, target)
    assert (target / "file").read_text() == "new"
    assert list(tmp_path.iterdir()) == [target]


def test_replacement_that_fails_between_renames_restores_the_old_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target, rename, calls = _folder(tmp_path / "target", "old"), Path.rename, list[Path]()

    def failing(path: Path, to: Path) -> Path:
        calls.append(path)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return rename(path, to)

    monkeypatch.setattr(Path, "rename", failing)
    with pytest.raises(KeyboardInterrupt), folders.replacement(target) as partial:
        folders.swap(partial, target)
    assert (target / "file").read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_folder_left_aside_by_a_kill_is_restored(tmp_path: Path) -> None:
    target = tmp_path / "target"
    aside = _folder(tmp_path / ".target.old", "old")
    assert folders.present(target) == aside
    with folders.replacement(target):
        assert folders.present(target) == target
        assert (target / "file").read_text() == "old"


def _done(folder: Path, count: int) -> None:
    """Put finished parts into a partial folder."""
    (folder / folders.JOURNAL).mkdir(exist_ok=True)
    for k in range(count):
        (folder / folders.JOURNAL / str(k)).touch()


def test_partial_folder_is_kept_if_anything_is_done_and_resumed_on_request(tmp_path: Path) -> None:
    target = tmp_path / "target"
    aside = folders.interrupted(target)
    for count, kept in ((0, 0), (2, 2), (1, 2), (3, 3)):
        with folders.replacement(target, resume=False) as partial:
            assert list(partial.iterdir()) == [], "started empty"
            _done(partial, count)
        assert list(tmp_path.iterdir()) == [aside] * bool(kept), "a folder with less done is not kept"
        assert len(list((aside / folders.JOURNAL).glob("*"))) == kept
    with folders.replacement(target, resume=True) as partial:
        assert len(list((partial / folders.JOURNAL).iterdir())) == 3 and not aside.exists()
        folders.swap(partial, target)
    assert list(tmp_path.iterdir()) == [target] and list(target.iterdir()) == []
    with folders.replacement(target) as partial:
        _done(partial, 9)
    assert list(tmp_path.iterdir()) == [target], "a folder that cannot be resumed is not kept"


def test_folder_of_a_killed_program_is_kept_by_the_next(tmp_path: Path) -> None:
    target = tmp_path / "target"
    folders.making(target).mkdir()
    _done(folders.making(target), 2)
    with folders.replacement(target, resume=False) as partial:
        _done(partial, 1)
    assert [path.name for path in tmp_path.iterdir()] == ["target.interrupted"]
    assert len(list((folders.interrupted(target) / folders.JOURNAL).iterdir())) == 2
    with folders.replacement(target) as partial:
        folders.swap(partial, target)
    assert list(tmp_path.iterdir()) == [target]


def test_a_folder_that_cannot_be_renamed_gets_the_new_content(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = _folder(tmp_path / "mount", "old")
    _folder(target / "inner", "old")

    def busy(path: Path, to: Path) -> Path:
        raise OSError("Device or resource busy")

    monkeypatch.setattr(Path, "rename", busy)
    with folders.replacement(target) as partial:
        (partial / "other").write_text("new")
        folders.swap(partial, target)
    assert [path.name for path in target.iterdir()] == ["other"]


def test_one_program_at_a_time(tmp_path: Path) -> None:
    target = tmp_path / "deep" / "target"
    with (
        folders.exclusive(target, "folder", "is busy"),
        pytest.raises(InputError, match=r"^folder: is busy.*target"),
        folders.exclusive(target, "folder", "is busy"),
    ):
        pass
    with folders.exclusive(target, "folder", "is busy"):
        pass
    assert list(target.parent.iterdir()) == []


def test_waiting_process_gets_the_lock_when_its_file_is_removed(tmp_path: Path) -> None:
    """The first holder removes the lock file that the second one waits for."""
    target = tmp_path / "target"
    with folders.exclusive(target, "folder"):
        child = os.fork()
        if child == 0:
            signal.alarm(20)
            with folders.exclusive(target, "folder"):
                (tmp_path / "waited").touch()
                held = FileLock(tmp_path / ".target.lock").lock_file
                os._exit(0 if Path(held).exists() else 1)
        time.sleep(0.3)
        assert not (tmp_path / "waited").exists()
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


# --- tables and arrays


def test_csv_quotes_what_must_be() -> None:
    assert csv_text([("a", 1.5), ('x,"y"', None)]) == 'a,1.5\n"x,""y""",\n'
    assert csv_text([("a,b", "c\td")], "\t") == 'a,b\t"c\td"\n'


def test_arrays_are_read_as_numpy_reads_them(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    written = {
        "f.lammps": np.array([np.nan, -0.0, 1e-310]),
        "x": np.asfortranarray(np.arange(6.0).reshape(2, 3)),
    }
    written |= {"id": np.arange(3), "type": np.arange(3, dtype=np.int32), "none": np.empty((0, 3))}
    write_arrays(path, written)
    found = read_arrays(path)
    with np.load(path) as loaded:
        assert found.keys() == set(loaded.files)
        for name in loaded.files:
            np.testing.assert_array_equal(found[name], loaded[name])
            assert found[name].dtype == loaded[name].dtype
