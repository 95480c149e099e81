"""The findings' workarounds: each is run, in the order of commands that it names, unless it is not a command.

A finding's deck (``eos-ref report-bug``) or scene shows it, and does not with the changes of the workaround.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from lammps_cases.bugs import deck
from lammps_cases.bugs.report import case_of, demonstrations
from lammps_cases.findings import LEDGER
from lammps_cases.findings.document import FOLDER
from lammps_cases.run import prepared_case
from lammps_cases.scene import casefile
from tests.support.bug_decks import engine_of, report_of, version_of
from tests.support.printed import ENTRIES
from tests.support.small_scene import Engine, SmallScene, agree
from tests.support.workarounds import NEWER, WORKAROUNDS, Deck, How, Orders, Scene, Test


def parts(name: str) -> list[str]:
    """The parts of a workaround: the lines of its section."""
    return (FOLDER / f"{name}.md").read_text(encoding="utf-8").partition("## Workaround\n\n")[2].splitlines()


def chosen(kind: type[How]) -> list[Any]:
    """The parts of one kind, for a test."""
    return [
        pytest.param(name, how, id=f"{name}: {part[:40]}")
        for name, hows in WORKAROUNDS.items()
        for part, how in zip(parts(name), hows, strict=True)
        if isinstance(how, kind)
    ]


def test_every_part_of_a_workaround_is_run() -> None:
    assert list(WORKAROUNDS) == [entry.id for entry in LEDGER]
    for entry in LEDGER:
        assert len(parts(entry.id)) == len(WORKAROUNDS[entry.id]), entry.id


@pytest.mark.parametrize(("name", "how"), chosen(Test))
def test_named_tests_of_workarounds_exist(name: str, how: Test) -> None:
    file, function = how.name.split("::")
    assert f"\ndef {function}(" in (Path(__file__).parent / f"test_texts_{file}.py").read_text()


def test_findings_fixed_by_a_newer_lammps_are_not_of_this_one() -> None:
    for name, hows in WORKAROUNDS.items():
        assert (NEWER in hows) <= (not ENTRIES[name].listed(version_of("env"))), name


def scene_of(name: str, changes: Mapping[str, Any]) -> SmallScene:
    """A changed scene of a finding."""
    case = case_of(name, name, casefile.merge(demonstrations()[name].scene, changes))
    return SmallScene(case.scene, prepared_case.prepare(case).atoms)


def as_documented(lammps: Engine, scene: SmallScene, beside: tuple[str, ...]) -> bool:
    """Whether every field lies within its bound of the reference's, at every step that is compared."""
    predicted = scene.predicted(*beside)
    return all(
        agree(fields[name], predicted, name, at)
        for at, fields in enumerate(lammps.fields(scene))
        for name in scene.scene.compare
    )


@pytest.mark.lammps
@pytest.mark.parametrize(("name", "how"), chosen(Scene))
def test_a_scene_changed_as_the_workaround_says(name: str, how: Scene, lammps: Engine) -> None:
    assert not as_documented(lammps, scene_of(name, {}), how.beside)
    assert all(as_documented(lammps, scene_of(name, changes), how.beside) for changes in how.changes)


def judged(name: str, *edits: tuple[str, str]) -> tuple[int, str]:
    """LAMMPS' exit code and the verdict of an edited deck of a finding; each text occurs in it once."""
    made = report_of(name).deck
    text = made.text
    for old, new in edits:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    ending = deck.run(replace(made, lines=tuple(text.splitlines())), engine_of("env"))
    return ending.code, ending.verdict(made)


@pytest.mark.lammps
@pytest.mark.parametrize(("name", "how"), chosen(Deck))
def test_a_deck_edited_as_the_workaround_says(name: str, how: Deck) -> None:
    assert judged(name)[1] == "FAIL" and judged(name, *how.edits) == (0, "PASS")


def before_the_last_run(name: str, order: str) -> tuple[str, str]:
    """The edit that inserts commands, by name, before the last run of a deck."""
    lines = report_of(name).deck.lines
    fixes = [line for line in lines if line.startswith("fix") and " rheo" in line]
    commands = {
        "define": fixes,
        "remove": [f"unfix {line.split()[1]}" for line in fixes[::-1]],
        "rheo": fixes[:1],
        "remove_rheo": [f"unfix {fixes[0].split()[1]}"],
        "pair": [line for line in lines if line.startswith("pair_")],
        "others": [line for line in lines if line.startswith(("fix", "compute")) and line not in fixes],
        "write": ["write_restart w.restart"],
        "read": ["clear", "comm_modify vel yes", "read_restart w.restart"],
        "run": ["run 0 post no"],
    }
    last = "thermo_style custom step v_inside\n"
    return last, "\n".join([*(line for word in order.split() for line in commands[word]), last])


@pytest.mark.lammps
@pytest.mark.parametrize(("name", "how"), chosen(Orders))
def test_commands_in_the_order_of_the_workaround(name: str, how: Orders) -> None:
    """Restart files included."""
    for order in how.bad:
        assert judged(name, before_the_last_run(name, order)) == (0, "FAIL"), order
    for order in how.good:
        assert judged(name, before_the_last_run(name, order)) == (0, "PASS"), order
