"""Findings about input: what the decks in their documents do not show."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from eos_ref import EOS, InputError, Viscosity, parse_fix_rheo, parse_fix_rheo_pressure
from eos_ref.eos import bounds, rounded_eos
from eos_ref.model.commands import parse_pair_style_rheo
from eos_ref.numbers.rounded import Rounded
from eos_ref.syntax.ranges import type_range
from lammps_cases.claims.probes.run import Reply
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.engine.session import Answer
from lammps_cases.engine.workers import Failure
from lammps_cases.run import prepared_case
from lammps_cases.scene import casefile
from lammps_cases.verdict.problems import problem_of
from tests.support.printed import ENTRIES, printed, quoted, recomputes, works_around
from tests.support.small_scene import Engine, SmallScene, agree, small_scene

pytestmark = pytest.mark.lammps

# Parts of the deck of the probes, each of which occurs there once.
PRESSURE = "1 linear 2 tait/water"
FIX_PRESSURE = f"fix 3 all rheo/pressure {PRESSURE}"
KEYWORDS = "density 1.2 0.7 speed/sound 3.0 8.0"
RUN = "run 3 post no"
UNPAIRED = (("pair_style rheo 3.0", ""), ("pair_coeff * *", ""))
SHIFT = ("quintic 0", "quintic 0 shift")


def with_law(lammps: Engine, text: str) -> Reply:
    """The deck with another fix rheo/pressure."""
    return lammps.reply("deck", (PRESSURE, text))


def with_keywords(lammps: Engine, text: str) -> Reply:
    """The deck with other keywords of fix rheo."""
    return lammps.reply("deck", (KEYWORDS, text))


def asking(what: str) -> tuple[str, str]:
    """The deck with a compute, and without steps."""
    return RUN, f"compute q all rheo/property/atom {what}\nrun 0 post no"


def accepted(reply: Reply) -> bool:
    return reply.ended == "answered" and "WARNING" not in reply.log


def planar(reply: Reply, name: str) -> Any:
    return reply.arrays[name][:, :2] if name in "xv" else reply.arrays[name]


def is_nan(reply: Reply) -> bool:
    """Whether positions, velocities, densities and pressures are NaN after three steps, without a message."""
    assert "WARNING" not in reply.log
    return all(np.isnan(planar(reply, name)).all() for name in ("x", "v", "rho", "pressure"))


# --- crashes


@works_around("component-names-unchecked", 1)
def test_component_names_unchecked(lammps: Engine) -> None:
    """Names too long are read by their last letters; a star next to a letter never gives a right answer."""

    def asked(words: str) -> Reply:
        return lammps.reply("deck", SHIFT, asking(f"{words} rho"))

    tensor, vector, row, stars = quoted("component-names-unchecked", "observed")
    for long, short in ((tensor, "grad/v/yx"), (vector, "shift/v/x")):
        ours, theirs = asked(long), asked(short)
        assert np.array_equal(ours.arrays["q"], theirs.arrays["q"]) and ours.arrays["q"].any(axis=0).all()
    for word in (row, stars):
        reply = asked(word)
        assert reply.ended == "crashed" or reply.arrays["q"].shape[1] != 5
    assert asked("grad/v/xy shift/v/y grad/v/* shift/v/*").arrays["q"].shape[1] == 1 + 1 + 4 + 2 + 1
    assert asked(quoted("component-names-unchecked", "argument")[0]).ended == "refused"


# --- ranges of types


@recomputes("long-range-abort", "digits")
def test_length_and_remainder_of_a_long_range() -> dict[str, Any]:
    *_, long, wraps, as_if = quoted("long-range-abort", "observed")
    assert (int(wraps[1:]) - int(as_if[1:])) % 2**32 == 0 and "modulo 2^32" in ENTRIES["long-range-abort"].observed
    return {"digits": len(long) - 1}


@pytest.mark.parametrize("types", ["1*1*2", "*1*", "1*2*3", "1*2**", "2*2*", "1*1*1*1"])
def test_reference_refuses_a_tail_of_a_range(types: str) -> None:
    with pytest.raises(InputError):
        type_range(types, 2)


@works_around("exclude-takes-one-range", 1)
def test_exclude_takes_one_range(lammps: Engine) -> None:
    command, error, *ranges = quoted("exclude-takes-one-range", "observed")
    assert error in with_keywords(lammps, command).error
    assert ranges == ["1", "1*2", "*"]
    for types in ranges:
        assert with_keywords(lammps, f"shift exclude/type {types}").ended == "answered"
    forms = ["*", *(form.format(m=m, n=n) for m in (1, 2, 3) for n in (1, 2, 3) for form in ("{m}", "*{n}", "{m}*"))]
    forms += [f"{m}*{n}" for m in (1, 2, 3) for n in range(m, 4)]
    assert all(set(type_range(form, 3)) != {1, 3} for form in forms)
    # The workaround, in a fluid of three types.
    (repeated,) = quoted("exclude-takes-one-range", "workaround")
    x = np.random.default_rng(1).uniform(0.3, 0.7, (36, 2)) + np.indices((6, 6)).reshape(2, -1).T
    v = np.random.default_rng(2).uniform(-1, 1, (36, 2))
    options: dict[str, Any] = {"types": [{"mass": 1.0}] * 3, "kind": [1, 2, 3] * 12, "compare": ["shift/v"]}
    listed, one = (
        small_scene(x, (6, 6), v, rheo={"cut": 2.6, "shift": {"exclude": excluded}}, **options)
        for excluded in (["1", "3"], ["1"])
    )
    commands = tuple(line.replace("shift exclude/type 1", repeated) for line in one.job.commands)
    assert sum(repeated in line for line in commands) == 1
    found = lammps.answer(replace(one.job, commands=commands)).snapshots[0]["q.shift/v"][:, :2]
    assert agree(found, listed.predicted(), "shift/v") and set(np.flatnonzero(found.any(axis=1)) % 3) == {1}


# --- documented input that is refused


def two_masses(mass: tuple[float, float], self_mass: bool = False, **options: Any) -> SmallScene:
    """Two particles at the distance and with the cutoff of the text, in 2D."""
    n = printed("self-mass-missing")
    types = [{"mass": m, "cs": 3.0, "rho0": 0.9} for m in mass]
    rheo = {"cut": float(n.cut), "rho_sum": True, "self_mass": self_mass} | options.pop("rheo", {})
    scene = {"rho": None, "compare": ["rho", "pressure"]} | options
    return small_scene([[4.0, 4.0], [4.0 + n.distance, 4.0]], (12, 12), kind=[1, 2], types=types, rheo=rheo, **scene)


@works_around("self-mass-missing", 1, 2)
@recomputes("self-mass-missing", "shared own percent", given="mass other_mass distance cut")
def test_self_mass_missing(lammps: Engine) -> dict[str, Any]:
    command, error = quoted("self-mass-missing", "observed")
    assert error in with_keywords(lammps, command).error
    for words in ("self/mass", "self/mass rho/sum", "rhosum self/mass", "self/mass rhosum", "rhosum"):
        assert with_keywords(lammps, words).ended == "refused"
    n = printed("self-mass-missing")
    masses = (n.mass, n.other_mass)
    wrong, right = lammps.fields(two_masses(masses))[0], two_masses(masses, self_mass=True).predicted().fields[0]
    shared, own = wrong["rho"][0], right["rho"][0]
    errors = [wrong[name][0] - right[name][0] for name in ("pressure", "rho")]
    # p = 9 (rho - 0.9): three roundings on one side, two on the other, of the terms 9 (rho + 0.9) of both densities.
    assert abs(errors[0] - 9.0 * errors[1]) <= 5 * 2.0**-53 * 9.0 * (shared + own + 2 * 0.9)
    # The workarounds: equal masses, or no summation.
    equal = two_masses((1.5, 1.5), self_mass=True).predicted()
    assert agree(lammps.fields(two_masses((1.5, 1.5)))[0]["rho"], equal, "rho")
    plain = two_masses(masses, rho=[0.95, 0.8], rheo={"rho_sum": False}, compare=["drho"])
    assert agree(lammps.fields(plain)[0]["drho"], plain.predicted(), "drho")
    return {"shared": shared, "own": own, "percent": 100 * (1 - shared / own)}


def test_cubic_law_can_be_inverted() -> None:
    """reconstruct-refuses-cubic: it rises with density, and the reference reconstructs walls with it."""
    rho0, cs, a3, rho = 1.2, 3.0, 2.1, np.linspace(0.1, 4.0, 400)
    cubic, linear = EOS("cubic", rho0, cs, a3), EOS("linear", rho0, cs)
    assert np.all(np.diff(cubic.pressure(rho)) > 0)
    p = Rounded(cubic.pressure(rho), bounds.reference(cubic, rho))
    assert np.all(np.abs(cubic.density(p.value) - rho) <= rounded_eos.density(cubic, p, None).error)
    more = cs**2 * a3 * (rho - rho0) ** 3  # seven operations, the difference of the densities among them three times
    bound = p.error + bounds.reference(linear, rho) + 7 * 2.0**-53 * cs**2 * a3 * (rho + rho0) * (rho - rho0) ** 2
    assert np.all(np.abs(p.value - linear.pressure(rho) - more) <= bound)
    for case in casefile.select(casefile.load(), ENTRIES["reconstruct-refuses-cubic"].applies_to):
        problem = problem_of(case.scene, prepared_case.prepare(case).atoms, "", (0,))
        fields = Predictor().predict(problem).fields[0]
        assert all(np.isfinite(values).all() for values in fields.values())


@pytest.mark.slow
@works_around("unknown-style-misnamed", 1)
def test_unknown_style_misnamed(lammps: Engine, older: Engine) -> None:
    command, error = quoted("unknown-style-misnamed", "observed")
    assert with_law(older, command).error.partition(" (")[0].endswith(error)
    assert "Illegal fix command, taitwater" in with_law(lammps, command).error
    for words in ("1 linear 2 taitwater", "2 taitwater 1 linear"):
        named = with_law(older, words).error.partition("command, ")[2].split()[0]
        assert words.split()[words.split().index(named) + 1] == "taitwater"


def test_syntax_of_the_laws_has_the_styles_of_the_page() -> None:
    """style-taitwater: linear, tait/water, cubic and three more."""
    entries = ["linear", "tait/water", "cubic 1.0", "tait/general 7.0", "ideal/gas 1.4", "background 0.5"]
    read = parse_fix_rheo_pressure(f"fix pressure all rheo/pressure {' '.join(f'* {entry}' for entry in entries)}")
    assert len(read) == 3 + 3


@works_around("data-file-of-walls", 1)
def test_data_file_of_walls(lammps: Engine) -> None:
    (error,) = quoted("data-file-of-walls", "observed")
    assert quoted("data-file-of-walls", "workaround") == ["nofix"]

    def through(by: str, **rheo: Any) -> Any:
        evolve = {"steps": 1, "timestep": 1e-4, "stops": [{"at": 0, "by": by}]}
        types = [{"mass": 1.0}, {"mass": 1.0, "phase": "solid"}]
        scene = small_scene([[4.0, 4.0], [5.0, 4.0]], (9, 9), kind=[2, 1], types=types, rheo=rheo, evolve=evolve)
        return lammps.workers.outcome(lammps.workers.submit(scene.job, 60.0))

    refused = through("data", interface_reconstruct=True)
    assert isinstance(refused, Failure) and error in refused.message
    assert ENTRIES["data-file-of-walls"].engine_error in refused.message
    assert isinstance(through("data"), Answer), "without interface/reconstruct there is no such section"
    assert isinstance(through("data nofix", interface_reconstruct=True), Answer)


# --- values without meaning


@works_around("specific-heat-zero", 1)
def test_specific_heat_zero(lammps: Engine) -> None:
    (words,) = quoted("specific-heat-zero", "observed")

    def given(text: str, law: str = "* ideal/gas 1.4") -> Reply:
        read = (RUN, f"compute q all rheo/property/atom temperature\n{RUN}")
        return lammps.reply("warm-deck", ("specific/heat * constant 0.9", text), ("* ideal/gas 1.4", law), read)

    others = ("x", "v", "rho", "pressure")
    gas = given(words)
    assert is_nan(gas) and all(np.isnan(gas.arrays[name]).all() for name in ("q", "esph"))
    for law in ("* linear", PRESSURE, "* cubic 1.0", "* tait/general 7.0"):
        ours, theirs = given(words, law), given(words.replace("0.0", "0.9"), law)
        assert all(np.isnan(ours.arrays[name]).all() for name in ("q", "esph")), law
        assert all(np.array_equal(ours.arrays[name], theirs.arrays[name]) for name in (*others, "f")), law
    assert quoted("specific-heat-zero", "documented")[0] in given(words.replace("0.0", "-1.0")).error
    assert np.isfinite(given(words.replace("0.0", "0.25")).arrays["esph"]).all(), "a positive value"


def test_a_sound_of_0_leaves_no_pressure(lammps: Engine) -> None:
    """scales-unchecked: without a message, although densities change."""
    reply = with_keywords(lammps, quoted("scales-unchecked", "observed")[2])
    first_n = reply.arrays["type"] == 1
    assert not reply.arrays["pressure"][first_n].any() and np.ptp(reply.arrays["rho"][first_n]) > 0


def test_law_arguments_unchecked(lammps: Engine) -> None:
    tait, below, one = quoted("law-arguments-unchecked", "observed")
    assert is_nan(with_law(lammps, f"1 linear 2 {tait}"))
    for words, sign in ((below, -1), (one, 0)):
        reply = lammps.reply("warm-deck", ("ideal/gas 1.4", words))
        assert accepted(reply) and (np.sign(reply.arrays["pressure"]) == sign).all()
    for words in (tait, below, one):
        style, gamma = words.split()
        with pytest.raises(InputError, match=r"must not be 0|must exceed 1"):
            EOS(style, parameter=float(gamma))
    gamma = float(below.split()[1])
    assert gamma * (gamma - 1) < 0, "the square of the speed of sound, per energy"


def test_power_law_unchecked(lammps: Engine) -> None:
    consistency, rate = quoted("power-law-unchecked", "observed")

    def given(words: str, *more: tuple[str, str]) -> Reply:
        return lammps.reply("deck", ("* constant 0.1", f"* {words}"), *more)

    reply = given(consistency, (RUN, f"compute q all rheo/property/atom viscosity\n{RUN}"))
    assert accepted(reply) and (reply.arrays["q"] < 0).all() and is_nan(given(rate))
    for words in (consistency, rate):
        with pytest.raises(InputError, match="must not be negative"):
            Viscosity("power", *map(float, words.split()[1:]))
    (error,) = quoted("power-law-unchecked", "documented")
    assert all(error in given(words).error for words in ("constant -0.1", "power -0.3 0.05 0.2 0.5"))


def test_magnitudes_unchecked(lammps: Engine) -> None:
    """Negative damping drives densities apart, and negative viscosity accelerates."""
    one_rho0 = ("density 1.2 0.7", "density 1.1 1.1")
    plain = lammps.reply("deck", one_rho0)

    def spread(reply: Reply) -> float:
        return float(np.ptp(reply.arrays["rho"]))

    def kinetic(reply: Reply) -> float:
        mass_n = np.where(reply.arrays["type"] == 1, 1.25, 0.75)
        return float(np.sum(mass_n[:, None] * reply.arrays["v"] ** 2))

    for words, measure in zip(quoted("magnitudes-unchecked", "observed"), (spread, kinetic), strict=True):
        with pytest.raises(InputError, match="not negative"):
            parse_pair_style_rheo(f"pair_style rheo 3.0 {words}")
        negative, positive = (
            lammps.reply("deck", one_rho0, ("pair_style rheo 3.0", f"pair_style rheo 3.0 {each}"))
            for each in (words, words.replace("-", ""))
        )
        assert accepted(negative) and accepted(positive)
        assert measure(negative) > measure(plain) > measure(positive)


def test_shiftscale_no_fraction(lammps: Engine) -> None:
    def shift(words: str) -> Any:
        reply = lammps.reply("deck", (SHIFT[0], f"{SHIFT[1]} {words}"), asking("shift/v/x shift/v/y"))
        assert accepted(reply)
        return reply.arrays["q"]

    none, whole = (shift(f"scale/cross/type {scale} 0.05 0.01") for scale in ("0.0", "1.0"))
    normal = whole - none
    assert np.abs(normal).max() > 0.01
    for words, scale in zip(quoted("shiftscale-no-fraction", "observed"), (-0.5, 1.5), strict=True):
        # Either side rounds a few times: both shifts, their difference and its product with the scale.
        bound = 16 * 2.0**-53 * (np.abs(none) + abs(scale) * (np.abs(none) + np.abs(whole)))
        assert (np.abs(shift(words) - (none + scale * normal)) <= bound).all()
        with pytest.raises(InputError, match="shiftscale: must be a fraction"):
            parse_fix_rheo(f"fix 1 all rheo 3.0 quintic 0 shift {words}")


# --- units of arguments


@works_around("cubic-unit", 1)
def test_cubic_unit(lammps: Engine) -> None:
    """A particle of water, compressed, in SI and cgs units; its cubic term is what the linear law lacks."""
    mass, density, velocity = 1e3, 1e-3, 1e2  # of an SI unit, in cgs units
    pressure = density * velocity**2
    assert pressure == 10.0

    def cubic_term(units: str, a3: float, m: float = 1.0, rho: float = 1.0, c: float = 1.0) -> Any:
        given: dict[str, Any] = {
            "types": [{"mass": m, "rho0": 1000.0 * rho, "cs": 1480.0 * c}] * 2,
            "pressure": [{"types": 1, "style": "linear"}, {"types": 2, "style": "cubic", "A3": a3}],
        }
        x, rho_n = [[2.0, 2.0], [6.0, 6.0]], 1020.0 * rho
        scene = small_scene(x, (9, 9), rho=rho_n, kind=[1, 2], compare=["pressure"], units=units, **given)
        found = lammps.fields(scene)[0]["pressure"]
        return found[1] - found[0]

    a3 = 2.5e-4
    si = cubic_term("si", a3)
    # rho - rho0 loses 1020/20, its cube three times that; what is linear is ten times the cubic term, and subtracted.
    lost = 2.0**-52 * (1020 / 20 * (3 + 10) + 8 * (1 + 10))
    np.testing.assert_allclose(si, 1480.0**2 * a3 * 20.0**3, rtol=lost)
    by_formula, by_syntax = (
        cubic_term("cgs", a3 * factor, mass, density, velocity) / pressure
        for factor in (1 / density**2, pressure / density**2)
    )
    np.testing.assert_allclose(by_formula, si, rtol=2 * lost)
    np.testing.assert_allclose(by_syntax, 10 * si, rtol=2 * lost)


@works_around("support-unit", 1)
@pytest.mark.parametrize(("dimension", "cells"), [(2, (7, 6)), (3, (4, 4, 4))])
def test_support_unit(lammps: Engine, dimension: int, cells: tuple[int, ...]) -> None:
    """By s in 2D and by s^2 in 3D."""
    sites, random = np.indices(cells).reshape(dimension, -1).T + 0.5, np.random.default_rng(3)
    x = sites + random.uniform(-0.2, 0.2, sites.shape)
    v, kind, wmin = random.uniform(-1, 1, sites.shape), random.integers(1, 3, len(sites)), 0.35

    def shifted(size: float, wmin: float) -> Any:
        rheo = {"cut": 2.4 * size, "shift": {"scale_cross_type": [1.0, 0.05, wmin]}}
        given: dict[str, Any] = {"types": [{"mass": size**dimension}] * 2, "rheo": rheo, "compare": ["shift/v"]}
        scene = small_scene(x * size, [size * cell for cell in cells], v * size, kind=kind, **given)
        return np.any(lammps.fields(scene)[0]["shift/v"] != 0, axis=1)

    here = shifted(1.0, wmin)
    assert 0 < here.sum() < len(here)
    assert (shifted(2.0, wmin) != here).any()
    assert (shifted(2.0, wmin / 2.0**dimension) != here).any(), "as W scales"
    np.testing.assert_array_equal(shifted(2.0, wmin / 2.0 ** (dimension - 1)), here)
