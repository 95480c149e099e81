"""Rules for drawing keys whose values the schema alone does not determine: sizes, and what has to agree.

A place without a rule is drawn by its kind: a listed value, a number about 1, an object with some of its keys. What the
rules let pass and the models refuse is drawn again.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from eos_ref.eos.registry import LAWS, PARAMETER
from eos_ref.model.box import TILTED
from eos_ref.model.quantities import keyword_of
from eos_ref.model.units import UNITS
from lammps_cases.scene.fields import FIELDS
from lammps_cases.scene.runs import AS_TEXT, FOR_EACH_ATOM, LOSES_MASSES
from tests.workshop.fuzz import schema
from tests.workshop.fuzz.drawing import LEFT_OUT, Content, Drawing, Rule, rounded

# What several keys depend on, and how probable it is.
COMMON: Mapping[str, float] = {
    **{"3D": 0.4, "rho0": 0.85, "cs": 0.85, "types of about one mass": 0.3, "energy": 0.4, "rho_sum": 0.3},
    **{"particles one by one": 0.2, "velocities one by one": 0.5},
    **{"whole model": 0.9, "time steps": 0.8, "stops": 0.3},
}
CONSISTENT = tuple(name for name, units in UNITS.items() if units.consistent)
VOLUME = {"sq": 1.0, "hex": math.sqrt(0.75), "sc": 1.0, "bcc": 0.5, "fcc": 0.25}  # of a particle, in cells' edges
CELLS = {"sq": (3, 9), "hex": (3, 6), "sc": (2, 4), "bcc": (2, 3), "fcc": (2, 2)}
GRIDS = {2: [[2, 1, 1], [1, 2, 1]], 3: [[3, 1, 1]], 4: [[2, 2, 1], [1, 4, 1]]}  # how processes share a box
TO_BE_SET = 1.0  # time step, which follows from the scene when it is complete; see `tests.workshop.fuzz.fit`
RULES: dict[str, Rule] = {
    "dimension": lambda s, part: 3 if s.gives("3D") else 2,
    "types": lambda s, part: [s.object("types") for _ in range(s.choice([2, 1, 3, 2, 4, 2, 1, 3]))],
    "types.cs": lambda s, part: s.number(0.65, 1.5) if s.gives("cs") else LEFT_OUT,
    **dict.fromkeys(["types.viscosity", "types.viscosity.eta", "types.viscosity.gd0"], (1e-3, 0.3)),
    "types.viscosity.K": (1e-4, 0.1),
    "types.viscosity.n": lambda s, part: s.choice([1.0, 0.5, 2.0, s.number(0.3, 1.8)]),
    "types.conductivity": lambda s, part: s.number(1e-3, 0.2) if s.gives("energy") else LEFT_OUT,
    "types.specific_heat": lambda s, part: s.number(0.3, 3.0) if s.gives("energy") else LEFT_OUT,
    "types.latent_heat": lambda s, part: s.number(1e-3, 0.3) * s.coin(0.7) if s.gives("energy") else LEFT_OUT,
    "types.velocity": lambda s, part: s.vector(speed(s)),
    "positions": lambda s, part: s.object("positions", key="x" if s.gives("particles one by one") else "lattice"),
    "positions.lattice": lambda s, part: s.choice(["sc", "bcc", "fcc"] if s.d == 3 else ["sq", "hex"]),
    "positions.disorder": lambda s, part: s.between(0.02, 0.25 if s.coin(0.9) else 0.45),
    "positions.periodic": lambda s, part: [s.coin(0.6) for _ in range(s.d)],
    "positions.margin": (0.6, 4.0),
    "positions.types": lambda s, part: [s.whole(1, s.count) for _ in part["x"]],
    "positions.low": lambda s, part: [-s.number(0.5, 4.0) for _ in range(s.d)],
    "positions.high": lambda s, part: [rounded(max(x) + s.number(0.5, 4.0)) for x in zip(*part["x"], strict=True)],
    "velocity.random": lambda s, part: LEFT_OUT if one_by_one(s) else speed(s),
    "velocity.uniform": lambda s, part: LEFT_OUT if one_by_one(s) else s.vector(speed(s)),
    "rheo.rho_sum": lambda s, part: s.gives("rho_sum") or s.choice([False, LEFT_OUT]),
    "rheo.self_mass": lambda s, part: s.coin(0.15) if s.gives("rho_sum") else LEFT_OUT,  # most LAMMPS refuse it
    "rheo.interface_reconstruct": lambda s, part: s.coin(0.6 if solids(s) else 0.1),
    "rheo.cut": lambda s, part: LEFT_OUT if support(s) == 3.0 else support(s),
    # Thresholds that all, some or no particles reach.
    "rheo.zmin": lambda s, part: 0 if s.coin(0.4) else s.whole(1, int(1.2 * neighbours(s))),
    "rheo.surface_detection.splash": lambda s, part: s.whole(0, max(1, neighbours(s) // 2)),
    "pair.artificial_visc": (0.02, 1.0),
    "pair.rho_damp": (1e-3, 0.1),
    "evolve": lambda s, part: s.object("evolve") if s.gives("time steps") else LEFT_OUT,
    "evolve.steps": lambda s, part: s.choice([1, 2, 3, 6, 1, 12, 6, 2, 1]),
    "evolve.timestep": lambda s, part: TO_BE_SET,
    "evolve.compare_at": lambda s, part: [*s.some(range(part["steps"]), 0.4), part["steps"]],
    "evolve.stops.timestep": lambda s, part: TO_BE_SET if part.get("by") == "dt/reset" or s.coin(0.2) else LEFT_OUT,
    "evolve.stops.count": lambda s, part: s.choice([0, 7, 1000]),
    **{f"evolve.stops.displace.{axis}": lambda s, part: s.between(-0.05, 0.05) for axis in "xy"},
    "evolve.stops.displace.z": lambda s, part: s.between(-0.05, 0.05) if s.d == 3 else LEFT_OUT,
    **{f"evolve.stops.stretch.{axis}": lambda s, part: s.between(0.9, 1.1) for axis in "xy"},
    "evolve.stops.stretch.z": lambda s, part: s.between(0.9, 1.1) if s.d == 3 else LEFT_OUT,
    **dict.fromkeys(["engine.every", "twin.rebuild.every"], lambda s, part: s.choice([1, 2, 1, 3])),
    **dict.fromkeys(["engine.delay", "twin.rebuild.delay"], lambda s, part: part.get("every", 1) * s.whole(0, 3)),
    "engine.newton": lambda s, part: s.coin(0.3),
    "engine.skin": (0.05, 1.5),
    "engine.processors": lambda s, part: s.choice(GRIDS[part["ranks"]]) if part.get("ranks") in GRIDS else LEFT_OUT,
    # Tiled accepts no periodic box shorter than the cutoff.
    "engine.communication": lambda s, part: "tiled" if not any(around(s)) and s.coin(0.8) else "brick",
    "engine.balance": lambda s, part: s.whole(1, 3) if part.get("communication") == "tiled" else LEFT_OUT,
    "engine.time_limit": lambda s, part: 30.0,  # such scenes take milliseconds
    "twin.boost": lambda s, part: s.vector(3 * speed(s)),
    # Along axes that are not periodic a small one, which the margin has room for.
    "twin.translate": lambda s, part: [s.between(-4, 4) if around_c else s.between(0, 0.3) for around_c in around(s)],
    "twin.ranks": lambda s, part: s.choice([*GRIDS]),
    "twin.newton": lambda s, part: not s.part("engine").get("newton", True),
    "twin.tilt": lambda s, part: [s.whole(1, 2) * can for can in leaning(s)],
}
_NO_FILES = "a drawn scene has no other files; the same numbers are given one by one"
_REFUSED = "a scene that is to be refused; bad input has a table of its own (eos-ref stability)"
# Keys that are never drawn, each with the reason.
NEVER: Mapping[str, str] = {
    "engine.ghosts": "copies that no particle meets; what grows with them has cases of its own (edges-growth)",
    "manual": "set by the engine, not by a scene",
    "example": "three lines of each page, which the cases `examples` give as they stand",
    **dict.fromkeys(["violate", "expect"], _REFUSED),
    **{f"positions.{key}": _NO_FILES for key in ("extxyz", "data", "dump", "step", "columns")},
    **{f"{values}.table": _NO_FILES for values in ("mass", "rho", "energy")},
}
# Probability that an optional key is given; keys not listed here are in a third of the scenes.
_GIVEN = {
    0.0: " ".join(NEVER),
    0.15: "types.latent_heat evolve.every",
    0.2: "mass evolve.deform",
    0.25: "positions.tilt evolve.stops.count engine.communication",
    0.35: "rheo.surface_detection",
    0.45: "twin pair.rho_damp evolve.compare_at engine.skin",
    0.5: "positions.margin rheo.shift pair.artificial_visc engine.newton engine.time_limit "
    "twin.rebuild.every twin.rebuild.delay twin.rebuild.check",
    0.6: "positions.periodic forces forces.types",
    0.7: "types.conductivity types.specific_heat engine",
    0.8: "units types.viscosity rheo.interface_reconstruct pair",
    0.9: "rheo.kernel velocity evolve.stops.by positions.disorder velocity.random",
    1.0: "types.rho0 types.cs types.T_freeze positions.spacing positions.types rho energy velocity.values pressure.A3 "
    "pressure.gamma pressure.P_b rheo rheo.rho_sum rheo.self_mass rheo.cut evolve evolve.stops evolve.stops.timestep "
    "compare",
}
GIVEN = {place: probability for probability, places in _GIVEN.items() for place in places.split()}


def rule(place: str) -> Callable[[Rule], Rule]:
    """Make a function the rule of a place."""

    def kept(function: Rule) -> Rule:
        RULES[place] = function
        return function

    return kept


# --- what several keys depend on


def gives_rho0(s: Drawing) -> bool:
    """Return whether types have densities; with units of their own, as the default of 1 would be another number."""
    return s.content.get("units", "lj") not in CONSISTENT or s.gives("rho0")


def stops(s: Drawing) -> bool:
    """Return whether a run ends and another begins."""
    return s.gives("whole model") and s.gives("time steps") and s.gives("stops")


def speed(s: Drawing) -> float:
    """Return the size of the velocities."""
    return s.once("speed", lambda: s.number(1e-3, 0.2))


def support(s: Drawing) -> float:
    """Return the cutoff; 3 is the default."""
    share, widest = (0.3, 3.3) if s.d == 2 else (0.05, 2.4)
    return s.once("cut", lambda: 3.0 if s.coin(share) else s.between(1.4, widest))


def neighbours(s: Drawing) -> int:
    """Return the number of neighbours of a particle within a fluid, about."""
    return max(2, int(3.14 * support(s) ** 2 if s.d == 2 else 4.19 * support(s) ** 3))


def solids(s: Drawing) -> list[int]:
    """Return the solid types."""
    return [t for t, each in enumerate(s.content["types"], 1) if each.get("phase") == "solid"]


def one_by_one(s: Drawing) -> bool:
    """Return whether every particle has a velocity of its own."""
    return (
        "x" in s.part("positions")
        and not any("velocity" in t for t in s.part("types"))
        and s.gives("velocities one by one")
    )


def around(s: Drawing, positions: Content | None = None) -> list[bool]:
    """Return which axes are periodic."""
    given: list[bool] | None = (positions or s.part("positions")).get("periodic")
    return given or [True] * s.d


def leaning(s: Drawing, positions: Content | None = None) -> list[bool]:
    """Return which edges may lean: those of periodic axes, along periodic axes."""
    return [all(around(s, positions)[axis] for axis in axes) for axes in TILTED if max(axes) < s.d]


def edges(s: Drawing) -> list[float]:
    """Return the edges of the box, or lengths that they have at least."""
    places = s.part("positions")
    return places.get("cells") or [high - low for low, high in zip(places["low"], places["high"], strict=True)]


def walls(s: Drawing) -> bool:
    """Return whether densities of walls are reconstructed."""
    return bool(s.part("rheo").get("interface_reconstruct"))


def shifts(s: Drawing) -> bool:
    """Return whether particles are shifted."""
    return bool(s.part("rheo").get("shift", False) is not False)


# --- particles


@rule("units")
def units(s: Drawing, part: Content) -> str:
    """Return a system of units; one with units of its own for energies only for the whole model in 3D."""
    others = [name for name in schema.options("units") if name not in CONSISTENT]
    return s.choice(others if s.gives("whole model") and s.gives("3D") and s.coin(0.4) else CONSISTENT)


@rule("types.mass")
def mass(s: Drawing, part: Content) -> float:
    alike = s.gives("types of about one mass") or (s.gives("rho_sum") and not gives_rho0(s))
    return s.number(0.97, 1.03) if alike else s.number(0.6, 1.6)


@rule("types.rho0")
def rho0(s: Drawing, part: Content) -> Any:
    width = 1.15 if s.gives("rho_sum") else 1.6
    return rounded(part["mass"] * s.number(1 / width, width)) if gives_rho0(s) else LEFT_OUT


@rule("types.T_freeze")
def freezing(s: Drawing, part: Content) -> Any:
    given = s.gives("energy") and ("latent_heat" in part or s.coin(0.25))
    return rounded(s.number(0.4, 2.0) / part.get("specific_heat", 1.0)) if given else LEFT_OUT


@rule("positions.spacing")
def spacing(s: Drawing, part: Content) -> float:
    """A particle has the volume of a cube of one spacing, or that of its lattice's cell."""
    return 1.0 if "x" in part or s.coin(0.3) else rounded(VOLUME[part["lattice"]] ** (-1 / s.d))


@rule("positions.cells")
def cells(s: Drawing, part: Content) -> list[int]:
    style = part["lattice"]
    return [max(1, s.whole(*CELLS[style]) // (2 if style == "hex" and axis else 1)) for axis in range(s.d)]


@rule("positions.regions")
def regions(s: Drawing, part: Content) -> list[Content]:
    """Return a layer of a solid over a fluid, or blocks anywhere, some of them empty."""
    made: list[Content] = []
    fluids = [t for t in range(1, s.count + 1) if t not in solids(s)]
    if solids(s) and fluids and s.coin(0.7):
        low, sides = [0.0] * s.d, [1.0] * (s.d - 1)
        made = [{"type": s.choice(fluids), "low": low, "high": [*sides, 1.0]}]
        made += [{"type": s.choice(solids(s)), "low": low, "high": [*sides, s.between(0.2, 0.6)]}]
    for _ in range(s.whole(0, 2)):
        low = [s.between(0.0, 0.6) for _ in range(s.d)]
        high = [rounded(each + s.between(0.2, 0.5)) for each in low]
        made.append({"type": None if s.coin() else s.whole(1, s.count), "low": low, "high": high})
    return made


@rule("positions.tilt")
def tilt(s: Drawing, part: Content) -> Any:
    can = leaning(s, part)
    return [rounded(each * s.between(-4.0, 4.0)) for each in can] if any(can) and "lattice" in part else LEFT_OUT


@rule("positions.x")
def places(s: Drawing, part: Content) -> list[list[float]]:
    """Return few particles about the sites of a lattice: alone, in a row, in a plane or in any arrangement."""
    n = s.choice([12, 5, 12, 3, 5, 2, 1])
    row, per_axis = s.coin(0.25), math.ceil(n ** (1 / s.d))
    sites = itertools.product(range(n if row else per_axis), *[range(1 if row else per_axis)] * (s.d - 1))
    off = 0.0 if row else 0.25
    return [[rounded(a + 1.0 + s.between(-off, off), 6) for a in site] for site in itertools.islice(sites, n)]


def values(s: Drawing, own: Sequence[float], low: float, high: float, near: float, forms: Sequence[str]) -> Content:
    """Return values of particles about those of their types, in one of the forms; one for all if types are near."""
    of = [t - 1 for t in s.part("positions").get("types") or [1] * len(s.part("positions").get("x", ()))]
    form = s.choice(
        [*forms, "per_type", *["constant", "range"] * (max(own) <= near * min(own)), *["values"] * bool(of)]
    )
    if form == "offset":
        signs = {"sign": s.choice(["both", "+", "-"])} if s.coin(0.8) else {}
        return {form: {"low": s.number(1e-12, 1e-3), "high": s.number(1e-3, 0.1)} | signs}
    if form == "constant":
        return {form: rounded(own[0] * high, 6)}
    if form in ("per_type", "values"):
        return {form: [rounded(own[t] * s.between(low, high), 6) for t in (of if form == "values" else range(s.count))]}
    unit = (1.0, 1.0) if form == "ratio" else (min(own), max(own))
    ends = [rounded(unit[0] * low, 6), rounded(unit[1] * high, 6)]
    return {form: ends} | ({"spacing": s.choice(["linear", "log"])} if s.coin() else {})


@rule("mass")
def masses(s: Drawing, part: Content) -> Content:
    own = [each["mass"] for each in s.content["types"]]
    return values(s, own, s.between(0.7, 1.0), s.between(1.0, 1.3), 1.3, ["ratio", "offset"])


@rule("rho")
def densities(s: Drawing, part: Content) -> Any:
    """Return densities about those of equilibrium; mostly none if they are summed."""
    width, own = s.number(1e-5, 0.12), [each.get("rho0", 1.0) for each in s.content["types"]]
    if s.gives("rho_sum") and s.coin(0.8):
        return LEFT_OUT
    return values(s, own, 1 - width, 1 + width * s.share(), 1.06, ["ratio", "ratio", "offset"])


@rule("energy")
def energies(s: Drawing, part: Content) -> Any:
    """Return energies per mass; where they have a unit of their own they follow no density."""
    forms = ["range", "ratio", "offset"] if s.content.get("units", "lj") in CONSISTENT else ["range"]
    own = [s.number(0.4, 2.0)] * s.count
    return values(s, own, 0.6, 1.6, 1.0, forms) if s.gives("energy") else LEFT_OUT


@rule("velocity.values")
def velocities(s: Drawing, part: Content) -> Any:
    return [s.vector(speed(s)) for _ in s.part("positions")["x"]] if one_by_one(s) else LEFT_OUT


# --- equations of state, fix rheo, forces


@rule("pressure")
def pressure(s: Drawing, part: Content) -> list[Content]:
    """Return the laws of all types, one for all or one each, then entries that override them, and backgrounds."""
    ranges = ["*"] if s.coin() else [str(t) for t in range(1, s.count + 1)]
    entries = [s.object("pressure", {"types": types}) for types in ranges]
    entries += [s.object("pressure") for _ in range(s.choice([0, 0, 0, 1, 2]))]
    for _ in range(s.choice([0, 0, 0, 1, 2])):
        background = s.object("pressure", {"types": s.type_range(), "style": "background"})
        entries.insert(s.whole(1, len(entries)), background)
    return entries


@rule("pressure.style")
def law(s: Drawing, part: Content) -> str:
    styles = [style for style in schema.options("pressure.style") if style in LAWS]
    gases = [style for style in styles if LAWS[style].needs_energy]
    return s.choice([style for style in styles if style not in gases] + 2 * gases * s.gives("energy"))


@rule("pressure.gamma")
def gamma(s: Drawing, part: Content) -> Any:
    if part["style"] == "ideal/gas":
        return s.choice([1.4, 1.67, s.number(1.01, 3.0)])
    # With a negative exponent pressures have an upper limit, above which no density of a wall gives them.
    bounded = [] if solids(s) or any("T_freeze" in each for each in s.content["types"]) else [-1.5]
    free = s.number(0.3, 12.0)
    return s.choice([1.0, 2.0, 7.0, 0.5, *bounded, 1.4, free]) if PARAMETER.get(part["style"]) == "gamma" else LEFT_OUT


@rule("pressure.A3")
def cubic(s: Drawing, part: Content) -> Any:
    size = s.number(0.01, 1.0) * (1.0 if s.coin(0.7) else -0.1)
    return rounded(size) if PARAMETER.get(part["style"]) == "A3" else LEFT_OUT


@rule("pressure.P_b")
def background(s: Drawing, part: Content) -> Any:
    return s.between(-0.2, 0.2) if part["style"] == "background" else LEFT_OUT


@rule("rheo.surface_detection.limit")
def limit(s: Drawing, part: Content) -> float:
    """Return a limit that some particles are below."""
    if part["style"] == "coordination":
        return float(s.whole(1, int(1.2 * neighbours(s)) + 1))
    return s.between(0.4 * s.d, 1.1 * s.d)


@rule("rheo.shift.scale_cross_type")
def cross_type(s: Drawing, part: Content) -> list[float]:
    wmin = 0.0 if s.coin() else s.number(0.05, 1.5)
    return [s.choice([0.0, 1.0, s.between(0.0, 1.0)]), s.choice([0.0, s.between(0.01, 0.6)]), wmin]


@rule("forces")
def forces(s: Drawing, part: Content) -> Any:
    """Return forces in some order; solids are held in half of the scenes that have any."""
    drawn = [s.object("forces") for _ in range(s.whole(0, 3))]
    held = [{"style": "setforce", "types": str(t), "vector": [0.0] * s.d} for t in solids(s)]
    return drawn + held * s.coin() or LEFT_OUT


@rule("forces.vector")
def force(s: Drawing, part: Content) -> list[float | None]:
    """Return a vector that changes velocities by the speed of sound over some ten smoothing lengths."""
    components: list[float | None] = [*s.vector(0.04)]
    if part["style"] != "setforce":
        return components
    return [None if s.coin(0.3) else 0.0 if s.coin() else value for value in components]


# --- time steps


@rule("evolve.stops")
def halts(s: Drawing, part: Content) -> Any:
    if not stops(s):
        return LEFT_OUT
    return [
        s.object("evolve.stops", {"at": at}) for at in sorted({s.whole(0, part["steps"]) for _ in range(s.whole(1, 2))})
    ]


@rule("evolve.stops.by")
def route(s: Drawing, part: Content) -> str:
    """Return a route; none that LAMMPS' commands refuse: fixes that store values, forces other than 0."""
    given = s.part("positions")
    pushed = any(any(each["vector"]) for each in s.part("forces") if each["style"] == "setforce")
    # After clear, fix enforce2d leaves one particle less than no degrees of freedom.
    alone = s.d == 2 and (len(given["x"]) if "x" in given else math.prod(given["cells"])) == 1
    plain = not all("rho0" in of and "cs" in of for of in s.content["types"])
    refused = {"replicated": walls(s), "minimize": pushed, "restart": alone, "other scene": alone}
    refused |= {"by hand": "tilt" in given, "replaced": walls(s) or s.gives("rho_sum") or plain}
    refused |= dict.fromkeys(LOSES_MASSES, True) if "mass" in s.content else {}
    return s.choice([route for route in schema.options("evolve.stops.by") if not refused.get(route)])


def moves(s: Drawing, part: Content) -> bool:
    """Return whether particles may be displaced at a stop; data of walls and masses in a restart file prevent it."""
    kept = (walls(s) or "mass" in s.content) and part.get("by") in ("restart", "other scene")
    return not kept and part.get("by") != "continued"


@rule("evolve.stops.displace")
def displacement(s: Drawing, part: Content) -> Any:
    return s.object("evolve.stops.displace") if moves(s, part) else LEFT_OUT


@rule("evolve.stops.stretch")
def stretch(s: Drawing, part: Content) -> Any:
    upright = "tilt" not in s.part("positions") and part.get("by") != "by hand"
    return s.object("evolve.stops.stretch") if moves(s, part) and upright else LEFT_OUT


@rule("evolve.every")
def every(s: Drawing, part: Content) -> Any:
    again = any(stop.get("by") == "continued" for stop in part.get("stops", ()))
    one = part.get("compare_at", [part["steps"]]) == [part["steps"]]
    return s.whole(1, part["steps"]) if s.gives("whole model") and one and not again else LEFT_OUT


@rule("evolve.deform")
def deform(s: Drawing, part: Content) -> Any:
    """Return the shares by which the edges of a box grow and lean in all steps; rates follow with the time step.

    Not where the box leans so far that fix deform may lean it back by an edge: an edge without a rate then stays
    flipped, and does not continue as it was.
    """
    leans = zip(s.part("positions").get("tilt", ()), TILTED, strict=False)
    far = any(abs(lean) > 0.2 * edges(s)[one] for lean, (one, _) in leans)
    through = {word for stop in part.get("stops", ()) for word in (stop.get("by"), *stop)}
    if far or not s.gives("whole model") or "every" in part or through & {*AS_TEXT, "by hand", "continued", "stretch"}:
        return LEFT_OUT
    return s.object("evolve.deform", {"remap": s.choice(["x", "x", "none", *["v"] * (not shifts(s) and not stops(s))])})


def growing(axis: int) -> Rule:
    """Return the rule for the growth along an axis.

    If positions are not remapped, faces that are not periodic only move outwards. So do periodic ones if velocities are
    not remapped, too: a particle passed by such a face returns by the edge of the step at which LAMMPS detects it.
    """

    def share(s: Drawing, part: Content) -> Any:
        outwards = part["remap"] == "none" or (part["remap"] == "v" and not around(s)[axis])
        return s.between(0.0 if outwards else -0.08, 0.08)

    return lambda s, part: share(s, part) if axis < s.d else LEFT_OUT


def leaning_further(pair: int) -> Rule:
    """Return the rule for a tilt: by less than half an edge, as LAMMPS leans the box back."""

    def share(s: Drawing, part: Content) -> Any:
        (one, other), can = TILTED[pair], leaning(s)[pair : pair + 1]
        size = min(1.0, edges(s)[one] / edges(s)[other]) if any(can) else 0.0
        return rounded(s.between(-0.25, 0.25) * size) if any(can) and part["remap"] != "none" else LEFT_OUT

    return share


RULES |= {f"evolve.deform.{axis}": growing(k) for k, axis in enumerate("xyz")}
RULES |= {f"evolve.deform.{axes}": leaning_further(k) for k, axes in enumerate(("xy", "xz", "yz"))}


# --- comparisons


@rule("compare")
def compare(s: Drawing, part: Content) -> Any:
    """Return some of the fields that the scene has, few or all; or the pressure alone."""
    if not s.gives("whole model"):
        return ["pressure"] if s.coin() else LEFT_OUT
    crosses = s.part("evolve").get("deform", {}).get("remap") == "v"  # velocities depend on the image
    has = {"interface/reconstruct": walls(s), "shift": shifts(s), "thermal": s.gives("energy")}
    has |= {"surface/detection": "surface_detection" in s.part("rheo")}
    possible = [n for n in FIELDS if has.get(keyword_of(n) or "", True) and not (n == "press" and crosses)]
    fields = s.some(possible, s.choice([0.15, 0.4, 0.7, 1.0]))
    if "stress/t" in fields and "pressure" not in fields and s.coin(0.9):
        fields.append("pressure")  # without it most releases of LAMMPS crash
    if crosses and "v" in fields and "x" not in fields:
        fields.append("x")  # decides to which image the velocity belongs
    return [*fields, s.choice(["f", "rho", "grad/v", "x"])] if set(fields) <= {"pressure"} else fields


@rule("engine.ranks")
def ranks(s: Drawing, part: Content) -> int:
    alone = any(stop.get("by") in FOR_EACH_ATOM for stop in s.part("evolve").get("stops", ()))
    return s.choice([*GRIDS]) if not alone and s.coin(0.8) else 1


@rule("engine.boundary")
def boundary(s: Drawing, part: Content) -> str:
    """Return a style of faces; none that shrinks to nothing or whose volume matters, fixed ones if the box changes."""
    evolve, given = s.part("evolve"), s.part("positions")
    if "deform" in evolve or any("stretch" in stop for stop in evolve.get("stops", ())):
        return "f"
    extents = np.ptp(given["x"], axis=0) if "x" in given else [count - 1 for count in given["cells"]]
    # A box that shrinks to particles of one coordinate has no bins.
    flat = any(extent < 0.1 and not axis for extent, axis in zip(extents, around(s), strict=True))
    keeps = flat or {"virial", "press"}.intersection(s.part("compare"))
    return s.choice([style for style in schema.options("engine.boundary") if not (keeps and "s" in style)])


# --- twins


def exponents(s: Drawing) -> list[int]:
    """Return the denominators of the exponents of viscosities."""
    laws = (each.get("viscosity") for each in s.content["types"])
    return [Fraction(law["n"]).denominator for law in laws if isinstance(law, dict)]


def scalable(s: Drawing) -> bool:
    """Return whether all terms have a dimension: the repulsion of walls has one in 3D only, normals are softened."""
    softened = (walls(s) and s.d == 2) or "surface_detection" in s.part("rheo")
    return not softened and max(exponents(s), default=1) <= 2


def fixed_box(s: Drawing) -> bool:
    """Return whether the box stays as it is."""
    return "deform" not in s.part("evolve")


POSSIBLE: Mapping[str, Callable[[Drawing], bool]] = {
    "translate": lambda s: "tilt" not in s.part("positions") and fixed_box(s),
    "boost": lambda s: not shifts(s) and fixed_box(s) and "press" not in s.part("compare"),
    "rescale": scalable,
    "units": scalable,
    "split": lambda s: s.part("evolve").get("steps", 0) > 1 and "every" not in s.part("evolve"),
    "ranks": lambda s: s.part("engine").get("ranks", 1) == 1,
    "tilt": lambda s: any(leaning(s)) and fixed_box(s),
}


@rule("twin")
def twin(s: Drawing, part: Content) -> Any:
    """Return a second run of any kind that the scene allows."""
    if not s.gives("whole model") or stops(s):
        return LEFT_OUT
    keys = schema.object_at("twin")["properties"]
    kinds = [kind for kind in keys if POSSIBLE.get(kind, lambda s: True)(s)]
    kind = s.choice([*kinds, "rebuild", *["units"] * 8 * ("units" in kinds)])
    return {kind: s.value(schema.resolved(keys[kind]), f"twin.{kind}", {})}


@rule("twin.rescale")
def rescale(s: Drawing, part: Content) -> float:
    """Return a power of two that every power law can be scaled by exactly."""
    return float(2.0 ** (math.lcm(*exponents(s)) * s.choice([1, -1, 2, -3])))


@rule("twin.units")
def other_units(s: Drawing, part: Content) -> str:
    possible = [name for name in schema.options("units") if name in CONSISTENT or s.d == 3]
    return s.choice([name for name in possible if name != s.content.get("units", "lj")])


@rule("twin.skin")
def skin(s: Drawing, part: Content) -> float:
    """Return another skin, with which particles of a dense lattice list half of 2000 neighbours, LAMMPS' limit."""
    widest = np.inf if s.d == 2 else float(np.cbrt(1000 / (4 * 4.19)) - support(s))
    return rounded(min(s.part("engine").get("skin", 0.3) * s.number(1.3, 3.0), widest))
