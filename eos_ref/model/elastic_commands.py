"""Parsers for the commands of elastic bodies: bond_style bpm/spring and rheo/shell, pair_style rheo/solid."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from eos_ref.errors import InputError
from eos_ref.model.bonds import BondLaw, ShellBond, SolidContact, SpringBond
from eos_ref.syntax.ranges import type_range
from eos_ref.syntax.words import Words

STYLES = ("bpm/spring", "rheo/shell")
SWITCHES = {"smooth": True, "normalize": False, "break": True, "overlay/pair": False, "volume/factor": False}


def parse_bonds(style: Sequence[str], coefficients: Sequence[Sequence[str]], ntypes: int) -> tuple[BondLaw, ...]:
    """Read the words behind ``bond_style`` and those behind every ``bond_coeff``; return a law per type, none of zero.

    Raises
    ------
    InputError
        Another style, a keyword that is not followed, a type without coefficients.

    Source: manual, bond_style bpm/spring and rheo/shell, syntax.
    """
    if list(style[:1]) == ["zero"]:
        return ()
    hybrid = list(style[:1]) == ["hybrid"]
    settings = _settings(list(style[1:] if hybrid else style), " ".join(["bond_style", *style]))
    laws: dict[int, BondLaw] = {}
    for values in coefficients:
        words = Words(list(values), " ".join(["bond_coeff", *values]))
        types = words.word("bond types")
        name = words.choice("bond style", tuple(settings)) if hybrid else next(iter(settings))
        law = _law(name, settings[name], words)
        for number in type_range(types, ntypes, words.command):
            laws[number] = law
    for number in range(1, ntypes + 1):
        if number not in laws:
            raise InputError(f"bond type {number}", "needs coefficients", where=" ".join(["bond_style", *style]))
    return tuple(laws[number] for number in range(1, ntypes + 1))


def _settings(words: list[str], command: str) -> dict[str, dict[str, str]]:
    """Return the keywords of each bond style."""
    reader, settings = Words(words, command), dict[str, dict[str, str]]()
    while reader.left:
        keywords = settings.setdefault(reader.choice("bond style", STYLES), {})
        while reader.left and reader.peek() not in STYLES:
            keyword = reader.choice("keyword of the bond style", (*SWITCHES, "t/form", "store/local"))
            if keyword == "store/local":  # what it stores changes no force
                while reader.left and reader.peek() not in (*STYLES, *SWITCHES, "t/form"):
                    reader.word("attribute")
            else:
                keywords[keyword] = str(reader.number(keyword)) if keyword == "t/form" else reader.word(keyword)
    return settings


def _law(name: str, settings: dict[str, str], words: Words) -> BondLaw:
    stiffness, strain, damping = (words.number(f"{what} of {name}") for what in ("stiffness", "strain", "damping"))
    if name == "rheo/shell":
        if "t/form" not in settings:
            words.fail("t/form", "is missing in bond_style rheo/shell")
        return ShellBond(stiffness, strain, damping, float(settings["t/form"]))
    switches = {keyword: settings[keyword] == "yes" if keyword in settings else on for keyword, on in SWITCHES.items()}
    if switches["volume/factor"]:
        words.fail("volume/factor", "cannot be followed")
    return SpringBond(stiffness, strain, damping, switches["smooth"], switches["normalize"])


def parse_contact(coefficients: Sequence[Sequence[str]], ntypes: int, bonded: float) -> SolidContact:
    """Read the words of every ``pair_coeff`` of pair_style rheo/solid: two ranges of types and three numbers.

    Parameters
    ----------
    bonded : weight of a contact of bonded particles (special_bonds)

    Raises
    ------
    InputError

    Source: manual, pair_style rheo/solid and pair_style hybrid: with pair_style rheo for all types nothing is mixed,
    and pairs of types without coefficients have no contacts.
    """
    table_ktt = np.zeros((3, ntypes, ntypes))
    for values in coefficients:
        words = Words(list(values), " ".join(["pair_coeff", *values]))
        ranges = [type_range(words.word("types"), ntypes, words.command) for _ in range(2)]
        numbers = [words.number(f"{what} of rheo/solid") for what in ("stiffness", "cutoff", "damping")]
        for one in ranges[0]:
            for other in ranges[1]:
                table_ktt[:, one - 1, other - 1] = table_ktt[:, other - 1, one - 1] = numbers
    return SolidContact(table_ktt[0], table_ktt[1], table_ktt[2], bonded)
