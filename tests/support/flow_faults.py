"""Mistakes planted in flows, and the order of convergence of the results."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from eos_ref.evaluation.time_step import Simulation
from lammps_cases.engine.session import Session
from lammps_cases.scene import Scene
from lammps_cases.setup import reference_side
from lammps_cases.studies.flows.flow import Flow, Start
from lammps_cases.studies.flows.solve import by_lammps, converge, fit

Plant = Callable[[Start], Start]
Law = Callable[[Any], Any]


def in_scene(change: Callable[[Scene], dict[str, Any]]) -> Plant:
    """A mistake in keys of the scene."""

    def planted(start: Start) -> Start:
        scene = start.case.scene
        return replace(start, case=replace(start.case, scene=scene.model_copy(update=change(scene))))

    return planted


def of_types(types: Sequence[int] = (), **factors: float) -> Plant:
    """Properties of some types (default: all) times factors."""

    def change(scene: Scene) -> dict[str, Any]:
        return {
            "types": tuple(
                t.model_copy(update={name: getattr(t, name) * factor for name, factor in factors.items()})
                if not types or k in types
                else t
                for k, t in enumerate(scene.types, 1)
            )
        }

    return in_scene(change)


def of_gravity(factor: float) -> Plant:
    """Gravity times a factor."""
    return in_scene(
        lambda scene: {
            "forces": tuple(
                f.model_copy(update={"vector": tuple(factor * v for v in f.vector)}) if f.style == "gravity" else f
                for f in scene.forces
            )
        }
    )


def of_gamma(gamma: float) -> Plant:
    """Another ratio of heat capacities."""
    return in_scene(lambda scene: {"pressure": tuple(p.model_copy(update={"gamma": gamma}) for p in scene.pressure)})


def of_energy(factor: float) -> Plant:
    """Energies times a factor."""

    def planted(start: Start) -> Start:
        assert start.atoms.energy_n is not None
        return replace(start, atoms=replace(start.atoms, energy_n=factor * start.atoms.energy_n))

    return planted


def faster(factor: float) -> Plant:
    """Initial velocities times a factor."""

    def planted(start: Start) -> Start:
        assert start.atoms.v_nc is not None
        return replace(start, atoms=replace(start.atoms, v_nc=factor * start.atoms.v_nc))

    return planted


def order(flow: Flow, resolutions: Sequence[int], plant: Plant | None = None, law: Law = np.ones_like) -> float:
    """Order at which the headline error, over a law of the resolution, falls on the reference."""
    if plant is not None:
        planted, begin = plant, flow.start
        flow = replace(flow, start=lambda n, options: planted(begin(n, options)))
    (found,) = converge(flow, engines=("reference",), resolutions=resolutions)
    errors_n = np.array(next(iter(found.errors.values())))
    return fit(resolutions, errors_n / law(np.array(resolutions, float))).order


def last_state(start: Start, stages: Any) -> dict[str, Any]:
    """Velocities and densities at the end, by stages of the reference or of a variant."""
    scene = start.case.scene
    model, box = reference_side.model(scene, start.atoms, ""), reference_side.box(scene, start.atoms)
    simulation = Simulation(model, box, reference_side.state(scene, start.atoms), (), stages)
    simulation.run(start.steps[-1], start.timestep)
    return {"v": simulation.output("v"), "rho": simulation.output("rho")}


def differences(flow: Flow, n: int, stages: Any, session: Session) -> tuple[float, float]:
    """Largest difference of LAMMPS' velocities from stages, over the largest velocity; of densities, relative."""
    start = flow.start(n, flow.options)
    found, ours = by_lammps(start, session).snapshots[-1], last_state(start, stages)
    v = np.abs(found.v_nc - ours["v"]).max() / np.abs(ours["v"]).max()
    return float(v), float(np.abs(found.rho_n / ours["rho"] - 1).max())
