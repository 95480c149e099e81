"""Compiled terms of pair_style rheo for `eos_ref.fast`: `eos_ref.interactions` summed over all pairs at once."""

# mypy: disable-error-code="untyped-decorator"

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from eos_ref import interactions, loops
from eos_ref.compiled import cached, inline
from eos_ref.loops import Pairs, both_gradients, slip
from eos_ref.vectors import add_to, dot, joined, matrix_times, row, zero

_jit = cached(*loops.SOURCES, "forces.py")

_arithmetic_mean, _harmonic_mean = inline(interactions.arithmetic_mean), inline(interactions.harmonic_mean)
_pressure_term, _artificial_term = inline(interactions.pressure_term), inline(interactions.artificial_term)
_viscous_term, _heat_term = inline(interactions.viscous_term), inline(interactions.heat_term)
_diffusion_term, _repulsion_term = inline(interactions.diffusion_term), inline(interactions.repulsion_term)


class Terms(NamedTuple):
    """Settings of the pair terms; 0 or False turns a term off."""

    zeta: float
    xi: float
    harmonic: bool
    thermal: bool
    walls: bool
    h: float
    cut: float
    like_f: Any


class Fields(NamedTuple):
    """Properties of the particles that pair terms use; those of terms that are off may be of any length.

    ``volume_n`` is the apparent one, ``rest_volume_n`` that of a solid seen by a solid.
    """

    solid_n: Any
    volume_n: Any
    rest_volume_n: Any
    v_nc: Any
    rho_n: Any
    rho0_n: Any
    pressure_n: Any
    viscosity_n: Any
    sound_n: Any
    chi_n: Any
    v_gradient_nf: Any
    rho_gradient_nc: Any
    conductivity_n: Any
    temperature_n: Any


@_jit
def pair_terms(pairs: Pairs, fields: Fields, terms: Terms, like: Any, force_nf: Any, drho_n: Any, heat_n: Any) -> None:
    """Add the force of pressure and artificial viscosity, followed by all other force; density diffusion; heat flow."""
    f = fields
    for i in range(f.solid_n.size):
        force = joined(zero(like), zero(like))
        v_i = row(f.v_nc, i, like)
        for p in range(pairs.start_n[i], pairs.start_n[i + 1]):
            j = pairs.j_p[p]
            solids = int(f.solid_n[i]) + int(f.solid_n[j])
            if solids == 2 and not terms.thermal:
                continue
            volume_i, volume_j = f.volume_n[i], f.volume_n[j]
            if solids == 2:
                volume_i, volume_j = f.rest_volume_n[i], f.rest_volume_n[j]
            x = row(pairs.x_pc, p, like)
            rr = dot(x, x)
            g_i, g_j = both_gradients(pairs, p, like)
            xg_i = dot(x, g_i)
            xg_j = _second_if_corrected(pairs.gi_pc, xg_i, -dot(x, g_j))
            if terms.thermal:
                kappa = _mean(f.conductivity_n[i], f.conductivity_n[j], terms.harmonic)
                difference = f.temperature_n[i] - f.temperature_n[j]
                heat_n[i] += _heat_term(kappa, volume_i, volume_j, xg_i, rr) * difference
                heat_n[j] -= _heat_term(kappa, volume_i, volume_j, xg_j, rr) * difference
            if solids == 2:
                continue
            sound = _arithmetic_mean(f.sound_n[i], f.sound_n[j])
            v = v_i - row(f.v_nc, j, like)
            p_sum = f.pressure_n[i] + f.pressure_n[j]
            if terms.zeta != 0 and not (terms.walls and solids == 1):
                p_sum += _artificial(f, i, j, v, x, rr, sound, terms, like)
            if terms.walls and solids == 1:
                v = (1 + slip(f.chi_n[i], f.chi_n[j], f.solid_n[i], terms.cut)) * v
                repulsion = joined(zero(like), _repulsion(f, i, j, rr, sound, terms) * x)
                force = force + repulsion
                add_to(force_nf, j, -1.0 * repulsion)
            if terms.xi != 0 and solids == 0:
                psi = _density_difference(pairs.gi_pc, f, i, j, x, like)
                drho_n[i] += _diffusion_term(terms.xi, volume_j, psi, xg_i, rr)
                drho_n[j] += _diffusion_term(terms.xi, volume_i, -psi, xg_j, rr)
            push = _pressure_term(volume_i, volume_j, p_sum)
            eta = _mean(f.viscosity_n[i], f.viscosity_n[j], terms.harmonic)
            force = force + joined(push * g_i, _viscous_term(eta, volume_i, volume_j, xg_i, rr) * v)
            drag = -_viscous_term(eta, volume_i, volume_j, xg_j, rr)
            add_to(force_nf, j, joined(push * g_j, drag * v))
        add_to(force_nf, i, force)


@inline
def _second_if_corrected(gi_pc: Any, a: float, b: float) -> float:
    """The same number for both sides without corrections: what follows from it is then evaluated once."""
    return a if gi_pc is None else b


@inline
def _mean(a: float, b: float, harmonic: bool) -> float:
    return _harmonic_mean(a, b) if harmonic else _arithmetic_mean(a, b)  # type: ignore[no-any-return]


@inline
def _artificial(f: Fields, i: int, j: int, v: Any, x: Any, rr: float, sound: float, terms: Terms, like: Any) -> float:
    """Artificial viscous pressure, with the velocities extrapolated to the midpoint."""
    G = 0.5 * (row(f.v_gradient_nf, i, terms.like_f) + row(f.v_gradient_nf, j, terms.like_f))
    u = v - matrix_times(G, x)
    return _artificial_term(terms.zeta, sound, dot(u, x), rr, terms.h, f.rho_n[i] + f.rho_n[j])  # type: ignore[no-any-return]


@inline
def _repulsion(f: Fields, i: int, j: int, rr: float, sound: float, terms: Terms) -> float:
    """Repulsion of fluid and solid over r."""
    r = math.sqrt(rr)
    s = i if f.solid_n[i] else np.int64(j)
    return _repulsion_term(f.chi_n[s], r, f.rho0_n[s], sound, terms.cut) / r  # type: ignore[no-any-return]


@inline
def _density_difference(gi_pc: Any, f: Fields, i: int, j: int, x: Any, like: Any) -> float:
    """Density of j less that of i, beyond equilibrium or beyond what the gradients explain."""
    if gi_pc is None:
        return (f.rho_n[j] - f.rho0_n[j]) - (f.rho_n[i] - f.rho0_n[i])  # type: ignore[no-any-return]
    slope = 0.5 * (row(f.rho_gradient_nc, i, like) + row(f.rho_gradient_nc, j, like))
    return f.rho_n[j] - f.rho_n[i] + dot(slope, x)  # type: ignore[no-any-return]
