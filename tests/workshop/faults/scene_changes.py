"""Changes of a scene, composed of a target (types, laws, options) and an operation (a factor, other values)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from eos_ref.eos.registry import PARAMETER
from lammps_cases.engine.session import Job
from lammps_cases.scene import PowerLaw, Scene
from lammps_cases.scene.settings import ShiftSettings
from tests.workshop.faults.fault import Fault

SceneChange = Callable[[Scene], Scene]
JobChange = Callable[[Job], Job]
Updates = dict[str, Any]  # keys of a part of a scene, with their new values
PartChange = Callable[[Any], Updates | None]  # None: the part is left out


@dataclass(frozen=True)
class InputFault(Fault):
    """A fault in LAMMPS' input: a change of the scene, or of the job made from it."""

    change_scene: SceneChange | None = None
    change_job: JobChange | None = None


# --- how


def times(name: str, factor: float) -> PartChange:
    """Multiply a value by a factor, where it is a number."""
    return lambda part: {name: v * factor} if isinstance(v := getattr(part, name), int | float) else {}


def plus(name: str, amount: float) -> PartChange:
    """Add to a value."""
    return lambda part: {name: getattr(part, name) + amount}


def put(**values: Any) -> PartChange:
    """Set values."""
    return lambda part: values


def put_if_unset(**values: Any) -> PartChange:
    """Set values that are 0 or not given."""
    return lambda part: {name: getattr(part, name) or value for name, value in values.items()}


def exchanged(one: str, other: str) -> PartChange:
    """Exchange two values."""
    return lambda part: {one: getattr(part, other), other: getattr(part, one)}


def as_style(style: str, **values: float) -> PartChange:
    """Give an equation of state another style."""
    return put(**{"style": style, **dict.fromkeys(PARAMETER.values()), **values})


def dropped(part: Any) -> None:
    """Leave a member out."""


def vector(change: Callable[[float], float]) -> PartChange:
    """Change the components of a force."""
    return lambda force: {"vector": tuple(None if v is None else change(v) for v in force.vector)}


# --- what


def altered(name: str, change: Callable[[Any], Any]) -> SceneChange:
    """Transform one part of a scene."""
    return lambda scene: scene.model_copy(update={name: change(getattr(scene, name))})


def updated(change: PartChange) -> Callable[[Any], Any]:
    """Change keys of a part, if present."""
    return lambda part: part and part.model_copy(update=change(part))


def each(change: PartChange) -> Callable[[Any], Any]:
    """Change every member of a part."""

    def change_members(members: Any) -> Any:
        changes = [(member, change(member)) for member in members]
        return tuple(member.model_copy(update=updates) for member, updates in changes if updates is not None)

    return change_members


def only(k: int, change: PartChange) -> Callable[[Any], Any]:
    """Change the member of index ``k``."""
    return lambda members: (*members[:k], updated(change)(members[k]), *members[k + 1 :])


def of_style(style: str, change: PartChange) -> PartChange:
    """Change members of one style only."""
    return lambda member: change(member) if member.style == style else {}


def types(change: PartChange) -> SceneChange:
    """Change every type."""
    return altered("types", each(change))


def rotated(name: str) -> SceneChange:
    """Give the values of the types each to the next type."""

    def rotate(types: Any) -> Any:
        return tuple(t.model_copy(update={name: getattr(types[k - 1], name)}) for k, t in enumerate(types))

    return altered("types", rotate)


def power(change: Callable[[PowerLaw], Any]) -> SceneChange:
    """Change power-law viscosities; a number in place of the law makes it constant."""

    def change_type(t: Any) -> Updates:
        if not isinstance(t.viscosity, PowerLaw):
            return {}
        new = change(t.viscosity)
        return {"viscosity": t.viscosity.model_copy(update=new) if isinstance(new, dict) else new}

    return types(change_type)


def laws(change: PartChange) -> SceneChange:
    """Change every entry of fix rheo/pressure."""
    return altered("pressure", lambda entries: each(change)(entries) or entries)


def entry(style: str, change: PartChange) -> SceneChange:
    """Change the entries of one style."""
    return laws(of_style(style, change))


def type_range(change: Callable[[str, str], tuple[str, str]]) -> SceneChange:
    """Change the ends of ranges m*n of types; a missing end is empty."""

    def change_law(law: Any) -> Updates:
        low, star, high = law.types.partition("*")
        return {"types": "*".join(change(low, high))} if star else {}

    return laws(change_law)


def option(name: str, change: PartChange) -> SceneChange:
    """Change options of one part: of fix rheo, of pair_style rheo, of the time steps."""
    return altered(name, updated(change))


rheo, pair, evolve = (partial(option, name) for name in ("rheo", "pair", "evolve"))


def kernel(old: str, new: str) -> SceneChange:
    """Replace one kernel by another."""
    return rheo(lambda r: {"kernel": new} if r.kernel == old else {})


def surface(change: PartChange) -> SceneChange:
    """Change settings of surface/detection, if on."""
    return rheo(lambda r: {"surface_detection": updated(change)(r.surface_detection)})


def cross_type(change: Callable[[float, float, float], tuple[float, ...]]) -> SceneChange:
    """Change the numbers of scale/cross/type."""

    def change_shift(r: Any) -> Updates:
        if r.shifting is None or r.shifting.scale_cross_type is None:
            return {}
        return {"shift": r.shifting.model_copy(update={"scale_cross_type": change(*r.shifting.scale_cross_type)})}

    return rheo(change_shift)


def excluding(*excluded: str) -> SceneChange:
    """Replace the types of exclude/type."""
    return rheo(lambda r: {"shift": ShiftSettings(exclude=excluded)} if r.shifting and r.shifting.exclude else {})


def cut(factor: float) -> SceneChange:
    """Multiply the kernel's cutoff by a factor."""

    def change_scene(scene: Scene) -> Scene:
        spacing = getattr(scene.positions, "spacing", None)
        length = scene.rheo.cut or (3.0 * spacing if spacing else None)
        return rheo(put(cut=length * factor))(scene) if length and scene.interacts else scene

    return change_scene


def force(style: str, change: PartChange) -> SceneChange:
    """Change the forces of one style."""
    return altered("forces", each(of_style(style, change)))
