"""Commands in README.md and docs/ are run here on real LAMMPS, and must print the output shown.

Blocks ``sh`` and ``python`` are run, in one folder per document; ``lammps``, ``yaml`` and ``toml`` are saved under the
name that the document gives; ``text`` is the output of the block above it, compared as by doctest: ``...``
stands for anything, white space for any white space. A comment ``# exit code N`` says how a
command ends, else it ends with 0.
Commands in the text are not run: their names and options have to exist.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from doctest import ELLIPSIS, NORMALIZE_WHITESPACE, OutputChecker
from pathlib import Path

import click
import pytest

from lammps_cases.cli.main import COMMANDS, group

ROOT = Path(__file__).parents[1]
DECKS = ROOT / "tests" / "decks"
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
NAMED = re.compile(r"Save this as `([\w.-]+)`[^`]*\Z")
GIVEN = {
    "in.deck": "in.plain",
    **{name: name for name in ("fluid.inc", "final.inc", "in.column", "in.box", "in.started", "in.vortices")},
}
NOT_RUN = {"make validate": "every case: minutes", "make setup": "an environment: minutes", "make test": "20 minutes"}


def blocks(page: Path) -> list[tuple[str, str, str]]:
    """The fenced blocks of a page: language, content, the text above."""
    text = page.read_text(encoding="utf-8")
    return [(match[1], match[2], text[: match.start()]) for match in BLOCK.finditer(text)]


def commands(block: str) -> Iterator[tuple[str, int]]:
    """The commands of a block, each with its exit code as documented."""
    for line in block.splitlines():
        command, _, comment = line.partition("  #")
        said = re.search(r"exit code (\d+)", comment)
        yield command.strip(), int(said[1]) if said else 0


def run(command: list[str], folder: Path) -> tuple[int, str, str]:
    """Run a command in a folder where the commands of this environment come first."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(command, cwd=folder, env=os.environ | {"PATH": path}, capture_output=True, text=True)
    return done.returncode, done.stdout, done.stderr


def typed(block: str, folder: Path) -> str:
    """Run the commands of a block; what they print."""
    printed = ""
    for command, expected in commands(block):
        if command in NOT_RUN:
            code, _, complaint = run([*shlex.split(command), "--dry-run"], ROOT)
            assert code == 0, f"{command}: {complaint}"
            continue
        code, out, complaint = run(["bash", "-c", command], folder)
        assert code == expected, f"{command}: exit code {code}\n{out}{complaint}"
        printed += out
    return printed


def assert_shows(shown: str, printed: str) -> None:
    """A block of output, or of comments, matches the printed text."""
    same = OutputChecker().check_output(shown, printed, ELLIPSIS | NORMALIZE_WHITESPACE)
    assert same, f"documented:\n{shown}\nprinted:\n{printed}"


@pytest.mark.lammps
@pytest.mark.typed
@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page)], ids=lambda page: page.name)
def test_blocks_print_the_output_shown(page: Path, tmp_path: Path) -> None:
    for name, deck in GIVEN.items():
        shutil.copy(DECKS / deck, tmp_path / name)
    shutil.copytree(ROOT / "docs" / "decks", tmp_path, dirs_exist_ok=True)
    printed = ""
    for language, block, above in blocks(page):
        if language == "sh":
            printed = typed(block, tmp_path)
        elif language == "python":
            code, out, complaint = run([sys.executable, "-c", block], tmp_path)
            assert code == 0, complaint
            assert_shows("".join(f"{said}\n" for said in re.findall(r"print\(.*\)  # (.*)", block)), out)
        elif language == "text":
            assert printed, f"nothing above prints this:\n{block}"
            assert_shows(block, printed)
            printed = ""
        else:
            named = NAMED.search(above)
            assert language in ("lammps", "yaml", "toml") and named, f"what is this block?\n{block}"
            (tmp_path / named[1]).write_text(block, encoding="utf-8")


def test_exempt_commands_occur_in_the_documents() -> None:
    shell = [block for page in PAGES for language, block, _ in blocks(page) if language == "sh"]
    assert set(NOT_RUN) <= {command for block in shell for command, _ in commands(block)}


def in_text() -> list[tuple[str, list[str]]]:
    """The words between backticks outside of the blocks, with their page."""
    found = []
    for page in (*PAGES, ROOT / "CONTRIBUTING.md", ROOT / "ARCHITECTURE.md"):
        prose = BLOCK.sub("", page.read_text(encoding="utf-8"))
        found += [(f"{page.name}: {code}", code.split()) for code in re.findall(r"`([^`]+)`", prose)]
    return found


def test_commands_in_the_text_exist(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "environ", dict(os.environ))  # --launcher leaves its value there
    seen = 0
    for place, words in in_text():
        if words[0] != "eos-ref" or len(words) == 1 or words[1].startswith("--"):
            continue
        seen += 1
        context = click.Context(group, **group.context_settings)  # click keeps the help option of the first one
        command = group.get_command(context, words[1])
        assert command is not None, place
        try:
            command.make_context(words[1], shlex.split(" ".join(words[2:])), parent=context)
        except click.MissingParameter:
            pass  # a command that is named, not shown
        except click.UsageError as error:
            pytest.fail(f"{place}: {error.format_message()}")
    assert seen > 50


def test_options_in_the_text_exist(pytestconfig: pytest.Config) -> None:
    context = click.Context(group, **group.context_settings)
    known = {"--" + name.replace("_", "-") for name in vars(pytestconfig.option)}
    for name in COMMANDS:
        command = group.get_command(context, name)
        assert command is not None
        known.update(option for parameter in command.params for option in parameter.opts)
    named = [(place, word) for place, words in in_text() for word in words if re.match(r"--\w", word)]
    assert [place for place, option in named if option.rstrip(",") not in known] == []
    assert len(named) > 20
