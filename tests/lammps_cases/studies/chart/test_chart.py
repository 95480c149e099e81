"""The chart as a whole: measured on real LAMMPS, on disk, read again, drawn, and its page."""

from __future__ import annotations

import csv
import json
import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from eos_ref import InputError
from eos_ref.methods.laws import METHODS as LAW_METHODS
from lammps_cases.records.documents import SCHEMAS
from lammps_cases.records.measure import ConfidenceInterval, Timing
from lammps_cases.report.pages.figures import RED
from lammps_cases.studies.chart import collect, flows, page, record
from lammps_cases.studies.chart.record import Chart, Map, MethodPoint, Panel, Section, compared, frontier, point
from lammps_cases.studies.flows.catalogue import FLOWS
from lammps_cases.studies.flows.flow import Options
from lammps_cases.studies.flows.solve import Convergence
from tests.support.outcome import Outcome
from tests.support.roundings import rounded

pytestmark = pytest.mark.slow

Run = Callable[..., Outcome]


def made_panel() -> Panel:
    timings = {
        "fast": Timing((1e-6, 1.1e-6, 0.9e-6) * 4, 10, 1e-3),
        "exact": Timing((5e-6, 5.1e-6, 4.9e-6) * 4, 10, 1e-3),
        "bad": Timing((9e-6,) * 12, 10, 1e-3),
        "LAMMPS exact": Timing((7e-6,) * 12, 10, 1e-3),
    }
    errors = {"fast": 1e-4, "exact": 1e-15, "bad": math.inf, "LAMMPS exact": 1e-8}
    points = compared([point("q", "near <&> far", m, errors[m], timings[m], 10.0, "why") for m in timings], timings)
    return Panel("p", "A panel", "About it.", "error of it", "state", points, roofline_ns=20.0)


def made_chart() -> Chart:
    convergence = [
        Convergence(
            "shear-wave",
            engine,
            Options(),
            (8, 16, 32),
            {"rate": errors},
            (1.0, 2.0, 4.0),
            (64, 128, 256),
            (9, 9, 9),
            {},
        )
        for engine, errors in (("reference", (4e-2, 1e-2, 2.5e-3)), ("lammps", (4e-2, math.nan, 3e-2)))
    ]
    data = Map(
        "m", "A map", "x", "gamma", (1e-6, 1e-3, 1.0), (1.5, 3.0), ((1e-3, 1e-6, 1e-9), (0.0, 1.0, 2.0)), "error"
    )
    section = Section("flows", "Flows", "About.", 1.0, (made_panel(),), (data,), tuple(convergence))
    return Chart(
        "eos-ref chart", {"processor": "p", "cores": 2, "load": 0.1}, {"distribution": "1"}, True, 2.0, (section,)
    )


def test_chart_round_trips(tmp_path: Path) -> None:
    chart = made_chart()
    record.write(chart, tmp_path)
    again = record.DOCUMENT.read(tmp_path / "chart.json")
    assert again.panels == chart.panels  # infinite errors included
    assert again.sections[0].maps == chart.sections[0].maps
    assert again.sections[0].flows[0] == chart.sections[0].flows[0]
    assert math.isnan(again.sections[0].flows[1].errors["rate"][1])
    assert json.loads((tmp_path / "chart.json").read_text())["schema"] == SCHEMAS["chart"]


def test_tables_hold_every_point_and_every_error(tmp_path: Path) -> None:
    record.write(made_chart(), tmp_path)
    points = list(csv.DictReader((tmp_path / "points.csv").read_text().splitlines()))
    assert [row["method"] for row in points] == ["fast", "exact", "bad", "LAMMPS exact"]
    assert {row["method"]: row["dominated_by"] for row in points}["LAMMPS exact"] == "exact"
    rows = list(csv.DictReader((tmp_path / "convergence.csv").read_text().splitlines()))
    assert [(row["engine"], row["resolution"]) for row in rows if row["engine"] == "reference"] == [
        ("reference", n) for n in ("8", "16", "32")
    ]
    assert float(rows[0]["order"]) == rounded(2.0, 16)


@pytest.mark.parametrize("content", [None, "", "{}", '{"schema": "other"}', "[1, 2"])
def test_invalid_charts_are_refused_in_one_line(tmp_path: Path, content: str | None) -> None:
    if content is not None:
        (tmp_path / "chart.json").write_text(content)
    with pytest.raises(InputError, match=r"chart\.json|^chart: cannot be read"):
        record.DOCUMENT.read(tmp_path / "chart.json")


def test_document_of_points_is_valid_json(tmp_path: Path) -> None:
    document = record.points_document(made_chart())
    json.dumps(document, allow_nan=False)
    keys = {"quantity", "regime", "method", "error", "ns"}
    assert all(keys <= set(row) for row in document["points"])
    assert next(row for row in document["points"] if row["method"] == "bad")["error"] is None


def test_pictures_and_page_are_reproducible(tmp_path: Path) -> None:
    for name in ("a", "b"):
        page.write(made_chart(), tmp_path / name)
    files = sorted(p.relative_to(tmp_path / "a") for p in (tmp_path / "a").rglob("*") if p.is_file())
    assert {str(f) for f in files} == {
        "report.html",
        *(f"figures/{name}.{kind}" for name in ("p", "m", "flow-shear-wave") for kind in ("svg", "png")),
    }
    for file in files:
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes(), file


def test_page_shows_the_points_and_has_unique_ids(tmp_path: Path) -> None:
    page.write(made_chart(), tmp_path)
    html = (tmp_path / "report.html").read_text()
    assert "near &lt;&amp;&gt; far" in html
    assert "near <&>" not in html
    assert "frontier: fast (4.0 digits, 100 ns), then exact (15.0 digits, 500 ns)" in html
    assert "none right" in html
    ids = re.findall(r'\bid="([^"]+)"', html)
    assert len(ids) == len(set(ids))
    used = set(re.findall(r'(?:xlink:href="#|url\(#)([^")]+)', html))
    assert used <= set(ids)


@pytest.mark.parametrize(("load", "cores", "busy"), [(0.9, 2, False), (1.4, 2, True), (1.0, 1, False), (3.0, 4, False)])
def test_page_warns_of_a_busy_machine(load: float, cores: int, busy: bool, tmp_path: Path) -> None:
    page.write(replace(made_chart(), machine={"processor": "p", "cores": cores, "load": load}), tmp_path)
    assert ("Other programs ran" in (tmp_path / "report.html").read_text()) is busy


def test_drawn_frontier_is_that_of_the_points() -> None:
    panel = made_panel()
    [axis] = [axis for axis in page.panel_figure(panel).axes if axis.get_visible()]
    line = axis.lines[0]
    best = frontier(panel.points)
    x, y = line.get_xdata(), line.get_ydata()
    assert list(x)[1:-1] == [p.ns.median for p in best]
    assert list(y)[1:-1] == [p.digits for p in best]
    assert panel.roofline_ns in [line.get_xdata()[0] for line in axis.lines]


def test_legend_has_every_method_and_lammps_shares_its_shape() -> None:
    names = [f"kernel {k}" for k in range(24)]
    points = [
        MethodPoint("q", "r", prefix + name, 10.0 ** -(k % 9), ConfidenceInterval(k + 1.0, k + 0.9, k + 1.1))
        for k, name in enumerate(names)
        for prefix in ("", "LAMMPS ")
    ]
    figure = page.panel_figure(Panel("p", "t", "a", "e", "u", tuple(points)))
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert texts[:24] == sorted(names)
    assert texts[24:] == ["LAMMPS: same shape, red", "frontier"]
    marks = page.marks_of(points)
    assert all(marks[f"LAMMPS {name}"] == (RED, marks[name][1]) for name in names)
    assert len({marks[name] for name in names}) == 24


def test_methods_have_one_explanation_and_one_mark_per_section(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    interval = ConfidenceInterval(1.0, 0.9, 1.1)
    named = {"one": "the first way", "two": "the second way", "two again": "the second way", "LAMMPS": "its output"}
    points = [MethodPoint("q", "r", name, 1e-9, interval, reason=reason) for name, reason in named.items()]
    points.append(MethodPoint("q", "r", "LAMMPS two", 1e-9, interval, reason="not listed: that of two"))
    both = [Panel(f"p{k}", "t", "a", "e", "u", tuple(points[k:])) for k in range(2)]
    section = Section("laws", "Laws", "about", 1.0, tuple(both))
    listed = [(["one"], named["one"]), (["two", "two again"], named["two"]), (["LAMMPS"], named["LAMMPS"])]
    assert page.methods(section) == listed
    drawn: list[page.Marks] = []

    def drawing(panel: Panel, others: object, marks: page.Marks) -> Figure:
        drawn.append(marks)
        return Figure()

    monkeypatch.setattr(page, "panel_figure", drawing)
    page.write(replace(made_chart(), sections=(section,)), tmp_path)
    assert drawn[0] == drawn[1] and {"one", "two"} <= set(drawn[0])
    text = (tmp_path / "report.html").read_text()
    assert text.count("<dt>two; two again</dt> <dd>the second way</dd>") == 1 and "not listed:" not in text


SECOND_ORDER = ("shear-wave", "heat-wave", "taylor-green", "sound-wave-tait-water")


@pytest.mark.lammps
def test_every_method_has_an_explanation(quick: tuple[Chart, Path]) -> None:
    assert all(method.reason for method in LAW_METHODS)
    for section in quick[0].sections:
        listed = page.methods(section)
        assert len({reason for _, reason in listed}) == len(listed) and all(reason for _, reason in listed)


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory) -> tuple[Chart, Path]:
    """The equations of state and some flows measured once, in the quick form, with real LAMMPS."""
    out = tmp_path_factory.mktemp("chart")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(flows, "FLOWS", {name: FLOWS[name] for name in (*SECOND_ORDER, "couette")})
        return collect.collect(("laws", "flows"), True, out, "test"), out


@pytest.mark.lammps
def test_lammps_has_the_error_of_its_order_of_operations(quick: tuple[Chart, Path]) -> None:
    """The bits are the same, so the worst case is, too, if the search begins and climbs in the same way."""
    for panel in quick[0].sections[0].panels:
        for regime in panel.regimes:
            errors = {p.method: p.error for p in panel.of(regime)}
            assert errors["LAMMPS"] == errors["in LAMMPS' order"]


@pytest.mark.lammps
def test_lammps_loses_digits_near_rho0(quick: tuple[Chart, Path]) -> None:
    [water] = [panel for panel in quick[0].panels if panel.title == "Pressure of tait/water"]
    near = {p.method: p.digits for p in water.of(water.regimes[0])}
    assert near["LAMMPS"] < 9 < 14 < near["compiled"]


@pytest.mark.lammps
def test_flows_converge_with_second_order_on_both_engines(
    quick: tuple[Chart, Path],
) -> None:
    runs = {(run.flow, run.engine): run for run in quick[0].sections[1].flows}
    for flow in SECOND_ORDER:
        for engine in ("reference", "lammps"):
            run = runs[flow, engine]
            assert abs(run.fit(next(iter(run.errors))).order - 2) < 0.25, (flow, engine)
    assert runs["couette", "reference"].fit("velocity").order > 1.5
    assert runs["couette", "lammps"].fit("velocity").order < 0.5  # finding wall-velocity-lost


@pytest.mark.lammps
def test_every_file_is_written(quick: tuple[Chart, Path]) -> None:
    chart, out = quick
    assert record.DOCUMENT.read(out / "chart.json").panels == chart.panels
    tables = {"chart.json", "sections.jsonl", "points.csv", "convergence.csv"}
    assert {p.name for p in out.iterdir()} == {*tables, "report.html", "figures"}
    assert chart.engine["distribution"]
    assert chart.machine["processor"]


@pytest.mark.lammps
def test_command(eos_ref_command: Run, tmp_path: Path) -> None:
    done = eos_ref_command("chart", "timestep", "--quick", "--out", tmp_path / "out", "--json")
    assert done.code == 0
    assert {row["quantity"] for row in json.loads(done.out)["points"]}
    assert (tmp_path / "out" / "report.html").exists()
    wrong = eos_ref_command("chart", "nothing", "--out", tmp_path / "no")
    assert wrong.code == 2
    assert not (tmp_path / "no").exists()
