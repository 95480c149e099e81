"""The folder of a report: the earlier one stays whole until the new one is complete, and nothing else is lost."""

from __future__ import annotations

from pathlib import Path

import pytest

from eos_ref import InputError
from lammps_cases.run.report_files import output_folder

REPORT = '{\n "schema": "eos-ref/run/2"'


def report(folder: Path, text: str = REPORT) -> Path:
    (folder / "fields").mkdir(parents=True)
    (folder / "run.json").write_text(text)
    (folder / "fields" / "a.npz").touch()
    return folder


def test_a_report_is_replaced_when_the_new_one_is_complete(tmp_path: Path) -> None:
    directory = report(tmp_path / "report")
    with output_folder(directory) as folder:
        (folder / "report.html").write_text("new")
        assert (directory / "run.json").read_text() == REPORT and not (directory / "report.html").exists()
    assert [path.name for path in directory.iterdir()] == ["report.html"]
    assert [path.name for path in tmp_path.iterdir() if path.suffix == ".partial"] == []


def test_failed_run_leaves_the_earlier_report(tmp_path: Path) -> None:
    directory = report(tmp_path / "report")
    with pytest.raises(ZeroDivisionError), output_folder(directory):
        1 / 0  # noqa: B018
    assert (directory / "run.json").read_text() == REPORT and (directory / "fields" / "a.npz").exists()


@pytest.mark.parametrize("foreign", ["notes.txt", "fields/notes.txt", "run.json"])
def test_a_folder_that_holds_anything_else_is_refused(foreign: str, tmp_path: Path) -> None:
    directory = report(tmp_path / "mine")
    (directory / foreign).write_text("somebody's")
    with (
        pytest.raises(InputError, match="output folder: must be empty or hold an earlier report"),
        output_folder(directory),
    ):
        pass
    assert (directory / foreign).read_text() == "somebody's"


def test_a_file_is_no_folder(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("text")
    with pytest.raises(InputError, match="output folder"), output_folder(tmp_path / "file"):
        pass
    assert (tmp_path / "file").read_text() == "text"


@pytest.mark.parametrize("above", [".", ".."])
def test_neither_the_current_folder_nor_one_above(above: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    with pytest.raises(InputError, match="must not be the current folder or above it"), output_folder(Path(above)):
        pass


def test_a_place_where_no_file_can_be_made() -> None:
    with (
        pytest.raises(InputError, match="output folder: cannot be written, found '/proc/x'"),
        output_folder(Path("/proc/x")),
    ):
        pass


def test_two_runs_do_not_write_into_one_folder(tmp_path: Path) -> None:
    with output_folder(tmp_path / "report") as folder:
        with pytest.raises(InputError, match="another run is writing into it"), output_folder(tmp_path / "report"):
            pass
        (folder / "run.json").write_text(REPORT)
    assert (tmp_path / "report" / "run.json").read_text() == REPORT


@pytest.mark.parametrize("length", [243, 244, 300])
def test_name_leaves_room_for_suffixes(length: int, tmp_path: Path) -> None:
    """The longest suffix, of an interrupted run, has 12 bytes; names have at most 255."""
    target = tmp_path / (length * "y")
    if length == 243:
        with output_folder(target, resume=False) as folder:
            (folder / "run.json").write_text("{}")
        assert (target / "run.json").exists()
        return
    with pytest.raises(InputError, match="output folder: must have a name of at most 243 bytes"), output_folder(target):
        pass
