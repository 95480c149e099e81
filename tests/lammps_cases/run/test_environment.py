"""A run in a hostile environment: a report, or one line and an exit code, and no partial files."""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from eos_ref import InputError
from lammps_cases.engine.installations import Engine
from lammps_cases.records import folders
from lammps_cases.records.files import write_atomically
from lammps_cases.records.progress import Progress
from lammps_cases.records.run_record import read_run
from lammps_cases.run import campaign
from lammps_cases.scene import casefile

pytestmark = [pytest.mark.lammps, pytest.mark.slow]
COMMAND = [sys.executable, "-m", "lammps_cases.cli.main", "run"]


class Removes(Progress):
    """Remove a folder when two cases are judged."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def advance(self, done: int, total: int | None, label: str, complaint: str = "") -> None:
        if done == 2:
            gone = self.folder.rename(self.folder.with_name("gone"))  # at once: a worker may be writing into it
            shutil.rmtree(gone, ignore_errors=True)


@pytest.mark.parametrize("without", ["HOME and many files", "TMPDIR"])
def test_a_run_needs_neither_home_nor_temporary_folder_nor_many_files(without: str, tmp_path: Path) -> None:
    environment = {**os.environ, "TMPDIR": "/nowhere"} if without == "TMPDIR" else dict(os.environ)
    if without != "TMPDIR":
        del environment["HOME"]
    few = [] if without == "TMPDIR" else ["prlimit", "--nofile=64:64"]
    command = [*few, *COMMAND, "near-rho0.linear", "--out", str(tmp_path / "report")]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert read_run(tmp_path / "report").summary == {"exact": 2}


def test_removal_of_the_partial_folder_is_an_error(tmp_path: Path) -> None:
    """It was exit code 0 with no report, or one without the arrays of the cases judged before."""
    out, cases = tmp_path / "report", casefile.select(casefile.load(), ["ranges"])
    with pytest.raises(InputError, match=r"^output folder: lost \d+ judged cases? .*--resume.*report") as raised:
        campaign.run_cases(cases, Engine(), 1, out, progress=Removes(folders.making(out)), resume=False)
    assert "\n" not in str(raised.value) and not out.exists()
    run = campaign.run_cases(cases, Engine(), 1, out, resume=True)
    arrays = [path for path in (out / "fields").iterdir() if "@" not in path.name]
    assert len(run.cases) == len(cases) == len(arrays)


def test_removal_of_the_current_folder_is_harmless(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "current").mkdir()
    monkeypatch.chdir(tmp_path / "current")
    cases = casefile.select(casefile.load(), ["ranges"])
    campaign.run_cases(cases, Engine(), 1, tmp_path / "report", progress=Removes(tmp_path / "current"))
    assert len(read_run(tmp_path / "report").cases) == len(cases)
    os.chdir(tmp_path)


def test_a_file_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    """The system names no file if a disk is full: a run ended in a traceback."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    write_atomically(tmp_path / "file", "old")
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    try:
        with pytest.raises(OSError, match="file") as raised:
            write_atomically(tmp_path / "file", 2000 * "x")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert raised.value.filename == str(tmp_path / "file")
    assert [path.read_text() for path in tmp_path.iterdir()] == ["old"]


@pytest.mark.root
def test_full_disk_is_one_line_and_judged_cases_are_kept(tmp_path: Path) -> None:
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=200k", "tmpfs", str(tmp_path)], check=True)
    try:
        command = [*COMMAND, "ranges", "near-rho0.linear", "--out", str(tmp_path / "report")]
        done = subprocess.run([*command, "--json"], capture_output=True, text=True, check=False)
        assert (done.returncode, done.stderr) == (2, "")
        assert "No space left on device" in done.stdout and not (tmp_path / "report").exists()
        subprocess.run(["mount", "-o", "remount,size=100m", str(tmp_path)], check=True)
        done = subprocess.run([*command, "--resume"], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    finally:
        subprocess.run(["umount", str(tmp_path)], check=True)


@pytest.mark.root
def test_caches_on_a_full_disk_cost_nothing(tmp_path: Path) -> None:
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(tmp_path)], check=True)
    try:
        own = {"EOS_REF_PREDICTIONS": str(tmp_path / "p"), "EOS_REF_HISTORY": str(tmp_path / "history.sqlite")}
        out = tmp_path.with_name("out")
        command = [*COMMAND, "near-rho0", "--out", str(out)]
        assert subprocess.run(command, env={**os.environ, **own}, check=False, capture_output=True).returncode == 0
    finally:
        subprocess.run(["umount", str(tmp_path)], check=True)
