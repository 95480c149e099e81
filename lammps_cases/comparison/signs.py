"""Random signs, by which runs are moved."""

from __future__ import annotations

import math

import numpy as np

from eos_ref.eos.table import FloatArray

DRAWN = 1024  # at a time: a draw takes as long as several hundred signs
_SIGNS = np.array((-1.0, 1.0))


class Signs:
    """Random signs: those of ``random.choice((-1.0, 1.0), shape)``, of which many are drawn at a time.

    Parameters
    ----------
    kept : whether those of one name and shape stay the same, whenever they are asked for
    """

    def __init__(self, random: np.random.Generator, kept: bool = False) -> None:
        self._random, self._left = random, np.empty(0)
        self._kept: dict[tuple[str, tuple[int, ...]], FloatArray] | None = {} if kept else None

    def __call__(self, name: str, shape: tuple[int, ...]) -> FloatArray:
        """Return those by which a quantity is moved next."""
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
