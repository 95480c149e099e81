"""Every page: its policy, its packed parts and pictures, no text becomes markup; the index and the bar."""

from __future__ import annotations

import base64
import dis
import hashlib
import os
import re
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from html import unescape
from pathlib import Path
from typing import Any

import jinja2
import jinja2.meta
import pytest
from matplotlib.figure import Figure
from syrupy.assertion import SnapshotAssertion

import lammps_cases
from lammps_cases.records import folders
from lammps_cases.records.run_record import EngineRecord, RunRecord
from lammps_cases.report.history import page as history_page
from lammps_cases.report.pages import figures, frame, index
from lammps_cases.run.report_files import write_run
from lammps_cases.versions.inputs import table
from lammps_cases.versions.inputs.table import InputTable
from tests.support.outcome import Outcome
from tests.support.pages import Page, text_of, unpacked

TEMPLATES = sorted(Path(lammps_cases.__file__).parent.rglob("*.html.j2"))
PAGES = [path for path in TEMPLATES if '{% extends "frame.html.j2" %}' in path.read_text(encoding="utf-8")]
HOSTILE = (
    "</script></style></title>\" onload=evil() '><script>evil()</script><img src=x onerror=evil()> javascript:evil()"
)
DEPTH = 6


class Anything(str):
    """A text that has every attribute, member and result, each such a text; its loops end."""

    depth = 0

    def __new__(cls, depth: int = 0) -> Anything:
        made = super().__new__(cls, HOSTILE)
        made.depth = depth
        return made

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return OfCode() if name == "data" else Anything(self.depth)

    def __getitem__(self, key: object) -> Any:
        return Anything(self.depth)

    def __call__(self, *arguments: object, **named: object) -> Any:
        return Anything(self.depth)

    def __iter__(self) -> Iterator[Any]:
        caller = sys._getframe(1)
        code, at = caller.f_code.co_code, caller.f_lasti
        if dis.opname[code[at]] == "UNPACK_SEQUENCE":  # as many as the targets of the unpacking
            return iter([Anything(self.depth + 1)] * code[at + 1])
        return iter([Anything(self.depth + 1)] * 2 if self.depth < DEPTH else [])

    def _same(self, *others: object) -> Any:
        return self

    __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __truediv__ = __mod__ = __rmod__ = _same

    def _less(self, other: object) -> bool:
        return False

    __lt__ = __gt__ = __le__ = __ge__ = _less

    def items(self) -> list[tuple[Any, Any]]:
        return [(Anything(self.depth + 1), Anything(self.depth + 1))] if self.depth < DEPTH else []

    # Methods of texts whose names our own models have as well.
    values = title = count = index = format = property(lambda self: Anything(self.depth))


class OfCode(dict[str, Any]):
    """The ``data-`` attributes of a row, whose names are written in the code."""

    def __init__(self) -> None:
        super().__init__(key=Anything())


def test_all_pages_are_known() -> None:
    names = {path.name.partition(".")[0] for path in PAGES}
    assert names >= {"report", "compare", "history", "claims", "study", "inputs", "index"}


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_no_text_is_markup(path: Path) -> None:
    environment = frame.environment_of(path.parent)
    environment.bytecode_cache = None  # templates compiled with other filters must not be cached
    parts = [part.read_text(encoding="utf-8") for part in TEMPLATES if part.parent in (path.parent, frame.SHARED)]
    for name in environment.filters.keys() | {name for part in parts for name in re.findall(r"\|\s*(\w+)", part)}:
        if name not in ("packed", "safe", "escape", "e"):
            environment.filters[name] = lambda value, *rest, **named: value if isinstance(value, str) else Anything()
    names = {name for part in parts for name in jinja2.meta.find_undeclared_variables(environment.parse(part))}
    given = {"scripts": [], "css": "", "policy": frame.policy([])}
    page = unpacked(environment.get_template(path.name).render(dict.fromkeys(names, Anything()) | given))
    assert "evil" in page
    found = Page(page)
    for tag, attributes in found.elements:
        assert attributes.get("src") != "x", (tag, attributes)
        assert not any(name.startswith("on") for name in attributes), (tag, attributes)
        assert tag != "script" or attributes.get("type") in ("text/plain", "application/json"), attributes


def test_only_the_policy_is_marked_safe() -> None:
    """Markup is made in a few places of the code, which escape their arguments."""
    named = re.compile(r"(\w+)\s*\|\s*safe")  # not the texts of a template
    assert [(path.name, name) for path in TEMPLATES for name in named.findall(path.read_text(encoding="utf-8"))] == [
        ("frame.html.j2", "policy")
    ]


def test_policy_names_the_scripts_of_a_page(tmp_path: Path) -> None:
    (tmp_path / "made.html.j2").write_text('{% extends "frame.html.j2" %}{% block main %}{{ text }}{% endblock %}')
    (tmp_path / "made.js").write_text("const a = '<b>';\n")
    page = frame.page(tmp_path, "made", unpacked=["later"], text=HOSTILE)
    found = Page(page)
    policies = [a["content"] for _, a in found.elements if a.get("http-equiv") == "Content-Security-Policy"]
    (policy,) = policies
    hashes = [
        base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        for text in (*(text for *_, text in found.scripts), "later")
    ]
    assert len(hashes) == 2 and policy is not None
    (scripts,) = [part for part in policy.split("; ") if part.startswith("script-src ")]
    assert scripts == " ".join(["script-src", *(f"'sha256-{each}'" for each in hashes)])
    assert "default-src 'none'" in policy and "base-uri 'none'" in policy and "evil" in page
    assert "script-src 'none'" in frame.policy([])


FOLDS = "claims"  # a table whose rows become blocks on a narrow screen, by its own style sheet


@pytest.mark.parametrize("path", TEMPLATES, ids=lambda path: path.name)
def test_wide_tables_scroll_and_not_the_page(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    for found in re.finditer(r'<table(?: class="([^"]*)")?', text):
        before = text[: found.start()].rstrip().rpartition("\n")[2]
        assert found[1] == FOLDS or 'class="scroll' in before, found[0]


# --- parts that are packed

TEXT = "const a = 'ü';\n" * 100


@pytest.mark.parametrize(
    "damage",
    [b"", b"\xff", b"!", frame.packed(TEXT.upper()).encode(), None],
    ids=["empty", "no text", "no hash", "of an earlier version", "another"],
)
def test_stale_cache_is_rebuilt(damage: bytes | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frame, "cache_folder", lambda _: tmp_path)
    assert frame.packed_once(TEXT) == frame.packed(TEXT)
    (kept,) = tmp_path.iterdir()
    right = kept.read_bytes()
    if damage is None:
        frame.packed_once(TEXT.upper())
        (other,) = {*tmp_path.iterdir()} - {kept}
        damage = other.read_bytes()
    kept.write_bytes(damage)
    assert frame.packed_once(TEXT) == frame.packed(TEXT)
    assert kept.read_bytes() == right


def test_cached_text_is_not_packed_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frame, "cache_folder", lambda _: tmp_path)
    made = frame.packed_once(TEXT)
    monkeypatch.delattr(frame, "packed")
    assert frame.packed_once(TEXT) == made


# --- pictures


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.002, "0.002"), (20000.0, "20000"), (1e5, "$10^{5}$"), (2e6, r"$2\cdot10^{6}$"), (1e-10, "$10^{-10}$")],
)
def test_numbers_of_many_digits_are_powers_of_ten(value: float, text: str) -> None:
    assert figures._plain(value) == text


def test_inline_svg_follows_dark_mode(tmp_path: Path) -> None:
    figure = Figure()
    axes = figure.subplots()
    axes.plot([1, 2], color="#2b3137")
    axes.plot([2, 1], color="#c0392b")
    page = figures.saved(figure, tmp_path, "lines")
    assert not {"#2b3137", "#000000", "#ffffff"} & set(re.findall(r"#[0-9a-f]{6}\b", page))
    assert "#c0392b" in page and "var(--ink)" in page and "var(--paper)" in page
    assert "var(" not in (tmp_path / "lines.svg").read_text(encoding="utf-8")


# --- the index of the reports, and the bar of every page


def a_run(folder: Path, date: str = "2026-01-31T12:00:00Z", distribution: str = "1.0") -> None:
    """A report of a run without cases: EMPTY."""
    write_run(RunRecord(engine=EngineRecord(name="env", distribution=distribution), reference={}, date=date), folder)


def links(path: Path) -> dict[str, str]:
    """The links of the bar of a page, verbatim, by label."""
    (bar,) = re.findall(r"<!--bar-->(.*?)<!--/bar-->", path.read_text(encoding="utf-8"), re.DOTALL)
    return {label: unescape(link) for link, label in re.findall(r'href="([^"]+)"[^>]*>([^<]+)</a>', bar)}


def labels(path: Path) -> list[str]:
    return [*links(path)]


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
        leads = [Path(os.path.normpath(page.parent / link)) for link in links(page).values()]
        assert leads[0] == reports / "index.html" and all(link.is_file() for link in leads), page
    assert links(reports / "inputs" / "report.html")["Run"] == "../latest/report.html"


def test_index_shows_the_headline_of_the_last_whole_run(reports: Path, snapshot: SnapshotAssertion) -> None:
    """Whole ones first, the newest first; neither the unfinished one nor addresses, which hold the time of day."""
    text = text_of((reports / "index.html").read_text(encoding="utf-8"))
    assert re.sub(r"(?m)^(inputs \| 1.0 \|) [-\d]{10} [:\d]{5}", r"\1 NOW", text) == snapshot and "| 9.0" not in text


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


def test_reports_are_sorted_by_second_then_by_name(written: Path, tmp_path: Path) -> None:
    page = (written / "audit-in.mine" / "report.html").read_text(encoding="utf-8")
    for name, second in (("b", 20), ("c", 50), ("a", 20), ("d", 5)):
        (tmp_path / name).mkdir()
        text = page.replace("2026-01-31T12:00:00Z", f"2026-01-31T12:00:{second:02}Z")
        (tmp_path / name / "report.html").write_text(text, encoding="utf-8")
    index.refresh(tmp_path)
    listed = re.findall(r'<th scope="row"><a href="([^"/]+)/', (tmp_path / index.NAME).read_text(encoding="utf-8"))
    assert listed == ["c", "a", "b", "d"]
