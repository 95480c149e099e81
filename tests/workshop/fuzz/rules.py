"""Rules for drawing keys whose values the schema alone does not determine: magnitudes, and consistent combinations.

A key without a rule is drawn from the schema: a listed value, a number about 1, an object with some of its keys. A
rule returns the value, or `LEFT_OUT`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

from eos_ref.model.units import UNITS
from tests.workshop.fuzz import rules_compared, rules_particles
from tests.workshop.fuzz.chance import Chance, rounded
from tests.workshop.fuzz.scope import Content, Scope

LEFT_OUT: Final = rules_particles.LEFT_OUT
Rule = Callable[[Scope, Chance], Any]
CONSISTENT = tuple(name for name, units in UNITS.items() if units.consistent)
UNITS_OF_OWN = tuple(name for name in UNITS if name not in CONSISTENT)
FORMS = ("*", "n", "*n", "m*", "m*n")


def type_range(scope: Scope, chance: Chance) -> str | int:
    """Return a range of types in one of the forms of the manual; a single one as a number or as text."""
    low = chance.whole(1, scope.count)
    high = chance.whole(low, scope.count)
    form = chance.choice(FORMS)
    if form == "n" and chance.coin():
        return low
    return form.replace("m", str(low)).replace("n", str(low if form == "n" else high))


def units(scope: Scope, chance: Chance) -> str:
    """Return a system of units; real and metal, which have conversion factors, only for the whole model in 3D."""
    return chance.choice(UNITS_OF_OWN if scope.whole and scope.spatial and chance.coin(0.4) else CONSISTENT)


# --- equations of state


def pressure(scope: Scope, chance: Chance) -> list[Content]:
    """Return the laws of all types, one for all or one each, then entries that override them, and backgrounds."""
    n = scope.count
    own: list[str | int] = [str(t) for t in range(1, n + 1)]
    entries = [_law(scope, chance.at(k), types) for k, types in enumerate(["*"] if chance.coin() else own)]
    others = range(chance.weighted({0: 0.6, 1: 0.3, 2: 0.1}))
    entries += [_law(scope, chance.at(f"over {k}"), type_range(scope, chance)) for k in others]
    for k in range(chance.weighted({0: 0.65, 1: 0.25, 2: 0.1})):
        size = 0.2 * scope.density * scope.sound**2
        background = {"style": "background", "P_b": chance.at(f"background {k}").between(-size, size)}
        entries.insert(chance.whole(1, len(entries)), {"types": type_range(scope, chance), **background})
    return entries


def _law(scope: Scope, chance: Chance, types: str | int) -> Content:
    styles = ["linear", "cubic", "tait/water", "tait/general", *["ideal/gas"] * (2 * scope.thermal)]
    style = chance.choice(styles)
    entry: Content = {"types": types, "style": style}
    if style == "cubic":
        size = chance.number(0.01, 3.0) / max(scope.rho0) ** 2
        entry["A3"] = rounded(size) if chance.coin(0.7) else rounded(-0.1 * size)
    elif style == "tait/general":
        solids = scope.solids or any("T_freeze" in each for each in scope.content["types"])
        # With a negative exponent pressures have an upper limit, above which no density of a wall gives them.
        bounded = [] if solids else [-1.5]
        entry["gamma"] = chance.choice([1.0, 2.0, 7.0, 0.5, *bounded, 1.4, chance.number(0.3, 12.0)])
    elif style == "ideal/gas":
        entry["gamma"] = chance.choice([1.4, 1.67, chance.number(1.01, 3.0)])
    return entry


# --- fix rheo


def zmin(scope: Scope, chance: Chance) -> int:
    """Return a threshold that all, some or no particles reach."""
    return 0 if chance.coin(0.4) else chance.whole(1, int(1.2 * scope.neighbours))


def surface_detection(scope: Scope, chance: Chance) -> Content:
    """Return limits of surfaces that some particles are below."""
    most = scope.neighbours
    splash = chance.whole(0, max(1, most // 2))
    if chance.coin():
        return {"style": "coordination", "limit": float(chance.whole(1, int(1.2 * most) + 1)), "splash": splash}
    return {"style": "divergence", "limit": chance.between(0.4 * scope.d, 1.1 * scope.d), "splash": splash}


def shift(scope: Scope, chance: Chance) -> Any:
    """Return on or off, or arguments: types that are not shifted, as one range or several, and a scale."""
    if chance.coin(0.5):
        return chance.coin(0.8)
    settings: Content = {}
    if chance.coin(0.6):
        single = chance.coin(0.7)
        ranges = [type_range(scope, chance.at(k)) for k in range(1 if single else chance.whole(1, 2))]
        settings["exclude"] = ranges[0] if single else ranges
    if chance.coin(0.6):
        weight = 0.5 * scope.spacing**-scope.d * (scope.spacing if chance.coin() else 1.0)
        wmin = 0.0 if chance.coin() else rounded(weight * chance.number(0.1, 3.0))
        keep = chance.choice([0.0, 1.0, chance.between(0.0, 1.0)])
        settings["scale_cross_type"] = [keep, chance.choice([0.0, chance.between(0.01, 0.6)]), wmin]
    return settings


def rho_damp(scope: Scope, chance: Chance) -> float:
    """Return a diffusivity."""
    return rounded(chance.number(1e-3, 0.1) * scope.sound * scope.h)


def cut(scope: Scope, chance: Chance) -> Any:
    """Return the cutoff of the scene."""
    return LEFT_OUT if scope.default_cut else rounded(scope.cut * scope.spacing)


def self_mass(scope: Scope, chance: Chance) -> Any:
    """Return the argument of rho_sum; rarely, as most releases of LAMMPS refuse it."""
    return chance.coin(0.15) if scope.sums else LEFT_OUT


# --- forces


def forces(scope: Scope, chance: Chance) -> Any:
    """Return forces in some order; solids are held in half of the scenes that have any."""
    drawn = [_force(scope, chance.at(k)) for k in range(chance.weighted({0: 0.3, 1: 0.3, 2: 0.25, 3: 0.15}))]
    if scope.solids and chance.coin():
        held = [{"style": "setforce", "types": str(t), "vector": [0.0] * scope.d} for t in scope.solids]
        drawn = [*drawn, *held]
    return drawn or LEFT_OUT


def _force(scope: Scope, chance: Chance) -> Content:
    style = chance.choice(["gravity", "addforce", "setforce"])
    mass = min(each["mass"] for each in scope.content["types"])
    vector: list[Any] = chance.vector(scope.d, scope.acceleration * (1.0 if style == "gravity" else mass))
    if style == "setforce":
        vector = [None if chance.coin(0.3) else 0.0 if chance.coin() else value for value in vector]
    force = {"style": style, "vector": vector}
    return force | ({"types": type_range(scope, chance)} if chance.coin(0.6) else {})


RULES: Mapping[str, Rule] = {
    **rules_particles.RULES,
    **rules_compared.RULES,
    "units": units,
    "pressure": pressure,
    "rheo.rho_sum": lambda scope, chance: scope.sums or chance.choice([False, LEFT_OUT]),
    "rheo.self_mass": self_mass,
    "rheo.interface_reconstruct": lambda scope, chance: chance.coin(0.6 if scope.solids else 0.1),
    "rheo.cut": cut,
    "rheo.zmin": zmin,
    "rheo.surface_detection": surface_detection,
    "rheo.shift": shift,
    "pair.artificial_visc": lambda scope, chance: 0.0 if chance.coin(0.1) else chance.number(0.02, 1.0),
    "pair.rho_damp": rho_damp,
    "forces": forces,
}

# Probability that an optional key is given; keys not listed here are in a third of the scenes.
GIVEN: Mapping[str, float] = {
    "units": 0.8,
    "mass": 0.2,
    "rho": 1.0,
    "energy": 1.0,
    "velocity": 0.9,
    "rheo": 1.0,
    "rheo.kernel": 0.9,
    "rheo.rho_sum": 1.0,
    "rheo.self_mass": 1.0,
    "rheo.interface_reconstruct": 0.8,
    "rheo.cut": 1.0,
    "rheo.surface_detection": 0.4,
    "rheo.shift": 0.5,
    "pair": 0.8,
    "pair.artificial_visc": 0.5,
    "pair.rho_damp": 0.4,
    "forces": 0.6,
    "evolve": 1.0,
    "compare": 1.0,
    "engine": 0.7,
    "twin": 0.45,
}

# Keys of objects that a rule draws as a whole; the keys that it does not set are drawn from the schema.
HANDLED: Mapping[str, frozenset[str]] = {
    "types": frozenset(
        [
            "mass",
            "rho0",
            "cs",
            "phase",
            "viscosity",
            "conductivity",
            "specific_heat",
            "latent_heat",
            "T_freeze",
            "velocity",
        ]
    ),
    "positions": frozenset(
        [
            "lattice",
            "spacing",
            "cells",
            "disorder",
            "regions",
            "periodic",
            "margin",
            "tilt",
            "extxyz",
            "data",
            "dump",
            "step",
            "columns",
            "x",
            "types",
            "low",
            "high",
        ]
    ),
    "pressure": frozenset(["types", "style", "A3", "gamma", "P_b"]),
    "forces": frozenset(["style", "vector", "types"]),
    "evolve": frozenset(["steps", "timestep", "compare_at", "stops", "every", "deform"]),
    "engine": frozenset(
        ["newton", "skin", "every", "delay", "check", "ranks", "time_limit", "processors", "communication", "balance"]
    ),
    "velocity": frozenset(["random", "uniform", "values"]),
    "rheo.surface_detection": frozenset(["style", "limit", "splash"]),
}

# Keys that are never drawn, each with the reason.
NEVER: Mapping[str, str] = {
    "engine.ghosts": "copies that no particle meets; what grows with them has cases of its own (edges-growth)",
    "manual": "set by the engine, not by a scene",
    "example": "three lines of each page, which the cases `examples` give as they stand",
    "violate": "a scene that is to be refused; bad input has a table of its own (eos-ref stability)",
    "expect": "a scene that is to be refused; bad input has a table of its own (eos-ref stability)",
    "positions.extxyz": "a drawn scene has no other files; the same numbers are given one by one",
    "positions.data": "a drawn scene has no other files; the same numbers are given one by one",
    "positions.dump": "a drawn scene has no other files; the same numbers are given one by one",
    "positions.step": "a drawn scene has no other files; the same numbers are given one by one",
    "positions.columns": "a drawn scene has no other files; the same numbers are given one by one",
    "mass.table": "a drawn scene has no other files; the same numbers are given one by one",
    "rho.table": "a drawn scene has no other files; the same numbers are given one by one",
    "energy.table": "a drawn scene has no other files; the same numbers are given one by one",
}
