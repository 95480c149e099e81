r"""The particle model in plain array operations: readable, and for several number types.

One method per stage of a force evaluation. Pairs are directed: every pair within the cutoff stands twice, once for
each particle that collects. `eos_ref.fast` has the same interface, compiled; tests hold the two against each other.
With positions that are `eos_ref.rounded` arrays every result carries its rounding bound. A finding is reproduced by
a subclass that replaces one small method.

Array names end in ``_n`` particle, ``_p`` directed pair, ``_c`` Cartesian axis. Source: manual, fix rheo; Palermo et
al., Phys. Fluids 36, 113337 (2024); the papers named at each stage.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from eos_ref import interactions, kernels, per_atom, rounded_eos
from eos_ref.columns import Axes, Number, axes, dot, joined, matrix
from eos_ref.elementary import maximum, sqrt, where
from eos_ref.errors import InputError
from eos_ref.matrices import cholesky, solve_unit
from eos_ref.model import BoolArray, Box, Gradients, IntArray, Model, PairTerms, Surface
from eos_ref.pairs import directed_pairs
from eos_ref.rounded import ROUNDING, Decision, Rounded, error, value


def is_class(class_n: Number, wanted: int) -> Any:
    """Whether particles are of a surface class; open where rounding leaves the class open."""
    if isinstance(class_n, Rounded):
        return Decision(class_n.value == wanted, class_n.error > 0)
    return class_n == wanted


class Plain:
    """Stages of a force evaluation for particles of a model in a box.

    Parameters
    ----------
    model : Model
    box : Box
    type_n : (n,) types, 1 to N
    solid_n : (n,) whether a particle is solid; may be set anew when phases change
    """

    def __init__(self, model: Model, box: Box, type_n: IntArray, solid_n: BoolArray) -> None:
        self.model, self.box, self.solid_n = model, box, solid_n
        self.type_n = np.asarray(type_n)
        self.n = len(self.type_n)
        of_type = self.type_n - 1
        self.mass_n, self.rho0_n, self.cs_n = model.mass[of_type], model.rho0[of_type], model.cs[of_type]
        self.walls = model.fix.interface_reconstruct

    # --- stage 1: pairs, kernel values, coordination

    def move(self, x_nc: Number) -> None:
        """Find the pairs of new positions and evaluate the kernel once for all sums."""
        model, cut = self.model, self.model.cut
        if not np.isfinite(value(x_nc).astype(float)).all():
            raise InputError("positions", "must be finite; the time step may be too long")
        self.i, self.j, shift_pc = directed_pairs(value(x_nc).astype(float), self.box, cut)
        x = axes(x_nc)
        self.x = [x_n[self.i] - (x_n[self.j] + shift_pc[:, a]) for a, x_n in enumerate(x)]
        self.rr = dot(self.x, self.x)
        self.r = sqrt(self.rr)
        sigma = self.constant(kernels.normalisation(model.dimension, cut))
        q = self.r / model.h
        self.w = sigma * kernels.quintic(q)
        slope = sigma / model.h * kernels.quintic_slope(q)
        self.gradw = [slope * x_p / self.r for x_p in self.x]
        self.g = self.gradw
        self.coordination_n = np.bincount(self.i, minlength=self.n)
        self.corrected_n = np.zeros(self.n, bool)

    def constant(self, factor: Number) -> Number:
        """A parameter's value; its evaluation rounds at most nine times on either side (kernel: pi, h, powers)."""
        return Rounded(factor, 5 * ROUNDING * abs(factor)) if isinstance(self.r, Rounded) else factor

    def total(self, term_p: Number) -> Number:
        """Sum over the neighbours of every particle."""
        if isinstance(term_p, Rounded):
            return term_p.sum_by(self.i, self.n)
        if term_p.dtype == np.float64:
            return np.bincount(self.i, term_p, self.n)
        total_n = np.zeros(self.n, term_p.dtype)
        np.add.at(total_n, self.i, term_p)
        return total_n

    # --- stage 2: density by summation

    def density_sum(self) -> Number:
        r"""Density of rho/sum: :math:`m_iW(0)+\sum_jm_jW_{ij}`; with self/mass :math:`m_i` for :math:`m_j`.

        Source: manual; self/mass as Hu & Adams, J. Comput. Phys. 213, 844 (2006).
        """
        w0 = self.constant(kernels.self_value(self.model.dimension, self.model.cut))
        if self.model.fix.self_mass:
            return self.mass_n * (w0 + self.total(self.w))
        return self.mass_n * w0 + self.total(self.mass_n[self.j] * self.w)

    # --- stage 3: reproducing kernels

    def volume_of_wall(self, rho_n: Number) -> Number:
        """Volume of every particle; a reconstructed solid is never thinner than its equilibrium density."""
        return self.mass_n / self.apparent_density(rho_n)

    def apparent_density(self, rho_n: Number) -> Number:
        """Density with which a particle meets one of the other phase."""
        return where(self.solid_n, maximum(rho_n, self.rho0_n), rho_n) if self.walls else rho_n

    def correct(self, rho_n: Number) -> None:
        r"""Gradients of the reproducing kernels RK1 and RK2, for both sides of every pair.

        :math:`\mathbf M_i=\sum_jV_jW_{ij}\mathbf H\mathbf H^T`,
        :math:`(\widetilde\nabla W_{ij})_a=-\frac1{r_c}W_{ij}\mathbf H\cdot\mathbf M_i^{-1}\mathbf e_{1+a}`: the moving
        least-squares derivative. A particle with fewer than zmin neighbours, or whose matrix has no Cholesky factor,
        keeps the quintic spline. RK0 has no unique gradient and keeps it too.

        Source: Bonet & Lok, CMAME 180, 97 (1999); Palermo et al. (2024).
        """
        if not self.model.corrects_gradients:
            return
        volume_p = self.volume_of_wall(rho_n)[self.j]
        h = kernels.basis(self.model.order, [x_p / self.model.cut for x_p in self.x])
        weight = volume_p * self.w
        m = [[self.total(weight * h[a] * h[b]) for b in range(a + 1)] for a in range(len(h))]
        factor, definite_n = cholesky(m)
        used_n = definite_n & (self.coordination_n >= self.model.fix.zmin)
        self.corrected_n = used_n.answer & ~used_n.open if isinstance(used_n, Decision) else used_n
        used_p = used_n[self.i]
        self.g = []
        for a in range(self.model.dimension):
            c = solve_unit(factor, 1 + a)
            product = h[0] * c[0][self.i]
            for h_b, c_b in zip(h[1:], c[1:], strict=True):
                product = product + h_b * c_b[self.i]
            self.g.append(where(used_p, -(self.w * product) / self.model.cut, self.gradw[a]))

    # --- stage 4: walls

    def interface(self, rho_n: Number, acceleration_nc: Number, energy_n: Number = None) -> tuple[Number, Number]:
        r"""Same-phase fraction chi of all particles, and densities with those of solids extrapolated from the fluid.

        :math:`\chi_i=\sum_{s_j=s_i}W_{ij}/\sum_jW_{ij}`;
        :math:`P_s=\sum_fW_{sf}[P_f+\rho_f(\mathbf g_f-\mathbf a_s)\cdot\mathbf x_{sf}]/\sum_fW_{sf}`,
        :math:`\rho_s=\mathrm{EOS}_s^{-1}(P_s)`, at least :math:`\rho_0/10`; :math:`\rho_0` without fluid neighbours.
        ``acceleration_nc`` holds the fluid's acceleration without pressure, and the solid's own.

        Source: Adami, Hu & Adams, J. Comput. Phys. 231, 7057 (2012); Palermo et al. (2024).
        """
        i, j = self.i, self.j
        a = axes(acceleration_nc)
        p_n = self.pressure(rho_n, energy_n)
        reach = dot([a_n[j] - a_n[i] for a_n in a], self.x)
        wall_p = self.solid_n[i] & ~self.solid_n[j]
        support_n = self.total(where(wall_p, self.w, 0.0))
        met_n = value(support_n) > 0
        sum_n = self.total(where(wall_p, self.w * (p_n[j] + rho_n[j] * reach), 0.0))
        p_wall_n = sum_n / where(met_n, support_n, 1.0)
        wall_n = self.density(p_wall_n, energy_n)
        # Below the pressure of vacuum Tait's law has no density: the lower limit applies.
        background_n = np.array([law.background for law in self.model.eos])[self.type_n - 1]
        torn = np.isnan(value(wall_n)) & (value(p_wall_n) < background_n)
        wall_n = maximum(where(torn, 0.0, wall_n), self.constant(self.rho0_n / 10))
        return self.same_phase(), where(self.solid_n, where(met_n, wall_n, self.rho0_n), rho_n)

    def same_phase(self) -> Number:
        r"""Same-phase fraction :math:`\chi_i=\sum_{s_j=s_i}W_{ij}/\sum_jW_{ij}`; 0 without neighbours."""
        same_p = self.solid_n[self.i] == self.solid_n[self.j]
        lonely = value(self.coordination_n) == 0
        return self.total(where(same_p, self.w, 0.0)) / where(lonely, 1.0, self.total(self.w))

    def density_pair(self, rho_n: Number) -> tuple[Number, Number]:
        """Densities of both particles as the pair sees them; see `apparent_density`, solids see rho0 of each other."""
        i, j = self.i, self.j
        if not self.walls:
            return rho_n[i], rho_n[j]
        apparent_n = self.apparent_density(rho_n)
        both = self.solid_n[i] & self.solid_n[j]
        return tuple(where(both, self.rho0_n[k], apparent_n[k]) for k in (i, j))

    def velocity_difference(self, v_nc: Number, chi_n: Number) -> Axes:
        """Velocity of i less that of j, a solid's as its fluid partner sees it (no slip at the interface)."""
        v = axes(v_nc)
        if not self.walls:
            return [v_n[self.i] - v_n[self.j] for v_n in v]
        solid_i, solid_j = self.solid_n[self.i], self.solid_n[self.j]
        chi_i, chi_j = chi_n[self.i], chi_n[self.j]
        ratio = self.no_slip(where(solid_i, chi_i, chi_j), where(solid_i, chi_j, chi_i))
        difference = []
        for v_i, v_j in ((v_n[self.i], v_n[self.j]) for v_n in v):
            seen_i = where(solid_i & ~solid_j, self.wall_velocity(v_i, v_j, ratio), v_i)
            seen_j = where(solid_j & ~solid_i, self.wall_velocity(v_j, v_i, ratio), v_j)
            difference.append(seen_i - seen_j)
        return difference

    def wall_velocity(self, v_solid: Number, v_fluid: Number, ratio: Number) -> Number:
        r"""Velocity of a solid as a fluid particle sees it, :math:`\mathbf v_s+(\mathbf v_s-\mathbf v_f)k`."""
        return v_solid + (v_solid - v_fluid) * ratio

    def no_slip(self, chi_solid: Number, chi_fluid: Number) -> Number:
        """Factor of the velocity extrapolation; see `interactions.no_slip_ratio`."""
        return interactions.no_slip_ratio(chi_solid, chi_fluid, self.model.cut)

    # --- stage 5: gradients

    def gradients(
        self,
        chi_n: Number = None,
        v_nc: Number = None,
        rho_n: Number = None,
        energy_n: Number = None,
        viscosity_n: Number = None,
        want: Sequence[str] = ("v", "rho"),
    ) -> Gradients:
        r"""Gradients :math:`(\nabla f)_i=\sum_jV_j(f_j-f_i)\widetilde\nabla W_{ij}` of the fields wanted."""
        rho_i, rho_j = self.density_pair(rho_n)
        volume = self.mass_n[self.j] / rho_j
        found = Gradients()
        if "v" in want:
            v = self.velocity_difference(v_nc, chi_n)
            found.v_ncc = joined([[self.total(-(volume * v_a) * g_b) for g_b in self.g] for v_a in v])
        if "rho" in want:
            found.rho_nc = self._gradient(volume, rho_j - rho_i)
        if "energy" in want:
            found.energy_nc = self._gradient(volume, energy_n[self.j] - energy_n[self.i])
        if "viscosity" in want:
            found.viscosity_nc = self._gradient(volume, viscosity_n[self.j] - viscosity_n[self.i])
        return found

    def _gradient(self, volume_p: Number, difference_p: Number) -> Number:
        return joined([self.total(volume_p * difference_p * g_a) for g_a in self.g])

    # --- stages 6 and 7: shifting, surfaces

    def shift(self, v_nc: Number, rho_n: Number) -> Number:
        r"""Shifting velocity :math:`-2h|\mathbf v_i|\sum_jV_j[1+\frac15(W_{ij}/W(h))^4]\nabla_iW_{ij}`, 0 for solids.

        Types of exclude/type get none; scale/cross/type scales it along the normal of the color function, and turns it
        off where too little of a particle's own type supports it. Source: manual; Lind et al., J. Comput. Phys. 231,
        1499 (2012); Yang et al., J. Comput. Phys. 458, 111079 (2022).
        """
        shift = self.raw_shift(axes(v_nc), rho_n)
        setting = self.model.fix.shift
        if setting and setting.scale_cross_type:
            shift = self._cross_type(shift, self.volume_of_wall(rho_n)[self.j], *setting.scale_cross_type)
        return joined(shift)

    def raw_shift(self, v: Axes, rho_n: Number) -> Axes:
        """Shifting velocity before any scaling."""
        model = self.model
        w_h = self.constant(kernels.normalisation(model.dimension, model.cut)) * kernels.quintic(1.0)
        weight = self.volume_of_wall(rho_n)[self.j] * interactions.shift_weight(self.w, w_h)
        scale = -2 * model.h * sqrt(dot(v, v))
        moves = ~self.solid_n & model.shifted_t[self.type_n - 1]
        return [where(moves, scale * self.total(weight * g_a), 0.0) for g_a in self.gradw]

    def _cross_type(self, shift: Axes, volume: Number, keep: float, cmin: float, wmin: float) -> Axes:
        other = self.type_n[self.i] != self.type_n[self.j]
        color_n = self.total(where(other, volume * self.w, 0.0))
        same_n = self.same_type_support(other)
        normal = self.cross_type_normal(other, volume)
        along = (1 - keep) * dot(normal, shift)
        scaled = [s - n * along for s, n in zip(shift, normal, strict=True)]
        return [
            where(same_n < wmin, 0.0, where(color_n >= cmin, new, old)) for new, old in zip(scaled, shift, strict=True)
        ]

    def same_type_support(self, other: BoolArray) -> Number:
        r"""Support by particles of the same type, :math:`\sum_jW_{ij}\delta_{ij}` (manual)."""
        return self.total(where(other, 0.0, self.w))

    def cross_type_normal(self, other: BoolArray, volume: Number) -> Axes:
        """Unit normal of the interface between types, the direction of the color function's gradient; or 0."""
        gradient = [self.total(where(other, volume * g_a, 0.0)) for g_a in self.gradw]
        size = sqrt(dot(gradient, gradient))
        none = value(size) == 0
        return [where(none, 0.0, c / where(none, 1.0, size)) for c in gradient]

    def surface(self, rho_n: Number, shift_nc: Number = None) -> tuple[Surface, Number]:
        r"""Free surfaces, and the shift without its outward part there.

        :math:`\nabla\cdot\mathbf r=-\sum_jV_j\mathbf x_{ij}\cdot\nabla_iW_{ij}`, normal
        :math:`-\nabla C/(|\nabla C|+10^{-10})` with :math:`\nabla C=\sum_jV_j\nabla_iW_{ij}`. Fluid below the limit is
        splash (2) with fewer than limit/splash neighbours, else surface (1). Source: manual; Palermo et al. (2024).
        """
        setting = self.model.fix.surface_detection
        assert setting is not None
        volume = self.mass_n[self.j] / self.density_pair(rho_n)[1]
        divr_n = self.total(-(volume * dot(self.x, self.gradw)))
        gradient = [self.total(volume * g_a) for g_a in self.gradw]
        size = sqrt(dot(gradient, gradient)) + interactions.NORMAL_SOFTENING
        low = (self.coordination_n if setting.style == "coordination" else divr_n) < setting.limit
        candidate = ~self.solid_n & low
        splash = self.coordination_n < setting.splash
        class_n = where(candidate, where(splash, 2.0, 1.0), 0.0)
        normal = [where(is_class(class_n, 1), -(c / size), 0.0) for c in gradient]
        distance_n = self._distance(class_n)
        if shift_nc is not None:
            shift_nc = joined(self._inward(axes(shift_nc), normal, class_n))
        return Surface(class_n, distance_n, joined(normal), divr_n), shift_nc

    def _distance(self, class_n: Number) -> Number:
        """Distance to the nearest surface particle, at most the cutoff; 0 on the surface, the cutoff for solids."""
        near = (value(class_n) == 1)[self.j] & ~self.solid_n[self.i]
        nearest_n = np.full(self.n, self.model.cut)
        np.minimum.at(nearest_n, self.i[near], value(self.r)[near].astype(float))
        nearest_n[value(class_n) > 0] = 0.0
        if isinstance(self.r, Rounded):
            open_n = error(class_n) > 0  # its own class, or that of a neighbour
            open_n = open_n | (np.bincount(self.i[open_n[self.j]], minlength=self.n) > 0)
            return Rounded(nearest_n, self.r.error.max(initial=0.0) + open_n * self.model.cut)
        return nearest_n

    def _inward(self, shift: Axes, normal: Axes, class_n: Number) -> Axes:
        outward = maximum(dot(normal, shift), 0.0)
        return [where(is_class(class_n, 2), 0.0, s - n * outward) for s, n in zip(shift, normal, strict=True)]

    # --- stages 8 to 10: properties of a particle

    def viscosity(self, gradient_ncc: Number = None) -> Number:
        """Viscosity of every particle; the style power needs the velocity gradient."""
        laws = self.model.viscosity
        eta_t, gd0_t, K_t, n_t = (np.array([getattr(law, k) for law in laws]) for k in ("eta", "gd0", "K", "n"))
        t = self.type_n - 1
        if all(law.style == "constant" for law in laws):
            return eta_t[t]
        rate = per_atom.strain_rate(matrix(gradient_ncc))
        power = np.array([law.style == "power" for law in laws])[t]
        gd0_n = np.where(power, gd0_t[t], 1.0)  # any rate but 0, which the style constant has
        return where(power, per_atom.power_viscosity(eta_t[t], gd0_n, K_t[t], n_t[t], rate), eta_t[t])

    def pressure(self, rho_n: Number, energy_n: Number = None) -> Number:
        """Pressure of every particle from its stored density; the energy is that of the particle."""
        e_n = None if energy_n is None else energy_n / self.mass_n
        return rounded_eos.by_type(rounded_eos.pressure, self.model.eos, self.type_n, rho_n, e_n)

    def density(self, p_n: Number, energy_n: Number = None) -> Number:
        """Density at which the equation of state of a particle's type has a pressure."""
        e_n = None if energy_n is None else energy_n / self.mass_n
        return rounded_eos.by_type(rounded_eos.density, self.model.eos, self.type_n, p_n, e_n)

    def sound_speed(self, energy_n: Number = None) -> Number:
        r"""Speed of sound for the pair terms: that of fix rheo, and :math:`\sqrt{(\gamma-1)e}` of an ideal gas."""
        gas_t = np.array([law.needs_energy for law in self.model.eos])
        if energy_n is None or not gas_t.any():
            return self.cs_n
        gamma_t = np.array([law.gamma for law in self.model.eos])
        gas = gas_t[self.type_n - 1]
        squared = (where(gas, gamma_t[self.type_n - 1], 1.0) - 1) * (energy_n / self.mass_n)
        return where(gas, sqrt(maximum(squared, 0.0)), self.cs_n)

    def temperature(self, energy_n: Number) -> Number:
        """Temperature of every particle from its stored energy."""
        thermal = self.model.thermal
        assert thermal is not None
        t = self.type_n - 1
        cv_n = np.array([p.specific_heat for p in thermal])[t]
        latent_n = np.array([p.latent_heat for p in thermal])[t]
        freezes = np.array([p.T_freeze is not None for p in thermal])[t]
        T_freeze = np.array([p.T_freeze or 0.0 for p in thermal])[t]
        return per_atom.temperature(self.specific_energy(energy_n), cv_n, latent_n, freezes, T_freeze)

    def specific_energy(self, energy_n: Number) -> Number:
        """Energy per unit mass, of which the temperature is a function."""
        return energy_n / self.mass_n

    # --- stage 11: pair terms

    def pair_terms(
        self,
        v_nc: Number,
        rho_n: Number,
        pressure_n: Number,
        viscosity_n: Number,
        sound_n: Number,
        chi_n: Number,
        grad: Gradients,
        temperature_n: Number = None,
    ) -> PairTerms:
        """Forces, density diffusion and heat flow of pair_style rheo; see `eos_ref.interactions`.

        ``pressure_n`` is that of the `apparent_density`.
        """
        model, i, j = self.model, self.i, self.j
        rho_i, rho_j = self.density_pair(rho_n)
        volume_i, volume_j = self.collecting_volume(rho_i), self.mass_n[j] / rho_j
        xg = dot(self.x, self.g)
        mechanical = ~(self.solid_n[i] & self.solid_n[j])
        mean = interactions.harmonic_mean if model.pair.harmonic_means else interactions.arithmetic_mean
        sound = interactions.arithmetic_mean(sound_n[i], sound_n[j])
        p_sum = pressure_n[i] + pressure_n[j]
        if model.pair.artificial_viscosity:
            p_sum = p_sum + self.artificial(v_nc, rho_n, sound, grad)
        coefficient = where(mechanical, interactions.pressure_term(volume_i, volume_j, p_sum), 0.0)
        pressure_force = [self.total(coefficient * g_a) for g_a in self.g]
        eta = mean(viscosity_n[i], viscosity_n[j])
        coefficient = where(mechanical, interactions.viscous_term(eta, volume_i, volume_j, xg, self.rr), 0.0)
        force = [
            f_a + self.total(coefficient * v_a)
            for f_a, v_a in zip(pressure_force, self.velocity_difference(v_nc, chi_n), strict=True)
        ]
        if self.walls:
            repulsion = self.repulsion(chi_n, sound) / self.r
            force = [f_a + self.total(repulsion * x_a) for f_a, x_a in zip(force, self.x, strict=True)]
        heat_n = None
        if model.thermal is not None:
            kappa_n = self.conduction()
            kappa = mean(kappa_n[i], kappa_n[j])
            flow = interactions.heat_term(kappa, self.heated_volume(rho_i, rho_j), volume_j, xg, self.rr)
            heat_n = self.total(flow * (temperature_n[i] - temperature_n[j]))
        drho_n = self.diffusion(rho_n, volume_j, xg, grad)
        return PairTerms(joined(force), joined(pressure_force), drho_n, heat_n)

    def collecting_volume(self, rho_i: Number) -> Number:
        """Volume of the particle that a pair's force acts on."""
        return self.mass_n[self.i] / rho_i

    def heated_volume(self, rho_i: Number, rho_j: Number) -> Number:
        """Volume of the particle that a pair's heat flows into."""
        return self.mass_n[self.i] / rho_i

    def conduction(self) -> Number:
        """Conductivity of every particle."""
        assert self.model.thermal is not None
        return np.array([p.conductivity for p in self.model.thermal])[self.type_n - 1]

    def artificial(self, v_nc: Number, rho_n: Number, sound: Number, grad: Gradients) -> Number:
        """Artificial viscous pressure of every pair; not between fluid and reconstructed solid."""
        i, j = self.i, self.j
        u = [v_n[i] - v_n[j] for v_n in axes(v_nc)]
        G = [[0.5 * (c_n[i] + c_n[j]) for c_n in row] for row in matrix(grad.v_ncc)]
        u = [u_a - dot(G_a, self.x) for u_a, G_a in zip(u, G, strict=True)]
        zeta = self.model.pair.artificial_viscosity
        q = interactions.artificial_term(zeta, sound, dot(u, self.x), self.rr, self.model.h, rho_n[i] + rho_n[j])
        return where(self.solid_n[i] != self.solid_n[j], 0.0, q) if self.walls else q

    def repulsion(self, chi_n: Number, sound: Number) -> Number:
        """Extra repulsion of fluid and solid close to each other; see `interactions.repulsion_term`."""
        i, j = self.i, self.j
        solid_i = self.solid_n[i]
        chi = where(solid_i, chi_n[i], chi_n[j])
        rho0 = where(solid_i, self.rho0_n[i], self.rho0_n[j])
        term = interactions.repulsion_term(chi, self.r, rho0, sound, self.model.cut)
        return where(solid_i != self.solid_n[j], term, 0.0)

    def diffusion(self, rho_n: Number, volume_j: Number, xg: Number, grad: Gradients) -> Number:
        """Rate of density by rho/damp, between fluid particles."""
        xi = self.model.pair.rho_damp
        if not xi:
            return np.zeros(self.n)
        i, j = self.i, self.j
        if self.model.corrects_gradients:
            slope = [0.5 * (g_n[i] + g_n[j]) for g_n in axes(grad.rho_nc)]
            difference = rho_n[j] - rho_n[i] + dot(slope, self.x)
        else:
            difference = (rho_n[j] - self.rho0_n[j]) - (rho_n[i] - self.rho0_n[i])
        fluid = ~self.solid_n[i] & ~self.solid_n[j]
        return self.total(where(fluid, interactions.diffusion_term(xi, volume_j, difference, xg, self.rr), 0.0))
