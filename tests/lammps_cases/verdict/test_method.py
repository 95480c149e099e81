"""Scenes that say how the reference evaluates: the choice is shown, used, and its tolerance is what bounds allow."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eos_ref import EOSTable
from eos_ref.methods import choice
from lammps_cases.comparison.compare import State, compare_pressure, evaluate
from lammps_cases.comparison.trajectory import own_stages
from lammps_cases.engine.workers import Workers
from lammps_cases.run import campaign
from lammps_cases.scene import casefile
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan
from lammps_cases.verdict.judgement import methods_of, particles_of
from tests.support.outcome import Outcome

Write = Callable[..., Path]
Run = Callable[..., Outcome]


def prepared(path: Path) -> campaign.Prepared:
    return campaign.prepare(casefile.load((path,))[0])


def state_of(ready: campaign.Prepared) -> tuple[EOSTable, State]:
    atoms = ready.atoms
    assert ready.eos is not None
    assert atoms.rho_n is not None
    return ready.eos, State(atoms.id_n, atoms.type_n, atoms.rho_n, atoms.mass_n)


def test_the_method_of_the_scene_is_the_one_that_is_evaluated(case_file: Write) -> None:
    ready = prepared(case_file(method="table, linear"))
    eos, state = state_of(ready)
    choices = methods_of(ready.case, eos, state.type_n, state.rho_n, None)
    assert [chosen.method.name for chosen in choices] == ["table, linear"]
    by_table, by_default = evaluate(eos, state, choices=choices), evaluate(eos, state)
    assert (by_table != by_default).any()
    assert np.allclose(by_table, by_default, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-6, 1e-12])
def test_what_leaves_the_tolerance_differs_and_what_stays_within_passes(case_file: Write, tolerance: float) -> None:
    ready = prepared(case_file(method="auto", tolerance=tolerance, rho={"offset": {"low": 1e-2, "high": 0.2}}))
    eos, state = state_of(ready)
    choices = methods_of(ready.case, eos, state.type_n, state.rho_n, None)
    exact_n = evaluate(eos, state)
    for factor, verdict in ((0.9, "pass"), (2.1, "differs")):
        wrong_n = exact_n.copy()
        wrong_n[3] *= 1 + factor * tolerance
        found = compare_pressure(eos, state, wrong_n, choices=choices)
        assert found.record.verdict == verdict
        assert found.record.first_id == (None if verdict == "pass" else 4)
    assert f"{tolerance:.2g} of the terms for the method" in found.record.derivation


def test_without_a_method_no_bound_is_wider(case_file: Write) -> None:
    ready = prepared(case_file())
    eos, state = state_of(ready)
    choices = methods_of(ready.case, eos, state.type_n, state.rho_n, None)
    p_n = evaluate(eos, state)
    plain, chosen = compare_pressure(eos, state, p_n), compare_pressure(eos, state, p_n, choices=choices)
    assert np.array_equal(plain.bound_n, chosen.bound_n)
    assert np.array_equal(plain.reference_n, chosen.reference_n)


@pytest.mark.parametrize(("method", "tolerance"), [("auto", 1e-4), ("auto", 1e-13), ("table, cubic", None)])
def test_explain_names_the_method_and_the_run_uses_it(
    case_file: Write, eos_ref_command: Run, tmp_path: Path, method: str, tolerance: float | None
) -> None:
    path = case_file(method=method, tolerance=tolerance, pressure=[{"types": "*", "style": "tait/water"}])
    explained = eos_ref_command("explain", "mine", "--cases", path, "--json")
    [chosen] = json.loads(explained.out)["cases"][0]["methods"]
    assert chosen["of"] == "type 1"
    assert "worst error" in chosen["why"]
    done = eos_ref_command("run", "mine", "--cases", path, "--out", tmp_path / "out", "--json")
    assert done.code == 0
    [field] = [f for f in json.loads(done.out)["cases"][0]["fields"] if f["field"] == "pressure"]
    assert f"for the method {chosen['method']} (" in field["derivation"]


@pytest.mark.parametrize("stages", ["plain", "compiled"])
def test_the_whole_model_can_name_its_stages(
    case_file: Write, eos_ref_command: Run, tmp_path: Path, stages: str
) -> None:
    path = case_file(method=stages, compare=["coordination", "f", "grad/v"], velocity={"random": 0.3})
    done = eos_ref_command("run", "mine", "--cases", path, "--out", tmp_path / "out", "--json")
    fields: list[dict[str, Any]] = json.loads(done.out)["cases"][0]["fields"]
    assert {f["field"]: f["verdict"] for f in fields}["grad/v"] in ("pass", "exact")
    ready = prepared(path)
    scene = particles_of(ready.case.scene, ready.atoms, "", ready.case.scene.snapshots)
    assert own_stages(scene).__name__ == {"plain": "Plain", "compiled": "Fast"}[stages]
    explained = json.loads(eos_ref_command("explain", "mine", "--cases", path, "--json").out)
    assert explained["cases"][0]["methods"] == [{"of": "all stages", "method": stages, "why": "as the scene says"}]


def test_stages_are_compiled_once_that_is_the_cheaper_way() -> None:
    """Little work is not worth loading compiled loops; the change comes where both cost the same."""
    costs = {name: choice.Cost(**each) for name, each in choice.measured()["stages"].items()}
    plain, compiled = costs["plain"], costs["compiled"]
    same = (compiled.startup - plain.startup) / (plain.ns - compiled.ns) * 1e9
    assert choice.stages(int(0.99 * same)) == "plain"
    assert choice.stages(int(1.01 * same)) == "compiled"


def test_densities_of_an_evolving_scene_choose_after_the_answer(case_file: Write) -> None:
    """The densities that count are LAMMPS' own at the end, so the choice is made for them."""
    path = case_file(method="auto", tolerance=1e-9, evolve={"steps": 5, "timestep": 1e-3}, velocity={"random": 0.1})
    ready = prepared(path)
    with Workers(None, 1) as workers:
        told = job(ready.case.scene, ready.atoms, plan(ready.case.scene))
        answer = workers.outcome(workers.submit(told, 60.0))
    record, _ = campaign.judge(None, ready, [answer], campaign.EngineRecord(distribution="2025.7.22.4.0"))
    assert record.verdict in ("exact", "pass")
    [field] = [f for f in record.fields if f.field == "pressure"]
    assert f"over rho from {answer.arrays['rho'].min():g} to" in field.derivation
