"""Runs of example decks against the logs shipped with them: where they differ first, and by how much."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from lammps_cases.audit import logs
from tests.support.audited_decks import DECKS
from tests.support.outcome import Outcome

STEPS = {"Step": [0.0, 20.0, 40.0], "KinEng": [0.5, 0.25, 0.125], "Atoms": [9.0, 9.0, 9.0]}


@pytest.mark.parametrize(
    ("other", "digits", "expected"),
    [
        (STEPS, None, ()),
        ({"KinEng": [0.5, 0.25000001, 0.125]}, 8, ()),  # a unit in the last digit of a log
        ({"KinEng": [0.5, 0.25000003, 0.125]}, 8, (20, 3e-8 / 0.25000003, 40, 0.0)),
        ({"KinEng": [0.5, 0.25, 0.125 + 2.0**-55]}, None, (40, 2.0**-52, 40, 2.0**-52)),
        ({"KinEng": [0.25, 0.25, 0.5]}, 8, (0, 0.5, 40, 0.75)),
        ({"KinEng": [0.25], "Step": [40.0]}, 8, (40, 0.5, 40, 0.5)),  # at the steps of both
        ({"KinEng": [float("nan"), 0.25, 0.125]}, 8, (0, float("inf"), 40, 0.0)),
        ({"Atoms": [9.0, 8.0, 7.0]}, 8, ()),
    ],
)
def test_first_and_last_difference(
    other: dict[str, list[float]], digits: int | None, expected: tuple[float, ...]
) -> None:
    found = logs.departures(STEPS, STEPS | other, digits)
    assert [(of.first, of.there, of.last, of.then) for of in found] == [
        pytest.approx(each, rel=1e-6) for each in [expected] if each
    ]


@pytest.mark.lammps
def test_command_compares_ranks_and_logs(tmp_path: Path, eos_ref_command: Callable[..., Outcome]) -> None:
    folder = tmp_path / "decks" / "plates"
    folder.mkdir(parents=True)
    shutil.copy(DECKS / "in.plates", folder)
    log = "LAMMPS (17 Apr 2024)\n Step Press\n 0 0\n 200 1.0\nLoop time of 1 on 2 procs for 200 steps\n"
    (folder / "log.17Apr2024.plates.g++.2").write_text(log)
    out = tmp_path / "out"
    given = f"logs --from {folder.parent} --ranks 2 --steps 200 --out {out}".split()
    outcome = eos_ref_command(*given)
    assert outcome.code == 0, outcome.err
    document = logs.DOCUMENT.read(out / logs.NAME)
    assert list(logs.table(document)) == outcome.out.splitlines()
    against = {row.what: row for row in document.rows}
    assert list(against) == [
        "log of 17 Apr 2024 (2 ranks), 1 rank",
        "log of 17 Apr 2024 (2 ranks), 2 ranks",
        "1 rank, 2 ranks",
        "1 rank, atoms moved by an ulp",
    ]
    assert {d.column: d.first for d in against["log of 17 Apr 2024 (2 ranks), 2 ranks"].departures} == {"Press": 200}
    for what in ("1 rank, 2 ranks", "1 rank, atoms moved by an ulp"):
        assert all(of.then < 1e-9 for of in against[what].departures if of.column == "Temp"), "rounding"
    before = (out / "runs.jsonl").read_bytes()
    assert eos_ref_command(*given).out == outcome.out
    assert (out / "runs.jsonl").read_bytes() == before, "no deck runs again"
