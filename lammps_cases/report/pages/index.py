"""The index of the reports: the pages below a folder, in one page, and the navigation bar that they share.

Pages describe themselves in their head, so that the index reads no record. The bar is written into
existing pages when another is added, between two comments: a page is one file, and cannot look for its neighbours.
"""

from __future__ import annotations

import os
import re
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape, unescape
from pathlib import Path

from eos_ref.errors import InputError
from lammps_cases.records import folders
from lammps_cases.records.files import replace_file
from lammps_cases.report.pages import frame

NAME = "index.html"
DEPTH = 4  # of the pages: compare/A/report.html has three names
LEFT_OUT = {"site", "accepted", "fields", "figures", "decks"}
HEAD = 4096  # bytes that hold the description of a page
BEGINNING = 2**17  # bytes that hold the bar of most pages, which may have many millions
BAR = re.compile(rb"(?<=<!--bar-->).*?(?=<!--/bar-->)", re.DOTALL)
DESCRIBED = re.compile(r'<meta name="eos-ref"([^>]*)>')
SAYS = re.compile(r'data-([a-z]+)="([^"]*)"')


@dataclass(frozen=True)
class Kind:
    """Pages of a command: their name in the bar, their heading in the index, the text of the section about them."""

    command: str
    label: str
    heading: str
    about: str


KINDS = (
    Kind("report", "Run", "Runs", "Every case, or some, against the reference."),
    Kind("audit", "Audit", "Audits of decks", "Your decks, run unmodified and checked while they run."),
    Kind("examples", "Examples", "LAMMPS' examples", "LAMMPS' own decks, judged and analysed."),
    Kind("claims", "Claims", "Claims of the manual", "Whether each statement of the manual holds."),
    Kind("compare", "Versions", "Versions compared", "What changed from one LAMMPS to another."),
    Kind("history", "History", "History", "Verdicts, errors and times from version to version."),
    Kind(
        "adopt", "New LAMMPS", "LAMMPS versions registered", "Which findings persist, disappear or appear on a LAMMPS."
    ),
    Kind("stability", "Stability", "Stability", "Where methods fail."),
    Kind("chart", "Chart", "Chart", "Speed against accuracy."),
    Kind("validate", "Validation", "Validation", "Flows with experiments, tables and solutions."),
    Kind("inputs", "Inputs", "Bad input", "How LAMMPS and the reference handle it."),
)
# Files that are not our pages, by pattern, with their names in the index.
FILES = (
    ("site/index.html", "documentation"),
    ("bug-*/issue.md", "bug report"),
    ("bisect/bisect.json", "bisection"),
    ("bench.jsonl", "benchmarks"),
    ("shrunk/*.yaml", "case made small"),
)


@dataclass(frozen=True)
class Page:
    """A page below the folder of the reports: its relative path, and the content of its head."""

    path: Path
    command: str
    status: str
    engine: str
    date: str
    state: str
    title: str
    sentence: str = ""  # the title without the state; missing in pages of earlier versions
    whole: bool = False

    @property
    def name(self) -> str:
        """Return the name of its row in the index: for reports kept by date the row shows the rest."""
        folder = self.path.parent.as_posix()
        if not folders.is_entry(self.path.parent):
            return folder
        return f"{'all' if self.whole else 'some'} {'claims' if folder.startswith('claims') else 'cases'}"


def refresh(reports: Path, since: int = 0) -> None:
    """Write the index of a folder, and the bar of each of its pages, if a page or file is not older than a given time.

    Parameters
    ----------
    reports : Path
        The folder; if it holds no page of ours, nothing is written.
    since : int
        The time in nanoseconds.
    """
    if not reports.is_dir() or not any(_written(path) >= since for path in (*_paths(reports), *_files(reports))):
        return
    try:
        with folders.exclusive(reports / NAME, "index"):
            pages = list(_pages(reports))
            replace_file(reports / NAME, _render(pages, reports))
            of_kind = _newest(pages, reports)
            for page in (*pages, Page(Path(NAME), "index", "", "", "", "", "")):
                _fill(reports, page, of_kind)
    except (InputError, OSError):  # a failed index must not affect the report
        return


def _render(pages: Sequence[Page], reports: Path) -> str:
    """Return the page."""
    latest = folders.whole_runs(reports).link.resolve()
    last = next((page for page in pages if (reports / page.path).resolve().parent == latest), None)
    holding = {page.path.parent for page in pages}
    shown = [page for page in pages if holding.isdisjoint(page.path.parent.parents)]  # others are a page's own runs
    sections = [(kind, [page for page in shown if page.command == kind.command]) for kind in KINDS]
    present = [(kind, group) for kind, group in sections if group]
    return frame.page(
        frame.SHARED,
        "index",
        last.status if last else "",
        last=last,
        contents=[(kind.command, f"{kind.heading} ({len(group)})") for kind, group in present],
        sections=present,
        files=[(name, path.relative_to(reports)) for path, name in _files(reports).items()],
        shown=lambda page: page.date[:16].replace("T", " "),
    )


def _paths(reports: Path) -> Iterator[Path]:
    """Yield the HTML files, except those reached by a link, hidden ones and the index."""
    for folder, below, names in os.walk(reports):
        path = Path(folder)
        deep = len(path.relative_to(reports).parts) + 1
        below[:] = [name for name in sorted(below) if deep < DEPTH and name not in LEFT_OUT and name[0] != "."]
        yield from (path / name for name in names if name.endswith(".html") and name[0] != "." and name != NAME)


def _files(reports: Path) -> dict[Path, str]:
    """Return the files that are not our pages, with their names."""
    return {path: name for pattern, name in FILES for path in sorted(reports.glob(pattern))}


def _written(path: Path) -> int:
    """Return when a file was written, in nanoseconds; the distant past if it no longer exists."""
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return -1


def _pages(reports: Path) -> Iterator[Page]:
    """Read the heads of the pages, whole runs and the newest first."""
    whole = {*folders.whole_runs(reports).entries(), *folders.whole_claims(reports).entries()}
    pages = []
    for path in _paths(reports):
        try:
            with path.open("rb") as file:
                head = file.read(HEAD).decode("utf-8", "replace")
        except OSError:
            continue
        described = DESCRIBED.search(head)
        if described is None:
            continue
        says = {name: unescape(value) for name, value in SAYS.findall(described[1])}
        place = path.relative_to(reports)
        if says["command"] == "report" and place.parts[0].startswith("audit-"):
            says["command"] = "audit"
        says["date"] = says["date"] or time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(_written(path) / 1e9))
        pages.append(Page(place, **says, whole=path.parent in whole or path.name == "history.html"))
    yield from sorted(sorted(pages, key=lambda page: page.path), key=_order, reverse=True)


def _order(page: Page) -> tuple[bool, tuple[str, int]]:
    """Return the sort key of pages, the last first: whole reports, then when they were begun, or made."""
    made = page.date[:19].replace("T", "_").replace(":", ".")
    return page.whole, folders.begun(page.path.parent) if folders.is_entry(page.path.parent) else (made, 0)


def _newest(pages: Sequence[Page], reports: Path) -> list[tuple[str, str, Path]]:
    """Return the links of the bar: command, label and path; for whole runs and claims the target of ``latest``."""
    links = {"report": folders.whole_runs(reports).link, "claims": folders.whole_claims(reports).link}
    of_kind = []
    for kind in KINDS:
        first = next((page for page in pages if page.command == kind.command), None)
        if first is not None:
            latest = links.get(kind.command) if first.whole else None
            link = latest.relative_to(reports) / first.path.name if latest else first.path
            of_kind.append((kind.command, kind.label, link))
    site = reports / FILES[0][0]
    return [*of_kind, *([("site", "Documentation", site.relative_to(reports))] if site.is_file() else [])]


def _fill(reports: Path, page: Page, of_kind: Sequence[tuple[str, str, Path]]) -> None:
    """Write the bar of a page, unless it is present; its time and everything else in it stay."""
    bar = ""
    for command, label, link in [("index", "eos-ref", Path(NAME)), *of_kind]:
        here = ' aria-current="page"' if command == page.command else ""
        bar += f'\n<a href="{escape(Path(os.path.relpath(link, page.path.parent)).as_posix())}"{here}>{label}</a>'
    path = reports / page.path
    try:
        with path.open("rb") as file:
            found = BAR.search(file.read(BEGINNING))
        if found and found[0] == bar.encode():
            return
        before, written = path.read_bytes(), path.stat()
        after = BAR.sub(lambda _: bar.encode(), before, count=1)
        if after != before:
            replace_file(path, after)
            os.utime(path, ns=(written.st_atime_ns, written.st_mtime_ns))
    except OSError:  # being replaced by a command that fills the bar
        return
