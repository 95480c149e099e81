"""The index of the reports, and the bar of every page: links, states, omissions, and when it is written."""

from __future__ import annotations

import os
import re
import shutil
import time
from collections.abc import Callable
from html import unescape
from pathlib import Path

import pytest

from lammps_cases.records import folders
from lammps_cases.records.run_record import EngineRecord, RunRecord
from lammps_cases.report.history import page as history_page
from lammps_cases.report.pages import index
from lammps_cases.run.report_files import write_run
from lammps_cases.versions.inputs import table
from lammps_cases.versions.inputs.table import InputTable
from tests.support.outcome import Outcome


def a_run(folder: Path, date: str = "2026-01-31T12:00:00Z", distribution: str = "1.0") -> None:
    """A report of a run without cases: EMPTY."""
    write_run(RunRecord(engine=EngineRecord(name="env", distribution=distribution), reference={}, date=date), folder)


def links(path: Path) -> list[str]:
    """Return the links of the bar of a page, verbatim."""
    (bar,) = re.findall(r"<!--bar-->(.*?)<!--/bar-->", path.read_text(encoding="utf-8"), re.DOTALL)
    return [unescape(link) for link in re.findall(r'href="([^"]+)"', bar)]


def labels(path: Path) -> list[str]:
    (bar,) = re.findall(r"<!--bar-->(.*?)<!--/bar-->", path.read_text(encoding="utf-8"), re.DOTALL)
    return re.findall(r">([^<]+)</a>", bar)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make two whole runs, a part, an audit, a table of bad input, a bug report, and an unfinished run."""
    reports = tmp_path_factory.mktemp("written") / "reports"
    for distribution in ("1.0", "2.0"):
        with folders.whole_runs(reports).place(f"pypi:{distribution}") as folder:
            a_run(folder, distribution=distribution)
    with folders.parts_of_runs(reports).place("env") as folder:
        a_run(folder, "2026-02-01T12:00:00Z", "3.0")
    a_run(reports / "audit-in.mine")
    a_run(reports / ".2026-01-31_12.00.00_9.partial", distribution="9.0")
    (reports / "inputs").mkdir()
    table.write(InputTable("", {"distribution": "1.0"}, 1.0, ()), reports / "inputs")
    (reports / "bug-of-mine").mkdir()
    (reports / "bug-of-mine" / "issue.md").write_text("# bug")
    index.refresh(reports)
    return reports


@pytest.fixture
def reports(written: Path, tmp_path: Path) -> Path:
    """A copy of them, to change."""
    return Path(shutil.copytree(written, tmp_path / "reports", symlinks=True))


def test_every_link_leads_to_a_file_from_the_page_and_through_latest(reports: Path) -> None:
    html = (reports / "index.html").read_text(encoding="utf-8")
    listed = [unescape(link) for link in re.findall(r'href="([^"#]+)"', html)]
    assert {"inputs/report.html", "audit-in.mine/report.html", "bug-of-mine/issue.md"} <= set(listed)
    assert all((reports / link).is_file() for link in listed)
    pages = [*reports.glob("2*/report.html"), *reports.glob("*/latest/report.html"), reports / "latest" / "report.html"]
    pages += [reports / "inputs" / "report.html", reports / "audit-in.mine" / "report.html", reports / "index.html"]
    assert len(pages) == 7
    for page in pages:
        assert labels(page) == ["eos-ref", "Run", "Audit", "Inputs"], page
        # A browser resolves .. against the name of the page, not against the target of a link.
        leads = [Path(os.path.normpath(page.parent / link)) for link in links(page)]
        assert leads[0] == reports / "index.html" and all(link.is_file() for link in leads), page
    assert links(reports / "inputs" / "report.html")[1] == "../latest/report.html"


def test_the_headline_is_that_of_the_last_whole_run(reports: Path) -> None:
    html = (reports / "index.html").read_text(encoding="utf-8")
    head, _, runs = html[html.index("<header") : html.index('id="audit"')].partition("</header>")
    assert 'class="stamp">EMPTY</span> nothing was compared' in head and "LAMMPS <b>2.0</b>" in head
    assert re.findall(r"<td>(\d\.0)</td>", runs) == ["2.0", "1.0", "3.0"], "whole ones first, the newest first"
    assert re.findall(r">(all|some) cases</a></th>", runs) == ["all", "all", "some"]
    shown = re.sub("<[^>]*>", " ", html)  # addresses hold the time of day, which may be 19.09
    assert "9.0" not in shown and "2026-02-01 12:00" in runs
    assert "how LAMMPS handles bad input" in html


def test_new_page_is_added_to_all_bars_and_changes_nothing_else(reports: Path) -> None:
    page = reports / "latest" / "report.html"
    before, written = page.read_text(encoding="utf-8"), page.stat().st_mtime_ns
    index.refresh(reports)
    assert page.read_text(encoding="utf-8") == before, "nothing is new"
    history_page.write(reports / "history", [], [], [], pictured=False)
    index.refresh(reports)
    after = page.read_text(encoding="utf-8")
    assert labels(page) == ["eos-ref", "Run", "Audit", "History", "Inputs"]
    assert len(after) - len(before) == len('\n<a href="../history/history.html">History</a>')
    assert page.stat().st_mtime_ns == written
    history_page.write(reports / "history", [], [], [], pictured=True)
    index.refresh(reports)
    assert 'href="../history/history.html"' in page.read_text(encoding="utf-8"), "not the page of some cases"


def test_index_is_written_only_after_a_page(reports: Path, tmp_path: Path) -> None:
    (reports / "index.html").unlink()
    index.refresh(reports, time.time_ns())
    assert not (reports / "index.html").exists()
    empty = tmp_path / "none"
    (empty / "site").mkdir(parents=True)
    (empty / "site" / "page.html").write_text("<html>no page of ours</html>")
    index.refresh(empty)
    index.refresh(tmp_path / "gone")
    assert not (empty / "index.html").exists() and not (tmp_path / "gone").exists()


@pytest.mark.lammps
def test_commands_update_the_index(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, eos_ref_command: Callable[..., Outcome]
) -> None:
    monkeypatch.chdir(tmp_path)
    eos_ref_command("run", "near-rho0.linear.2d", "--out", "elsewhere")
    assert not Path("reports").exists() and labels(Path("elsewhere/report.html")) == []
    eos_ref_command("run", "near-rho0.linear.2d")
    html = Path("reports/index.html").read_text(encoding="utf-8")
    assert "No run of all cases" in html and ">PASS</span> no difference" in html
    eos_ref_command("claims", "pressure-linear", "--run", "elsewhere")
    assert labels(Path("reports/parts/latest/report.html")) == ["eos-ref", "Run", "Claims"]
    Path("reports/index.html").write_text("old")
    eos_ref_command("list")
    assert Path("reports/index.html").read_text() == "old", "a command that writes no report"


def test_reports_are_sorted_by_second_then_by_name(tmp_path: Path) -> None:
    for name, second in (("b", 20), ("c", 50), ("a", 20), ("d", 5)):
        a_run(tmp_path / name, f"2026-01-31T12:00:{second:02}Z")
    index.refresh(tmp_path)
    listed = re.findall(r'<th scope="row"><a href="([^"/]+)/', (tmp_path / index.NAME).read_text(encoding="utf-8"))
    assert listed == ["c", "a", "b", "d"]
