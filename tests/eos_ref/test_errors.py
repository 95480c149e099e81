"""The one exception: a line with subject, rule, value and place; it can be pickled."""

from __future__ import annotations

import pickle

import pytest

from eos_ref import InputError
from eos_ref.errors import nearest


def test_message() -> None:
    assert str(InputError("rho0", "must be positive")) == "rho0: must be positive"
    assert str(InputError("rho0", "must be positive", -1.0)) == "rho0: must be positive, found -1.0"
    assert str(InputError("rho0", "must be positive", 0, "a.yaml")) == "rho0: must be positive, found 0 (a.yaml)"
    assert str(InputError("word", "must not be empty", "")) == "word: must not be empty, found ''"


def test_is_a_value_error() -> None:
    with pytest.raises(ValueError, match="rho0"):
        raise InputError("rho0", "must be positive")


def test_message_stays_on_one_line() -> None:
    class Wordy:
        def __repr__(self) -> str:
            return "many\nlines\n\tof it"

    assert str(InputError("a\nb", "c\r\nd", Wordy(), "e\n f")) == "a b: c d, found many lines of it (e f)"


def test_at_prefixes_the_place() -> None:
    error = InputError("cs", "must be positive", 0)
    assert str(error.at("type 2")) == "cs: must be positive, found 0 (type 2)"
    assert str(error.at("type 2").at("case.yaml")) == "cs: must be positive, found 0 (case.yaml: type 2)"
    assert str(error) == "cs: must be positive, found 0", "the first complaint is left as it was"


@pytest.mark.parametrize("where", ["", "case.yaml"])
@pytest.mark.parametrize("found", [None, 0, "text", (1, 2)])
def test_can_be_pickled(found: object, where: str) -> None:
    error = InputError("cs", "must be positive", found, where)
    back = pickle.loads(pickle.dumps(error))
    assert type(back) is InputError
    assert (back.what, back.rule, back.found, back.where) == ("cs", "must be positive", found, where)
    assert str(back) == str(error)


def test_nearest_name_is_suggested_if_close_enough() -> None:
    assert nearest("near-rho", ["far", "near-rho0"]) == " (did you mean 'near-rho0'?)"
    assert nearest("zzz", ["far", "near-rho0"]) == ""
    assert nearest("near-rho0", ["example-rhosum"]) == "", "not near enough"
    assert nearest("rk", ["risk", "RK1.long", "RK1"]) == " (did you mean 'RK1'?)", "what begins so comes first"
