"""Decks that an audit does not run, or not to the end: forbidden commands, and set-ups that cannot be checked."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from eos_ref import InputError
from lammps_cases.audit import place, supervise, text
from lammps_cases.audit.fields import PRESSURE
from lammps_cases.audit.options import AuditOptions
from lammps_cases.audit.place import DeckPlace
from lammps_cases.audit.supervise import audit_deck
from tests.support.audited_decks import DECKS, FIXES, MELT, case_of, write_deck

pytestmark = pytest.mark.lammps


def test_shell_is_refused_before_anything_runs(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"command shell: not allowed in an audit.*in\.shell:2"):
        audit_deck(DECKS / "in.shell", AuditOptions(keep=tmp_path, trust=False))
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_shell_made_of_variables_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From its text, whatever contains the process."""
    monkeypatch.setattr(supervise, "confined", lambda options: "none")
    with pytest.raises(InputError, match=r"'shell touch touched' \(in\.hidden_shell:6\)"):
        audit_deck(DECKS / "in.hidden_shell", AuditOptions(keep=tmp_path, trust=False))
    assert not (tmp_path / "touched").exists()


def test_shell_is_run_if_allowed(tmp_path: Path) -> None:
    case = case_of(audit_deck(DECKS / "in.hidden_shell", AuditOptions(keep=tmp_path, trust=True, fields=PRESSURE)))
    assert case.verdict == "refused"  # by LAMMPS, without fix rheo
    assert (tmp_path / "touched").exists()


@pytest.mark.parametrize(
    "command",
    [
        "shell rm -rf .",
        "python f here 'x = 1'",
        "plugin load evil.so",
        "variable x python f",
        "fix 1 all python/invoke 10 end_of_step f",
        "pair_style hybrid/overlay rheo 3.0 python 2.5",
        "if '1 > 0' then 'print a' else \"shell ls\"",
        "run 100 every 10 'shell ls'",
        "partition yes 1 shell ls",
        "log /elsewhere/log.lammps",
        "dump 1 all atom 10 ../out.dump",
        "write_data sub/../../x.data",
        "read_data ../common/fluid.data",
        "include ../settings.inc",
        "jump /elsewhere/in.deck",
        "molecule m sub/../../m.mol",
        "pair_coeff * * ../table.txt",
        "variable f file ../names",
        "if '1 > 0' then 'include ../settings.inc'",
        "print 'x' file /elsewhere/x",
        "write_dump all atom 'a;touch b;.gz'",
        "dump 1 all custom 10 out.*.gz id x",
        "dump 1 all movie 10 m.mp4 type type",
        "   'shell' ls # quoted",
    ],
)
def test_commands_that_reach_outside(command: str) -> None:
    with pytest.raises(InputError):
        place.check_command(text.words(text.without_comment(command)), "here", DeckPlace())


@pytest.mark.parametrize(
    "command",
    [
        "# shell ls",
        "print 'shell ls'",
        "print '/elsewhere'",
        "variable a equal 1 / 2",
        "jump SELF ../label",
        "variable a string /elsewhere",
        "dump 1 all atom/gz 10 out.*.gz",
        "dump 1 all custom 10 sub/../out.dump id x",
        "label shell",
        "thermo_style custom step temp",
        "fix 3 all rheo/pressure * linear",
        "group python type 1",
        "if '1 > 0' then 'print shell'",
    ],
)
def test_commands_that_stay_inside(command: str) -> None:
    place.check_command(text.words(text.without_comment(command)), "here", DeckPlace())


def test_included_files_are_checked(tmp_path: Path) -> None:
    deck = tmp_path / "in.deck"
    deck.write_text("if '0 > 1' then 'include a.inc'\n")
    (tmp_path / "a.inc").write_text("jump b.inc\njump SELF\n")
    (tmp_path / "b.inc").write_text("\nprint &\n  x\nshell ls\ninclude a.inc\n")
    with pytest.raises(InputError, match=r"shell.*b\.inc:4"):
        audit_deck(deck, AuditOptions(trust=False))


@pytest.mark.parametrize(
    ("commands", "rule"),
    [
        (FIXES, "must reach a run command"),
        (f"{FIXES}fix 3 all rheo/pressure * linear\nrun 9 every 3 'unfix 3'\n", "may not hold a command"),
        (f"{FIXES}variable c string fix\nrun 9 every 3 '${{c}} 3 all x'\n", "may not hold a command"),
        (f"{FIXES}variable c string log\npartition yes 1 clear\n", "may not hold a command"),
    ],
)
def test_decks_that_cannot_be_checked(commands: str, rule: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=rule):
        audit_deck(write_deck(tmp_path, commands))


def test_deck_without_rheo(tmp_path: Path) -> None:
    (tmp_path / "in.melt").write_text(MELT)
    with pytest.raises(InputError, match="must define fix rheo and fix rheo/pressure before a run"):
        audit_deck(tmp_path / "in.melt")


def test_missing_deck_and_bad_options(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="deck: no such file"):
        audit_deck(tmp_path / "in.none")
    wrongs: list[dict[str, Any]] = [{"every": 0}, {"steps": 0}, {"timeout": 0.0}, {"timeout": math.nan}]
    for wrong in wrongs:
        with pytest.raises(InputError, match="must be"):
            AuditOptions(**wrong)


@pytest.mark.parametrize("command", ["include no.inc", "jump no.inc", "jump SELF nowhere", "if '1 >", "next z"])
def test_errors_of_the_flow_are_refused(command: str, tmp_path: Path) -> None:
    case = case_of(audit_deck(write_deck(tmp_path, command + "\n")))
    assert case.verdict == "refused" and case.message.startswith("ERROR") and "in.deck:" in case.message


def test_control_and_unprintable_characters_are_escaped(tmp_path: Path) -> None:
    deck = tmp_path / "in.words"
    for words, told in (
        (b"foo \x1b[31mred\x07", r"Unknown command: foo \x1b[31mred\x07"),
        (b"print $\xe9", "Substitution for illegal variable \ufffd"),  # LAMMPS quotes one byte of it
    ):
        deck.write_bytes(b"units lj\n" + words + b"\n")
        case = case_of(audit_deck(deck))
        assert case.verdict == "refused"
        assert told in case.message
