"""The worked pair of NUMERICS.md: its table is what the reference computes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from eos_ref import EOS, EOSTable, FixRheo
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.box import Box
from eos_ref.model.parameters import Model, PairRheo, Viscosity
from eos_ref.model.state import State
from eos_ref.numbers.rounded import Rounded

PAGE = Path(__file__).parents[2] / "eos_ref" / "NUMERICS.md"
EPS = 2.0**-52


def pair() -> Simulation:
    """Return the two particles, evaluated."""
    law, fix = EOSTable((EOS("linear", 1.0, 1.0),)), FixRheo(3.0, "quintic", 0)
    model = Model(2, fix, (1.0,), law, PairRheo(3.0), (Viscosity("constant", 0.0),))
    x_nc, rho_n = np.array([[4.0, 4.5], [5.0, 4.5]]), np.array([1.4, 1.35])
    state = State(x_nc, np.zeros((2, 2)), rho_n, np.ones(2, int), np.zeros(2, bool))
    simulation = Simulation(model, Box((0.0, 0.0), (9.0, 9.0), (True, True)), state, ("f", "pressure_used"))
    simulation.evaluate()
    return simulation


def rows() -> list[str]:
    """Return the table of the page, line by line."""
    rounded = pair().rounded()
    evaluator = rounded.evaluator
    assert isinstance(evaluator, ArrayEvaluator)
    distance, gradient = evaluator.r[0], evaluator.gradw[0][0]
    volume = [1.0 / Rounded(rho) for rho in (1.4, 1.35)]
    pressure = rounded.fields["pressure_used"]
    total, force = pressure[0] + pressure[1], rounded.fields["f"][0, 0]

    def row(step: str, *numbers: Rounded) -> str:
        values = ", ".join(f"{float(number.value):.9g}" for number in numbers)
        errors = ", ".join(f"{float(number.error):.1e}" for number in numbers)
        return f"| {step} | {values} | {errors} |"

    return [
        row("$r$", distance),
        row("$\\partial W_{ij}/\\partial x_i$", gradient),
        row("$V_i$, $V_j$", *volume),
        row("$P_i + P_j$", total),
        row("$f_x = -V_iV_j(P_i+P_j)\\,\\partial W_{ij}/\\partial x_i$", force),
    ]


def test_table_matches_the_reference() -> None:
    text = PAGE.read_text(encoding="utf-8")
    for row in rows():
        assert row in text, f"NUMERICS.md must read {row}"


def test_statements_on_the_bound() -> None:
    text = PAGE.read_text(encoding="utf-8")
    force = pair().rounded().fields["f"][0, 0]
    bound = float(force.error)
    assert f"{bound / (EPS * abs(float(force.value))):.0f} $\\varepsilon|f_x|$" in text
    lacking = abs(float(force.value)) * (1.4 - 1.0)  # the force on i without V_i = 1/1.4
    assert f"{lacking / bound:.0e} bounds" in text
