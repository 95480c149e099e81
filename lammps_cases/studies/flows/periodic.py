r"""Flows in a periodic box: waves of shear, heat and sound, Taylor-Green vortices.

Waves run along strips that are `STRIP` particles wide. The reproducing kernel RK1 is the default. At a cutoff of 3
spacings the plain quintic's sums over a lattice miss their integrals by a constant, 8e-4 for the viscosity, at which
the convergence ends; RK1's first moments are exact, and on a lattice the second with them.

Sound also depends on the time step. A force is evaluated with densities that have taken half of a step's change, so
that the pressure lags behind by half a step, :math:`\ddot f=-c^2k^2f(t-\Delta t/2)`. To first order that is
:math:`-c^2k^2(f-\tfrac12\Delta t\dot f)`: without viscosity the amplitude grows at the rate :math:`c^2k^2\Delta t/4`,
and waves of any length grow unless :math:`\Delta t<2\nu/c^2`. Where viscosity limits the step, this error falls with
the square of the spacing as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from eos_ref import InputError
from eos_ref.analytic import waves
from eos_ref.eos.table import EOS, FloatArray, examples
from lammps_cases.findings.thermal import HEAT_IS_TEMPERATURE_RATE
from lammps_cases.scene.atoms import seed
from lammps_cases.scene.particles import entries
from lammps_cases.studies.flows.flow import Options, Snapshot, Start, fluid, relative, rows, start, time_step
from lammps_cases.studies.flows.known import Flow

STRIP = 8  # particles across, a direction on which nothing depends
RK1 = Options(kernel="RK1")
QUICK = (16, 24, 32)
DIFFUSION = 0.05  # viscosity or diffusivity over sound speed times wavelength: it limits the time step, not sound
SECOND = "2: kernel smoothing, (k h)^2; the time step falls with the square of the spacing, and so does its error"


def wave_number(n: int) -> float:
    """Return the wave number of a wavelength of n spacings."""
    return 2 * np.pi / n


def strip(n: int, width: int = STRIP) -> FloatArray:
    """Return the square lattice, n spacings along x."""
    return rows(0, width, n)


def amplitude(x_n: FloatArray, f_n: FloatArray, k: float, phase: float = 0.0) -> float:
    """Return the amplitude of sin(k x + phase) in values at evenly spread positions, (n,) each."""
    return 2 * float(np.mean(f_n * np.sin(k * x_n + phase)))


def _box(n: int, options: Options, x_nc: FloatArray, speed: float, diffusivity: float) -> dict[str, Any]:
    """Return the particles, box, options and time step of a flow at a resolution, as arguments of `start`."""
    size = n, len(x_nc) // n
    return {"x_nc": x_nc, "high_c": size, "options": options, "timestep": time_step(options, speed, diffusivity)}


def _diffusion_times(k: float, diffusivity: float) -> list[float]:
    """Return the times at which a wave has decayed by exp(-1/2) and by exp(-1)."""
    return [0.5 / (diffusivity * k**2), 1 / (diffusivity * k**2)]


def _diffusion_errors(
    snapshots: Sequence[Snapshot], f_tn: Sequence[FloatArray], exact_n: FloatArray, k: float, diffusivity: float
) -> dict[str, float]:
    """Return the errors of the rate at which a wave decays between snapshots, and of its values in the last one."""
    first, last = (amplitude(snapshots[t].x_nc[:, 0], f_tn[t], k) for t in (0, -1))
    rate = float(np.log(first / last)) / (snapshots[-1].time - snapshots[0].time)
    return {"rate": abs(rate / (diffusivity * k**2) - 1), "profile": relative(f_tn[-1] - exact_n, exact_n)}


# --- shear wave

MOVED = 1e-4  # spacings that a particle moves while the wave decays: the lattice persists


def _shear(n: int) -> tuple[float, float, float]:
    """Return the wave number, viscosity, amplitude."""
    k, nu = wave_number(n), DIFFUSION * n
    return k, nu, MOVED * nu * k**2


def _shear_start(n: int, options: Options) -> Start:
    (k, nu, a), x_nc = _shear(n), strip(n)
    return start(
        "shear-wave",
        {"types": [fluid(viscosity=nu)]},
        **_box(n, options, x_nc, 1.0 + a, nu),
        times=_diffusion_times(k, nu),
        v_nc=np.stack([0 * x_nc[:, 0], waves.shear_wave(x_nc[:, 0], 0.0, k, nu, a)], axis=1),
    )


def _shear_measures(n: int, options: Options, snapshots: Sequence[Snapshot]) -> dict[str, float]:
    (k, nu, a), shot = _shear(n), snapshots[-1]
    exact_n = waves.shear_wave(shot.x_nc[:, 0], shot.time, k, nu, a)
    return _diffusion_errors(snapshots, [s.v_nc[:, 1] for s in snapshots], exact_n, k, nu)


SHEAR = Flow(
    "shear-wave",
    f"Velocity across a wave vector decays by viscosity alone. Particles move by {MOVED:g} spacings.",
    (16, 24, 32, 48, 64),
    SECOND,
    _shear_start,
    _shear_measures,
    RK1,
    QUICK,
    validates="viscosity",
)


# --- heat wave

HOT = 0.1  # amplitude over mean of the temperature; the equation is linear


def _heat(n: int, options: Options) -> tuple[float, float, float, float]:
    """Return the wave number, diffusivity, density (and mass), specific heat."""
    return wave_number(n), DIFFUSION * n, options.number("rho0", 1.0), options.number("cv", 1.0)


def _heat_start(n: int, options: Options) -> Start:
    (k, alpha, rho0, cv), x_nc = _heat(n, options), strip(n)
    return start(
        "heat-wave",
        {"types": [fluid(mass=rho0, rho0=rho0, conductivity=alpha * rho0 * cv, specific_heat=cv)]},
        **_box(n, options, x_nc, 1.0, alpha),
        times=_diffusion_times(k, alpha),
        e_n=cv * waves.heat_wave(x_nc[:, 0], 0.0, k, alpha, HOT, 1.0),
    )


def _heat_measures(n: int, options: Options, snapshots: Sequence[Snapshot]) -> dict[str, float]:
    (k, alpha, _, _), shot = _heat(n, options), snapshots[-1]
    temperatures = [s.temperature_n - 1 for s in snapshots if s.temperature_n is not None]
    exact_n = waves.heat_wave(shot.x_nc[:, 0], shot.time, k, alpha, HOT)
    return _diffusion_errors(snapshots, temperatures, exact_n, k, alpha)


HEAT = Flow(
    "heat-wave",
    "Temperature evens out in a fluid at rest. Options rho0 (the mass too) and cv; LAMMPS adds a rate of temperature "
    "to the energy, so that heat flows more slowly by rho0 cv.",
    (16, 24, 32, 48, 64),
    SECOND,
    _heat_start,
    _heat_measures,
    RK1,
    QUICK,
    findings=(HEAT_IS_TEMPERATURE_RATE,),
    validates="conduction of heat",
)


# --- sound

COMPRESSED = 1e-4  # amplitude: nonlinear terms are negligible, and volumes stay 1
STATE = 1.05  # mean density over rho0, so that the laws differ in their speeds of sound
ATTENUATION = 0.05  # as `DIFFUSION`; the wave falls by exp(-1) in a period
READINGS = 8  # in one period
_LAWS = {law.style: law for law in examples()} | {"background": EOS("tait/water", background=0.3)}
LAWS = tuple(_LAWS)
GAS_ENERGY = 2.5  # per mass, so that (gamma - 1) e = 1


def _sound(n: int, options: Options) -> tuple[float, float, float, EOS]:
    """Return the wave number, speed of sound by the law itself, viscosity, the law."""
    name = options.word("law", "linear")
    if name not in _LAWS:
        raise InputError("option law", f"must be one of {', '.join(LAWS)}", name)
    law = _LAWS[name]
    c = float(law.sound_speed(STATE, GAS_ENERGY))
    return wave_number(n), c, options.number("attenuation", ATTENUATION) * c * n, law


def _sound_start(n: int, options: Options) -> Start:
    (k, c, nu, law), x_nc = _sound(n, options), strip(n)
    slope_n = -COMPRESSED * np.cos(k * x_nc[:, 0])  # of the displacement; its inverse is the density: mass is conserved
    rho_n = STATE / (1 + slope_n)
    x_nc[:, 0] += -COMPRESSED / k * np.sin(k * x_nc[:, 0])
    period = 2 * np.pi / waves.damped(k, c, nu)[1]
    return start(
        "sound-wave",
        {"types": [fluid(mass=STATE, viscosity=nu * STATE)], "pressure": entries(law)},
        **_box(n, options, x_nc, c, nu),
        times=[period / READINGS * reading for reading in range(1, READINGS + 1)],
        rho_n=rho_n,
        e_n=np.full(len(x_nc), GAS_ENERGY) if law.needs_energy else None,
    )


def _sound_measures(n: int, options: Options, snapshots: Sequence[Snapshot]) -> dict[str, float]:
    k, c, nu, _ = _sound(n, options)
    f_t = [amplitude(s.x_nc[:, 0], s.rho_n - STATE, k, np.pi / 2) for s in snapshots]
    rate, omega = waves.damped_oscillation(f_t, snapshots[0].time)
    last = snapshots[-1]
    rho_n, _ = waves.sound_wave(last.x_nc[:, 0], last.time, k, c, nu, STATE, COMPRESSED)
    error_n = last.rho_n - rho_n
    errors = {
        "speed": abs(float(np.hypot(rate, omega)) / (c * k) - 1),
        "damping": abs(float(rate) / (nu * k**2 / 2) - 1),
        "profile": relative(error_n - error_n.mean(), rho_n - STATE),
    }
    return errors | ({"mean": abs(float(last.rho_n.mean()) / STATE - 1)} if options.rho_sum else {})


SOUND = Flow(
    "sound-wave",
    f"A standing wave of sound, {COMPRESSED:g} high, in a fluid at {STATE:g} rho0; the speed is that of its law there. "
    f"Options law ({', '.join(LAWS)}), attenuation (viscosity over speed times wavelength, {ATTENUATION:g}).",
    (16, 24, 32, 48),
    SECOND
    + ". Where sound limits the step (attenuation below 1/2N), 1 for the damping: the pressure lags by half a step",
    _sound_start,
    _sound_measures,
    RK1,
    QUICK,
    validates="equation of state, continuity",
)
SOUNDS = tuple(
    replace(SOUND, name=f"sound-wave-{law.replace('/', '-')}", options=replace(RK1, extra={"law": law})) for law in LAWS
)


# --- Taylor-Green vortices

REYNOLDS = 1.0  # of the wavelength: particles move by a hundredth of it, and shear by 8 %
MACH = 0.1


def _vortex(n: int, options: Options) -> tuple[float, float, float, float]:
    """Return the wave number, viscosity, highest speed, speed of sound.

    Sound takes a spacing at twice the speed of diffusion, so that both limit the time step equally. The Mach number is
    then Re/2N: the fluid becomes incompressible as the resolution grows. It is at most `MACH`.
    """
    nu = 1.0
    speed = options.number("Re", REYNOLDS) * nu / n
    return wave_number(n), nu, speed, max(2 * nu, speed / MACH)


def _vortex_start(n: int, options: Options) -> Start:
    (k, nu, a, c), x_nc = _vortex(n, options), strip(n, n)
    disorder = options.number("disorder", 0.0)
    x_nc = np.mod(x_nc + np.random.default_rng(seed(f"vortices-{n}")).uniform(-disorder, disorder, x_nc.shape), n)
    u_n, v_n, p_n = waves.taylor_green(x_nc[:, 0], x_nc[:, 1], 0.0, k, nu, a)
    pair = {
        "artificial_visc": options.number("artificial-visc", 0.0),
        "rho_damp": options.number("rho-damp", 0.0) * options.cut / 3 * c,
    }
    return start(
        "taylor-green",
        {"types": [fluid(cs=c, viscosity=nu)], "rheo": {"shift": options.word("shift", "no") == "yes"}, "pair": pair},
        **_box(n, options, x_nc, c + a, nu),
        times=[1 / (2 * nu * k**2)],
        v_nc=np.stack([u_n, v_n], axis=1),
        rho_n=1 + p_n / c**2,
    )


def _vortex_measures(n: int, options: Options, snapshots: Sequence[Snapshot]) -> dict[str, float]:
    (k, nu, a, _), shot = _vortex(n, options), snapshots[-1]
    u_n, v_n, _ = waves.taylor_green(shot.x_nc[:, 0], shot.x_nc[:, 1], shot.time, k, nu, a)
    exact_nc = np.stack([u_n, v_n], axis=1)
    # Energy of the particles against that of the solution at their positions: independent of their distribution.
    decay = np.log(np.sum(exact_nc**2) / np.sum(shot.v_nc**2)) / (2 * shot.time)
    return {"rate": abs(float(decay) / (2 * nu * k**2)), "profile": relative(shot.v_nc - exact_nc, exact_nc)}


VORTICES = Flow(
    "taylor-green",
    f"Vortices in a square decay by viscosity and carry the particles. Option Re ({REYNOLDS:g}); the Mach number is "
    f"Re/2N, at most {MACH:g}. Options disorder (spacings), shift (yes), artificial-visc, rho-damp (over h c): none.",
    (16, 24, 32, 48),
    SECOND + "; the square of the Mach number falls at the same order",
    _vortex_start,
    _vortex_measures,
    RK1,
    QUICK,
    validates="viscosity, motion of particles",
)

FLOWS = (SHEAR, VORTICES, HEAT, *SOUNDS)
