"""Sum the terms of pair_style rheo (`eos_ref.model.interactions`) over all pairs, compiled."""

# mypy: disable-error-code="untyped-decorator"

from __future__ import annotations

import math
from typing import Any, NamedTuple

from eos_ref.compiled import loops
from eos_ref.compiled.loops import Pairs, both_gradients, slip
from eos_ref.compiled.vectors import add_to, dot, joined, matrix_times, outer, row, zero
from eos_ref.jit import cached, inline
from eos_ref.model import interactions

_jit = cached(*loops.SOURCES, "compiled/forces.py")

_arithmetic_mean, _harmonic_mean = inline(interactions.arithmetic_mean), inline(interactions.harmonic_mean)
_pressure_term, _artificial_term = inline(interactions.pressure_term), inline(interactions.artificial_term)
_viscous_term, _heat_term = inline(interactions.viscous_term), inline(interactions.heat_term)
_diffusion_term, _repulsion_term = inline(interactions.diffusion_term), inline(interactions.repulsion_term)


class Terms(NamedTuple):
    """Settings of the pair terms; a factor of 0 turns a term off."""

    zeta: float
    xi: float
    harmonic: bool
    h: float
    cut: float


class Fields(NamedTuple):
    """Properties of all particles; None: what no term that is on uses, so that it is compiled without that term.

    ``solid_n`` is None without solids, ``rest_volume_n`` and ``chi_n`` without reconstructed ones: the volume of a
    solid seen by a solid, and the same-phase fraction. ``volume_n`` is the apparent one.
    """

    volume_n: Any
    v_nc: Any
    rho_n: Any
    rho0_n: Any
    pressure_n: Any
    viscosity_n: Any
    sound_n: Any
    solid_n: Any
    rest_volume_n: Any
    chi_n: Any
    v_gradient_nf: Any
    rho_gradient_nc: Any
    conductivity_n: Any
    temperature_n: Any


class Particle(NamedTuple):
    """One particle's entries of `Fields`; zeros for None."""

    volume: float
    v: Any
    rho: float
    rho0: float
    pressure: float
    viscosity: float
    sound: float
    solid: bool
    rest_volume: float
    chi: float
    v_gradient: Any
    rho_gradient: Any
    conductivity: float
    temperature: float


@inline
def _particle(f: Fields, k: int, like: Any, like_f: Any) -> Particle:
    return Particle(
        f.volume_n[k],
        row(f.v_nc, k, like),
        f.rho_n[k],
        f.rho0_n[k],
        f.pressure_n[k],
        f.viscosity_n[k],
        f.sound_n[k],
        _truth(f.solid_n, k),
        _entry(f.rest_volume_n, k),
        _entry(f.chi_n, k),
        _row(f.v_gradient_nf, k, like_f),
        _row(f.rho_gradient_nc, k, like),
        _entry(f.conductivity_n, k),
        _entry(f.temperature_n, k),
    )


@inline
def _entry(array_n: Any, k: int) -> float:
    return 0.0 if array_n is None else array_n[k]


@inline
def _truth(array_n: Any, k: int) -> bool:
    return False if array_n is None else array_n[k]


@inline
def _row(array_nc: Any, k: int, like: Any) -> Any:
    return zero(like) if array_nc is None else row(array_nc, k, like)


@inline
def _given(array_n: Any) -> bool:
    return array_n is not None


@_jit
def pair_terms(
    pairs: Pairs,
    f: Fields,
    terms: Terms,
    like: Any,
    like_f: Any,
    force_nf: Any,
    drho_n: Any,
    heat_n: Any,
    virial_nf: Any = None,
) -> None:
    """Add the force of pressure and artificial viscosity, followed by all other force; density diffusion; heat flow.

    And the virials of these forces, unless they are None.
    """
    walls, thermal, artificial = _given(f.chi_n), _given(f.temperature_n), _given(f.v_gradient_nf)
    for i in range(f.volume_n.size):
        a = _particle(f, i, like, like_f)
        force, drho, heat = joined(zero(like), zero(like)), 0.0, 0.0
        for p in range(pairs.start_n[i], pairs.start_n[i + 1]):
            j = pairs.j_p[p]
            b = _particle(f, j, like, like_f)
            if a.solid & b.solid and not thermal:
                continue
            x = row(pairs.x_pc, p, like)
            rr = dot(x, x)
            g_a, g_b = both_gradients(pairs, p, like)
            F_a, F_b = _ratios(pairs.slope_p, pairs.gi_pc, p, x, g_a, g_b, rr)
            volume_a, volume_b = a.volume, b.volume
            if walls and a.solid & b.solid:
                volume_a, volume_b = a.rest_volume, b.rest_volume
            if thermal:
                kappa = _mean(a.conductivity, b.conductivity, terms.harmonic)
                difference = a.temperature - b.temperature
                heat += _heat_term(kappa, volume_a, volume_b, F_a) * difference
                heat_n[j] -= _heat_term(kappa, volume_a, volume_b, F_b) * difference
            if a.solid & b.solid:
                continue
            meet = a.solid | b.solid  # fluid and solid
            sound = _arithmetic_mean(a.sound, b.sound)
            v = a.v - b.v
            p_sum = a.pressure + b.pressure
            if artificial and not (walls and meet):
                p_sum += _artificial(a, b, v, x, rr, sound, terms)
            if walls and meet:
                v = (1 + slip(a.chi, b.chi, a.solid, terms.cut)) * v
                repulsion = _repulsion(a, b, rr, sound, terms) * x
                force = force + joined(zero(like), repulsion)
                add_to(force_nf, j, -1.0 * joined(zero(like), repulsion))
                if virial_nf is not None:
                    add_to(virial_nf, i, 0.5 * outer(x, repulsion))
                    add_to(virial_nf, j, 0.5 * outer(x, repulsion))
            if terms.xi != 0 and not meet:
                psi = _density_difference(pairs.gi_pc, a, b, x)
                drho += _diffusion_term(terms.xi, volume_b, psi, F_a)
                drho_n[j] += _diffusion_term(terms.xi, volume_a, -psi, F_b)
            push = _pressure_term(volume_a, volume_b, p_sum)
            eta = _mean(a.viscosity, b.viscosity, terms.harmonic)
            drag_a = _viscous_term(eta, volume_a, volume_b, F_a) * v
            drag_b = _viscous_term(eta, volume_a, volume_b, F_b) * v
            force = force + joined(push * g_a, drag_a)
            add_to(force_nf, j, -1.0 * joined(push * g_b, drag_b))
            if virial_nf is not None:
                add_to(virial_nf, i, 0.5 * outer(x, push * g_a + drag_a))
                add_to(virial_nf, j, 0.5 * outer(x, push * g_b + drag_b))
        add_to(force_nf, i, force)
        drho_n[i] += drho
        heat_n[i] += heat


@inline
def _ratios(slope_p: Any, gi_pc: Any, p: int, x: Any, g_a: Any, g_b: Any, rr: float) -> tuple[float, float]:
    """Return x.gradient over r squared of both sides; both factors have their sign turned for b."""
    if gi_pc is None:
        return slope_p[p], slope_p[p]
    return dot(x, g_a) / rr, dot(x, g_b) / rr


@inline
def _mean(a: float, b: float, harmonic: bool) -> float:
    return _harmonic_mean(a, b) if harmonic else _arithmetic_mean(a, b)  # type: ignore[no-any-return]


@inline
def _artificial(a: Particle, b: Particle, v: Any, x: Any, rr: float, sound: float, terms: Terms) -> float:
    """Return the artificial viscous pressure, with the velocities extrapolated to the midpoint."""
    u = v - matrix_times(0.5 * (a.v_gradient + b.v_gradient), x)
    return _artificial_term(terms.zeta, sound, dot(u, x), rr, terms.h, a.rho + b.rho)  # type: ignore[no-any-return]


@inline
def _repulsion(a: Particle, b: Particle, rr: float, sound: float, terms: Terms) -> float:
    """Return the repulsion of fluid and solid over r."""
    r = math.sqrt(rr)
    chi, rho0 = (a.chi, a.rho0) if a.solid else (b.chi, b.rho0)
    return _repulsion_term(chi, r, rho0, sound, terms.cut) / r  # type: ignore[no-any-return]


@inline
def _density_difference(gi_pc: Any, a: Particle, b: Particle, x: Any) -> float:
    """Return the density of b less that of a, beyond equilibrium or beyond what the gradients explain."""
    if gi_pc is None:
        return (b.rho - b.rho0) - (a.rho - a.rho0)
    return b.rho - a.rho + dot(0.5 * (a.rho_gradient + b.rho_gradient), x)  # type: ignore[no-any-return]
