r"""Slow flow through periodic arrays of obstacles at rest: the drag on each, and the speed of the fluid.

A body force on the fluid, or a gradient of pressure, G per volume, drives the flow, and the drag on each obstacle is
that of its cell, G times its volume. U is the mean velocity over the cell, obstacle included.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from eos_ref.errors import InputError

Array = Any  # of floats
MODES = 18  # of the angle; the drag of a cylinder whose radius is up to 0.3 of the cell is right to six digits


def drag_of_sphere(fraction: float) -> float:
    r"""Return K in the drag :math:`6\pi\eta aUK` on a sphere of radius a of a simple cubic array.

    .. math::
        1/K = 1-1.7601\,\phi^{1/3}+\phi-1.5593\,\phi^2+3.9799\,\phi^{8/3}-3.0734\,\phi^{10/3}

    Sources: Hasimoto, J. Fluid Mech. 5, 317 (1959) up to :math:`\phi^2`; Sangani & Acrivos, Int. J. Multiphase Flow
    8, 343 (1982).

    Parameters
    ----------
    fraction : float
        Volume fraction phi of the spheres, between 0 and 0.2.

    Raises
    ------
    InputError
        Another fraction.
    """
    if not 0 < fraction <= 0.2:
        raise InputError("volume fraction", "must lie above 0 and not above 0.2", fraction)
    third = np.cbrt(fraction)
    return float(1 / (1 - 1.7601 * third + fraction - 1.5593 * fraction**2 + 3.9799 * third**8 - 3.0734 * third**10))


@dataclass(frozen=True)
class Cylinders:
    r"""Flow across a square array of cylinders of radius ``a`` in cells of length 1, for :math:`\eta U=1`.

    The stream function is a sum of the biharmonic functions odd in y and even in x that obey the condition of no slip
    on the cylinder,

    .. math::
        \psi=\sum_m\sin(m\theta)\,[A_mp_m(r)+B_mq_m(r)],\quad m=1,3,5,\dots

    with p and q out of :math:`r^m, r^{-m}, r^{m+2}, r^{2-m}` (m = 1: :math:`r\ln r` for the last). The coefficients
    are those of least squares on the faces of the cell, which are planes of symmetry: :math:`v=0` and
    :math:`\partial_x\nabla^2\psi=0` at :math:`x=1/2`; :math:`\psi=1/2` and :math:`\partial_yu=0` at :math:`y=1/2`. A
    force F along x makes :math:`\psi=F/(4\pi\eta)\,(r-r\ln r)\sin\theta`: the coefficient of :math:`r\ln r` is the
    drag.
    Source of the method: Sangani & Acrivos, Int. J. Multiphase Flow 8, 193 (1982).

    Attributes
    ----------
    drag : on a cylinder, per length, over eta U
    """

    a: float
    drag: float
    coefficients_mk: Array

    def speed(self, y_n: Array) -> Array:
        """Return u/U at distances from the axis, (n,), on the line across the stream through it; 0 inside."""
        y_n = np.abs(np.asarray(y_n, float))
        outside_n = np.maximum(y_n, self.a)
        basis = _basis(0 * outside_n, outside_n, self.a)["u"]
        return np.where(y_n > self.a, basis @ self.coefficients_mk.ravel(), 0.0)


def cylinders(a: float) -> Cylinders:
    """Return the flow across a square array of cylinders of radius a (over the length of a cell).

    Raises
    ------
    InputError
        A radius outside (0, 0.3].
    """
    if not 0 < a <= 0.3:
        raise InputError("radius of the cylinder", "must lie above 0 and not above 0.3 of the cell", a)
    s_n = (np.arange(6 * MODES) + 0.5) / (12 * MODES)  # along a face, from its middle
    right, top = _basis(0 * s_n + 0.5, s_n, a), _basis(s_n, 0 * s_n + 0.5, a)
    conditions = np.concatenate([right["v"], right["vorticity_x"], top["psi"], top["uy"]])
    wanted = np.concatenate([0 * s_n, 0 * s_n, 0 * s_n + 0.5, 0 * s_n])
    scale = np.abs(conditions).max(axis=0)
    found = np.linalg.lstsq(conditions / scale, wanted, rcond=None)[0] / scale
    return Cylinders(a, float(4 * np.pi * found[1]), found.reshape(MODES, 2))


def _basis(x_n: Array, y_n: Array, a: float) -> dict[str, Array]:
    """Return psi, u, v, du/dy and the derivative of its Laplacian by x of every function, (n, 2 modes) each."""
    z = x_n + 1j * y_n
    modes = [terms for m in range(1, 2 * MODES, 2) for terms in _no_slip(m, a)]
    columns = [sum(factor * _derivatives(z, *of) for factor, of in terms) for terms in modes]
    return dict(zip(("psi", "u", "v", "uy", "vorticity_x"), np.stack(columns, axis=2), strict=True))


def _no_slip(m: int, a: float) -> list[list[tuple[float, tuple[int, str]]]]:
    """Return two combinations of the radial functions of a mode whose value and slope are 0 at r = a.

    The first is r^(m+2) with r^m and r^-m; the second r^(2-m), or r ln r, with the same two.
    """
    power = {"in": m, "out": -m, "grow": m + 2, "fall": 2 - m}
    ends = {kind: (a**p, p * a ** (p - 1)) for kind, p in power.items()}
    if m == 1:
        ends["fall"] = a * np.log(a), np.log(a) + 1
    pair = np.array([ends["in"], ends["out"]]).T
    return [
        [(1.0, (m, kind)), *zip(-np.linalg.solve(pair, ends[kind]), ((m, "in"), (m, "out")), strict=True)]
        for kind in ("grow", "fall")
    ]


def _derivatives(z: Array, m: int, kind: str) -> Array:
    """Return sin(m theta) times a radial function, (5, n) as in `_basis`, as the imaginary part of h(z, conj z).

    h is z^m, -z^-m, or conj(z) times an analytic function; for r ln r it is z ln|z|. Its Laplacian is 4 h_zw.
    """
    w = np.conj(z)
    if (m, kind) == (1, "fall"):
        log = np.log(np.abs(z))
        h, hz, hw, hzz, hzw, hww, third = z * log, log + 0.5, z / w / 2, 0.5 / z, 0.5 / w, -z / w**2 / 2, -0.5 / w**2
    else:
        sign, p = {"in": (1, m), "out": (-1, -m), "grow": (1, m + 1), "fall": (-1, 1 - m)}[kind]
        f, fz, fzz = (sign * factor * z ** (p - k) for k, factor in enumerate((1, p, p * (p - 1))))
        plain = kind in ("in", "out")
        h, hz, hw, hzz, hzw, hww, third = (
            (f, fz, 0, fzz, 0, 0, 0 * f) if plain else (w * f, w * fz, f, w * fzz, fz, 0, fzz)
        )
    return np.imag(np.stack([h, 1j * (hz - hw), -(hz + hw), -(hzz - 2 * hzw + hww), 4 * third]))
