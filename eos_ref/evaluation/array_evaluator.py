r"""The particle model in plain array operations: readable, and for several number types.

Pairs are directed: every pair within the cutoff is listed twice, once for each of its particles i, which collects the
terms. A finding is reproduced by a subclass that replaces one small method. Array names are those of
`eos_ref.evaluation.evaluator`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from eos_ref.eos import rounded_eos
from eos_ref.eos.table import FloatArray
from eos_ref.errors import InputError
from eos_ref.evaluation.evaluator import Evaluator, PairInput
from eos_ref.evaluation.pairs import ROWS, Candidates, apart, candidates, directed_pairs
from eos_ref.kernels.reproducing import basis
from eos_ref.model import interactions
from eos_ref.model.box import BoolArray
from eos_ref.model.parameters import IntArray
from eos_ref.model.state import Gradients, PairTerms, State
from eos_ref.numbers.columns import Axes, axes, dot, joined, matrix, summed, symmetric
from eos_ref.numbers.elementary import N, sqrt, where
from eos_ref.numbers.matrices import cholesky, solve_unit
from eos_ref.numbers.number import Array, Number
from eos_ref.numbers.rounded import ROUNDING, Decision, Rounded, error, value


class ArrayEvaluator(Evaluator):
    """Stages of a force evaluation in plain array operations; see `Evaluator` for the parameters."""

    by_rows = True  # whether the sums of a particle depend on itself and its neighbours alone
    candidates: Candidates | None = None  # of the last search
    loops: Any = None  # the slowest parts, compiled: `eos_ref.evaluation.pair_loops`, once it is imported

    # --- pairs, kernel values, coordination

    def pairs(self, x_nc: FloatArray, cut: float) -> tuple[IntArray, IntArray, FloatArray]:
        """Return the directed pairs closer than a cutoff; see `directed_pairs`."""
        if len(x_nc) > ROWS:  # what is kept for the next step takes memory
            return directed_pairs(x_nc, self.box, cut)
        if self.candidates is None or not self.candidates.hold(x_nc, self.box, cut):
            self.candidates = candidates(x_nc, self.box, cut)
        near = self.candidates
        if self.loops:
            return self.loops.near(x_nc, near.i, near.j, near.shift_pc, cut)  # type: ignore[no-any-return]
        return near.closer(x_nc, cut)

    def move(self, x_nc: Array) -> None:
        if not np.isfinite(value(x_nc).astype(float)).all():
            raise InputError("positions", "must be finite; the time step may be too long")
        self.i, self.j, self.shift_pc = self.pairs(value(x_nc).astype(float), self.model.cut)
        self.kernel_values(x_nc)
        self.g = self.gradw
        self.count(x_nc)

    def count(self, x_nc: Array) -> None:
        """Set the coordination from the pairs; no gradient is corrected yet."""
        self.coordination_n = np.bincount(self.i, minlength=self.n)
        self.corrected_n = np.zeros(self.n, bool)

    def kernel_values(self, x_nc: Array) -> None:
        """Set displacements and distances of the pairs, values and gradients of their kernel."""
        if self.loops and self.loops.set_kernel_values(self, x_nc):
            return
        model, kernel = self.model, self.model.kernel
        self.x = [apart(x_n, self.i, self.j, self.shift_pc[:, a]) for a, x_n in enumerate(axes(x_nc))]
        self.rr = dot(self.x, self.x)
        self.r = sqrt(self.rr)
        sigma = self.constant(kernel.normalisation(model.dimension, model.cut))
        q = self.r / model.h
        self.w = sigma * kernel.shape(q)
        slope = sigma / model.h * kernel.slope(q)
        self.gradw = [slope * x_p / self.r for x_p in self.x]

    def velocities_met(self, v_nc: Array) -> Iterator[tuple[Array, Array]]:
        """Yield, by axis, the velocities of i and of the image of j for every pair, (p,)."""
        for a, v_n in enumerate(axes(v_nc)):
            v_i, v_j = v_n[self.i], v_n[self.j]
            if self.image_velocity_cc is not None:
                image_pc = self.box.periods(self.shift_pc)
                moving_p = self.constant(image_pc @ self.image_velocity_cc[:, a])
                if isinstance(moving_p, Rounded):
                    moving_p.error = moving_p.error + np.abs(image_pc) @ self.image_rounding_cc[:, a]
                v_j = v_j + moving_p
            yield v_i, v_j

    def constant(self, factor: N) -> N:
        """Return a parameter's value; its evaluation rounds at most nine times on either side (pi, h, powers)."""
        if not isinstance(self.r, Rounded):
            return factor
        return Rounded(factor, 5 * ROUNDING * abs(factor))  # type: ignore[return-value]

    def total(self, term_p: Any) -> Any:
        """Return the sums over the neighbours of every particle, (n,), of terms (p,)."""
        if isinstance(term_p, Rounded):
            return term_p.sum_by(self.i, self.n)
        if term_p.dtype == np.float64:
            return (self.loops.total if self.loops else np.bincount)(self.i, term_p, self.n)
        total_n = np.zeros(self.n, term_p.dtype)
        np.add.at(total_n, self.i, term_p)
        return total_n

    def any_neighbour(self, holds: Callable[[Any, Any], BoolArray], of_n: Any) -> BoolArray:
        """Return for which particles a relation holds between their value and that of any neighbour, (n,)."""
        return np.bincount(self.i, holds(of_n[self.i], of_n[self.j]), self.n) > 0

    def kernel_sum(self, weight_n: Array | None = None) -> Array:
        return self.total(self.w if weight_n is None else weight_n[self.j] * self.w)  # type: ignore[no-any-return]

    # --- reproducing kernels

    def correct(self, rho_n: Array) -> None:
        r"""Evaluate the gradients of the reproducing kernels RK1 and RK2, for both sides of every pair.

        :math:`\mathbf M_i=\sum_jV_jW_{ij}\mathbf H\mathbf H^T`,
        :math:`(\widetilde\nabla W_{ij})_a=-\frac1{r_c}W_{ij}\mathbf H\cdot\mathbf M_i^{-1}\mathbf e_{1+a}`: the moving
        least-squares derivative. A particle with fewer than zmin neighbours, or whose matrix has no Cholesky factor,
        keeps the quintic spline. RK0 has no unique gradient and keeps it too.

        Source: Bonet & Lok, CMAME 180, 97 (1999); Palermo et al. (2024).
        """
        if not self.model.corrects_gradients:
            return
        h, m = self.moments(rho_n)
        factor, definite_n = cholesky(m)
        used_n = self.corrects(definite_n)
        self.corrected_n = used_n.answer & ~used_n.open if isinstance(used_n, Decision) else used_n
        self.correction = used_n, [solve_unit(factor, 1 + a) for a in range(self.model.dimension)]
        self.corrected_gradients(h)

    def corrected_gradients(self, h: list[Array]) -> None:
        """Set the gradients by the correction of every particle, for bases of pairs, functions of shape (p,)."""
        used_n, coefficients = self.correction
        used_p = used_n[self.i]
        self.g = []
        for a, c in enumerate(coefficients):
            product = h[0] * c[0][self.i]
            for h_b, c_b in zip(h[1:], c[1:], strict=True):
                product = product + h_b * c_b[self.i]
            self.g.append(where(used_p, -(self.w * product) / self.model.cut, self.gradw[a]))

    def follow(self, x_nc: Array) -> None:
        """Find the pairs of positions in a box that has changed; particles keep their corrections."""
        self.move(x_nc)
        if self.model.corrects_gradients:
            self.corrected_gradients(basis(self.model.order, [x_p / self.model.cut for x_p in self.x]))

    def corrects(self, definite_n: Any) -> Any:
        """Return which particles use the reproducing kernel's gradients, (n,), of those with a definite matrix."""
        return definite_n & (self.coordination_n >= self.model.fix.zmin)

    def moments(self, rho_n: Array) -> tuple[list[Array], list[list[Array]]]:
        """Return the bases of pairs, functions of shape (p,), and the moment matrices; see `correct`.

        Of these the lower triangles, row by row, with entries of shape (n,).
        """
        volume_p = self.volume_of_wall(rho_n)[self.j]
        h = basis(self.model.order, [x_p / self.model.cut for x_p in self.x])
        weight = volume_p * self.w
        weighted = [weight * h_a for h_a in h]
        return h, [[self.total(weighted[a] * h[b]) for b in range(a + 1)] for a in range(len(h))]

    # --- walls

    def wall_sums(self, pressure_n: Array, rho_n: Array, acceleration_nc: Array) -> tuple[Array, ...]:
        i, j = self.i, self.j
        reach = dot([a_n[j] - a_n[i] for a_n in axes(acceleration_nc)], self.x)
        wall_p = self.solid_n[i] & ~self.solid_n[j]
        support_n = self.total(where(wall_p, self.w, 0.0))
        sum_n = self.total(where(wall_p, self.w * (pressure_n[j] + rho_n[j] * reach), 0.0))
        return *self.phase_sums(), support_n, sum_n

    def same_phase(self) -> Array:
        """Return the same-phase fractions alone, without the densities of walls; see `Evaluator.same_fraction`."""
        return self.same_fraction(*self.phase_sums())

    def phase_sums(self) -> tuple[Array, Array]:
        """Return the sums of the kernel over all neighbours, and over those of the same phase."""
        same_p = self.solid_n[self.i] == self.solid_n[self.j]
        return self.total(self.w), self.total(where(same_p, self.w, 0.0))

    def density_pair(self, rho_n: Array) -> tuple[Array, Array]:
        """Return the densities that pair terms use for i and j, (p,).

        `apparent_density`, but rho0 between two reconstructed solids.
        """
        i, j = self.i, self.j
        if not self.walls:
            return rho_n[i], rho_n[j]
        apparent_n = self.apparent_density(rho_n)
        both = self.solid_n[i] & self.solid_n[j]
        rho_i, rho_j = (where(both, self.rho0_n[k], apparent_n[k]) for k in (i, j))
        return rho_i, rho_j

    def velocity_difference(self, v_nc: Array, chi_n: Array | None) -> Axes:
        """Return v_i - v_j; with walls, a solid's velocity is the one extrapolated for its fluid partner (no slip)."""
        if not self.walls:
            return [v_i - v_j for v_i, v_j in self.velocities_met(v_nc)]
        assert chi_n is not None
        solid_i, solid_j = self.solid_n[self.i], self.solid_n[self.j]
        chi_i, chi_j = chi_n[self.i], chi_n[self.j]
        ratio = self.no_slip(where(solid_i, chi_i, chi_j), where(solid_i, chi_j, chi_i))
        difference = []
        for v_i, v_j in self.velocities_met(v_nc):
            met_i = where(solid_i & ~solid_j, self.wall_velocity(v_i, v_j, ratio), v_i)
            met_j = where(solid_j & ~solid_i, self.wall_velocity(v_j, v_i, ratio), v_j)
            difference.append(met_i - met_j)
        return difference

    def wall_velocity(self, v_solid: Array, v_fluid: Array, ratio: Array) -> Array:
        r"""Return the velocity of a solid seen by a fluid, :math:`\mathbf v_s+(\mathbf v_s-\mathbf v_f)k`."""
        return v_solid + (v_solid - v_fluid) * ratio

    def no_slip(self, chi_solid: Array, chi_fluid: Array) -> Array:
        """Return the factor of the velocity extrapolation; see `interactions.no_slip_ratio`."""
        return interactions.no_slip_ratio(chi_solid, chi_fluid, self.model.cut)

    # --- gradients

    def gradients(self, state: State, chi_n: Array | None = None, want: Sequence[str] = ("v", "rho")) -> Gradients:
        rho_i, rho_j = self.density_pair(state.rho_n)
        volume = self.mass_n[self.j] / rho_j
        gradients = Gradients()
        if "v" in want:
            v = [-(volume * v_a) for v_a in self.velocity_difference(state.v_nc, chi_n)]
            gradients.v_ncc = joined([[self.total(v_a * g_b) for g_b in self.g] for v_a in v])
        if "rho" in want:
            gradients.rho_nc = self._gradient(volume, rho_j - rho_i)
        if "energy" in want:
            gradients.energy_nc = self._gradient(volume, state.energy_n[self.j] - state.energy_n[self.i])
        return gradients

    def _gradient(self, volume_p: Array, difference_p: Array) -> Array:
        weight_p = volume_p * difference_p
        return joined([self.total(weight_p * g_a) for g_a in self.g])

    # --- shifting, surfaces

    def shift_sums(self, volume_n: Array, w_h: Number) -> Axes:
        weight = volume_n[self.j] * interactions.shift_weight(self.w, w_h)
        return [self.total(weight * g_a) for g_a in self.gradw]

    def color_sums(self, volume_n: Array) -> tuple[Axes, Array, Array]:
        other, volume = self.type_n[self.i] != self.type_n[self.j], volume_n[self.j]
        gradient = [self.total(where(other, self.sloping_volume(volume_n) * g_a, 0.0)) for g_a in self.gradw]
        return gradient, self.total(where(other, volume * self.w, 0.0)), self.same_type_support(other)

    def sloping_volume(self, volume_n: Array) -> Array:
        """Return the volume of the other particle of every pair in the gradient of the color function, (p,)."""
        return volume_n[self.j]

    def same_type_support(self, other: BoolArray) -> Array:
        r"""Return the support by particles of the same type, (n,), by the manual of the version.

        :math:`\sum_jW_{ij}\delta_{ij}`, and from 4 Jul 2026 on :math:`\sum_jr_{ij}W_{ij}\delta_{ij}`.
        """
        support_p = self.w * self.r if self.model.weighs_distance else self.w
        return self.total(where(other, 0.0, support_p))  # type: ignore[no-any-return]

    def surface_sums(self, rho_n: Array) -> tuple[Axes, Array]:
        volume = self.mass_n[self.j] / self.density_pair(rho_n)[1]
        return [self.total(volume * g_a) for g_a in self.gradw], self.total(-(volume * dot(self.x, self.gradw)))

    def nearest(self, class_n: Array) -> Array:
        """Return the distance to the nearest neighbour of class 1, (n,); undecided where a neighbour's class is.

        Without such a neighbour it is the cutoff, which nothing rounds.
        """
        near = (value(class_n) == 1)[self.j]
        nearest_n, error_n = np.full(self.n, self.model.cut), np.zeros(self.n)
        np.minimum.at(nearest_n, self.i[near], value(self.r)[near].astype(float))
        if isinstance(self.r, Rounded):
            np.maximum.at(error_n, self.i[near], self.r.error[near])
            open_n = np.bincount(self.i[(error(class_n) > 0)[self.j]], minlength=self.n) > 0
            return Rounded(nearest_n, error_n + open_n * self.model.cut)
        return nearest_n

    # --- properties of a particle

    def eos_pressure(self, rho_n: Array, e_n: Array | None) -> Array:
        return rounded_eos.by_type(rounded_eos.pressure, self.model.eos, self.type_n, rho_n, e_n)

    # --- pair terms

    def pair_terms(self, fields: PairInput) -> PairTerms:
        v_nc, rho_n, pressure_n, viscosity_n, sound_n, chi_n, grad, temperature_n, virial = fields
        model, i, j = self.model, self.i, self.j
        rho_i, rho_j = self.density_pair(rho_n)
        volume_i, volume_j = self.collecting_volume(rho_i), self.pair_masses()[1] / rho_j
        F = dot(self.x, self.g) / self.rr
        mechanical = ~(self.solid_n[i] & self.solid_n[j])
        sound = interactions.arithmetic_mean(sound_n[i], sound_n[j])
        p_sum = pressure_n[i] + pressure_n[j]
        if model.pair.artificial_viscosity:
            p_sum = p_sum + self.artificial(v_nc, rho_n, sound, grad)
        coefficient = where(mechanical, interactions.pressure_term(volume_i, volume_j, p_sum), 0.0)
        forces = [[coefficient * g_a for g_a in self.g]]
        eta = self.mean(viscosity_n[i], viscosity_n[j])
        coefficient = where(mechanical, interactions.viscous_term(eta, volume_i, volume_j, F), 0.0)
        forces.append([coefficient * v_a for v_a in self.velocity_difference(v_nc, chi_n)])
        if self.walls:
            assert chi_n is not None
            repulsion = self.repulsion(chi_n, sound) / self.r
            forces.append([repulsion * x_a for x_a in self.x])
        if self.coincide():  # there the gradient is undefined; solids have no terms that need it
            forces = [[where(mechanical, f_a, 0.0) for f_a in part] for part in forces]
        pressure_force = [self.total(f_a) for f_a in forces[0]]
        force = pressure_force
        for term in forces[1:]:
            force = [f_a + self.total(t_a) for f_a, t_a in zip(force, term, strict=True)]
        heat_n = None
        if temperature_n is not None:
            kappa_n = self.conduction()
            kappa = self.mean(kappa_n[i], kappa_n[j])
            flow = interactions.heat_term(kappa, self.heated_volume(rho_i, rho_j), volume_j, F)
            heat_n = self.total(flow * (temperature_n[i] - temperature_n[j]))
        drho_n = self.diffusion(rho_n, volume_j, F, grad)
        virials = (
            self.virials([sum(parts[1:], start=parts[0]) for parts in zip(*forces, strict=True)]) if virial else ()
        )
        return PairTerms(joined(force), joined(pressure_force), drho_n, heat_n, *virials)

    def coincide(self) -> bool:
        """Return whether both particles of a pair lie at one place."""
        return not value(self.rr).all()

    def virials(self, force: Axes) -> tuple[Array, Array]:
        r"""Return the virials of forces on the particles of pairs: of every particle, and that of all, (n, d, d).

        :math:`W_{i,ab}=\frac12\sum_jx_{ij,a}f_{ij,b}` for :math:`a\le b`, the other half of the tensor the same.
        """
        virial = symmetric([[0.5 * self.total(x_a * f_b) for f_b in force] for x_a in self.x])
        # The same sum as places times forces, as it is documented, rounds more; m - m is 0 with the errors of m.
        ends = zip(self.box.low_c, self.box.high_c, strict=True)
        reach = [max(abs(low), abs(high)) + self.model.cut for low, high in ends]
        by_places = symmetric([[summed(self.total(x * f_b)) for f_b in force] for x in reach])
        whole = [
            [summed(w_n) + (m_n - m_n) for w_n, m_n in zip(*rows, strict=True)]
            for rows in zip(virial, by_places, strict=True)
        ]
        return joined(virial), joined(whole)

    def mean(self, of_i: Array, of_j: Array) -> Array:
        """Return the mean of a viscosity or conductivity of both particles of every pair, (p,)."""
        harmonic = self.model.pair.harmonic_means
        return (interactions.harmonic_mean if harmonic else interactions.arithmetic_mean)(of_i, of_j)

    def pair_masses(self) -> tuple[Array, Array]:
        """Return the masses of both particles of every pair, (p,), as the terms of pairs take them."""
        return self.mass_n[self.i], self.mass_n[self.j]

    def collecting_volume(self, rho_i: Array) -> Array:
        """Return the volume of the particle that a pair's force acts on."""
        return self.pair_masses()[0] / rho_i

    def heated_volume(self, rho_i: Array, rho_j: Array) -> Array:
        """Return the volume of the particle that a pair's heat flows into."""
        return self.pair_masses()[0] / rho_i

    def artificial(self, v_nc: Array, rho_n: Array, sound: Array, grad: Gradients) -> Array:
        """Return the artificial viscous pressure of every pair, (p,); not between fluid and reconstructed solid."""
        i, j = self.i, self.j
        u = [v_i - v_j for v_i, v_j in self.velocities_met(v_nc)]
        G = [[0.5 * (c_n[i] + c_n[j]) for c_n in row] for row in matrix(grad.v_ncc)]
        u = [u_a - dot(G_a, self.x) for u_a, G_a in zip(u, G, strict=True)]
        zeta = self.model.pair.artificial_viscosity
        q = interactions.artificial_term(zeta, sound, dot(u, self.x), self.rr, self.model.h, rho_n[i] + rho_n[j])
        return where(self.solid_n[i] != self.solid_n[j], 0.0, q) if self.walls else q

    def repulsion(self, chi_n: Array, sound: Array) -> Array:
        """Return the extra repulsion of fluid and solid close to each other; see `interactions.repulsion_term`."""
        i, j = self.i, self.j
        solid_i = self.solid_n[i]
        chi = where(solid_i, chi_n[i], chi_n[j])
        rho0 = where(solid_i, self.rho0_n[i], self.rho0_n[j])
        term = interactions.repulsion_term(chi, self.r, rho0, sound, self.model.cut)
        return where(solid_i != self.solid_n[j], term, 0.0)

    def diffusion(self, rho_n: Array, volume_j: Array, F: Array, grad: Gradients) -> Array:
        """Return the rates of density by rho/damp, between fluid particles, (n,)."""
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
        term_p = interactions.diffusion_term(xi, volume_j, difference, F)
        return self.total(where(fluid, term_p, 0.0))  # type: ignore[no-any-return]
