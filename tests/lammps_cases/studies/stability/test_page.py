"""The page of an atlas is complete, offline, escaped and reproducible; its pictures show the results of the cells."""

from __future__ import annotations

import html
import io
import re
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from eos_ref import InputError
from lammps_cases.findings import LEDGER
from lammps_cases.findings.entry import MapDifference
from lammps_cases.report.pages.figures import svg
from lammps_cases.studies.flows.flow import rows
from lammps_cases.studies.stability import draw, maps, page
from lammps_cases.studies.stability.maps import ExpectedDifference
from lammps_cases.studies.stability.model import ENGINES, KINDS, Boundary, Kind, MapCell
from tests.support.made_atlas import MAP, PLACES, TEXT, kind, made_atlas, made_map
from tests.support.pages import text_of

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("page")
    page.write(made_atlas(out), out, {"made": MAP})
    return out


@pytest.fixture(scope="module")
def text(folder: Path) -> str:
    return (folder / "report.html").read_text()


# --- the page


def test_words_of_the_page(text: str, snapshot: Any) -> None:
    """Every cell has its numbers and its command, every disagreement both sides."""
    assert text_of(text) == snapshot


def test_page_has_unique_ids_valid_links_and_escaped_text(folder: Path, text: str) -> None:
    ids = re.findall(r'\bid="([^"]+)"', text)
    assert Counter(ids).most_common(1)[0][1] == 1
    assert set(re.findall(r'(?:href="#|url\(#)([^")]+)', text)) <= set(ids)
    assert not re.findall(r'(?:src|href)="https?:', text)
    assert all((folder / path).exists() for path in re.findall(r'href="(decks/[^"]+)"', text))
    for raw in (TEXT, MAP.title, MAP.about, MAP.layers[1]):
        assert html.escape(raw) in text and raw not in text
    cell = MapCell("made", 1.6, 0.1, "plain")  # where a failure begins
    row = text.partition(f'<tr id="{cell.anchor}"')[2].partition("</tr>")[0]
    assert row.count("data:image/png;base64,") == 2
    assert "particles of LAMMPS after step 6, colour: density 1 to 1.05; ringed: 12" in row
    assert f'href="decks/{cell.anchor}.in"' in row
    deck = (folder / "decks" / f"{cell.anchor}.in").read_text()
    assert deck.startswith("# A <made> map: made:plain:1.6:0.1\n# eos-ref stability --cell made:plain:1.6:0.1\n")


def test_differences_are_explained_by_a_finding_or_by_their_map(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lines = made_atlas(folder).disagreements
    assert len(maps.unexplained(lines)) == 2
    shown = MapDifference("made", "it moves <things>", "plain")
    monkeypatch.setattr(maps, "LEDGER", (replace(LEDGER[0], id="some-finding", expected_in_maps=(shown,)),))
    assert [line.layer for line in maps.unexplained(lines)] == ["with <shift>"]
    explained = ExpectedDifference("some-finding", "it moves <things>")
    assert [maps.expected_difference(line) for line in lines] == [explained, None]
    monkeypatch.setattr(maps, "MAPS", {"made": replace(MAP, engines_differ="by rounding")})
    assert [maps.expected_difference(line) for line in lines] == [explained, ExpectedDifference("", "by rounding")]


def test_page_pictures_and_decks_are_reproducible(folder: Path, tmp_path: Path) -> None:
    page.write(made_atlas(tmp_path), tmp_path, {"made": MAP})
    files = sorted(p.relative_to(folder) for p in folder.rglob("*") if p.is_file() and p.suffix != ".npz")
    assert {"report.html", "figures/made.svg", "figures/made.png"} <= {str(f) for f in files}
    for file in files:
        assert (folder / file).read_bytes() == (tmp_path / file).read_bytes(), file


def test_removed_map_is_still_shown(tmp_path: Path) -> None:
    page.write(made_atlas(tmp_path), tmp_path, {})
    text = (tmp_path / "report.html").read_text()
    assert "A &lt;made&gt; map" in text
    assert "decks/" not in text


# --- names of cells

NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
CELLS = st.builds(MapCell, st.just("made"), NUMBERS, NUMBERS, st.text("ab:_- <>,0", max_size=5))


@settings(deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(CELLS, min_size=1, max_size=6))
def test_names_of_cells_round_trip_and_have_different_addresses(cells: list[MapCell]) -> None:
    assert [MapCell.parse(cell.name) for cell in cells] == cells
    assert len({cell.anchor for cell in cells}) == len({cell.name for cell in cells})
    assert all(re.fullmatch(r"[A-Za-z0-9_.+-]+", cell.anchor) for cell in cells)


@pytest.mark.parametrize("text", ["", "made", "made:plain:1", "made:plain:one:2", "made:plain:1:"])
def test_invalid_cells_are_refused(text: str) -> None:
    with pytest.raises(InputError, match="cell: must be MAP:LAYER:X:Y"):
        MapCell.parse(text)


# --- pictures


def drawn() -> list[list[Any]]:
    """The axes of each layer: of LAMMPS, of the reference, of the differences."""
    figure = draw.map_figure(made_map(), MAP.theory)
    return [figure.axes[:3], figure.axes[3:6]]


def test_every_kind_has_its_own_mark_at_the_place_of_its_cells() -> None:
    assert set(draw.MARKS) == set(KINDS)
    assert len(set(draw.MARKS.values())) == len(KINDS)
    for row, layer in zip(drawn(), MAP.layers, strict=True):
        for axis, engine in zip(row, ENGINES[::-1], strict=False):
            found = {
                (KINDS[int(c.get_gid().rpartition("-")[2])], *place)
                for c in axis.collections
                if (c.get_gid() or "").startswith(engine)
                for place in np.asarray(c.get_offsets()).tolist()
            }
            of_layer = [r for r in made_map().cells if (r.engine, r.cell.layer) == (engine, layer)]
            assert found == {(r.outcome.kind, r.cell.x, r.cell.y) for r in of_layer}
            assert layer in axis.get_title()


def test_third_picture_shows_the_differences() -> None:
    for row in drawn():
        marks = {(*line.get_xdata(), *line.get_ydata(), line.get_marker()) for line in row[2].lines}
        shapes = {draw.MARKS[k][1] for k in ("lost particles", "energy growth")}
        assert {(6.4, 10.0, shape) for shape in shapes} <= marks
        alike = {mark[:2] for mark in marks if len(mark) == 3 and mark[2] == "o" and mark[:2] != (6.4, 10.0)}
        assert alike == {(x, y) for x in PLACES for y in MAP.lines} - {(6.4, 10.0)}


def test_cell_links_to_its_address_and_names_are_plain_text() -> None:
    made = made_map()
    pictures = [svg(draw.map_figure(made, MAP.theory, lambda cell: f"#{cell.anchor}")) for _ in range(2)]
    assert pictures[0] == pictures[1]
    links = re.findall(r'xlink:href="(#made[^"]*)"', pictures[0])
    differing = [cell for cell in {r.cell for r in made.cells} if kind(cell, "lammps") != kind(cell, "reference")]
    # Each cell once per engine, and cells that differ once more per engine.
    assert len(links) == len(made.cells) + 2 * len(differing)
    assert set(links) == {f"#{r.cell.anchor}" for r in made.cells}
    assert "costs $1 and $2" in pictures[0] and "with &lt;shift&gt;" in pictures[0]


def test_theory_is_drawn_on_its_layers() -> None:
    for row, count in zip(drawn(), (2, 1), strict=True):
        for axis in row:
            lines = [line for line in axis.lines if len(line.get_xdata()) == 101]
            assert len(lines) == count
            assert set(lines[0].get_xdata()) == {0.5}
            for line in lines[1:]:  # 1/y: a quotient and a product
                np.testing.assert_allclose(np.array(line.get_xdata()) * line.get_ydata(), 1.0, rtol=2 * 2.0**-53)


def test_bands_join_neighbouring_lines_with_the_same_kinds() -> None:
    def edge(y: float, low: float, above: Kind = "energy growth") -> Boundary:
        return Boundary("made", "plain", y, "lammps", low, 1.1 * low, "stable", above)

    lines = replace(made_map(), lines=(1.0, 2.0, 3.0, 4.0))
    edges = [edge(1.0, 0.1), edge(2.0, 0.2), edge(3.0, 0.3, "overlap"), edge(4.0, 0.4), edge(4.0, 0.8)]
    found = draw.chains(lines, edges)
    assert sorted([b.low for b in chain] for chain in found) == [[0.1, 0.2], [0.3], [0.4], [0.8]]
    bands = [c.get_paths()[0].vertices for c in drawn()[0][0].collections if not c.get_gid()]
    assert (0.4, 0.1, 1.6, 10.0) in [(*v.min(axis=0), *v.max(axis=0)) for v in bands], "between low and high"


def pixels(failing: list[int], values: Any = None, by_type: bool = False) -> Any:
    colour_n = np.linspace(0.9, 1.1, 54) if values is None else values
    png = draw.thumbnail(rows(0, 6, 9), colour_n, np.array(failing, int), (0.0, 0.0), (9.0, 6.0), by_type)
    return matplotlib.image.imread(io.BytesIO(png))


def test_thumbnail_marks_the_failing_particle_and_colours_types() -> None:
    plain, marked = pixels([]), pixels([13])  # the fifth of the second row
    row, column = np.nonzero(np.abs(marked - plain).max(axis=2) > 0.2)
    height, width = plain.shape[:2]
    middle = (column.mean() + 0.5) / width * 9, (1 - (row.mean() + 0.5) / height) * 6
    assert middle == pytest.approx((4.5, 1.5), rel=0, abs=0.5 * 9 / width), "to half a pixel"
    assert pixels([2], np.full(54, np.nan)).size  # a NaN density does not prevent the picture
    one, other = (pixels([], np.full(54, value), by_type=True) for value in (1.0, 2.0))
    assert np.abs(one - other).max() > 0.2
    assert np.array_equal(pixels([13]), marked)
