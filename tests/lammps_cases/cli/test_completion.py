"""Help pages and shell completion, both without importing slow packages."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import platformdirs
import pytest
import yaml

from lammps_cases.cli import commands
from lammps_cases.cli.main import COMMANDS, DEV
from lammps_cases.findings import KNOWN, LEDGER
from lammps_cases.scene import casefile
from tests.support.outcome import Outcome

Run = Callable[..., Outcome]
HEAVY = {"numpy", "scipy", "numba", "ase", "pandas", "rich", "matplotlib", "lammps"}


def completed(line: str) -> list[str]:
    """The completions that bash gets for a line ending at the cursor."""
    words = line.split(" ")
    given = {commands.VARIABLE: "bash_complete", "COMP_WORDS": line, "COMP_CWORD": str(len(words) - 1)}
    command = [sys.executable, "-m", "lammps_cases.cli.main"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env={**os.environ, **given})
    return [line.removeprefix("plain,") for line in done.stdout.splitlines()]


@pytest.mark.parametrize(
    ("line", "names"),
    [
        ("eos-ref rep", ["report-bug", "report"]),
        ("eos-ref sta", ["stability"]),
        ("eos-ref dev sta", ["stability"]),
        ("eos-ref run near-rho0.linear", ["near-rho0.linear.2d", "near-rho0.linear.3d"]),
        ("eos-ref run --tag quic", ["quick"]),
        ("eos-ref findings force-per", ["force-per-volume"]),
        ("eos-ref explain force-per", ["force-per-volume"]),
        ("eos-ref run --engine e", ["env"]),
        ("eos-ref audit in.deck --engine pypi:2025.7.22.4", ["pypi:2025.7.22.4.0"]),
        ("eos-ref run --base", ["--baseline"]),
    ],
)
def test_shell_completion(line: str, names: list[str]) -> None:
    assert completed(line) == names


def test_completions_are_the_existing_names() -> None:
    cases = casefile.load()
    assert {case.name for case in cases} <= set(commands.case_names())
    assert {name.split(".")[0] for name in commands.case_names()} == {case.name.split(".")[0] for case in cases}
    assert commands.tag_names() == {tag for case in cases for tag in case.tags}
    assert sorted(commands.finding_names()) == sorted(entry.id for entry in LEDGER)
    assert commands.engine_names() == ["env", *(f"pypi:{version}" for version in KNOWN), "path:"]


@pytest.mark.parametrize(
    "call", ["main.group.main(['--help'], 'eos-ref', standalone_mode=False)", "commands.completed('cases', 'n')"]
)
def test_nothing_heavy_is_imported(call: str) -> None:
    code = f"import sys\nfrom lammps_cases.cli import commands, main\n{call}\nprint(*sys.modules, file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert HEAVY.isdisjoint(done.stderr.split())


def test_names_are_cached_until_a_file_changes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "root" / "data" / "cases"
    folder.mkdir(parents=True)
    (folder / "one.yaml").write_text("name: one\ntags: [small]\nmatrix: {}\n")
    monkeypatch.setattr(commands, "ROOT", tmp_path / "root")
    monkeypatch.setattr(platformdirs, "user_cache_dir", lambda _: str(tmp_path))
    reads: list[int] = []
    load = yaml.load

    def counted(*of: Any) -> Any:
        reads.append(1)
        return load(*of)

    monkeypatch.setattr(yaml, "load", counted)
    for _ in range(2):
        assert (commands.case_names()[0], commands.tag_names()) == ("one", {"small"})
    assert len(reads) == 1
    (folder / "two.yaml").write_text("name: two\n")
    assert "two" in commands.case_names() and len(reads) == 3
    (tmp_path / "completion.json").write_text('{"key": 5')
    assert "two" in commands.case_names() and len(reads) == 5
    (tmp_path / "completion.json").unlink()
    (tmp_path / "completion.json").mkdir()
    assert "two" in commands.case_names() and len(reads) == 7


@pytest.mark.parametrize("shell", commands.INSTALLED)
def test_script_is_printed_and_nothing_is_written(
    shell: str, eos_ref_command: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    code, out, err = eos_ref_command("completion", shell)
    assert (code, err) == (0, "") and commands.VARIABLE in out
    assert out.splitlines()[0] == f"# eos-ref completion {shell} {commands.INSTALLED[shell]}"
    assert not [*tmp_path.iterdir()]


def test_bash_accepts_the_printed_script(eos_ref_command: Run, tmp_path: Path) -> None:
    start = tmp_path / ".bashrc"
    start.write_text("export OWN=1\n" + eos_ref_command("completion", "bash").out)
    done = subprocess.run(["bash", "-c", f". {start}; complete -p eos-ref"], capture_output=True, text=True, check=True)
    assert "eos-ref" in done.stdout


def listed(out: str) -> list[str]:
    """The commands that a page of the help lists."""
    _, _, after = out.partition("Options:\n")
    return [line.split()[0] for line in after.splitlines() if line.startswith("  ") and line[2] not in " -"]


def test_help_lists_ten_commands_and_dev_the_others(eos_ref_command: Run) -> None:
    first, second = eos_ref_command("--help").out, eos_ref_command("dev").out
    ten = "run audit explain findings report-bug report compare accept chart doctor"
    assert " ".join(listed(first)) == ten
    assert sorted([*listed(first), *listed(second)]) == sorted(COMMANDS)
    places = [second.index(f"{title}:\n") for title in DEV]
    assert places == sorted(places) and "eos-ref dev " in first


@pytest.mark.parametrize(
    ("earlier", "words"), [("ledger", ["findings"]), ("kit", ["dev", "kit"]), ("findings", ["dev", "findings"])]
)
def test_every_spelling_of_a_command_works(earlier: str, words: list[str], eos_ref_command: Run) -> None:
    assert eos_ref_command(*words, "--json") == eos_ref_command(earlier, "--json")
    assert eos_ref_command("dev", "lst").err.startswith("eos-ref: no such command: 'lst' (did you mean 'list'?)")
