"""Faults in LAMMPS' input that a scene can express: values at a place of it, changed.

A place is a path of keys, ``rheo.surface_detection.limit``; lists are changed in every member, ``pressure[cubic].A3``
in those of a style. Every annotated number is changed in its last digits, those of types are exchanged, and options are
left out: a new key of a scene has these faults at once. The rest is a table.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, get_args

from eos_ref.eos.registry import PARAMETER
from lammps_cases.engine.session import Job
from lammps_cases.scene import Scene
from lammps_cases.scene.changes import Kind
from lammps_cases.scene.values import SceneModel
from tests.workshop.faults.fault import Fault

SceneChange = Callable[[Scene], Scene]
JobChange = Callable[[Job], Job]
Change = Callable[[Any], Any]  # of a value; updates of a part of the scene; None leaves a member of a list out
TINY = 1 + 1e-6


@dataclass(frozen=True)
class InputFault(Fault):
    """A fault in LAMMPS' input: a change of the scene, or of the job made from it."""

    change_scene: SceneChange | None = None
    change_job: JobChange | None = None


def at(place: str, change: Change) -> Callable[[Any], Any]:
    """Change the values at a place of a scene, or of a part of it."""
    first, _, rest = place.partition(".")
    name, _, style = first.rstrip("]").partition("[")

    def below(value: Any) -> Any:
        if rest:
            return at(rest, change)(value) if isinstance(value, SceneModel) else value
        new = change(value)
        return value.model_copy(update=new) if isinstance(new, dict) else new

    def changed(part: Any) -> Any:
        old = getattr(part, name)
        if not (isinstance(old, tuple) and (style or isinstance(next(iter(old), None), SceneModel))):
            return part.model_copy(update={name: below(old)})
        members = [below(each) if style in ("", getattr(each, "style", "")) else each for each in old]
        return part.model_copy(update={name: tuple(each for each in members if each is not None) or old})

    return changed


def times(factor: float) -> Change:
    """Multiply numbers, and the components of vectors; nothing else."""

    def change(value: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(map(change, value))
        return value * factor if isinstance(value, int | float) and not isinstance(value, bool) else value

    return change


def put(value: Any) -> Change:
    """Set a value."""
    return lambda old: value


def instead(old: Any, new: Any) -> Change:
    """Set a value in place of another."""
    return lambda value: new if value == old else value


def exchanged(one: str, other: str) -> Change:
    """Exchange two values of a part that has them."""
    return lambda part: {one: getattr(part, other), other: getattr(part, one)} if hasattr(part, one) else part


def as_style(style: str, **values: float) -> Change:
    """Give an equation of state another style."""
    return put({"style": style, **dict.fromkeys(PARAMETER.values()), **values})


def whole(key: str, change: Change) -> SceneChange:
    """Change a list as a whole."""
    return lambda scene: scene.model_copy(update={key: change(getattr(scene, key))})


def rotated(name: str) -> SceneChange:
    """Give the values of the types each to the next type."""
    return whole(
        "types",
        lambda types: tuple(t.model_copy(update={name: getattr(types[k - 1], name)}) for k, t in enumerate(types)),
    )


def ends(change: Callable[[str, str], tuple[str, str]]) -> SceneChange:
    """Change the ends of the ranges m*n of laws; a missing end is empty."""
    return at("pressure.types", lambda types: "*".join(change(*types.split("*"))) if "*" in types else types)


def cut(factor: float) -> SceneChange:
    """Multiply the kernel's cutoff by a factor."""

    def change_scene(scene: Scene) -> Scene:
        spacing = getattr(scene.positions, "spacing", None)
        length = scene.rheo.cut or (3.0 * spacing if spacing else None)
        return at("rheo.cut", put(length * factor))(scene) if length and scene.interacts else scene

    return change_scene


def _cross_type(change: Callable[[float, float, float], tuple[float, ...]]) -> SceneChange:
    return at("rheo.shift.scale_cross_type", lambda given: given and change(*given))


# --- of every annotated number, and every option

NAMES = {"viscosity": "eta", "conductivity": "kappa", "specific_heat": "cv", "latent_heat": "latent"}
NAMES |= {"artificial_visc": "artificial", "rho_damp": "damp", "interface_reconstruct": "interface"}
NAMES |= {"surface_detection": "surface", "rho_sum": "rho-sum", "vector": "force", "harmonic_means": "harmonic"}
KINDS: Mapping[str, Kind] = {"mass": "volume or mass", "gamma": "exponent", "n": "exponent"}
# Thresholds, which a small change of seldom decides anything; velocities and the cutoff, whose values others hold.
OF_THEIR_OWN = {"T_freeze", "limit", "scale_cross_type", "velocity", "cut"}
PARTS = ("types", "pressure", "rheo", "pair", "forces")


def numbers(model: type[SceneModel], above: str) -> Iterator[str]:
    """Yield the places of the numbers of a part of a scene, those of a law by its style."""
    for key, field in model.model_fields.items():
        if model.dim(key) is not None and key not in OF_THEIR_OWN:
            styles = [style for style, argument in PARAMETER.items() if argument == key]
            yield from [f"{above}[{style}].{key}" for style in styles] or [f"{above}.{key}"]
        for part in parts(field.annotation):
            yield from numbers(part, f"{above}.{key}")


def parts(annotation: Any) -> list[type[SceneModel]]:
    """Return the models of an annotation."""
    if isinstance(annotation, type) and issubclass(annotation, SceneModel):
        return [annotation]
    return [part for each in get_args(annotation) for part in parts(each)]


def _name(place: str) -> str:
    above, _, key = place.rpartition(".")
    if above.endswith("viscosity"):
        return f"power-{key}"
    return "gas-" * above.endswith("[ideal/gas]") + f"{NAMES.get(key, key)}-off"


def _derived() -> Iterator[tuple[str, Kind, str, SceneChange]]:
    for part in PARTS:
        (model,) = parts(Scene.model_fields[part].annotation)
        for place in numbers(model, part):
            key = place.rpartition(".")[2]
            yield _name(place), KINDS.get(key, "constant"), f"{place} times 1 + 1e-6", at(place, times(TINY))
            if part == "types" and place.count(".") == 1:
                yield f"{NAMES.get(key, key)}-exchanged", "exchanged", f"{key} of the types exchanged", rotated(key)
        for key, field in model.model_fields.items() if part in ("rheo", "pair") else ():
            if not field.is_required() and key not in ("kernel", "cut", "self_mass"):
                dropped = at(f"{part}.{key}", put(field.default))
                yield f"{NAMES.get(key, key)}-dropped", "missing term", f"{part}.{key} left out", dropped


# --- others

ALL, NO_FREEZING, SURFACE = {"types": "*"}, {"latent_heat": None, "T_freeze": None}, "rheo.surface_detection"
OTHER = {"coordination": {"style": "divergence", "limit": 1.5}, "divergence": {"style": "coordination", "limit": 20.0}}


def _lower(surface: Any) -> Any:
    lower = 0.9 * surface.limit if surface else 0.0
    return surface and {"limit": lower if surface.style == "divergence" else float(int(lower))}


def _longer(evolve: Any) -> Any:
    return evolve and {"steps": evolve.steps + 1, "compare_at": (*evolve.snapshots[:-1], evolve.steps + 1)}


_TABLE: tuple[tuple[str, Kind, str, SceneChange], ...] = (
    # --- types
    ("cs-doubled", "constant", "speed of sound of every type doubled", at("types.cs", times(2))),
    ("cs-of-one", "constant", "speed of sound 1 for all types", at("types.cs", lambda cs: cs and 1.0)),
    ("cs-dropped", "missing term", "keyword speed/sound left out", at("types.cs", put(None))),
    ("cs-squared", "exponent", "square of the speed of sound given for it", at("types.cs", lambda cs: cs and cs**2)),
    ("rho0-halved", "constant", "equilibrium density of every type halved", at("types.rho0", times(0.5))),
    ("rho0-dropped", "missing term", "keyword density left out", at("types.rho0", put(None))),
    ("rho0-and-cs-exchanged", "exchanged", "density given as speed of sound", at("types", exchanged("rho0", "cs"))),
    ("mass-doubled", "volume or mass", "mass of every type doubled", at("types.mass", times(2))),
    ("mass-of-one", "volume or mass", "mass 1 for all types", at("types.mass", put(1.0))),
    ("phase-fluid", "option", "solid types taken for fluid", at("types.phase", put("fluid"))),
    ("phase-exchanged", "exchanged", "phases of the types exchanged", rotated("phase")),
    # --- laws
    ("gamma-plus-one", "exponent", "exponent larger by 1.5", at("pressure[tait/general].gamma", lambda g: g + 1.5)),
    ("gamma-of-seven", "exponent", "exponent 7 for tait/general", at("pressure[tait/general].gamma", put(7.0))),
    ("gamma-inverted", "exponent", "inverse of the exponent", at("pressure[tait/general].gamma", lambda g: 1 / g)),
    ("gas-gamma-less-one", "missing term", "gamma - 1 for gamma", at("pressure[ideal/gas].gamma", lambda g: g - 1)),
    ("gas-as-linear", "option", "linear in place of ideal/gas", at("pressure[ideal/gas]", as_style("linear"))),
    ("A3-sign", "sign", "A3 of the other sign", at("pressure[cubic].A3", times(-1))),
    ("A3-zero", "missing term", "A3 of 0", at("pressure[cubic].A3", put(0.0))),
    ("cubic-as-linear", "option", "linear in place of cubic", at("pressure[cubic]", as_style("linear"))),
    ("cubic-as-tait", "option", "tait/water in place of cubic", at("pressure[cubic]", as_style("tait/water"))),
    ("water-as-linear", "option", "linear in place of tait/water", at("pressure[tait/water]", as_style("linear"))),
    ("water-of-7.15", "exponent", "7.15 for 7", at("pressure[tait/water]", as_style("tait/general", gamma=7.15))),
    ("general-as-water", "option", "tait/water for it", at("pressure[tait/general]", as_style("tait/water"))),
    ("linear-as-water", "option", "tait/water in place of linear", at("pressure[linear]", as_style("tait/water"))),
    ("linear-as-cubic", "option", "cubic, A3 1e-3, for linear", at("pressure[linear]", as_style("cubic", A3=1e-3))),
    ("P_b-sign", "sign", "background of the other sign", at("pressure[background].P_b", times(-1))),
    ("P_b-twice", "constant", "background doubled", at("pressure[background].P_b", times(2))),
    ("P_b-dropped", "missing term", "background left out", at("pressure[background]", put(None))),
    ("P_b-everywhere", "type range", "background of some types for all", at("pressure[background].types", put("*"))),
    # --- type ranges, entries
    ("range-ends-early", "type range", "m*(n-1) for m*n", ends(lambda m, n: (m, str(max(1, int(n) - 1)) if n else n))),
    ("range-ends-late", "type range", "m* in place of m*n", ends(lambda m, n: (m, ""))),
    ("range-begins-late", "type range", "(m+1)* in place of m*", ends(lambda m, n: (str(int(m or 1) + 1), n))),
    ("range-begins-early", "type range", "*n in place of m*n", ends(lambda m, n: ("", n))),
    ("range-of-first", "type range", "m in place of m*n", at("pressure.types", lambda of: of.partition("*")[0] or "1")),
    ("single-types-exchanged", "exchanged", "1 for 2", at("pressure.types", lambda t: {"1": "2", "2": "1"}.get(t, t))),
    ("entries-reversed", "exchanged", "entries of fix rheo/pressure in reverse", whole("pressure", lambda e: e[::-1])),
    ("entries-rotated", "exchanged", "first entry last", whole("pressure", lambda e: (*e[1:], e[0]))),
    ("last-entry-dropped", "missing term", "last entry left out", whole("pressure", lambda e: e[:-1] or e)),
    (
        "first-entry-for-all",
        "type range",
        "first law for all",
        whole("pressure", lambda e: (e[0].model_copy(update=ALL),)),
    ),
    # --- fix rheo
    ("cut-off", "constant", "cutoff times 1 + 1e-6", cut(TINY)),
    ("cut-larger", "constant", "cutoff 10 % larger", cut(1.1)),
    ("rk1-for-quintic", "option", "kernel RK1 in place of quintic", at("rheo.kernel", instead("quintic", "RK1"))),
    ("quintic-for-rk0", "option", "kernel quintic in place of RK0", at("rheo.kernel", instead("RK0", "quintic"))),
    ("quintic-for-rk1", "option", "kernel quintic in place of RK1", at("rheo.kernel", instead("RK1", "quintic"))),
    ("rk2-for-rk1", "option", "kernel RK2 in place of RK1", at("rheo.kernel", instead("RK1", "RK2"))),
    ("rk1-for-rk2", "option", "kernel RK1 in place of RK2", at("rheo.kernel", instead("RK2", "RK1"))),
    ("zmin-above-all", "neighbours", "zmin that no particle reaches", at("rheo.zmin", put(500))),
    ("zmin-larger", "neighbours", "zmin larger by 3", at("rheo.zmin", lambda zmin: zmin and zmin + 3)),
    ("rho-sum-added", "option", "rho/sum although densities are given", at("rheo.rho_sum", put(True))),
    ("interface-added", "option", "interface/reconstruct added", at("rheo.interface_reconstruct", put(True))),
    ("surface-style", "option", "the other style of surface/detection", at(SURFACE, lambda s: s and OTHER[s.style])),
    ("surface-limit", "constant", "limit of surface/detection 10 % lower", at(SURFACE, _lower)),
    ("surface-splash", "constant", "splash limit larger by 4", at("rheo.surface_detection.splash", lambda n: n + 4)),
    ("shift-added", "option", "shift added", at("rheo.shift", lambda shift: True if shift is False else shift)),
    ("exclude-dropped", "type range", "exclude/type left out", at("rheo.shift.exclude", put(()))),
    ("exclude-other", "type range", "exclude/type of type 1", at("rheo.shift.exclude", lambda of: of and ("1",))),
    ("exclude-all", "type range", "exclude/type of all types", at("rheo.shift.exclude", lambda of: of and ("*",))),
    ("shiftscale", "constant", "shiftscale larger by 0.1", _cross_type(lambda s, c, w: (s + 0.1, c, w))),
    ("shift-cmin", "constant", "cmin of scale/cross/type tripled", _cross_type(lambda s, c, w: (s, 3 * c, w))),
    ("shift-wmin", "constant", "wmin of scale/cross/type larger by 0.2", _cross_type(lambda s, c, w: (s, c, w + 0.2))),
    ("cross-type-dropped", "missing term", "scale/cross/type left out", at("rheo.shift.scale_cross_type", put(None))),
    # --- pair rheo, viscosity
    ("artificial-added", "option", "artificial viscosity 0.1", at("pair.artificial_visc", lambda value: value or 0.1)),
    ("damp-added", "option", "rho/damp 0.05 added", at("pair.rho_damp", lambda value: value or 0.05)),
    ("other-mean", "option", "harmonic for arithmetic means", at("pair.harmonic_means", lambda means: not means)),
    ("other-two-terms", "exchanged", "coefficients exchanged", at("pair", exchanged("artificial_visc", "rho_damp"))),
    ("eta-zero", "missing term", "constant viscosities 0", at("types.viscosity", times(0.0))),
    ("power-n-less-one", "exponent", "n - 1 given for n of power", at("types.viscosity.n", lambda n: n - 1)),
    ("power-K-and-eta", "exchanged", "K and eta of power exchanged", at("types.viscosity", exchanged("K", "eta"))),
    ("power-as-constant", "option", "constant for power", at("types.viscosity", lambda law: getattr(law, "eta", law))),
    # --- heat
    ("cv-and-kappa", "exchanged", "conductivity as heat", at("types", exchanged("specific_heat", "conductivity"))),
    ("latent-zero", "missing term", "latent heats 0", at("types.latent_heat", times(0.0))),
    ("freezing-off", "constant", "freezing temperatures 10 % higher", at("types.T_freeze", times(1.1))),
    ("freezing-of-zero", "constant", "freezing temperatures 0", at("types.T_freeze", times(0.0))),
    ("freezing-dropped", "missing term", "latent heat and freezing left out", at("types", put(NO_FREEZING))),
    # --- forces
    ("gravity-dropped", "missing term", "gravity left out", at("forces[gravity]", put(None))),
    ("gravity-sign", "sign", "gravity of the other sign", at("forces[gravity].vector", times(-1))),
    ("gravity-as-force", "volume or mass", "addforce of that vector", at("forces[gravity].style", put("addforce"))),
    ("addforce-dropped", "missing term", "addforce left out", at("forces[addforce]", put(None))),
    ("addforce-sign", "sign", "addforce of the other sign", at("forces[addforce].vector", times(-1))),
    ("addforce-as-gravity", "volume or mass", "gravity for addforce", at("forces[addforce].style", put("gravity"))),
    ("addforce-for-all", "type range", "addforce of some types on all", at("forces[addforce].types", put(None))),
    ("force-axes", "exchanged", "components of gravity exchanged", at("forces[gravity].vector", lambda v: v[::-1])),
    ("setforce-dropped", "missing term", "setforce left out", at("forces[setforce]", put(None))),
    ("setforce-other", "type range", "type 1 for 2", at("forces[setforce].types", lambda t: "1" if t == "2" else "2")),
    (
        "setforce-whole",
        "missing term",
        "all axes for one",
        at("forces[setforce].vector", lambda v: [f or 0.0 for f in v]),
    ),
    ("forces-reversed", "order of operations", "other forces in reverse", whole("forces", lambda f: f[::-1])),
    # --- time steps, the rest of a scene
    ("timestep-off", "constant", "time step times 1 + 1e-6", at("evolve.timestep", times(TINY))),
    ("timestep-halved", "constant", "time step halved", at("evolve.timestep", times(0.5))),
    ("one-step-more", "constant", "one step more at the end", at("evolve", _longer)),
    ("units-real", "units", "units real in place of lj", at("units", instead("lj", "real"))),
    ("units-metal", "units", "units metal in place of lj", at("units", instead("lj", "metal"))),
    ("refusal-not-asked", "option", "a refused scene without the broken rule", at("violate", put(None))),
)
FAULTS = tuple(InputFault(f"told.{name}", kind, what, change) for name, kind, what, change in (*_derived(), *_TABLE))
