"""Words for an argument of a kind, each by a name: what a mistake puts there, and the edges of its range."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from lammps_cases.versions.inputs.syntax import NTYPES, Argument

N = NTYPES
HUGE = "9" * 20
FULL_WIDTH = {ord(digit): 0xFF10 + k for k, digit in enumerate("0123456789")}
EMPTY = '""'

Words = Mapping[str, str]

# Of every argument that is read as a number.
_NO_NUMBER = {
    "word": "seven",
    "boolean": "true",
    "null": "NULL",
    "empty": EMPTY,
    "blank": '" "',
    "two-numbers": '"1 2"',
    "decimal-comma": "1,2",
    "underscore": "1_0",
    "two-points": "1.2.3",
    "two-signs": "--1",
    "sign-alone": "-",
    "hexadecimal": "0x1",
    "fortran-exponent": "1d0",
    "open-exponent": "1e",
    "unit-behind": "1.2kg",
    "quoted-minus": "\u22121",
    "no-break-space": "1\u00a02",
    "unknown-variable": "v_nothing",
    "nan": "nan",
    "negative-nan": "-nan",
    "infinity": "inf",
    "negative-infinity": "-inf",
    "infinity-in-words": "infinity",
    "beyond-doubles": "1e309",
    "beyond-doubles-negative": "-1e309",
}


def number(argument: Argument, legal: str) -> Words:
    """Return words for a number, given one that is legal."""
    return _NO_NUMBER | {
        "zero": "0",
        "minus-zero": "-0.0",
        "negative": f"-{legal}",
        "minus-one": "-1",
        "subnormal": "1e-310",
        "largest": "1e308",
        "negative-largest": "-1e308",
        "two-to-the-31": "2147483648",
        "two-to-the-32-and-1": "4294967297",
        "plus-sign": f"+{legal}",
        "point-first": f"0{legal}" if not legal.startswith("0") else legal[1:],
        "exponent": f"{legal}e0",
        "full-width": legal.translate(FULL_WIDTH),
    }


def integer(argument: Argument, legal: str) -> Words:
    """Return words for a whole number, given one that is legal."""
    return _NO_NUMBER | {
        "zero": "0",
        "minus-zero": "-0",
        "negative": f"-{legal}",
        "minus-one": "-1",
        "fraction": "1.5",
        "point-zero": f"{legal}.0",
        "exponent": f"{legal}e0",
        "two-to-the-31-less-1": "2147483647",
        "two-to-the-31": "2147483648",
        "two-to-the-32-and-1": "4294967297",
        "twenty-digits": HUGE,
        "plus-sign": f"+{legal}",
        "leading-zero": f"0{legal}",
        "full-width": legal.translate(FULL_WIDTH),
    }


def choice(argument: Argument, legal: str) -> Words:
    """Return words for one of several words, given one of them."""
    return {
        "upper-case": legal.upper(),
        "lower-case": legal.lower(),
        "capital": legal.capitalize(),
        "misspelt": legal[:-1] + "x",
        "cut-short": legal[:-1],
        "prolonged": legal + "s",
        "other-script": legal.replace("a", "\u0430").replace("R", "\u211b").replace("o", "\u043e"),
        "number": "1",
        "empty": EMPTY,
        "nan": "nan",
        "blank-behind": f'"{legal} "',
        "no-break-space": f"{legal}\u00a0",
    } | {f"the-word-{word.replace('/', '-')}": word for word in argument.of if word != legal}


# Legal forms of types among those of a deck of two, by which it shows what others are taken for.
LEGAL_TYPES = {
    "one": "1",
    "last": f"{N}",
    "all": "*",
    "up-to": "*1",
    "up-to-last": f"*{N}",
    "from": f"{N}*",
    "from-one": "1*",
    "both": f"1*{N}",
    "single-range": "1*1",
    "leading-zero": "01",
}


def types(argument: Argument, legal: str) -> Words:
    """Return words for a range of types."""
    return LEGAL_TYPES | {
        "zero": "0",
        "beyond": f"{N + 1}",
        "up-to-zero": "*0",
        "from-zero": "0*",
        "from-beyond": f"{N + 1}*",
        "up-to-beyond": f"*{N + 1}",
        "to-beyond": f"1*{N + 1}",
        "reversed": f"{N}*1",
        "two-stars": "**",
        "three-stars": "***",
        "two-stars-between": f"1**{N}",
        "star-first-and-last": "*1*",
        "two-ranges": "1*2*3",
        "hyphen": f"1-{N}",
        "hyphen-alone": "-",
        "comma": f"1,{N}",
        "semicolon": f"1;{N}",
        "colon": f"1:{N}",
        "slash": f"1/{N}",
        "points": f"1..{N}",
        "blank": '" "',
        "empty": EMPTY,
        "quoted-list": f'"1 {N}"',
        "negative": "-1",
        "negative-bound": "*-1",
        "from-negative": "-1*",
        "plus-sign": "+1",
        "fraction": "1.5",
        "exponent": "1e0",
        "hexadecimal": "0x1",
        "two-to-the-31": "2147483648",
        "two-to-the-32-and-1": "4294967297",
        "up-to-two-to-the-32-and-2": "*4294967298",
        "from-two-to-the-32-and-1": "4294967297*",
        "twenty-digits": HUGE,
        "up-to-twenty-digits": f"*{HUGE}",
        "word": "water",
        "nan": "nan",
        "letter-behind": "1x",
        "star-in-letters": "a*b",
        "brackets": f"[1-{N}]",
        "full-width": "\uff11",
        "full-width-star": "\uff0a",
        "operator-star": "\u2217",
        "no-break-space": f"1\u00a0{N}",
        "quoted-minus": f"1\u2212{N}",
    }


def group(argument: Argument, legal: str) -> Words:
    """Return words for a group: all is the one allowed."""
    return {
        "another": "some",
        "unknown": "nobody",
        "upper-case": "ALL",
        "number": "1",
        "star": "*",
        "empty": EMPTY,
        "full-width": "\uff41\uff4c\uff4c",
    }


def id(argument: Argument, legal: str) -> Words:
    """Return words for the ID of a fix."""
    return {
        "hyphen": "a-b",
        "fraction": "1.5",
        "blank": '"a b"',
        "empty": EMPTY,
        "star": "*",
        "accent": "\u00fc",
        "no-break-space": "a\u00a0b",
        "word": "a_1",
    }


def name(argument: Argument, legal: str) -> Words:
    """Return words for an attribute of particles, given one; with components, if it has them."""
    stem, _, last = legal.rpartition("/")
    words = {
        "upper-case": legal.upper(),
        "misspelt": legal[:-1] + "q",
        "cut-short": legal[:-1],
        "prolonged": legal + "s",
        "number": "1",
        "empty": EMPTY,
        "temperature": "temperature",
        "nbond-shell": "nbond/shell",
        "surface": "surface",
        "chi": "chi",
        "star": "*",
        "full-width": legal.replace("/", "\uff0f"),
        "twice": f"{legal} {legal}",
    }
    if stem and len(last) < 3:
        words |= {
            "third-axis": f"{stem}/{'z' * len(last)}",
            "fourth-axis": f"{stem}/{'w' * len(last)}",
            "one-component-more": f"{stem}/{last}x",
            "no-component": stem,
            "empty-component": f"{stem}/",
            "star-twice": f"{stem}/**",
            "all-components": f"{stem}/*",
            "upper-case-component": f"{stem}/{last.upper()}",
            "number-of-component": f"{stem}/1",
        }
    return words


WORDS: Mapping[str, Callable[[Argument, str], Words]] = {
    of.__name__: of for of in (number, integer, choice, types, group, id, name)
}


def words(argument: Argument, legal: str) -> Words:
    """Return words for an argument by their names, given one that is legal; none of them is that one."""
    return {name: word for name, word in WORDS[argument.kind](argument, legal).items() if word != legal}


def keyword(word: str) -> Words:
    """Return words in the place of a keyword or style."""
    return {
        "upper-case": word.upper(),
        "capital": word.capitalize(),
        "misspelt": word[:-1] + "x",
        "prolonged": word + "s",
        "no-slash": word.replace("/", ""),
        "hyphen-for-slash": word.replace("/", "-"),
        "underscore-for-slash": word.replace("/", "_"),
        "full-width-slash": word.replace("/", "\uff0f"),
        "number": "1",
        "empty": EMPTY,
    }
