"""The harness must be able to fail: the shipped cases detect mistakes planted in the reference."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from eos_ref import EOSTable
from eos_ref.eos import laws
from lammps_cases.comparison import compare
from lammps_cases.comparison.compare import EosState, compare_field
from lammps_cases.engine.session import Answer
from lammps_cases.findings import explain_outcome
from lammps_cases.records.run_record import CaseRecord, EngineRecord
from lammps_cases.run import prepared_case
from lammps_cases.scene import casefile
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan
from lammps_cases.verdict.cases import compare_case
from lammps_cases.verdict.mistakes import LAW_MUTANTS, undetected_in_laws
from tests.support.outcome import Solver

ENGINE = EngineRecord(distribution="2025.7.22.4.0")
Solved = list[tuple[prepared_case.PreparedCase, Answer]]


@pytest.fixture(scope="module")
def solved(solver: Solver) -> Solved:
    """Return real LAMMPS' answers to the quick cases of equations of state."""
    quick = casefile.select(casefile.load(), tag="quick")
    prepared = [prepared_case.prepare(case) for case in quick if "eos" in case.tags and case.scene.expect is None]
    return [(ready, solver(job(ready.case.scene, ready.atoms, plan(ready.case.scene)))) for ready in prepared]


def judge(solved: Solved) -> list[CaseRecord]:
    return [compare_case(ready.case, ready.eos, ready.atoms, answer, ENGINE)[0] for ready, answer in solved]


@pytest.mark.lammps
def test_unchanged_reference_turns_nothing_red(solved: Solved) -> None:
    assert {record.verdict for record in judge(solved)} == {"exact"}


@pytest.mark.lammps
@pytest.mark.parametrize("mistake", LAW_MUTANTS)
def test_planted_mistake_turns_a_case_red(mistake: str, solved: Solved, monkeypatch: pytest.MonkeyPatch) -> None:
    right = compare.evaluate

    def planted(table: EOSTable, state: EosState, number: Any = np.float64) -> Any:
        wrong_n = LAW_MUTANTS[mistake](table, state) if number is np.float64 else None
        return right(table, state, number) if wrong_n is None else wrong_n

    monkeypatch.setattr(compare, "evaluate", planted)
    red = [record for record in judge(solved) if record.verdict == "differs"]
    assert red, f"no quick case sees: {mistake}"
    assert "(stage eos) leaves its bound at" in red[0].message
    assert "first atom" in red[0].message


laws_right = {name: getattr(laws, name) for name in ("linear", "cubic", "tait_water", "tait_general", "ideal_gas")}
LAW_FAULTS: dict[str, tuple[str, Callable[..., Any]]] = {
    "a constant off by 1e-12": (
        "tait_water",
        lambda rho, rho0, cs: laws_right["tait_water"](rho, rho0, cs) * (1 + 1e-12),
    ),
    "no square of cs": ("linear", lambda rho, rho0, cs: cs * (rho - rho0)),
    "exponent 2 for 3": ("cubic", lambda rho, rho0, cs, a3: cs * cs * (rho - rho0 + a3 * (rho - rho0) ** 2)),
    "rho0 left out": ("tait_general", lambda rho, rho0, cs, g: laws_right["tait_general"](rho, rho0, cs, g) / rho0),
    "gamma for gamma - 1": ("ideal_gas", lambda rho, e, g: g * rho * e),
    "one constant of water": ("tait_water", lambda rho, rho0, cs: laws_right["tait_general"](rho, rho0, cs, 7.001)),
}


@pytest.mark.lammps
@pytest.mark.parametrize("fault", LAW_FAULTS)
def test_fault_in_the_source_of_a_law_turns_a_case_red(
    fault: str, solved: Solved, monkeypatch: pytest.MonkeyPatch
) -> None:
    name, wrong = LAW_FAULTS[fault]
    monkeypatch.setattr(laws, name, wrong)
    assert any(record.verdict == "differs" for record in judge(solved))


@pytest.mark.lammps
def test_wrong_input_is_blamed_on_the_input_stage(solved: Solved) -> None:
    ready, answer = solved[0]
    rho = answer.arrays["rho"].copy()
    rho[3] = np.nextafter(rho[3], 10)  # one ulp: LAMMPS does not hold what it was given
    spoilt = Answer({**answer.arrays, "rho": rho}, answer.seconds)
    record, _ = compare_case(ready.case, ready.eos, ready.atoms, spoilt, ENGINE)
    assert record.verdict == "differs"
    assert record.message.startswith("rho (stage input) leaves its bound at 1 of")
    assert f"first atom {answer.arrays['id'][3]} " in record.message


@pytest.mark.lammps
@pytest.mark.parametrize("fault", ["lost", "doubled", "none", "exchanged"])
def test_answer_with_wrong_atoms_differs(fault: str, solved: Solved) -> None:
    ready, answer = solved[0]
    n = len(ready.atoms)
    every = np.arange(n)
    picks = {"lost": every[1:], "doubled": np.r_[0, every[:-1]], "none": every[:0], "exchanged": np.r_[1, 0, every[2:]]}
    pick = picks[fault]
    spoilt = Answer({name: values[pick] for name, values in answer.arrays.items()}, 0.0)
    record, arrays = compare_case(ready.case, ready.eos, ready.atoms, spoilt, ENGINE)
    assert record.verdict == "differs"
    assert not arrays
    assert f"LAMMPS returned {len(pick)} of {n} atoms" in record.message


@pytest.mark.lammps
def test_pressure_used_by_forces_is_compared_too(solved: Solved) -> None:
    ready, answer = solved[0]
    spoilt_n = answer.arrays["pressure"].copy()
    spoilt_n[2] *= 1 + 1e-9
    spoilt = Answer({**answer.arrays, "pressure": spoilt_n}, 0.0)
    record, _ = compare_case(ready.case, ready.eos, ready.atoms, spoilt, ENGINE)
    assert [field.verdict for field in record.fields if field.field.startswith("pressure")] == ["differs", "exact"]
    assert "pressure_used (stage eos) leaves its bound at 1 of" in record.message


def test_ending_is_explained_by_case_kind_and_message() -> None:
    style = CaseRecord(
        case="refused.unknown-style", verdict="differs", ended="refused", engine_error="ERROR: Illegal fix command, *"
    )
    assert explain_outcome(style) is not None
    assert explain_outcome(style.model_copy(update={"ended": "accepted"})) is None
    assert explain_outcome(style.model_copy(update={"engine_error": "ERROR: Illegal fix command"})) is None
    assert explain_outcome(style.model_copy(update={"case": "refused.other"})) is None


def test_empty_comparison_is_not_a_pass() -> None:
    nothing = np.empty(0)
    assert compare_field("p", "eos", np.empty(0, int), nothing, nothing, nothing).record.verdict == "differs"


ID = np.arange(1, 4)
ONE, BOUND = np.array([1.0, 2.0, 3.0]), np.full(3, 1e-15)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("side", ["lammps", "reference", "both", "bound"])
def test_non_finite_number_is_never_a_pass(bad: float, side: str) -> None:
    spoilt = np.array([1.0, bad, 3.0])
    record = compare_field(
        "pressure",
        "eos",
        ID,
        spoilt if side in ("lammps", "both") else ONE,
        spoilt if side in ("reference", "both") else ONE + (1e-16 if side == "bound" else 0.0),
        np.abs(spoilt) if side == "bound" else BOUND,
        same_order_n=spoilt,
    ).record
    if side == "bound":
        # Equal values need no bound; a difference is never within a non-finite bound.
        unequal = compare_field("p", "eos", ID, ONE, ONE * (1 + 2**-52), np.abs(spoilt)).record
        assert unequal.verdict == "differs"
        return
    assert record.verdict == "differs"
    assert record.max_over_bound == np.inf
    assert (record.outside, record.first_id, record.worst_id) == (1, 2, 2)


def test_difference_within_the_bound_passes() -> None:
    inside = compare_field("p", "eos", ID, np.array([1.0, 2.0 + 4e-16, 3.0]), ONE, BOUND).record
    outside = compare_field("p", "eos", ID, np.array([1.0, 2.0 + 4e-15, 3.0]), ONE, BOUND).record
    assert (inside.verdict, outside.verdict) == ("pass", "differs")
    assert compare_field("p", "eos", ID, ONE, ONE, BOUND).record.verdict == "exact"
    assert compare_field("p", "eos", ID, ONE, ONE + 2**-51, BOUND, same_order_n=ONE).record.verdict == "exact"
    assert compare_field("p", "eos", ID, ONE, ONE + 1e-14, BOUND, same_order_n=ONE).record.verdict == "differs"


def test_minus_zero_has_different_bits() -> None:
    zero = np.zeros(3)
    assert compare_field("p", "eos", ID, -zero, zero, BOUND).record.verdict == "pass"


def test_lint_names_mistakes_that_a_scene_cannot_detect() -> None:
    from eos_ref import EOS

    n = 50
    rho_n = np.linspace(0.5, 1.5, n)
    ids, types, masses = np.arange(1, n + 1), np.ones(n, int), np.ones(n)
    blind = EOSTable((EOS("linear"),))
    state = EosState(ids, types, rho_n, masses)
    p_n = compare.evaluate(blind, state)
    assert {"cs instead of cs^2", "rho0 and cs exchanged"} <= set(
        undetected_in_laws(blind, state, p_n, 1e-15 * np.ones(n))
    )
    sharp = EOSTable((EOS("linear", 1.2, 3.4),))
    p_n = compare.evaluate(sharp, state)
    assert undetected_in_laws(sharp, state, p_n, 1e-14 * np.ones(n)) == []
    gas = EOSTable((EOS("ideal/gas", parameter=1.4),))
    state = EosState(ids, types, rho_n, masses, np.ones(n))
    assert "energy not per unit mass" in undetected_in_laws(
        gas, state, compare.evaluate(gas, state), 1e-14 * np.ones(n)
    )
