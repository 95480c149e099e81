"""The numbers of a scene, one by one, and LAMMPS' job with another value of one of them.

They are the annotated ones of the scene, those of one particle, of walls and of the box, and thresholds that count.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lammps_cases.engine.session import Job
from lammps_cases.run.prepared_case import PreparedCase
from lammps_cases.scene.atoms import kernel_cut
from lammps_cases.scene.values import Path, changed
from lammps_cases.scene.values import numbers as annotated
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan
from tests.workshop.faults.scene_faults import SceneChange, at, put

PARTS = ("types", "pressure", "rheo", "pair", "forces", "evolve")
OF_LAWS = {"mass", "rho0", "cs"}  # of types, where no particles interact
OF_HEAT = {"conductivity", "specific_heat", "latent_heat", "T_freeze"}
CROSS_TYPE = ("shiftscale", "cmin", "wmin")
DECIDES = {"T_freeze", "cmin", "wmin"}


@dataclass(frozen=True)
class SceneNumber:
    """One number of a case.

    Attributes
    ----------
    parameter : what it is, the same for all cases
    place : where it occurs, as in ``type 2``
    job_with : the job with another value in its place, everything else as it was
    whole : whether it counts something
    decides : whether it is a threshold, so that a small change may have no effect
    """

    parameter: str
    place: str
    value: float
    job_with: Callable[[float], Job]
    whole: bool = False
    decides: bool = False


def numbers(ready: PreparedCase) -> list[SceneNumber]:
    """Return all nonzero numbers of a case, as zeros have no relative change; none for refusals and twins."""
    scene = ready.case.scene
    if scene.expect or scene.twin:
        return []
    candidates = [*_annotated(ready), *_of_atoms(ready), *(_others(ready) if scene.interacts else ())]
    return [n for n in candidates if n.value != 0 and np.isfinite(n.value)]


def _with(ready: PreparedCase, change: Callable[[float], SceneChange]) -> Callable[[float], Job]:
    """Return the jobs of another scene, with the particles of the given one."""
    scene, items = ready.case.scene, plan(ready.case.scene)
    return lambda value: job(change(value)(scene), ready.atoms, items)


def _annotated(ready: PreparedCase) -> Iterator[SceneNumber]:
    scene = ready.case.scene
    for path, value, _ in annotated(scene):
        part, key = path[0], str(path[-1])
        of_heat = key in OF_HEAT and not scene.thermal
        if part not in PARTS or path[:2] in (("rheo", "cut"), ("rheo", "surface_detection")) or "velocity" in path:
            continue
        if part == "types" and getattr(scene.types[int(path[1])], str(path[2])) is None:
            continue  # stands for 1
        if "stops" in path or of_heat or not (scene.interacts or part == "pressure" or key in OF_LAWS):
            continue
        parameter, place = _named(scene, path)
        jobs = _with(ready, lambda new, path=path: lambda s: changed(s, lambda p, old, _: new if p == path else old))
        yield SceneNumber(parameter, place, value, jobs, decides=parameter in DECIDES)


def _named(scene: Any, path: Path) -> tuple[str, str]:
    """Return what a number is, and where it occurs."""
    match path:
        case ("types", int(t), "viscosity", str(key)):
            return f"viscosity {key}", f"type {t + 1}"
        case ("types", int(t), str(key)):
            return key, f"type {t + 1}"
        case ("pressure", int(k), str(key)):
            law = scene.pressure[k]
            return key, f"entry {k + 1} ({law.types} {law.style})"
        case ("forces", int(k), "vector", int(axis)):
            return scene.forces[k].style, f"force {k + 1}, {'xyz'[axis]}"
        case ("rheo", "shift", "scale_cross_type", int(k)):
            return CROSS_TYPE[k], ""
        case ("evolve", "deform", str(key)):
            return f"deform {key}", ""
    return str(path[-1]), ""


def _others(ready: PreparedCase) -> Iterator[SceneNumber]:
    """Yield what is no number of the scene as it stands: the cutoff, which has a default, and thresholds."""
    scene, rheo = ready.case.scene, ready.case.scene.rheo

    def whole(place: str) -> Callable[[float], Job]:
        return _with(ready, lambda value: at(place, put(int(value))))

    cut = _with(ready, lambda value: at("rheo.cut", put(value)))
    yield SceneNumber("cut", "", kernel_cut(scene, ready.atoms.spacing), cut)
    if rheo.kernel.startswith("RK"):
        yield SceneNumber("zmin", "", rheo.zmin, whole("rheo.zmin"), whole=True)
    if detection := rheo.surface_detection:
        limit = _with(ready, lambda value: at("rheo.surface_detection.limit", put(value)))
        counts = detection.style == "coordination"
        yield SceneNumber(f"surface limit, {detection.style}", "", detection.limit, limit, counts, decides=True)
        yield SceneNumber("splash", "", detection.splash, whole("rheo.surface_detection.splash"), whole=True)


def _of_atoms(ready: PreparedCase) -> Iterator[SceneNumber]:
    """Yield numbers of one particle (the one in the middle of the list), of walls and of the box."""
    atoms, scene = ready.atoms, ready.case.scene
    k = len(atoms) // 2
    fields: dict[str, tuple[str, tuple[int, ...]]] = {
        "initial rho": ("rho_n", (k,)),
        "initial energy": ("energy_n", (k,)),
    }
    if scene.interacts:
        fields |= {"initial x": ("x_nc", (k, 0)), "initial velocity": ("v_nc", (k, 0))}
    for parameter, (name, where) in fields.items():
        if (array := getattr(atoms, name)) is not None:
            yield SceneNumber(parameter, f"atom {atoms.id_n[k]}", float(array[where]), _element(ready, name, where))
    for t, atom_type in enumerate(scene.types, 1):
        wall = scene.interacts and atom_type.phase == "solid"  # all its particles have this velocity
        for axis, value in enumerate((atom_type.velocity or ()) if wall else ()):
            jobs = _element(ready, "v_nc", (atoms.type_n == t, axis))
            yield SceneNumber("wall velocity", f"type {t}, {'xyz'[axis]}", value, jobs)
    if scene.interacts and atoms.periodic[0]:
        yield SceneNumber("box edge", "x", float(atoms.high_c[0]), _element(ready, "high_c", (0,)))


def _element(ready: PreparedCase, name: str, where: tuple[Any, ...]) -> Callable[[float], Job]:
    """Return the jobs of particles of which some elements of an array are others, in the given scene."""
    scene, items = ready.case.scene, plan(ready.case.scene)

    def job_with(value: float) -> Job:
        changed = getattr(ready.atoms, name).copy()
        changed[where] = value
        return job(scene, replace(ready.atoms, **{name: changed}), items)

    return job_with
