"""Densities kept in single precision, the law in double precision: compiled."""

# mypy: disable-error-code="untyped-decorator"

from __future__ import annotations

from typing import Any

import numba
import numpy as np

import eos_ref.jit  # noqa: F401  chooses the registers before anything is compiled
from eos_ref.eos import compiled
from eos_ref.eos.table import EOS, FloatArray


def pressure(law: EOS, state_n: Any, e_n: FloatArray | None, excess: bool) -> FloatArray:
    """Return the pressures (n,) in float64 of float32 densities, or of float32 differences from rho0."""
    p_n = np.empty(state_n.shape)
    _widened(state_n, np.empty(0) if e_n is None else e_n, law.rho0 if excess else 0.0, *law.settings, p_n)
    return p_n


@numba.njit(error_model="numpy", cache=True, nogil=True)
def _widened(
    state_n: Any,
    e_n: Any,
    origin: float,
    style: int,
    rho0: float,
    cs: float,
    parameter: float,
    background: float,
    out_n: Any,
) -> None:
    rho_b = np.empty(compiled.BLOCK)  # stays in the first-level cache
    for start in range(0, state_n.size, rho_b.size):
        size = min(rho_b.size, state_n.size - start)
        for k in range(size):
            rho_b[k] = origin + state_n[start + k]
        part = slice(start, start + size)
        e_b = e_n[part] if e_n.size else e_n
        compiled.pressure_of_one_type(rho_b[:size], e_b, style, rho0, cs, parameter, background, out_n[part])
