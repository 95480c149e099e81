r"""Elastic bodies in the fluid: bonds between particles, and contacts of solids that no bond joins.

A law returns the force on particle i along :math:`\hat{\mathbf r}=\mathbf x_{ij}/r`, positive where it drives i and j
apart. The manual's :math:`F` attracts where it is positive, so its sign is the opposite one. Symbols: ``r`` distance,
``r0`` reference length of the bond, ``closing`` the velocity :math:`-\hat{\mathbf r}\cdot\mathbf v_{ij}`.

Source: manual, bond_style bpm/spring, bond_style rheo/shell, pair_style rheo/solid; Clemmer & Robbins, Phys. Rev. Lett.
129, 078002 (2022); Clemmer et al., Appl. Math. Model. 130, 310 (2024).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.numbers.elementary import N

if TYPE_CHECKING:
    from eos_ref.model.parameters import IntArray


def fades(ratio: N) -> N:
    """Return the factor by which forces vanish at the end of their reach, 1 - ratio^8."""
    squared = ratio * ratio
    fourth = squared * squared
    return 1 - fourth * fourth


@dataclass(frozen=True)
class SpringBond:
    r"""Bond of bpm/spring: :math:`[-k(r-r_0)-\gamma\,\hat{\mathbf r}\cdot\mathbf v_{ij}]w`.

    :math:`w=1-((r-r_0)/(r_0\epsilon_c))^8` with ``smooth``, else 1; with ``normalize`` :math:`k` is divided by
    :math:`r_0`.
    """

    stiffness: float
    strain: float
    damping: float
    smooth: bool = True
    normalize: bool = False

    def force(self, r: N, r0: N, closing: N) -> N:
        stretch = r - r0
        spring = self.stiffness * (stretch / r0 if self.normalize else stretch)
        force = self.damping * closing - spring
        return force * fades(stretch / (r0 * self.strain)) if self.smooth else force


@dataclass(frozen=True)
class ShellBond:
    r"""Enabled bond of rheo/shell.

    :math:`-2k(r-r_0)-2k(r-r_0)^3/(r_0\epsilon_c)^2-\gamma\,\hat{\mathbf r}\cdot\mathbf v_{ij}`.
    """

    stiffness: float
    strain: float
    damping: float
    formation: float  # time until the bond is enabled

    def force(self, r: N, r0: N, closing: N) -> N:
        stretch = r - r0
        relative = stretch / (r0 * self.strain)
        return self.damping * closing - 2 * self.stiffness * (stretch + relative * relative * stretch)


@dataclass(frozen=True)
class SolidContact:
    r"""Contact of two solids closer than :math:`r_c`: :math:`k(r_c-r)-\gamma w\,\hat{\mathbf r}\cdot\mathbf v_{ij}`.

    :math:`w=1-(r/r_c)^8`. One number per pair of types: (t, t) arrays.
    """

    stiffness_tt: FloatArray
    reach_tt: FloatArray
    damping_tt: FloatArray
    bonded: float = 1.0  # weight of a contact of bonded particles (special_bonds)

    def force(self, r: N, closing: N, types: tuple[IntArray, IntArray]) -> N:
        k, reach, damping = (table[types] for table in (self.stiffness_tt, self.reach_tt, self.damping_tt))
        return k * (reach - r) + damping * closing * fades(r / reach)


BondLaw = SpringBond | ShellBond


@dataclass(frozen=True)
class Elastic:
    """What bonds and contacts obey: a law per bond type, and that of contacts, if there are any."""

    bonds: tuple[BondLaw, ...] = ()
    contact: SolidContact | None = None


@dataclass(frozen=True, eq=False)
class Bonds:
    """Bonds that act, each once: particles i and j (b,), types from 1 on (b,), reference lengths (b,)."""

    i_b: IntArray = field(default_factory=lambda: np.empty(0, int))
    j_b: IntArray = field(default_factory=lambda: np.empty(0, int))
    type_b: IntArray = field(default_factory=lambda: np.empty(0, int))
    length_b: FloatArray = field(default_factory=lambda: np.empty(0))

    def of(self, rows_k: IntArray, n: int) -> Bonds:
        """Return the bonds among some of n particles, numbered by their places in ``rows_k``, (k,)."""
        place_n = np.full(n, -1)
        place_n[rows_k] = np.arange(len(rows_k))
        i_b, j_b = place_n[self.i_b], place_n[self.j_b]
        among = (i_b >= 0) & (j_b >= 0)
        return Bonds(i_b[among], j_b[among], self.type_b[among], self.length_b[among])
