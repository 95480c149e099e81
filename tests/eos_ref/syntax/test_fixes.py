"""Commands: words, ranges of types, the two fixes and their manuals; a clear one-line message for the rest."""

from __future__ import annotations

import math
import random
import re
from dataclasses import replace
from itertools import chain
from typing import Any, get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eos_ref import EOS, FixRheo, InputError, parse_fix_rheo, parse_fix_rheo_pressure, resolve, type_range
from eos_ref.eos.registry import LAWS
from eos_ref.kernels.styles import KERNELS
from eos_ref.syntax.fixes import PressureEntry, Shift, SurfaceDetection
from eos_ref.syntax.manual import FIRST, MANUALS, Manual, manual_of, weighs_distance
from eos_ref.syntax.words import fix, number, split
from tests.support.particle_scenes import bounded, recipe

# --- words


def test_split() -> None:
    assert split("fix 1 all\t rheo &\n 3.0 # cut\n\n").words == ["fix", "1", "all", "rheo", "3.0"]
    assert split("").words == []
    assert split("a 1\u00a02").words == ["a", "1\u00a02"], "a blank of another script does not separate words"
    with pytest.raises(InputError, match="command: must be a single one"):
        split("a\nb")


NO_NUMBER = ("1_0", "\uff11", "\u22121", "1,2", "0x1p1", "1d0", "1.2.3", "--1", "one")
NOT_FINITE, NOT_WHOLE = ("nan", "inf", "-inf", "1e309"), ("1.5", "1e0", "99999999999999999999", "0x1", "\uff11", "one")


@pytest.mark.parametrize(
    ("text", "method", "rule"),
    [
        *[(text, "number", "cut: must be a finite number") for text in (*NO_NUMBER, *NOT_FINITE)],
        *[(text, "integer", "cut: must be a whole number") for text in NOT_WHOLE],
    ],
)
def test_word_that_is_no_number(text: str, method: str, rule: str) -> None:
    words = split(f"a {text}")
    words.word("command")
    with pytest.raises(InputError, match=rule):
        getattr(words, method)("cut")
    assert text not in NO_NUMBER or number(text) is number("") is None


def test_end_choice_and_place() -> None:
    words = split("a b c")
    assert words.choice("letter", ("a",)) == "a"
    with pytest.raises(InputError, match=r"letter: must be one of x, bb \(did you mean 'bb'\?\), found 'b' \(a b c\)"):
        words.choice("letter", ("x", "bb"))
    with pytest.raises(InputError, match="a: takes nothing more, found 'c'"):
        words.end("a")
    with pytest.raises(InputError, match=r"mass: must be positive, found -1 \(a b c\)"), words.complaints():
        raise InputError("mass", "must be positive", -1)


def test_fix() -> None:
    assert fix("fix a_1 all rheo 3.0", "rheo").peek() == "3.0"
    for text, message in (
        ("unfix 1", "must begin with fix"),
        ("fix a-1 all rheo", "fix ID: must consist of letters, digits and underscores, found 'a-1'"),
        ("fix 1 some rheo", "group of fix rheo: must be all"),
        ("fix 1 all nve", "fix style: must be rheo"),
    ):
        with pytest.raises(InputError, match=message):
            fix(text, "rheo")


# --- ranges of types

LARGE, DIGITS = 999999999999999999, "9" * 5000  # Python refuses to convert so many digits
INVALID = {
    "must be *, n, *n, m* or m*n with whole numbers": (
        *(
            "**",
            "1*2*",
            "1-2",
            "1:2",
            "1,2",
            "",
            " 1",
            "1 ",
            "1\n",
            "1 * 2",
            "-1",
            "+1",
            "1.5",
            "1e0",
            "0x1",
            "1_0",
            "a",
        ),
        *("١", "¹", "１*２", DIGITS, "*" + DIGITS),
    ),
    "must lie within the atom types 1 to 2": ("0", "0*", "*0", "0*1", "3", "3*", "*3", "1*3", "3*4", str(LARGE)),
    "must not be reversed": ("2*1", "9*8"),
}


@pytest.mark.parametrize(("text", "rule"), [(text, rule) for rule, texts in INVALID.items() for text in texts])
def test_invalid_ranges_of_two_types(text: str, rule: str) -> None:
    with pytest.raises(InputError, match=re.escape(rule)) as caught:
        type_range(text, 2, "in.deck")
    message = str(caught.value)
    assert message.startswith("type range: ") and message.endswith("(in.deck)")
    assert "found" in message and "\n" not in message
    assert repr(text)[:100] in message or " " in text  # spaces are closed up


@settings(deadline=None, derandomize=True)
@given(st.integers(1, 50), st.integers(1, 50), st.integers(1, 50))
def test_range_selects_the_types_between_its_ends(low: int, high: int, ntypes: int) -> None:
    def value(text: str) -> list[int] | None:
        try:
            return list(type_range(text, ntypes))
        except InputError:
            return None

    fits = 1 <= low <= high <= ntypes
    assert value(f"{low}*{high}") == (list(range(low, high + 1)) if fits else None)
    assert value(f"*{high}") == (list(range(1, high + 1)) if high <= ntypes else None)
    assert value(f"{low}*") == (list(range(low, ntypes + 1)) if low <= ntypes else None)
    assert value(f"{low}") == value(f"0{low}") == ([low] if low <= ntypes else None)
    assert value("*") == list(range(1, ntypes + 1))
    assert list(type_range(str(LARGE), 10**18)) == [LARGE]


# --- fixes

PRESSURE = "fix 1 all rheo/pressure "
RHEO = "fix 1 all rheo 3.0 quintic 0 "


def laws(text: str, ntypes: int = 2, **per_type: Any) -> tuple[EOS, ...]:
    return resolve(parse_fix_rheo_pressure(PRESSURE + text), ntypes, **per_type).laws


# --- fix rheo/pressure ---


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        # the examples of the manual
        ("* linear", (EOS("linear"), EOS("linear"))),
        ("1 linear 2 cubic 10.0", (EOS("linear"), EOS("cubic", parameter=10.0))),
        ("* linear * background 0.1", (EOS("linear", background=0.1), EOS("linear", background=0.1))),
        # every style
        ("1 tait/water 2 tait/general 7.15", (EOS("tait/water"), EOS("tait/general", parameter=7.15))),
        ("1 ideal/gas 1.4 2 cubic -1e-3", (EOS("ideal/gas", parameter=1.4), EOS("cubic", parameter=-0.001))),
        # every form of types
        ("*1 linear 2* tait/water", (EOS("linear"), EOS("tait/water"))),
        ("1*2 cubic 1", (EOS("cubic", parameter=1.0), EOS("cubic", parameter=1.0))),
        # later entries override completely: an argument of the earlier style is dropped
        ("* cubic 3 2 linear", (EOS("cubic", parameter=3.0), EOS("linear"))),
        ("2 linear * tait/water", (EOS("tait/water"), EOS("tait/water"))),
        ("* cubic 3 * cubic 4", (EOS("cubic", parameter=4.0),) * 2),
        # the background comes before or after its law, survives a new one, and the last one counts
        ("* background -2 * linear", (EOS("linear", background=-2.0),) * 2),
        ("* linear 2 background 5 2 tait/water", (EOS("linear"), EOS("tait/water", background=5.0))),
        ("* linear * background 1 1 background 0", (EOS("linear"), EOS("linear", background=1.0))),
        # numbers
        ("* cubic 1e-3", (EOS("cubic", parameter=1e-3),) * 2),
        ("* cubic +.5E+2", (EOS("cubic", parameter=50.0),) * 2),
        ("* cubic 3.", (EOS("cubic", parameter=3.0),) * 2),
    ],
)
def test_pressure_entries(text: str, expected: tuple[EOS, ...]) -> None:
    assert laws(text) == expected


def test_rho0_and_cs_go_to_their_types() -> None:
    assert laws("1 linear 2 tait/water", rho0=(2.0, 3.0), cs=(4.0, 5.0)) == (
        EOS("linear", 2.0, 4.0),
        EOS("tait/water", 3.0, 5.0),
    )


@pytest.mark.parametrize(
    "text",
    [
        "fix 1 all rheo/pressure 1 linear &\n   2 cubic 10.0",
        "fix 1 all rheo/pressure 1 linear & \t\r\n 2 cubic 10.0",
        "fix 1 all rheo/pressure 1 lin&\near 2 cubic 10.0",
        "fix 1 all rheo/pressure 1 linear 2 cubic 10.0  # 3 nonsense &\nfix 2",
        "# a comment\n\nfix 1 all rheo/pressure 1 linear 2 cubic 10.0\n# another\n",
        "  fix\tmyfix   all rheo/pressure 1 linear 2 cubic 10.0\r\n",
    ],
)
def test_lines_are_read_as_lammps_reads_them(text: str) -> None:
    """& as the last printable character continues the line without a space; # ends it, joined lines included."""
    assert parse_fix_rheo_pressure(text) == (PressureEntry("1", "linear"), PressureEntry("2", "cubic", 10.0))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "command: is missing"),
        ("# only a comment", "command: is missing"),
        ("pair_style rheo", "command: must begin with fix, found 'pair_style'"),
        ("fix", "fix ID: is missing"),
        ("fix 1", "group-ID: is missing"),
        ("fix 1 water rheo/pressure * linear", "group of fix rheo/pressure: must be all, found 'water'"),
        ("fix 1 all", "fix style: is missing"),
        ("fix 1 all rheo 3.0 quintic 0", "fix style: must be rheo/pressure, found 'rheo'"),
        ("fix 1 all rheo/viscosity * constant 1", "fix style: must be rheo/pressure"),
        (PRESSURE, "types and pressure style: is missing at the end"),
        (PRESSURE + "*", "pressure style: is missing at the end"),
        (PRESSURE + "linear", "type range: must be .*found 'linear'"),
        (PRESSURE + "1 linear cubic 10", "type range: must be .*found 'cubic'"),
        (PRESSURE + "2*1 linear", "type range: must not be reversed"),
        (PRESSURE + "* taitwater", r"did you mean 'tait/water'\?\), found 'taitwater'"),
        (PRESSURE + "* Linear", r"did you mean 'linear'\?"),
        (PRESSURE + "* tait", "pressure style: must be one of linear, cubic, tait/water, tait/general"),
        (PRESSURE + "* xyz", "background, found 'xyz'"),
        (PRESSURE + "* cubic", "A3 of cubic: is missing at the end"),
        (PRESSURE + "* tait/general", "gamma of tait/general: is missing"),
        (PRESSURE + "* ideal/gas", "gamma of ideal/gas: is missing"),
        (PRESSURE + "* linear * background", "P_b of background: is missing"),
        (PRESSURE + "* cubic nan", "A3 of cubic: must be a finite number, found 'nan'"),
        (PRESSURE + "* cubic inf", "must be a finite number, found 'inf'"),
        (PRESSURE + "* cubic -Infinity", "must be a finite number"),
        (PRESSURE + "* cubic 1e999", "must be a finite number, found '1e999'"),
        (PRESSURE + "* cubic 1_0", "must be a finite number, found '1_0'"),
        (PRESSURE + "* cubic ١", "must be a finite number"),
        (PRESSURE + "* cubic ${A3}", "must be a finite number"),
        (PRESSURE + "* cubic linear", "must be a finite number, found 'linear'"),
        (PRESSURE + "* linear 1.0", "type range: must be .*found '1.0'"),
        (PRESSURE + "* linear\nfix 2 all nve", "command: must be a single one .*found 'fix 2 all nve'"),
        (PRESSURE + "1 linear & # no continuation\n2 cubic 1", "command: must be a single one"),
        (PRESSURE + "1 linear &", "type range"),
    ],
)
def test_bad_pressure_commands(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        parse_fix_rheo_pressure(text)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "arguments", "message"),
    [
        ("1 linear", {}, "atom type 2: needs an equation of state"),
        ("1 linear * background 3", {}, "atom type 2: needs an equation of state in addition to the background"),
        ("* background 3", {}, "atom type 1: needs an equation of state in addition to the background"),
        ("3 linear", {}, "type range: must lie within the atom types 1 to 2, found '3'"),
        ("* linear 3* tait/water", {}, "must lie within the atom types 1 to 2"),
        ("* tait/general 0", {}, r"gamma of tait/general: must not be 0.*\(deck, atom type 1\)"),
        ("1 linear 2 ideal/gas 1", {}, r"gamma of ideal/gas: must exceed 1.*\(deck, atom type 2\)"),
        ("* linear", {"rho0": (1.0,)}, r"density: needs one value per atom type \(2\), found 1"),
        ("* linear", {"rho0": (1.0, 2.0, 3.0)}, r"density: needs one value per atom type \(2\), found 3"),
        ("* linear", {"cs": ()}, "speed/sound: needs one value per atom type"),
        ("* linear", {"cs": (1.0, -1.0)}, r"cs: must be positive, found -1.0 \(deck, atom type 2\)"),
        ("* linear", {"rho0": (math.nan, 1.0)}, r"rho0: must be a finite number.*atom type 1"),
    ],
)
def test_unresolvable_entries_are_refused(text: str, arguments: dict[str, Any], message: str) -> None:
    entries = parse_fix_rheo_pressure(PRESSURE + text)
    with pytest.raises(InputError, match=message) as caught:
        resolve(entries, 2, where="deck", **arguments)
    assert "\n" not in str(caught.value)


def test_entries_made_in_python_are_checked() -> None:
    with pytest.raises(InputError, match="needs the argument P_b"):
        resolve([PressureEntry("*", "linear"), PressureEntry("*", "background")], 1)
    with pytest.raises(InputError, match="pressure style"):
        resolve([PressureEntry("*", "tait")], 1)
    with pytest.raises(InputError, match="needs the argument A3"):
        resolve([PressureEntry("*", "cubic")], 1)
    with pytest.raises(InputError, match="every atom type"):
        resolve([], 0)


# --- fix rheo ---

PLAIN = FixRheo(3.0, "quintic", 0)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("fix 1 all rheo 3.0 quintic 0", PLAIN),
        ("fix 1 all rheo 2.5e-3 RK0 1", FixRheo(2.5e-3, "RK0", 1)),
        ("fix 1 all rheo 3 RK2 12", FixRheo(3.0, "RK2", 12)),
        # the first example of the manual
        (
            "fix 1 all rheo 3.0 quintic 0 thermal density 0.1 0.1 speed/sound 10.0 1.0",
            replace(PLAIN, thermal=True, rho0=(0.1, 0.1), cs=(10.0, 1.0)),
        ),
        # the second and third, as the syntax section requires
        (
            "fix 1 all rheo 3.0 RK1 10 shift surface/detection coordination 40 8",
            FixRheo(3.0, "RK1", 10, shift=Shift(), surface_detection=SurfaceDetection("coordination", 40.0, 8)),
        ),
        ("fix 1 all rheo 3.0 RK1 10 rho/sum self/mass", FixRheo(3.0, "RK1", 10, rho_sum=True, self_mass=True)),
        (RHEO + "interface/reconstruct", replace(PLAIN, interface_reconstruct=True)),
        (
            RHEO + "surface/detection divergence 1.5 4 rho/sum",
            replace(PLAIN, surface_detection=SurfaceDetection("divergence", 1.5, 4), rho_sum=True),
        ),
        (RHEO + "shift exclude/type 2", replace(PLAIN, shift=Shift(("2",)))),
        (RHEO + "shift exclude/type 1 *2 2*", replace(PLAIN, shift=Shift(("1", "*2", "2*")))),
        (
            RHEO + "shift scale/cross/type 0 0.5 1e-3 thermal",
            replace(PLAIN, shift=Shift((), (0.0, 0.5, 1e-3)), thermal=True),
        ),
        (
            RHEO + "shift exclude/type * scale/cross/type 1 2 3",
            replace(PLAIN, shift=Shift(("*",), (1.0, 2.0, 3.0))),
        ),
        (
            RHEO + "shift scale/cross/type 1 2 3 exclude/type 1*2 density 1 2",
            replace(PLAIN, shift=Shift(("1*2",), (1.0, 2.0, 3.0)), rho0=(1.0, 2.0)),
        ),
        (RHEO + "density 1 2 & # not continued", None),
        ("fix 1 all rheo 3.0 &\n quintic 0 & \n thermal # warm", replace(PLAIN, thermal=True)),
    ],
)
def test_rheo_commands(text: str, expected: FixRheo | None) -> None:
    if expected is None:
        with pytest.raises(InputError, match=r"keyword of fix rheo: .*found '&'"):
            parse_fix_rheo(text, 2)
    else:
        assert parse_fix_rheo(text, 2) == expected
        assert parse_fix_rheo(text) == expected


def test_defaults_are_left_to_the_law() -> None:
    """rho0 and cs of None stand for 1 for every type, which `resolve` fills in."""
    fix = parse_fix_rheo(RHEO)
    assert fix.rho0 is None
    assert fix.cs is None
    assert laws("* linear", rho0=fix.rho0, cs=fix.cs) == (EOS("linear", 1.0, 1.0),) * 2


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("fix 1 all rheo/pressure * linear", "fix style: must be rheo, found 'rheo/pressure'"),
        ("fix 1 fluid rheo 3 quintic 0", "group of fix rheo: must be all, found 'fluid'"),
        ("fix 1 all rheo", "cut: is missing at the end"),
        ("fix 1 all rheo 3", "kstyle: is missing"),
        ("fix 1 all rheo 3 quintic", "zmin: is missing"),
        ("fix 1 all rheo -3 quintic 0", "cut: must be positive, found -3.0"),
        ("fix 1 all rheo 0 quintic 0", "cut: must be positive"),
        ("fix 1 all rheo nan quintic 0", "cut: must be a finite number"),
        ("fix 1 all rheo quintic 3 0", "cut: must be a finite number, found 'quintic'"),
        ("fix 1 all rheo 3 rk1 0", "kstyle: must be one of quintic, RK0, RK1, RK2"),
        ("fix 1 all rheo 3 quintc 0", r"did you mean 'quintic'\?"),
        ("fix 1 all rheo 3 RK1 -1", "zmin: must not be negative, found -1"),
        ("fix 1 all rheo 3 RK1 1.5", "zmin: must be a whole number.*found '1.5'"),
        ("fix 1 all rheo 3 RK1 1_0", "zmin: must be a whole number"),
        ("fix 1 all rheo 3 RK1 " + "9" * 5000, "zmin: must be a whole number"),
        # the second and third example of the manual contradict its syntax section
        (
            "fix 1 all rheo 3.0 RK1 10 shift surface/detection coordination 40",
            "limit/splash of surface/detection: is missing at the end of the command",
        ),
        ("fix 1 all rheo 3.0 RK1 10 rhosum self/mass", r"did you mean 'rho/sum'\?\), found 'rhosum'"),
        (RHEO + "termal", r"keyword of fix rheo: must be one of .*did you mean 'thermal'\?\), found 'termal'"),
        (RHEO + "artificial/visc 1", "keyword of fix rheo: must be one of"),
        (RHEO + "5", "keyword of fix rheo: must be one of .*found '5'"),
        (RHEO + "self/mass", "self/mass: is an argument of rho/sum and must follow it"),
        (RHEO + "rho/sum thermal self/mass", "self/mass: is an argument of rho/sum and must follow it"),
        (RHEO + "exclude/type 1", "keyword of fix rheo"),
        (RHEO + "surface/detection", "style of surface/detection: is missing"),
        (RHEO + "surface/detection divergense 1 2", r"did you mean 'divergence'\?"),
        (RHEO + "surface/detection divergence x 2", "limit of surface/detection: must be a finite number"),
        (RHEO + "surface/detection divergence 1.5 2.5", "limit/splash .*must be a whole number"),
        (RHEO + "surface/detection divergence -1 2", r"limit of surface/detection: must not be negative, .*\(fix 1"),
        (RHEO + "surface/detection divergence 1.5 -1", "limit/splash of surface/detection: must not be negative"),
        (RHEO + "surface/detection coordination 20.5 4", "limit of surface/detection: must be a whole number"),
        (RHEO + "shift scale/cross/type 1.5 0 0", "shiftscale: must be a fraction, 0 to 1, found 1.5"),
        (RHEO + "shift scale/cross/type -0.5 0 0", "shiftscale: must be a fraction"),
        (RHEO + "shift scale/cross/type 0.5 -1 0", "cmin: must not be negative, found -1.0"),
        (RHEO + "shift scale/cross/type 0.5 0 -1", "wmin: must not be negative, found -1.0"),
        (RHEO + "shift exclude/type", "types of exclude/type: is missing"),
        (RHEO + "shift exclude/type thermal", "type range: must be .*found 'thermal'"),
        (RHEO + "shift exclude/type 3", "type range: must lie within the atom types 1 to 2, found '3'"),
        (RHEO + "shift exclude/type 1 2*1", "type range: must not be reversed"),
        (RHEO + "shift scale/cross/type 1 2", "wmin: is missing"),
        (RHEO + "shift scale/cross/type 1 2 inf", "wmin: must be a finite number"),
        (RHEO + "density", r"density: needs one value per atom type \(2\)"),
        (RHEO + "density thermal", r"density: needs one value per atom type \(2\), found 'thermal'"),
        (RHEO + "density 1", r"density: needs one value per atom type \(2\), found '1.0'"),
        (RHEO + "density 1 2 3", r"density: needs one value per atom type \(2\), found '1.0 2.0 3.0'"),
        (RHEO + "density 1 0", "density: must be positive, found 0.0"),
        (RHEO + "density 1 nan", "density: must be a finite number, found 'nan'"),
        (RHEO + "density 1 1e999", "density: must be a finite number"),
        (RHEO + "density 1 1_0", "density: needs one value per atom type"),
        (RHEO + "speed/sound 1 -1", "speed/sound: must be positive, found -1.0"),
        (RHEO + "speed/sound 0 1", "speed/sound: must be positive"),
        (RHEO + "thermal\nfix 2 all nve", "command: must be a single one"),
    ],
)
def test_bad_rheo_commands(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        parse_fix_rheo(text, 2)
    assert "\n" not in str(caught.value)
    assert str(caught.value).endswith(")"), "every complaint names the command"


@pytest.mark.parametrize("ntypes", [None, 3])
def test_wrong_number_of_values_is_refused(ntypes: int | None) -> None:
    assert parse_fix_rheo(RHEO + "density 1 2 3", ntypes).rho0 == (1.0, 2.0, 3.0)
    with pytest.raises(InputError, match=r"needs one value per atom type \((N|3)\)"):
        parse_fix_rheo(RHEO + "density", ntypes)


# --- round trips: any valid settings, written as text, are read back ---

NTYPES = 4
numbers = st.floats(allow_nan=False, allow_infinity=False)
positive = st.floats(1e-300, 1e300)
ranges = st.builds(
    lambda a, b, form: form.format(min(a, b), max(a, b)),
    st.integers(1, NTYPES),
    st.integers(1, NTYPES),
    st.sampled_from(["{0}", "*", "*{0}", "{1}*", "{0}*{1}"]),
)
entries = st.one_of(
    st.builds(PressureEntry, ranges, st.just("background"), numbers),
    *[
        st.builds(PressureEntry, ranges, st.just(style), numbers.filter(law.allows) if law.parameter else st.none())
        for style, law in LAWS.items()
    ],
)
gaps = st.sampled_from([" ", "  ", "\t", " &\n ", " & \n\t"])
per_type = st.none() | st.tuples(*[positive] * NTYPES)
counts, thresholds = st.integers(0, 10**6), st.floats(0, allow_infinity=False)
settings_of_rheo = st.builds(
    lambda **values: FixRheo(**values, self_mass=values["rho_sum"] and values["cut"] > 1),
    cut=positive,
    kernel=st.sampled_from(list(KERNELS)),
    zmin=st.integers(0, 10**6),
    thermal=st.booleans(),
    interface_reconstruct=st.booleans(),
    surface_detection=st.none()
    | st.builds(SurfaceDetection, st.just("coordination"), counts, counts)
    | st.builds(SurfaceDetection, st.just("divergence"), thresholds, counts),
    shift=st.none()
    | st.builds(
        Shift,
        st.lists(ranges, max_size=3).map(tuple),
        st.none() | st.tuples(st.floats(0, 1), thresholds, thresholds),
    ),
    rho_sum=st.booleans(),
    rho0=per_type,
    cs=per_type,
)


@settings(deadline=None, derandomize=True)
@given(st.lists(entries, min_size=1, max_size=6), gaps)
def test_any_entries_survive_a_round_trip(written: list[PressureEntry], gap: str) -> None:
    words = PRESSURE.split()
    for entry in written:
        words += [entry.types, entry.style] + ([] if entry.value is None else [repr(entry.value)])
    read = parse_fix_rheo_pressure(gap.join(words))
    assert read == tuple(written)
    # and their result, computed in the simplest way: the last law and the last background of each type
    whole = (PressureEntry("*", "linear"), *read)
    for t, law in enumerate(resolve(whole, NTYPES).laws, 1):
        mine = [e for e in whole if covers(e.types, t)]
        last = [e for e in mine if e.style != "background"][-1]
        shifts = [e.value for e in mine if e.style == "background"]
        assert (law.style, law.parameter, law.background) == (last.style, last.value, shifts[-1] if shifts else 0.0)


def covers(types: str, t: int) -> bool:
    low, star, high = types.partition("*")
    if not star:
        return t == int(low)
    return int(low or 1) <= t <= int(high or NTYPES)


def rheo_text(fix: FixRheo, gap: str, order: int) -> str:
    """The command, its keywords in random order."""
    keywords: list[list[str]] = []
    if fix.thermal:
        keywords.append(["thermal"])
    if fix.interface_reconstruct:
        keywords.append(["interface/reconstruct"])
    if fix.surface_detection:
        s = fix.surface_detection
        keywords.append(["surface/detection", s.style, repr(s.limit), str(s.splash)])
    if fix.shift:
        optional = [["exclude/type", *fix.shift.exclude_types]] if fix.shift.exclude_types else []
        if fix.shift.scale_cross_type:
            optional.append(["scale/cross/type", *map(repr, fix.shift.scale_cross_type)])
        random.Random(order).shuffle(optional)
        keywords.append(["shift", *chain(*optional)])
    if fix.rho_sum:
        keywords.append(["rho/sum"] + ["self/mass"] * fix.self_mass)
    if fix.rho0:
        keywords.append(["density", *map(repr, fix.rho0)])
    if fix.cs:
        keywords.append(["speed/sound", *map(repr, fix.cs)])
    random.Random(order).shuffle(keywords)
    words = ["fix", "1", "all", "rheo", repr(fix.cut), fix.kernel, str(fix.zmin), *chain(*keywords)]
    return gap.join(words)


@settings(deadline=None, derandomize=True)
@given(settings_of_rheo, gaps, st.integers(0, 10**6))
def test_any_settings_survive_a_round_trip(fix: FixRheo, gap: str, order: int) -> None:
    text = rheo_text(fix, gap, order)
    assert parse_fix_rheo(text, NTYPES) == fix
    assert parse_fix_rheo(text) == fix


@pytest.mark.slow
@settings(deadline=None, derandomize=True, max_examples=300)
@given(st.text(max_size=60), st.sampled_from(["", PRESSURE, RHEO, PRESSURE + "* linear ", RHEO + "shift "]))
def test_any_text_is_read_or_refused(text: str, start: str) -> None:
    """No other exception, whatever is written."""
    for parse in (parse_fix_rheo, parse_fix_rheo_pressure):
        try:
            parse(start + text)
        except InputError as error:
            assert len(str(error).splitlines()) == 1


# --- versions of the manual

LINE = "fix 1 all rheo 3.0 RK1 10 shift exclude/type 2*4 scale/cross/type 0.05 0.02 0.5"


VERSIONS = {
    "2025.7.22": ("2025.7.22.4.0", "2026.7.3", "20250722", "2024.8.29", "", "fork"),
    "2026.7.4": ("2026.7.4", "20260704", "20260930"),
}


def test_manual_of_a_version() -> None:
    assert FIRST == "2025.7.22", "that of a version without a date"
    for manual, versions in VERSIONS.items():
        assert {manual_of(version) for version in versions} == {manual}


def test_meaning_of_a_line_depends_on_the_manual() -> None:
    assert get_args(Manual) == MANUALS
    for manual in MANUALS:
        shift = parse_fix_rheo(LINE, 4, manual).shift
        assert shift is not None and shift.scale_cross_type == (0.05, 0.02, 0.5)
        assert shift.weighs_distance == weighs_distance(manual) == (manual != "2025.7.22")


@pytest.mark.parametrize("dimension", [2, 3])
def test_two_sums_shift_different_particles(dimension: int) -> None:
    """Both are compared with the double loop wherever all recipes are; here, a recipe distinguishes them."""
    shifts = [bounded(recipe(name, dimension))["shift/v"][0] for name in ("cross", "cross, by distance")]
    still = [np.all(shift_nc == 0, axis=1) for shift_nc in shifts]
    assert still[0].any() and still[1].any() and np.any(still[0] != still[1])
