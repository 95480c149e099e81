"""Decks in the style of LAMMPS' examples: their output from LAMMPS' executable, and their logs."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from lammps_cases.bugs import deck
from lammps_cases.bugs.upstream import files
from lammps_cases.bugs.upstream.files import CASES, FOLDER, example_files, log_of
from lammps_cases.engine import installations
from lammps_cases.engine.session import EngineMissing
from lammps_cases.run import campaign
from tests.support.outcome import Outcome

Run = Callable[..., Outcome]
SHOWN = {"rheo-fall": "PASS", "rheo-mix": "FAIL", "rheo-heat": "FAIL"}  # only gravity acts in the first


@pytest.mark.slow
def test_decks_match_their_cases() -> None:
    flows = yaml.safe_load(CASES.read_text())["matrix"]["flow"]
    assert {f"rheo-{flow}" for flow in flows} == {example.name for example in files.examples()} == set(SHOWN)
    for example in files.examples():
        text = example.files[f"in.{example.name}"]
        assert f"read_data data.{example.name}\n" in text and "run 60 post no\n" in text and "thermo 20\n" in text
        assert text.startswith("# ") and example.files[f"data.{example.name}"]


@pytest.mark.lammps
@pytest.mark.parametrize("name", SHOWN)
def test_log_ends_with_both_numbers_and_the_verdict(name: str) -> None:
    example = next(example for example in files.examples() if example.name == name)
    log_name, log = log_of(example, installations.resolve("env"))
    assert re.fullmatch(rf"log\.\d+[A-Z][a-z]{{2}}\d{{4}}\.{name}\.g\+\+\.1", log_name)
    obtained, expected, within = (
        float(found) for found in (*re.findall(r"^obtained (\S+)$", log, re.M), *_expected(log))
    )
    assert (abs(obtained - expected) <= within) == (SHOWN[name] == "PASS")
    assert re.findall(r"^(PASS|FAIL)$", log, re.M) == [SHOWN[name]]
    assert re.findall(r"^ +(\d+) +[01] ", log, re.M) == ["0", "20", "40", "60"]


def _expected(log: str) -> tuple[str, str]:
    ((number, bound),) = re.findall(r"^expected (\S+) within (\S+)$", log, re.M)
    return number, bound


@pytest.mark.lammps
@pytest.mark.slow
def test_failing_flows_are_explained_by_findings(tmp_path: Path) -> None:
    """The same cases, judged by a run."""
    cases = files.example_cases()
    record = campaign.run_cases(cases, installations.resolve("env"), 1, tmp_path / "report")
    judged = {case.case.replace(".", "-"): case.verdict for case in record.cases}
    assert judged == {name: "exact" if shown == "PASS" else "explained" for name, shown in SHOWN.items()}


def test_without_lammps_the_decks_come_without_logs(
    tmp_path: Path, eos_ref_command: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing(engine: str) -> None:
        raise EngineMissing("there is no LAMMPS")

    monkeypatch.setattr(installations, "resolve", missing)
    monkeypatch.setattr(files, "kit_files", list)  # its numbers take seconds
    done = eos_ref_command("kit", "unittest", "--repository", "me/eos-ref", "--out", tmp_path)
    assert done.code == 0 and "the decks come without logs: there is no LAMMPS" in done.err
    names = {path.name for path in (tmp_path / FOLDER).iterdir()}
    assert names == {Path(file.path).name for file in example_files(None)}
    assert names == {f"{kind}.{name}" for name in SHOWN for kind in ("in", "data")}


def test_lammps_that_cannot_run_a_deck_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    broken = tmp_path / "lmp"
    broken.write_text("#!/bin/sh\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setattr(deck, "program", lambda engine: broken)
    with pytest.raises(EngineMissing, match=r"LAMMPS does not run in\.rheo-fall: .*exit status 1"):
        log_of(files.examples()[0], installations.resolve("env"))
