"""Pictures of maps and of particles show the results of the cells."""

from __future__ import annotations

import io
import re
from dataclasses import replace
from typing import Any

import matplotlib.image
import numpy as np
import pytest

from lammps_cases.report.pages.figures import svg
from lammps_cases.studies.flows.flow import rows
from lammps_cases.studies.stability import draw
from lammps_cases.studies.stability.model import KINDS, Boundary, Engine, Kind
from tests.support.made_atlas import MAP, PLACES, kind, made_map

pytestmark = pytest.mark.slow


def axes(figure: Any) -> list[list[Any]]:
    return [figure.axes[:3], figure.axes[3:6]]


def test_every_kind_has_its_own_mark() -> None:
    assert set(draw.MARKS) == set(KINDS)
    assert len(set(draw.MARKS.values())) == len(KINDS)


def test_cells_are_drawn_at_their_place_with_the_mark_of_their_kind() -> None:
    drawn = made_map()
    for row, layer in zip(axes(draw.map_figure(drawn, MAP.theory)), MAP.layers, strict=True):
        for axis, engine in zip(row, ("lammps", "reference"), strict=False):
            found: dict[str, set[tuple[float, float]]] = {
                KINDS[int(c.get_gid().rpartition("-")[2])]: {tuple(p) for p in np.asarray(c.get_offsets())}
                for c in axis.collections
                if (c.get_gid() or "").startswith(engine)
            }
            expected: dict[str, set[tuple[float, float]]] = {}
            for r in drawn.cells:
                if (r.engine, r.cell.layer) == (engine, layer):
                    expected.setdefault(r.outcome.kind, set()).add((r.cell.x, r.cell.y))
            assert found == expected
            assert layer in axis.get_title()


def test_third_picture_shows_the_differences() -> None:
    for row in axes(draw.map_figure(made_map())):
        marks = {(*line.get_xdata(), *line.get_ydata(), line.get_marker()) for line in row[2].lines}
        shapes = {k: draw.MARKS[k][1] for k in ("lost particles", "energy growth")}
        assert {(6.4, 10.0, shape) for shape in shapes.values()} <= marks
        alike = {mark[:2] for mark in marks if len(mark) == 3 and mark[2] == "o" and mark[:2] != (6.4, 10.0)}
        assert alike == {(x, y) for x in PLACES for y in MAP.lines} - {(6.4, 10.0)}


def test_cell_links_to_its_address_and_names_are_plain_text() -> None:
    drawn = made_map()
    text = svg(draw.map_figure(drawn, MAP.theory, lambda cell: f"#{cell.anchor}"))
    links = re.findall(r'xlink:href="(#made[^"]*)"', text)
    differing = [Cell for Cell in {r.cell for r in drawn.cells} if kind(Cell, "lammps") != kind(Cell, "reference")]
    # Each cell once per engine, and cells that differ once more per engine.
    assert len(links) == len(drawn.cells) + 2 * len(differing)
    assert set(links) == {f"#{r.cell.anchor}" for r in drawn.cells}
    assert "costs $1 and $2" in text
    assert "with &lt;shift&gt;" in text


def test_theory_is_drawn_on_its_layers() -> None:
    first, second = axes(draw.map_figure(made_map(), MAP.theory))
    for row, expected in ((first, [0.5, None]), (second, [0.5])):
        for axis in row:
            lines = [line for line in axis.lines if len(line.get_xdata()) == 101]
            assert len(lines) == len(expected)
            assert set(lines[0].get_xdata()) == {0.5}
    other = next(line for line in first[0].lines if len(line.get_xdata()) == 101 and line.get_xdata()[0] != 0.5)
    # A quotient and a product.
    np.testing.assert_allclose(np.array(other.get_xdata()) * other.get_ydata(), 1.0, rtol=2 * 2.0**-53)


def boundary(y: float, low: float, above: Kind = "energy growth", engine: Engine = "lammps") -> Boundary:
    return Boundary("made", "plain", y, engine, low, 1.1 * low, "stable", above)


def test_bands_join_neighbouring_lines_with_the_same_kinds() -> None:
    drawn = replace(made_map(), lines=(1.0, 2.0, 3.0, 4.0))
    edges = [boundary(1.0, 0.1), boundary(2.0, 0.2), boundary(3.0, 0.3, "overlap"), boundary(4.0, 0.4)]
    edges.append(boundary(4.0, 0.8))
    found = draw.chains(drawn, edges)
    assert sorted([b.low for b in chain] for chain in found) == [[0.1, 0.2], [0.3], [0.4], [0.8]]


def test_bands_lie_between_low_and_high() -> None:
    figure = draw.map_figure(made_map())
    [axis, *_] = axes(figure)[0]
    bands = [c.get_paths()[0].vertices for c in axis.collections if not c.get_gid()]
    assert any((v[:, 0].min(), v[:, 0].max(), v[:, 1].min(), v[:, 1].max()) == (0.4, 1.6, 0.1, 10.0) for v in bands)


def test_pictures_are_reproducible() -> None:
    pictures = [svg(draw.map_figure(made_map(), MAP.theory)) for _ in range(2)]
    assert pictures[0] == pictures[1]


def pixels(failing: list[int], values: Any = None, by_type: bool = False) -> Any:
    x_nc = rows(0, 6, 9)
    colour_n = np.linspace(0.9, 1.1, 54) if values is None else values
    png = draw.thumbnail(x_nc, colour_n, np.array(failing, int), (0.0, 0.0), (9.0, 6.0), by_type)
    return matplotlib.image.imread(io.BytesIO(png))


def test_thumbnail_marks_the_failing_particle() -> None:
    plain, marked = pixels([]), pixels([13])  # the fifth of the second row
    row, column = np.nonzero(np.abs(marked - plain).max(axis=2) > 0.2)
    height, width = plain.shape[:2]
    middle = (column.mean() + 0.5) / width * 9, (1 - (row.mean() + 0.5) / height) * 6
    assert middle == pytest.approx((4.5, 1.5), rel=0, abs=0.5 * 9 / width), "to half a pixel"
    # A NaN density does not prevent the picture.
    pixels([2], np.full(54, np.nan))


def test_thumbnail_colours_types_differently() -> None:
    one, other = pixels([], np.ones(54), by_type=True), pixels([], np.full(54, 2.0), by_type=True)
    assert np.abs(one - other).max() > 0.2
    assert np.array_equal(pixels([1]), pixels([1]))
