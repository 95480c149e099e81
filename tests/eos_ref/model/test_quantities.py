"""The stages that requested fields need: no more than necessary, in order, and no others are evaluated."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

from eos_ref import InputError
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.quantities import QUANTITIES, needed_to_step, order, required
from eos_ref.syntax.fixes import Shift, SurfaceDetection
from tests.support.particle_scenes import HOT, POWER, RECIPES, Scene, bounded, everything, recipe, scene

STAGES = {
    "move": "pairs",
    "density_sum": "rho",
    "correct": "correction",
    "interface": "chi",
    "gradients": "gradients",
    "shift": "shift/v",
    "surface": "surface",
    "viscosity": "viscosity",
    "pressure": "pressure",
    "temperature": "temperature",
    "pair_terms": "pair_terms",
}


class Spy(ArrayEvaluator):
    """Records the stages that are called from outside."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.called: list[str] = []
        self.deep = 0


def _spied(name: str) -> Any:
    def method(self: Spy, *arguments: Any, **keywords: Any) -> Any:
        if not self.deep:
            self.called.append(name)
        self.deep += 1
        try:
            return getattr(ArrayEvaluator, name)(self, *arguments, **keywords)
        finally:
            self.deep -= 1

    return method


for _name in STAGES:
    setattr(Spy, _name, _spied(_name))


def called(built: Scene, *fields: str) -> list[str]:
    simulation = built.simulate(fields, Spy)
    simulation.evaluate()
    assert isinstance(simulation.evaluator, Spy)
    return list(simulation.evaluator.called)


@pytest.mark.parametrize(
    ("options", "fields", "stages"),
    [
        ({}, ["pressure"], ["pressure"]),
        ({}, ["coordination"], ["move"]),
        ({}, ["rho"], []),
        ({"rho_sum": True}, ["rho"], ["move", "density_sum"]),
        ({"rho_sum": True, "kernel": "RK1", "thermal": HOT}, ["rho"], ["move", "density_sum"]),
        ({"rho_sum": True}, ["pressure"], ["move", "density_sum", "pressure"]),
        ({"kernel": "RK2"}, ["viscosity"], ["viscosity"]),
        ({"kernel": "RK2", "viscosity": POWER}, ["viscosity"], ["move", "correct", "gradients", "viscosity"]),
        ({"kernel": "RK1"}, ["grad/v"], ["move", "correct", "gradients"]),
        ({"kernel": "RK0"}, ["grad/v"], ["move", "correct", "gradients"]),
        ({"walls": True}, ["chi"], ["move", "interface"]),
        ({"walls": True}, ["pressure_used"], ["move", "interface", "pressure"]),
        ({"shift": Shift()}, ["shift/v"], ["move", "shift"]),
        (
            {"shift": Shift(), "surface": SurfaceDetection("divergence", 1.7, 9)},
            ["shift/v"],
            ["move", "shift", "surface"],
        ),
        ({"surface": SurfaceDetection("divergence", 1.7, 9)}, ["status"], ["move", "surface"]),
        ({"thermal": HOT}, ["temperature"], ["temperature"]),
        ({"artificial": 0.5}, ["f"], ["move", "gradients", "viscosity", "pressure", "pressure", "pair_terms"]),
    ],
)
def test_only_what_is_needed_is_evaluated(options: dict[str, Any], fields: list[str], stages: list[str]) -> None:
    found = called(scene(**options), *fields)
    if options.get("kernel") == "RK0":  # a kernel without corrected gradients corrects nothing
        stages = [stage for stage in stages if stage != "correct"]
    assert found == stages


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("name", RECIPES)
def test_any_one_field_alone_is_the_same(name: str, dimension: int) -> None:
    """Every field requested alone equals, to the last bit, the same field among all others."""
    built = recipe(name, dimension)
    whole = built.simulate()
    whole.evaluate()
    for field in everything(built.model):
        if field in ("pairs", "kernel", "correction"):
            continue
        alone = built.simulate([field])
        alone.evaluate()
        assert np.array_equal(alone.output(field), whole.output(field), equal_nan=False), field


@pytest.mark.parametrize("name", RECIPES)
def test_steps_evaluate_only_what_they_need(name: str) -> None:
    built = recipe(name, 2)
    lean, rich = built.simulate([]), built.simulate()
    assert set(lean.plan) <= set(rich.plan)
    for simulation in (lean, rich):
        simulation.run(2, 2.0**-9)
    for a, b in (
        (lean.state.x_nc, rich.state.x_nc),
        (lean.state.v_nc, rich.state.v_nc),
        (lean.state.rho_n, rich.state.rho_n),
    ):
        assert np.array_equal(a, b)


@pytest.mark.parametrize("name", RECIPES)
def test_plans_are_closed_and_in_order(name: str) -> None:
    model = recipe(name, 2).model
    has = everything(model)
    wishes = [*itertools.combinations(has, 1), *itertools.combinations(has, 2), has, needed_to_step(model)]
    for wish in wishes:
        plan = required(model, wish)
        assert set(wish) <= set(plan)
        assert [order().index(q) for q in plan] == sorted(order().index(q) for q in plan)
        for quantity in plan:
            for needed in QUANTITIES[quantity].needs(model):
                if needed in order():
                    assert needed in plan
                    assert plan.index(needed) < plan.index(quantity), (quantity, needed)


def test_records_refer_to_each_other() -> None:
    for name, quantity in QUANTITIES.items():
        assert quantity.name == name
        assert {quantity.whole, quantity.completed_by or "rho"} <= set(QUANTITIES)
        assert (quantity.part_of == "") or quantity.part_of in order()


def test_bounds_cover_every_field() -> None:
    """Fields of an evaluation and of its bounds are the same set."""
    built = recipe("walls, thermal", 2)
    assert {"f", "grad/v", "grad/rho", "grad/energy", "heatflow", "chi", "shift/v"} <= bounded(built).keys()


@pytest.mark.parametrize("fields", [("drho", "grad/v"), ("pressure",)])
def test_steps_and_outputs_need_what_was_evaluated(fields: tuple[str, ...]) -> None:
    built = scene()
    sim = Simulation(built.model, built.box, built.state, fields)
    sim.setup()
    with pytest.raises(InputError, match="was not evaluated"):
        sim.output("f")
    with pytest.raises(InputError, match="fields: must name what time steps need: f"):
        sim.step(0.01)


def test_worked_plans() -> None:
    rich = scene(kernel="RK2", artificial=0.5, thermal=HOT)
    assert required(scene(rho_sum=True, artificial=0.5, thermal=HOT).model, ["rho"]) == ("pairs", "kernel", "rho")
    assert required(rich.model, ["pressure"]) == ("rho", "pressure"), "no pairs"
    assert required(scene().model, ["status"]) == required(scene().model, []) == (), "without surfaces, too"
    assert required(rich.model, ["f", "f", "rho"]) == required(rich.model, ["rho", "f"])


NO_FIELDS = ("", "F", "grad", "grad/v/xx", "pressures", "f ")
MISSING = (
    *("shift/v", "surface", "surface/r", "surface/n", "surface/divr", "chi"),
    *("temperature", "heatflow", "energy", "conductivity", "cv"),
)


@pytest.mark.parametrize(
    ("field", "rule"),
    [
        *[(field, "field: must be one of pairs, ") for field in NO_FIELDS],
        *[(field, f"field: is not part of this model .*found '{field}'") for field in MISSING],
    ],
)
def test_unavailable_fields_are_refused(field: str, rule: str) -> None:
    with pytest.raises(InputError, match=rule) as caught:
        required(scene().model, ["f", field])
    assert repr(field) in str(caught.value) and "\n" not in str(caught.value)
