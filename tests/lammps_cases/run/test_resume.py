"""An interrupted or killed run keeps judged cases; resuming it gives the report of an undisturbed run."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from eos_ref import InputError
from lammps_cases.comparison.store import Store
from lammps_cases.engine.installations import Engine
from lammps_cases.records import folders
from lammps_cases.records.progress import Progress
from lammps_cases.records.run_record import EngineRecord, read_run
from lammps_cases.run import campaign, provenance
from lammps_cases.run.shards import merge
from lammps_cases.scene import casefile
from lammps_cases.scene.casefile import Case
from lammps_cases.versions.acceptance import accept
from tests.support.outcome import Outcome
from tests.support.resumed import report

pytestmark = pytest.mark.lammps
NAMES = (
    "near-rho0.linear",
    "near-rho0.cubic-plus",
    "ranges.override",
    "refused.range-two-stars",
    "walls-summed.quintic",
)


class Interrupts(Progress):
    """Simulate Ctrl-C after a number of judged cases."""

    def __init__(self, after: int) -> None:
        self.after, self.told = after, list[str]()

    def advance(self, done: int, total: int | None, label: str, complaint: str = "") -> None:
        self.told.append(label)
        if len(self.told) == self.after:
            raise KeyboardInterrupt


def run(
    cases: list[Case], out: Path, resume: bool | None, after: int = 0, store: Store | None = None, **options: Any
) -> list[str]:
    """Run cases; return the names of those judged."""
    progress = Interrupts(after)
    asked = campaign.Request("eos-ref run", **options)
    campaign.run_cases(cases, Engine(), 2, out, asked, progress, store, resume)
    return progress.told


@pytest.fixture(scope="module")
def cases() -> list[Case]:
    return casefile.select(casefile.load(), NAMES)


@pytest.fixture(scope="module")
def undisturbed(cases: list[Case], tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("undisturbed")
    assert len(run(cases, folder / "report", resume=False)) == len(cases)
    return report(folder / "report", folder / "scratch")


def interrupted(cases: list[Case], out: Path, after: int) -> Path:
    with pytest.raises(KeyboardInterrupt, match=f"of {len(cases)} cases.*--resume"):
        run(cases, out, resume=False, after=after)
    return folders.interrupted(out)


def test_interrupted_run_is_resumed_to_the_same_report(
    cases: list[Case], undisturbed: dict[str, bytes], tmp_path: Path
) -> None:
    out = tmp_path / "report"
    partial = interrupted(cases, out, 3)
    record = read_run(partial)
    assert len(record.cases) >= 3 and len(record.cases) + record.missing == len(cases)
    assert "interrupted: " in (partial / "summary.md").read_text()
    assert not out.exists()
    with pytest.raises(KeyboardInterrupt):
        run(cases, out, resume=True, after=1)  # interrupted once more
    kept = {case.case for case in read_run(partial).cases}
    judged = run(cases, out, resume=True)
    assert not kept & set(judged) and len(kept) + len(judged) == len(cases), "none twice, none lost"
    assert report(out, tmp_path / "scratch") == undisturbed
    assert {path.name for path in tmp_path.iterdir()} == {"report", "scratch"}


def test_more_cases_than_in_memory_give_the_same_report(
    cases: list[Case], undisturbed: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beyond them particles, records and pictures are made or read again, and the store is trimmed."""
    monkeypatch.setattr(campaign, "KEPT", 1)
    trimmed = list[Path]()
    monkeypatch.setattr(Store, "trim", lambda store: trimmed.append(store.folder))
    interrupted(cases, tmp_path / "report", 3)
    run(cases, tmp_path / "report", resume=True, store=Store(tmp_path / "store"))
    assert report(tmp_path / "report", tmp_path / "scratch") == undisturbed and trimmed


class Forgets(Progress):
    """Remove the entry of the last case from the journal when it is judged."""

    def __init__(self, making: Path) -> None:
        self.making = making

    def advance(self, done: int, total: int | None, label: str, complaint: str = "") -> None:
        if done == total:
            (self.making / "journal" / "cases" / f"{label}.json").unlink()


def test_loss_of_a_case_from_the_journal_is_an_error(
    cases: list[Case], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(campaign, "KEPT", 1)
    out = tmp_path / "report"
    with pytest.raises(InputError, match="lost 1 judged case during"):
        campaign.run_cases(cases, Engine(), 2, out, progress=Forgets(folders.making(out)))
    assert not out.exists()


def test_earlier_report_stays_until_the_run_is_complete(cases: list[Case], tmp_path: Path) -> None:
    out = tmp_path / "report"
    run(cases[:1], out, resume=None)
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    interrupted(cases, out, 2)
    assert before == {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    run(cases, out, resume=True)
    assert len(read_run(out).cases) == len(cases)


def _cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-9])


def test_damaged_cases_are_judged_again(cases: list[Case], undisturbed: dict[str, bytes], tmp_path: Path) -> None:
    out = tmp_path / "report"
    folder = interrupted(cases, out, 5)
    entries, fields = folder / "journal" / "cases", folder / "fields"
    hurt = [case.case for case in read_run(folder).cases if case.fields][:4]
    _cut(entries / f"{hurt[0]}.json")
    (entries / f"{hurt[1]}.json").unlink()
    _cut(fields / f"{hurt[2]}.npz")
    (fields / f"{hurt[3]}.npz").unlink()
    for name in (f"fields/.{hurt[0]}.npz.abcdefgh", ".report.html.abcdefgh"):
        (folder / name).write_text("half")
    assert set(hurt) <= set(run(cases, out, resume=True))
    assert report(out, tmp_path / "scratch") == undisturbed


def test_unknown_journal_is_discarded(cases: list[Case], tmp_path: Path) -> None:
    folder = interrupted(cases[:3], tmp_path / "report", 1)
    _cut(folder / "journal" / "run.json")
    assert len(run(cases[:3], tmp_path / "report", resume=True)) == 3


def test_killed_run_is_resumed_from_its_partial_folder(cases: list[Case], tmp_path: Path) -> None:
    out = tmp_path / "report"
    interrupted(cases, out, 3).rename(folders.making(out))
    assert len(run(cases, out, resume=True)) <= len(cases) - 3


def test_another_run_is_refused_in_one_line(cases: list[Case], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "report"
    folder = interrupted(cases, out, 2)
    changed = replace(cases[0], about="another")
    refusals = [
        ("the cases of .*: 1 case gone", cases[1:], {}),
        (rf"the cases of .*: 1 case changed \({cases[0].name}\)", [changed, *cases[1:]], {}),
        ("the --fail-on of .*, new, found 'high'", cases, {"fail_on": "high"}),
        ("the --shard of .*, none, found '1/2'", cases, {"part": ("1/2", "")}),
    ]
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    for text, others, options in refusals:
        with pytest.raises(InputError, match=rf"^--resume: needs {text}.*report") as refused:
            run(others, out, resume=True, **options)
        assert "\n" not in str(refused.value)

    def other(*arguments: Any) -> EngineRecord:
        return provenance.engine_record(*arguments).model_copy(update={"library_sha256": 64 * "0"})

    monkeypatch.setattr(campaign, "engine_record", other)
    with pytest.raises(InputError, match="--resume: needs the engine of the interrupted run, "):
        run(cases, out, resume=True)
    assert before == {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}, "nothing is lost"


def test_part_of_a_run_is_neither_accepted_nor_merged(cases: list[Case], tmp_path: Path) -> None:
    partial = interrupted(cases, tmp_path / "report", 2)
    with pytest.raises(InputError, match="run: must be whole, not interrupted"):
        merge([partial], tmp_path / "merged")
    with pytest.raises(InputError, match="run: must be whole, not interrupted"):
        accept(partial, "why", tmp_path / "accepted")


def test_resume_without_an_interrupted_run_begins_one(cases: list[Case], tmp_path: Path) -> None:
    assert len(run(cases[:1], tmp_path / "report", resume=True)) == 1


def test_run_kept_by_date_is_found_by_resume(
    eos_ref_command: Callable[..., Outcome], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("lammps_cases.cli.run.Bar", lambda **_: _Bar())
        stopped = eos_ref_command("run", "near-rho0.linear", "ranges.override", "--jobs", 1)
    assert stopped.code == 130
    (partial,) = Path("reports/parts").glob("*.interrupted")
    told = rf"interrupted after \d of 3 cases: see {partial}/summary.md; the same command with --resume continues$"
    assert re.search(told, stopped.err.strip())
    assert not Path("reports/parts/latest").exists()
    assert eos_ref_command("run", "ranges").code == 0
    assert partial.is_dir(), "another report does not clear it away"
    assert eos_ref_command("run", "near-rho0.linear", "ranges.override", "--resume").code == 0
    assert not partial.exists()
    assert len(read_run(partial.with_suffix("")).cases) == 3


class _Bar(Interrupts):
    def __init__(self) -> None:
        super().__init__(1)

    def __enter__(self) -> _Bar:
        return self

    def __exit__(self, *_: object) -> None: ...
