r"""A kernel that fix rheo does not have, Wendland's C2 of support 2h, through both evaluators and all of the harness.

The evaluators receive its object: support, normalisation, shape and slope; the double loop has its own copy. In a copy
of the packages it is a module, its styles and their rows in NUMERICS.md.
Source: Wendland, Adv. Comput. Math. 4, 389 (1995); Dehnen & Aly, MNRAS 425, 1068 (2012), table 1 (their r is q/2).
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eos_ref.compiled.evaluator import CompiledEvaluator
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.kernels.kernel import Kernel
from eos_ref.kernels.styles import KERNELS, Corrected
from eos_ref.numbers.elementary import maximum
from eos_ref.numbers.rounded import error
from eos_ref.syntax.fixes import Shift, SurfaceDetection
from tests.support.double_loop import PI, DoubleLoop, L, ScalarKernel
from tests.support.particle_scenes import POWER, results, scene
from tests.support.walk import after, walk

pytestmark = pytest.mark.slow


def shape(q: Any) -> Any:
    a = maximum(1 - 0.5 * q, 0.0)
    aa = a * a
    return aa * aa * (1 + 2 * q)


def slope(q: Any) -> Any:
    a = maximum(1 - 0.5 * q, 0.0)
    return -5 * q * (a * a * a)


def normalisation(dimension: int, h: float) -> float:
    return 7 / (4 * math.pi * h**2) if dimension == 2 else 21 / (16 * math.pi * h**3)


WENDLAND = Kernel("Wendland C2", support=2.0, factor=normalisation, shape=shape, slope=slope)
FROM_TEXT = ScalarKernel(
    2,
    lambda q: max(1 - q / 2, L(0)) ** 4 * (2 * q + 1),
    lambda q: 2 * max(1 - q / 2, L(0)) ** 4 - 2 * max(1 - q / 2, L(0)) ** 3 * (2 * q + 1),
    lambda d, h: L(7) / (4 * PI * h**2) if d == 2 else L(21) / (16 * PI * h**3),
)
ORDERS = {"wendland": -1, "wendland RK1": 1, "wendland RK2": 2}
SCENES: dict[str, dict[str, Any]] = {
    "plain": {"kernel": "wendland", "artificial": 0.75, "damp": 0.125, "shift": Shift(), "viscosity": POWER},
    "summed": {"kernel": "wendland", "rho_sum": True, "shift": Shift((), (0.3, 0.35, 0.2))},
    "surface": {"kernel": "wendland", "surface": SurfaceDetection("divergence", 1.7, 13), "shift": Shift()},
    "RK1": {"kernel": "wendland RK1", "artificial": 0.75, "damp": 0.125, "shift": Shift(), "walls": True},
    "RK2": {"kernel": "wendland RK2", "artificial": 0.75, "damp": 0.125, "shift": Shift()},
}


@pytest.fixture(autouse=True)
def styles(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, order in ORDERS.items():
        monkeypatch.setitem(KERNELS, name, Corrected(WENDLAND, order, ""))


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_normalisation_is_that_of_the_shape(dimension: int) -> None:
    """Gauss's rule of 8 nodes is exact: a polynomial of degree 7 on the whole support."""
    node, weight = np.polynomial.legendre.leggauss(8)
    q_n, cut = node + 1, 2.625
    sphere = 2 * math.pi if dimension == 2 else 4 * math.pi
    integral = sphere * np.sum(weight * shape(q_n) * q_n ** (dimension - 1)) * (cut / 2) ** dimension
    # A node off by an eps shifts values by an eps of their slope, which adds up to twice the largest value (below 1/2);
    # the value itself takes 12 operations, the sum 8.
    values_n = shape(q_n) * q_n ** (dimension - 1)
    eps = np.finfo(float).eps
    bound = float(eps * (2 * values_n.max() / np.sum(weight * values_n) + 20 / 2))
    assert abs(integral * WENDLAND.normalisation(dimension, cut) - 1) < bound
    assert WENDLAND.self_value(dimension, cut) == WENDLAND.normalisation(dimension, cut)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("name", SCENES)
def test_both_evaluators_against_the_double_loop(name: str, dimension: int) -> None:
    """Within the rounding bound of the plain evaluator, itself below 1e-9 of the largest value."""
    built = scene(dimension, **SCENES[name])
    expected = DoubleLoop(built, FROM_TEXT).evaluate()
    bound = results(built.simulate().rounded())
    of_quintic = DoubleLoop(built).evaluate()
    for evaluator in (ArrayEvaluator, CompiledEvaluator):
        simulation = built.simulate(evaluator=evaluator)
        simulation.evaluate()
        found = results(simulation)
        assert found.keys() == expected.keys()
        for field, values in found.items():
            errors = error(bound[field])
            assert (np.abs(values - np.array(expected[field], L)) <= errors).all(), f"{evaluator.__name__}: {field}"
            assert errors.max() <= 1e-9 * max(np.abs(values).max(), 1.0), field
        assert (np.abs(found["f"] - np.array(of_quintic["f"], L)) > error(bound["f"])).any(), "the kernel is not used"


MODULE = '''"""Wendland's C2."""

import math

from eos_ref.kernels.kernel import Kernel
from eos_ref.numbers.elementary import maximum


def wendland(q):
    """Return the shape."""
    a = maximum(1 - 0.5 * q, 0.0)
    return a * a * (a * a) * (1 + 2 * q)


def wendland_slope(q):
    """Return its derivative."""
    a = maximum(1 - 0.5 * q, 0.0)
    return -5 * q * (a * a * a)


def normalisation(dimension, h):
    """Return the factor of an integral of 1."""
    return 7 / (4 * math.pi * h**2) if dimension == 2 else 21 / (16 * math.pi * h**3)


WENDLAND = Kernel("Wendland C2", support=2.0, factor=normalisation, shape=wendland, slope=wendland_slope)
'''
RECORDS = """    "wendland": Corrected(WENDLAND, -1, "smooth"),
    "WRK1": Corrected(WENDLAND, 1, "smooth and exact"),
}
"""
ROWS = """| `wendland` | Wendland C2, $r_c = 2h$ | none | smooth |
| `WRK1` | Wendland C2, $r_c = 2h$ | 1 | smooth and exact |
"""
EDITS = {
    "eos_ref/kernels/wendland.py": lambda text: MODULE,
    "eos_ref/kernels/styles.py": lambda text: text.replace("\n}\n", f"\n{RECORDS}", 1).replace(
        "\n\n\n@dataclass", "\nfrom eos_ref.kernels.wendland import WENDLAND\n\n\n@dataclass", 1
    ),
    "eos_ref/NUMERICS.md": after("gradients of quadratic fields are exact |\n", ROWS),
}


def test_new_kernel_is_complete_in_three_files(tmp_path: Path) -> None:
    assert len(EDITS) <= 3
    assert walk(tmp_path, EDITS, "use_new_kernel.py") == "wendland WRK1"
