r"""Terms of pair_style rheo for one pair, each written once.

A function takes the values of particles i and j and returns what multiplies the kernel's gradient, in plain operators
and `eos_ref.numbers.elementary` functions; compiled loops, numpy arrays and numbers that carry their rounding error
share the bodies. The sums over neighbours are in `eos_ref.evaluation.array_evaluator` (readable) and
`eos_ref.compiled.evaluator` (compiled).

Symbols: ``volume`` V = m/rho, ``p`` pressure, ``eta`` dynamic viscosity, ``kappa`` conductivity, ``rr`` squared
distance, ``F`` the ratio :math:`\mathbf x_{ij}\cdot\widetilde\nabla W_{ij}/r^2` (1/length**(d + 2)), which is
:math:`W'/r` for the plain kernel.
"""

from __future__ import annotations

from eos_ref.numbers.elementary import N, maximum, minimum, sqrt, where

VISCOUS_SOFTENING = 1e-2  # epsilon of the artificial viscosity, in units of h**2
REPULSION_CHI = 0.9  # solids deeper in their phase than this repel fluid at short range
NORMAL_SOFTENING = 1e-10  # added to |grad C| in the surface normal, absolute


def arithmetic_mean(a: N, b: N) -> N:
    """Return the mean of a coefficient of two particles, (a + b)/2."""
    return 0.5 * (a + b)


def harmonic_mean(a: N, b: N) -> N:
    """Return the mean of a coefficient of two particles with keyword harmonic/means, 2ab/(a + b); 0 if both are 0."""
    total = a + b
    # One over the sum first: the product of two large or small numbers leaves the range of doubles.
    return where(total == 0, 0.0, 2 * (a / where(total == 0, 1.0, total) * b))  # type: ignore[comparison-overlap]


def pressure_term(volume_i: N, volume_j: N, p_sum: N) -> N:
    r"""Return :math:`-V_iV_j(P_i+P_j)`, which times :math:`\widetilde\nabla W_{ij}` is the pressure force on i."""
    return -(volume_i * volume_j) * p_sum


def artificial_term(zeta: float, cs: N, ux: N, rr: N, h: float, rho_sum: N) -> N:
    r"""Return the artificial viscous pressure :math:`q(\rho_i+\rho_j)`, to be added to :math:`P_i+P_j`.

    :math:`\mu = \min(0, \frac{\mathbf u\cdot\mathbf x/h}{r^2/h^2+\epsilon})`,
    :math:`q = \zeta(-2\bar c\mu + \mu^2)`, with ``ux`` = :math:`\mathbf u\cdot\mathbf x_{ij}` and
    :math:`\mathbf u = \mathbf v_{ij} - \frac12(\mathbf G_i+\mathbf G_j)\mathbf x_{ij}`.

    Source: Monaghan's form with the linear midpoint extrapolation of Frontiere, Raskin & Owen, J. Comput. Phys. 332,
    160 (2017).
    """
    mu = minimum(0.0, h * ux / (rr + VISCOUS_SOFTENING * (h * h)))
    return zeta * (mu * mu - 2 * (cs * mu)) * rho_sum


def viscous_term(eta: N, volume_i: N, volume_j: N, F: N) -> N:
    r"""Return the viscous coefficient :math:`2\bar\eta V_iV_jF`, times v_ij.

    Source: Morris, Fox & Zhu, J. Comput. Phys. 136, 214 (1997).
    """
    return 2 * eta * (volume_i * volume_j) * F


def heat_term(kappa: N, volume_i: N, volume_j: N, F: N) -> N:
    r"""Return the heat coefficient :math:`2\bar\kappa V_iV_jF`, times T_i - T_j.

    Source: Cleary & Monaghan, J. Comput. Phys. 148, 227 (1999).
    """
    return 2 * kappa * (volume_i * volume_j) * F


def diffusion_term(xi: float, volume_j: N, difference: N, F: N) -> N:
    r"""Return the density diffusion into i, :math:`-2\xi V_j\psi_{ij}F`.

    :math:`\psi` is :math:`(\rho_j-\rho_{0,j})-(\rho_i-\rho_{0,i})` for the kernels quintic and RK0 (Molteni &
    Colagrossi, Comput. Phys. Commun. 180, 861 (2009)) and
    :math:`(\rho_j-\rho_i)+\frac12[(\nabla\rho)_i+(\nabla\rho)_j]\cdot\mathbf x_{ij}` for RK1 and RK2 (Antuono et al.,
    Comput. Phys. Commun. 181, 532 (2010)).
    """
    return -2 * xi * volume_j * difference * F


def interface_distance(chi: N, cut: float) -> N:
    r"""Return the estimated distance to the interface, :math:`d = 2r_c(\chi-\frac12)` (Palermo et al. 2024)."""
    return 2 * cut * (chi - 0.5)


def no_slip_ratio(chi_solid: N, chi_fluid: N, cut: float) -> N:
    r"""Return the ratio :math:`\max(d_s,0)/\max(d_f,\frac{\sqrt3}{12}r_c)` of the distances to the interface.

    The solid's velocity as the fluid meets it is :math:`\mathbf v_s + (\mathbf v_s-\mathbf v_f)` times this.
    Source: Takeda, Miyama & Sekiya, Prog. Theor. Phys. 92, 939 (1994); Morris, Fox & Zhu (1997).
    """
    d_solid = maximum(interface_distance(chi_solid, cut), 0.0)
    d_fluid = maximum(interface_distance(chi_fluid, cut), sqrt(3.0) / 12 * cut)
    return d_solid / d_fluid


def repulsion_term(chi_solid: N, r: N, rho0_solid: N, cs: N, cut: float) -> N:
    r"""Return the short-range repulsion of fluid and solid, which times :math:`\mathbf x_{ij}/r` is the force on i.

    :math:`(\chi_s-0.9)(\frac{r_c}2-r)\rho_{0,s}\bar c^2r_c` for :math:`\chi_s>0.9` and :math:`r<r_c/2`, else 0.
    """
    near = maximum(0.5 * cut - r, 0.0)
    return maximum(chi_solid - REPULSION_CHI, 0.0) * near * rho0_solid * (cs * cs) * cut


def shift_weight(w: N, w_h: N) -> N:
    r"""Return the weight of a neighbour in the shifting sum, :math:`1+\frac15(W_{ij}/W(h))^4`."""
    s = w / w_h
    ss = s * s
    return 1 + 0.2 * (ss * ss)
