"""Named random numbers: every key of a scene has its own stream, independent of all other keys.

A stream depends on the seed, the number of the draw and the place of the key alone, and numbers are rounded to few
digits. So a draw is the same on any machine, in any order, and a new key leaves the others unchanged.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TypeVar

import numpy as np

from lammps_cases.scene.atoms import seed

T = TypeVar("T")
DIGITS = 3  # of numbers drawn: the last bit of a logarithm differs from one machine to another


def rounded(value: float, digits: int = DIGITS) -> float:
    """Round a number to a few significant digits."""
    return float(f"{value:.{digits - 1}e}")


class Chance:
    """A stream of random numbers.

    Parameters
    ----------
    name : str
        Determines the stream: seed, draw and place.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        # Only its doubles are used, which depend on the bits alone; see NEP 19 of numpy on its other methods.
        self._stream = np.random.Generator(np.random.PCG64(seed(name)))

    def at(self, place: object) -> Chance:
        """Return the stream of a place below this one."""
        return Chance(f"{self.name}/{place}")

    def share(self) -> float:
        """Return a number from 0 to 1."""
        return float(self._stream.random())

    def coin(self, probability: float = 0.5) -> bool:
        """Return true with a probability."""
        return self.share() < probability

    def whole(self, low: int, high: int) -> int:
        """Return a whole number, both ends included."""
        return low + int(self.share() * (high - low + 1))

    def choice(self, values: Sequence[T]) -> T:
        """Return one of some values, with equal probability."""
        return values[self.whole(0, len(values) - 1)]

    def weighted(self, weights: Mapping[T, float]) -> T:
        """Return one of some values by their weights."""
        left = self.share() * sum(weights.values())
        for value, weight in weights.items():
            left -= weight
            if left < 0:
                return value
        return list(weights)[-1]

    def some(self, values: Sequence[T], probability: float) -> list[T]:
        """Return each of some values with a probability, in their order."""
        return [value for value in values if self.coin(probability)]

    def number(self, low: float, high: float) -> float:
        """Return a positive number, distributed uniformly in its logarithm."""
        return rounded(low * math.exp(self.share() * math.log(high / low)))

    def between(self, low: float, high: float) -> float:
        """Return a number, distributed uniformly."""
        return rounded(low + self.share() * (high - low))

    def vector(self, axes: int, size: float) -> list[float]:
        """Return components of a size up to the one given; some are 0."""
        return [0.0 if self.coin(0.15) else self.between(-size, size) for _ in range(axes)]
