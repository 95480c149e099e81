"""Rules for drawing particles: types, positions, densities, energies, velocities."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping
from typing import Any, Final

from eos_ref.model.box import TILTED
from tests.workshop.fuzz.chance import Chance, rounded
from tests.workshop.fuzz.scope import Content, Scope

LEFT_OUT: Final = object()
VOLUME = {"sq": 1.0, "hex": math.sqrt(0.75), "sc": 1.0, "bcc": 0.5, "fcc": 0.25}  # of a particle, in cells' edges
CELLS = {"sq": (3, 9), "hex": (3, 6), "sc": (2, 4), "bcc": (2, 3), "fcc": (2, 2)}


def types(scope: Scope, chance: Chance) -> list[Content]:
    """Return one to four types, equal or as different as possible."""
    alike = chance.coin(0.3)
    return [_type(scope, chance.at(t), alike) for t in range(chance.weighted({1: 0.25, 2: 0.4, 3: 0.2, 4: 0.15}))]


def _type(scope: Scope, chance: Chance, alike: bool) -> Content:
    def near(value: float, width: float) -> float:
        return rounded(value * chance.number(1 / width, width))

    own: Content = {}
    rho0 = near(scope.density, 1.05 if alike else 1.8) if scope.gives_rho0 else 1.0
    cs = near(scope.sound, 1.5) if scope.gives("cs") else 1.0
    filling = chance.number(0.85, 1.1) if scope.sums else chance.number(0.6, 1.6)
    own["mass"] = rounded(rho0 * scope.spacing**scope.d * filling)
    own |= {"rho0": rho0} if scope.gives_rho0 else {}
    own |= {"cs": cs} if scope.gives("cs") else {}
    if chance.coin(0.35):
        own["phase"] = "solid" if chance.coin(0.8) else "fluid"
    if chance.coin(0.8):
        own["viscosity"] = _viscosity(chance.at("viscosity"), rho0 * cs * scope.h, cs / scope.h)
    if scope.thermal:
        own |= _thermal(chance.at("thermal"), rho0 * cs * scope.h, cs**2)
    if chance.coin(0.3):
        own["velocity"] = chance.vector(scope.d, scope.speed)
    return own


def _viscosity(chance: Chance, size: float, rate: float) -> Any:
    eta = 0.0 if chance.coin(0.05) else rounded(size * chance.number(1e-3, 0.3))
    if chance.coin(0.6):
        return eta
    gd0, n = rounded(rate * chance.number(1e-3, 0.3)), chance.choice([1.0, 0.5, 2.0, chance.number(0.3, 1.8)])
    return {"eta": eta, "gd0": gd0, "K": rounded(chance.between(0.0, 1.5) * eta * gd0 ** (1 - n)), "n": n}


def _thermal(chance: Chance, size: float, energy: float) -> Content:
    cv = chance.number(0.3, 3.0)
    own: Content = {}
    if chance.coin(0.7):
        own["specific_heat"] = cv
    if chance.coin(0.7):
        heat = own.get("specific_heat", 1.0)
        own["conductivity"] = 0.0 if chance.coin(0.1) else rounded(size * heat * chance.number(1e-3, 0.2))
    if chance.coin(0.35):
        own["T_freeze"] = rounded(energy / own.get("specific_heat", 1.0) * chance.number(0.4, 2.0))
        if chance.coin(0.4):
            own["latent_heat"] = 0.0 if chance.coin(0.3) else rounded(energy * chance.number(1e-3, 0.3))
    return own


# --- places


def positions(scope: Scope, chance: Chance) -> Content:
    """Return particles on a lattice, or one by one."""
    if scope.listed:
        return _listed(scope, chance)
    content = _lattice(scope, chance)
    if any(can_lean := leaning(scope, content.get("periodic"))) and chance.coin(0.25):
        lean = chance.at("tilt")
        content["tilt"] = [rounded(can * lean.between(-4.0, 4.0) * scope.spacing) for can in can_lean]
    return content


def leaning(scope: Scope, periodic: list[bool] | None) -> list[bool]:
    """Return which edges may lean: those of periodic axes, along periodic axes."""
    around = periodic or [True] * scope.d
    return [around[one] and around[other] for one, other in TILTED if max(one, other) < scope.d]


def _periodic(scope: Scope, chance: Chance) -> list[bool] | None:
    return [chance.coin(0.6) for _ in range(scope.d)] if chance.coin(0.6) else None


def _lattice(scope: Scope, chance: Chance) -> Content:
    style = chance.choice(["sq", "hex"] if scope.planar else ["sc", "bcc", "fcc"])
    # A particle has the volume of a cube of one spacing, or that of its lattice's cell.
    edge = rounded(scope.spacing * (1.0 if chance.coin(0.3) else VOLUME[style] ** (-1 / scope.d)))
    content: Content = {"lattice": style, "spacing": edge}
    content["cells"] = [
        max(1, chance.whole(*CELLS[style]) // (2 if style == "hex" and axis else 1)) for axis in range(scope.d)
    ]
    if chance.coin(0.85):
        content["disorder"] = chance.between(0.02, 0.25) if chance.coin(0.9) else chance.between(0.25, 0.45)
    if chance.coin(0.5 if scope.solids else 0.3):
        content["regions"] = _regions(scope, chance.at("regions"))
    if periodic := _periodic(scope, chance):
        content["periodic"] = periodic
    if chance.coin(0.5):
        content["margin"] = chance.number(0.6, 4.0)
    return content


def _regions(scope: Scope, chance: Chance) -> list[Content]:
    """Return a layer of a solid over a fluid, or blocks anywhere, some of them empty."""
    regions: list[Content] = []
    fluids = [t for t in range(1, scope.count + 1) if t not in scope.solids]
    whole = {"low": [0.0] * scope.d, "high": [1.0] * scope.d}
    if scope.solids and fluids and chance.coin(0.7):
        layer = {"low": [0.0] * scope.d, "high": [*[1.0] * (scope.d - 1), chance.between(0.2, 0.6)]}
        regions = [{"type": chance.choice(fluids), **whole}, {"type": chance.choice(scope.solids), **layer}]
    for k in range(chance.weighted({0: 0.3, 1: 0.4, 2: 0.3})):
        block = chance.at(k)
        low = [block.between(0.0, 0.6) for _ in range(scope.d)]
        high = [rounded(each + block.between(0.2, 0.5)) for each in low]
        of = None if block.coin(0.5) else block.whole(1, scope.count)
        regions.append({"type": of, "low": low, "high": high})
    return regions


def _listed(scope: Scope, chance: Chance) -> Content:
    """Return few particles about the sites of a lattice: alone, in a row, in a plane or in any arrangement."""
    n = chance.weighted({1: 0.05, 2: 0.15, 3: 0.15, 5: 0.25, 12: 0.4})
    per_axis = math.ceil(n ** (1 / scope.d))
    flat = chance.choice([0.0, 1.0, 1.0, 1.0])  # in a row, exactly
    sites = itertools.product(range(n if not flat else per_axis), *[range(per_axis if flat else 1)] * (scope.d - 1))
    spacing = scope.spacing
    x = []
    for k, site in zip(range(n), sites, strict=False):
        jitter = [flat * chance.at(f"{k} {axis}").between(-0.25, 0.25) for axis in range(scope.d)]
        x.append([rounded((a + 1.0 + b) * spacing, 6) for a, b in zip(site, jitter, strict=True)])
    content: Content = {"x": x}
    if scope.count > 1 or chance.coin():
        content["types"] = [chance.whole(1, scope.count) for _ in x]
    low = [rounded(-chance.number(0.5, 4.0) * spacing) for _ in range(scope.d)]
    high = [rounded(max(each) + chance.number(0.5, 4.0) * spacing) for each in zip(*x, strict=True)]
    content |= {"low": low, "high": high, "spacing": spacing}
    if periodic := _periodic(scope, chance):
        content["periodic"] = periodic
    return content


# --- values of particles


def density(scope: Scope, chance: Chance) -> Any:
    """Return densities about those of equilibrium, in every form; mostly none if they are summed."""
    if scope.sums and chance.coin(0.8):
        return LEFT_OUT
    rho0, width = scope.rho0, chance.number(1e-5, 0.12)
    low, high = 1 - width, 1 + width * chance.share()
    alike = max(rho0) <= 1.06 * min(rho0)
    forms = ["ratio", "ratio", "offset", "per_type", *["constant", "range"] * alike, *["values"] * scope.listed]
    form = chance.choice(forms)
    if form == "offset":
        far = chance.number(1e-3, 0.1)
        spread = {"low": chance.number(1e-12, far), "high": far}
        return {"offset": spread | _sign(chance)}
    if form == "per_type":
        return {"per_type": [rounded(each * chance.between(low, high), 6) for each in rho0]}
    if form == "values":
        of = scope.content["positions"].get("types", [1] * scope.particles)
        return {"values": [rounded(rho0[t - 1] * (1 + chance.between(-width, width)), 6) for t in of]}
    if form == "constant":
        return {"constant": rounded(rho0[0] * high, 6)}
    ends = {"ratio": [rounded(low, 6), rounded(high, 6)]}
    if form == "range":
        ends = {"range": [rounded(min(rho0) * low, 6), rounded(max(rho0) * high, 6)]}
    return ends | ({"spacing": chance.choice(["linear", "log"])} if chance.coin(0.5) else {})


def mass(scope: Scope, chance: Chance) -> Content:
    """Return masses of particles about those of their types, in every form."""
    own = [each["mass"] for each in scope.content["types"]]
    low, high = chance.between(0.7, 1.0), chance.between(1.0, 1.3)
    alike = max(own) <= 1.3 * min(own)
    form = chance.choice(["ratio", "offset", "per_type", *["constant", "range"] * alike, *["values"] * scope.listed])
    if form == "offset":
        return {"offset": {"low": chance.number(1e-12, 1e-3), "high": chance.number(1e-3, 0.1)} | _sign(chance)}
    if form == "per_type":
        return {"per_type": [rounded(each * chance.between(low, high), 6) for each in own]}
    if form == "values":
        of = scope.content["positions"].get("types", [1] * scope.particles)
        return {"values": [rounded(own[t - 1] * chance.between(low, high), 6) for t in of]}
    if form == "constant":
        return {"constant": rounded(own[0] * high, 6)}
    unit = 1.0 if form == "ratio" else own[0]
    spacing = {"spacing": chance.choice(["linear", "log"])} if chance.coin(0.5) else {}
    return {form: [rounded(unit * low, 6), rounded(unit * high, 6)]} | spacing


def energy(scope: Scope, chance: Chance) -> Any:
    """Return positive energies per mass, in every form."""
    if not scope.thermal:
        return LEFT_OUT
    size = scope.sound**2 * chance.number(0.4, 2.0)
    forms = ["range", "range", "per_type", "constant", "ratio", "offset", "offset", *["values"] * scope.listed]
    form = chance.choice(forms[:4] if scope.own_units else forms)
    ends = [rounded(0.6 * size), rounded(1.6 * size)]
    spacing = {"spacing": chance.choice(["linear", "log"])} if chance.coin(0.5) else {}
    if form == "per_type":
        return {"per_type": [rounded(size * chance.number(0.5, 2.0)) for _ in range(scope.count)]}
    if form == "constant":
        return {"constant": rounded(size)}
    if form == "values":
        return {"values": [rounded(size * chance.number(0.5, 2.0)) for _ in range(scope.particles)]}
    if form == "ratio":
        return {"ratio": [rounded(each / scope.density) for each in ends]} | spacing
    if form == "offset":
        spread = {"low": chance.number(1e-6, 1e-3), "high": chance.number(1e-2, 0.5)}
        return {"offset": spread | _sign(chance)}
    return {"range": ends} | spacing


def _sign(chance: Chance) -> Content:
    return {"sign": chance.choice(["both", "+", "-"])} if chance.coin(0.8) else {}


def velocity(scope: Scope, chance: Chance) -> Content:
    """Return velocities below the speed of sound."""
    if scope.listed and chance.coin(0.5) and not any("velocity" in each for each in scope.content["types"]):
        return {"values": [chance.vector(scope.d, scope.speed) for _ in range(scope.particles)]}
    content: Content = {"random": rounded(scope.speed)} if chance.coin(0.85) else {}
    return content | ({"uniform": chance.vector(scope.d, scope.speed)} if chance.coin(0.3) else {})


RULES: Mapping[str, Callable[[Scope, Chance], Any]] = {
    "dimension": lambda scope, chance: 3 if scope.spatial else 2,
    "types": types,
    "positions": positions,
    "mass": mass,
    "rho": density,
    "energy": energy,
    "velocity": velocity,
}
