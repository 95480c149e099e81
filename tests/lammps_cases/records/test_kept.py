"""Reports kept by date and engine: the target of the link, pruning, and the effect of kills and concurrent runs."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from lammps_cases.records import folders
from lammps_cases.records.folders import KEPT, Shelf
from lammps_cases.scene import casefile
from tests.support.outcome import Outcome

KILLED = """
import os, sys
from pathlib import Path
from lammps_cases.records.folders import whole_runs
with whole_runs(Path(sys.argv[1])).place("env") as folder:
    folder.with_name(f".{folder.name}.partial").mkdir()
    os.kill(os.getpid(), 9)
"""


def report(shelf: Shelf, engine: str = "pypi:1.0") -> Path:
    """Make a complete report."""
    with shelf.place(engine) as folder:
        (folder / shelf.mark).write_text("{}")
    return folder


def there(shelf: Shelf) -> set[Path]:
    """Return all entries of a shelf except the link."""
    return {path for path in shelf.folder.iterdir() if path != shelf.link}


def test_link_points_to_the_newest_and_old_reports_are_pruned_per_engine(tmp_path: Path) -> None:
    shelf = folders.whole_runs(tmp_path)
    other = report(shelf, "pypi:2.0")
    made = [report(shelf) for _ in range(KEPT + 2)]
    assert len({*made, other}) == KEPT + 3 and made[0].name.endswith("_1.0")
    assert shelf.link.is_symlink() and shelf.link.resolve() == made[-1].resolve()
    assert set(shelf.entries()) == {other, *made[-KEPT:]}
    assert there(shelf) == set(shelf.entries())


def test_report_begun_earlier_does_not_take_the_link(tmp_path: Path) -> None:
    shelf = folders.whole_runs(tmp_path)
    with shelf.place("env") as early:
        late = report(shelf, "env")
        assert late != early and early.is_dir(), "the one at work is not cleared away"
        (early / shelf.mark).write_text("{}")
    assert shelf.entries() == [late, early]
    assert shelf.link.resolve() == late.resolve()


def test_failed_or_killed_report_leaves_the_link(tmp_path: Path) -> None:
    shelf = folders.whole_runs(tmp_path)
    whole = report(shelf)
    with pytest.raises(KeyboardInterrupt), shelf.place("env"):
        raise KeyboardInterrupt
    assert shelf.link.resolve() == whole.resolve() and there(shelf) == {whole}
    killed = subprocess.run([sys.executable, "-c", KILLED, str(tmp_path)], env=os.environ)
    assert killed.returncode == -9 and len(there(shelf)) == 4, "folder, part of one, lock"
    assert shelf.link.resolve() == whole.resolve()
    after = report(shelf)
    assert there(shelf) == {whole, after} and shelf.link.resolve() == after.resolve()


def interrupted(shelf: Shelf, engine: str) -> Path:
    """Interrupt a report with something done; return the folder it would have had."""
    with pytest.raises(KeyboardInterrupt), shelf.place(engine) as folder:
        journal = folders.interrupted(folder) / folders.JOURNAL
        journal.mkdir(parents=True)
        (journal / "run.json").write_text("{}")
        raise KeyboardInterrupt
    return folder


def resumed(shelf: Shelf, engine: str) -> Path:
    """Return the folder in which a report is resumed or begun."""
    with pytest.raises(KeyboardInterrupt), shelf.place(engine, resume=True) as folder:
        raise KeyboardInterrupt
    return folder


def test_newest_interrupted_report_of_each_engine_is_resumed(tmp_path: Path) -> None:
    shelf = folders.whole_runs(tmp_path)
    _, last = interrupted(shelf, "pypi:1.0"), interrupted(shelf, "pypi:1.0")
    other = interrupted(shelf, "pypi:2.0")
    assert resumed(shelf, "pypi:1.0") == last and resumed(shelf, "pypi:2.0") == other
    assert resumed(shelf, "pypi:3.0") not in (last, other)
    third = report(shelf, "pypi:3.0")
    assert there(shelf) == {third, *map(folders.interrupted, (last, other))}, "the older one is cleared away"


def test_finished_report_removes_one_interrupted_before(tmp_path: Path) -> None:
    shelf = folders.whole_runs(tmp_path)
    before = interrupted(shelf, "pypi:1.0")
    whole = report(shelf)
    assert there(shelf) == {whole} and shelf.link.resolve() == whole.resolve()
    assert resumed(shelf, "pypi:1.0") not in (before, whole)


def test_a_folder_in_the_place_of_the_link_is_moved_aside(tmp_path: Path) -> None:
    shelf = folders.whole_runs(tmp_path)
    shelf.link.mkdir()
    (shelf.link / "run.json").write_text("old")
    made = report(shelf)
    assert shelf.link.resolve() == made.resolve()
    assert [path.read_text() for path in tmp_path.glob("latest-before-*/run.json")] == ["old"]


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Only three cases exist."""
    load = casefile.load
    of_file = [case for case in load([casefile.SHIPPED / "near-rho0.yaml"]) if case.name.endswith(".2d")][:3]
    monkeypatch.setattr(casefile, "load", lambda paths=(), tag=None: load(paths, tag) if paths else of_file)
    monkeypatch.chdir(tmp_path)


@pytest.mark.lammps
def test_run_of_some_cases_never_replaces_a_run_of_all(
    few: None, case_file: Callable[..., Path], eos_ref_command: Callable[..., Outcome]
) -> None:
    name, *_ = (case.name for case in casefile.load())
    done = eos_ref_command("run")
    latest = Path("reports/latest").resolve()
    assert f"report: reports/{latest.name}/report.html\n" in done.out and "3 cases" in done.out
    some = [
        eos_ref_command("run", *options)
        for options in ([name], ["--shard", "1/2"], ["--shard", "2/2"], ["--cases", case_file()])
    ]
    *shards, _ = reversed(folders.parts_of_runs(Path("reports")).entries())
    assert len(shards) == KEPT - 1
    for outcome in some:
        assert "report: reports/parts/" in outcome.out and "reports/latest is unchanged" in outcome.out
        assert Path("reports/latest").resolve() == latest
    refused = eos_ref_command("run", name, "--out", "reports/latest")
    assert refused.code == 2 and "must not be a link" in refused.err
    merged = eos_ref_command("merge", *shards)
    assert "report: reports/" in merged.out and Path("reports/latest").resolve() != latest
    assert len(list(Path("reports").glob("2*/run.json"))) == 2
    for command in (["report"], ["accept", "--reason", "first"], ["history", "--add"]):
        assert eos_ref_command(*command, "reports/latest").code == 0, command
    assert Path("reports/latest").is_symlink()


@pytest.mark.lammps
def test_page_of_some_claims_never_replaces_that_of_all(few: None, eos_ref_command: Callable[..., Outcome]) -> None:
    eos_ref_command("run", "--out", "run")
    latest = Path("reports/claims/latest")
    assert eos_ref_command("claims", "--run", "run").code == 0
    whole = latest.resolve()
    assert (whole / "claims.html").is_file()
    done = eos_ref_command("claims", "pressure-linear", "--run", "run")
    assert "page: reports/claims-parts/2" in done.out and latest.resolve() == whole
    eos_ref_command("claims", "--run", "run")
    assert latest.resolve() != whole
