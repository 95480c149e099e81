"""Parsers for the commands of the properties that the two fixes need: pair_style rheo, fix rheo/viscosity and
fix rheo/thermal.

The grammar is that of their manual pages. A type that is given a value twice has the last one, as with fix
rheo/pressure.
"""

from __future__ import annotations

from typing import Any

from eos_ref.model.parameters import PairRheo, Thermal, Viscosity
from eos_ref.syntax.ranges import type_range
from eos_ref.syntax.words import Words, fix, split

PAIR_KEYWORDS = ("rho/damp", "artificial/visc", "harmonic/means")


def parse_pair_style_rheo(text: str) -> PairRheo:
    """Read ``pair_style rheo cutoff keyword values``.

    Raises
    ------
    InputError
        Not this command, an unknown keyword, a missing or bad value.

    Source: manual, pair_style rheo, syntax.
    """
    words = split(text)
    words.choice("command", ("pair_style",))
    words.choice("pair style", ("rheo",))
    pair = pair_rheo(words)
    words.end("pair_style rheo")
    return pair


def pair_rheo(words: Words) -> PairRheo:
    """Read the cutoff and the keywords of pair_style rheo, up to the first other word.

    Raises
    ------
    InputError
    """
    cut = words.number("cutoff of pair rheo")
    if cut <= 0:
        words.fail("cutoff of pair rheo", "must be positive", cut)
    values = dict.fromkeys(PAIR_KEYWORDS, 0.0)
    while words.peek() in PAIR_KEYWORDS:
        keyword = words.word("keyword")
        values[keyword] = 1.0 if keyword == "harmonic/means" else words.number(f"{keyword} of pair rheo")
    with words.complaints():
        return PairRheo(cut, values["artificial/visc"], values["rho/damp"], bool(values["harmonic/means"]))


def parse_fix_rheo_viscosity(text: str, ntypes: int) -> tuple[Viscosity, ...]:
    """Read ``fix ID all rheo/viscosity type1 pstyle1 args1 ...``.

    Returns
    -------
    tuple of Viscosity
        One per type.

    Raises
    ------
    InputError
        Not this command, an unknown style, a missing or bad argument, a type without viscosity.

    Source: manual, fix rheo/viscosity, syntax.
    """
    words = fix(text, "rheo/viscosity")
    laws: dict[int, Viscosity] = {}
    while words.left or not laws:
        types = type_range(words.word("types and viscosity style"), ntypes, words.command)
        style = words.choice("viscosity style", ("constant", "power"))
        names = ("eta",) if style == "constant" else ("eta", "gd0", "K", "n")
        values = {name: words.number(f"{name} of rheo/viscosity {style}") for name in names}
        with words.complaints():
            laws |= dict.fromkeys(types, Viscosity(style, **values))  # type: ignore[arg-type]
    return tuple(laws[t] if t in laws else words.fail(f"atom type {t}", "needs a viscosity") for t in _all(ntypes))


THERMAL_ATTRIBUTES = {
    "conductivity": "conductivity",
    "specific/heat": "specific_heat",
    "latent/heat": "latent_heat",
    "Tfreeze": "T_freeze",
}


def parse_fix_rheo_thermal(text: str, ntypes: int) -> tuple[Thermal, ...]:
    """Read ``fix ID all rheo/thermal attribute values ...``.

    The reference has no bonds: ``react`` is read, and otherwise ignored.

    Returns
    -------
    tuple of Thermal
        One per type.

    Raises
    ------
    InputError
        Not this command, an unknown attribute, a missing or bad value, a type without conductivity or specific heat.

    Source: manual, fix rheo/thermal, syntax.
    """
    words = fix(text, "rheo/thermal")
    values_t: dict[int, dict[str, Any]] = {t: {} for t in _all(ntypes)}
    while words.left:
        attribute = words.choice("attribute of rheo/thermal", (*THERMAL_ATTRIBUTES, "react"))
        if attribute == "react":
            _react(words)
            continue
        types = type_range(words.word(f"types of {attribute}"), ntypes, words.command)
        words.choice(f"style of {attribute}", ("constant",))
        value = words.number(attribute)
        for t in types:
            values_t[t][THERMAL_ATTRIBUTES[attribute]] = value
    for t, values in values_t.items():
        for attribute in ("conductivity", "specific/heat"):
            if THERMAL_ATTRIBUTES[attribute] not in values:
                words.fail(f"atom type {t}", f"needs a {attribute}")
    with words.complaints():
        return tuple(Thermal(**values) for values in values_t.values())


def _react(words: Words) -> None:
    cut, kind = words.number("cut of react"), words.integer("type of react")
    if cut <= 0:
        words.fail("cut of react", "must be positive", cut)
    if kind < 1:
        words.fail("type of react", "must be a bond type, from 1 on", kind)


def _all(ntypes: int) -> range:
    return range(1, ntypes + 1)
