"""A scene drawn in consistent numbers, in the units of its system: real and metal measure energies otherwise."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from eos_ref.model.units import UNITS
from tests.workshop.fuzz.chance import rounded
from tests.workshop.fuzz.scope import Content

# Keys whose numbers have such a unit: the quantity that they are of, by `eos_ref.model.units`.
QUANTITIES: Mapping[str, str] = {
    "types.rho0": "rho",
    "types.viscosity": "viscosity",
    "types.viscosity.eta": "viscosity",
    "types.viscosity.K": "viscosity",
    "types.conductivity": "conductivity",
    "types.specific_heat": "cv",
    "types.latent_heat": "latent heat",
    "pressure.A3": "A3",
    "pressure.P_b": "pressure",
    "forces.vector": "f",
    **{f"rho.{form}": "rho" for form in ("constant", "per_type", "range", "values")},
    **{f"energy.{form}": "energy" for form in ("constant", "per_type", "range", "values")},
}


def in_own_units(content: Content) -> Content:
    """Return a content whose numbers are in the units of its system; the same for consistent ones."""
    units = UNITS[content.get("units", "lj")]
    if units.consistent:
        return content

    def converted(part: Any, place: str) -> Any:
        if isinstance(part, dict):
            return {key: converted(value, f"{place}.{key}" if place else key) for key, value in part.items()}
        if isinstance(part, list):
            return [converted(value, place) for value in part]
        if isinstance(part, float) and place in QUANTITIES:
            return rounded(part / units.of(QUANTITIES[place]), 6)
        return part

    return {key: converted(value, key) for key, value in content.items()}
