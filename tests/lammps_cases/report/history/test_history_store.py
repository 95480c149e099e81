"""The file of runs: stored runs are read back, whatever happens to the file."""

from __future__ import annotations

import contextlib
import math
import multiprocessing
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
from multiprocessing.synchronize import Barrier
from pathlib import Path

import pytest

from eos_ref.errors import InputError
from lammps_cases.records.case_parts import FieldRecord
from lammps_cases.records.files import write_atomically
from lammps_cases.records.run_record import CaseRecord, RunRecord
from lammps_cases.report import history as kept
from lammps_cases.report.history import store
from lammps_cases.report.history.store import History
from tests.support import made_runs


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "deep" / "history.sqlite"


def test_stored_run_is_read_back(file: Path) -> None:
    record = made_runs.run()
    record.cases[1].fields[0].explained_by = ["force-per-volume"]
    record.cases[1].message = "a word"
    with History(file) as history:
        assert history.add(record, revision="abc")
    with History(file) as history:
        (run,) = history.runs()
        results = history.results([run.id])
        outcomes = history.outcomes(result.outcome for result in results)
    assert (run.date, run.revision, run.counts, run.cases) == (record.date, "abc", {"pass": 2}, 2)
    assert run.engine.key == record.engine.library_sha256
    assert [(r.case, r.lammps, r.reference) for r in results] == [("one", 0.1, 0.5), ("two.a", 0.1, 0.5)]
    ended = outcomes[results[1].outcome]
    assert (ended.case, ended.kind, ended.natoms, ended.steps, ended.message) == ("two.a", "pass", 9, 3, "a word")
    assert (ended.worst, ended.worst_field) == (0.25, "f")
    field = ended.fields["f"]
    assert (field.field, field.verdict, field.max_abs, field.digest) == ("f", "pass", 1e-9, "00000000000000aa")
    assert field.explained_by == ("force-per-volume",)


def test_same_run_is_stored_once(file: Path) -> None:
    with History(file) as history:
        assert history.add(made_runs.run())
        assert not history.add(made_runs.run())
        assert history.add(made_runs.run(seconds=3.0))
        assert len(history.runs()) == 2


def test_equal_outcomes_are_stored_once(file: Path) -> None:
    many = [made_runs.case(f"case-{k}") for k in range(400)]
    with History(file) as history:
        history.add(made_runs.run(cases=many))
        first = file.stat().st_size
        history.add(made_runs.run(cases=many, date="2026-11-02"))
        assert len({r.outcome for r in history.results([1, 2])}) == 400
    assert (
        file.stat().st_size - first < 400 * 60
    )  # an id of a run and of an outcome, two seconds, one entry of an index


@pytest.mark.parametrize("ratio", [math.nan, math.inf, -math.inf, None, 0.0, 5e-324, 1.7976931348623157e308])
def test_every_number_is_read_back_unchanged(file: Path, ratio: float | None) -> None:
    record = made_runs.run(cases=[made_runs.case("one", "differs", ratio)])
    record.cases[0].fields[0].max_abs = ratio
    with History(file) as history:
        history.add(record)
        (ended,) = history.outcomes([1]).values()
    (field,) = ended.fields.values()
    for value in (ended.worst, field.max_over_bound, field.max_abs):
        assert repr(value) == repr(ratio)


def test_not_a_number_is_the_worst_field(file: Path) -> None:
    fields = [
        FieldRecord(field=n, stage="pair", verdict="differs", max_over_bound=r)
        for n, r in (("f", 9e9), ("v", math.nan))
    ]
    with History(file) as history:
        history.add(made_runs.run(cases=[CaseRecord(case="one", verdict="differs", fields=fields)]))
        (ended,) = history.outcomes([1]).values()
    assert ended.worst_field == "v"


def test_expected_refusal_is_a_kind_of_its_own(file: Path) -> None:
    cases = [CaseRecord(case="one", verdict="refused", expects="bad"), CaseRecord(case="two", verdict="refused")]
    with History(file) as history:
        history.add(made_runs.run(cases=cases))
        assert history.runs()[0].counts == {"refused as expected": 1, "refused": 1}
        assert [o.kind for o in history.outcomes([1, 2]).values()] == ["refused as expected", "refused"]


def _add_some(file: Path, first: int, together: Barrier) -> None:
    together.wait()
    for k in range(first, first + 3):
        with History(file) as history:
            history.add(made_runs.run(seconds=float(k)))


@pytest.mark.parametrize("again", range(6))
def test_concurrent_processes_wait_for_each_other(file: Path, again: int) -> None:
    context = multiprocessing.get_context("fork")
    together = context.Barrier(4)
    writers = [context.Process(target=_add_some, args=(file, first, together)) for first in (0, 10, 20, 30)]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join(60)
        assert writer.exitcode == 0
    with History(file) as history:
        assert sorted(run.seconds for run in history.runs()) == [10.0 * i + k for i in range(4) for k in range(3)]
        assert all(len(history.results([run.id])) == 2 for run in history.runs())


_KILLED = """
import os, signal, sys
from pathlib import Path
from tests.support import made_runs
from lammps_cases.report.history import store

class Deadly:
    lammps = property(lambda self: os.kill(os.getpid(), signal.SIGKILL))

cases = [made_runs.case(f"case-{k}") for k in range(1500)]
for case in cases:
    case.message = f"{case.case:2000}"  # more than SQLite keeps in memory: much is on the disk before the end
cases[-1].seconds = Deadly()
with store.History(Path(sys.argv[1])) as history:
    history.add(made_runs.run(cases=cases, seconds=7.0), content="x")
"""


@pytest.mark.slow
@pytest.mark.parametrize("first", [True, False], ids=["first run", "later run"])
def test_a_kill_while_a_run_is_added_leaves_the_runs_before_it(file: Path, first: bool) -> None:
    if not first:
        with History(file) as history:
            history.add(made_runs.run())
    here = os.pathsep.join([str(Path(__file__).parents[4]), *sys.path])
    ended = subprocess.run(
        [sys.executable, "-c", _KILLED, str(file)], env={**os.environ, "PYTHONPATH": here}, check=False
    )
    assert ended.returncode == -signal.SIGKILL
    assert file.with_name(f"{file.name}-journal").stat().st_size > 0  # killed in the middle
    with History(file) as history:
        assert [run.seconds for run in history.runs()] == [] if first else [2.0]
        assert history.cases() == [] if first else ["one", "two.a"]
        assert history.add(made_runs.run(seconds=8.0))
        assert history.runs()[-1].seconds == 8.0


def _refused(file: Path) -> str:
    """Return the error that every use of an unusable file raises; the file stays as it is."""
    content = file.read_bytes()
    said = set()
    for use in (lambda h: h.add(made_runs.run(seconds=99.0)), lambda h: h.runs(), lambda h: h.forget("2030")):
        with pytest.raises(InputError) as refused, History(file) as history:
            use(history)
        said.add(str(refused.value))
    assert file.read_bytes() == content
    (told,) = said
    assert str(file) in told
    return told


def test_a_file_that_is_no_database_is_refused_and_left(file: Path) -> None:
    file.parent.mkdir()
    file.write_text("my notes\n" * 1000)
    assert "file is not a database" in _refused(file)


def test_a_truncated_file_is_refused_and_left(file: Path) -> None:
    with History(file) as history:
        history.add(made_runs.run())
    file.write_bytes(file.read_bytes()[:6000])
    assert "malformed" in _refused(file)


def test_nothing_is_added_to_a_file_with_a_damaged_page(file: Path) -> None:
    with History(file) as history:
        history.add(made_runs.run(cases=[made_runs.case(f"case-{k}", digest=f"{k:016x}") for k in range(500)]))
    content = bytearray(file.read_bytes())
    content[-4096 : -4096 + 64] = b"\xff" * 64
    file.write_bytes(content)
    with pytest.raises(InputError, match="cannot be used"), History(file) as history:
        history.add(made_runs.run(cases=[]))
    assert file.read_bytes() == content


def test_a_file_of_a_newer_schema_is_refused_and_left(file: Path) -> None:
    with History(file) as history:
        history.add(made_runs.run())
    with sqlite3.connect(file) as connection:
        connection.execute(f"PRAGMA user_version = {store.VERSION + 1}")
    connection.close()
    assert f"must be of schema {store.VERSION} or older" in _refused(file)


def test_the_database_of_another_program_is_refused_and_left(file: Path) -> None:
    file.parent.mkdir()
    with sqlite3.connect(file) as connection:
        connection.execute("CREATE TABLE bookmarks (address TEXT)")
    connection.close()
    assert "is the database of another program" in _refused(file)


def test_an_empty_file_and_none_are_empty_histories(file: Path) -> None:
    for made in (False, True):
        if made:
            file.parent.mkdir()
            file.touch()
        with History(file) as history:
            assert history.runs() == history.cases() == history.results([1]) == []
            assert history.forget("2030") == 0
        assert file.exists() is made
    with History(file) as history:
        assert history.add(made_runs.run())


def test_reading_a_file_does_not_change_it(file: Path) -> None:
    with History(file) as history:
        history.add(made_runs.run())
    content = file.read_bytes()
    with History(file) as history:
        history.runs()
    assert file.read_bytes() == content
    assert [path.name for path in file.parent.iterdir()] == [file.name]


def test_forget_deletes_runs_and_data_that_only_they_had(file: Path) -> None:
    with History(file) as history:
        history.add(made_runs.run(date="2026-10-01", cases=[made_runs.case(f"old-{k}") for k in range(500)]))
        history.add(made_runs.run(date="2026-11-01"))
        before = file.stat().st_size
        assert history.forget("2026-11-01") == 1
        assert [run.date for run in history.runs()] == ["2026-11-01"]
        assert history.cases() == ["one", "two.a"]
    with contextlib.closing(sqlite3.connect(file)) as database:
        assert database.execute("SELECT count(*) FROM fields").fetchall() == [(2,)]
    assert file.stat().st_size < before / 2


def _collected(record: RunRecord, capfd: pytest.CaptureFixture[str]) -> list[str]:
    capfd.readouterr()
    kept.collect(record)
    out, err = capfd.readouterr()
    assert out == ""
    return err.splitlines()


def test_run_is_collected_in_the_file_of_the_variable(
    file: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(store.VARIABLE, str(file))
    assert _collected(made_runs.run(), capfd) == []
    write_atomically(file.with_name("run.json"), made_runs.run().to_json())
    kept.collect(made_runs.run(), file.parent)  # the same, by its file
    with History(file) as history:
        assert len(history.runs()) == 1


def test_collecting_can_be_switched_off(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv(store.VARIABLE, "off")
    monkeypatch.setattr(store, "History", None)
    assert _collected(made_runs.run(), capfd) == []
    assert kept.past(made_runs.run()) is None


@pytest.mark.parametrize("below", ["/proc/nowhere", "a file"])
def test_unwritable_history_costs_a_line_and_no_run(
    below: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    folder = Path(below)
    if below == "a file":
        folder = tmp_path / "file"
        folder.write_text("")
    monkeypatch.setenv(store.VARIABLE, str(folder / "history.sqlite"))
    (line,) = _collected(made_runs.run(), capfd)
    assert line.startswith("eos-ref: this run is not in the history: history: cannot be used")
    assert kept.past(made_runs.run()) is None


def test_a_damaged_history_costs_a_line_and_no_run(
    file: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    file.parent.mkdir()
    file.write_text("my notes\n" * 1000)
    monkeypatch.setenv(store.VARIABLE, str(file))
    assert len(_collected(made_runs.run(), capfd)) == 1
    assert kept.past(made_runs.run()) is None
    assert file.read_text().startswith("my notes")


def test_the_revision_of_the_sources_is_kept(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(store.VARIABLE, str(file))
    kept.collect(made_runs.run())
    with History(file) as history:
        (run,) = history.runs()
    root = Path(kept.__file__).parents[3]
    if (root / ".git").exists() and shutil.which("git"):
        head = subprocess.run(["git", "-C", str(root), "rev-parse", "HEAD"], capture_output=True, text=True, check=True)
        assert head.stdout.startswith(run.revision.removesuffix("-dirty"))
        assert len(run.revision) >= 12
    else:
        assert run.revision == ""
