"""The numbers of a scene, one by one, and LAMMPS' job with another value of one of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from eos_ref.eos.registry import PARAMETER
from lammps_cases.engine.session import Job
from lammps_cases.run.prepared_case import PreparedCase
from lammps_cases.scene import PowerLaw
from lammps_cases.scene.atoms import kernel_cut
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan
from tests.workshop.faults.scene_changes import (
    PartChange,
    SceneChange,
    altered,
    cross_type,
    only,
    option,
    put,
    surface,
)

Put = Callable[[float], Job]


@dataclass(frozen=True)
class SceneNumber:
    """One number of a case.

    Attributes
    ----------
    parameter : what it is, the same for all cases
    place : where it occurs, as in ``type 2``
    whole : whether it counts something
    decides : whether it is a threshold, so that a small change may have no effect
    job_with : the job with another value in its place, everything else as it was
    """

    parameter: str
    place: str
    value: float
    job_with: Put
    whole: bool = False
    decides: bool = False


DECIDES = ("T_freeze", "cmin", "wmin", "surface limit", "splash", "zmin", "gd0")


def numbers(ready: PreparedCase) -> list[SceneNumber]:
    """Return all nonzero numbers of a case, as zeros have no relative change; none for refusals and twins."""
    scene = ready.case.scene
    if scene.expect or scene.twin:
        return []
    candidates = [*_of_types(ready), *_of_laws(ready), *_of_atoms(ready)]
    if scene.interacts:
        candidates += [*_of_model(ready), *_of_shift(ready), *_of_forces(ready)]
    return [n for n in candidates if n.value != 0 and np.isfinite(n.value)]


def _scene(ready: PreparedCase, change: Callable[[float], SceneChange]) -> Put:
    """Return the jobs of another scene, with the particles of the given one."""
    scene, items = ready.case.scene, plan(ready.case.scene)
    return lambda value: job(change(value)(scene), ready.atoms, items)


def _member(ready: PreparedCase, part: str, k: int, change: Callable[[float], PartChange]) -> Put:
    """Return the jobs of scenes whose types, laws or forces differ in one member."""
    return _scene(ready, lambda value: altered(part, only(k, change(value))))


def _put(name: str) -> Callable[[float], PartChange]:
    return lambda value: put(**{name: value})


def _of_types(ready: PreparedCase) -> Iterator[SceneNumber]:
    scene = ready.case.scene
    names = ["mass", "rho0", "cs"]
    names += ["conductivity", "specific_heat", "latent_heat", "T_freeze"] if scene.thermal and scene.interacts else []
    for t, atom_type in enumerate(scene.types):
        place = f"type {t + 1}"
        for name in names:
            if (value := getattr(atom_type, name)) is not None:
                yield SceneNumber(name, place, value, _member(ready, "types", t, _put(name)), decides=name in DECIDES)
        law = atom_type.viscosity
        if isinstance(law, PowerLaw) and scene.interacts:
            for name in ("eta", "gd0", "K", "n"):
                jobs = _member(ready, "types", t, _power_term(law, name))
                yield SceneNumber(f"viscosity {name}", place, getattr(law, name), jobs)
        elif scene.interacts and not isinstance(law, PowerLaw):
            yield SceneNumber("viscosity", place, law, _member(ready, "types", t, _put("viscosity")))


def _power_term(law: PowerLaw, name: str) -> Callable[[float], PartChange]:
    return lambda value: put(viscosity=law.model_copy(update={name: value}))


def _of_laws(ready: PreparedCase) -> Iterator[SceneNumber]:
    for k, law in enumerate(ready.case.scene.pressure):
        if (name := PARAMETER.get(law.style)) is not None:
            place = f"entry {k + 1} ({law.types} {law.style})"
            yield SceneNumber(name, place, getattr(law, name), _member(ready, "pressure", k, _put(name)))


def _of_model(ready: PreparedCase) -> Iterator[SceneNumber]:
    scene, rheo = ready.case.scene, ready.case.scene.rheo

    def in_part(part: str, name: str) -> Put:
        return _scene(ready, lambda value: option(part, put(**{name: value})))

    yield SceneNumber("cut", "", kernel_cut(scene, ready.atoms.spacing), in_part("rheo", "cut"))
    if rheo.kernel.startswith("RK"):
        zmin = _scene(ready, lambda value: option("rheo", put(zmin=int(value))))
        yield SceneNumber("zmin", "", rheo.zmin, zmin, whole=True)
    for name in ("artificial_visc", "rho_damp"):
        yield SceneNumber(name, "", getattr(scene.pair, name), in_part("pair", name))
    if scene.evolve:
        yield SceneNumber("timestep", "", scene.evolve.timestep, in_part("evolve", "timestep"))
    if detection := rheo.surface_detection:
        limit = _scene(ready, lambda value: surface(put(limit=value)))
        splash = _scene(ready, lambda value: surface(put(splash=int(value))))
        whole = detection.style == "coordination"
        yield SceneNumber(f"surface limit, {detection.style}", "", detection.limit, limit, whole, decides=True)
        yield SceneNumber("splash", "", detection.splash, splash, whole=True)


def _of_shift(ready: PreparedCase) -> Iterator[SceneNumber]:
    shift = ready.case.scene.rheo.shifting
    if shift is None or shift.scale_cross_type is None:
        return

    def put_at(k: int) -> Put:
        return _scene(ready, lambda value: cross_type(lambda *numbers: (*numbers[:k], value, *numbers[k + 1 :])))

    for k, name in enumerate(("shiftscale", "cmin", "wmin")):
        yield SceneNumber(name, "", shift.scale_cross_type[k], put_at(k), decides=name in DECIDES)


def _of_forces(ready: PreparedCase) -> Iterator[SceneNumber]:
    for k, force in enumerate(ready.case.scene.forces):
        for axis, value in enumerate(force.vector):
            jobs = _member(ready, "forces", k, _component(force.vector, axis))
            yield SceneNumber(force.style, f"force {k + 1}, {'xyz'[axis]}", value or 0.0, jobs)


def _component(vector: tuple[float | None, ...], axis: int) -> Callable[[float], PartChange]:
    return lambda value: put(vector=(*vector[:axis], value, *vector[axis + 1 :]))


def _of_atoms(ready: PreparedCase) -> Iterator[SceneNumber]:
    """Yield numbers of one particle (the one in the middle of the list), of walls and of the box."""
    atoms, scene = ready.atoms, ready.case.scene
    k = len(atoms) // 2
    place = f"atom {atoms.id_n[k]}"
    fields: dict[str, tuple[str, tuple[int, ...]]] = {
        "initial rho": ("rho_n", (k,)),
        "initial energy": ("energy_n", (k,)),
    }
    if scene.interacts:
        fields |= {"initial x": ("x_nc", (k, 0)), "initial velocity": ("v_nc", (k, 0))}
    for parameter, (name, where) in fields.items():
        if (array := getattr(atoms, name)) is not None:
            yield SceneNumber(parameter, place, float(array[where]), _element(ready, name, where))
    for t, atom_type in enumerate(scene.types, 1):
        wall = scene.interacts and atom_type.phase == "solid"  # all its particles have this velocity
        for axis, value in enumerate((atom_type.velocity or ()) if wall else ()):
            put = _element(ready, "v_nc", (atoms.type_n == t, axis))
            yield SceneNumber("wall velocity", f"type {t}, {'xyz'[axis]}", value, put)
    if scene.interacts and atoms.periodic[0]:
        yield SceneNumber("box edge", "x", float(atoms.high_c[0]), _element(ready, "high_c", (0,)))


def _element(ready: PreparedCase, name: str, where: tuple[Any, ...]) -> Put:
    """Return the jobs of particles of which some elements of an array are others, in the given scene."""
    scene, items = ready.case.scene, plan(ready.case.scene)

    def job_with(value: float) -> Job:
        changed = getattr(ready.atoms, name).copy()
        changed[where] = value
        return job(scene, replace(ready.atoms, **{name: changed}), items)

    return job_with
