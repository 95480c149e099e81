r"""Properties of one particle, each formula written once: viscosity, temperature, stress.

Plain operators and `eos_ref.numbers.elementary` functions; see `eos_ref.eos.laws` for the idea,
`eos_ref.model.interactions` for pairs.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from eos_ref.numbers.elementary import N, maximum, sqrt, where


def strain_rate(G: Sequence[Sequence[N]]) -> N:
    r"""Return the magnitude of the strain rate, :math:`\dot\gamma = \sqrt{2\mathbf D:\mathbf D}` (1/time).

    :math:`\mathbf D = \frac12(\mathbf G+\mathbf G^T)`, ``G[a][b]`` is :math:`\partial v_a/\partial x_b`.
    D is not made traceless.
    """
    total: Any = 0.0
    for a in range(len(G)):
        for b in range(len(G)):
            D = 0.5 * (G[a][b] + G[b][a])
            total = total + D * D
    return sqrt(2 * total)  # type: ignore[no-any-return]


def power_viscosity(eta: Any, gd0: Any, K: Any, n: Any, rate: N) -> N:
    r"""Return the viscosity of the style power, a regularised Herschel-Bulkley law (manual, fix rheo/viscosity).

    :math:`\eta` for :math:`\dot\gamma\le\dot\gamma_0`, else :math:`K\dot\gamma^{n-1} + \tau_0/\dot\gamma` with
    :math:`\tau_0 = \eta\dot\gamma_0 - K\dot\gamma_0^n`, which is continuous at :math:`\dot\gamma_0`.
    """
    tau0 = eta * gd0 - K * gd0**n
    beyond = maximum(rate, gd0)
    return where(rate > gd0, K * beyond ** (n - 1) + tau0 / beyond, eta)  # type: ignore[no-any-return]


def temperature(e: N, cv: Any, latent_heat: Any, freezes: Any, T_freeze: Any) -> N:
    r"""Return the temperature that follows from the energy per mass, :math:`T = e/c_v`.

    With a freezing temperature :math:`T_c` and latent heat L: :math:`\max(T_c, (e-L)/c_v)` where :math:`e/c_v > T_c`.
    """
    T = e / cv
    return where(freezes & (T_freeze < T), maximum((e - latent_heat) / cv, T_freeze), T)  # type: ignore[no-any-return]


def stress(G: Sequence[Sequence[N]], eta: N, p: N | None = None) -> list[list[N]]:
    r"""Return the viscous stress :math:`\eta(\partial_bv_a + \partial_av_b)`, plus :math:`P\delta_{ab}` if p is given.

    The sign of the pressure is that of LAMMPS' output; Cauchy's convention would be the opposite one.
    """
    d = range(len(G))
    viscous = [[eta * (G[a][b] + G[b][a]) for b in d] for a in d]
    if p is None:
        return viscous
    return [[viscous[a][b] + p if a == b else viscous[a][b] for b in d] for a in d]
