"""Changes of a scene, composed of what is changed (types, laws, options) and how (a factor, other values)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from pydantic import BaseModel

from eos_ref.eos.registry import PARAMETER
from lammps_cases.scene import AtomType, ForceSettings, PowerLaw, RheoSettings, Scene
from lammps_cases.scene.materials import LawSettings
from lammps_cases.scene.settings import Evolve, PairSettings, ShiftSettings, SurfaceDetectionSettings

SceneChange = Callable[[Scene], Scene]
Updates = dict[str, Any]  # keys of a part of a scene, with their new values
M = TypeVar("M", bound=BaseModel)

# --- how


def times(name: str, factor: float) -> Callable[[BaseModel], Updates]:
    """Multiply a value by a factor, where it is a number."""

    def update(part: BaseModel) -> Updates:
        value = getattr(part, name)
        return {name: value * factor} if isinstance(value, int | float) else {}

    return update


def put(**values: Any) -> Callable[[BaseModel], Updates]:
    """Set values, whatever they were."""
    return lambda part: values


def exchanged(one: str, other: str) -> Callable[[BaseModel], Updates]:
    """Exchange two values."""
    return lambda part: {one: getattr(part, other), other: getattr(part, one)}


def as_style(style: str, **values: float) -> Callable[[LawSettings], Updates]:
    """Make an equation of state one of another style."""
    return put(**{"style": style, **dict.fromkeys(PARAMETER.values()), **values})


def dropped(part: BaseModel) -> None:
    """Leave a member out."""


# --- what


def _each(members: Sequence[M], change: Callable[[M], Updates | None]) -> tuple[M, ...]:
    changes = [(member, change(member)) for member in members]
    return tuple(member.model_copy(update=updates) for member, updates in changes if updates is not None)


def types(change: Callable[[AtomType], Updates]) -> SceneChange:
    """Change every type."""
    return lambda scene: scene.model_copy(update={"types": _each(scene.types, change)})


def rotated(name: str) -> SceneChange:
    """Give the values of the types each to the next type."""

    def change_scene(scene: Scene) -> Scene:
        values = [getattr(t, name) for t in scene.types]
        rolled = zip(scene.types, [values[-1], *values[:-1]], strict=True)
        return scene.model_copy(update={"types": tuple(t.model_copy(update={name: v}) for t, v in rolled)})

    return change_scene


def power(change: Callable[[PowerLaw], Any]) -> SceneChange:
    """Change power-law viscosities; a number in place of the law makes it constant."""

    def of(t: AtomType) -> Updates:
        if not isinstance(t.viscosity, PowerLaw):
            return {}
        new = change(t.viscosity)
        return {"viscosity": t.viscosity.model_copy(update=new) if isinstance(new, dict) else new}

    return types(of)


def laws(change: Callable[[LawSettings], Updates | None]) -> SceneChange:
    """Change every entry of fix rheo/pressure."""
    return lambda scene: scene.model_copy(update={"pressure": _each(scene.pressure, change) or scene.pressure})


def entry(style: str, change: Callable[[LawSettings], Updates | None]) -> SceneChange:
    """Change the entries of one style."""
    return laws(lambda law: change(law) if law.style == style else {})


def entries(change: Callable[[tuple[LawSettings, ...]], tuple[LawSettings, ...]]) -> SceneChange:
    """Put the entries of fix rheo/pressure in another order, or keep some of them."""
    return lambda scene: scene.model_copy(update={"pressure": change(scene.pressure)})


def type_range(change: Callable[[str, str], tuple[str, str]]) -> SceneChange:
    """Give ranges m*n of types other ends, which are empty where there is none."""

    def of(law: LawSettings) -> Updates:
        low, star, high = law.types.partition("*")
        return {"types": "*".join(change(low, high))} if star else {}

    return laws(of)


def rheo(change: Callable[[RheoSettings], Updates]) -> SceneChange:
    """Change options of fix rheo."""
    return lambda scene: scene.model_copy(update={"rheo": scene.rheo.model_copy(update=change(scene.rheo))})


def kernel(old: str, new: str) -> SceneChange:
    """Take one kernel for another."""
    return rheo(lambda r: {"kernel": new} if r.kernel == old else {})


def surface(change: Callable[[SurfaceDetectionSettings], Updates]) -> SceneChange:
    """Change settings of surface/detection, where it is on."""

    def of(r: RheoSettings) -> Updates:
        settings = r.surface_detection
        return {} if settings is None else {"surface_detection": settings.model_copy(update=change(settings))}

    return rheo(of)


def cross_type(change: Callable[[float, float, float], tuple[float, float, float]]) -> SceneChange:
    """Change the numbers of scale/cross/type."""

    def of(r: RheoSettings) -> Updates:
        if r.shifting is None or r.shifting.scale_cross_type is None:
            return {}
        numbers = change(*r.shifting.scale_cross_type)
        return {"shift": r.shifting.model_copy(update={"scale_cross_type": numbers})}

    return rheo(of)


def excluding(*excluded: str) -> SceneChange:
    """Replace the types of exclude/type."""

    def of(r: RheoSettings) -> Updates:
        return {"shift": ShiftSettings(exclude=excluded)} if r.shifting and r.shifting.exclude else {}

    return rheo(of)


def cut(factor: float) -> SceneChange:
    """Multiply the kernel's cutoff by a factor."""

    def change_scene(scene: Scene) -> Scene:
        spacing = getattr(scene.positions, "spacing", None)
        length = scene.rheo.cut or (3.0 * spacing if spacing else None)
        return rheo(put(cut=length * factor))(scene) if length and scene.interacts else scene

    return change_scene


def pair(change: Callable[[PairSettings], Updates]) -> SceneChange:
    """Change options of pair_style rheo."""
    return lambda scene: scene.model_copy(update={"pair": scene.pair.model_copy(update=change(scene.pair))})


def force(style: str, change: Callable[[ForceSettings], Updates | None]) -> SceneChange:
    """Change the forces of one style."""
    return lambda scene: scene.model_copy(
        update={"forces": _each(scene.forces, lambda one: change(one) if one.style == style else {})}
    )


def vector(change: Callable[[float], float]) -> Callable[[ForceSettings], Updates]:
    """Change the components of a force."""
    return lambda one: {"vector": tuple(None if v is None else change(v) for v in one.vector)}


def evolve(change: Callable[[Evolve], Updates]) -> SceneChange:
    """Change the time steps, where there are any."""
    return lambda scene: scene.model_copy(
        update={"evolve": scene.evolve and scene.evolve.model_copy(update=change(scene.evolve))}
    )
