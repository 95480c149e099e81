r"""Stages of a force evaluation: from a particle's sums over its neighbours to its rates, for several number types.

One method per stage. The sums themselves are left to two evaluators with the same results:
`eos_ref.evaluation.array_evaluator`, readable array operations, and `eos_ref.compiled.evaluator`, compiled loops.
Tests compare the two. With positions that are `eos_ref.numbers.rounded` arrays every result of the
former carries its rounding bound.

Array names end in ``_n`` particle, ``_p`` directed pair, ``_c`` Cartesian axis. Source: manual, fix rheo; Palermo et
al., Phys. Fluids 36, 113337 (2024); the papers named at each stage.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from eos_ref.eos import rounded_eos
from eos_ref.eos.table import FloatArray
from eos_ref.errors import InputError
from eos_ref.model import interactions, per_atom
from eos_ref.model.bonds import BondLaw
from eos_ref.model.box import BoolArray, Box
from eos_ref.model.parameters import IntArray, Model
from eos_ref.model.state import Gradients, PairTerms, State, Surface
from eos_ref.numbers.columns import Axes, axes, dot, joined, matrix
from eos_ref.numbers.elementary import N, maximum, sqrt, where
from eos_ref.numbers.number import Array, Number
from eos_ref.numbers.rounded import Decision, Rounded, placed, value

WALL_FLOOR = 10  # a reconstructed solid has at least rho0 over this


def is_class(class_n: Array, wanted: int) -> BoolArray | Decision:
    """Return which particles are of a surface class, (n,); undecided where rounding could change the class."""
    if isinstance(class_n, Rounded):
        return Decision(class_n.value == wanted, class_n.error > 0)
    return np.asarray(value(class_n) == wanted)


class PairInput(NamedTuple):
    """The input of the terms of pair_style rheo, apart from the pairs themselves.

    Attributes
    ----------
    v_nc, rho_n : (n, d) velocities, (n,) densities
    pressure_n : (n,) pressures of the `Evaluator.apparent_density`
    viscosity_n, sound_n : (n,) dynamic viscosities, speeds of sound
    chi_n : (n,) same-phase fractions, with interface/reconstruct
    gradient : of velocity for artificial viscosity, of density for rho/damp
    temperature_n : (n,) temperatures, with a thermal model
    virial : whether virials are summed as well
    """

    v_nc: Array
    rho_n: Array
    pressure_n: Array
    viscosity_n: Array
    sound_n: Array
    chi_n: Array | None
    gradient: Gradients
    temperature_n: Array | None = None
    virial: bool = False


@dataclass(eq=False, repr=False)
class Evaluator(ABC):
    """Stages of a force evaluation for particles of a model in a box.

    Parameters
    ----------
    model : Model
    box : Box
    type_n : (n,) types, 1 to N
    solid_n : (n,) whether a particle is solid; is set again when phases change

    Attributes
    ----------
    image_velocity_cc : (d, d) velocities of the images that are one edge away, one edge per row; None: at rest
    image_rounding_cc : (d, d) largest difference of these velocities between two correct codes, where images move
    mass_n, rho0_n, cs_n : (n,) mass, equilibrium density and speed of sound of every particle
    coordination_n : (n,) number of neighbours, from `move` on
    shelled_n : (n,) whether a particle is in a bond of fix rheo/oxidation; None: without that fix
    corrected_n : (n,) whether a particle has the gradients of a reproducing kernel, from `correct` on
    """

    model: Model
    box: Box
    type_n: IntArray
    solid_n: BoolArray
    image_velocity_cc: FloatArray | None = field(default=None, init=False)
    image_rounding_cc: FloatArray = field(init=False)
    mass_n: FloatArray = field(init=False)
    rho0_n: FloatArray = field(init=False)
    cs_n: FloatArray = field(init=False)
    coordination_n: Array = field(init=False)
    corrected_n: BoolArray = field(init=False)
    shelled_n: BoolArray | None = field(default=None, init=False)
    _pressures: tuple[Any, Any, Any] | None = field(default=None, init=False)  # the last ones, with what they are of

    def __post_init__(self) -> None:
        self.type_n = np.asarray(self.type_n)
        self.n = len(self.type_n)
        self.mass_n, self.rho0_n, self.cs_n = map(self.of_type, (self.model.mass, self.model.rho0, self.model.cs))
        self.walls = self.model.fix.interface_reconstruct

    def weigh(self, mass_n: FloatArray) -> None:
        """Use per-particle masses, (n,), instead of those of the types."""
        self.mass_n = mass_n

    def take(self, box: Box) -> None:
        """Use another box from here on."""
        self.box = box

    def of_type(self, values_t: Iterable[Any]) -> npt.NDArray[Any]:
        """Return values given per type for every particle, (n,)."""
        return np.asarray(values_t if isinstance(values_t, np.ndarray) else list(values_t))[self.type_n - 1]

    def constant(self, factor: N) -> N:
        """Return a parameter's value in the number type of the evaluation."""
        return factor

    def counted(self) -> Array:
        """Return the number of neighbours as it is output, (n,)."""
        return self.coordination_n

    def follow(self, x_nc: Array) -> None:
        """Find the pairs of positions in a box that has changed; particles keep their corrections.

        Raises
        ------
        InputError
            This evaluator cannot do so.
        """
        raise InputError("deform", "needs the sums of all particles at once: use ArrayEvaluator", type(self).__name__)

    # --- sums over neighbours, left to the evaluators

    @abstractmethod
    def move(self, x_nc: Array) -> None:
        """Find the pairs of new positions (n, d) and evaluate the kernel once for all sums."""

    @abstractmethod
    def correct(self, rho_n: Array) -> None:
        """Evaluate the gradients of the reproducing kernels, for both sides of every pair."""

    @abstractmethod
    def kernel_sum(self, weight_n: Array | None = None) -> Array:
        r"""Return :math:`\sum_jw_jW_{ij}`, (n,); without weights :math:`\sum_jW_{ij}`."""

    @abstractmethod
    def wall_sums(self, pressure_n: Array, rho_n: Array, acceleration_nc: Array) -> tuple[Array, ...]:
        r"""Return four sums, each (n,).

        Of :math:`W_{ij}` over all neighbours, and over those of the same phase; over a solid's fluid neighbours of
        :math:`W_{sf}`, and of :math:`W_{sf}[P_f+\rho_f(\mathbf a_f-\mathbf a_s)\cdot\mathbf x_{sf}]`.
        """

    @abstractmethod
    def shift_sums(self, volume_n: Array, w_h: Number) -> Axes:
        r"""Return the components of :math:`\sum_jV_j[1+\frac15(W_{ij}/W(h))^4]\nabla_iW_{ij}`."""

    @abstractmethod
    def color_sums(self, volume_n: Array) -> tuple[Axes, Array, Array]:
        r"""Return sums over the neighbours of other types, and one over those of the same, each (n,).

        Over other types :math:`\sum_jV_j\nabla_iW_{ij}` and :math:`\sum_jV_jW_{ij}`; over the own type
        :math:`\sum_jW_{ij}`, or :math:`\sum_jr_{ij}W_{ij}` where the manual weighs distances.
        """

    @abstractmethod
    def surface_sums(self, rho_n: Array) -> tuple[Axes, Array]:
        r"""Return the gradient of the color function and the divergence of positions, components of shape (n,).

        :math:`\nabla C=\sum_jV_j\nabla_iW_{ij}` and
        :math:`\nabla\cdot\mathbf r=-\sum_jV_j\mathbf x_{ij}\cdot\nabla_iW_{ij}`.
        """

    @abstractmethod
    def nearest(self, class_n: Array) -> Array:
        """Return the distance to the nearest neighbour of class 1, at most the cutoff, (n,)."""

    @abstractmethod
    def gradients(self, state: State, chi_n: Array | None = None, want: Sequence[str] = ("v", "rho")) -> Gradients:
        r"""Return gradients :math:`(\nabla f)_i=\sum_jV_j(f_j-f_i)\widetilde\nabla W_{ij}` of some fields of a state.

        ``want`` names them: v, rho, energy. Walls need the same-phase fractions ``chi_n``.
        """

    @abstractmethod
    def pair_terms(self, fields: PairInput) -> PairTerms:
        """Return forces, density diffusion and heat flow of pair_style rheo; see `eos_ref.model.interactions`."""

    @abstractmethod
    def eos_pressure(self, rho_n: Array, e_n: Array | None) -> Array:
        """Return the pressure of every particle by the law of its type, from density and energy per mass, all (n,)."""

    def bond_force(self, law: BondLaw, r0: Any, r: Any, closing: Any) -> Any:
        """Return the forces of bonds on one of their particles, along the line from the other one, (b,)."""
        return law.force(r, r0, closing)

    # --- density by summation

    def density_sum(self) -> Array:
        r"""Return the summed density, :math:`m_iW(0)+\sum_jm_jW_{ij}`; with self/mass :math:`m_i` for :math:`m_j`.

        Source: manual; self/mass as Hu & Adams, J. Comput. Phys. 213, 844 (2006).
        """
        w0 = self.constant(self.model.kernel.self_value(self.model.dimension, self.model.cut))
        if self.model.fix.self_mass:
            return self.mass_n * (w0 + self.kernel_sum())
        return self.mass_n * w0 + self.kernel_sum(self.mass_n)

    # --- walls

    def apparent_density(self, rho_n: Array) -> Array:
        """Return the densities that particles of the other phase see, (n,): of a solid at least rho0 with walls."""
        return where(self.solid_n, maximum(rho_n, self.rho0_n), rho_n) if self.walls else rho_n

    def volume_of_wall(self, rho_n: Array) -> Array:
        """Return the volumes, (n,); a reconstructed solid is at least as dense as at equilibrium."""
        return self.mass_n / self.apparent_density(rho_n)

    def interface(self, rho_n: Array, acceleration_nc: Array, energy_n: Array | None = None) -> tuple[Array, Array]:
        r"""Return same-phase fractions chi, and densities with those of solids extrapolated from the fluid, both (n,).

        :math:`P_s=\sum_fW_{sf}[P_f+\rho_f(\mathbf g_f-\mathbf a_s)\cdot\mathbf x_{sf}]/\sum_fW_{sf}`,
        :math:`\rho_s=\mathrm{EOS}_s^{-1}(P_s)`, at least :math:`\rho_0/10`; :math:`\rho_0` without fluid neighbours.
        ``acceleration_nc`` holds :math:`\mathbf g_f`, the acceleration of the fluid without pressure, and
        :math:`\mathbf a_s`, that of the solid.

        Source: Adami, Hu & Adams, J. Comput. Phys. 231, 7057 (2012); Palermo et al. (2024).
        """
        all_n, same_n, support_n, sum_n = self.wall_sums(self.pressure(rho_n, energy_n), rho_n, acceleration_nc)
        met = np.flatnonzero(value(support_n) > 0)
        wall = self.wall_density(met, sum_n[met] / support_n[met], energy_n)
        return self.same_fraction(all_n, same_n), placed(wall, met, where(self.solid_n, self.rho0_n, rho_n))

    def wall_density(self, at: IntArray, p: Array, energy_n: Array | None) -> Array:
        """Return the densities of the solids ``at`` whose fluid neighbours give them a pressure."""
        table, type_of = self.model.eos, self.type_n[at]
        e = None if energy_n is None else energy_n[at] / self.mass_n[at]
        rho = rounded_eos.by_type(rounded_eos.density, table, type_of, p, e)
        # Below the pressure of vacuum Tait's law has no density: the lower limit applies.
        background = np.array([law.background for law in table])[type_of - 1]
        torn = np.isnan(value(rho)) & (value(p) < background)
        return maximum(where(torn, 0.0, rho), self.constant(self.rho0_n[at] / WALL_FLOOR))

    def same_fraction(self, all_n: Array, same_n: Array) -> Array:
        r"""Return same-phase fractions :math:`\chi_i=\sum_{s_j=s_i}W_{ij}/\sum_jW_{ij}`; 0 without neighbours."""
        return same_n / where(value(self.counted()) == 0, 1.0, all_n)

    # --- shifting

    def shift(self, v_nc: Array, rho_n: Array) -> Array:
        r"""Return the shifting velocity, (n, d); 0 for solids.

        :math:`-2h|\mathbf v_i|\sum_jV_j[1+\frac15(W_{ij}/W(h))^4]\nabla_iW_{ij}`.
        Types of exclude/type are not shifted; scale/cross/type scales the shift along the normal of the color function,
        and turns it off where the support by the particle's own type is too small. Source: manual; Lind et al., J.
        Comput. Phys. 231, 1499 (2012); Yang et al., J. Comput. Phys. 458, 111079 (2022).
        """
        shift = self.raw_shift(axes(v_nc), rho_n)
        setting = self.model.fix.shift
        if setting and setting.scale_cross_type:
            shift = self._cross_type(shift, rho_n, *setting.scale_cross_type)
        return joined(shift)

    def unshelled(self) -> Any:
        """Return which particles may shift, being in no bond of fix rheo/oxidation, (n,); see Howto rheo."""
        return True if self.shelled_n is None else ~self.shelled_n

    def raw_shift(self, v: Axes, rho_n: Array) -> Axes:
        """Return the components of the shifting velocity before any scaling."""
        model = self.model
        w_h = self.constant(model.kernel.normalisation(model.dimension, model.cut)) * float(model.kernel.shape(1.0))
        scale = -2 * model.h * sqrt(dot(v, v))
        moves = ~self.solid_n & self.of_type(model.shifted_t) & self.unshelled()
        return [where(moves, scale * sum_n, 0.0) for sum_n in self.shift_sums(self.volume_of_wall(rho_n), w_h)]

    def _cross_type(self, shift: Axes, rho_n: Array, keep: float, cmin: float, wmin: float) -> Axes:
        gradient, color_n, same_n = self.color_sums(self.volume_of_wall(rho_n))
        scaled = shift
        if keep != 1:  # else nothing is removed, whatever the normal, even where it has no direction
            normal = self.cross_type_normal(gradient)
            along = (1 - keep) * dot(normal, shift)
            scaled = [s - n * along for s, n in zip(shift, normal, strict=True)]
        return [
            where(same_n < wmin, 0.0, where(color_n >= cmin, new, old)) for new, old in zip(scaled, shift, strict=True)
        ]

    def cross_type_normal(self, gradient: Axes) -> Axes:
        """Return the unit normal of the interface between types, along the color function's gradient; or 0."""
        size = sqrt(dot(gradient, gradient))
        none = value(size) == 0
        return [where(none, 0.0, c / where(none, 1.0, size)) for c in gradient]

    # --- surfaces

    def surface(self, rho_n: Array, shift_nc: Array | None = None) -> tuple[Surface, Array | None]:
        r"""Return the free surfaces, and the shift without its outward part there.

        Fluid whose coordination, or :math:`\nabla\cdot\mathbf r`, is below the limit is splash (2) with fewer than
        limit/splash neighbours, else surface (1), with the normal :math:`-\nabla C/(|\nabla C|+10^{-10})`. See
        `surface_sums`. Source: manual; Palermo et al. (2024).
        """
        setting = self.model.fix.surface_detection
        assert setting is not None
        gradient, divr_n = self.surface_sums(rho_n)
        size = sqrt(dot(gradient, gradient)) + interactions.NORMAL_SOFTENING
        low = (self.coordination_n if setting.style == "coordination" else divr_n) < setting.limit
        candidate = ~self.solid_n & low
        splash = self.coordination_n < setting.splash
        class_n: Array = where(candidate, where(splash, 2.0, 1.0), 0.0)
        normal = [where(is_class(class_n, 1), -(c / size), 0.0) for c in gradient]
        # Distance to the surface: 0 on it, the cutoff for solids.
        distance_n = where(self.solid_n, self.model.cut, where(~is_class(class_n, 0), 0.0, self.nearest(class_n)))
        if shift_nc is not None:
            shift_nc = joined(self._inward(axes(shift_nc), normal, class_n))
        return Surface(class_n, distance_n, joined(normal), divr_n), shift_nc

    def _inward(self, shift: Axes, normal: Axes, class_n: Array) -> Axes:
        outward = maximum(dot(normal, shift), 0.0)
        return [where(is_class(class_n, 2), 0.0, s - n * outward) for s, n in zip(shift, normal, strict=True)]

    # --- properties of a particle

    def viscosity(self, gradient_ncc: Array | None = None) -> Array:
        """Return the viscosities, (n,); the style power needs the velocity gradients."""
        laws = self.model.viscosity
        eta_n = self.of_type(law.eta for law in laws)
        if all(law.style == "constant" for law in laws):
            return eta_n
        gd0_n, K_n, power_n = (self.of_type(getattr(law, k) for law in laws) for k in ("gd0", "K", "n"))
        assert gradient_ncc is not None
        rate = per_atom.strain_rate(matrix(gradient_ncc))
        power = self.of_type(law.style == "power" for law in laws)
        gd0_n = np.where(power, gd0_n, 1.0)  # any rate but 0, which the style constant has
        return where(power, per_atom.power_viscosity(eta_n, gd0_n, K_n, power_n, rate), eta_n)

    def pressure(self, rho_n: Array, energy_n: Array | None = None) -> Array:
        """Return the pressures at given densities, all (n,); the energy is that of the whole particle."""
        if self._pressures is None or self._pressures[0] is not rho_n or self._pressures[1] is not energy_n:
            e_n = None if energy_n is None else energy_n / self.mass_n
            self._pressures = rho_n, energy_n, self.eos_pressure(rho_n, e_n)
        return self._pressures[2]

    def sound_speed(self, energy_n: Array | None = None) -> Array:
        r"""Return the speeds of sound of pair terms: fix rheo's, :math:`\sqrt{(\gamma-1)e}` of an ideal gas."""
        laws = self.model.eos
        if energy_n is None or not laws.needs_energy:
            return self.cs_n
        gas = self.of_type(law.needs_energy for law in laws)
        squared: Any = 0.0
        for law in dict.fromkeys(eos.law for eos in laws if eos.needs_energy):
            assert law.energy is not None
            of_law = self.of_type(eos.law is law for eos in laws)
            parameter = where(of_law, self.of_type(eos.parameter or 0.0 for eos in laws), 1.0)
            squared = where(of_law, law.energy.sound_squared(energy_n / self.mass_n, parameter), squared)
        return where(gas, sqrt(maximum(squared, 0.0)), self.cs_n)  # type: ignore[no-any-return]

    def temperature(self, energy_n: Array) -> Array:
        """Return the temperatures that follow from the stored energies, (n,)."""
        thermal = self.model.thermal
        assert thermal is not None
        cv_n = self.of_type(p.specific_heat for p in thermal)
        latent_n = self.of_type(p.latent_heat for p in thermal)
        freezes = self.of_type(p.T_freeze is not None for p in thermal)
        T_freeze = self.of_type(p.T_freeze or 0.0 for p in thermal)
        return per_atom.temperature(self.specific_energy(energy_n), cv_n, latent_n, freezes, T_freeze)

    def specific_energy(self, energy_n: Array) -> Array:
        """Return the energies per unit mass, of which temperatures are a function, (n,)."""
        return energy_n / self.mass_n

    def conduction(self) -> FloatArray:
        """Return the conductivities, (n,)."""
        assert self.model.thermal is not None
        return self.of_type(p.conductivity for p in self.model.thermal)
