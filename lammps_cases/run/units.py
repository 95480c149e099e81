"""The units that fields are measured in, as text for tables and figures."""

from __future__ import annotations

from eos_ref.model.quantities import DENSITY, ENERGY, PRESSURE, QUANTITIES, VISCOSITY, Dimension
from eos_ref.model.units import KINDS
from lammps_cases.records.field_names import parted

# Units of length, mass, time and temperature; those of lj are what the user takes them for.
BASE = {
    "lj": ("length", "mass", "time", "temperature"),
    "si": ("m", "kg", "s", "K"),
    "cgs": ("cm", "g", "s", "K"),
    "micro": ("um", "pg", "us", "K"),
    "nano": ("nm", "ag", "ns", "K"),
    "real": ("Angstrom", "(g/mol)", "fs", "K"),
    "metal": ("Angstrom", "(g/mol)", "ps", "K"),
}
OWN = {
    "real": {"energy": "kcal/mol", "pressure": "atm", "density": "g/cm^3", "viscosity": "Poise"},
    "metal": {"energy": "eV", "pressure": "bar", "density": "g/cm^3", "viscosity": "Poise"},
}
_OF_KIND = {"energy": ENERGY, "pressure": PRESSURE, "density": DENSITY, "viscosity": VISCOSITY}
_OF_TEMPERATURE = {"temperature": 1, "cv": -1, "conductivity": -1}
_OTHER_NAMES = {"esph": "energy"}


def unit(field: str, style: str, dimension: int) -> str:
    """Return the unit of a field in a system of units: ``kg m^-1 s^-2``; 1 of counts, classes and ratios.

    Parameters
    ----------
    field : str
        By its name in a record; see `lammps_cases.records.field_names`.
    style : str
        As in the command units.
    dimension : int
        2 or 3: densities, pressures and stresses are per area or per volume.
    """
    name, _ = parted(field)
    name = _OTHER_NAMES.get(name, name)
    if name == "e":  # energy per mass
        return _product(style, Dimension(2, 0, -2), dimension, "")
    if name not in QUANTITIES:
        return "1"
    powers = QUANTITIES[name].dimension
    kind = next((kind for kind in OWN.get(style, {}) if name in KINDS[kind]), None)  # type: ignore[index]
    if kind is None:
        return _product(style, powers, dimension, "", _OF_TEMPERATURE.get(name, 0))
    rest = Dimension(*(a - b for a, b in zip(powers, _OF_KIND[kind], strict=True)))
    return _product(style, rest, dimension, OWN[style][kind], _OF_TEMPERATURE.get(name, 0))


def _product(style: str, powers: Dimension, dimension: int, own: str, temperature: int = 0) -> str:
    """Return a unit of its own times powers of base units."""
    of_base = (powers.mass, powers.length + dimension * powers.volume, powers.time, temperature)
    length, mass, time, kelvin = BASE[style]
    factors = [own] * bool(own)
    for base, power in zip((mass, length, time, kelvin), of_base, strict=True):
        if power:
            factors.append(base if power == 1 else f"{base}^{power}")
    return " ".join(factors) or "1"
