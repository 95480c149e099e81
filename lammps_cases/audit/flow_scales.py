"""The scales of the flow of a deck or a scene, for which `lammps_cases.studies.stability.choice` chooses numbers.

A deck is set up by LAMMPS, its runs are not carried out: the flow is that of its first particles. Of several runs every
one is judged with its own fixes, and the strictest number counts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from eos_ref.errors import InputError
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.pairs import ROWS, Search
from eos_ref.kernels import reproducing
from eos_ref.kernels.styles import KERNELS
from eos_ref.model.consistent import consistent_model, consistent_state
from eos_ref.model.state import masses
from eos_ref.model.units import UNITS
from lammps_cases.audit.deck import Action
from lammps_cases.audit.evaluation import ParticleSample
from lammps_cases.audit.lints import blocks, number_density, pulls
from lammps_cases.audit.messages import DeckSetups
from lammps_cases.audit.options import Given
from lammps_cases.audit.rescale import sample_of
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import Atoms
from lammps_cases.setup import reference_side
from lammps_cases.studies.stability.advice import MOST, matrices
from lammps_cases.studies.stability.choice import FlowScales


def scales_of_deck(setups: DeckSetups, given: Given, where: str) -> list[FlowScales]:
    """Return the scales of a deck with the fixes of each of its runs.

    Raises
    ------
    InputError
        No particles of RHEO, no run whose model can be followed, or a flow without a scale.
    """
    if setups.start is None:
        raise InputError("deck", "must have an atom_style of RHEO", where=where)
    found, wrong = list[FlowScales](), list[InputError]()
    for run in setups.runs:
        try:
            sample = sample_of(run, setups.start, followed=given.speed is None)
            mass_n = np.full(len(sample.mass_n), np.nan) if run.mass_t is None else sample.mass_n
            sample = replace(sample, model=replace(sample.model, units=run.units), mass_n=mass_n)  # type: ignore[arg-type]
            found.append(scales(sample, given, run.dt))
        except InputError as error:
            wrong.append(error)
    if not found:
        raise wrong[0].at(where)
    return found


def scales_of_scene(scene: Scene, atoms: Atoms, given: Given, where: str) -> FlowScales:
    """Return the scales of a scene with its particles.

    Raises
    ------
    InputError
        Particles that do not interact or do not move, or a flow without a scale.
    """
    if scene.expect or not scene.interacts or scene.evolve is None:
        raise InputError("case", "must have particles that interact and move (evolve)", where)
    model, state = reference_side.model(scene, atoms, where), reference_side.state(scene, atoms, where)
    actions = [(Action(f.style, "all", f.vector), f.acts_on(state.type_n)) for f in model.forces]
    sample = ParticleSample(model, reference_side.box(scene, atoms), state, atoms.mass_n, actions)
    try:
        return scales(sample, given, scene.evolve.timestep)
    except InputError as error:
        raise error.at(where) from None


@dataclass(frozen=True)
class _Flow:
    """What particles, their laws and the forces on them say of a flow; numbers are consistent, axes those of the box.

    Attributes
    ----------
    ends_c : axes along which the fluid ends, at a wall, a surface or a face of the box
    present : types that have particles
    """

    sample: ParticleSample
    given: Given
    spacing: float
    surface: bool

    @cached_property
    def fluid_nc(self) -> Any:
        return self.sample.state.x_nc[~self.sample.state.solid_n]

    @cached_property
    def ends_c(self) -> Any:
        box, extent_c = self.sample.box, np.ptp(self.fluid_nc, axis=0) + self.spacing
        return ~np.array(box.periodic) | (extent_c < np.array(box.edge_c) - 1.5 * self.spacing)

    @cached_property
    def weight(self) -> tuple[Any, float]:
        """Acceleration (d,) along axes on which the fluid ends, and the height of the fluid along it."""
        found = [(g_c, height + self.spacing) for _, g_c, height in pulls(self.sample, ~self.ends_c)]
        g_c, height = max(found, key=lambda pull: _size(pull[0]), default=(np.zeros(len(self.ends_c)), 0.0))
        return g_c, (self.given.height or height) if g_c.any() else 0.0

    @cached_property
    def drive(self) -> float:
        return max((_size(g_c) for _, g_c, _ in pulls(self.sample, self.ends_c)), default=0.0)

    @property
    def head(self) -> float:
        return _size(self.weight[0]) * self.weight[1]

    @cached_property
    def length(self) -> float:
        ends = (np.ptp(self.fluid_nc, axis=0) + self.spacing)[self.ends_c]
        return self.given.length or self.weight[1] or float(min(ends, default=min(self.sample.box.edge_c)))

    @cached_property
    def falls(self) -> bool:
        """Whether fluid with a weight has a surface and, on a side, more than two cutoffs of empty space."""
        g_c, solid_nc = self.weight[0], self.sample.state.x_nc[self.sample.state.solid_n]
        if not (self.head and self.surface):
            return False
        up_c, low_c, high_c = -g_c / _size(g_c), self.fluid_nc.min(axis=0), self.fluid_nc.max(axis=0)
        beside_n = solid_nc @ up_c > (self.fluid_nc @ up_c).min() + self.spacing
        for axis in np.flatnonzero((np.abs(up_c) < 0.5) & self.ends_c):
            x_n = solid_nc[beside_n, axis]
            ahead = min([*x_n[x_n > high_c[axis]], self.sample.box.high_c[axis]]) - high_c[axis]
            behind = low_c[axis] - max([*x_n[x_n < low_c[axis]], self.sample.box.low_c[axis]])
            if max(ahead, behind) > 2 * self.sample.model.cut:
                return True
        return False

    @cached_property
    def present(self) -> list[int]:
        return sorted({*self.sample.state.type_n.tolist()})

    @cached_property
    def rho(self) -> dict[int, float]:
        """Density of the types: that of equilibrium, of a gas the lowest of its particles."""
        state, eos = self.sample.state, self.sample.model.eos
        lowest = {t: float(state.rho_n[state.type_n == t].min()) for t in self.present}
        return {t: lowest[t] if eos[t].needs_energy else eos[t].rho0 for t in self.present}

    @cached_property
    def nu(self) -> float:
        """Largest kinematic viscosity, of a pair of types by the mean of both: light among viscous particles."""
        eta = [law.eta for law in self.sample.model.viscosity]
        return max((eta[t - 1] + eta[s - 1]) / 2 / self.rho[t] for t in self.present for s in self.present)

    @cached_property
    def heat(self) -> float:
        thermal = self.sample.model.thermal or ()
        of_type = {t: thermal[t - 1] for t in self.present if thermal}
        return max((h.conductivity / h.specific_heat / self.rho[t] for t, h in of_type.items()), default=0.0)

    @cached_property
    def sounds(self) -> tuple[float, float]:
        """Smallest speed of sound of fix rheo, NaN without one, and the largest of all laws over it."""
        model, state = self.sample.model, self.sample.state
        cs = [model.eos[t].cs for t in self.present if not model.eos[t].needs_energy]
        e_n = None if state.energy_n is None else state.energy_n / masses(model, state)
        gases = [
            float(np.nanmax(model.eos[t].sound_speed(state.rho_n[at_n], None if e_n is None else e_n[at_n])))
            for t in self.present
            if model.eos[t].needs_energy and (at_n := state.type_n == t).any()
        ]
        return min(cs, default=math.nan), max([*cs, *gases]) / min(cs, default=1.0)

    @cached_property
    def sudden(self) -> bool:
        """Whether the fluid begins without the pressure of its weight."""
        state, laws = self.sample.state, self.sample.model.eos
        risen = 0.0
        for t in self.present:
            rho_n = state.rho_n[(state.type_n == t) & ~state.solid_n]
            if rho_n.size and not (laws[t].needs_energy or self.sample.model.fix.rho_sum):
                risen = max(risen, float(np.ptp(laws[t].pressure(rho_n))) / laws[t].rho0)
        return bool(self.head) and risen < 0.5 * self.head

    @cached_property
    def speed(self) -> tuple[float, str]:
        """The fastest of the flow, and where the number comes from.

        Raises
        ------
        InputError
            Nothing moves the fluid, or a force without walls and viscosity.
        """
        if self.given.speed is not None:
            return self.given.speed, "U is given"
        fastest = float(np.linalg.norm(self.sample.state.v_nc, axis=1).max())
        channel = self.nu > 0 and (self.ends_c.any() or self.given.length is not None)
        if (self.drive and not channel) or not (self.drive or self.head or fastest):
            why = "a force drives fluid without walls or viscosity" if self.drive else "nothing moves the fluid"
            raise InputError("speed", f"must be given: {why} (option --speed)")
        found = (
            (fastest, "U is the fastest particle of the start" if fastest else "U = 0: the fluid begins at rest"),
            (2 * math.sqrt(self.head) * self.falls, "U = 2 (g H)^(1/2) of a front on a dry floor"),
            (self.drive * self.length**2 / (8 * self.nu) if self.drive else 0.0, "U = g L^2/8nu of a channel"),
        )
        return max(found, key=lambda each: each[0])

    @property
    def like(self) -> str:
        """The measured flow that is most like it."""
        state, model, speed = self.sample.state, self.sample.model, self.speed[0]
        walls, fluids = bool(state.solid_n.any()), {*state.type_n[~state.solid_n].tolist()}
        reynolds = speed * self.length / self.nu if self.nu else math.inf
        kinds = {
            "convection": model.thermal and walls and self.head,
            "heat-wave": model.thermal and not speed,
            "dam-break": self.falls,
            "tank": walls and self.head,
            "poiseuille": walls and self.drive,
            "couette": walls and model.fix.interface_reconstruct,
            "cavity-stored": walls,
            "drop": self.surface,
            "interface": len(fluids) > 1,
            "taylor-green": reynolds <= 10,
        }
        return next((name for name, fits in kinds.items() if fits), "taylor-green-100")


def scales(sample: ParticleSample, given: Given, timestep: float) -> FlowScales:
    """Return the scales of particles under the forces that act on them, in consistent units.

    Raises
    ------
    InputError
        No fluid; neither the particles nor a force give a speed.
    """
    units = UNITS[sample.model.units]
    factors = {"gravity": units.of("acceleration"), "addforce": units.of("f")}
    actions = [
        (replace(action, vector=tuple((c or 0.0) * factors.get(action.style, 1.0) for c in action.vector)), acts_n)
        for action, acts_n in sample.actions
    ]
    model, state = consistent_model(sample.model, units), consistent_state(sample.state, units)
    sample = replace(sample, model=model, state=state, actions=actions)
    if state.solid_n.all():
        raise InputError("deck", "must hold particles of fluid")
    n_n, full_n = number_density(sample)
    spacing = float(np.nanmedian(n_n)) ** (-1 / model.dimension)
    filled_n = model.rho0[state.type_n - 1] * spacing**model.dimension  # where particles have masses of their own
    sample = replace(sample, mass_n=np.where(np.isnan(sample.mass_n), filled_n, sample.mass_n))
    flow = _Flow(sample, given, spacing, bool((np.isfinite(n_n) & ~full_n & ~state.solid_n).any()))
    own = [float(np.median(sample.mass_n[state.type_n == t])) for t in flow.present]
    volume = min(mass / rho for mass, rho in zip(own, flow.rho.values(), strict=True))
    used = {"shift": model.fix.shift, "rho/sum": model.fix.rho_sum, "thermal": model.thermal}
    return FlowScales(
        like=flow.like,
        dimension=model.dimension,
        spacing=spacing,
        length=flow.length,
        speed=flow.speed[0],
        because=flow.speed[1],
        head=flow.head,
        sudden=flow.sudden,
        gravity=max(_size(flow.weight[0]), flow.drive),
        sound=flow.sounds[0],
        stiffest=flow.sounds[1],
        nu=flow.nu,
        heat=flow.heat,
        smoothing=model.pair.rho_damp,
        tension=given.surface_tension / min(flow.rho.values()),
        artificial=model.pair.artificial_viscosity > 0,
        surface=flow.surface,
        fewest=_fewest(sample),
        matrices="" if flow.surface or len(state.x_nc) > MOST else _matrices(sample),
        pressures=units.energy / volume,
        viscous=units.energy * units.density / units.viscosity / volume,
        kernel=model.fix.kernel,
        cut=model.fix.cut,
        zmin=model.fix.zmin,
        timestep=timestep,
        options=tuple(name for name, on in used.items() if on),
    )


def _size(g_c: Any) -> float:
    return float(np.linalg.norm(g_c))


def _matrices(sample: ParticleSample) -> str:
    """Return what the moment matrices of a reproducing kernel are like at the start."""
    model, state = sample.model, sample.state
    style = model.fix.kernel if model.corrects_gradients else "RK1"
    fix = replace(model.fix, kernel=style, zmin=reproducing.basis_size(KERNELS[style].order, model.dimension))
    evaluator = ArrayEvaluator(replace(model, fix=fix), sample.box, state.type_n, state.solid_n)
    evaluator.move(state.x_nc)
    return "".join(f"; {line.text}" for line in matrices(evaluator, np.asarray(state.rho_n, float)))


def _fewest(sample: ParticleSample) -> int:
    """Return the least number of neighbours of a fluid particle, of many particles in some blocks."""
    state, cut, least = sample.state, sample.model.cut, math.inf
    search = Search(state.x_nc, sample.box, cut)
    for first in blocks(len(state.x_nc)):
        own = slice(first, min(first + ROWS, len(state.x_nc)))
        i, _, _ = search.rows(first, own.stop, cut)
        count_n = np.bincount(i - first, minlength=own.stop - first)
        least = min(least, count_n[~state.solid_n[own]].min(initial=2**31))
    return int(least)
