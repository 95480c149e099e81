r"""Closed solutions of flows in a periodic box, as functions of arrays of any float type.

Symbols: ``k`` wave number (1/length), ``nu`` kinematic viscosity (length\ :sup:`2`/time), ``c`` speed of sound,
``rho0`` density at rest, ``t`` time. Nothing is rounded to a float64 on the way, so that a solution can be
differentiated in longdoubles.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from eos_ref.errors import InputError

Array = Any  # of any float type


def shear_wave(x_n: Array, t: Any, k: Any, nu: Any, amplitude: Any = 1.0) -> Array:
    r"""Return the transverse velocity (n,) of a shear wave, :math:`v_y=A\sin(kx)\,e^{-\nu k^2t}`.

    Solves :math:`\partial_tv_y=\nu\,\partial_x^2v_y`, which at any amplitude is the whole equation of Navier and
    Stokes: the flow does not carry itself, as nothing depends on y. Source: Landau & Lifshitz, Fluid Mechanics (1987),
    section 24.
    """
    return amplitude * np.sin(k * x_n) * np.exp(-nu * k * k * t)


def taylor_green(x_n: Array, y_n: Array, t: Any, k: Any, nu: Any, amplitude: Any = 1.0) -> tuple[Array, Array, Array]:
    r"""Return the velocity, and the pressure over density, of decaying vortices in a plane.

    .. math:: u=A\sin kx\cos ky\,F,\quad v=-A\cos kx\sin ky\,F,\quad
        \frac p\rho=\frac{A^2}4(\cos2kx+\cos2ky)F^2,\qquad F=e^{-2\nu k^2t}

    Solves :math:`\nabla\cdot v=0` and :math:`\partial_tv+v\cdot\nabla v=-\nabla p/\rho+\nu\nabla^2v`. Source: Taylor &
    Green, Proc. R. Soc. Lond. A 158, 499 (1937); this form: Chorin, Math. Comput. 22, 745 (1968).

    Returns
    -------
    u_n, v_n, pressure over density
    """
    decay = np.exp(-2 * nu * k * k * t)
    u_n = amplitude * np.sin(k * x_n) * np.cos(k * y_n) * decay
    v_n = -amplitude * np.cos(k * x_n) * np.sin(k * y_n) * decay
    return u_n, v_n, amplitude**2 / 4 * (np.cos(2 * k * x_n) + np.cos(2 * k * y_n)) * decay**2


def heat_wave(x_n: Array, t: Any, k: Any, diffusivity: Any, amplitude: Any = 1.0, mean: Any = 0.0) -> Array:
    r"""Return the temperature (n,) of a wave of heat at rest, :math:`T=\bar T+A\sin(kx)\,e^{-\alpha k^2t}`.

    Solves :math:`\partial_tT=\alpha\,\partial_x^2T` with :math:`\alpha=\kappa/(\rho c_v)`. Source: Landau & Lifshitz,
    Fluid Mechanics (1987), section 51.
    """
    return mean + amplitude * np.sin(k * x_n) * np.exp(-diffusivity * k * k * t)


def sound_wave(
    x_n: Array, t: Any, k: Any, c: Any, nu: Any, rho0: Any = 1.0, amplitude: Any = 1.0
) -> tuple[Array, Array]:
    r"""Return the density and velocity of a small standing wave of sound, at rest and compressed by A at t = 0.

    .. math:: \rho=\rho_0\{1+A\cos(kx)\,e^{-\Gamma t}[\cos\omega t+\tfrac\Gamma\omega\sin\omega t]\},\qquad
        v=A\,\frac{c^2k}\omega\sin(kx)\,e^{-\Gamma t}\sin\omega t,

        \Gamma=\tfrac12\nu_lk^2,\qquad\omega=\sqrt{c^2k^2-\Gamma^2}

    Solves :math:`\partial_t\rho=-\rho_0\,\partial_xv` and
    :math:`\rho_0\,\partial_tv=-c^2\,\partial_x\rho+\rho_0\nu_l\,\partial_x^2v`
    (Landau & Lifshitz, Fluid Mechanics (1987), section 79, without conduction of heat).

    ``nu`` is the *longitudinal* viscosity :math:`\nu_l`. That of the viscous pair force of Morris, Fox & Zhu, J.
    Comput. Phys. 136, 214 (1997), is the shear viscosity itself, in any dimension d: expanding :math:`v_i-v_j`
    around i,

    .. math:: \frac{F_i}{V_i}=\sum_j2\eta V_j\frac{W'}r(v_i-v_j)\to
        -\eta\,\partial_a\partial_bv\int\frac{W'}r\,x_ax_b\,d^dx=\eta\nabla^2v,\qquad
        \int\frac{W'}r\,x_ax_b\,d^dx=\frac{\delta_{ab}}d\int W'r\,d^dx=-\delta_{ab}

    (the last by parts, as W integrates to 1). The force follows the difference of velocities, not the line of centres,
    so no gradient of the divergence comes with it, unlike in Monaghan's form (Colagrossi et al., Phys. Rev. E 84,
    026705 (2011)). In the plane that is what Stokes' hypothesis gives, :math:`\nu_l=\nu(2-2/d)=\nu`; in space
    it is 3/4 of it.

    Raises
    ------
    InputError
        A wave so damped that it does not oscillate.

    Returns
    -------
    rho_n, v_n
    """
    damping, omega = damped(k, c, nu)
    f = np.exp(-damping * t) * (np.cos(omega * t) + damping / omega * np.sin(omega * t))
    g = c * c * k / omega * np.exp(-damping * t) * np.sin(omega * t)
    return rho0 * (1 + amplitude * np.cos(k * x_n) * f), amplitude * np.sin(k * x_n) * g


def damped(k: Any, c: Any, nu: Any) -> tuple[Any, Any]:
    r"""Return the rate :math:`\Gamma=\nu_lk^2/2` at which sound is damped, and its angular frequency; see `sound_wave`.

    Raises
    ------
    InputError
        A wave so damped that it does not oscillate.
    """
    damping = nu * k * k / 2
    if not damping < c * k:
        raise InputError("viscosity", "must be less than 2 c/k for a wave that oscillates", nu)
    return damping, np.sqrt(c * c * k * k - damping * damping)


def damped_oscillation(f_t: Array, dt: Any) -> tuple[Any, Any]:
    r"""Return the rate and angular frequency of :math:`f=e^{-\Gamma t}(a\cos\omega t+b\sin\omega t)`.

    Any such f, at equal distances of time, obeys :math:`f_{j+1}=pf_j-qf_{j-1}` with
    :math:`p=2e^{-\Gamma\Delta t}\cos\omega\Delta t` and :math:`q=e^{-2\Gamma\Delta t}`; p and q follow by least
    squares. Source: Prony's method, e.g. Hildebrand, Introduction to Numerical Analysis (1974), section 9.4.

    Parameters
    ----------
    f_t : array_like
        At least four values.
    dt : float
        Time between them, less than half a period.

    Returns
    -------
    rate, angular frequency
        NaN where the values do not oscillate.
    """
    f_t = np.asarray(f_t, float)
    if len(f_t) < 4:
        raise InputError("oscillation", "needs at least four values", len(f_t))
    p, minus_q = np.linalg.lstsq(np.stack([f_t[1:-1], f_t[:-2]], axis=1), f_t[2:], rcond=None)[0]
    with np.errstate(invalid="ignore"):
        return -np.log(-minus_q) / (2 * dt), np.arccos(p / (2 * np.sqrt(-minus_q))) / dt
