"""What red scenes have in common and green ones lack, in the words of scenes."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lammps_cases.scene import Scene
from lammps_cases.scene.materials import PowerLaw
from lammps_cases.scene.particles import FromFile, Lattice

LONGEST = 3  # features that are named together
MANY = 60  # features combined; those that fewest green scenes have go first

_TESTS: dict[str, Callable[[Scene], bool]] = {
    "more than one type": lambda s: len(s.types) > 1,
    "more than two types": lambda s: len(s.types) > 2,
    "one type": lambda s: len(s.types) == 1,
    "types of different mass": lambda s: len({t.mass for t in s.types}) > 1,
    "types of different rho0": lambda s: len(set(s.rho0 or ())) > 1,
    "types of different speed of sound": lambda s: len(set(s.cs or ())) > 1,
    "types of different viscosity": lambda s: len({repr(t.viscosity) for t in s.types}) > 1,
    "laws of different styles": lambda s: len({law.style for law in s.pressure}) > 1,
    "solid particles": lambda s: any(t.phase == "solid" for t in s.types),
    "no solid particles": lambda s: all(t.phase == "fluid" for t in s.types),
    "moving solids": lambda s: any(t.phase == "solid" and any(t.velocity or ()) for t in s.types),
    "`interface_reconstruct`": lambda s: s.rheo.interface_reconstruct,
    "no `interface_reconstruct`": lambda s: not s.rheo.interface_reconstruct,
    "`rho_sum`": lambda s: s.rho_sum,
    "no `rho_sum`": lambda s: not s.rho_sum,
    "`self_mass`": lambda s: s.rheo.self_mass,
    "`rho_sum` without `self_mass`": lambda s: s.rho_sum and not s.rheo.self_mass,
    "`shift`": lambda s: s.rheo.shifting is not None,
    "no `shift`": lambda s: s.rheo.shifting is None,
    "`shift` with `exclude`": lambda s: bool(s.rheo.shifting and s.rheo.shifting.exclude),
    "`shift` with `scale_cross_type`": lambda s: bool(s.rheo.shifting and s.rheo.shifting.scale_cross_type),
    "`surface_detection`": lambda s: s.rheo.surface_detection is not None,
    "`surface_detection` by coordination": lambda s: _surface(s) == "coordination",
    "`surface_detection` by divergence": lambda s: _surface(s) == "divergence",
    "`zmin`": lambda s: s.rheo.zmin > 0,
    "`artificial_visc`": lambda s: s.pair.artificial_visc > 0,
    "no `artificial_visc`": lambda s: s.pair.artificial_visc == 0,
    "`rho_damp`": lambda s: s.pair.rho_damp > 0,
    "no `rho_damp`": lambda s: s.pair.rho_damp == 0,
    "`harmonic_means`": lambda s: s.pair.harmonic_means,
    "no `harmonic_means`": lambda s: not s.pair.harmonic_means,
    "particles with energy": lambda s: s.thermal,
    "no energy": lambda s: not s.thermal,
    "latent heat": lambda s: any(t.latent_heat for t in s.types),
    "a freezing temperature": lambda s: any(t.T_freeze is not None for t in s.types),
    "power-law viscosity": lambda s: any(isinstance(t.viscosity, PowerLaw) for t in s.types),
    "a background pressure": lambda s: any(law.entry.style == "background" or law.P_b for law in s.pressure),
    "external forces": lambda s: bool(s.forces),
    "time steps": lambda s: s.evolve is not None,
    "no time steps": lambda s: s.evolve is None,
    "more than one time step": lambda s: s.evolve is not None and s.evolve.steps > 1,
    "a twin": lambda s: s.twin is not None,
    "two ranks": lambda s: s.engine.ranks > 1 or bool(s.twin and s.twin.ranks),
    "newton off": lambda s: not s.engine.newton,
    "newton of bonds apart": lambda s: len(set(s.engine.newton_flags)) > 1,
    "particles from a file": lambda s: isinstance(s.positions, FromFile),
    "a face that is not periodic": lambda s: _open(s),
    "all axes periodic": lambda s: isinstance(s.positions, Lattice) and not _open(s),
    "disorder": lambda s: isinstance(s.positions, Lattice) and s.positions.disorder > 0,
    "velocities": lambda s: bool(s.velocity.random or any(s.velocity.uniform or ())),
    "a refusal that is expected": lambda s: s.expect is not None,
}


def _surface(scene: Scene) -> str:
    return scene.rheo.surface_detection.style if scene.rheo.surface_detection else ""


def _open(scene: Scene) -> bool:
    positions = scene.positions
    return isinstance(positions, Lattice) and positions.periodic is not None and not all(positions.periodic)


def features(scene: Scene) -> set[str]:
    """Return what can be said of a scene."""
    said = {name for name, test in _TESTS.items() if test(scene)}
    said |= {f"dimension {scene.dimension}", f"units {scene.units}", f"kernel {scene.rheo.kernel}"}
    if scene.rheo.kernel in ("RK1", "RK2"):
        said.add("a kernel that corrects gradients")
    said |= {f"law {law.style}" for law in scene.pressure}
    said |= {f"fix {force.style}" for force in scene.forces}
    if isinstance(scene.positions, Lattice):
        said.add(f"lattice {scene.positions.lattice}")
    if scene.twin:
        said.add(f"twin {scene.twin.kind}")
    if scene.whole_model:
        said |= {f"comparing `{name}`" for name in scene.compare}
    return said


@dataclass(frozen=True)
class Common:
    """Features that all red scenes have, and how many green ones have them all too."""

    features: tuple[str, ...]
    green: int


def in_common(red: Sequence[set[str]], green: Sequence[set[str]]) -> Common:
    """Return the fewest features that all red scenes have together and the fewest green ones.

    A combination is taken only if it leaves fewer green scenes than any shorter one.
    """
    order = {name: at for at, name in enumerate(_TESTS)}
    shared = sorted(set.intersection(*red)) if red else []
    table = {name: np.array([name in scene for scene in green], bool) for name in shared}
    # What fewest green scenes have tells most; among equals what is a property of the model before what is compared.
    ranked = sorted(shared, key=lambda name: (int(table[name].sum()), order.get(name, len(order)), name))[:MANY]
    best = Common((), len(green))
    for size in range(1, LONGEST + 1):
        for names in itertools.combinations(ranked, size):
            both: Any = np.logical_and.reduce([table[name] for name in names])
            left = int(both.sum())
            if left < best.green:
                best = Common(names, left)
        if best.green == 0:
            break
    return best
