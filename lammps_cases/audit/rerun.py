"""The right evolution of a deck's first sample: by runs of the reference, and by closed solutions.

The reference runs the deck's fluid unchanged, and with one change at a time.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import Any

import numpy as np

from eos_ref.analytic import channel, waves
from eos_ref.compiled.evaluator import CompiledEvaluator
from eos_ref.eos.bounds import EPS
from eos_ref.eos.table import FloatArray
from eos_ref.errors import InputError
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.box import Box
from eos_ref.model.parameters import Force, Model
from eos_ref.model.quantities import needed_to_step
from eos_ref.model.state import State
from lammps_cases.audit.evaluation import ParticleSample, TimedSample, model_with_forces
from lammps_cases.comparison.problem import Problem
from lammps_cases.findings import Finding
from lammps_cases.findings.variants import combined
from lammps_cases.records.case_parts import ClosedRecord, SeriesRecord
from lammps_cases.verdict.runaway import RUNAWAY, fastest

AS_IT_IS, HALF_STEP, FINER, SILENT = "as it is", "half the time step", "half the spacing", "no artificial viscosity"
SLOW = 200_000  # steps times particles of a run with a finding, which is not compiled; above, it is shortened
LARGE = 40_000_000  # steps times particles of any other run
POINTS = 2001  # across a channel, for the mean of the velocity
# Part of the largest velocity by which vortices may differ: a product of sines, their arguments rounded.
VORTICES = 64 * EPS


@dataclass(frozen=True)
class ChangedFluid:
    """A fluid to be run: the deck's, except for the change ``name``."""

    name: str
    model: Model
    state: State
    finer: int = 1  # steps per step of the deck
    findings: tuple[Finding, ...] = ()


def boxed(sample: ParticleSample) -> ParticleSample:
    """Return a sample whose particles lie in its box: between two lists of neighbours LAMMPS lets them leave it."""
    box, x_nc = sample.box, sample.state.x_nc
    x_nc = x_nc - box.shift(box.images(x_nc))
    ends = np.where(box.periodic, (box.low_c, box.high_c), (x_nc.min(axis=0), x_nc.max(axis=0)))
    low_c, high_c = np.minimum(box.low_c, ends[0]), np.maximum(box.high_c, ends[1])
    grown = replace(box, low_c=tuple(map(float, low_c)), high_c=tuple(map(float, high_c)))
    return replace(sample, box=grown, state=replace(sample.state, x_nc=x_nc))


def reruns(good: TimedSample, steps: int, every: int, entries: Sequence[Finding]) -> list[SeriesRecord]:
    """Run the reference on from a sample, as it is and with each thing changed.

    Parameters
    ----------
    good : TimedSample
        The first sample of a run.
    steps, every : int
        Steps to take, and between two samples.
    entries : sequence of Finding
        Each is applied to the reference alone.

    Returns
    -------
    list of SeriesRecord
        Empty if forces act on other groups than types.
    """
    model = model_with_forces(good.sample)
    if model is None:
        return []
    sample = boxed(good.sample)
    series = [_series(of, sample.box, good, steps, every) for of in _changes(model, sample.box, sample.state, entries)]
    return [of for of in series if len(of.steps) > 1 or of.ended]


def _changes(model: Model, box: Box, state: State, entries: Sequence[Finding]) -> Iterator[ChangedFluid]:
    pair, fix = model.pair, model.fix
    yield ChangedFluid(AS_IT_IS, model, state)
    if pair.artificial_viscosity:
        yield ChangedFluid(SILENT, replace(model, pair=replace(pair, artificial_viscosity=0.0)), state)
    if pair.rho_damp:
        yield ChangedFluid("no density diffusion", replace(model, pair=replace(pair, rho_damp=0.0)), state)
    if fix.shift:
        yield ChangedFluid("no shifting", replace(model, fix=replace(fix, shift=None)), state)
    yield ChangedFluid(HALF_STEP, model, state, finer=2)
    half = finer(model, box, state)
    yield half
    if pair.artificial_viscosity:  # which is proportional to the spacing
        silent = replace(half.model, pair=replace(half.model.pair, artificial_viscosity=0.0))
        yield replace(half, name=f"{FINER}, {SILENT}", model=silent)
    for entry in entries:
        yield ChangedFluid(entry.id, model, state, findings=(entry,))


def finer(model: Model, box: Box, state: State) -> ChangedFluid:
    """Return a fluid with every particle split in two along each axis, and the lengths of the method halved.

    The parts lie around the particle, a quarter of its size away, and those of fluid have the velocities that its
    gradient gives there. Decks choose the coefficient of density diffusion by the cutoff: it is halved with that.
    """
    d = model.dimension
    parts = 2**d
    mass_n = np.array(model.mass_t)[state.type_n - 1] if state.mass_n is None else state.mass_n
    offset_kc = np.array(list(product((-0.25, 0.25), repeat=d)))
    offset_nkc = ((mass_n / state.rho_n) ** (1 / d))[:, None, None] * offset_kc
    evaluated = Simulation(model, box, state, ("grad/v",))
    evaluated.setup()
    gradient_ncc = np.where(state.solid_n[:, None, None], 0.0, evaluated.output("grad/v"))
    v_nkc = state.v_nc[:, None, :] + np.einsum("nab,nkb->nka", gradient_ncc, offset_nkc)

    def split(array: Any, share: int = 1) -> Any:
        if array is None:
            return None
        return np.repeat(array if share == 1 else array / share, parts, axis=0)

    x_nc = (state.x_nc[:, None, :] + offset_nkc).reshape(-1, d)
    divided = State(
        x_nc - box.shift(box.images(x_nc)), v_nkc.reshape(-1, d),
        split(state.rho_n), split(state.type_n), split(state.solid_n),
        split(state.energy_n, parts), split(state.mass_n, parts),
    )  # fmt: skip
    half = replace(
        model,
        mass_t=tuple(m / parts for m in model.mass_t),
        fix=replace(model.fix, cut=model.fix.cut / 2),
        pair=replace(model.pair, cut=model.pair.cut / 2, rho_damp=model.pair.rho_damp / 2),
        forces=tuple(_shared(force, parts) for force in model.forces),
    )
    return ChangedFluid(FINER, half, divided, finer=2)


def _shared(force: Force, parts: int) -> Force:
    """Return a force on particles as it is on their parts: that of addforce is each particle's own."""
    if force.style != "addforce":
        return force
    return replace(force, vector=tuple(None if v is None else v / parts for v in force.vector))


def _series(of: ChangedFluid, box: Box, good: TimedSample, steps: int, every: int) -> SeriesRecord:
    """Run one fluid, sampled at the steps of the deck."""
    begin, dt = time.perf_counter(), good.timestep / of.finer
    count = affordable(len(of.state.x_nc), steps * of.finer, bool(of.findings)) // of.finer
    count = steps if count == steps else count - count % every  # a sample that the other runs have, too
    record = SeriesRecord(name=of.name, findings=[e.id for e in of.findings], steps=[], kinetic=[], momentum=[])
    try:
        run = _simulation(of, box, dt, count * of.finer)
        run.setup()
        limit, done = RUNAWAY * fastest(of.model, of.state), 0
        _look(record, run, 0)
        for step in looks(count, every)[1:]:
            run.run((step - done) * of.finer, dt)
            done = step
            if not np.abs(run.state.v_nc).max(initial=0.0) <= limit:
                record.ended = f"ran away before step {step}"
                break
            _look(record, run, step)
    except InputError as error:
        record.ended = str(error)
    record.seconds = time.perf_counter() - begin
    return record


def looks(steps: int, every: int) -> list[int]:
    """Return the steps at which a run is sampled."""
    return [*range(0, steps, every), steps]


def shortened(particles: int, steps: int) -> str:
    """Return which runs of the reference are shorter than the deck's, in words; empty if all have its length."""
    ends = {what: affordable(particles, steps, bool(slow)) for slow, what in enumerate(("as it is", "with a finding"))}
    return " and ".join(f"those {what} end after step {end}" for what, end in ends.items() if end < steps)


def affordable(particles: int, steps: int, slow: bool) -> int:
    """Return the steps, or fewer if the run would take too long for a user."""
    return min(steps, (SLOW if slow else LARGE) // max(particles, 1))


def _simulation(of: ChangedFluid, box: Box, dt: float, steps: int) -> Simulation:
    fields = needed_to_step(of.model)
    variants = [entry.model_variant for entry in of.findings if entry.model_variant]
    if not variants:
        return Simulation(of.model, box, of.state, fields, CompiledEvaluator)
    problem = Problem(of.model, box, of.state, dt, fields, (0, steps))
    stages, stepping = combined(variants, problem, {}) or (ArrayEvaluator, Simulation)
    return stepping(of.model, box, of.state, fields, stages)


def _look(record: SeriesRecord, run: Simulation, step: int) -> None:
    mass_n, v_nc = run.mass_n, run.state.v_nc
    record.steps.append(step)
    record.kinetic.append(0.5 * float((mass_n[:, None] * v_nc**2).sum()))
    record.momentum.append([float(of) for of in (mass_n[:, None] * v_nc).sum(axis=0)])


def closed(good: TimedSample, steps: Sequence[int]) -> ClosedRecord | None:
    """Return a closed solution of the deck at some steps after the sample; None if it has no known one.

    Known are the vortices of Taylor and Green in a periodic square, and fluid at rest between two plates, along which
    a force sets in.
    """
    model = model_with_forces(good.sample)
    if model is None or model.dimension != 2 or len({(law.style, law.eta) for law in model.viscosity}) != 1:
        return None
    if model.viscosity[0].style != "constant" or len({law.rho0 for law in model.eos.laws}) != 1:
        return None
    times = [step * good.timestep for step in steps]
    nu = model.viscosity[0].eta / model.eos.laws[0].rho0
    if not nu > 0:
        return None
    return _vortices(good, model, nu, steps, times) or _channel(good, model, nu, steps, times)


def _vortices(
    good: TimedSample, model: Model, nu: float, steps: Sequence[int], times: Sequence[float]
) -> ClosedRecord | None:
    box, state = good.sample.box, good.sample.state
    edge = box.edge_c[0]
    if not all(box.periodic) or box.edge_c[1] != edge or model.forces or state.solid_n.any():
        return None
    size, k = float(np.abs(state.v_nc).max(initial=0.0)), 2 * math.pi / edge
    x_nc = state.x_nc - np.array(box.low_c)
    if not size or not _are_vortices(state.v_nc, x_nc, k):
        return None
    kinetic = 0.5 * float((good.sample.mass_n[:, None] * state.v_nc**2).sum())
    values = [kinetic * math.exp(-4 * nu * k**2 * t) for t in times]
    if any(not 0 < after < before for before, after in pairwise(values)):
        return None  # too little or too much viscosity for a rate
    return ClosedRecord(
        flow="vortices of Taylor and Green", quantity="kinetic energy",
        about=f"decays at the rate 4 ν k², k = {k:.6g}",
        steps=list(steps), values=values, decays=True,
    )  # fmt: skip


def _are_vortices(v_nc: FloatArray, x_nc: FloatArray, k: float) -> bool:
    """Return whether velocities are those of vortices of either sense, for any centres along the axes."""
    for shift_c in ((0.0, 0.0), (0.5, 0.0), (0.0, 0.5), (0.25, 0.25), (0.25, 0.75), (0.75, 0.25), (0.75, 0.75)):
        at_nc = x_nc + 2 * math.pi / k * np.array(shift_c)
        u_n, w_n, _ = waves.taylor_green(at_nc[:, 0], at_nc[:, 1], 0.0, k, 1.0)
        unit_nc = np.stack([u_n, w_n], axis=1)
        amplitude = float((unit_nc * v_nc).sum() / (unit_nc * unit_nc).sum())
        if np.abs(v_nc - amplitude * unit_nc).max() <= VORTICES * max(1.0, k * np.abs(at_nc).max()) * abs(amplitude):
            return True
    return False


def _channel(
    good: TimedSample, model: Model, nu: float, steps: Sequence[int], times: Sequence[float]
) -> ClosedRecord | None:
    box, state = good.sample.box, good.sample.state
    fluid_n = ~state.solid_n
    if not all(box.periodic) or fluid_n.all() or not fluid_n.any() or state.v_nc.any():
        return None
    drive = _drive(model, state)
    if drive is None:
        return None
    along, acceleration = drive
    y_n, solid_n = state.x_nc[fluid_n, 1 - along], state.x_nc[state.solid_n, 1 - along]
    above_n, below_n = solid_n[solid_n > y_n.max()], solid_n[solid_n < y_n.min()]
    if not above_n.size or not below_n.size or above_n.size + below_n.size < solid_n.size:
        return None
    # The fluid fills what lies between the walls.
    width = float((good.sample.mass_n[fluid_n] / state.rho_n[fluid_n]).sum()) / float(box.edge_c[along])
    mass = float(good.sample.mass_n[fluid_n].sum())
    across_n = np.linspace(0.0, width, POINTS)
    means = [
        float(np.trapezoid(channel.plane_start_up(across_n, t, width, nu, acceleration), across_n)) / width
        for t in times
    ]
    return ClosedRecord(
        flow="fluid at rest between two plates, along which a force sets in", quantity=f"momentum along {'xy'[along]}",
        about=f"series of Poiseuille's flow; the plates are {width:.6g} apart",
        steps=list(steps), values=[mass * of for of in means],
    )  # fmt: skip


def _drive(model: Model, state: State) -> tuple[int, float] | None:
    """Return axis and size of the one acceleration of the fluid, if all solids are held."""
    fluid = set(np.unique(state.type_n[~state.solid_n]).tolist())
    solid = set(np.unique(state.type_n[state.solid_n]).tolist())
    driving = [force for force in model.forces if force.style != "setforce"]
    held = [force for force in model.forces if force.style == "setforce" and not any(force.vector)]
    if len(driving) != 1 or fluid & solid or not all(_acts(force, solid) for force in held) or not held:
        return None
    (force,) = driving
    axes = [axis for axis, component in enumerate(force.vector) if component]
    masses = {model.mass_t[t - 1] for t in fluid}
    if len(axes) != 1 or not _acts(force, fluid) or len(masses) != 1:
        return None
    component = force.vector[axes[0]] or 0.0
    return axes[0], component / masses.pop() if force.style == "addforce" else component


def _acts(force: Force, types: set[int]) -> bool:
    return force.types is None or types <= set(force.types)


def deviation(of: ClosedRecord, series: SeriesRecord, at: int | None = None) -> float | None:
    """Return how far a run is from the closed solution at a step, its last by default; None if it lacks the step.

    Of a decay it is the relative difference of the mean rates up to there, else that of the values.
    """
    exact = dict(zip(of.steps, of.values, strict=True))
    at = at if at is not None else max((step for step in series.steps if step in exact), default=0)
    if not at or at not in exact or at not in series.steps:
        return None
    k = series.steps.index(at)
    if of.decays:
        return math.log(series.kinetic[k] / series.kinetic[0]) / math.log(exact[at] / exact[0]) - 1
    return series.momentum[k]["xyz".index(of.quantity[-1])] / exact[at] - 1
