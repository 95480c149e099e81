"""The page of an atlas is complete, offline, escaped and reproducible."""

from __future__ import annotations

import html
import re
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

from eos_ref import InputError
from lammps_cases.findings import LEDGER
from lammps_cases.findings.entry import MapDifference
from lammps_cases.studies.stability import maps, page
from lammps_cases.studies.stability.maps import ExpectedDifference
from lammps_cases.studies.stability.model import MapCell
from tests.support.made_atlas import MAP, TEXT, made_atlas

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("page")
    page.write(made_atlas(out), out, {"made": MAP})
    return out


def test_page_has_unique_ids_and_valid_links(folder: Path) -> None:
    text = (folder / "report.html").read_text()
    ids = re.findall(r'\bid="([^"]+)"', text)
    assert Counter(ids).most_common(1)[0][1] == 1
    inner = set(re.findall(r'(?:href="#|url\(#)([^")]+)', text))
    assert inner <= set(ids)
    assert not re.findall(r'(?:src|href)="https?:', text)
    for path in re.findall(r'href="(decks/[^"]+)"', text):
        assert (folder / path).exists()


def test_text_is_escaped(folder: Path) -> None:
    text = (folder / "report.html").read_text()
    for raw in (TEXT, MAP.title, MAP.about, MAP.layers[1]):
        assert html.escape(raw) in text
        assert raw not in text


def test_every_cell_has_its_numbers_and_its_command(folder: Path) -> None:
    text = (folder / "report.html").read_text()
    atlas = made_atlas(folder)
    for cell in {r.cell for r in atlas.maps[0].cells}:
        row = text.partition(f'<tr id="{cell.anchor}"')[2].partition("</tr>")[0]
        assert html.escape(cell.command, quote=True).replace("&#x27;", "&#39;") in row
        assert ("step 7 of 9, atom 12, value 345.68" in row) == (cell.x > 1)
        assert (html.escape(TEXT) in row) == (cell.x > 5 and cell.y == 10.0)
    assert '<td>4 of 6 lines</td><td class="number">24.0</td>' in text


def test_table_of_disagreements_shows_both_sides(folder: Path) -> None:
    table = (folder / "report.html").read_text().partition('id="disagreements"')[2].partition("</section>")[0]
    assert table.count("<tr") == 3  # a header, one line per layer
    assert "stable, energy growth from dt = 0.4 to 1.6 on, lost particles from dt = 1.6 to 6.4 on" in table
    assert table.count("none known") == 2


def test_known_finding_explains_a_line(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    atlas = made_atlas(folder)
    assert len(maps.unexplained(atlas.disagreements)) == 2
    shown = MapDifference("made", "it moves <things>", "plain")
    monkeypatch.setattr(maps, "LEDGER", (replace(LEDGER[0], id="some-finding", expected_in_maps=(shown,)),))
    assert [line.layer for line in maps.unexplained(atlas.disagreements)] == ["with <shift>"]
    explained = ExpectedDifference("some-finding", "it moves <things>")
    assert [maps.expected_difference(line) for line in atlas.disagreements] == [explained, None]


def test_map_may_explain_differences_without_a_finding(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(maps, "MAPS", {"made": replace(MAP, engines_differ="by rounding")})
    atlas = made_atlas(folder)
    assert [maps.expected_difference(line) for line in atlas.disagreements] == 2 * [
        ExpectedDifference("", "by rounding")
    ]


def test_particles_at_the_onset_of_a_failure_are_shown(folder: Path) -> None:
    text = (folder / "report.html").read_text()
    cell = MapCell("made", 1.6, 0.1, "plain")
    row = text.partition(f'<tr id="{cell.anchor}"')[2].partition("</tr>")[0]
    assert row.count("data:image/png;base64,") == 2
    assert "particles of LAMMPS after step 6, colour: density 1 to 1.05; ringed: 12" in row
    assert f'href="decks/{cell.anchor}.in"' in row
    deck = (folder / "decks" / f"{cell.anchor}.in").read_text()
    assert deck.startswith("# A <made> map: made:plain:1.6:0.1\n# eos-ref stability --cell made:plain:1.6:0.1\n")


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


# --- names


@pytest.mark.parametrize("layer", ["", "plain", "with shift", "a:b", "with <shift>", "RK1, zmin 0"])
def test_name_of_a_cell_round_trips(layer: str) -> None:
    for x, y in ((0.1, 1e-300), (-2.5, 1 / 3), (1e22, 0.0)):
        cell = MapCell("made", x, y, layer)
        assert MapCell.parse(cell.name) == cell
        assert re.fullmatch(r"[A-Za-z0-9_.+-]+", cell.anchor)


def test_different_names_have_different_addresses() -> None:
    layers = ("", "a b", "a_b", "a:b", "a-b", "a_20_b", "a_", "a__")
    cells = [MapCell("made", x, y, layer) for layer in layers for x in (1.0, -1.0) for y in (1.0, 2.0)]
    assert len({cell.anchor for cell in cells}) == len(cells)


@pytest.mark.parametrize("text", ["", "made", "made:plain:1", "made:plain:one:2", "made:plain:1:"])
def test_invalid_cells_are_refused(text: str) -> None:
    with pytest.raises(InputError, match="cell: must be MAP:LAYER:X:Y"):
        MapCell.parse(text)
