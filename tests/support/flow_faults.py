"""Mistakes planted in flows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from lammps_cases.scene import Scene
from lammps_cases.studies.flows.flow import Start

Plant = Callable[[Start], Start]


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
