"""A chart of several engines: their frontiers in one picture, each measured in its own process."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from lammps_cases.records.measure import ConfidenceInterval
from lammps_cases.studies.chart import page, record
from lammps_cases.studies.chart.record import Chart, MethodPoint, Panel, Section
from tests.support.outcome import Outcome

Run = Callable[..., Outcome]


def panel(ns: float) -> Panel:
    """One method on both sides; LAMMPS takes ``ns``."""
    times = {"plain": 3.0, "LAMMPS": ns}
    points = [MethodPoint("p", "near", m, 1e-9, ConfidenceInterval(t, 0.9 * t, 1.1 * t)) for m, t in times.items()]
    return Panel("p", "P", "about", "of p", "particle", tuple(points))


def chart(version: str, ns: float) -> Chart:
    """A chart of one panel."""
    machine: dict[str, str | float | int] = {"processor": "x", "cores": 2, "load": 0.1}
    section = Section("laws", "Laws", "about", 1.0, (panel(ns),))
    return Chart("eos-ref chart", machine, {"distribution": version}, True, 1.0, (section,))


def test_other_engine_is_drawn_over_the_first() -> None:
    alone, both = page.panel_figure(panel(9.0)), page.panel_figure(panel(9.0), [("2026.7.4", panel(5.0))])
    lines = [[tuple(line.get_xdata()) for line in figure.axes[0].lines] for figure in (alone, both)]
    assert lines[1][: len(lines[0])] == lines[0], "the first engine's are where they were"
    added = both.axes[0].lines[len(lines[0]) :]
    assert (5.0,) in [tuple(line.get_xdata()) for line in added]
    assert [line.get_linestyle() for line in added].count("--") == 1
    (legend,) = both.legends
    assert "LAMMPS 2026.7.4\nand its frontier" in [text.get_text() for text in legend.get_texts()]


def test_page_names_every_engine(tmp_path: Path) -> None:
    first, other = chart("2025.7.22.4.0", 9.0), chart("2026.7.4", 5.0)
    record.write(first, tmp_path)
    page.write(first, tmp_path, [other])
    html = (tmp_path / "report.html").read_text()
    assert "2025.7.22.4.0, and in addition, measured afterwards: 2026.7.4" in html
    page.write(first, tmp_path)
    assert "and in addition" not in (tmp_path / "report.html").read_text()


@pytest.mark.lammps
@pytest.mark.slow
def test_missing_engine_is_reported_in_one_line(eos_ref_command: Run, tmp_path: Path) -> None:
    code, _, err = eos_ref_command("chart", "laws", "--quick", "--engine", "path:/nowhere", "--out", tmp_path)
    assert code == 2
    assert "engine: must exist, found 'path:/nowhere'" in err.splitlines()[-1]
