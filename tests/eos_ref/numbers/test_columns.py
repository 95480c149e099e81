"""Arrays joined from columns keep the errors of the columns."""

from __future__ import annotations

import numpy as np

from eos_ref.numbers.columns import joined
from eos_ref.numbers.rounded import Rounded, error


def test_joined_keeps_errors() -> None:
    a, b = Rounded(np.ones(3), 0.5), np.zeros(3)
    assert error(joined([a, b])).tolist() == [[0.5, 0.0]] * 3
