"""Views of a history: the line of the terminal, the page, the part of a run's report."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from html.parser import HTMLParser
from pathlib import Path

import pytest

from lammps_cases.records.run_record import RunRecord
from lammps_cases.report import history as kept
from lammps_cases.report.formats import write_report
from lammps_cases.report.history import TABLE, Past, page, runs_before, store, views
from lammps_cases.report.history.store import History
from lammps_cases.report.history.views import RunMark, Spread, engines
from lammps_cases.report.pages import frame
from tests.support import made_runs
from tests.support.pages import unpacked

HOSTILE = "<img src=x onerror=alert(1)> & \"'"


@pytest.mark.parametrize(
    ("values", "line"),
    [
        ([], ""),
        ([1.0], "▁"),
        ([1.0, 2.0, 3.0], "▁▅█"),
        ([None, math.nan, math.inf, 2.0], "·××▁"),
        ([2.0, 2.0], "▁▁"),
    ],
)
def test_a_line_of_bars(values: list[float | None], line: str) -> None:
    assert views.spark(values) == line


def test_a_line_of_bars_on_a_log_axis() -> None:
    assert views.spark([0.0, 1e-4, 1.0, 1e3, 1e4, 1e11], logarithmic=True) == "▁▁▃▄▅█"


SVG = "{http://www.w3.org/2000/svg}"


def _marks(svg: str) -> list[tuple[str, float]]:
    """Class and height of every mark."""
    groups = [part for part in ET.fromstring(svg).iter(f"{SVG}g") if part.get("class")]
    return [(group.attrib["class"], float(next(group.iter(f"{SVG}use")).attrib["y"])) for group in groups]


HALF_UNIT = 0.5e-6  # of the last digit of a height


def _path(svg: str, name: str) -> list[float]:
    """Heights of the ends of a line."""
    [group] = [part for part in ET.fromstring(svg).iter(f"{SVG}g") if part.get("id", "").endswith(name)]
    return [float(y) for _, y in re.findall(r"[ML] ([\d.]+) ([\d.]+)", next(group.iter(f"{SVG}path")).attrib["d"])]


def test_errors_are_drawn_by_decade_with_the_bound_as_a_line() -> None:
    ratios = [
        ("exact", 0.0),
        ("pass", 0.1),
        ("pass", 1.0),
        ("explained", 1e9),
        ("differs", math.inf),
        ("error", math.nan),
    ]
    svg = page.error_figure([RunMark("1.0", "", kind, ratio, "says") for kind, ratio in ratios], "one")
    found = _marks(svg)
    assert [kind for kind, _ in found] == [f"v-{kind}" for kind, _ in ratios]
    exact, inside, at, beyond, infinite, nan = (y for _, y in found)
    assert exact > inside > at > beyond > infinite == nan
    assert _path(svg, "limit") == [at, at]
    assert 9 * (inside - at) == pytest.approx(at - beyond, rel=0, abs=(9 * 2 + 2) * HALF_UNIT)


def test_times_show_median_and_range() -> None:
    svg = page.time_figure({"1.0": Spread(2.0, 1.0, 4.0, 3), "2.0": Spread(4.0, 4.0, 4.0, 1)}, "one")
    (_, median), (_, other) = _marks(svg)
    low, high = _path(svg, "range-0")
    assert low > median > high == other
    assert 2 * (low - median) == pytest.approx(median - high, rel=0, abs=(2 * 2 + 2) * HALF_UNIT)
    assert "2 s, 1 to 4 s in 3 runs" in svg


def test_text_is_never_markup() -> None:
    for svg in (
        page.error_figure([RunMark(HOSTILE, HOSTILE, "pass", 1.0, HOSTILE)], "one"),
        page.time_figure({HOSTILE: Spread(1.0, 1.0, 1.0, 1)}, "one"),
    ):
        assert "<img" not in svg
        assert HOSTILE in "".join(ET.fromstring(svg).itertext())


class _Parsed(HTMLParser):
    """Elements that are open at the end, ids, links within the page, and all tags."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.links: list[str] = []
        self.tags: list[str] = []
        self.feed(html)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.tags.append(tag)
        self.ids += [given["id"] or ""] if "id" in given else []
        self.links += [given["href"] or ""] if tag == "a" and "href" in given else []
        if tag not in ("meta", "input", "br"):
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


@pytest.fixture
def history(tmp_path: Path) -> History:
    case = made_runs.case
    with History(tmp_path / "h.sqlite") as history:
        history.add(made_runs.run("1.0", "2026-11-01", [case("one"), case("two", digest="b")]))
        history.add(
            made_runs.run("2.0", "2026-11-02", [case("one"), case("two", "explained", 1e9, "c", finding="heat")])
        )
        history.add(made_runs.run("2.0", "2026-11-03", [case("one"), case("two", "differs", math.nan, "d")]))
    return history


def _page(history: History, folder: Path, pictured: bool) -> str:
    with history:
        runs = history.runs()
        lines = views.run_lines(history, runs, runs)
        found = views.case_views(history, runs, history.cases())
        labels = [line.label for line in engines(runs)]
    return page.write(folder, lines, found, labels, pictured).read_text()


@pytest.mark.parametrize("pictured", [True, False])
def test_page_is_well_formed_and_reproducible(history: History, tmp_path: Path, pictured: bool) -> None:
    html = _page(history, tmp_path / "out", pictured)
    parsed = _Parsed(html)
    assert parsed.open == []
    assert len(set(parsed.ids)) == len(parsed.ids)
    styled = re.findall(r"#([a-z-]+)[ ,{]", (frame.SHARED / "page.css").read_text())
    assert set(parsed.ids) & set(styled) == set(), "the look of another page's part"
    assert {link.removeprefix("#") for link in parsed.links} <= set(parsed.ids)
    assert parsed.tags.count("svg") == (4 if pictured else 0)
    assert "script" not in parsed.tags
    assert "http" not in re.sub(r'http-equiv|xmlns(:xlink)?="[^"]*"', "", html)
    assert html == _page(history, tmp_path / "again", pictured)


def test_page_lists_changes(history: History, tmp_path: Path) -> None:
    text = re.sub(r"\s+", " ", re.sub(r"<[^>]+>", "", _page(history, tmp_path, pictured=False)))
    assert "1.0 to 2.0: 1 case (verdict of 1, bits of 1)" in text
    assert "pass to differs" in text
    assert "Cases that changed (1 of 2)" in text
    assert "1.0: other verdict in 1, other bits in 1, other finding in 1" in text  # the run of the second day


def test_page_of_identical_runs_lists_no_changes(tmp_path: Path) -> None:
    with History(tmp_path / "alike.sqlite") as history:
        for day in (1, 2):
            history.add(made_runs.run("1.0", f"2026-11-0{day}", [made_runs.case("one")]))
    html = _page(history, tmp_path, pictured=False)
    assert "Cases that changed (0 of 1)" in html and "None changed from one engine to another." in html
    assert "Last verdict on every engine" not in html


def _past(history: History, record: RunRecord) -> Past:
    with history:
        found = runs_before(history, record)
    assert found is not None
    return found


def test_a_report_knows_the_runs_before_it(history: History) -> None:
    own = made_runs.run("1.5", "2026-11-04", [made_runs.case("two", "pass", 0.5)])
    past = _past(history, own)
    assert [(line.label, line.own) for line in past.runs] == [
        ("1.5", True),
        ("2.0", False),
        ("2.0", False),
        ("1.0", False),
    ]
    told = [(m.label, m.under, m.kind) for m in past.marks["two"]]
    assert told == [
        ("1.0", "2026-11-01", "pass"),
        ("1.5", "this run", "pass"),
        ("2.0", "2026-11-02", "explained"),
        ("2.0", "2026-11-03", "differs"),
    ]
    assert set(past.marks) == {"two"}


def test_report_is_unaffected_by_its_own_and_later_runs(history: History) -> None:
    own = made_runs.run("1.5", "2026-11-02", [made_runs.case("two")])
    past = _past(history, own)
    assert [line.run.date[-1] for line in past.runs] == ["2", "2", "1"]
    with history:
        history.add(own)
        history.add(made_runs.run("3.0", "2026-11-05"))
    assert _past(history, own) == past


def test_the_table_of_a_report_is_short(history: History) -> None:
    with history:
        for k in range(30):
            history.add(made_runs.run("2.0", f"2026-11-{k + 1:02d}T12", seconds=float(k)))
    assert len(_past(history, made_runs.run("2.0", "2026-12-01")).runs) == TABLE


def test_report_with_and_without_history(history: History, tmp_path: Path) -> None:
    own = made_runs.run("1.5", "2026-11-04", [made_runs.case("two", "pass", 0.5), made_runs.case("new")])
    plain = unpacked(write_report(own, tmp_path).read_text())
    assert "#history" not in plain
    assert "By version: " not in plain
    past = _past(history, own)
    html = unpacked(write_report(own, tmp_path, history=past).read_text())
    parsed = _Parsed(html)
    assert parsed.open == []
    assert "history" in parsed.ids
    assert "#history" in parsed.links
    assert html.count("By version: ") == 1  # of the case that earlier runs had too
    assert html == unpacked(write_report(own, tmp_path, history=past).read_text())


def test_empty_history_is_left_out_of_a_report(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(store.VARIABLE, str(tmp_path / "h.sqlite"))
    own = made_runs.run()
    assert kept.past(own) is None
    kept.collect(own)
    assert kept.past(own) is None  # only the run itself
