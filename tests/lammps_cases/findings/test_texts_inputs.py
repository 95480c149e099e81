"""Texts of the findings about values and words without meaning, checked with LAMMPS and the reference."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from eos_ref import EOS, InputError, Viscosity, parse_fix_rheo
from eos_ref.model.commands import parse_pair_style_rheo
from eos_ref.syntax.ranges import type_range
from lammps_cases.claims.probes.run import Reply
from tests.support.printed import ENTRIES, quoted
from tests.support.small_scene import Engine

pytestmark = pytest.mark.lammps

PRESSURE, KEYWORDS, RUN = "1 linear 2 tait/water", "density 1.2 0.7 speed/sound 3.0 8.0", "run 3 post no"
SHIFT = ("quintic 0", "quintic 0 shift")


def asking(what: str) -> tuple[str, str]:
    return RUN, f"compute q all rheo/property/atom {what}\nrun 0 post no"


def same(one: Reply, other: Reply) -> bool:
    assert (one.ended, other.ended) == ("answered", "answered"), (one.error, other.error)
    return all(np.array_equal(one.arrays[name], other.arrays[name]) for name in one.arrays)


def planar(reply: Reply, name: str) -> Any:
    return reply.arrays[name][:, :2] if name in "xv" else reply.arrays[name]


def is_nan(reply: Reply) -> bool:
    """Whether positions, velocities, densities and pressures are NaN after three steps."""
    assert RUN.startswith("run 3") and "WARNING" not in reply.log, "without a message"
    return all(np.isnan(planar(reply, name)).all() for name in ("x", "v", "rho", "pressure"))


def accepted(reply: Reply) -> bool:
    return reply.ended == "answered" and "WARNING" not in reply.log


def test_range_tail_ignored(lammps: Engine) -> None:
    entry = ENTRIES["range-tail-ignored"]
    *pairs, law = quoted(entry.id, "observed")
    assert len(pairs) == 6
    pairs += ["1*2**", "1*2", "2*2*", "2*2", "1*1*1*1", "1*1"]  # stars and digits, whatever their number

    def given(types: str) -> Reply:
        return lammps.reply("deck", (PRESSURE, f"* linear {types} tait/water"))

    for types, taken_for in zip(pairs[::2], pairs[1::2], strict=True):
        assert accepted(given(types))
        assert same(given(types), given(taken_for))
        with pytest.raises(InputError):
            type_range(types, 2)
    assert law == f"* linear {pairs[0]} tait/water"
    assert not same(given(pairs[0]), given("1*2")), "type 2 is left linear"
    *refused, error, _ = quoted(entry.id, "argument")
    assert len(refused) == 3 and all(f"{error}: {types}" in given(types).error for types in refused)
    assert accepted(given("1*2")) and accepted(given("*1")), "a single star"


def test_scales_unchecked(lammps: Engine) -> None:
    entry = ENTRIES["scales-unchecked"]
    zero, negative, silent = quoted(entry.id, "observed")
    assert is_nan(lammps.reply("deck", (KEYWORDS, zero)))
    assert accepted(lammps.reply("deck", (KEYWORDS, negative)))
    reply = lammps.reply("deck", (KEYWORDS, silent))
    assert accepted(reply)
    first_n = reply.arrays["type"] == 1
    assert not reply.arrays["pressure"][first_n].any() and np.ptp(reply.arrays["rho"][first_n]) > 0
    for words in (zero, negative, silent):
        with pytest.raises(InputError, match="must be positive"):
            parse_fix_rheo(f"fix 1 all rheo 3.0 quintic 0 {words}")
    (error,) = quoted(entry.id, "argument")
    assert error in lammps.reply("deck", ("mass 1 1.25", "mass 1 0.0")).error


def test_law_arguments_unchecked(lammps: Engine) -> None:
    entry = ENTRIES["law-arguments-unchecked"]
    tait, below, one = quoted(entry.id, "observed")
    assert is_nan(lammps.reply("deck", (PRESSURE, f"1 linear 2 {tait}")))
    for words, sign in ((below, -1), (one, 0)):
        reply = lammps.reply("warm-deck", ("ideal/gas 1.4", words))
        assert accepted(reply)
        assert (np.sign(reply.arrays["pressure"]) == sign).all()
    for words in (tait, below, one):
        style, gamma = words.split()
        with pytest.raises(InputError, match=r"must not be 0|must exceed 1"):
            EOS(style, parameter=float(gamma))
    gamma = float(below.split()[1])
    assert gamma * (gamma - 1) < 0, "the square of the speed of sound, per energy"


def test_power_law_unchecked(lammps: Engine) -> None:
    entry = ENTRIES["power-law-unchecked"]
    consistency, rate = quoted(entry.id, "observed")

    def given(words: str, *more: tuple[str, str]) -> Reply:
        return lammps.reply("deck", ("* constant 0.1", f"* {words}"), *more)

    reply = given(consistency, (RUN, f"compute q all rheo/property/atom viscosity\n{RUN}"))
    assert accepted(reply)
    assert (reply.arrays["q"] < 0).all()
    assert is_nan(given(rate))
    for words in (consistency, rate):
        with pytest.raises(InputError, match="must not be negative"):
            Viscosity("power", *map(float, words.split()[1:]))
    (error,) = quoted(entry.id, "documented")
    assert error in given("constant -0.1").error
    assert error in given("power -0.3 0.05 0.2 0.5").error


def test_magnitudes_unchecked(lammps: Engine) -> None:
    entry = ENTRIES["magnitudes-unchecked"]
    damping, viscosity = quoted(entry.id, "observed")
    one_rho0 = ("density 1.2 0.7", "density 1.1 1.1")
    plain = lammps.reply("deck", one_rho0)

    def given(words: str) -> Reply:
        reply = lammps.reply("deck", one_rho0, ("pair_style rheo 3.0", f"pair_style rheo 3.0 {words}"))
        assert accepted(reply)
        return reply

    def spread(reply: Reply) -> float:
        return float(np.ptp(reply.arrays["rho"]))

    def kinetic(reply: Reply) -> float:
        mass_n = np.where(reply.arrays["type"] == 1, 1.25, 0.75)
        return float(np.sum(mass_n[:, None] * reply.arrays["v"] ** 2))

    for words in (damping, viscosity):
        with pytest.raises(InputError, match="not negative"):
            parse_pair_style_rheo(f"pair_style rheo 3.0 {words}")
    assert spread(given(damping)) > spread(plain) > spread(given(damping.replace("-", "")))
    assert kinetic(given(viscosity)) > kinetic(plain) > kinetic(given(viscosity.replace("-", "")))


def test_shiftscale_no_fraction(lammps: Engine) -> None:
    entry = ENTRIES["shiftscale-no-fraction"]
    below, above = quoted(entry.id, "observed")

    def shift(words: str) -> Any:
        reply = lammps.reply("deck", (SHIFT[0], f"{SHIFT[1]} {words}"), asking("shift/v/x shift/v/y"))
        assert accepted(reply)
        return reply.arrays["q"]

    none, whole = (shift(f"scale/cross/type {scale} 0.05 0.01") for scale in ("0.0", "1.0"))
    normal = whole - none
    assert np.abs(normal).max() > 0.01
    for words, scale in ((below, -0.5), (above, 1.5)):
        # Either side rounds a few times: both shifts, their difference and its product with the scale.
        bound = 16 * 2.0**-53 * (np.abs(none) + abs(scale) * (np.abs(none) + np.abs(whole)))
        assert (np.abs(shift(words) - (none + scale * normal)) <= bound).all()
        with pytest.raises(InputError, match="shiftscale: must be a fraction"):
            parse_fix_rheo(f"fix 1 all rheo 3.0 quintic 0 shift {words}")


def test_component_stars_crash(lammps: Engine) -> None:
    entry = ENTRIES["component-stars-crash"]
    tensor, vector = quoted(entry.id, "observed")
    for words in (tensor, vector):
        reply = lammps.reply("deck", SHIFT, asking(words))
        assert reply.ended == "crashed" and ("SIGSEGV" in reply.error or "SIGABRT" in reply.error)
    wrong, error = quoted(entry.id, "argument")[:2]
    assert error in lammps.reply("deck", asking(wrong)).error
    assert lammps.reply("deck", SHIFT, asking(f"{tensor[:-1]} {vector[:-1]}")).ended == "answered", "a single star"
