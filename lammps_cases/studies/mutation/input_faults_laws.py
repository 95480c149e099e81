"""Faults in LAMMPS' input: types and equations of state."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from eos_ref.eos.registry import PARAMETER
from lammps_cases.scene import AtomType, PowerLaw, Scene
from lammps_cases.scene.materials import LawSettings
from lammps_cases.studies.mutation.fault import Kind
from lammps_cases.studies.mutation.input_faults import InputFault, SceneChange

TINY = 1 + 1e-6


def types(change: Callable[[AtomType], dict[str, Any]]) -> SceneChange:
    """Every type with some keys changed."""

    def change_scene(scene: Scene) -> Scene:
        changed = tuple(t.model_copy(update=change(t)) for t in scene.types)
        return scene.model_copy(update={"types": changed})

    return change_scene


def scaled(name: str, factor: float) -> SceneChange:
    """A value of every type, where it is given, times a factor."""

    def change(t: AtomType) -> dict[str, Any]:
        value = getattr(t, name)
        return {} if value is None or isinstance(value, PowerLaw) else {name: value * factor}

    return types(change)


def dealt_on(name: str) -> SceneChange:
    """Values of the types, each given to the next type."""

    def change_scene(scene: Scene) -> Scene:
        values = [getattr(t, name) for t in scene.types]
        rolled = zip(scene.types, [values[-1], *values[:-1]], strict=True)
        return scene.model_copy(update={"types": tuple(t.model_copy(update={name: v}) for t, v in rolled)})

    return change_scene


def laws(change: Callable[[LawSettings], dict[str, Any] | None]) -> SceneChange:
    """Every entry of fix rheo/pressure with some keys changed; None drops it."""

    def change_scene(scene: Scene) -> Scene:
        changes = [(law, change(law)) for law in scene.pressure]
        kept = tuple(law.model_copy(update=new) for law, new in changes if new is not None)
        return scene.model_copy(update={"pressure": kept}) if kept else scene

    return change_scene


def entry(style: str, change: Callable[[LawSettings], dict[str, Any] | None]) -> SceneChange:
    """Entries of one style changed."""
    return laws(lambda law: change(law) if law.style == style else {})


def order(change: Callable[[tuple[LawSettings, ...]], tuple[LawSettings, ...]]) -> SceneChange:
    """Entries of fix rheo/pressure in another order, or some of them."""
    return lambda scene: scene.model_copy(update={"pressure": change(scene.pressure)})


def as_style(style: str, **values: float) -> Callable[[LawSettings], dict[str, Any]]:
    """An entry of another style."""
    blank = dict.fromkeys(PARAMETER.values())
    return lambda law: {"style": style, **blank, **values}


def _range(change: Callable[[str, str], tuple[str, str]]) -> SceneChange:
    """Ranges m*n with other ends; empty where there is none."""

    def of(law: LawSettings) -> dict[str, Any]:
        low, star, high = law.types.partition("*")
        return {"types": "*".join(change(low, high))} if star else {}

    return laws(of)


def _single(law: LawSettings) -> dict[str, Any]:
    return {"types": str(3 - int(law.types))} if law.types in ("1", "2") else {}


def _less(number: str) -> str:
    return str(int(number) - 1) if number and int(number) > 1 else number


def _all(law: LawSettings) -> LawSettings:
    return law.model_copy(update={"types": "*"})


def _fault(name: str, kind: Kind, what: str, change_scene: SceneChange) -> InputFault:
    return InputFault(f"told.{name}", kind, what, change_scene)


FAULTS = (
    # --- types
    _fault("cs-off", "constant", "speed of sound of every type times 1 + 1e-6", scaled("cs", TINY)),
    _fault("cs-doubled", "constant", "speed of sound of every type doubled", scaled("cs", 2)),
    _fault("cs-of-one", "constant", "speed of sound 1 for all types", types(lambda t: {"cs": 1.0 if t.cs else None})),
    _fault("cs-dropped", "missing term", "keyword speed/sound left out", types(lambda t: {"cs": None})),
    _fault(
        "cs-squared",
        "exponent",
        "square of the speed of sound given for it",
        types(lambda t: {"cs": None if t.cs is None else t.cs**2}),
    ),
    _fault("cs-exchanged", "exchanged", "speeds of sound of the types exchanged", dealt_on("cs")),
    _fault("rho0-off", "constant", "equilibrium density of every type times 1 + 1e-6", scaled("rho0", TINY)),
    _fault("rho0-halved", "constant", "equilibrium density of every type halved", scaled("rho0", 0.5)),
    _fault("rho0-dropped", "missing term", "keyword density left out", types(lambda t: {"rho0": None})),
    _fault("rho0-exchanged", "exchanged", "equilibrium densities of the types exchanged", dealt_on("rho0")),
    _fault(
        "rho0-and-cs-exchanged",
        "exchanged",
        "equilibrium density given as speed of sound and the reverse",
        types(lambda t: {"rho0": t.cs, "cs": t.rho0}),
    ),
    _fault("mass-off", "volume or mass", "mass of every type times 1 + 1e-6", scaled("mass", TINY)),
    _fault("mass-doubled", "volume or mass", "mass of every type doubled", scaled("mass", 2)),
    _fault("mass-of-one", "volume or mass", "mass 1 for all types", types(lambda t: {"mass": 1.0})),
    _fault("mass-exchanged", "exchanged", "masses of the types exchanged", dealt_on("mass")),
    # --- laws
    _fault(
        "gamma-off",
        "exponent",
        "exponent of tait/general times 1 + 1e-6",
        entry("tait/general", lambda law: {"gamma": (law.gamma or 0) * TINY}),
    ),
    _fault(
        "gamma-plus-one",
        "exponent",
        "exponent of tait/general larger by 1",
        entry("tait/general", lambda law: {"gamma": (law.gamma or 0) + 1.5}),
    ),
    _fault(
        "gamma-of-seven", "exponent", "exponent 7 for tait/general", entry("tait/general", lambda law: {"gamma": 7.0})
    ),
    _fault(
        "gamma-inverted",
        "exponent",
        "inverse of the exponent of tait/general",
        entry("tait/general", lambda law: {"gamma": 1 / (law.gamma or 1)}),
    ),
    _fault(
        "gas-gamma-off",
        "constant",
        "gamma of ideal/gas times 1 + 1e-6",
        entry("ideal/gas", lambda law: {"gamma": (law.gamma or 0) * TINY}),
    ),
    _fault(
        "gas-gamma-less-one",
        "missing term",
        "gamma - 1 given to ideal/gas for gamma",
        entry("ideal/gas", lambda law: {"gamma": (law.gamma or 0) - 1}),
    ),
    _fault("gas-as-linear", "option", "linear in place of ideal/gas", entry("ideal/gas", as_style("linear"))),
    _fault("A3-off", "constant", "A3 times 1 + 1e-6", entry("cubic", lambda law: {"A3": (law.A3 or 0) * TINY})),
    _fault("A3-sign", "sign", "A3 of the other sign", entry("cubic", lambda law: {"A3": -(law.A3 or 0)})),
    _fault("A3-zero", "missing term", "A3 of 0", entry("cubic", lambda law: {"A3": 0.0})),
    _fault("cubic-as-linear", "option", "linear in place of cubic", entry("cubic", as_style("linear"))),
    _fault("cubic-as-tait", "option", "tait/water in place of cubic", entry("cubic", as_style("tait/water"))),
    _fault("water-as-linear", "option", "linear in place of tait/water", entry("tait/water", as_style("linear"))),
    _fault(
        "water-of-7.15",
        "exponent",
        "tait/general with 7.15 in place of tait/water",
        entry("tait/water", as_style("tait/general", gamma=7.15)),
    ),
    _fault("general-as-water", "option", "tait/water for tait/general", entry("tait/general", as_style("tait/water"))),
    _fault("linear-as-water", "option", "tait/water in place of linear", entry("linear", as_style("tait/water"))),
    _fault("linear-as-cubic", "option", "cubic, A3 1e-3, for linear", entry("linear", as_style("cubic", A3=1e-3))),
    _fault(
        "P_b-off", "constant", "background times 1 + 1e-6", entry("background", lambda w: {"P_b": (w.P_b or 0) * TINY})
    ),
    _fault("P_b-sign", "sign", "background of the other sign", entry("background", lambda w: {"P_b": -(w.P_b or 0)})),
    _fault("P_b-twice", "constant", "background doubled", entry("background", lambda law: {"P_b": 2 * (law.P_b or 0)})),
    _fault("P_b-dropped", "missing term", "background left out", entry("background", lambda law: None)),
    _fault(
        "P_b-everywhere",
        "type range",
        "background of some types given to all",
        entry("background", lambda law: {"types": "*"}),
    ),
    # --- type ranges, entries
    _fault("range-ends-early", "type range", "m*(n-1) in place of m*n", _range(lambda m, n: (m, _less(n)))),
    _fault("range-ends-late", "type range", "m* in place of m*n", _range(lambda m, n: (m, ""))),
    _fault("range-begins-late", "type range", "(m+1)* in place of m*", _range(lambda m, n: (str(int(m or 1) + 1), n))),
    _fault("range-begins-early", "type range", "*n in place of m*n", _range(lambda m, n: ("", n))),
    _fault(
        "range-of-first", "type range", "m in place of m*n", laws(lambda w: {"types": w.types.partition("*")[0] or "1"})
    ),
    _fault("single-types-exchanged", "exchanged", "1 in place of 2 and the reverse in ranges", laws(_single)),
    _fault("entries-reversed", "exchanged", "entries of fix rheo/pressure in reverse", order(lambda e: e[::-1])),
    _fault("entries-rotated", "exchanged", "first entry of fix rheo/pressure last", order(lambda e: (*e[1:], e[0]))),
    _fault("last-entry-dropped", "missing term", "last entry left out", order(lambda e: e[:-1] or e)),
    _fault("first-entry-for-all", "type range", "first law for all types", order(lambda e: (_all(e[0]),))),
)
