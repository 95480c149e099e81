"""Judgement of a law alone: the pressure used by the forces and the output pressure, atom by atom."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lammps_cases.comparison.compare import EosState, evaluate
from lammps_cases.engine.session import Answer
from lammps_cases.records.run_record import CaseRecord, EngineRecord
from lammps_cases.run import prepared_case
from lammps_cases.run.prepared_case import PreparedCase
from lammps_cases.scene import casefile
from lammps_cases.verdict.case_arrays import Arrays
from lammps_cases.verdict.cases import compare_laws
from lammps_cases.verdict.outcome import blank_record
from tests.support import made_answers

GAS = {"pressure": [{"types": "*", "style": "ideal/gas", "gamma": 1.4}], "energy": {"range": [0.5, 2.5]}}


@pytest.fixture
def gas(case_file: Callable[..., Path]) -> PreparedCase:
    return prepared_case.prepare(casefile.load((case_file(**GAS),))[0])


def answer_of(ready: PreparedCase) -> Answer:
    atoms = ready.atoms
    assert atoms.rho_n is not None and ready.eos is not None
    p_n = evaluate(ready.eos, EosState(atoms.id_n, atoms.type_n, atoms.rho_n, atoms.mass_n, atoms.energy_n))
    return Answer(made_answers.given(atoms) | {"pressure": p_n, "q.pressure": p_n.copy()}, made_answers.SECONDS)


def judged(ready: PreparedCase, answer: Answer) -> tuple[CaseRecord, Arrays]:
    assert ready.eos is not None
    record = blank_record(ready.case, ready.eos, ready.atoms, EngineRecord(distribution="2099.1.1"))
    return record, compare_laws(record, ready.case, ready.eos, ready.atoms, answer)


def test_same_bits_are_exact_and_arrays_have_the_energy_per_mass(gas: PreparedCase) -> None:
    record, arrays = judged(gas, answer_of(gas))
    assert (record.verdict, record.ended, record.blame) == ("exact", "answered", None)
    assert gas.atoms.energy_n is not None
    assert np.array_equal(arrays["e"], gas.atoms.energy_n / gas.atoms.mass_n)


@pytest.mark.parametrize(("key", "field"), [("pressure", "pressure_used"), ("q.pressure", "pressure")])
def test_atom_outside_its_bound_is_blamed(key: str, field: str, gas: PreparedCase) -> None:
    answer = answer_of(gas)
    of_atom = np.array(answer.arrays[key])
    of_atom[4] *= 1.5
    record, _ = judged(gas, replace(answer, arrays={**answer.arrays, key: of_atom}))
    blame = record.blame
    assert record.verdict == "differs" and blame is not None
    assert (blame.field, blame.stage, blame.atom, blame.outside, blame.of) == (field, "eos", 5, 1, len(gas.atoms))
    assert blame.lammps == of_atom[4] and blame.reference == answer.arrays[key][4]
    assert blame.bound is not None and abs(blame.lammps - blame.reference) > blame.bound


def test_law_is_evaluated_at_the_density_that_lammps_holds(gas: PreparedCase) -> None:
    """A density other than the given one is blamed first, not the pressure that follows from it."""
    answer = answer_of(gas)
    rho_n = np.array(answer.arrays["rho"])
    rho_n[2] *= 1.01
    state = EosState(gas.atoms.id_n, gas.atoms.type_n, rho_n, gas.atoms.mass_n, gas.atoms.energy_n)
    assert gas.eos is not None
    p_n = evaluate(gas.eos, state)
    record, _ = judged(gas, replace(answer, arrays={**answer.arrays, "rho": rho_n, "pressure": p_n, "q.pressure": p_n}))
    assert {field.field: field.verdict for field in record.fields}["pressure"] == "exact"
    assert record.verdict == "differs" and record.blame is not None and record.blame.field == "rho"
