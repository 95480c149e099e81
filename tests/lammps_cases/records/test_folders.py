"""Folders replaced as a whole and reports kept by date and engine: the link, pruning, kills and concurrent runs."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from filelock import FileLock

from eos_ref import InputError
from lammps_cases.records import folders
from lammps_cases.records.folders import KEPT, Shelf
from lammps_cases.scene import casefile
from tests.support.outcome import Outcome

Run = Callable[..., Outcome]

# --- one folder


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
    target, aside = tmp_path / "target", _folder(tmp_path / ".target.old", "old")
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


def test_folder_that_cannot_be_renamed_gets_the_new_content(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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
    for _ in range(2):
        with (
            folders.exclusive(target, "folder", "is busy"),
            pytest.raises(InputError, match=r"^folder: is busy.*target"),
            folders.exclusive(target, "folder", "is busy"),
        ):
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


# --- a shelf of reports


@pytest.fixture
def shelf(tmp_path: Path) -> Shelf:
    return folders.whole_runs(tmp_path)


def report(shelf: Shelf, engine: str = "pypi:1.0") -> Path:
    """Make a complete report."""
    with shelf.place(engine) as folder:
        (folder / shelf.mark).write_text("{}")
    return folder


def interrupted(shelf: Shelf, engine: str, done: bool = True, resume: bool = False) -> Path:
    """Interrupt a report, with something done or nothing; return the folder it would have had."""
    with pytest.raises(KeyboardInterrupt), shelf.place(engine, resume=resume) as folder:
        if done:
            folders.interrupted(folder).mkdir()
            _done(folders.interrupted(folder), 1)
        raise KeyboardInterrupt
    return folder


def there(shelf: Shelf) -> set[Path]:
    """Return all entries of a shelf except the link."""
    return {path for path in shelf.folder.iterdir() if path != shelf.link}


def test_link_points_to_the_newest_and_old_reports_are_pruned_per_engine(shelf: Shelf) -> None:
    other = report(shelf, "pypi:2.0")
    made = [report(shelf) for _ in range(KEPT + 2)]
    assert len({*made, other}) == KEPT + 3 and made[0].name.endswith("_1.0")
    assert shelf.link.is_symlink() and shelf.link.resolve() == made[-1].resolve()
    assert there(shelf) == set(shelf.entries()) == {other, *made[-KEPT:]}


def test_report_begun_earlier_does_not_take_the_link(shelf: Shelf) -> None:
    with shelf.place("env") as early:
        late = report(shelf, "env")
        assert late != early and early.is_dir(), "the one at work is not cleared away"
        (early / shelf.mark).write_text("{}")
    assert shelf.entries() == [late, early]
    assert shelf.link.resolve() == late.resolve()


def test_failed_or_killed_report_leaves_the_link(shelf: Shelf) -> None:
    whole = report(shelf)
    interrupted(shelf, "env", done=False)
    assert shelf.link.resolve() == whole.resolve() and there(shelf) == {whole}
    child = os.fork()
    if child == 0:
        with shelf.place("env") as folder:
            folder.with_name(f".{folder.name}.partial").mkdir()
            os.kill(os.getpid(), signal.SIGKILL)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL
    assert len(there(shelf)) == 4, "folder, part of one, lock"
    assert shelf.link.resolve() == whole.resolve()
    after = report(shelf)
    assert there(shelf) == {whole, after} and shelf.link.resolve() == after.resolve()


def test_newest_interrupted_report_of_each_engine_is_resumed(shelf: Shelf) -> None:
    _, last = interrupted(shelf, "pypi:1.0"), interrupted(shelf, "pypi:1.0")
    other = interrupted(shelf, "pypi:2.0")
    for engine, found in (("pypi:1.0", True), ("pypi:2.0", True), ("pypi:3.0", False)):
        again = interrupted(shelf, engine, done=False, resume=True)
        assert (again == {"pypi:1.0": last, "pypi:2.0": other}.get(engine)) == found
    third = report(shelf, "pypi:3.0")
    assert there(shelf) == {third, *map(folders.interrupted, (last, other))}, "the older one is cleared away"


def test_finished_report_removes_one_interrupted_before(shelf: Shelf) -> None:
    before, whole = interrupted(shelf, "pypi:1.0"), report(shelf)
    assert there(shelf) == {whole} and shelf.link.resolve() == whole.resolve()
    assert interrupted(shelf, "pypi:1.0", done=False, resume=True) not in (before, whole)


def test_folder_in_the_place_of_the_link_is_moved_aside(shelf: Shelf) -> None:
    _folder(shelf.link, "old")
    assert report(shelf).resolve() == shelf.link.resolve()
    assert [path.read_text() for path in shelf.folder.glob("latest-before-*/file")] == ["old"]


@pytest.mark.parametrize(
    ("text", "name"),
    [("pypi:2025.7.22.1.0", "pypi-2025.7.22.1.0"), ("path:../../etc", "path-..-..-etc"), ("../..", ""), ("ü/é", "")],
)
def test_name_of_a_folder_has_no_path_separators(text: str, name: str) -> None:
    assert folders.folder_name(text) == name


# --- the commands


@pytest.mark.lammps
def test_part_of_a_run_or_of_claims_never_replaces_the_whole(
    case_file: Callable[..., Path], eos_ref_command: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only three cases exist."""
    load = casefile.load
    few = [case for case in load([casefile.SHIPPED / "near-rho0.yaml"]) if case.name.endswith(".2d")][:3]
    monkeypatch.setattr(casefile, "load", lambda paths=(), tag=None: load(paths, tag) if paths else few)
    monkeypatch.chdir(tmp_path)
    done = eos_ref_command("run")
    latest = Path("reports/latest").resolve()
    assert f"report: reports/{latest.name}/report.html\n" in done.out and "3 cases" in done.out
    for options in ([few[0].name], ["--shard", "1/2"], ["--shard", "2/2"], ["--cases", case_file()]):
        some = eos_ref_command("run", *options)
        assert "report: reports/parts/" in some.out and "reports/latest is unchanged" in some.out
        assert Path("reports/latest").resolve() == latest
    *shards, _ = reversed(folders.parts_of_runs(Path("reports")).entries())
    assert len(shards) == KEPT - 1
    refused = eos_ref_command("run", few[0].name, "--out", "reports/latest")
    assert refused.code == 2 and "must not be a link" in refused.err
    merged = eos_ref_command("merge", *shards)
    assert "report: reports/" in merged.out and Path("reports/latest").resolve() != latest
    assert len(list(Path("reports").glob("2*/run.json"))) == 2
    for command in (["report"], ["accept", "--reason", "first"], ["history", "--add"]):
        assert eos_ref_command(*command, "reports/latest").code == 0, command
    assert Path("reports/latest").is_symlink()

    claims = Path("reports/claims/latest")
    assert eos_ref_command("claims", "--run", "reports/latest").code == 0
    whole = claims.resolve()
    assert (whole / "claims.html").is_file()
    done = eos_ref_command("claims", "pressure-linear", "--run", "reports/latest")
    assert "page: reports/claims-parts/2" in done.out and claims.resolve() == whole
    eos_ref_command("claims", "--run", "reports/latest")
    assert claims.resolve() != whole
