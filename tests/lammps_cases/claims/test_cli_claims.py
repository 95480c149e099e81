"""The command eos-ref claims: verdicts, page, document, exit codes."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.support.outcome import Outcome

pytestmark = pytest.mark.lammps

Command = Callable[..., Outcome]
CHOSEN = ("pressure-linear", "pressure-gamma-unit", "pressure-a3-unit", "rheo-exclude-list", "rheo-versionadded")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder in which the claims of this module are judged, once."""
    return tmp_path_factory.mktemp("claims")


def document(outcome: Outcome) -> dict[str, dict[str, Any]]:
    return {row["id"]: row for row in json.loads(outcome.out)["claims"]}


def test_run(eos_ref_command: Command, folder: Path) -> None:
    done = eos_ref_command("claims", *CHOSEN, "--out", folder, "--json")
    assert done.code == 0, done.err
    rows = document(done)
    assert {id: row["verdict"] for id, row in rows.items()} == {
        "pressure-linear": "holds",
        "pressure-gamma-unit": "holds",
        "pressure-a3-unit": "does not hold",
        "rheo-exclude-list": "does not hold",
        "rheo-versionadded": "cannot be tested",
    }
    assert set(rows["pressure-linear"]) >= {"id", "page", "text", "cases", "verdict", "evidence"}
    assert rows["pressure-a3-unit"]["evidence"][0]["finding"] == "cubic-unit"
    assert rows["pressure-linear"]["cases"][0] == "compression.linear.3d"
    assert json.loads((folder / "claims.json").read_text()) == json.loads(done.out)
    page = (folder / "claims.html").read_text()
    assert 'href="env/report.html#case=compression.linear.3d"' in page
    assert (
        " ".join(page.split()).count(
            "1 are refuted by cases, 1 only by small decks, and 0 by the wording of their page"
        )
        == 1
    )
    assert "http" not in page.replace("http-equiv", "")


def test_finished_run_gives_the_same_verdicts(eos_ref_command: Command, folder: Path) -> None:
    """Probes run earlier on the same LAMMPS count; nothing is run."""
    again = eos_ref_command("claims", *CHOSEN, "--run", folder / "env", "--out", folder / "again", "--json")
    assert again.code == 0, again.err
    assert {id: row["verdict"] for id, row in document(again).items()} == {
        row["id"]: row["verdict"] for row in json.loads((folder / "claims.json").read_text())["claims"]
    }
    first = (folder / "again" / "claims.html").read_bytes()
    eos_ref_command("claims", *CHOSEN, "--run", folder / "env", "--out", folder / "again")
    assert (folder / "again" / "claims.html").read_bytes() == first


def test_failure_without_a_finding_is_red(eos_ref_command: Command, folder: Path, tmp_path: Path) -> None:
    run = json.loads((folder / "env" / "run.json").read_text())
    case = next(case for case in run["cases"] if case["case"] == "near-rho0.linear.2d")
    for field in case["fields"]:
        field |= {"verdict": "differs", "max_abs": 1.0, "max_over_bound": 1e9}
    case["verdict"] = "differs"
    (tmp_path / "env").mkdir()
    (tmp_path / "env" / "run.json").write_text(json.dumps(run))
    done = eos_ref_command("claims", "pressure-linear", "--run", tmp_path / "env", "--out", tmp_path / "out")
    assert done.code == 1
    assert "no finding explains it: near-rho0.linear.2d" in done.out
    assert done.out.endswith("\nFAIL: 1 statement does not hold, unexplained\n")
    both = eos_ref_command(
        "claims", "pressure-linear", "--run", folder / "env", "--run", tmp_path / "env", "--out", tmp_path, "--json"
    )
    row = document(both)["pressure-linear"]
    assert both.code == 1 and row["verdict"] == "does not hold"
    assert sorted(row["verdicts"].values()) == ["does not hold", "holds"]  # two runs of one version are two columns


@pytest.mark.parametrize(
    ("claims", "codes", "said"),
    [
        (("pressure-linear", "pressure-gamma-unit"), (0, 0, 0), "PASS: 2 statements hold"),
        (
            ("pressure-linear", "pressure-a3-unit"),
            (0, 0, 1),
            "KNOWN BUGS: 1 statement does not hold, all known; 1 known bug seen in this LAMMPS (not severe); "
            "nothing new",
        ),
    ],
)
def test_headline(
    claims: tuple[str, ...],
    codes: tuple[int, ...],
    said: str,
    eos_ref_command: Command,
    folder: Path,
    tmp_path: Path,
) -> None:
    """A known finding of medium severity fails at that severity and not above."""
    judged = ("claims", *claims, "--run", folder / "env", "--out", tmp_path)
    done = eos_ref_command(*judged)
    state, _, sentence = said.partition(": ")
    assert done.out.endswith(f"\n{said}\n")
    assert f'<span class="stamp">{state}</span> {sentence}</h1>' in (tmp_path / "claims.html").read_text()
    levels = [eos_ref_command(*judged, "--fail-on", level).code for level in ("high", "medium")]
    assert (done.code, *levels) == codes


def test_cases_not_in_the_run_are_not_run(eos_ref_command: Command, folder: Path, tmp_path: Path) -> None:
    done = eos_ref_command("claims", "pressure-cubic", "--run", folder / "env", "--out", tmp_path, "--json")
    assert done.code == 0 and document(done)["pressure-cubic"]["verdict"] == "not run"


def test_traceability(eos_ref_command: Command) -> None:
    done = eos_ref_command("claims", "--traceability")
    assert done.code == 0 and "claims without a case" in done.out
    as_json = json.loads(eos_ref_command("claims", "--traceability", "--json").out)
    assert as_json["dangling"] == {} and "rheo-howto" in as_json["untestable"]


def test_bad_input(eos_ref_command: Command, tmp_path: Path) -> None:
    done = eos_ref_command("claims", "pressure-liner")
    assert done.code == 2 and "did you mean 'pressure-linear" in done.err and done.err.count("\n") == 1
    done = eos_ref_command("claims", "--run", tmp_path / "gone")
    assert done.code == 2 and "cannot be read" in done.err


def test_help_has_an_example(eos_ref_command: Command) -> None:
    assert "Example:  eos-ref claims" in eos_ref_command("claims", "--help").out
