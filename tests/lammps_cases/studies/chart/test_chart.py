"""The chart: which methods dominate which, on disk, drawn, its page; measured once on real LAMMPS."""

from __future__ import annotations

import csv
import itertools
import json
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure

from eos_ref import InputError
from eos_ref.methods.laws import METHODS as LAW_METHODS
from lammps_cases.records import measure
from lammps_cases.records.documents import SCHEMAS
from lammps_cases.records.measure import ConfidenceInterval, Timing
from lammps_cases.report.pages.figures import RED
from lammps_cases.studies.chart import collect, laws, page, record
from lammps_cases.studies.chart.codes import SWIRL
from lammps_cases.studies.chart.record import (
    DIGITS,
    Chart,
    Map,
    MethodPanel,
    MethodPoint,
    Section,
    compared,
    frontier,
    point,
)
from lammps_cases.studies.flows.record import LAMMPS, REFERENCE, FlowRecord
from tests.support.outcome import Outcome
from tests.support.roundings import rounded

pytestmark = pytest.mark.slow

Run = Callable[..., Outcome]
ROUNDS = 11


def made_panel() -> MethodPanel:
    timings = {
        "fast": Timing((1e-6, 1.1e-6, 0.9e-6) * 4, 10, 1e-3),
        "exact": Timing((5e-6, 5.1e-6, 4.9e-6) * 4, 10, 1e-3),
        "bad": Timing((9e-6,) * 12, 10, 1e-3),
        "LAMMPS exact": Timing((7e-6,) * 12, 10, 1e-3),
    }
    errors = {"fast": 1e-4, "exact": 1e-15, "bad": math.inf, "LAMMPS exact": 1e-8}
    points = compared([point("q", "near <&> far", m, errors[m], timings[m], 10.0, "why") for m in timings], timings)
    spread = replace(points[0], median=1e-9, p99=1e-6, worst_at="rho = 1.5")
    return MethodPanel("p", "A panel", "About it.", "error of it", "state", (spread, *points[1:]), roofline_ns=20.0)


def made_chart(version: str = "1", **more: Any) -> Chart:
    codes = tuple(
        FlowRecord(SWIRL.name, side, n, n * n, 9, 0.1 * n, "", {}, {"profile": error}, {})
        for side, errors in ((REFERENCE, (4e-2, 1e-2, 2.5e-3)), (LAMMPS, (4e-2, math.nan, 3e-2)))
        for n, error in zip((8, 16, 32), errors, strict=True)
    )
    data = Map(
        "m", "A map", "x", "gamma", (1e-6, 1e-3, 1.0), (1.5, 3.0), ((1e-3, 1e-6, 1e-9), (0.0, 1.0, 2.0)), "error"
    )
    section = Section("flows", "Flows", "About.", 1.0, (made_panel(),), (data,), codes)
    machine: dict[str, str | float | int] = {"processor": "p", "cores": 2, "load": 0.1}
    return replace(Chart("eos-ref chart", machine, {"distribution": version}, True, 2.0, (section,)), **more)


def written(folder: Path, chart: Chart, *more: Any) -> str:
    page.write(chart, folder, *more)
    return (folder / "report.html").read_text()


# --- frontiers


def _points(methods: dict[str, tuple[float, float]]) -> tuple[MethodPoint, ...]:
    """Points of (error, seconds), without scatter of the times."""
    timings = {name: Timing((seconds,) * ROUNDS, 1, seconds) for name, (_, seconds) in methods.items()}
    given = [point("q", "r", name, error, timings[name], 1.0) for name, (error, _) in methods.items()]
    return compared(given, timings)


@settings(deadline=None)
@given(
    st.dictionaries(
        st.text("abcdefgh", min_size=1, max_size=3),
        st.tuples(st.sampled_from([0.0, 1e-16, 1e-12, 1e-8, 1e-3, 1.0, math.inf]), st.floats(0.5, 50.0)),
        min_size=1,
        max_size=8,
    )
)
def test_errors_fall_along_the_frontier(methods: dict[str, tuple[float, float]]) -> None:
    """It is never empty, and errors fall as times grow."""
    best = frontier(_points(methods))
    assert best
    for one, next_ in itertools.pairwise(best):
        assert one.ns.median <= next_.ns.median
        assert next_.error < one.error or one.ns.median == next_.ns.median


@pytest.mark.parametrize(
    ("methods", "best"),
    [
        ({"fast": (1e-3, 1.0), "middle": (1e-8, 2.0), "bad": (1e-6, 3.0), "exact": (0.0, 4.0)}, "fast middle exact"),
        ({"a": (1.0e-16, 2.0), "b": (1.9e-16, 1.0)}, "b"),  # errors within one bit are equal
        ({"a": (1.0e-16, 2.0), "b": (2.1e-16, 1.0)}, "b a"),
    ],
)
def test_frontier_holds_only_undominated_methods(methods: dict[str, tuple[float, float]], best: str) -> None:
    found = _points(methods)
    assert [p.method for p in frontier(found)] == best.split()
    assert {p.method: p.dominated_by for p in found}.get("bad", "middle") == "middle"


def test_indistinguishable_times_are_listed_and_do_not_dominate() -> None:
    seconds = (tuple(1.0 + sign * 0.1 * (-1) ** k for k in range(ROUNDS)) for sign in (1, -1))
    timings = {name: Timing(each, 1, 1.0) for name, each in zip("ab", seconds, strict=True)}
    found = compared([point("q", "r", name, 1e-9, timings[name], 1.0) for name in timings], timings)
    assert [p.like for p in found] == [("b",), ("a",)]
    assert len(frontier(found)) == 2


@pytest.mark.parametrize(
    ("error", "digits"), [(1e-3, 3.0), (0.0, DIGITS), (1e-30, DIGITS), (50.0, 0.0), (math.inf, 0.0), (math.nan, 0.0)]
)
def test_digits_and_times_per_particle_without_compilation(error: float, digits: float) -> None:
    found = point("q", "r", "m", error, Timing((2.0, 2.0, 2.0), 4, 7.0), 1000.0)
    assert found.digits == rounded(digits, 2)
    assert found.ns.median == rounded(2e6, 3)
    assert found.compiling == rounded(5.0, 3)


# --- on disk


def test_chart_round_trips_and_its_tables_hold_every_point_and_error(tmp_path: Path) -> None:
    chart = made_chart()
    record.write(chart, tmp_path)
    again = record.DOCUMENT.read(tmp_path / "chart.json")
    assert again.panels == chart.panels  # infinite errors included
    assert again.sections[0].maps == chart.sections[0].maps
    assert again.sections[0].codes[:3] == chart.sections[0].codes[:3]
    assert math.isnan(again.sections[0].codes[4].errors["profile"])
    assert json.loads((tmp_path / "chart.json").read_text())["schema"] == SCHEMAS["chart"]
    points = list(csv.DictReader((tmp_path / "points.csv").read_text().splitlines()))
    assert [row["method"] for row in points] == ["fast", "exact", "bad", "LAMMPS exact"]
    assert points[3]["dominated_by"] == "exact"
    assert [points[0][name] for name in ("median", "p99", "worst_at")] == ["1e-09", "1e-06", "rho = 1.5"]
    assert [points[1][name] for name in ("median", "p99", "worst_at")] == ["", "", ""]
    rows = list(csv.DictReader((tmp_path / "errors.csv").read_text().splitlines()))
    assert [row["n"] for row in rows if row["side"] == REFERENCE] == ["8", "16", "32"]
    assert float(rows[0]["order"]) == rounded(2.0, 16)
    document = record.points_document(chart)
    json.dumps(document, allow_nan=False)
    assert all({"quantity", "regime", "method", "error", "ns"} <= set(row) for row in document["points"])
    assert next(row for row in document["points"] if row["method"] == "bad")["error"] is None


@pytest.mark.parametrize("content", [None, "", "{}", '{"schema": "other"}', "[1, 2"])
def test_invalid_charts_are_refused_in_one_line(tmp_path: Path, content: str | None) -> None:
    if content is not None:
        (tmp_path / "chart.json").write_text(content)
    with pytest.raises(InputError, match=r"chart\.json|^chart: cannot be read"):
        record.DOCUMENT.read(tmp_path / "chart.json")


# --- pictures and page


def test_page_shows_the_points_and_is_reproducible(tmp_path: Path) -> None:
    html, _ = (written(tmp_path / name, made_chart()) for name in "ab")
    files = sorted(p.relative_to(tmp_path / "a") for p in (tmp_path / "a").rglob("*") if p.is_file())
    assert {str(f) for f in files} == {
        "report.html",
        *(f"figures/{name}.{kind}" for name in ("p", "m", "flows") for kind in ("svg", "png")),
    }
    for file in files:
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes(), file
    assert "near &lt;&amp;&gt; far" in html and "near <&>" not in html
    assert "frontier: fast (4.0 digits, 100 ns), then exact (15.0 digits, 500 ns)" in html
    assert "none right" in html
    assert "Use “exact”: error of at most 1e-15" in html
    assert "<td>rho = 1.5</td>" in html and "median error" in html
    ids = re.findall(r'\bid="([^"]+)"', html)
    assert len(ids) == len(set(ids))
    assert set(re.findall(r'(?:xlink:href="#|url\(#)([^")]+)', html)) <= set(ids)


@pytest.mark.parametrize(("load", "cores", "busy"), [(0.9, 2, False), (1.4, 2, True), (1.0, 1, False), (3.0, 4, False)])
def test_page_warns_of_a_busy_machine(load: float, cores: int, busy: bool, tmp_path: Path) -> None:
    bare = (Section("laws", "", "", 1.0),)
    chart = made_chart(machine={"processor": "p", "cores": cores, "load": load}, sections=bare)
    assert ("Other programs ran" in written(tmp_path, chart)) is busy


def test_drawn_frontier_is_that_of_the_points() -> None:
    panel = made_panel()
    [axis] = [axis for axis in page.panel_figure(panel).axes if axis.get_visible()]
    line = axis.lines[0]
    best = frontier(panel.points)
    assert list(line.get_xdata())[1:-1] == [p.ns.median for p in best]
    assert list(line.get_ydata())[1:-1] == [p.digits for p in best]
    assert panel.roofline_ns in [line.get_xdata()[0] for line in axis.lines]
    fast = panel.points[0]
    assert ([fast.ns.median] * 2, [4.0, 9.0]) in [
        (list(line.get_xdata()), list(line.get_ydata())) for line in axis.lines
    ]


def test_legend_has_every_method_and_lammps_shares_its_shape() -> None:
    names = [f"kernel {k}" for k in range(24)]
    points = [
        MethodPoint("q", "r", prefix + name, 10.0 ** -(k % 9), ConfidenceInterval(k + 1.0, k + 0.9, k + 1.1))
        for k, name in enumerate(names)
        for prefix in ("", "LAMMPS ")
    ]
    figure = page.panel_figure(MethodPanel("p", "t", "a", "e", "u", tuple(points)))
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert texts == ["frontier", *sorted(names), "LAMMPS: same shape, red"]
    marks = page.marks_of(points)
    assert all(marks[f"LAMMPS {name}"] == (RED, marks[name][1]) for name in names)
    assert len({marks[name] for name in names}) == 24


def test_methods_have_one_explanation_and_one_mark_per_section(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    interval = ConfidenceInterval(1.0, 0.9, 1.1)
    named = {"one": "the first way", "two": "the second way", "two again": "the second way", "LAMMPS": "its output"}
    points = [MethodPoint("q", "r", name, 1e-9, interval, reason=reason) for name, reason in named.items()]
    points.append(MethodPoint("q", "r", "LAMMPS two", 1e-9, interval, reason="not listed: that of two"))
    both = [MethodPanel(f"p{k}", "t", "a", "e", "u", tuple(points[k:])) for k in range(2)]
    section = Section("laws", "Laws", "about", 1.0, tuple(both))
    listed = [(["one"], named["one"]), (["two", "two again"], named["two"]), (["LAMMPS"], named["LAMMPS"])]
    assert page.methods(section) == listed
    drawn: list[page.Marks] = []

    def drawing(panel: MethodPanel, others: object, marks: page.Marks) -> Figure:
        drawn.append(marks)
        return Figure()

    monkeypatch.setattr(page, "panel_figure", drawing)
    text = written(tmp_path, made_chart(sections=(section,)))
    assert drawn[0] == drawn[1] and {"one", "two"} <= set(drawn[0])
    assert text.count("<dt>two; two again</dt> <dd>the second way</dd>") == 1 and "not listed:" not in text


def test_other_engine_is_drawn_over_the_first_and_named(tmp_path: Path) -> None:
    def of(ns: float) -> MethodPanel:
        """One method on both sides; LAMMPS takes ``ns``."""
        times = {"plain": 3.0, "LAMMPS": ns}
        points = [MethodPoint("p", "near", m, 1e-9, ConfidenceInterval(t, 0.9 * t, 1.1 * t)) for m, t in times.items()]
        return MethodPanel("p", "P", "about", "of p", "particle", tuple(points))

    alone, both = page.panel_figure(of(9.0)), page.panel_figure(of(9.0), [("2026.7.4", of(5.0))])
    lines = [[tuple(line.get_xdata()) for line in figure.axes[0].lines] for figure in (alone, both)]
    assert lines[1][: len(lines[0])] == lines[0], "the first engine's are where they were"
    added = both.axes[0].lines[len(lines[0]) :]
    assert (5.0,) in [tuple(line.get_xdata()) for line in added]
    assert [line.get_linestyle() for line in added].count("--") == 1
    (legend,) = both.legends
    assert "LAMMPS 2026.7.4\nand its frontier" in [text.get_text() for text in legend.get_texts()]
    first, other = (
        made_chart(version, sections=(Section("laws", "Laws", "about", 1.0, (of(ns),)),))
        for version, ns in (("2025.7.22.4.0", 9.0), ("2026.7.4", 5.0))
    )
    said = "2025.7.22.4.0, and in addition, measured afterwards: 2026.7.4"
    assert [said in written(tmp_path, first, *more) for more in ([[other]], [])] == [True, False]


# --- real LAMMPS

in_turns = measure.in_turns


def briefly(calls: Mapping[str, measure.Call], *_: Any, **__: Any) -> dict[str, Timing]:
    """Times without precision; that of an output without a law is 0, so that no difference is negative."""
    took, bare = in_turns(calls, 2, 0.0), "LAMMPS, no law"
    return took | {bare: Timing((0.0, 0.0), 1, 0.0)} if bare in took else took


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory) -> tuple[Chart, Path]:
    """Three equations of state measured once, in the quick form, with real LAMMPS and few samples."""
    out = tmp_path_factory.mktemp("chart")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(laws, "LAWS", laws.LAWS[:3])
        patch.setattr(laws, "SAMPLES", 512)
        patch.setattr(laws, "QUICK_STATES", 20_000)
        patch.setattr(laws, "in_turns", briefly)
        return collect.collect(("laws",), True, out, "test"), out


@pytest.mark.lammps
def test_chart_has_every_file_and_an_explanation_of_every_method(quick: tuple[Chart, Path]) -> None:
    chart, out = quick
    assert record.DOCUMENT.read(out / "chart.json").panels == chart.panels
    tables = {"chart.json", "sections.jsonl", "points.csv", "errors.csv"}
    assert {p.name for p in out.iterdir()} == {*tables, "report.html", "figures"}
    assert chart.engine["distribution"] and chart.machine["processor"]
    assert all(method.reason for method in LAW_METHODS)
    for section in chart.sections:
        listed = page.methods(section)
        assert len({reason for _, reason in listed}) == len(listed) and all(reason for _, reason in listed)


@pytest.mark.lammps
def test_lammps_has_the_error_of_its_order_of_operations(quick: tuple[Chart, Path]) -> None:
    """The bits are the same, so the worst case is, too, if the search begins and climbs in the same way."""
    panels = {panel.title: panel for panel in quick[0].sections[0].panels}
    for panel in panels.values():
        for regime in panel.regimes:
            errors = {p.method: (p.error, p.median, p.p99, p.worst_at) for p in panel.of(regime)}
            assert errors["LAMMPS"] == errors["in LAMMPS' order"]
            assert all(0 < p.median < p.p99 <= p.error for p in panel.of(regime) if p.median is not None and p.p99)
            assert all(p.worst_at.startswith("rho = ") for p in panel.of(regime))
    water = panels["Pressure of tait/water"]
    near = {p.method: p.digits for p in water.of(water.regimes[0])}
    assert near["LAMMPS"] < 9 < 14 < near["compiled"], "it loses digits near rho0"


@pytest.mark.lammps
def test_command(eos_ref_command: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measure, "in_turns", briefly)
    done = eos_ref_command("chart", "timestep", "--quick", "--out", tmp_path / "out", "--json")
    assert done.code == 0
    assert {row["quantity"] for row in json.loads(done.out)["points"]}
    assert (tmp_path / "out" / "report.html").exists()
    wrong = eos_ref_command("chart", "nothing", "--out", tmp_path / "no")
    assert wrong.code == 2 and not (tmp_path / "no").exists()
    code, _, err = eos_ref_command("chart", "laws", "--quick", "--engine", "path:/nowhere", "--out", tmp_path / "no")
    assert (code, "engine: must exist, found 'path:/nowhere'" in err.splitlines()[-1]) == (2, True)
