"""The published rate says what it leaves out: every function of the reference has a fault, or a reason why not."""

from __future__ import annotations

import fnmatch

import pytest

from tests.workshop.faults import coverage, formula, source
from tests.workshop.faults.fault import Detection
from tests.workshop.faults.record import FaultRecord, Power


def test_every_module_is_mutated_or_left_out_for_a_reason() -> None:
    modules = coverage.modules()
    unjudged = [m for m in modules if m not in source.MODULES and not coverage.left_out_because(m)]
    assert unjudged == [], "a new module: plant faults in it (source.MODULES), or say why not (coverage.LEFT_OUT)"
    both = [m for m in source.MODULES if coverage.left_out_because(m)]
    assert both == []
    patterns = [pattern for of in coverage.LEFT_OUT.values() for pattern in of]
    assert [pattern for pattern in patterns if not fnmatch.filter(modules, pattern)] == []


@pytest.mark.slow
def test_every_function_is_counted_once() -> None:
    of = coverage.coverage()
    every = [f"{module}:{name}" for module in coverage.modules() for name in coverage.functions(module)]
    without = [function for functions in of.left_out.values() for function in functions]
    assert sorted([*of.mutated, *without]) == sorted(every)
    named = {edit.function.removeprefix("eos_ref.") for edit in formula.edits().values()}
    assert named & set(every) <= set(of.mutated)
    assert of.drawn == len(source.faults()) < of.possible


@pytest.mark.slow
def test_functions_left_out_by_name_are_counted_with_their_reason() -> None:
    of = coverage.coverage()
    for reason, functions in source.EXCLUDED.items():
        untouched = set(functions) - set(of.mutated)  # a named mistake may be planted in what machines leave alone
        assert untouched == set(of.left_out.get(f"by name: {reason}", ())), reason


@pytest.mark.slow
def test_the_statement_names_all_that_is_left_out_and_single_witnesses() -> None:
    seen = [Detection(f"{file}.a", "differs", "f", "", file != "shift") for file in ("walls", "walls", "shift")]
    faults = (
        FaultRecord("source.a", "source", "source", "", ("walls.a",), True, tuple(seen[:2])),
        FaultRecord("source.b", "source", "source", "", ("walls.a", "shift.a"), True, tuple(seen)),
        FaultRecord("source.c", "source", "source", "", (), False),
    )
    power = Power("", {}, {}, whole=False, quick_only=False, seconds=0.0, controls=(), faults=faults)
    of = coverage.coverage()
    assert [fault.id for fault in power.single] == ["source.a"]
    assert [fault.id for fault in power.hidden] == ["source.a"]
    begins = "2 of 3 planted faults caught (66.7%), 1 of them by the cases of a single file, 1 only where no finding "
    assert power.statement.startswith(begins + "of the engine stands in their place; ")
    assert f"{of.unmutated} of {len(of.mutated) + of.unmutated} functions" in power.statement
    assert all(f"{len(functions)} {reason}" in power.statement for reason, functions in of.left_out.items())
