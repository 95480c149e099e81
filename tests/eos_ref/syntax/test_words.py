"""Words of commands: how they are split, and words that are not numbers."""

from __future__ import annotations

import pytest

from eos_ref import InputError
from eos_ref.syntax.words import fix, number, split


def test_split() -> None:
    assert split("fix 1 all\t rheo &\n 3.0 # cut\n\n").words == ["fix", "1", "all", "rheo", "3.0"]
    assert split("").words == []
    assert split("a 1\u00a02").words == ["a", "1\u00a02"], "a blank of another script does not separate words"
    with pytest.raises(InputError, match="command: must be a single one"):
        split("a\nb")


@pytest.mark.parametrize("text", ["1_0", "\uff11", "\u22121", "1,2", "0x1p1", "1d0", "", "1.2.3", "--1", "one"])
def test_not_a_number(text: str) -> None:
    assert number(text) is None
    with pytest.raises(InputError, match="cut: must be a finite number, found "):
        split(f"a {text or chr(34) * 2}").__class__(["a", text], "a", 1).number("cut")


@pytest.mark.parametrize("text", ["nan", "inf", "-inf", "1e309"])
def test_not_finite(text: str) -> None:
    words = split(f"a {text}")
    words.word("command")
    with pytest.raises(InputError, match="must be a finite number"):
        words.number("cut")


@pytest.mark.parametrize("text", ["1.5", "1e0", "99999999999999999999", "0x1", "\uff11", "one"])
def test_not_a_whole_number(text: str) -> None:
    words = split(f"a {text}")
    words.word("command")
    with pytest.raises(InputError, match="zmin: must be a whole number"):
        words.integer("zmin")


def test_end_choice_and_place() -> None:
    words = split("a b c")
    assert words.choice("letter", ("a",)) == "a"
    with pytest.raises(InputError, match=r"letter: must be one of x, bb \(did you mean 'bb'\?\), found 'b' \(a b c\)"):
        words.choice("letter", ("x", "bb"))
    with pytest.raises(InputError, match="a: takes nothing more, found 'c'"):
        words.end("a")
    with pytest.raises(InputError, match=r"mass: must be positive, found -1 \(a b c\)"), words.complaints():
        raise InputError("mass", "must be positive", -1)


def test_fix() -> None:
    assert fix("fix a_1 all rheo 3.0", "rheo").peek() == "3.0"
    for text, message in (
        ("unfix 1", "must begin with fix"),
        ("fix a-1 all rheo", "fix ID: must consist of letters, digits and underscores, found 'a-1'"),
        ("fix 1 some rheo", "group of fix rheo: must be all"),
        ("fix 1 all nve", "fix style: must be rheo"),
    ):
        with pytest.raises(InputError, match=message):
            fix(text, "rheo")
