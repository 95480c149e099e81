"""Pairs at the cutoff: where rounding decides whether they count, the coordination is open."""

from __future__ import annotations

from typing import Any

import numpy as np

from eos_ref.eos import bounds
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.pairs import separations
from eos_ref.model.box import Box
from eos_ref.numbers.rounded import Rounded, value


def rounding_at(cut: float, x_nc: Any, box: Box) -> float:
    """Return how far the distance of a pair at the cutoff may lie apart in two codes.

    Each coordinate of a pair is a difference of two, of which one may have been moved by a period, and rounded on
    either side; so are the squares, their sum and the root.
    """
    reach = float(np.abs(x_nc).max(initial=0.0)) + np.abs(box.cell_cc).sum(axis=0).max()
    return float(8 * bounds.EPS * (reach + cut) + 4 * box.rounding(cut).max())


class AtCutoff(ArrayEvaluator):
    """Pairs so close to the cutoff that rounding decides whether they count leave the coordination open.

    ``spread``: by how much distances may be off beyond that, if positions are known to some digits only.
    """

    spread = 0.0

    def count(self, x_nc: Any) -> None:
        """Count the pairs, and those that may as well be on the other side."""
        super().count(x_nc)
        cut, x = self.model.cut, value(x_nc)
        width = rounding_at(cut, x, self.box) + self.spread
        i, j, shift_pc = self.pairs(x.astype(float), cut + 2 * width)
        r = separations(x, i, j, shift_pc)
        near_n = np.bincount(i[r > cut - width], minlength=self.n)
        self.counted_n = Rounded(self.coordination_n, near_n)
        if near_n.any():
            certain_n = np.bincount(i[r <= cut - width], minlength=self.n)
            # Whole numbers from certain to certain + near; the quarter makes "less than a whole number" open just if
            # some of them are less and some are not.
            self.coordination_n = Rounded(certain_n + 0.5 * near_n + 0.25, 0.5 * near_n)

    def counted(self) -> Rounded:
        """Return the number of neighbours, (n,), open by the pairs at the cutoff."""
        return self.counted_n


def at_cutoff(stages: type[ArrayEvaluator]) -> type[ArrayEvaluator]:
    """Return stages whose coordination is open where rounding decides."""
    return type("Counted", (AtCutoff,) if stages is ArrayEvaluator else (stages, AtCutoff), {})
