"""Mistakes in a law: which ones a scene can show, and to which it is blind."""

from __future__ import annotations

import numpy as np
import pytest

from eos_ref import EOS, EOSTable
from eos_ref.eos import bounds
from lammps_cases.comparison.compare import EosState, evaluate
from lammps_cases.verdict.law_mistakes import MUTANTS, unseen

ODD = EOSTable([EOS("cubic", 1.2, 3.1, 0.7, 0.3), EOS("tait/general", 0.9, 2.3, 4.1)])
PLAIN = EOSTable([EOS("linear", 1.0, 1.0)])


def state(table: EOSTable) -> EosState:
    n = 40
    type_n = np.arange(n) % len(table) + 1
    return EosState(np.arange(1, n + 1), type_n, np.linspace(0.71, 1.53, n), np.full(n, 1.3))


def blind(table: EOSTable) -> list[str]:
    scene = state(table)
    bound_n = bounds.comparison(table, scene.rho_n, scene.type_n, None)
    return unseen(table, scene, evaluate(table, scene), bound_n)


def test_a_scene_of_odd_numbers_shows_every_mistake() -> None:
    assert blind(ODD) == []


def test_units_of_one_hide_what_they_multiply() -> None:
    assert blind(PLAIN) == ["cs instead of cs^2", "cs ignored", "rho0 ignored", "rho0 and cs exchanged"]


@pytest.mark.parametrize("name", ["types exchanged", "background dropped", "A3 dropped", "gamma instead of gamma - 1"])
def test_a_mistake_in_what_a_scene_does_not_have_is_none(name: str) -> None:
    assert MUTANTS[name](PLAIN, state(PLAIN)) is None


@pytest.mark.parametrize("name", MUTANTS)
def test_a_mistake_changes_the_pressure_or_does_not_apply(name: str) -> None:
    scene = state(ODD)
    p_n = MUTANTS[name](ODD, scene)
    assert p_n is None or not np.array_equal(p_n, evaluate(ODD, scene))
