"""The journal of a run: only the same run is resumed, and every kept case is complete."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from eos_ref import InputError
from lammps_cases.records.case_parts import FieldRecord
from lammps_cases.records.run_record import CaseRecord, EngineRecord, RunRecord
from lammps_cases.run import judged
from lammps_cases.run.judged import CaseJournal, RunStart
from lammps_cases.scene import casefile


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
    return journal


def test_resumed_run_gets_its_first_record(journal: CaseJournal) -> None:
    assert journal.begin(run_start(date="later")).run.date == "d"


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
    judged = ("a", "b")
    assert journal.begin(run_start(), judged).run.older == {}
    assert journal.begin(run_start(context="p"), judged[:1]).run.older == {"a": "reference"}
    assert journal.begin(run_start(context="p", code="o"), judged).run.older == {"a": "reference", "b": "code"}
    goes_on = journal.begin(run_start(context="p", code="o"), judged[1:])
    assert goes_on.run.older == {"b": "code"} and goes_on.code == "o"
    other = journal.begin(run_start(context="p", code="o", reference={"numpy": "3"}), judged)
    assert other.run.older == {"a": "reference", "b": "reference"} and other.run.reference == {"numpy": "3"}
    assert journal.begun() == other


def test_kept_cases_are_read_back(journal: CaseJournal) -> None:
    records = {name: kept(journal, name) for name in ("a", "b")}
    assert journal.records() == records and journal.lost(records) == []


@pytest.mark.parametrize("damaged", ["fields/a.npz", ".journal/cases/a.json"])
def test_a_damaged_case_is_not_judged_and_leaves_nothing(damaged: str, journal: CaseJournal) -> None:
    records = {name: kept(journal, name) for name in ("a", "b")}
    (entry,) = journal.folder.rglob("a.json")
    path = journal.folder / "fields" / "a.npz" if damaged.endswith("npz") else entry
    path.write_bytes(path.read_bytes()[:-1])
    (journal.folder / ".half-written").touch()
    assert journal.records() == {"b": records["b"]}
    assert [path.name for path in (journal.folder / "fields").iterdir()] == ["b.npz"]
    assert not entry.exists() and not (journal.folder / ".half-written").exists()
    assert journal.lost(records) == ["a"]


def test_known_cases_are_not_read_again(journal: CaseJournal) -> None:
    record = kept(journal, "a")
    (entry,) = journal.folder.rglob("a.json")
    entry.write_text("damaged")
    assert journal.records({"a": record}) == {"a": record} and entry.exists()


def test_discarded_journal_leaves_nothing(journal: CaseJournal) -> None:
    kept(journal, "a")
    journal.forget()
    assert journal.begun() is None and list(journal.folder.iterdir()) == []


def test_start_depends_on_the_scenes_of_its_cases(case_file: Callable[..., Path]) -> None:
    run = run_start().run
    hashes = [judged.start(run, casefile.load_file(case_file(**of))) for of in ({}, {}, {"rho": {"constant": 1}})]
    assert hashes[0] == hashes[1] != hashes[2]
    assert hashes[0].code == hashes[2].code and [*hashes[0].cases] == ["mine"]


def test_start_depends_on_the_files_of_its_cases(tmp_path: Path) -> None:
    names = ("files.yaml", "droplet.extxyz", "droplet.data", "droplet.dump", "densities.csv")
    for name in names:
        (tmp_path / name).write_bytes((casefile.SHIPPED / name).read_bytes())
    files = {file for case in casefile.load_file(tmp_path / names[0]) for file in case.scene.files}
    assert files == set(names[1:])

    def hashes() -> dict[str, str]:
        return judged.start(run_start().run, casefile.load_file(tmp_path / names[0])).cases

    before = hashes()
    with (tmp_path / "densities.csv").open("a") as table:
        table.write("\n")
    assert {name for name, one in hashes().items() if one != before[name]} == {"files.csv"}
