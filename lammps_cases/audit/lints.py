"""Unphysical set-ups that LAMMPS accepts silently, judged by single samples of a run.

Every line holds the numbers on which it is based. Gases are left out: they have neither an equilibrium density nor a
speed of sound of their own.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from eos_ref import EOS
from eos_ref.errors import InputError
from eos_ref.evaluation.pairs import ROWS, Search, directed_pairs, separations
from eos_ref.model.box import BoolArray
from lammps_cases.audit.evaluation import ParticleSample
from lammps_cases.records.wording import counted, number, times

Array = npt.NDArray[Any]
FAR = 0.1  # of rho0: ten times the variation that a weakly compressible fluid is set up for
SLOW = 10.0  # speed of sound over the largest speed at which densities vary by 1 %, Monaghan, JCP 110, 399 (1994)
OUTER = 2 / 3  # of the cutoff, beyond which a full support has neighbours in every direction
MOST = 100_000  # particles whose neighbours are evaluated; of more particles, blocks
FEW = 2_000  # particles in which known bugs are then evaluated: no blocks, which would push out those of all
CLOSE = 0.5  # of the spacing: no lattice and no well resolved fluid has closer pairs


@dataclass(frozen=True)
class Lint:
    """A questionable set-up: of lines on one subject the one with the largest measure is the worst.

    ``brief`` says it in a few words where it can make a run diverge.
    """

    subject: str
    line: str
    measure: float = 1.0
    brief: str = ""


def number_density(sample: ParticleSample) -> tuple[Array, BoolArray]:
    r"""Return the number densities :math:`n_i=\sum_jW_{ij}`, i included, and which particles have full support.

    1/n is the volume of a particle, whatever its mass. The support is full if the outer third of the cutoff holds
    neighbours within 45 degrees of every axis and every diagonal. Of many particles only some blocks are evaluated,
    evenly spaced; the others have no number and no support.

    Raises
    ------
    InputError
        Particles far from the box.
    """
    model, x_nc, n = sample.model, sample.state.x_nc, len(sample.state.x_nc)
    n_n, full_n = np.full(n, np.nan), np.zeros(n, bool)
    search = Search(x_nc, sample.box, model.cut)
    sigma, kernel = model.kernel.normalisation(model.dimension, model.cut), model.kernel
    for first in blocks(n):
        own = slice(first, min(first + ROWS, n))
        i, j, shift_pc = search.rows(first, own.stop, model.cut)
        apart_pc = x_nc[i] - (x_nc[j] + shift_pc)
        r_p, of_p, count = np.linalg.norm(apart_pc, axis=1), i - first, own.stop - first
        n_n[own] = sigma * (float(kernel.shape(0.0)) + np.bincount(of_p, kernel.shape(r_p / model.h), count))
        outer = r_p > OUTER * model.cut
        of_p, apart_pc, least_p = of_p[outer], apart_pc[outer], math.sqrt(0.5) * r_p[outer]
        full_n[own] = True
        for direction in np.ndindex(*(3,) * model.dimension):
            d_c = np.array(direction) - 1.0
            if d_c.any():
                along_p = apart_pc @ d_c / np.linalg.norm(d_c)
                full_n[own] &= np.bincount(of_p, along_p >= least_p, count) > 0
    return n_n, full_n


def blocks(n: int) -> list[int]:
    """Return the first particles of the blocks that are evaluated."""
    first = np.arange(0, n, ROWS)
    some = np.linspace(0, len(first) - 1, MOST // ROWS).round().astype(int) if n > MOST else slice(None)
    return first[some].tolist()  # type: ignore[no-any-return]


def lints(sample: ParticleSample, id_n: Array) -> Iterator[Lint]:
    """Yield what is questionable in a sample, given the ids of its particles."""
    yield from _walls(sample)
    yield from _weight(sample)
    state = sample.state
    if len(state.x_nc) > MOST:
        some = f"by about {MOST} of {len(state.x_nc)} particles"
        yield Lint("some", f"masses and number densities were judged {some}, what known bugs do by about {FEW}")
    try:
        n_n, full_n = number_density(sample)
    except InputError:  # particles far from the box, which the next step will lose
        return
    if len(n_n):
        yield from _close(sample, id_n, float(np.nanmedian(n_n)) ** (-1 / sample.model.dimension))
    for t, law in enumerate(sample.model.eos, 1):
        fluid_n = (state.type_n == t) & ~state.solid_n
        if law.needs_energy or not fluid_n.any():
            continue
        bulk_n = fluid_n & full_n
        # A density that is summed is low at surfaces, as it should be.
        sums = sample.model.fix.rho_sum
        judged_n = bulk_n if sums else fluid_n
        density = list(_density(t, law, state.rho_n[judged_n], id_n[judged_n]))
        mass = list(_mass(t, law, sample.mass_n[bulk_n], n_n[bulk_n], state.rho_n[bulk_n], bool(density) and not sums))
        yield from mass if mass and sums else density + mass
        yield from _speed(t, law, state.v_nc[fluid_n])


def _close(sample: ParticleSample, id_n: Array, spacing: float) -> Iterator[Lint]:
    """Judge the closest pairs; two solids may overlap, but not lie at one place."""
    state = sample.state
    i, j, shift_pc = directed_pairs(state.x_nc, sample.box, min(CLOSE * spacing, sample.model.cut))
    r = separations(state.x_nc, i, j, shift_pc)
    once = (id_n[i] < id_n[j]) & (~(state.solid_n[i] & state.solid_n[j]) | (r == 0))
    if not once.any():
        return
    i, j, r, across = i[once], j[once], r[once], shift_pc[once].any(axis=1)
    at = int(np.lexsort((id_n[i], r))[0])
    pair = f"atoms {id_n[i[at]]} and {id_n[j[at]]}"
    if r[at] == 0:
        brief = f"{pair} lie at the same place"
        more = f" ({counted(int((r == 0).sum()), 'such pair')})" if (r == 0).sum() > 1 else ""
        yield Lint("place", f"{brief}{more}: forces between them are not defined (delete_atoms overlap)", 1.0, brief)
        return
    boundary = " across a boundary" if across[at] else ""
    yield Lint(
        "close",
        f"{pair} are {number(r[at])} apart{boundary}, {number(r[at] / spacing, 2)} of the spacing {number(spacing)} "
        f"({counted(len(r), 'pair')} closer than {CLOSE:g} of it)",
        1 - r[at] / spacing,
        f"{pair} are {number(r[at] / spacing, 2)} of the spacing apart",
    )


def _density(t: int, law: EOS, rho_n: Array, id_n: Array) -> Iterator[Lint]:
    """Judge the densities of a type, by the median if it is far, else by the particles that are."""
    off_n = np.abs(rho_n / law.rho0 - 1)
    if not (off_n > FAR).any():
        return
    median = float(np.median(rho_n))
    whole = abs(median / law.rho0 - 1) > FAR
    rho = median if whole else float(rho_n[np.argmax(off_n)])
    pressure = (float(law.pressure(rho)) - law.background) / (law.rho0 * law.cs**2)
    of = (
        f"median of {len(rho_n)} fluid particles: {rho:.6g}"
        if whole
        else f"{rho:.6g}, atom {id_n[np.argmax(off_n)]}; {(off_n > FAR).sum()} of {len(rho_n)} fluid particles are off"
    )
    brief = f"rho is {rho / law.rho0:.3g} times rho0"
    line = (
        f"{brief} = {law.rho0:g} ({of}), which {law.style} makes a pressure of {pressure:.3g} rho0 c^2; a weakly "
        f"compressible fluid stays within {100 * FAR:g} %"
    )
    yield Lint(f"rho {t}", f"type {t}: {line}", abs(rho / law.rho0 - 1), brief)


def _mass(t: int, law: EOS, mass_n: Array, n_n: Array, rho_n: Array, far: bool) -> Iterator[Lint]:
    """Judge the masses of a type; masses that fit a density far from rho0 are not blamed as well.

    Particles with masses of their own are judged by groups of one mass.
    """
    for mass in np.unique(mass_n).tolist():
        own_n = mass_n == mass
        filled = float(np.median(mass * n_n[own_n])) / law.rho0
        fits = far and abs(float(np.median(mass * n_n[own_n] / rho_n[own_n])) - 1) <= FAR
        if fits or not abs(filled - 1) > FAR:
            continue
        volume = float(np.median(1 / n_n[own_n]))
        factor = times(filled)
        line = (
            f"type {t}: m = {mass:.6g} is {factor} times rho0 V = {law.rho0 * volume:.6g} (V = {volume:.6g} by the "
            f"spacing of {own_n.sum()} fluid particles with full support): sum_j m/rho0 W_ij is {factor} instead "
            "of 1, and gradients and forces are wrong by this factor"
        )
        yield Lint(
            f"mass {t}", line, abs(math.log(filled)) if filled > 0 else math.inf, f"mass is {factor} times rho0 V"
        )


def _speed(t: int, law: EOS, v_nc: Array) -> Iterator[Lint]:
    """Judge the speed of sound of a type by its fastest particle."""
    speed = float(np.sqrt((v_nc**2).sum(axis=1)).max())
    if speed and float(f"{law.cs / speed:.3g}") < SLOW:  # as it is printed
        line = (
            f"type {t}: speed of sound {law.cs:g} is {law.cs / speed:.3g} times the largest speed of its fluid, "
            f"{speed:.3g}: its density will vary by about {times(100 * (speed / law.cs) ** 2)} %; a ratio of {SLOW:g} "
            "would limit this to 1 %"
        )
        yield Lint(f"speed {t}", line, speed / law.cs, f"fluid reaches {speed / law.cs:.3g} times the speed of sound")


def pulls(sample: ParticleSample, left_out_c: Any) -> Iterator[tuple[BoolArray, Array, float]]:
    """Yield the fluid that gravity or addforce acts on, (n,), its acceleration (d,) and its height along that.

    ``left_out_c`` are axes along which accelerations do not count.
    """
    state = sample.state
    for action, acts_n in sample.actions:
        fluid_n = acts_n & ~state.solid_n
        if action.style == "setforce" or not fluid_n.any():
            continue
        vector_c = np.where(left_out_c, 0.0, np.array(action.vector[: sample.model.dimension], float))
        g_c = vector_c / float(np.median(sample.mass_n[fluid_n])) if action.style == "addforce" else vector_c
        g = float(np.linalg.norm(g_c))
        yield fluid_n, g_c, float(np.ptp(state.x_nc[fluid_n] @ g_c)) / g if g > 0 else 0.0


def _weight(sample: ParticleSample) -> Iterator[Lint]:
    """Judge the speed of sound by the height of the fluid that is accelerated, but along periodic axes."""
    model, state = sample.model, sample.state
    for fluid_n, g_c, height in pulls(sample, sample.box.periodic):
        laws = [model.eos[t] for t in np.unique(state.type_n[fluid_n]).tolist()]
        g = float(np.linalg.norm(g_c))
        c = min((law.cs for law in laws if not law.needs_energy), default=math.inf)
        fall = math.sqrt(g * height)
        if fall and float(f"{c / fall:.3g}") < SLOW:  # as it is printed
            line = (
                f"speed of sound {c:g} is {c / fall:.3g} times sqrt(g h) = {fall:.3g} (g = {g:.4g}, fluid of height "
                f"{height:.4g}): its weight will compress it by about {100 * (fall / c) ** 2:.2g} %; a ratio "
                f"of {SLOW:g} would limit this to 1 %"
            )
            yield Lint("weight", line, fall / c, f"speed of sound is {c / fall:.3g} times sqrt(g h)")


def held(sample: ParticleSample) -> BoolArray:
    """Return the fluid particles that a setforce of 0 keeps from feeling any force, (n,)."""
    held_n: BoolArray = np.zeros(len(sample.state.type_n), bool)
    for action, acts_n in sample.actions:
        if action.style == "setforce" and not any(c != 0 for c in action.vector[: sample.model.dimension]):
            held_n |= acts_n
    return held_n & ~sample.state.solid_n


def _walls(sample: ParticleSample) -> Iterator[Lint]:
    state, held_n = sample.state, held(sample)
    if held_n.any():
        yield Lint(
            "held",
            f"fix setforce 0 holds {held_n.sum()} particles of type {_types(state.type_n[held_n])} that are fluid: "
            "those of a wall must be solid (set ... rheo/status 1)",
        )
    if sample.model.fix.interface_reconstruct and not state.solid_n.any():
        yield Lint(
            "reconstruct",
            f"fix rheo has interface/reconstruct, but none of {len(state.type_n)} particles is solid: nothing is "
            "reconstructed (set ... rheo/status 1)",
        )


def _types(type_n: Array) -> str:
    return ", ".join(map(str, np.unique(type_n).tolist()))


@dataclass
class Stillness:
    """Fluid that does not move from one sample to the next although something next to it does.

    A neighbour that moves drags a particle along, by the viscosity, by its density if by nothing else: what is at rest
    to the last bit ten steps later is held, or not integrated.
    """

    line: str = ""
    _exposed: Any = ()  # ids of fluid at rest next to something that moves, in the last sample
    _most: int = 1  # forces on one particle may cancel by symmetry

    def look(self, step: int, id_n: Array, sample: ParticleSample, first: bool) -> None:
        """Take a sample; ``first`` of a run, before which velocities may have been set."""
        state, box = sample.state, sample.box
        moves_n = (state.v_nc != 0).any(axis=1)
        still_n = ~moves_n & ~state.solid_n & ~held(sample)  # particles held by setforce have a separate line
        stuck_n = still_n & np.isin(id_n, self._exposed)
        count = 0 if first else int(stuck_n.sum())
        if count > self._most:
            self._most = count
            self.line = (
                f"{count} fluid particles of type {_types(state.type_n[stuck_n])} are at rest in step {step} as in the "
                "sample before, although others next to them moved: something holds them; those of a wall must be "
                "solid (set ... rheo/status 1)"
            )
        self._exposed = ()
        if still_n.any() and moves_n.any():
            i, j, _ = directed_pairs(state.x_nc, box, sample.model.cut)
            near_n = np.bincount(i, moves_n[j], len(id_n)) > 0
            self._exposed = id_n[still_n & near_n]
