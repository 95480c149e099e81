"""Scenes that are refused: the change of a good scene, and words of the message."""

from __future__ import annotations

from typing import Any

LINEAR = {"types": "*", "style": "linear"}
TWO = [{"mass": 1.3, "rho0": 1.2, "cs": 3.1}, {"mass": 0.4, "rho0": 0.7, "cs": 8.8}]
POSITIONS = {"lattice": "sq", "spacing": 0.8, "cells": [5, 4]}
GAS = [{"types": "*", "style": "ideal/gas", "gamma": 1.4}]


def tait(gamma: float) -> list[dict[str, Any]]:
    return [{"types": "*", "style": "tait/general", "gamma": gamma}]


BAD: dict[str, tuple[dict[str, Any], tuple[str, ...]]] = {
    "method of a scene": (
        {"method": "auto"},
        ("method is no key of a scene", 'EOS.pressure(rho, method="auto", tolerance=1e-9)', "eos-ref chart"),
    ),
    "tolerance of a scene": (
        {"tolerance": 1e-6},
        ("tolerance is no key of a scene", 'EOS.pressure(rho, method="auto", tolerance=1e-9)', "eos-ref chart"),
    ),
    "unknown key": ({"presure": [LINEAR]}, ("presure", "unknown key", "did you mean 'pressure")),
    "wrong type": ({"units": "furlong"}, ("units", "'lj'", "'furlong'")),
    "text for a number": ({"types": [{"mass": "heavy"}]}, ("types.0.mass", "number", "'heavy'")),
    "missing key": ({"positions": None}, ("positions", "required")),
    "missing type": (
        {"types": TWO, "pressure": [{"types": 1, "style": "linear"}]},
        ("atom type 2", "equation of state"),
    ),
    "missing style": ({"pressure": []}, ("atom type 1", "needs an equation of state")),
    "unknown style": (
        {"pressure": [{"types": "*", "style": "taitwater"}]},
        ("pressure.0.style", "'tait/general', 'ideal/gas' or 'background'", "'taitwater'"),
    ),
    "lattice of another dimension": (
        {"positions": POSITIONS | {"lattice": "fcc"}},
        ("cells needs 3 numbers for fcc, a lattice in 3D", "2"),
    ),
    "background alone": (
        {"pressure": [{"types": "*", "style": "background", "P_b": 1.0}]},
        ("atom type 1", "in addition to the background"),
    ),
    "range beyond": ({"pressure": [{"types": "*2", "style": "linear"}]}, ("type range", "1 to 1", "'*2'")),
    "range reversed": ({"types": TWO, "pressure": [{"types": "2*1", "style": "linear"}]}, ("reversed", "'2*1'")),
    "range of two stars": ({"pressure": [{"types": "**", "style": "linear"}]}, ("type range", "'**'")),
    "range with hyphen": ({"types": TWO, "pressure": [{"types": "1-2", "style": "linear"}]}, ("type range", "'1-2'")),
    "type zero": ({"pressure": [{"types": 0, "style": "linear"}]}, ("type range", "1 to 1", "'0'")),
    "gamma 0": ({"pressure": tait(0)}, ("gamma of tait/general", "must not be 0")),
    "gamma of a gas": (
        {"pressure": [{"types": "*", "style": "ideal/gas", "gamma": 1.0}], "energy": {"constant": 1.0}},
        ("gamma of ideal/gas", "exceed 1", "1.0"),
    ),
    "gamma NaN": ({"pressure": tait(float("nan"))}, ("pressure.0.gamma", "finite", "nan")),
    "A3 infinite": ({"pressure": [{"types": "*", "style": "cubic", "A3": float("inf")}]}, ("A3", "finite", "inf")),
    "background infinite": (
        {"pressure": [LINEAR, {"types": "*", "style": "background", "P_b": float("-inf")}]},
        ("P_b", "finite", "-inf"),
    ),
    "missing argument": ({"pressure": [{"types": "*", "style": "cubic"}]}, ("cubic needs A3",)),
    "argument too much": ({"pressure": [{**LINEAR, "gamma": 2.0}]}, ("linear does not take gamma",)),
    "rho0 zero": ({"types": [{"mass": 1.0, "rho0": 0.0, "cs": 1.0}]}, ("types.0.rho0", "greater than 0", "0.0")),
    "rho0 negative": ({"types": [{"mass": 1.0, "rho0": -1.0, "cs": 1.0}]}, ("types.0.rho0", "-1.0")),
    "cs zero": ({"types": [{"mass": 1.0, "rho0": 1.0, "cs": 0.0}]}, ("types.0.cs", "greater than 0", "0.0")),
    "rho0 for one of two": ({"types": [TWO[0], {"mass": 1.0}]}, ("rho0", "for every type or for none")),
    "mass zero": ({"types": [{"mass": 0.0}]}, ("types.0.mass", "greater than 0")),
    "negative density": ({"rho": {"range": [-0.5, 1.0]}}, ("rho", "tait/general of type 1", "found -0.", "atom ")),
    "overflow": ({"rho": {"constant": 3.0}, "pressure": tait(4000.0)}, ("rho", "overflows", "3.0", "atom 1")),
    "density missing": ({"rho": None}, ("rho", "must be given")),
    "gas without energy": ({"pressure": GAS}, ("energy", "ideal/gas needs")),
    "two ways to give a field": (
        {"rho": {"constant": 1.0, "range": [1.0, 2.0]}},
        ("rho", "exactly one", "constant, range"),
    ),
    "values of wrong length": ({"rho": {"values": [1.0, 1.1]}}, ("per-atom values", "(20)", "found 2")),
    "log through zero": ({"rho": {"range": [0.0, 1.0], "spacing": "log"}}, ("log spacing", "0.0")),
    "empty scene": ({"positions": {"lattice": "sq", "spacing": 1.0, "cells": [0, 3]}}, ("empty", "[0, 3]")),
    "lattice of wrong dimension": (
        {"positions": {"lattice": "fcc", "spacing": 1.0, "cells": [2, 2, 2]}},
        ("lattice fcc", "dimension 2"),
    ),
    "too many particles": (
        {"positions": {"lattice": "sq", "spacing": 1.0, "cells": [100000, 100000]}},
        ("at most", "10000000000"),
    ),
    "file outside": ({"positions": {"extxyz": "../../etc/passwd"}}, ("own folder", "etc/passwd")),
    "file missing": (
        {"positions": {"extxyz": "none.extxyz"}},
        ("extxyz", "cannot be read: No such file", "none.extxyz"),
    ),
    "table missing": (
        {"rho": {"table": {"csv": "none.csv", "column": "rho"}}},
        ("table", "cannot be read", "none.csv"),
    ),
    "raw commands": ({"commands": ["shell rm -rf ."]}, ("commands", "unknown key")),
    "true for a number": ({"types": [{"mass": True}]}, ("types.0.mass", "found true")),
    "quoted number": ({"rho": {"constant": "1.5"}}, ("rho.constant", "'1.5'")),
    "nothing to compare": ({"compare": []}, ("compare", "at least 1")),
    "expectation that fits any error": ({"expect": {"refused": "ERROR: "}}, ("expect.refused", "ERROR")),
    "time limit": ({"engine": {"time_limit": 1e9}}, ("engine.time_limit", "3600")),
    # the particle model
    "unknown field": ({"compare": ["presure"]}, ("compare.0", "'pressure'", "'presure'")),
    "field twice": ({"compare": ["f", "f"]}, ("compare", "each field once")),
    "chi without walls": ({"compare": ["chi"]}, ("chi needs rheo.interface_reconstruct",)),
    "surface without detection": ({"compare": ["surface/r"]}, ("surface/r needs rheo.surface_detection",)),
    "shift without shifting": (
        {"compare": ["shift/v"], "rheo": {"shift": False}},
        ("shift/v needs rheo.shift",),
    ),
    "temperature without energy": ({"compare": ["temperature"]}, ("temperature needs energy",)),
    "forces in real units of a plane": ({"units": "real", "compare": ["f"]}, ("units real", "need dimension 3")),
    "cut zero": ({"rheo": {"cut": 0}}, ("rheo.cut", "greater than 0", "0")),
    "cut negative": ({"rheo": {"cut": -2.4}}, ("rheo.cut", "-2.4")),
    "unknown kernel": ({"rheo": {"kernel": "RK3"}}, ("rheo.kernel", "'RK3'")),
    "zmin negative": ({"rheo": {"zmin": -1}}, ("rheo.zmin", "-1")),
    "self_mass alone": ({"rheo": {"self_mass": True}}, ("rheo", "self_mass", "rho_sum, which is off")),
    "shift by a word": ({"rheo": {"shift": "all"}}, ("rheo.shift", "true or false", "'all'")),
    "shift of unknown argument": (
        {"rheo": {"shift": {"excluded": 1}}},
        ("rheo.shift.excluded", "did you mean 'exclude"),
    ),
    "excluded type beyond": ({"rheo": {"shift": {"exclude": 2}}}, ("type range", "1 to 1", "'2'")),
    "fraction of a neighbour": (
        {"rheo": {"surface_detection": {"style": "coordination", "limit": 20.5, "splash": 4}}},
        ("rheo.surface_detection", "whole number", "20.5"),
    ),
    "surface by pressure": (
        {"rheo": {"surface_detection": {"style": "pressure", "limit": 1.5, "splash": 4}}},
        ("rheo.surface_detection.style", "'pressure'"),
    ),
    "viscosity negative": ({"types": [{"mass": 1.0, "viscosity": -0.1}]}, ("types.0.viscosity", "-0.1")),
    "viscosity by a word": ({"types": [{"mass": 1.0, "viscosity": "thick"}]}, ("types.0.viscosity", "'thick'")),
    "power law incomplete": (
        {"types": [{"mass": 1.0, "viscosity": {"eta": 0.1, "gd0": 0.2, "K": 0.1}}]},
        ("types.0.viscosity.n", "required"),
    ),
    "viscosity of the engine": ({"engine": {"viscosity": 0.1}}, ("engine.viscosity", "unknown key")),
    "artificial viscosity negative": ({"pair": {"artificial_visc": -1.0}}, ("pair.artificial_visc", "-1.0")),
    "cutoff of the pair style": ({"pair": {"cut": 2.0}}, ("pair.cut", "unknown key")),
    "thermal type without energy": ({"types": [{"mass": 1.0, "conductivity": 0.4}]}, ("conductivity", "need energy")),
    "latent heat without freezing": (
        {"types": [{"mass": 1.0, "latent_heat": 0.4}], "energy": {"constant": 1.0}},
        ("types.0", "latent_heat needs T_freeze"),
    ),
    "specific heat zero": ({"types": [{"mass": 1.0, "specific_heat": 0.0}]}, ("types.0.specific_heat", "0.0")),
    "unknown phase": ({"types": [{"mass": 1.0, "phase": "gas"}]}, ("types.0.phase", "'gas'")),
    "velocity of three components": (
        {"velocity": {"uniform": [1.0, 0.0, 0.0]}},
        ("velocity.uniform", "2 components", "found 3"),
    ),
    "velocities of three components": (
        {"velocity": {"values": [[1.0, 0.0, 0.0]] * 20}},
        ("velocity.values", "2 components", "found 3"),
    ),
    "velocities of too few": ({"velocity": {"values": [[1.0, 0.0]]}}, ("velocity", "one value per particle", "1")),
    "velocities together with random": (
        {"velocity": {"values": [[1.0, 0.0]] * 20, "random": 0.1}},
        ("velocity", "neither random nor uniform"),
    ),
    "velocities together with that of a type": (
        {"velocity": {"values": [[1.0, 0.0]] * 20}, "types": [{"mass": 1.0, "velocity": [1.0, 0.0]}]},
        ("stands instead of the velocity of a type",),
    ),
    "list of particles of three components": (
        {"positions": {"x": [[0.5, 0.5, 0.5]], "low": [0.0, 0.0], "high": [1.0, 1.0]}},
        ("positions", "same number of components"),
    ),
    "list of particles in space": (
        {"positions": {"x": [[0.5, 0.5, 0.5]], "low": [0.0, 0.0, 0.0], "high": [1.0, 1.0, 1.0]}},
        ("positions need 2 components", "found 3"),
    ),
    "list of particles, box inside out": (
        {"positions": {"x": [[0.5, 0.5]], "low": [1.0, 0.0], "high": [0.0, 1.0]}},
        ("low < high",),
    ),
    "list of particles, types of two": (
        {"positions": {"x": [[0.5, 0.5]], "types": [1, 1], "low": [0.0, 0.0], "high": [1.0, 1.0]}},
        ("types needs one value per particle (1), found 2",),
    ),
    "list of particles, type beyond": (
        {"positions": {"x": [[0.5, 0.5]], "types": [2], "low": [0.0, 0.0], "high": [1.0, 1.0]}},
        ("type", "within 1 to 1", "2"),
    ),
    "list of particles, a lattice's key": (
        {"positions": {"x": [[0.5, 0.5]], "low": [0.0, 0.0], "high": [1.0, 1.0], "cells": [2, 2]}},
        ("positions.cells", "unknown key"),
    ),
    "velocity of a type": ({"types": [{"mass": 1.0, "velocity": [1.0]}]}, ("types.0.velocity", "at least 2")),
    "velocity in evolve": ({"evolve": {"steps": 1, "timestep": 0.1, "velocity": 1.0}}, ("evolve.velocity",)),
    "gravity left open": ({"forces": [{"style": "gravity", "vector": [0, None]}]}, ("forces.0", "every component")),
    "force of three components": (
        {"forces": [{"style": "addforce", "vector": [0, 0, 1]}]},
        ("vector of a force", "2 components", "found 3"),
    ),
    "force on no type": ({"forces": [{"style": "addforce", "vector": [0, 1], "types": "2*"}]}, ("type range", "'2*'")),
    "unknown force": ({"forces": [{"style": "spring", "vector": [0, 1]}]}, ("forces.0.style", "'spring'")),
    "steps out of order": (
        {"evolve": {"steps": 10, "timestep": 0.1, "compare_at": [0, 10, 1]}},
        ("evolve", "compare_at must increase", "[0, 10, 1]"),
    ),
    "steps beyond the end": (
        {"evolve": {"steps": 10, "timestep": 0.1, "compare_at": [0, 11]}},
        ("end with steps (10)", "[0, 11]"),
    ),
    "nothing to compare at": (
        {"evolve": {"steps": 2, "timestep": 0.1, "compare_at": []}},
        ("compare_at", "at least 1"),
    ),
    "time step zero": ({"evolve": {"steps": 2, "timestep": 0.0}}, ("evolve.timestep", "greater than 0")),
    "three ranks": ({"engine": {"ranks": 3}}, ("engine.ranks", "1 or 2", "3")),
    "delay between rebuilds": ({"engine": {"every": 2, "delay": 3}}, ("engine", "multiple of every", "3 and 2")),
    "region of a type beyond": (
        {"positions": {**POSITIONS, "regions": [{"type": 2, "low": [0, 0], "high": [1, 0.5]}]}},
        ("type of a region", "1 to 1", "found 2"),
    ),
    "region inside out": (
        {"positions": {**POSITIONS, "regions": [{"type": 1, "low": [0, 0.5], "high": [1, 0.5]}]}},
        ("positions", "low < high"),
    ),
    "region of three axes": (
        {"positions": {**POSITIONS, "regions": [{"type": 1, "low": [0, 0, 0], "high": [1, 1, 1]}]}},
        ("positions", "2 numbers for sq"),
    ),
    "region without type": (
        {"positions": {**POSITIONS, "regions": [{"low": [0, 0], "high": [1, 1]}]}},
        ("positions.regions.0.type", "required"),
    ),
    "everything removed": (
        {"positions": {**POSITIONS, "regions": [{"type": None, "low": [0, 0], "high": [1, 1]}]}},
        ("empty", "regions remove every particle"),
    ),
    "flags of three axes": ({"positions": {**POSITIONS, "periodic": [True, True, True]}}, ("periodic needs 2 flags",)),
    "outside of an open box": (
        {
            "positions": {**POSITIONS, "periodic": [False, True], "margin": 0.0, "disorder": 0.49},
            "compare": ["coordination"],
        },
        ("position", "must lie in the box", "atom "),
    ),
}
