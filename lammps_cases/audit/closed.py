"""Closed solutions of flows that decks set up: what the deck's first sample ought to become."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from eos_ref.analytic import channel, waves
from eos_ref.eos.bounds import EPS
from eos_ref.eos.table import FloatArray
from eos_ref.model.parameters import Force, Model
from eos_ref.model.state import State
from lammps_cases.audit.outlook import Good, model_with_forces
from lammps_cases.records.case_parts import ClosedRecord, SeriesRecord

POINTS = 2001  # across a channel, for the mean of the velocity
VORTICES = (
    64 * EPS
)  # of the largest velocity, by which vortices may differ: a product of sines, their arguments rounded


def closed(good: Good, steps: Sequence[int]) -> ClosedRecord | None:
    """Return what a closed solution says of the deck at some steps after the sample; None if there is none.

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


def _vortices(good: Good, model: Model, nu: float, steps: Sequence[int], times: Sequence[float]) -> ClosedRecord | None:
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
        return None  # too little viscosity or too much for a rate
    return ClosedRecord(
        flow="vortices of Taylor and Green", quantity="kinetic energy",
        about=f"decays at the rate 4 ν k², k = {k:.6g}",
        steps=list(steps), values=values, decays=True,
    )  # fmt: skip


def _are_vortices(v_nc: FloatArray, x_nc: FloatArray, k: float) -> bool:
    """Return whether velocities are those of vortices, of either sense, wherever their centres lie along the axes."""
    for shift_c in ((0.0, 0.0), (0.5, 0.0), (0.0, 0.5), (0.25, 0.25), (0.25, 0.75), (0.75, 0.25), (0.75, 0.75)):
        at_nc = x_nc + 2 * math.pi / k * np.array(shift_c)
        u_n, w_n, _ = waves.taylor_green(at_nc[:, 0], at_nc[:, 1], 0.0, k, 1.0)
        unit_nc = np.stack([u_n, w_n], axis=1)
        amplitude = float((unit_nc * v_nc).sum() / (unit_nc * unit_nc).sum())
        if np.abs(v_nc - amplitude * unit_nc).max() <= VORTICES * max(1.0, k * np.abs(at_nc).max()) * abs(amplitude):
            return True
    return False


def _channel(good: Good, model: Model, nu: float, steps: Sequence[int], times: Sequence[float]) -> ClosedRecord | None:
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
    """Return whether a force acts on all of some types."""
    return force.types is None or types <= set(force.types)


def deviation(of: ClosedRecord, series: SeriesRecord, at: int | None = None) -> float | None:
    """Return how far a run is from the closed solution at a step, its last by default; None if it is not there.

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
