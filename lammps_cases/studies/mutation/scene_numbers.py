"""The numbers of a scene, one by one, and LAMMPS' job with another value of one of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from eos_ref.eos.registry import PARAMETER
from lammps_cases.engine.session import Job
from lammps_cases.run.campaign import PreparedCase
from lammps_cases.scene import AtomType, PowerLaw, Scene
from lammps_cases.scene.atoms import Atoms, kernel_cut
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan

Put = Callable[[float], Job]


@dataclass(frozen=True)
class Number:
    """One number of a case.

    Attributes
    ----------
    parameter : what it is, the same for all cases
    place : which one of its kind, as in ``type 2``
    whole : whether it counts something
    decides : whether it is compared with something, so that a small change may do nothing
    job_with : the job with another value in its place, everything else as it was
    """

    parameter: str
    place: str
    value: float
    job_with: Put
    whole: bool = False
    decides: bool = False


DECIDES = ("T_freeze", "cmin", "wmin", "surface limit", "splash", "zmin", "gd0")


def numbers(ready: PreparedCase) -> list[Number]:
    """Return all numbers of a case but zeros, which have no relative change; none for refusals and twins."""
    scene = ready.case.scene
    if scene.expect or scene.twin:
        return []
    candidates = [*_of_types(ready), *_of_laws(ready), *_of_atoms(ready)]
    if scene.interacts:
        candidates += [*_of_model(ready), *_of_shift(ready), *_of_forces(ready)]
    return [n for n in candidates if n.value != 0 and np.isfinite(n.value)]


def _scene(ready: PreparedCase, alter: Callable[[float], Scene]) -> Put:
    """Return the jobs of another scene, with the particles of the given one."""
    items = plan(ready.case.scene)
    return lambda value: job(alter(value), ready.atoms, items)


def _atoms(ready: PreparedCase, alter: Callable[[float], Atoms]) -> Put:
    """Return the jobs of other particles, in the given scene."""
    items = plan(ready.case.scene)
    return lambda value: job(ready.case.scene, alter(value), items)


def _of_types(ready: PreparedCase) -> Iterator[Number]:
    scene = ready.case.scene
    names = ["mass", "rho0", "cs"]
    names += ["conductivity", "specific_heat", "latent_heat", "T_freeze"] if scene.thermal and scene.interacts else []
    for t, atom_type in enumerate(scene.types):
        place = f"type {t + 1}"
        for name in names:
            if (value := getattr(atom_type, name)) is not None:
                yield Number(name, place, value, _type(ready, t, _setter(name)), decides=name in DECIDES)
        law = atom_type.viscosity
        if isinstance(law, PowerLaw) and scene.interacts:
            for name in ("eta", "gd0", "K", "n"):
                yield Number(f"viscosity {name}", place, getattr(law, name), _type(ready, t, _term(law, name)))
        elif scene.interacts and not isinstance(law, PowerLaw):
            yield Number("viscosity", place, law, _type(ready, t, _setter("viscosity")))


def _setter(name: str) -> Callable[[float], dict[str, Any]]:
    return lambda value: {name: value}


def _term(law: PowerLaw, name: str) -> Callable[[float], dict[str, Any]]:
    return lambda value: {"viscosity": law.model_copy(update={name: value})}


def _type(ready: PreparedCase, t: int, change: Callable[[float], dict[str, Any]]) -> Put:
    scene = ready.case.scene

    def alter(value: float) -> Scene:
        types: list[AtomType] = list(scene.types)
        types[t] = types[t].model_copy(update=change(value))
        return scene.model_copy(update={"types": tuple(types)})

    return _scene(ready, alter)


def _of_laws(ready: PreparedCase) -> Iterator[Number]:
    laws = ready.case.scene.pressure
    for k, law in enumerate(laws):
        if (name := PARAMETER.get(law.style)) is not None:
            place = f"entry {k + 1} ({law.types} {law.style})"
            yield Number(name, place, getattr(law, name), _law(ready, k, name))


def _law(ready: PreparedCase, k: int, name: str) -> Put:
    scene = ready.case.scene

    def alter(value: float) -> Scene:
        laws = list(scene.pressure)
        laws[k] = laws[k].model_copy(update={name: value})
        return scene.model_copy(update={"pressure": tuple(laws)})

    return _scene(ready, alter)


def _part(ready: PreparedCase, part: str, change: Callable[[float], dict[str, Any]]) -> Put:
    """Return a number of the scene's part ``rheo``, ``pair`` or ``evolve``."""
    scene = ready.case.scene
    return _scene(
        ready, lambda value: scene.model_copy(update={part: getattr(scene, part).model_copy(update=change(value))})
    )


def _of_model(ready: PreparedCase) -> Iterator[Number]:
    scene, rheo = ready.case.scene, ready.case.scene.rheo
    yield Number("cut", "", kernel_cut(scene, ready.atoms.spacing), _part(ready, "rheo", _setter("cut")))
    if rheo.kernel.startswith("RK"):
        yield Number("zmin", "", rheo.zmin, _part(ready, "rheo", lambda z: {"zmin": int(z)}), whole=True)
    for name in ("artificial_visc", "rho_damp"):
        yield Number(name, "", getattr(scene.pair, name), _part(ready, "pair", _setter(name)))
    if scene.evolve:
        yield Number("timestep", "", scene.evolve.timestep, _part(ready, "evolve", _setter("timestep")))
    if surface := rheo.surface_detection:

        def detecting(name: str) -> Put:
            def change(value: float) -> dict[str, Any]:
                number = int(value) if name == "splash" else value
                return {"surface_detection": surface.model_copy(update={name: number})}

            return _part(ready, "rheo", change)

        whole = surface.style == "coordination"
        yield Number(f"surface limit, {surface.style}", "", surface.limit, detecting("limit"), whole, decides=True)
        yield Number("splash", "", surface.splash, detecting("splash"), whole=True)


def _of_shift(ready: PreparedCase) -> Iterator[Number]:
    shift = ready.case.scene.rheo.shifting
    if shift is None or shift.scale_cross_type is None:
        return
    given = shift.scale_cross_type

    def put(k: int) -> Put:
        def change(value: float) -> dict[str, Any]:
            numbers = (*given[:k], value, *given[k + 1 :])
            return {"shift": shift.model_copy(update={"scale_cross_type": numbers})}

        return _part(ready, "rheo", change)

    for k, name in enumerate(("shiftscale", "cmin", "wmin")):
        yield Number(name, "", given[k], put(k), decides=name in DECIDES)


def _of_forces(ready: PreparedCase) -> Iterator[Number]:
    scene = ready.case.scene

    def put(k: int, axis: int) -> Put:
        def alter(value: float) -> Scene:
            forces = list(scene.forces)
            vector = list(forces[k].vector)
            vector[axis] = value
            forces[k] = forces[k].model_copy(update={"vector": tuple(vector)})
            return scene.model_copy(update={"forces": tuple(forces)})

        return _scene(ready, alter)

    for k, force in enumerate(scene.forces):
        for axis, value in enumerate(force.vector):
            yield Number(force.style, f"force {k + 1}, {'xyz'[axis]}", value or 0.0, put(k, axis))


def _of_atoms(ready: PreparedCase) -> Iterator[Number]:
    """Of one particle, the one in the middle of the list; of a wall; of the box."""
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
            yield Number(parameter, place, float(array[where]), _atoms(ready, _element(atoms, name, where)))
    for t, atom_type in enumerate(scene.types, 1):
        wall = scene.interacts and atom_type.phase == "solid"  # all its particles have this velocity
        for axis, value in enumerate((atom_type.velocity or ()) if wall else ()):
            put = _atoms(ready, _element(atoms, "v_nc", (atoms.type_n == t, axis)))
            yield Number("wall velocity", f"type {t}, {'xyz'[axis]}", value, put)
    if scene.interacts and atoms.periodic[0]:
        yield Number("box edge", "x", float(atoms.high_c[0]), _atoms(ready, _element(atoms, "high_c", (0,))))


def _element(atoms: Atoms, name: str, where: tuple[Any, ...]) -> Callable[[float], Atoms]:
    def alter(value: float) -> Atoms:
        changed = getattr(atoms, name).copy()
        changed[where] = value
        return replace(atoms, **{name: changed})

    return alter
