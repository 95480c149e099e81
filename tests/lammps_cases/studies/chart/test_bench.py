"""Benchmarks: their history, the comparison of two; every part runs. No test checks the speed."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from eos_ref import InputError
from lammps_cases.records.measure import ConfidenceInterval
from lammps_cases.studies.chart import bench, speed_history
from lammps_cases.studies.chart.bench import Ratio, against, laws_against_copy
from tests.support.outcome import Outcome

pytestmark = pytest.mark.slow

Run = Callable[..., Outcome]


def ratio(scene: str, low: float, high: float) -> Ratio:
    middle = ConfidenceInterval((low + high) / 2, low, high)
    return Ratio(scene, "LAMMPS", middle, ConfidenceInterval(1.0, 1.0, 1.0), middle)


def test_history_keeps_every_measurement_in_order(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "history.jsonl"
    for label in ("one", "two", "one"):
        speed_history.append(path, label, [ratio("a", 0.2, 0.3)])
    entries = speed_history.read(path)
    assert [entry.label for entry in entries] == ["one", "two", "one"]
    assert entries[0].ratios == (ratio("a", 0.2, 0.3),)
    for which, at in (("one", 2), ("1", 0), ("-1", 2)):
        assert speed_history.pick(entries, which, path) is entries[at]
    for which in ("none", "0x1", "9", "-9"):
        with pytest.raises(InputError, match="must be a label, or a number from 1 to 3"):
            speed_history.pick(entries, which, path)
    path.write_text(path.read_text() + path.read_text()[:40] + "\n")
    with pytest.raises(InputError, match=r"history\.jsonl, line 4"):
        speed_history.read(path)
    with pytest.raises(InputError, match="cannot be read"):
        speed_history.read(tmp_path / "none")


def test_measurements_differ_only_if_their_intervals_are_disjoint(tmp_path: Path) -> None:
    path = tmp_path / "h"
    before = [ratio("faster", 0.40, 0.42), ratio("slower", 0.20, 0.22), ratio("same", 0.30, 0.40), ratio("gone", 1, 2)]
    after = [ratio("faster", 0.30, 0.33), ratio("slower", 0.25, 0.27), ratio("same", 0.28, 0.33), ratio("new", 1, 2)]
    found = speed_history.changes(speed_history.append(path, "", before), speed_history.append(path, "", after))
    assert {change.scene: change.answer for change in found} == {
        "faster": "faster",
        "slower": "slower",
        "same": "cannot tell",
    }


def test_ratio_is_per_particle_and_over_rounds() -> None:
    calls: list[str] = []
    found = against("s", "p", lambda: calls.append("o"), lambda: calls.append("p"), 7, per=4.0, at_least=0.0)
    assert calls.count("o") == calls.count("p") == 2 + 7
    assert found.ratio.low <= found.ratio.median <= found.ratio.high
    assert found.ours_ns.median > 0


def test_every_law_is_measured_and_the_run_is_saved(eos_ref_command: Run, tmp_path: Path) -> None:
    laws = [r.scene.split(",")[0] for r in laws_against_copy(1000, 2)]
    assert laws == ["linear", "cubic", "tait/water", "tait/general 1.4", "ideal/gas"]
    history = tmp_path / "h.jsonl"
    for label in ("a", "b"):
        arguments = ("laws", "--states", "1000", "--repeats", "2", "--history", history, "--label", label)
        done = eos_ref_command("bench", *arguments, "--json")
        assert done.code == 0
        assert {"scene", "peer", "ours_ns", "peer_ns", "ratio"} <= set(json.loads(done.out)["ratios"][0])
    done = eos_ref_command("bench", "--compare", "a", "b", "--history", history, "--json")
    assert len(json.loads(done.out)["changes"]) == 6
    wrong = eos_ref_command("bench", "--compare", "a", "c", "--history", history)
    assert wrong.code == 2 and "must be a label" in wrong.err


@pytest.mark.lammps
def test_particle_model_is_measured_against_lammps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench, "EDGE", {2: 12})
    monkeypatch.setattr(bench, "MODEL_STEPS", {2: 2})
    found = list(bench.against_lammps((2,), 1))
    assert [r.scene for r in found] == [f"2D {option}, 144 particles" for option in bench.OPTIONS]
    assert all(r.peer == "LAMMPS" and r.peer_ns.median > 0 for r in found)


def test_completion_runs_as_in_a_shell() -> None:
    """A complete process prints candidates, and a failed request raises."""
    bench.process([*bench.EOS_REF], bench.completion_of("eos-ref r"))
    asked = os.environ | bench.completion_of("eos-ref findings force-p")
    done = subprocess.run([*bench.EOS_REF], check=True, env=asked, capture_output=True, text=True)
    assert done.stdout.split() == ["plain,force-per-volume"]
    with pytest.raises(RuntimeError, match="exit code"):
        bench.process([*bench.EOS_REF, "no-such-command"])
