"""Rules for drawing comparisons: time steps, fields, settings of LAMMPS, twins."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import Any, get_args

import numpy as np

from eos_ref.model.box import TILTED
from eos_ref.model.quantities import keyword_of
from eos_ref.model.units import UNITS
from lammps_cases.scene.fields import FIELDS
from lammps_cases.scene.runs import AS_TEXT, FOR_EACH_ATOM, LOSES_MASSES, ROUTES, Boundary
from tests.workshop.fuzz.chance import Chance, rounded
from tests.workshop.fuzz.rules_particles import LEFT_OUT, leaning
from tests.workshop.fuzz.scope import Content, Scope

SECONDS = 30.0  # that LAMMPS may take: a scene of some tens of particles and steps takes milliseconds
TO_BE_SET = 1.0  # time step, which follows from the scene when it is complete; see `tests.workshop.fuzz.fit`


def evolve(scope: Scope, chance: Chance) -> Any:
    """Return few time steps, rarely none, compared at some of them."""
    if not scope.evolves:
        return LEFT_OUT
    steps = chance.weighted({1: 0.3, 2: 0.2, 3: 0.15, 6: 0.2, 12: 0.15})
    content: Content = {"steps": steps, "timestep": TO_BE_SET}
    if scope.whole and chance.at("grows").coin(0.12) and not _leans_far(scope):
        content["deform"] = _deform(scope, chance.at("deform"))
    if scope.stops:
        content["stops"] = _stops(scope, chance.at("stops"), steps, "deform" in content)
        goes_on = any(stop.get("by") == "continued" for stop in content["stops"])
        if chance.coin(0.3) and "deform" not in content and not goes_on:
            return content | {"every": chance.whole(1, steps), "compare_at": [steps]}
    elif scope.whole and "deform" not in content and chance.coin(0.1):
        return content | {"every": chance.whole(1, steps), "compare_at": [steps]}
    if chance.coin(0.4):
        content["compare_at"] = [*chance.some(range(steps), 0.4), steps]
    return content


def _edges(scope: Scope) -> list[float]:
    """Return the edges of the box, or lengths that they have at least."""
    places = scope.content["positions"]
    if "cells" in places:
        return [scope.spacing * count for count in places["cells"]]
    return [high - low for low, high in zip(places["low"], places["high"], strict=True)]


def _leans_far(scope: Scope) -> bool:
    """Return whether the box leans so far that fix deform may lean it back by an edge.

    An edge without a rate then stays flipped, and does not continue as it was.
    """
    tilt, edges = scope.content["positions"].get("tilt", ()), _edges(scope)
    return any(abs(lean) > 0.2 * edges[one] for lean, (one, _) in zip(tilt, TILTED, strict=False))


def _deform(scope: Scope, chance: Chance) -> Content:
    """Return the shares by which the edges of a box grow and lean in all steps; rates follow with the time step.

    If positions are not remapped, faces that are not periodic only move outwards. So do periodic ones if velocities are
    not remapped, too: a particle passed by such a face returns by the edge of the step at which LAMMPS detects it.
    """
    periodic = scope.content["positions"].get("periodic") or [True] * scope.d
    shifts = scope.content["rheo"].get("shift", False) is not False
    remap = chance.choice(["x", "x", "none", *["v"] * (not shifts and not scope.stops)])
    stays = [remap == "none" or (remap == "v" and not around) for around in periodic]
    shares = [chance.between(0.0 if out else -0.08, 0.08) for out in stays]
    content: Content = {axis: share for axis, share in zip("xyz", shares, strict=False) if chance.coin(0.7)}
    edges = _edges(scope)
    for (one, other), can in zip(TILTED, leaning(scope, periodic), strict=False):
        pair = "xyz"[one] + "xyz"[other]
        if can and remap != "none" and chance.at(pair).coin(0.4):  # by less than half an edge: LAMMPS leans it back
            content[pair] = chance.at(pair).between(-0.25, 0.25) * min(1.0, edges[one] / edges[other])
    return content | ({"remap": remap} if remap != "x" or chance.coin() else {})


def _stops(scope: Scope, chance: Chance, steps: int, grows: bool) -> list[Content]:
    """Return one or two steps at which the state is written and read back."""
    at = sorted({chance.whole(0, steps) for _ in range(chance.whole(1, 2))})
    stops = [_stop(scope, chance.at(k), step, grows) for k, step in enumerate(at)]
    if any(stop.get("by") == "by hand" for stop in stops):  # it writes the box of the scene
        stops = [{key: value for key, value in stop.items() if key != "stretch"} for stop in stops]
    if any(stop.get("by") == "dt/reset" for stop in stops):  # LAMMPS then does not set the step count
        stops = [{key: value for key, value in stop.items() if key != "count"} for stop in stops]
    return stops


def _stop(scope: Scope, chance: Chance, at: int, grows: bool) -> Content:
    stop: Content = {"at": at}
    walls = scope.content["rheo"].get("interface_reconstruct", False)
    if chance.coin(0.9):
        refused = _refused(scope) | ({*AS_TEXT, "by hand", "continued"} if grows else set())
        stop["by"] = chance.choice([route for route in ROUTES if route not in refused])
    if chance.coin(0.2) or stop.get("by") == "dt/reset":
        stop["timestep"] = TO_BE_SET
    if chance.coin(0.25):
        stop["count"] = chance.choice([0, 7, 1000])
    kept = (walls or "mass" in scope.content) and stop.get("by") in ("restart", "other scene")
    if stop.get("by") == "continued":  # nothing is set up for
        return stop
    if kept:  # the data of walls and masses in a restart file prevent displace_atoms and change_box
        return stop
    if chance.coin(0.25):
        axes = "xy" if scope.planar else "xyz"
        moved = {axis: chance.between(-0.05, 0.05) * scope.spacing for axis in axes if chance.coin(0.7)}
        stop["displace"] = {axis: rounded(value) for axis, value in moved.items()}
        if chance.coin():
            stop["displace"]["types"] = str(chance.whole(1, scope.count))
    if chance.coin(0.2) and "tilt" not in scope.content["positions"] and not grows:
        stop["stretch"] = {axis: chance.between(0.9, 1.1) for axis in "xyz"[: scope.d] if chance.coin()}
    return stop


def _refused(scope: Scope) -> set[str]:
    """Return routes that LAMMPS' commands refuse (fixes that store values, forces other than 0) or no scene allows."""
    given = [each for each in scope.content.get("forces", ()) if each["style"] == "setforce"]
    kept = scope.content["rheo"].get("interface_reconstruct", False)
    pushed = any(any(each["vector"]) for each in given)
    # After clear, fix enforce2d leaves one particle less than no degrees of freedom.
    places = scope.content["positions"]
    alone = scope.planar and (len(places["x"]) if "x" in places else math.prod(places["cells"])) == 1
    plain = not all("rho0" in of and "cs" in of for of in scope.content["types"])
    made = kept or scope.content["rheo"].get("rho_sum", False)  # densities computed by an evaluation
    possible = {"replicated": kept, "minimize": pushed, "restart": alone, "other scene": alone}
    possible |= {"by hand": "tilt" in places, "replaced": made or plain}
    refused = {route for route, refuses in possible.items() if refuses}
    return refused | (set(LOSES_MASSES) if "mass" in scope.content else set())


def compare(scope: Scope, chance: Chance) -> Any:
    """Return some of the fields that the scene has, few or all; or the pressure alone."""
    if not scope.whole:
        return ["pressure"] if chance.coin() else LEFT_OUT
    fields = chance.some([name for name in FIELDS if _has(scope, name)], chance.choice([0.15, 0.4, 0.7, 1.0]))
    if "stress/t" in fields and "pressure" not in fields and chance.coin(0.9):
        fields.append("pressure")  # without it most releases of LAMMPS crash
    if _crosses(scope) and "v" in fields and "x" not in fields:
        fields.append("x")  # decides to which image the velocity belongs
    return [*fields, chance.choice(["f", "rho", "grad/v", "x"])] if set(fields) <= {"pressure"} else fields


def _has(scope: Scope, field: str) -> bool:
    rheo = scope.content.get("rheo", {})
    given = {
        "interface/reconstruct": rheo.get("interface_reconstruct", False),
        "shift": rheo.get("shift", False) is not False,
        "surface/detection": "surface_detection" in rheo,
        "thermal": scope.thermal,
    }
    if field == "press" and _crosses(scope):
        return False
    keyword = keyword_of(field)
    return keyword is None or not keyword or bool(given.get(keyword, True))


def _crosses(scope: Scope) -> bool:
    """Return whether particles that cross a boundary change their velocity."""
    return scope.content.get("evolve", {}).get("deform", {}).get("remap") == "v"  # type: ignore[no-any-return]


def _rebuild(chance: Chance) -> Content:
    every = chance.choice([1, 1, 2, 3])
    content: Content = {"every": every} if every > 1 or chance.coin() else {}
    content |= {"delay": every * chance.whole(0, 3)} if chance.coin(0.4) else {}
    return content | ({"check": chance.coin(0.4)} if chance.coin(0.7) else {})


def skin(scope: Scope, chance: Chance) -> float:
    """Return a skin of neighbour lists, in spacings."""
    return chance.number(0.05, 1.5)


def engine(scope: Scope, chance: Chance) -> Content:
    """Return settings without a documented effect on the results."""
    content = _rebuild(chance.at("rebuild")) if chance.coin(0.4) else {}
    if chance.coin(0.5):
        content["newton"] = chance.coin(0.3)
    if chance.coin(0.4):
        content["skin"] = skin(scope, chance)
    if chance.coin(0.3):
        alone = any(stop.get("by") in FOR_EACH_ATOM for stop in scope.content.get("evolve", {}).get("stops", ()))
        content["ranks"] = 2 if chance.coin(0.8) and not alone else 1
    if content.get("ranks") == 2 and chance.coin(0.4):
        content["processors"] = chance.choice([[2, 1, 1], [1, 2, 1]])
    if chance.coin(0.25):  # tiled accepts no periodic box shorter than the cutoff
        open_box = not any(scope.content["positions"].get("periodic", [True]))
        content["communication"] = "tiled" if open_box and chance.coin(0.8) else "brick"
        content |= {"balance": chance.whole(1, 3)} if content["communication"] == "tiled" and chance.coin() else {}
    return content | ({"time_limit": SECONDS} if chance.coin(0.5) else {})


def boundary(scope: Scope, chance: Chance) -> str:
    """Return a style of faces; none that shrinks to nothing or whose volume matters, fixed ones if the box changes."""
    evolves = scope.content.get("evolve", {})
    if "deform" in evolves or any("stretch" in stop for stop in evolves.get("stops", ())):
        return "f"
    volume = {"virial", "press"}.intersection(scope.content.get("compare", ()))
    styles: tuple[str, ...] = get_args(Boundary)
    return chance.choice([style for style in styles if not ((volume or _is_flat(scope)) and "s" in style)])


def _is_flat(scope: Scope) -> bool:
    """Return whether all particles may have one coordinate: a box that shrinks to them has no bins."""
    places = scope.content["positions"]
    periodic = places.get("periodic") or [True] * scope.d
    extents = np.ptp(places["x"], axis=0) if "x" in places else [count - 1 for count in places["cells"]]
    return any(extent < 0.1 * scope.spacing and not around for extent, around in zip(extents, periodic, strict=True))


def twin(scope: Scope, chance: Chance) -> Any:
    """Return a second run of any kind that the scene allows."""
    content = scope.content
    if not scope.whole or scope.stops:
        return LEFT_OUT
    own, evolves = content.get("engine", {}), content.get("evolve", {})
    shifts = content.get("rheo", {}).get("shift", False) is not False
    positions = content["positions"]
    kinds: dict[str, Callable[[], Any]] = {
        "relabel": lambda: True,
        "newton": lambda: not own.get("newton", True),
        "skin": lambda: rounded(min(own.get("skin", 0.3) * chance.number(1.3, 3.0), _widest_skin(scope))),
        "rebuild": lambda: _rebuild(chance),
    }
    grows = "deform" in evolves
    kinds |= {} if "tilt" in positions or grows else {"translate": lambda: _along_periodic(scope, chance)}
    if _can_be_rescaled(scope):
        kinds["rescale"] = lambda: _scale(scope, chance)
        possible = [name for name in UNITS if UNITS[name].consistent or not scope.planar]
        possible = [name for name in possible if name != content.get("units", "lj")]
        kinds["units"] = lambda: chance.choice(possible)
    if not shifts and not grows and "press" not in content.get("compare", ()):
        kinds["boost"] = lambda: chance.vector(scope.d, 3 * scope.speed)
    kinds |= {"split": lambda: True} if evolves.get("steps", 0) > 1 and "every" not in evolves else {}
    if not grows and any(
        edges := [can * chance.at("tilt").whole(1, 2) for can in leaning(scope, positions.get("periodic"))]
    ):
        kinds["tilt"] = lambda: edges
    kinds |= {"ranks": lambda: 2} if own.get("ranks", 1) == 1 else {}
    kind = chance.choice([*kinds, "rebuild", *["units"] * 3 * ("units" in kinds)])
    return {kind: kinds[kind]()}


def _widest_skin(scope: Scope) -> float:
    """Return the skin, in spacings, with which particles of a dense lattice list half of 2000, LAMMPS' limit."""
    return np.inf if scope.planar else float(np.cbrt(1000 / (4 * 4.19)) - scope.cut)


def _along_periodic(scope: Scope, chance: Chance) -> list[float]:
    """Return a displacement; along axes that are not periodic a small one, which the margin has room for."""
    periodic = scope.content["positions"].get("periodic") or [True] * scope.d
    size = scope.spacing
    return [chance.between(-4 * size, 4 * size) if around else chance.between(0, 0.3 * size) for around in periodic]


def _can_be_rescaled(scope: Scope) -> bool:
    """Return whether all terms have a dimension: the repulsion of walls has one in 3D only, normals are softened."""
    rheo = scope.content.get("rheo", {})
    walls, surfaces = rheo.get("interface_reconstruct", False), "surface_detection" in rheo
    laws = [each["viscosity"] for each in scope.content["types"] if isinstance(each.get("viscosity"), dict)]
    exact = all(Fraction(law["n"]).denominator <= 2 for law in laws)
    return exact and not (walls and scope.planar) and not surfaces


def _scale(scope: Scope, chance: Chance) -> float:
    """Return a power of two that every power law can be scaled by exactly."""
    laws = [each["viscosity"] for each in scope.content["types"] if isinstance(each.get("viscosity"), dict)]
    whole = math.lcm(*(Fraction(law["n"]).denominator for law in laws))
    return 2.0 ** (whole * chance.choice([-3, -1, 1, 2]))


RULES: Mapping[str, Callable[[Scope, Chance], Any]] = {
    "evolve": evolve,
    "compare": compare,
    "engine": engine,
    "engine.boundary": boundary,
    "twin": twin,
}
