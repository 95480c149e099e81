"""The command line: commands made from signatures, their help, the list of commands, shell completion."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import click
import platformdirs
import pytest
import yaml
from annotated_types import Interval
from click.testing import CliRunner
from syrupy.assertion import SnapshotAssertion

from lammps_cases.cli import commands
from lammps_cases.cli.commands import command
from lammps_cases.cli.main import COMMANDS, group
from lammps_cases.findings import KNOWN, LEDGER
from lammps_cases.records.options import Option, Positional, flat, option_of, parameters
from lammps_cases.scene import casefile
from tests.support.outcome import Outcome

Run = Callable[..., Outcome]
HEAVY = {"numpy", "scipy", "numba", "ase", "pandas", "rich", "matplotlib", "lammps"}
given: dict[str, Any] = {}


@dataclass(frozen=True)
class Size:
    """A group of options."""

    width: Annotated[Annotated[int, Interval(ge=1, le=9)] | None, Option("Width.")] = None
    _: KW_ONLY
    names: Annotated[list[str], Option("Made when it is needed.", type=str)] = field(default_factory=lambda: ["own"])
    hidden: str = "not an option"


def try_command(
    place: Annotated[Path, Positional()],
    kind: Annotated[Literal["a", "b"], Option("Kind.", like="c+")] = "a",
    *,
    size: Size,
    parts: Annotated[tuple[int, ...], Option("Parts.", "--part")] = (),
    fresh: Annotated[bool, Option("Fresh.")] = False,
    text: Annotated[str, Option("Text.")] = "",
) -> int:
    """Try."""
    given.update(locals())
    return 0


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("x", {"place": Path("x"), "kind": "a", "size": Size(), "parts": (), "fresh": False, "text": ""}),
        ("x --kind ccc --width 9 --part 1 --part 2", {"kind": "ccc", "size": Size(9), "parts": (1, 2)}),
        ("--fresh x --text t", {"fresh": True, "text": "t"}),
        ("", "Missing argument 'PLACE'"),
        ("x --kind d", "'d' is not one of 'a', 'b'"),
        ("x --width 10", "10 is not in the range 1<=x<=9"),
        ("x --part one", "'one' is not a valid integer"),
        ("x --hidden y", "No such option"),
    ],
)
def test_command_accepts_the_arguments_of_its_signature(words: str, expected: Any) -> None:
    made = CliRunner().invoke(command()(try_command), words.split())
    if isinstance(expected, str):
        assert made.exit_code == 2 and expected in made.output
    else:
        assert made.exit_code == 0 and given | expected == given


def test_help_follows_the_signature(snapshot: SnapshotAssertion) -> None:
    assert CliRunner().invoke(command()(try_command), ["--help"]).output == snapshot
    options = [each.name for each in parameters(try_command) if option_of(each.annotation)]
    assert options == ["place", "kind", "width", "names", "parts", "fresh", "text"]


def test_function_takes_options_as_arguments_and_documents_them() -> None:
    @flat
    def area(at: int, *, size: Size) -> tuple[int, Size]:
        """Compute.

        Parameters
        ----------
        (options)
        """
        return at, size

    assert area(3, width=2) == (3, Size(2)) and area(3) == (3, Size())
    assert "width :\n    Width." in (area.__doc__ or "")
    with pytest.raises(TypeError, match="widht"):
        area(3, widht=2)


# --- the commands


@pytest.mark.parametrize("name", COMMANDS)
def test_command_has_the_help_line_of_the_table_and_help_for_every_option(name: str) -> None:
    made = group.get_command(click.Context(group), name)
    assert made is not None
    assert (made.name, made.get_short_help_str(limit=120)) == (name, COMMANDS[name][1])
    assert all(option.help for option in made.params if isinstance(option, click.Option))


def test_help_lists_ten_commands_and_dev_the_others(eos_ref_command: Run, snapshot: SnapshotAssertion) -> None:
    first, second = eos_ref_command("--help").out, eos_ref_command("dev").out
    assert (first, second) == snapshot
    assert eos_ref_command() == (0, first, "")
    listed = [line.split()[0] for out in (first, second) for line in out.partition("Options:\n")[2].splitlines()
              if line.startswith("  ") and line[2] not in " -"]  # fmt: skip
    assert sorted(listed) == sorted(COMMANDS)


@pytest.mark.parametrize(
    ("earlier", "words"), [("ledger", "findings"), ("kit", "dev kit"), ("findings", "dev findings")]
)
def test_every_spelling_of_a_command_works(earlier: str, words: str, eos_ref_command: Run) -> None:
    assert eos_ref_command(*words.split(), "--json") == eos_ref_command(earlier, "--json")


# --- completion


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
def test_shell_completion(line: str, names: list[str], eos_ref_command: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    variables = {commands.VARIABLE: "bash_complete", "COMP_WORDS": line, "COMP_CWORD": str(line.count(" "))}
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    assert [line.removeprefix("plain,") for line in eos_ref_command().out.splitlines()] == names


def test_completions_are_the_existing_names() -> None:
    cases = casefile.load()
    assert {case.name for case in cases} <= set(commands.case_names())
    assert {name.split(".")[0] for name in commands.case_names()} == {case.name.split(".")[0] for case in cases}
    assert commands.tag_names() == {tag for case in cases for tag in case.tags} - {casefile.MORE}
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
    folder, cache = tmp_path / "root" / "data" / "cases", tmp_path / "completion.json"
    folder.mkdir(parents=True)
    (folder / "one.yaml").write_text("name: one\ntags: [small]\nmatrix: {}\n")
    monkeypatch.setattr(commands, "ROOT", tmp_path / "root")
    monkeypatch.setattr(platformdirs, "user_cache_dir", lambda _: str(tmp_path))
    reads, load = list[int](), yaml.load

    def counted(*of: Any) -> Any:
        reads.append(1)
        return load(*of)

    monkeypatch.setattr(yaml, "load", counted)
    for _ in range(2):
        assert (commands.case_names()[0], commands.tag_names()) == ("one", {"small"})
    assert len(reads) == 1
    (folder / "two.yaml").write_text("name: two\n")
    assert "two" in commands.case_names() and len(reads) == 3
    cache.write_text('{"key": 5')
    assert "two" in commands.case_names() and len(reads) == 5
    cache.unlink()
    cache.mkdir()
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
    if shell == "bash":
        (tmp_path / "start").write_text("export OWN=1\n" + out)
        bash = ["bash", "-c", f". {tmp_path / 'start'}; complete -p eos-ref"]
        assert "eos-ref" in subprocess.run(bash, capture_output=True, text=True, check=True, env={**os.environ}).stdout
