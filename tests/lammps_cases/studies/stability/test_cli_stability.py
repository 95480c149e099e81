"""The command: what it runs, prints and writes, and its exit codes."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from lammps_cases.findings import LEDGER
from lammps_cases.findings.entry import MapDifference
from lammps_cases.studies.stability import atlas, maps, model, probe
from lammps_cases.studies.stability.limits import Limits, read
from tests.support.made_atlas import MAP, made_atlas
from tests.support.outcome import Outcome

pytestmark = pytest.mark.slow

Run = Callable[..., Outcome]


@pytest.fixture(autouse=True)
def one_map(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(maps, "MAPS", {"made": MAP})


@pytest.fixture
def measured(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """Return the arguments of each measurement, which gives an atlas made up for the test."""
    asked: list[dict[str, Any]] = []

    def measure(chosen: Any, out: Path, command: str, **options: Any) -> Any:
        asked.append({"chosen": [one.id for one in chosen], **options})
        found = made_atlas(out)
        model.write(found, out)
        return found

    monkeypatch.setattr(atlas, "measure", measure)
    return asked


@pytest.mark.lammps
def test_unexplained_differences_exit_with_one(
    eos_ref_command: Run, measured: list[dict[str, Any]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = eos_ref_command("stability", "made", "--out", tmp_path, "--jobs", 1)
    assert out.code == 1
    assert "made                        48 runs,    24 fail, 2 of 6 lines differ (24.0 s)" in out.out
    assert "2 lines differ for no known reason" in out.out
    assert (tmp_path / "report.html").exists()
    assert measured == [
        {"chosen": ["made"], "quick": False, "site": None, "jobs": 1, "progress": measured[0]["progress"]}
    ]
    shown = MapDifference("made", "why")
    monkeypatch.setattr(maps, "LEDGER", (replace(LEDGER[0], expected_in_maps=(shown,)),))
    assert eos_ref_command("stability", "made", "--out", tmp_path).code == 0


def test_document_has_cells_and_disagreements(
    eos_ref_command: Run, measured: list[dict[str, Any]], tmp_path: Path
) -> None:
    out = eos_ref_command("stability", "made", "--out", tmp_path, "--json")
    [one] = json.loads(out.out)["maps"]
    assert {"id", "cells", "disagreements"} <= set(one)
    assert (one["id"], len(one["cells"]), len(one["disagreements"])) == ("made", 48, 2)


def test_limits_are_saved_where_the_advice_reads_them(
    eos_ref_command: Run, measured: list[dict[str, Any]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from lammps_cases.studies.stability import limits

    def saved(found: Limits, file: Path = tmp_path / "limits.json") -> None:
        save(found, file)

    save = limits.save
    monkeypatch.setattr(limits, "save", saved)
    eos_ref_command("stability", "made", "--out", tmp_path, "--save-limits")
    found = read(tmp_path / "limits.json")
    assert [(c.layer, c.engine, len(c.points)) for c in found.curves] == [
        (layer, engine, 3) for layer in MAP.layers for engine in ("lammps", "reference")
    ]
    assert read(limits.FILE) != found


def test_fresh_discards_the_cells(eos_ref_command: Run, measured: list[dict[str, Any]], tmp_path: Path) -> None:
    kept = tmp_path / "cells.jsonl"
    kept.write_text("{}\n")
    eos_ref_command("stability", "made", "--out", tmp_path)
    assert kept.exists()
    eos_ref_command("stability", "made", "--out", tmp_path, "--fresh")
    assert not kept.exists()


@pytest.mark.lammps
def test_cell_is_run_on_both_engines_and_written_as_a_deck(
    eos_ref_command: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(probe, "examine", partial(probe.examine, limit=300.0))  # its two steps may have to be compiled
    out = eos_ref_command("stability", "--cell", "made:with <shift>:1.6:0.1", "--out", tmp_path, "--json")
    document = json.loads(out.out)
    assert (document["cell"], out.code) == ("made:with <shift>:1.6:0.1", 0)
    assert [document[side]["kind"] for side in ("lammps", "reference")] == ["stable", "stable"]
    assert document["lammps"]["steps"] == 2
    deck = Path(document["deck"]).read_text()
    assert deck.startswith(
        "# A <made> map: made:with <shift>:1.6:0.1\n# eos-ref stability --cell 'made:with <shift>:1.6:0.1'\n"
    )
    assert deck.endswith("\nrun 2 post no\n")
    out = eos_ref_command("stability", "--cell", "made:plain:1.6:0.1", "--out", tmp_path)
    assert out.out.splitlines()[:3] == [
        "A <made> map: dt = 1.6, nu = 0.1 plain",
        "LAMMPS     stable",
        "reference  stable",
    ]


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        (("nade",), "no such map: 'nade' (did you mean 'made'?)"),
        (("--tag", "none"), "tag: no map has it"),
        (("--cell", "made"), "cell: must be MAP:LAYER:X:Y with two numbers, found 'made'"),
        (("--cell", "mode::1:1"), "no such map: 'mode' (did you mean 'made'?)"),
        (("--cell", "made::1:1"), "layer: must be one of 'plain', 'with <shift>', found ''"),
        (("--cell", "made:plain:100:1"), "dt: must lie within 0.1 to 6.4, found 100.0"),
        (("--cell", "made:plain:1:nan"), "nu: must lie within 0.1 to 10, found nan"),
        (("--engine", "nothing"), "engine: must be env"),
        (("--jobs", "0"), "--jobs"),
    ],
)
def test_bad_input_is_reported_in_one_line_with_exit_code_two(
    eos_ref_command: Run, tmp_path: Path, arguments: tuple[str, ...], error: str
) -> None:
    out = eos_ref_command("stability", *arguments, "--out", tmp_path)
    assert out.code == 2
    assert error in out.err
    assert "Traceback" not in out.err
    assert not out.out


def test_maps_are_chosen_by_name_pattern_and_tag() -> None:
    from dataclasses import replace

    known_maps = {
        name: replace(MAP, id=name, tags=tags)
        for name, tags in (("step-a", ("quick",)), ("step-b", ()), ("whole", ("long",)))
    }

    def ids(*arguments: Any) -> list[str]:
        return [one.id for one in maps.select(known_maps, *arguments)]

    assert ids() == ["step-a", "step-b"]
    assert ids(("step-*",)) == ["step-a", "step-b"]
    assert ids(("whole", "step-a")) == ["step-a", "whole"]
    assert ids((), "quick") == ["step-a"]
    assert ids((), "long") == ["whole"]
