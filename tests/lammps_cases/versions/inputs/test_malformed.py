"""Malformed words of each kind of argument in the manual, each once."""

from __future__ import annotations

from typing import get_args

import pytest

from eos_ref import InputError
from eos_ref.syntax.ranges import type_range
from lammps_cases.versions.inputs import syntax
from lammps_cases.versions.inputs.syntax import NTYPES, Argument, Kind

LEGAL = {"number": "1.2", "integer": "8", "choice": "RK1", "types": "2", "group": "all", "id": "1", "name": "grad/v/xy"}


@pytest.mark.parametrize("kind", get_args(Kind))
def test_words_of_a_kind_are_distinct_and_malformed(kind: Kind) -> None:
    words = syntax.words_for(Argument(kind=kind), LEGAL[kind])
    assert len(words) >= 7
    assert LEGAL[kind] not in words.values()
    assert len(set(words.values())) == len(words), "the same word by two names"
    assert any(not word.isascii() for word in words.values()), "other scripts"


def test_numbers_include_every_edge_case() -> None:
    words = set(syntax.number(Argument(kind="number"), "1.2").values())
    assert {"0", "-0.0", "-1.2", "nan", "inf", "1e-310", "1e308", "1e309", "2147483648", "4294967297", "-1"} <= words
    words = set(syntax.integer(Argument(kind="integer"), "8").values())
    assert {"1.5", "8.0", "2147483648", "4294967297", "nan", "9" * 20} <= words


@pytest.mark.parametrize(("name", "word"), syntax.types(Argument(kind="types"), "").items())
def test_exactly_the_listed_types_are_legal(name: str, word: str) -> None:
    if name in syntax.LEGAL_TYPES:
        assert type_range(word, NTYPES)
    else:
        with pytest.raises(InputError):
            type_range(word, NTYPES)


def test_keywords_are_misspelled() -> None:
    assert {"RHO/SUM", "Rho/sum", "rhosum", "rho-sum", "rho/sums", "rho/sux"} <= set(
        syntax.words_for_keyword("rho/sum").values()
    )
