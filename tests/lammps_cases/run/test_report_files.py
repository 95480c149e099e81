"""The folder of a report stays whole until the new one is complete; articles made by workers are those of one process.

The journal of a run: only the same run is resumed, and every kept case is complete.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from eos_ref import InputError
from lammps_cases.engine.workers import Failure, Workers
from lammps_cases.records.case_parts import FieldRecord
from lammps_cases.records.run_record import CaseRecord, EngineRecord, RunRecord
from lammps_cases.report import findings, page
from lammps_cases.report.page import Family, RunPage
from lammps_cases.run import judged, report_files
from lammps_cases.run.judged import CaseJournal, RunStart
from lammps_cases.run.report_files import output_folder
from lammps_cases.scene import casefile
from tests.support.made_report import FINDINGS, example

REPORT = '{\n "schema": "eos-ref/run/2"'


def report(folder: Path) -> Path:
    (folder / "fields").mkdir(parents=True)
    (folder / "run.json").write_text(REPORT)
    (folder / "fields" / "a.npz").touch()
    return folder


def test_report_is_replaced_only_when_the_new_one_is_complete(tmp_path: Path) -> None:
    directory = report(tmp_path / "report")
    with pytest.raises(ZeroDivisionError), output_folder(directory):
        1 / 0  # noqa: B018
    assert (directory / "run.json").read_text() == REPORT and (directory / "fields" / "a.npz").exists()
    with output_folder(directory) as folder:
        with pytest.raises(InputError, match="another run is writing into it"), output_folder(directory):
            pass
        (folder / "report.html").write_text("new")
        assert (directory / "run.json").read_text() == REPORT and not (directory / "report.html").exists()
    assert [path.name for path in directory.iterdir()] == ["report.html"]
    assert [path.name for path in tmp_path.iterdir() if path.suffix == ".partial"] == []


@pytest.mark.parametrize(
    ("place", "foreign", "rule"),
    [
        ("../mine", "notes.txt", "must be empty or hold an earlier report"),
        ("../mine", "fields/notes.txt", "must be empty or hold an earlier report"),
        ("../mine", "run.json", "must be empty or hold an earlier report"),
        ("../mine/notes.txt", "notes.txt", ""),
        (".", "", "must not be the current folder or above it"),
        ("..", "", "must not be the current folder or above it"),
        ("/proc/x", "", "cannot be written, found '/proc/x'"),
        (244 * "y", "", "must have a name of at most 243 bytes"),
        (300 * "y", "", "must have a name of at most 243 bytes"),
    ],
)
def test_other_places_are_refused_and_left(
    place: str, foreign: str, rule: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The longest suffix, of an interrupted run, has 12 bytes; names have at most 255."""
    directory = report(tmp_path / "mine")
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    if foreign:
        (directory / foreign).write_text("somebody's")
    with pytest.raises(InputError, match=f"^output folder: {rule}"), output_folder(Path(place)):
        pass
    assert not foreign or (directory / foreign).read_text() == "somebody's"
    with output_folder(tmp_path / (243 * "y"), resume=False) as folder:
        (folder / "run.json").write_text("{}")
    assert (tmp_path / (243 * "y") / "run.json").exists()


# --- articles


@pytest.fixture(scope="module")
def families(tmp_path_factory: pytest.TempPathFactory) -> list[Family]:
    folder = tmp_path_factory.mktemp("report")
    return RunPage(findings.outcome(example(folder), FINDINGS), folder / "fields").families


@pytest.mark.slow
def test_workers_make_the_same_articles(families: list[Family]) -> None:
    with Workers(None, 2) as workers:
        assert report_files.begin_articles(workers, families)() == page.articles(families)


@pytest.mark.parametrize("count", [1, 3])
def test_articles_lost_by_workers_are_made_locally(count: int, families: list[Family]) -> None:
    failing: Any = SimpleNamespace(
        count=count, call=lambda *arguments, **options: None, outcome=lambda _: Failure("crashed", "it died")
    )
    assert report_files.begin_articles(failing, families)() == page.articles(families)


def test_shares_are_about_equal_and_hold_every_family_once(families: list[Family]) -> None:
    entries = [entry for family in families for entry in family.entries]
    made = [Family(entries[:1] * (k + 1), Path(), {}, frozenset(), True) for k in range(20)]
    shares = report_files.article_shares(made, 4)
    assert sorted(k for share in shares for k in share) == [*range(20)]
    sizes = [sum(k + 1 for k in share) for share in shares]
    assert max(sizes) < 1.1 * min(sizes), sizes
    assert len(report_files.article_shares(made[:3], 8)) == 3


# --- the journal


def run_start(**changes: Any) -> RunStart:
    run = RunRecord(engine=EngineRecord(name="env", distribution="1.0"), reference={"numpy": "2"}, date="d")
    of_run = {key: value for key, value in changes.items() if key in RunRecord.model_fields and key != "cases"}
    rest = {"code": "c", "cases": {"a": "1", "b": "2"}} | {k: v for k, v in changes.items() if k not in of_run}
    return RunStart(run=run.model_copy(update=of_run), **rest)


def kept(journal: CaseJournal, name: str) -> CaseRecord:
    (journal.folder / "fields").mkdir(exist_ok=True)
    (journal.folder / "fields" / f"{name}.npz").write_bytes(name.encode())
    field = FieldRecord(field="pressure", stage="eos", verdict="exact")
    record = CaseRecord(case=name, verdict="exact", fields=[field])
    journal.keep(record)
    return record


@pytest.fixture
def journal(tmp_path: Path) -> CaseJournal:
    journal = CaseJournal(tmp_path)
    journal.begin(run_start())
    assert journal.begin(run_start(date="later")).run.date == "d", "a resumed run gets its first record"
    return journal


@pytest.mark.parametrize(
    ("changes", "rule"),
    [
        ({"engine": EngineRecord(name="env", distribution="2.0")}, "needs the engine of the interrupted run, .*1.0"),
        ({"cases": {"a": "1", "c": "3"}}, r"cases of the interrupted run: 1 case new \(c\), 1 case gone \(b\)"),
        ({"cases": {"a": "1", "b": "3"}}, r"1 case changed \(b\)"),
        ({"fail_on": "high"}, "--fail-on of the interrupted run, new, found 'high'"),
        ({"allowed": {"support-unit": "--allow"}}, "--allow of the interrupted run, none, found 'support-unit'"),
        ({"shard": "1/2"}, "--shard of the interrupted run, none, found '1/2'"),
    ],
)
def test_another_run_cannot_resume_it(changes: dict[str, Any], rule: str, journal: CaseJournal) -> None:
    with pytest.raises(InputError, match=f"--resume: .*{rule}"):
        journal.begin(run_start(**changes))


def test_judgements_by_other_code_are_named_until_repeated(journal: CaseJournal) -> None:
    both = ("a", "b")
    assert journal.begin(run_start(), both).run.older == {}
    assert journal.begin(run_start(context="p"), both[:1]).run.older == {"a": "reference"}
    assert journal.begin(run_start(context="p", code="o"), both).run.older == {"a": "reference", "b": "code"}
    goes_on = journal.begin(run_start(context="p", code="o"), both[1:])
    assert goes_on.run.older == {"b": "code"} and goes_on.code == "o"
    other = journal.begin(run_start(context="p", code="o", reference={"numpy": "3"}), both)
    assert other.run.older == dict.fromkeys(both, "reference") and other.run.reference == {"numpy": "3"}
    assert journal.begun() == other


@pytest.mark.parametrize("damaged", ["fields/a.npz", "a.json", ""])
def test_damaged_case_is_not_judged_and_leaves_nothing(damaged: str, journal: CaseJournal) -> None:
    records = {name: kept(journal, name) for name in ("a", "b")}
    assert journal.records() == records and journal.lost(records) == []
    (entry,) = journal.folder.rglob("a.json")
    if not damaged:
        entry.write_text("damaged")
        assert journal.records(records) == records and entry.exists(), "known cases are not read again"
        journal.forget()
        assert journal.begun() is None and list(journal.folder.iterdir()) == []
        return
    path = journal.folder / damaged if damaged.endswith("npz") else entry
    path.write_bytes(path.read_bytes()[:-1])
    (journal.folder / ".half-written").touch()
    assert journal.records() == {"b": records["b"]}
    assert [path.name for path in (journal.folder / "fields").iterdir()] == ["b.npz"]
    assert not entry.exists() and not (journal.folder / ".half-written").exists()
    assert journal.lost(records) == ["a"]


def test_start_depends_on_the_scenes_and_files_of_its_cases(case_file: Callable[..., Path], tmp_path: Path) -> None:
    run = run_start().run
    hashes = [judged.start(run, casefile.load_file(case_file(**of))) for of in ({}, {}, {"rho": {"constant": 1}})]
    assert hashes[0] == hashes[1] != hashes[2]
    assert hashes[0].code == hashes[2].code and [*hashes[0].cases] == ["mine"]
    names = ("files.yaml", "droplet.extxyz", "droplet.data", "droplet.dump", "densities.csv")
    for name in names:
        (tmp_path / name).write_bytes((casefile.SHIPPED / name).read_bytes())
    cases = casefile.load_file(tmp_path / names[0])
    assert {file for case in cases for file in case.scene.files} == set(names[1:])
    before = judged.start(run, cases).cases
    with (tmp_path / "densities.csv").open("a") as table:
        table.write("\n")
    after = judged.start(run, casefile.load_file(tmp_path / names[0])).cases
    assert {name for name, one in after.items() if one != before[name]} == {"files.csv"}
