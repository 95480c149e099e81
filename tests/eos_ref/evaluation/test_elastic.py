"""Forces of bonds and of contacts: by their formulas, across boundaries, with bounds."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from eos_ref import EOS, EOSTable, parse_fix_rheo
from eos_ref.errors import InputError
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.elastic import elastic_forces
from eos_ref.model.bonds import Bonds, Elastic, ShellBond, SolidContact, SpringBond
from eos_ref.model.box import Box
from eos_ref.model.elastic_commands import parse_bonds
from eos_ref.model.parameters import Model, PairRheo, Viscosity
from eos_ref.model.state import State
from eos_ref.numbers.rounded import Rounded

ROUNDED = 1e-13  # relative: some twenty roundings of a force, and 40 of a distance of 1 between coordinates of 10
LAWS = EOSTable((EOS("linear"),) * 2)
SPRING = SpringBond(2.0, 0.5, 0.3)


def forces(elastic: Elastic, bonds: Bonds, r: float, speed: float = 0.0, number: Any = np.asarray) -> Any:
    """Forces on two solids of types 1 and 2, r apart across a periodic boundary; the second one moves away."""
    fix = parse_fix_rheo("fix 1 all rheo 3.0 quintic 0")
    model = Model(2, fix, (1.0, 1.0), LAWS, PairRheo(3.0), (Viscosity("constant", 0.1),) * 2, elastic=elastic)
    x_nc, v_nc = np.array([[9.7, 4.0], [9.7 + r - 10, 4.0]]), np.array([[0.0, 0.0], [speed, 0.0]])
    box = Box((0.0, 0.0), (10.0, 10.0), (True, True))
    solid_n = np.array([True, True])
    state = State(number(x_nc), number(v_nc), number(np.ones(2)), np.array([1, 2]), solid_n)
    return elastic_forces(ArrayEvaluator(model, box, state.type_n, solid_n), bonds, state)


def test_bonds_among_some_particles() -> None:
    bonds = Bonds(np.array([0, 2, 3]), np.array([1, 3, 1]), np.array([1, 2, 1]), np.array([1.0, 2.0, 3.0]))
    some = bonds.of(np.array([3, 1, 2]), 4)
    assert [some.i_b.tolist(), some.j_b.tolist(), some.type_b.tolist()] == [[2, 0], [0, 1], [2, 1]]
    assert some.length_b.tolist() == [2.0, 3.0]


def bond(length: float) -> Bonds:
    return Bonds(np.array([0]), np.array([1]), np.array([1]), np.array([length]))


def contact(bonded: float = 0.0) -> SolidContact:
    one_two = np.array([[0.0, 1.0], [1.0, 0.0]])
    return SolidContact(1.5 * one_two, 1.4 * one_two, 0.5 * one_two, bonded)


PULLS = [
    (Elastic((SPRING,)), (2.0 * 0.2 + 0.3 * 0.3) * (1 - 0.4**8)),
    (Elastic((SpringBond(2.0, 0.5, 0.3, smooth=False),)), 2.0 * 0.2 + 0.3 * 0.3),
    (Elastic((SpringBond(2.0, 0.5, 0.3, smooth=False, normalize=True),)), 2.0 * 0.2 + 0.3 * 0.3),
    (Elastic((ShellBond(2.0, 0.5, 0.3, 1.0),)), 4.0 * (0.2 + 0.2**3 / 0.5**2) + 0.3 * 0.3),
]


@pytest.mark.parametrize(("elastic", "pull"), PULLS)
def test_bond_of_length_1_at_12_that_grows_by_03(elastic: Elastic, pull: float) -> None:
    force_nc = forces(elastic, bond(1.0), 1.2, 0.3)
    assert force_nc[:, 0] == pytest.approx([pull, -pull], rel=ROUNDED) and not force_nc[:, 1].any()


def test_contact_up_to_its_cutoff_unless_bonded() -> None:
    push = 1.5 * 0.2 - 0.5 * 0.3 * (1 - (1.2 / 1.4) ** 8)
    assert forces(Elastic((), contact()), Bonds(), 1.2, 0.3)[0, 0] == pytest.approx(-push, rel=ROUNDED)
    assert not forces(Elastic((), contact()), Bonds(), 1.5, 0.3).any()
    spring = Elastic((SpringBond(0.0, 1.0, 0.0),), contact())
    assert not forces(spring, bond(1.2), 1.2).any()
    halved = Elastic((SpringBond(0.0, 1.0, 0.0),), contact(0.5))
    assert forces(halved, bond(1.2), 1.2)[0, 0] == pytest.approx(-0.5 * 1.5 * 0.2, rel=ROUNDED)


@pytest.mark.parametrize(("elastic", "pull"), [*PULLS, (Elastic((), contact()), None)])
def test_bounds_hold_one_rounding_of_every_coordinate(elastic: Elastic, pull: float | None) -> None:
    bonds = bond(1.0) if elastic.bonds else Bonds()
    by = forces(elastic, bonds, 1.2, 0.3, Rounded)
    moved = forces(elastic, bonds, np.nextafter(1.2, 2), 0.3)
    assert (np.abs(by.value - moved) <= by.error)[:, 0].all() and by.error.max() < 1e-12


def test_units_with_energies_of_their_own_are_refused() -> None:
    fix = parse_fix_rheo("fix 1 all rheo 3.0 quintic 0")
    with pytest.raises(InputError, match="must not be real or metal with bonds or contacts"):
        Model(
            *(3, fix, (1.0, 1.0), LAWS, PairRheo(3.0), (Viscosity("constant", 0.1),) * 2),
            elastic=Elastic((SPRING,)),
            units="real",
        )


@pytest.mark.parametrize(
    ("style", "coefficients", "complaint"),
    [
        ("bpm/spring", "1 1 1", "damping of bpm/spring: is missing"),
        ("bpm/spring", "3 1 1 1", "must lie within"),
        ("bpm/spring smoth yes", "1 1 1 1", "keyword of the bond style: must be one of"),
        ("rheo/shell", "* 1 1 1", "t/form: is missing"),
        ("rheo/shell t/form soon", "* 1 1 1", "t/form: must be a finite number, found 'soon'"),
        ("hybrid bpm/spring", "1 rheo/shell 1 1 1", "bond style: must be one of bpm/spring"),
    ],
)
def test_bad_commands(style: str, coefficients: str, complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        parse_bonds(style.split(), [coefficients.split()], 2)
