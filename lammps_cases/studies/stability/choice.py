r"""Choose the numbers of a flow, each with its reason: speed of sound, time step, kernel, cutoff, zmin, spacing.

A weakly compressible fluid keeps its density to within a fraction :math:`\delta` if
:math:`c^2\ge\max(U^2,\,gH,\,\nu U/L)/\delta` (Morris, Fox & Zhu, J. Comput. Phys. 136, 214 (1997)). The time step is
the smallest of the limits in `limits_of`, and of the measured ones (`lammps_cases.studies.stability.advice.nearest`);
what error and cost to expect follows from the measured flow that is most like the given one.
"""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from eos_ref.kernels import reproducing
from eos_ref.kernels.styles import KERNELS, KernelStyle
from lammps_cases.findings.forces import FORCE_PER_VOLUME
from lammps_cases.findings.kernels import STALE_GRADIENT_BELOW_ZMIN
from lammps_cases.findings.units import UNITS_UNCONVERTED
from lammps_cases.records.files import DATA
from lammps_cases.records.wording import brief, number, times
from lammps_cases.studies.stability.advice import growth_limit, nearest
from lammps_cases.studies.stability.limits import Limits, Numbers

CUTS = (2.4, 4.0)  # spacings, of the maps timestep-kernel and tension-width; gradients are 1.2 % off at 2.4, 5 % at 2.2
USUAL_CUT = 3.0
EVIDENCE = "measured-flows.json"


@dataclass(frozen=True)
class FlowScales:
    """The scales of a flow, in products of its units of length, mass and time (`eos_ref.model.consistent`).

    Attributes
    ----------
    like : the measured flow that is most like it
    spacing, length : of particles; of the gap, the height or the box
    speed, because : the fastest of the flow, and where that number comes from
    head, sudden : g H of the weight on axes along which the fluid ends, and whether it begins without its pressure
    gravity : acceleration by all forces
    sound, stiffest : smallest speed of sound of fix rheo, and the largest of the laws over it; NaN and that of a gas
    nu, heat, smoothing : kinematic viscosity, conductivity/(rho cv), rho/damp
    tension : surface tension over the density
    artificial : whether there is artificial viscosity
    surface : whether fluid lacks neighbours on a side
    fewest, matrices : neighbours of a fluid particle, and what their moment matrices are like
    pressures, viscous : how many times LAMMPS accelerates too much by pressures and by viscosity
    """

    like: str
    dimension: int
    spacing: float
    length: float
    speed: float
    because: str
    head: float
    sudden: bool
    gravity: float
    sound: float
    stiffest: float
    nu: float
    heat: float
    smoothing: float
    tension: float
    artificial: bool
    surface: bool
    fewest: int
    pressures: float
    viscous: float
    kernel: KernelStyle
    cut: float
    zmin: int
    timestep: float
    matrices: str = ""
    options: tuple[str, ...] = ()  # of fix rheo that cost time: shift, rho/sum, thermal

    @property
    def resolution(self) -> float:
        """Return the spacings of the length."""
        return self.length / self.spacing

    @property
    def damps(self) -> float:
        """Return what damps long waves of sound: rho/damp of kernels of order 1 does not."""
        return self.nu + self.smoothing * self.surface

    @property
    def cell(self) -> float:
        """Return the Reynolds number of a spacing."""
        return self.speed * self.spacing / self.nu if self.nu else math.inf


@dataclass(frozen=True)
class Chosen:
    """An advised number: that of the deck (None: none), the new one (None: no change), and the reason."""

    subject: str
    now: float | str | None
    advised: float | str | None
    why: str


@dataclass(frozen=True)
class AdvisedNumbers:
    """All advised numbers of a flow, in the order in which they are chosen.

    Attributes
    ----------
    limits : of the time step, by their formulas
    fails : time step from which on the nearest measured flow fails; None: none was measured
    """

    flow: FlowScales
    chosen: tuple[Chosen, ...]
    limits: dict[str, float]
    fails: float | None

    def line(self, subject: str) -> Chosen:
        """Return what is advised on a subject."""
        return next(chosen for chosen in self.chosen if chosen.subject == subject)

    def of(self, subject: str) -> Any:
        """Return an advised number; that of the deck where it stays."""
        line = self.line(subject)
        return line.now if line.advised is None else line.advised


def strictest(flows: Sequence[FlowScales], compressibility: float, limits: Limits) -> AdvisedNumbers:
    """Choose for the runs of a deck: the largest speed of sound that one needs, with it the smallest time step."""
    sounds = [_sound(of, compressibility) for of in flows]
    sound = max(sounds, key=lambda each: -1.0 if each.advised is None else float(each.advised))
    return min((choose(of, sound, limits) for of in flows), key=lambda each: float(each.of("time step")))


def choose(of: FlowScales, sound: Chosen, limits: Limits) -> AdvisedNumbers:
    """Choose the other numbers of a flow with a speed of sound, given the measured limits."""
    c = of.sound if sound.advised is None else float(sound.advised)
    kernel, cut, zmin = _kernel(of)
    h = float(cut.advised or of.cut) / 3
    damping = _damping(of, c, h)
    of = replace(of, smoothing=of.smoothing if damping.advised is None else float(damping.advised))
    bounds = limits_of(of, c, h)
    step, fails = _step(of, c, h, bounds, limits)
    dt, style = float(step.advised or of.timestep), str(kernel.advised or of.kernel)
    chosen = (sound, damping, step, kernel, cut, zmin, *_spacing(of), *_tension(of, c, limits))
    return AdvisedNumbers(of, (*chosen, *_expected(of, style, dt), *_warned(of, c, h)), bounds, fails)


# --- speed of sound


def _rounded(value: float, digits: int, up: bool) -> float:
    """Return a number with some digits, not below the given one or not above it."""
    unit = 10.0 ** (math.floor(math.log10(value)) - digits + 1)
    steps = value / unit
    return float(f"{(math.ceil(steps - 1e-9) if up else math.floor(steps + 1e-9)) * unit:.{digits}g}")


def _sound(of: FlowScales, compressibility: float) -> Chosen:
    weight = ("2 g H", 2 * of.head) if of.sudden else ("g H", of.head)
    terms = {"U^2": of.speed**2, weight[0]: weight[1], "nu U/L": of.nu * of.speed / of.length}
    terms["sigma/(rho L)"] = of.tension / of.length
    name, largest = max(terms.items(), key=lambda term: term[1])
    if math.isnan(of.sound):
        return Chosen("speed of sound", None, None, "that of a gas follows from its energy")
    if largest == 0:
        return Chosen("speed of sound", of.sound, None, "no speed demands another one")
    c = _rounded(math.sqrt(largest / compressibility), 3, up=True)
    each = ", ".join(f"{term}/c^2 = {number(v / c**2, 2)}" for term, v in terms.items() if v > 0)
    why = f"({name} / {compressibility:g})^(1/2): {each}; {of.because}"
    why += "; the weight sets in suddenly, which doubles it" if of.head and of.sudden else ""
    why += f"; with the c of the deck the density varies by {number(largest / of.sound**2, 2)}"
    return Chosen("speed of sound", of.sound, c, why)


# --- time step


def limits_of(of: FlowScales, c: float, h: float) -> dict[str, float]:
    """Return the limits of the time step by their formulas, the stricter one of the reference and LAMMPS each."""
    felt, nu = max(1.0, of.pressures), of.nu * max(1.0, of.viscous)
    fast = (of.stiffest * c if c == c else of.stiffest) * math.sqrt(felt) + of.speed
    limits = {"h/4(c+U)": 1 / Numbers(fast, 0.0, h, 1.0).acoustic}
    diffusing = {"h^2/8nu": nu, "h^2 rho cv/8kappa": of.heat, "h^2/8 rho/damp": of.smoothing}
    limits |= {name: 1 / Numbers(0.0, d, h, 1.0).viscous for name, d in diffusing.items() if d > 0}
    if of.gravity > 0:
        limits["(h/g)^(1/2)/4"] = math.sqrt(h / of.gravity) / 4
    if of.tension > 0:
        limits["(rho h^3/2 pi sigma)^(1/2)/4"] = math.sqrt(h**3 / (2 * math.pi * of.tension)) / 4
    if of.damps > 0 and not of.artificial:
        limits["2(nu+rho/damp)/c^2"] = growth_limit(nu + of.damps - of.nu, fast - of.speed)
    return limits


def _damping(of: FlowScales, c: float, h: float) -> Chosen:
    """Advise the density diffusion of the measured dam break where a front falls, or where sound would grow."""
    usual = 0.1 * h * c
    grows = not of.artificial and growth_limit(of.damps, c) < 0.5 * h / (4 * c)
    if of.surface and of.smoothing < 0.5 * usual and (of.like == "dam-break" or grows):
        why = "0.1 h c, as measured in flow dam-break: else waves of a sudden start add up, and sound grows"
        return Chosen("rho/damp", of.smoothing, float(f"{usual:.3g}"), why)
    return Chosen("rho/damp", of.smoothing, None, "kept" if of.smoothing else "sound needs no damping")


def _step(of: FlowScales, c: float, h: float, bounds: dict[str, float], limits: Limits) -> tuple[Chosen, float | None]:
    name, least = min(bounds.items(), key=lambda bound: bound[1])
    fast, nu = h / 4 / bounds["h/4(c+U)"], max(of.nu * max(1.0, of.viscous), of.heat)
    measured = nearest(limits, Numbers(fast, nu, h, least, of.heat > of.nu))
    fraction, text = measured or (0.0, "")
    dt = _rounded(least / max(1.0, fraction), 2, up=False)
    why = f"{name} is the smallest of {', '.join(f'{key} = {number(v)}' for key, v in bounds.items())}"
    if measured:
        why += f"; measured to fail above {number(1 / fraction, 2)} times that ({text})"
    if not (of.damps or of.artificial):
        why += "; without viscosity sound grows at any step (rate c^2 k^2 dt/4)"
    return Chosen("time step", of.timestep, dt, why), least / fraction if measured else None


# --- kernel


def lattice_error(dimension: int, cut: float) -> float:
    r"""Return by how much the quintic's sum :math:`-\frac1d\sum_jV_j\mathbf x\cdot\nabla W` over a lattice misses 1.

    Parameters
    ----------
    cut : float
        Cutoff in spacings.
    """
    kernel, reach = KERNELS["quintic"].kernel, math.ceil(cut)
    x_pc = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * dimension), axis=-1).reshape(-1, dimension)
    r_p = np.sqrt((x_pc**2).sum(axis=1))
    q_p = kernel.support * r_p[(r_p > 0) & (r_p < cut)] / cut
    return float(-(kernel.normalisation(dimension, cut) * kernel.slope(q_p) * q_p).sum() / dimension - 1)


def _kernel(of: FlowScales) -> tuple[Chosen, Chosen, Chosen]:
    ratio = of.cut / of.spacing
    keeps = CUTS[0] <= ratio * 1.001 and ratio <= CUTS[1] * 1.001
    cut = of.cut if keeps else float(f"{USUAL_CUT * of.spacing:.2g}")
    miss = brief(abs(lattice_error(of.dimension, cut / of.spacing)))
    why_cut = (
        f"{number(cut / of.spacing)} spacings; maps timestep-kernel and tension-width support {CUTS[0]} to {CUTS[1]:g}"
    )
    if of.surface:
        style: KernelStyle = "quintic"
        why = (
            f"the fluid has a free surface (at least {of.fewest} neighbours): below zmin neighbours LAMMPS takes old "
            f"gradients ({STALE_GRADIENT_BELOW_ZMIN.id}, map matrices-zmin), so no reproducing kernel"
        )
        zmin, why_zmin = 0, "unused by the quintic kernel"
    else:
        style = of.kernel if KERNELS[of.kernel].order >= 1 else "RK1"
        why = f"there are neighbours on all sides: gradients of {style} are exact, the quintic's at least {miss} off"
        least = reproducing.basis_size(KERNELS[style].order, of.dimension)
        zmin = min(max(of.zmin, least), max(of.fewest, least))
        why_zmin = (
            f"{style} needs {least} neighbours (map matrices-zmin), the fluid has at least {of.fewest}{of.matrices}"
        )
    return (
        Chosen("kernel", of.kernel, style, why),
        Chosen("cut", of.cut, cut, f"{why_cut}; on a lattice the quintic's gradients are {miss} off"),
        Chosen("zmin", of.zmin, zmin, why_zmin),
    )


def _tension(of: FlowScales, c: float, limits: Limits) -> Iterator[Chosen]:
    """Compare the pressure that a vortex of the flow lowers with the tension at which particles clump."""
    shift = "shift" in of.options
    clumps = max((t.high for t in limits.tensions if t.shift == shift and t.high < 0), default=None)
    if of.surface or clumps is None or not c > 0 or of.speed == 0:
        return
    lowest = -((of.speed / c) ** 2)
    needed = lowest < clumps
    what = f"rho0 c^2 x {number(clumps - lowest, 2)}" if needed else "none"
    why = (
        f"pressures fall to about -U^2 rho0 = {number(lowest, 2)} rho0 c^2, particles clump from {number(clumps, 2)} on"
    )
    yield Chosen("background pressure", None, what, f"{why} (map tension{', shift' * shift})")


# --- what to expect


@functools.cache
def evidence() -> dict[str, Any]:
    """Return the measured flows and costs (``python -m tests.workshop.measured_flows``)."""
    found: dict[str, Any] = json.loads((DATA / EVIDENCE).read_text(encoding="utf-8"))
    return found


def _spacing(of: FlowScales) -> Iterator[Chosen]:
    name = of.like if "reynolds" in evidence()["flows"][of.like] else "taylor-green-100"
    known = evidence()["flows"][name]
    most = known["reynolds"] / known["coarsest"]
    if of.speed > 0 and of.nu > 0:
        finer = float(f"{most * of.nu / of.speed:.3g}") if of.cell > most else None
        why = f"Reynolds number of a spacing U dx/nu = {number(of.cell)}: flow {name} was measured up to {number(most)}"
        yield Chosen("spacing", of.spacing, finer, why + (", or artificial/visc 0.1 in its place" if finer else ""))


def _expected(of: FlowScales, kernel: str, dt: float) -> Iterator[Chosen]:
    measured = evidence()
    known, n = measured["flows"][of.like], of.resolution
    sides = {"reference": ("reference", "order"), "LAMMPS": ("lammps", "order of lammps")}
    errors = []
    for side, (error, order) in sides.items():
        if known[error] is None:
            errors.append(f"{side} stops")
        else:
            grows = (known["n"] / n) ** max(known[order] or 0.0, 0.0)
            errors.append(f"{brief(known[error] * grows)} {side}")
    how = f"error of the {known['of']} of flow {of.like}, N = {known['n']}, order {number(known['order'])}"
    yield Chosen("error", None, ", ".join(errors), f"{how}, scaled to L/dx = {number(n)} ({known['page']})")
    cost = measured["steps"][str(of.dimension)]
    each = cost.get(kernel, cost["quintic"]) + sum(cost[option] - cost["quintic"] for option in of.options)
    unit = 0.1 * each / dt
    why = f"{number(each)} µs per particle and step of LAMMPS on a core, {kernel} ({measured['costs']})"
    passing = f"; {times(unit * of.length / of.speed)} s for the time L/U" if of.speed > 0 else ""
    yield Chosen("cost", None, f"{times(unit)} s per 1e5 particles and unit of time", why + passing)


def _warned(of: FlowScales, c: float, h: float) -> Iterator[Chosen]:
    """Warn of what no number mends: summed densities at a surface, and forces that LAMMPS gets wrong."""
    if of.surface and "rho/sum" in of.options:
        why = "summed densities are too low at a free surface: particles clump there (map summed-surface); leave it out"
        yield Chosen("rho/sum", "on", "off", why)
    if max(abs(math.log(of.pressures)), abs(math.log(of.viscous))) > 0.05:
        right = min(limits_of(replace(of, pressures=1.0, viscous=1.0), c, h).values())
        why = (
            f"LAMMPS accelerates by pressures {times(of.pressures)} and by viscosity {times(of.viscous)} times as much "
            f"as it should ({FORCE_PER_VOLUME.id}; in units real and metal {UNITS_UNCONVERTED.id}, too). The time step "
            "allows for that, but the flow is another one: first eos-ref audit DECK --rescale, then "
            f"{number(right, 2)} will do"
        )
        yield Chosen("volume of particles", None, "1", why)
