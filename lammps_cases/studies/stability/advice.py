"""The margin of a scene or a deck to instability, by the measured atlas and by theory."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from eos_ref import InputError
from eos_ref.eos.table import FloatArray
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.model.box import Box
from eos_ref.model.parameters import Model
from eos_ref.model.state import State
from eos_ref.syntax.fixes import SurfaceDetection
from lammps_cases.studies.stability.kinds import moment_matrices
from lammps_cases.studies.stability.limits import LimitCurve, Limits, Numbers, Tension, numbers, pressures, read

NEAR = 0.8  # of a limit, from which on it is a warning
MARGIN = 0.05  # of a threshold of surface/detection within which a class is uncertain
DIGITS = 1e12  # condition number that leaves fewer than four digits of a double
MOST = 20_000  # particles up to which matrices and surfaces are examined
L = TypeVar("L", LimitCurve, Tension)


@dataclass(frozen=True)
class Advice:
    """One line, and whether it is a warning; of lines on one subject the one with the largest measure is the worst."""

    text: str
    warns: bool = False
    subject: str = ""
    measure: float = 0.0


def advice(model: Model, box: Box, state: State, timestep: float | None, limits: Limits | None = None) -> list[str]:
    """Describe the margins of a state to the nearest limits: warnings first, and marked.

    Parameters
    ----------
    timestep : float or None
        None: no steps are taken, and limits of the time step do not count.
    limits : Limits, optional
        Those shipped by default.
    """
    lines = judge(model, box, state, timestep, limits)
    return [f"warning: {a.text}" for a in lines if a.warns] + [a.text for a in lines if not a.warns]


def judge(model: Model, box: Box, state: State, timestep: float | None, limits: Limits | None = None) -> list[Advice]:
    """Return the lines of `advice`."""
    measured = read() if limits is None else limits
    lines: list[Advice] = []
    if timestep is not None:
        lines += time_step(model, numbers(model, state, timestep), measured)
        lines += tension(model, state, measured)
    lines += hyperbolicity(model, state)
    lines += _neighbourhoods(model, box, state)
    return lines


def _share_of(fraction: float) -> str:
    """Return a fraction in words: 40 % of, or 2.5 times."""
    if fraction >= 2:
        return f"{fraction:.3g} times"
    return f"{100 * fraction:.2g} % of" if fraction < 0.99 else f"{100 * fraction:.0f} % of"


# --- time step


def time_step(model: Model, step: Numbers, limits: Limits) -> Iterable[Advice]:
    """Compare the time step with measured limits, those of theory, and the growth of sound."""
    theory = f"{_share_of(step.acoustic)} CFL h/4(c+U)"
    if step.nu > 0:
        limit = "limit of conduction h^2 rho cv/8kappa" if step.conducts else "viscous limit h^2/8nu"
        theory += f", {_share_of(step.viscous)} the {limit}"
    measured = nearest(limits, step)
    if measured is not None:
        fraction, text = measured
        yield Advice(
            f"time step {step.dt:.3g} is {_share_of(fraction)} the measured limit ({text}), {theory}",
            fraction >= NEAR,
            "time step",
            fraction,
        )
    else:
        text = f"time step {step.dt:.3g} is {theory} (no measured limit)"
        yield Advice(text, step.fraction >= 1, "time step", step.fraction)
    yield from _sound(model, step)


def nearest(limits: Limits, step: Numbers) -> tuple[float, str] | None:
    """Return the fraction of the stable end of the nearest curve, and which curve it is."""
    curves = list(_of_lammps(limits.curves).values())
    if not curves or not step.fraction > 0:
        return None
    ratio = max(step.ratio, 1e-300)
    near = [curve for curve in curves if curve.covers(ratio)] or curves
    fraction, curve = max(((step.fraction / curve.at(ratio).low, curve) for curve in near), key=lambda pair: pair[0])
    at, scale = curve.at(ratio), step.dt / step.fraction
    side = "sound" if step.viscous <= step.acoustic else "conduction" if step.conducts else "viscous"
    where = f"{curve.map}, {curve.layer}" if curve.layer else curve.map
    outside = "" if curve.covers(ratio) else ", outside the measured viscosities"
    low, high = sorted((at.low * scale, at.high * scale))
    return fraction, f"{low:.3g} to {high:.3g}, {side}; map {where}: {curve.above}{outside}"


def _of_lammps(measured: Iterable[L]) -> dict[tuple[str, str], L]:
    """Return the limits by map and layer: those of LAMMPS, which runs a deck, before those of the reference."""
    return {(one.map, one.layer): one for one in sorted(measured, key=lambda one: one.engine == "lammps")}


def growth_limit(nu: float, c: float) -> float:
    """Return the time step beyond which long waves of sound grow: c^2 dt/2 k^2, as pressure lags, against nu k^2."""
    return 2 * nu / c**2 if c > 0 else math.inf


def _sound(model: Model, step: Numbers) -> Iterable[Advice]:
    """Compare the time step with that from which on sound grows."""
    limit = growth_limit(step.nu, step.c)
    if step.dt <= limit:
        return
    damped = model.pair.artificial_viscosity > 0 or model.pair.rho_damp > 0
    rest = "; artificial viscosity and damping, which slow this growth, are not included" if damped else ""
    text = f"sound waves grow: time step {step.dt:.3g} > 2 nu/c^2 = {limit:.3g}{rest}"
    yield Advice(text, not damped, "sound", step.dt)


# --- equations of state


def tension(model: Model, state: State, limits: Limits) -> Iterable[Advice]:
    """Compare the strongest tension with that at which particles clump."""
    pressure_n = pressures(model, state)
    shift = model.fix.shift is not None
    measured = _of_lammps(t for t in limits.tensions if t.shift == shift and t.high < 0)
    if not pressure_n.size or not measured:
        return
    nearest = max(measured.values(), key=lambda t: t.high)
    lowest = float(np.nanmin(pressure_n))
    fraction = lowest / nearest.high
    if fraction >= 0.01:
        where = f"{nearest.map}, {nearest.layer}" if nearest.layer else nearest.map
        yield Advice(
            f"lowest pressure {lowest:.3g} rho0 c^2 is {_share_of(fraction)} the tension at which particles clump "
            f"({where}: {nearest.low:.3g} to {nearest.high:.3g})",
            fraction >= NEAR,
            "tension",
            fraction,
        )


def hyperbolicity(model: Model, state: State) -> Iterable[Advice]:
    """Compare the densities of the fluid with those at which a law stops growing."""
    rho_n = np.asarray(state.rho_n, float)
    for t, law in enumerate(model.eos, 1):
        own_n = rho_n[(state.type_n == t) & ~state.solid_n]
        if not own_n.size or law.needs_energy:
            continue
        low, high = law.monotone
        for word, rho, end in (("lowest", float(own_n.min()), low), ("highest", float(own_n.max()), high)):
            if not math.isfinite(end) or end == law.rho0:
                continue
            left = (rho - end) / (law.rho0 - end)
            if left < 1 - NEAR:
                yield Advice(
                    f"type {t}: {word} density {rho:.6g} is near {end:.6g}, where the pressure of {law.style} stops "
                    f"growing ({100 * left:.0f} % of the way from there to rho0)",
                    True,
                    f"{word} density of type {t}",
                    1 - left,
                )


# --- neighbourhoods


def _neighbourhoods(model: Model, box: Box, state: State) -> Iterable[Advice]:
    surface = model.fix.surface_detection
    if not model.corrects_gradients and surface is None:
        return
    if len(state.x_nc) > MOST:
        text = f"moment matrices and surface limits were not examined: {len(state.x_nc)} particles, more than {MOST}"
        yield Advice(text, True, "examined")
        return
    evaluator = ArrayEvaluator(model, box, state.type_n, state.solid_n)
    try:
        evaluator.move(state.x_nc)
    except InputError:  # particles far from the box, lost in the next step
        return
    rho_n = np.asarray(state.rho_n, float)
    if model.corrects_gradients:
        yield from matrices(evaluator, rho_n)
    if surface is not None:
        divr = surface.style == "divergence"
        measure_n = evaluator.surface(state.rho_n)[0].divr_n if divr else evaluator.coordination_n
        yield from _surfaces(np.asarray(measure_n, float)[~state.solid_n], surface)


def matrices(evaluator: ArrayEvaluator, rho_n: FloatArray) -> Iterable[Advice]:
    """Examine the moment matrices at the positions of an evaluator: those without a factor, the worst condition."""
    m_nbb, definite_n, used_n = moment_matrices(evaluator, rho_n)
    if not used_n.any():
        zmin = evaluator.model.fix.zmin
        text = f"all particles have fewer than zmin = {zmin} neighbours: no moment matrix is used"
        yield Advice(text, subject="zmin")
        return
    failed = int((used_n & ~definite_n).sum())
    if failed:
        text = f"{failed} of {len(rho_n)} moment matrices have no Cholesky factor"
        yield Advice(text, True, "matrices", failed / len(rho_n))
    if (used_n & definite_n).any():
        eigenvalue_nb = np.linalg.eigvalsh(m_nbb[used_n & definite_n])
        with np.errstate(all="ignore"):
            condition = float(np.max(eigenvalue_nb[:, -1] / np.maximum(eigenvalue_nb[:, 0], 0.0)))
        text = f"condition number of moment matrices up to {condition:.2g}"
        yield Advice(text, condition > DIGITS, "condition", condition)


def _surfaces(measure_n: FloatArray, surface: SurfaceDetection) -> Iterable[Advice]:
    if not measure_n.size or surface.limit == 0:
        return
    distance_n = np.abs(measure_n / surface.limit - 1)
    near = int((distance_n <= MARGIN).sum())
    nearest = f"{100 * distance_n.min():.1f} % from the nearest value of a fluid particle"
    text = f"surface limit {surface.limit:g} ({surface.style}): {nearest}"
    text += f"; {near} of {measure_n.size} fluid particles lie within {100 * MARGIN:g} %" if near else ""
    yield Advice(text, subject="surface", measure=near / measure_n.size - float(distance_n.min()))
