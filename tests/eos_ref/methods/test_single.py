"""Densities in single precision: the law is that of the same numbers in double precision, bit for bit."""

from __future__ import annotations

import numpy as np
import pytest

from eos_ref import EOS
from eos_ref.eos import compiled
from eos_ref.methods import single

N = compiled.BLOCK + 1  # the last particle is in a separate block


@pytest.mark.slow
@pytest.mark.parametrize("excess", [False, True])
@pytest.mark.parametrize(
    "law", [EOS("cubic", 1.25, 3.1, 2.0), EOS("ideal/gas", 1.25, 3.1, 1.4)], ids=lambda law: law.style
)
def test_only_the_densities_are_single(law: EOS, excess: bool) -> None:
    rng = np.random.default_rng(1)
    state_n = rng.uniform(-0.2, 0.2, N).astype(np.float32) + np.float32(0 if excess else law.rho0)
    e_n = rng.uniform(0.5, 2.5, N) if law.needs_energy else None
    rho_n, expected_n = (law.rho0 if excess else 0.0) + state_n.astype(float), np.empty(N)
    compiled.pressure_of_one_type(rho_n, np.empty(0) if e_n is None else e_n, *law.settings, expected_n)
    p_n = single.pressure(law, state_n, e_n, excess)
    assert p_n.dtype == np.float64 and np.array_equal(p_n, expected_n)
