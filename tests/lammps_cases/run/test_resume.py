"""An interrupted or killed run keeps judged cases; resuming it gives the report of an undisturbed run."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

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
NAMES = [
    *("near-rho0.linear", "near-rho0.cubic-plus", "ranges.override", "refused.range-two-stars", "walls-summed.quintic")
]
CASES = casefile.select(casefile.load(), NAMES)
COUNT = len(CASES)


class Interrupts(Progress):
    """Simulate Ctrl-C after a number of judged cases; also as a bar."""

    def __init__(self, after: int) -> None:
        self.after, self.told = after, list[str]()

    def advance(self, done: int, total: int | None, label: str, complaint: str = "") -> None:
        self.told.append(label)
        if len(self.told) == self.after:
            raise KeyboardInterrupt

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None: ...


def run(
    cases: list[Case], out: Path, resume: bool | None, after: int = 0, store: Store | None = None, **options: Any
) -> list[str]:
    """Run cases; return the names of those judged."""
    progress = Interrupts(after)
    asked = campaign.Request("eos-ref run", **options)
    campaign.run_cases(cases, Engine(), 2, out, asked, progress, store, resume)
    return progress.told


def interrupted(cases: list[Case], out: Path, after: int) -> Path:
    with pytest.raises(KeyboardInterrupt, match=f"of {len(cases)} cases.*--resume"):
        run(cases, out, resume=False, after=after)
    return folders.interrupted(out)


def contents(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("undisturbed")
    assert len(run(CASES, folder / "report", resume=False)) == COUNT
    return report(folder / "report", folder / "scratch")


@pytest.fixture(scope="module")
def stopped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What an interrupt after five cases left."""
    return interrupted(CASES, tmp_path_factory.mktemp("stopped") / "report", 5)


@pytest.fixture
def partial(stopped: Path, tmp_path: Path) -> Path:
    """A copy of it next to a report that was not written."""
    return Path(shutil.copytree(stopped, tmp_path / "report.interrupted"))


def test_interrupted_run_is_resumed_to_the_same_report(
    partial: Path, undisturbed: dict[str, bytes], tmp_path: Path
) -> None:
    out = tmp_path / "report"
    record = read_run(partial)
    assert len(record.cases) >= 5 and len(record.cases) + record.missing == COUNT
    assert "interrupted: " in (partial / "summary.md").read_text()
    with pytest.raises(KeyboardInterrupt):
        run(CASES, out, resume=True, after=1)  # interrupted once more
    assert not out.exists()
    kept = {case.case for case in read_run(partial).cases}
    judged = run(CASES, out, resume=True)
    assert not kept & set(judged) and len(kept) + len(judged) == COUNT, "none twice, none lost"
    assert report(out, tmp_path / "scratch") == undisturbed
    assert {path.name for path in tmp_path.iterdir()} == {"report", "scratch"}


def test_more_cases_than_in_memory_give_the_same_report(
    undisturbed: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beyond them particles, records and pictures are made or read again, and the store is trimmed."""
    monkeypatch.setattr(campaign, "KEPT", 1)
    trimmed = list[Path]()
    monkeypatch.setattr(Store, "trim", lambda store: trimmed.append(store.folder))
    interrupted(CASES, tmp_path / "report", 3)
    run(CASES, tmp_path / "report", resume=True, store=Store(tmp_path / "store"))
    assert report(tmp_path / "report", tmp_path / "scratch") == undisturbed and trimmed


def test_loss_of_a_case_from_the_journal_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Forgets(Progress):
        def advance(self, done: int, total: int | None, label: str, complaint: str = "") -> None:
            if done == total:  # remove the entry of the last case when it is judged
                (folders.making(out) / "journal" / "cases" / f"{label}.json").unlink()

    out = tmp_path / "report"
    monkeypatch.setattr(campaign, "KEPT", 1)
    with pytest.raises(InputError, match="lost 1 judged case during"):
        campaign.run_cases(CASES[:3], Engine(), 2, out, progress=Forgets())
    assert not out.exists()


def test_earlier_report_stays_until_the_run_is_complete(tmp_path: Path) -> None:
    out = tmp_path / "report"
    assert len(run(CASES[:1], out, resume=True)) == 1, "without an interrupted run it begins one"
    before = contents(out)
    interrupted(CASES[:3], out, 2)
    assert before == contents(out)
    run(CASES[:3], out, resume=True)
    assert len(read_run(out).cases) == 3


def _cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-9])


def test_damaged_cases_are_judged_again(partial: Path, undisturbed: dict[str, bytes], tmp_path: Path) -> None:
    entries, fields = partial / "journal" / "cases", partial / "fields"
    hurt = [case.case for case in read_run(partial).cases if case.fields][:4]
    _cut(entries / f"{hurt[0]}.json")
    (entries / f"{hurt[1]}.json").unlink()
    _cut(fields / f"{hurt[2]}.npz")
    (fields / f"{hurt[3]}.npz").unlink()
    for name in (f"fields/.{hurt[0]}.npz.abcdefgh", ".report.html.abcdefgh"):
        (partial / name).write_text("half")
    assert set(hurt) <= set(run(CASES, tmp_path / "report", resume=True))
    assert report(tmp_path / "report", tmp_path / "scratch") == undisturbed


def test_unknown_journal_is_discarded(partial: Path, tmp_path: Path) -> None:
    _cut(partial / "journal" / "run.json")
    assert len(run(CASES[:3], tmp_path / "report", resume=True)) == 3


def test_killed_run_is_resumed_from_its_partial_folder(partial: Path, tmp_path: Path) -> None:
    partial.rename(folders.making(tmp_path / "report"))
    assert len(run(CASES, tmp_path / "report", resume=True)) <= COUNT - 5


def test_another_run_is_refused_in_one_line(partial: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:

    def other(*arguments: Any) -> EngineRecord:
        return provenance.engine_record(*arguments).model_copy(update={"library_sha256": 64 * "0"})

    before = contents(partial)
    changed = [replace(CASES[0], about="another"), *CASES[1:]]
    for text, cases, options in (
        (rf"the cases of .*: 1 case changed \({CASES[0].name}\)", changed, {}),
        ("the --shard of .*, none, found '1/2'", CASES, {"part": ("1/2", "")}),
        ("the engine of the interrupted run, ", CASES, {}),
    ):
        if "engine" in text:
            monkeypatch.setattr(campaign, "engine_record", other)
        with pytest.raises(InputError, match=rf"^--resume: needs {text}.*report.*$"):
            run(cases, tmp_path / "report", resume=True, **options)
    assert before == contents(partial), "nothing is lost"


def test_part_of_a_run_is_neither_accepted_nor_merged(stopped: Path, tmp_path: Path) -> None:
    for use in (lambda: merge([stopped], tmp_path / "m"), lambda: accept(stopped, "why", tmp_path / "a")):
        with pytest.raises(InputError, match="run: must be whole, not interrupted"):
            use()


def test_run_kept_by_date_is_found_by_resume(
    eos_ref_command: Callable[..., Outcome], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr("lammps_cases.cli.run.Bar", lambda **_: Interrupts(1))
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
