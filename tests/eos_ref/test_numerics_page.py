"""NUMERICS.md: its tables of laws, kernels, quantities and of a worked pair are those of the reference."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import eos_ref
from eos_ref import EOS, EOSTable, FixRheo
from eos_ref.eos.registry import LAWS
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from eos_ref.kernels.styles import KERNELS
from eos_ref.model.box import Box
from eos_ref.model.parameters import Model, PairRheo, Viscosity
from eos_ref.model.quantities import QUANTITIES, keyword_of
from eos_ref.model.state import State
from eos_ref.numbers.rounded import Rounded

PAGE = Path(eos_ref.__file__).with_name("NUMERICS.md")
EPS = 2.0**-52
SYMBOLS = {"gamma": "$\\gamma$", "A3": "$A_3$"}


def pair() -> Simulation:
    """Return the two particles, evaluated."""
    law, fix = EOSTable((EOS("linear", 1.0, 1.0),)), FixRheo(3.0, "quintic", 0)
    model = Model(2, fix, (1.0,), law, PairRheo(3.0), (Viscosity("constant", 0.0),))
    x_nc, rho_n = np.array([[4.0, 4.5], [5.0, 4.5]]), np.array([1.4, 1.35])
    state = State(x_nc, np.zeros((2, 2)), rho_n, np.ones(2, int), np.zeros(2, bool))
    simulation = Simulation(model, Box((0.0, 0.0), (9.0, 9.0), (True, True)), state, ("f", "pressure_used"))
    simulation.evaluate()
    return simulation


def of_pair() -> Iterator[str]:
    """Yield the rows of the worked pair."""
    rounded = pair().rounded()
    evaluator = rounded.evaluator
    assert isinstance(evaluator, ArrayEvaluator)
    pressure = rounded.fields["pressure_used"]
    steps = {
        "$r$": [evaluator.r[0]],
        "$\\partial W_{ij}/\\partial x_i$": [evaluator.gradw[0][0]],
        "$V_i$, $V_j$": [1.0 / Rounded(rho) for rho in (1.4, 1.35)],
        "$P_i + P_j$": [pressure[0] + pressure[1]],
        "$f_x = -V_iV_j(P_i+P_j)\\,\\partial W_{ij}/\\partial x_i$": [rounded.fields["f"][0, 0]],
    }
    for step, numbers in steps.items():
        values = ", ".join(f"{float(number.value):.9g}" for number in numbers)
        yield f"| {step} | {values} | {', '.join(f'{float(number.error):.1e}' for number in numbers)} |"


def of_laws() -> Iterator[str]:
    """Yield the beginnings of the rows of formulas, then the rows of bounds at the example of each law."""
    for style, law in LAWS.items():
        yield f"| `{style}`{f' {SYMBOLS[law.parameter]}' if law.parameter else ''} | $"
    for style, law in LAWS.items():
        at = f" ({law.parameter} = {law.example:g})" if law.parameter else ""
        terms = law.terms_text.replace("|", "\\|")
        yield f"| `{style}`{at} | {law.roundings(law.example or 0.0):g} | {terms} | {law.reference_eps:g} |"


def of_kernels() -> Iterator[str]:
    """Yield the rows of the kernel styles."""
    for style, corrected in KERNELS.items():
        kernel = corrected.kernel
        order = corrected.order if corrected.order >= 0 else "none"
        yield f"| `{style}` | {kernel.name}, $r_c = {kernel.support:g}h$ | {order} | {corrected.about} |"


def of_quantities() -> Iterator[str]:
    """Yield the rows of the quantities."""
    for name, quantity in QUANTITIES.items():
        kind = ("scalar", "vector", "tensor")[quantity.rank]
        own = "output" if quantity.inputs is None else "evaluation"
        of = "state" if quantity.integrated else f"with `{quantity.part_of}`" if quantity.part_of else own
        yield f"| `{name}` | {quantity.about} | {kind} | {of} | {keyword_of(name) or ''} |".replace("|  |", "| |")


@pytest.mark.parametrize("rows", [of_pair, of_laws, of_kernels, of_quantities])
def test_tables_match_the_reference(rows: Callable[[], Iterator[str]]) -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert [row for row in rows() if f"\n{row}" not in text] == []


def test_statements_on_the_bound() -> None:
    text = PAGE.read_text(encoding="utf-8")
    force = pair().rounded().fields["f"][0, 0]
    bound = float(force.error)
    assert f"{bound / (EPS * abs(float(force.value))):.0f} $\\varepsilon|f_x|$" in text
    lacking = abs(float(force.value)) * (1.4 - 1.0)  # the force on i without V_i = 1/1.4
    assert f"{lacking / bound:.0e} bounds" in text
