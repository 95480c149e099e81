"""Set-ups that LAMMPS runs without a word and that physics forbids, judged by the first sample of a run.

Every line has the numbers that it is judged by. Gases are left out: they have neither an equilibrium density nor a
speed of sound of their own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from eos_ref import EOS
from eos_ref.errors import InputError
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.pairs import directed_pairs
from eos_ref.model.box import BoolArray
from lammps_cases.audit.evaluation import ParticleSample

Array = npt.NDArray[Any]
FAR = 0.1  # of rho0: ten times what a weakly compressible fluid is set up to vary by
SLOW = 10.0  # times the largest speed is what sound takes for densities to vary by 1 %, Monaghan, JCP 110, 399 (1994)
OUTER = 2 / 3  # of the cutoff, beyond which a full support has neighbours in every direction


def number_density(sample: ParticleSample) -> tuple[Array, BoolArray]:
    r"""Return the number densities :math:`n_i=\sum_jW_{ij}`, i included, and which particles have full support.

    1/n is the volume of a particle, whatever its mass. The support is full if the outer third of the cutoff holds
    neighbours within 45 degrees of every axis and every diagonal.
    """
    model, state = sample.model, sample.state
    pairs = ArrayEvaluator(model, sample.box, state.type_n, state.solid_n)
    pairs.move(state.x_nc)
    own = model.kernel.normalisation(model.dimension, model.cut) * float(model.kernel.shape(0.0))
    outer_p = pairs.r > OUTER * model.cut
    full_n = np.ones(len(state.type_n), bool)
    for direction in np.ndindex(*(3,) * model.dimension):
        d_c = np.array(direction) - 1.0
        if d_c.any():
            along_p = sum(x_p * c for x_p, c in zip(pairs.x, d_c, strict=True)) / np.linalg.norm(d_c)
            full_n &= np.bincount(pairs.i, outer_p & (along_p >= math.sqrt(0.5) * pairs.r), pairs.n) > 0
    return own + np.asarray(pairs.kernel_sum()), full_n


def lints(sample: ParticleSample) -> tuple[dict[int, str], dict[str, str]]:
    """Return lines by type, where densities are far from rho0, and by subject for whatever else is questionable."""
    state, far, lines = sample.state, dict[int, str](), _walls(sample) | _gravity(sample)
    try:
        n_n, full_n = number_density(sample)
    except InputError:  # particles far from the box, which the next step will lose
        return {}, lines
    for t, law in enumerate(sample.model.eos, 1):
        fluid_n = (state.type_n == t) & ~state.solid_n
        if law.needs_energy or not fluid_n.any():
            continue
        bulk_n = fluid_n & full_n
        # A density that is summed is low at surfaces, as it should be.
        judged_n = bulk_n if sample.model.fix.rho_sum else fluid_n
        if line := _density(law, state.rho_n[judged_n]):
            far[t] = line
        mass = _mass(law, sample.mass_n[bulk_n], n_n[bulk_n], state.rho_n[bulk_n], t in far)
        of_type = {"mass": mass, "speed": _speed(law, state.v_nc[fluid_n])}
        lines |= {f"{subject} {t}": f"type {t}: {line}" for subject, line in of_type.items() if line}
    return far, lines


def _density(law: EOS, rho_n: Array) -> str:
    """Judge the densities of a type."""
    if not rho_n.size:
        return ""
    rho = float(np.median(rho_n))
    if not abs(rho / law.rho0 - 1) > FAR:
        return ""
    pressure = (float(law.pressure(rho)) - law.background) / (law.rho0 * law.cs**2)
    return (
        f"rho is {rho / law.rho0:.3g} times rho0 = {law.rho0:g} (median of {len(rho_n)} fluid particles: {rho:.6g}), "
        f"which {law.style} makes a pressure of {pressure:.3g} rho0 c^2; a weakly compressible fluid stays within "
        f"{100 * FAR:g} %"
    )


def _mass(law: EOS, mass_n: Array, n_n: Array, rho_n: Array, far: bool) -> str:
    """Judge the masses of a type; those that fit a density which is far from rho0 are not to blame as well."""
    if not mass_n.size:
        return ""
    filled = float(np.median(mass_n * n_n)) / law.rho0
    fits = far and abs(float(np.median(mass_n * n_n / rho_n)) - 1) <= FAR
    if fits or not abs(filled - 1) > FAR:
        return ""
    volume = float(np.median(1 / n_n))
    return (
        f"m = {float(np.median(mass_n)):.6g} is {filled:.3g} times rho0 V = {law.rho0 * volume:.6g} (V = {volume:.6g} "
        f"by the spacing of {len(mass_n)} fluid particles with full support): sum_j m/rho0 W_ij is {filled:.3g} "
        "instead of 1, and gradients and forces are wrong by this factor"
    )


def _speed(law: EOS, v_nc: Array) -> str:
    """Judge the speed of sound of a type by its fastest particle."""
    speed = float(np.sqrt((v_nc**2).sum(axis=1)).max())
    if not law.cs < SLOW * speed:
        return ""
    return (
        f"speed of sound {law.cs:g} is {law.cs / speed:.3g} times the largest speed of its fluid, {speed:.3g}: its "
        f"density will vary by about {100 * (speed / law.cs) ** 2:.2g} %; a ratio of {SLOW:g} would limit this to 1 %"
    )


def _gravity(sample: ParticleSample) -> dict[str, str]:
    """Judge the speed of sound by the height of the fluid that gravity acts on, but along periodic axes."""
    model, state, lines = sample.model, sample.state, dict[str, str]()
    for action, acts_n in sample.actions:
        if action.style != "gravity":
            continue
        fluid_n = acts_n & ~state.solid_n
        g_c = np.where(sample.box.periodic, 0.0, np.array(action.vector[: model.dimension], float))
        g = float(np.linalg.norm(g_c))
        laws = [model.eos[t] for t in np.unique(state.type_n[fluid_n]).tolist()]
        c = min((law.cs for law in laws if not law.needs_energy), default=math.inf)
        height = float(np.ptp(state.x_nc[fluid_n] @ g_c)) / g if g > 0 and laws else 0.0
        fall = math.sqrt(g * height)
        if c < SLOW * fall:
            lines["gravity"] = (
                f"speed of sound {c:g} is {c / fall:.3g} times sqrt(g h) = {fall:.3g} (g = {g:g}, fluid of height "
                f"{height:.4g}): its weight will compress it by about {100 * (fall / c) ** 2:.2g} %; a ratio "
                f"of {SLOW:g} would limit this to 1 %"
            )
    return lines


def held(sample: ParticleSample) -> BoolArray:
    """Return the fluid particles that a setforce of 0 keeps from feeling any force, (n,)."""
    held_n: BoolArray = np.zeros(len(sample.state.type_n), bool)
    for action, acts_n in sample.actions:
        if action.style == "setforce" and not any(c != 0 for c in action.vector[: sample.model.dimension]):
            held_n |= acts_n
    return held_n & ~sample.state.solid_n


def _walls(sample: ParticleSample) -> dict[str, str]:
    state, held_n, lines = sample.state, held(sample), dict[str, str]()
    if held_n.any():
        lines["held"] = (
            f"fix setforce 0 holds {held_n.sum()} particles of type {_types(state.type_n[held_n])} that are fluid: "
            "those of a wall must be solid (set ... rheo/status 1)"
        )
    if sample.model.fix.interface_reconstruct and not state.solid_n.any():
        lines["reconstruct"] = (
            f"fix rheo has interface/reconstruct, but none of {len(state.type_n)} particles is solid: nothing is "
            "reconstructed (set ... rheo/status 1)"
        )
    return lines


def _types(type_n: Array) -> str:
    return ", ".join(map(str, np.unique(type_n).tolist()))


@dataclass
class Stillness:
    """Fluid that does not move from one sample to the next although something beside it does.

    A neighbour that moves drags a particle along, by the viscosity, by its density if by nothing else: who is at rest
    to the last bit ten steps later is held, or not integrated.
    """

    line: str = ""
    _exposed: Any = ()  # ids of fluid at rest beside something that moves, in the last sample
    _most: int = 1  # forces on one particle may cancel by symmetry

    def look(self, step: int, id_n: Array, sample: ParticleSample, first: bool) -> None:
        """Take a sample; ``first`` of a run, before which velocities may have been set."""
        state, box = sample.state, sample.box
        moves_n = (state.v_nc != 0).any(axis=1)
        still_n = ~moves_n & ~state.solid_n & ~held(sample)  # those that setforce holds have a line of their own
        stuck_n = still_n & np.isin(id_n, self._exposed)
        count = 0 if first else int(stuck_n.sum())
        if count > self._most:
            self._most = count
            self.line = (
                f"{count} fluid particles of type {_types(state.type_n[stuck_n])} are at rest in step {step} as in the "
                "sample before, although others beside them moved: something holds them; those of a wall must be solid "
                "(set ... rheo/status 1)"
            )
        self._exposed = ()
        if still_n.any() and moves_n.any():
            i, j, _ = directed_pairs(state.x_nc, box, sample.model.cut)
            beside_n = np.bincount(i, moves_n[j], len(id_n)) > 0
            self._exposed = id_n[still_n & beside_n]
