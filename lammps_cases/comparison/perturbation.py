"""Perturbations: random signs that move runs, and input moved by the rounding of a change of units.

The factor of a quantity is a product of powers of three base units and the ratio of two units of its own. Its roundings
are at most 2 in each of 3 powers, 1 in each of up to 5 factors of these, 2 products, 2 in the ratio, and 1 each in the
product with the ratio and with the number: 17.
"""

from __future__ import annotations

import math
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.syntax.fixes import Shift
from lammps_cases.comparison.problem import Problem

ROUNDING = 17 * 2.0**-53
# The cutoff occurs twice in a model, and must be one number; positions move against it. The others are pure numbers,
# some of which are compared with counts.
EXACT = ("cut", "surface_detection", "dimension", "zmin")
DRAWN = 1024  # signs at a time: the overhead of a draw equals several hundred signs
_SIGNS = np.array((-1.0, 1.0))


class Signs:
    """Random signs, equal to those of ``random.choice((-1.0, 1.0), shape)``, many drawn at a time.

    Parameters
    ----------
    kept : whether the signs of one name and shape are the same at every draw
    """

    def __init__(self, random: np.random.Generator, kept: bool = False) -> None:
        self._random, self._left = random, np.empty(0)
        self._kept: dict[tuple[str, tuple[int, ...]], FloatArray] | None = {} if kept else None

    def __call__(self, name: str, shape: tuple[int, ...]) -> FloatArray:
        """Return the signs for the next move of a quantity."""
        if self._kept is None:
            return self._next(shape)
        if (name, shape) not in self._kept:
            self._kept[name, shape] = self._next(shape)
        return self._kept[name, shape]

    def _next(self, shape: tuple[int, ...]) -> FloatArray:
        size = math.prod(shape)
        if size > len(self._left):
            drawn = self._random.integers(0, 2, max(DRAWN, size))
            self._left = np.concatenate([self._left, _SIGNS[drawn]])
        signs, self._left = self._left[:size], self._left[size:]
        return signs.reshape(shape)


def moved_input(problem: Problem, random: np.random.Generator) -> Problem:
    """Return a problem with every number of the model and the state moved by `ROUNDING`, up or down."""

    def sign(shape: tuple[int, ...] = ()) -> Any:
        return 1 + ROUNDING * random.choice((-1.0, 1.0), shape)

    def moved(part: Any) -> Any:
        if isinstance(part, float):
            return float(part * sign())
        if isinstance(part, tuple):
            return tuple(moved(each) for each in part)
        if not is_dataclass(part) or isinstance(part, type):
            return part
        names = (field.name for field in fields(part) if field.init and field.name not in EXACT)
        moved_parts = {name: moved(getattr(part, name)) for name in names}
        if isinstance(part, Shift) and part.scale_cross_type:  # the first is a fraction, which may be 1 and no more
            moved_parts["scale_cross_type"] = (part.scale_cross_type[0], *moved_parts["scale_cross_type"][1:])
        return replace(part, **moved_parts)

    s = problem.state
    x_nc, v_nc, rho_n = (array * sign(array.shape) for array in (s.x_nc, s.v_nc, s.rho_n))
    energy_n = None if s.energy_n is None else s.energy_n * sign(s.energy_n.shape)
    mass_n = None if s.mass_n is None else s.mass_n * sign(s.mass_n.shape)
    state = replace(s, x_nc=x_nc, v_nc=v_nc, rho_n=rho_n, energy_n=energy_n, mass_n=mass_n)
    return replace(problem, model=moved(problem.model), state=state, timestep=float(problem.timestep * sign()))
