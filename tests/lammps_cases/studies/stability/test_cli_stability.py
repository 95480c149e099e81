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
from lammps_cases.studies.stability import atlas, limits, maps, model, probe
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


def test_unexplained_differences_exit_with_one(
    eos_ref_command: Run, measured: list[dict[str, Any]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Cells of an earlier survey stay unless it begins afresh."""
    kept = tmp_path / "cells.jsonl"
    kept.write_text("{}\n")
    out = eos_ref_command("stability", "made", "--out", tmp_path, "--jobs", 1)
    assert out.code == 1
    assert "made                        48 runs,    24 fail, 2 of 6 lines differ (24.0 s)" in out.out
    assert "2 lines differ for no known reason" in out.out
    assert (tmp_path / "report.html").exists() and kept.exists()
    assert measured == [
        {"chosen": ["made"], "quick": False, "site": None, "jobs": 1, "progress": measured[0]["progress"]}
    ]
    monkeypatch.setattr(maps, "LEDGER", (replace(LEDGER[0], expected_in_maps=(MapDifference("made", "why"),)),))
    out = eos_ref_command("stability", "made", "--out", tmp_path, "--fresh", "--json")
    [one] = json.loads(out.out)["maps"]
    assert (out.code, kept.exists()) == (0, False)
    assert (one["id"], len(one["cells"]), len(one["disagreements"])) == ("made", 48, 2)


def test_limits_are_saved_where_the_advice_reads_them(
    eos_ref_command: Run, measured: list[dict[str, Any]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shipped, save = limits.read(), limits.save
    monkeypatch.setattr(limits, "save", lambda found, file=tmp_path / "limits.json": save(found, file))
    eos_ref_command("stability", "made", "--out", tmp_path, "--save-limits")
    found = limits.read(tmp_path / "limits.json")
    assert [(c.layer, c.engine, len(c.points)) for c in found.curves] == [
        (layer, engine, 3) for layer in MAP.layers for engine in ("lammps", "reference")
    ]
    assert limits.read() == shipped != found


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


@pytest.mark.parametrize(
    ("arguments", "chosen"),
    [
        ((), "step-a step-b"),
        ((("step-*",),), "step-a step-b"),
        ((("whole", "step-a"),), "step-a whole"),
        (((), "quick"), "step-a"),
        (((), "long"), "whole"),
    ],
)
def test_maps_are_chosen_by_name_pattern_and_tag(arguments: tuple[Any, ...], chosen: str) -> None:
    tags = {"step-a": ("quick",), "step-b": (), "whole": ("long",)}
    known = {name: replace(MAP, id=name, tags=of) for name, of in tags.items()}
    assert [one.id for one in maps.select(known, *arguments)] == chosen.split()
