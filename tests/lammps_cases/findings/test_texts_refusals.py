"""The findings about input: every command, message and number of their texts, on LAMMPS."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from eos_ref import EOS, InputError, parse_fix_rheo, parse_fix_rheo_pressure
from eos_ref.eos import bounds, rounded_eos
from eos_ref.numbers.rounded import Rounded
from eos_ref.syntax.ranges import type_range
from lammps_cases.claims.probes.run import Reply
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.engine.session import Answer
from lammps_cases.engine.workers import Failure
from lammps_cases.run import prepared_case
from lammps_cases.scene import casefile
from lammps_cases.verdict.problems import problem_of
from tests.support.printed import ENTRIES, printed, quoted, recomputes
from tests.support.small_scene import Engine, SmallScene, agree, small_scene

pytestmark = pytest.mark.lammps

# Parts of the deck of the probes, each of which occurs there once.
PRESSURE = "1 linear 2 tait/water"
FIX_PRESSURE = f"fix 3 all rheo/pressure {PRESSURE}"
KEYWORDS = "density 1.2 0.7 speed/sound 3.0 8.0"
RUN = "run 3 post no"
UNPAIRED = (("pair_style rheo 3.0", ""), ("pair_coeff * *", ""))


def with_law(lammps: Engine, text: str) -> Reply:
    """The deck with another fix rheo/pressure."""
    return lammps.reply("deck", (PRESSURE, text))


def with_keywords(lammps: Engine, text: str) -> Reply:
    """The deck with other keywords of fix rheo."""
    return lammps.reply("deck", (KEYWORDS, text))


def asking(what: str) -> tuple[str, str]:
    """The deck with a compute, and without steps."""
    return RUN, f"compute q all rheo/property/atom {what}\nrun 0 post no"


def same(one: Reply, other: Reply) -> bool:
    """Whether LAMMPS answers two decks the same, to the last bit."""
    assert (one.ended, other.ended) == ("answered", "answered"), (one.error, other.error)
    return all(np.array_equal(one.arrays[name], other.arrays[name]) for name in one.arrays)


def test_no_pressure_segfault(lammps: Engine) -> None:
    entry = ENTRIES["no-pressure-segfault"]
    missing, paired = quoted(entry.id, "observed")
    asked, unasked = asking("pressure"), (RUN, "run 0 post no")
    for ask in (asked, unasked):
        reply = lammps.reply("deck", (FIX_PRESSURE, ""), ask)
        assert reply.ended == "refused" and paired in reply.error
    reply = lammps.reply("deck", *UNPAIRED, (FIX_PRESSURE, ""), unasked)
    assert reply.ended == "refused" and missing in reply.error
    reply = lammps.reply("deck", *UNPAIRED, (FIX_PRESSURE, ""), asked)
    assert reply.ended == "crashed" and reply.error.endswith("SIGSEGV"), "nothing more, so no message"
    late = (RUN, f"{asked[1].partition(chr(10))[0]}\n{FIX_PRESSURE}\nrun 0 post no")
    assert lammps.reply("deck", *UNPAIRED, (FIX_PRESSURE, ""), late).ended == "answered"


def test_stress_without_pressure_segfault(lammps: Engine) -> None:
    entry = ENTRIES["stress-without-pressure-segfault"]
    stresses = quoted(entry.id, "observed")
    assert stresses == ["stress/t/*", "stress/t/xx"]
    for stress in stresses:
        another = (RUN, f"compute p all rheo/property/atom pressure\n{asking(stress)[1]}")
        for ask in (asking(stress), another):
            reply = lammps.reply("deck", ask)
            assert reply.ended == "crashed" and reply.error.endswith("SIGSEGV"), "nothing more, so no message"
        for words in (f"{stress} pressure", f"pressure {stress}"):
            assert lammps.reply("deck", asking(words)).ended == "answered"


def two_masses(mass: tuple[float, float], self_mass: bool = False, **options: Any) -> SmallScene:
    """Two particles at the distance and with the cutoff of the text, in 2D."""
    n = printed("self-mass-missing")
    types = [{"mass": m, "cs": 3.0, "rho0": 0.9} for m in mass]
    rheo = {"cut": float(n.cut), "rho_sum": True, "self_mass": self_mass} | options.pop("rheo", {})
    scene = {"rho": None, "compare": ["rho", "pressure"]} | options
    return small_scene([[4.0, 4.0], [4.0 + n.distance, 4.0]], (12, 12), kind=[1, 2], types=types, rheo=rheo, **scene)


@recomputes("self-mass-missing", "shared own percent", given="mass other_mass distance cut")
def test_self_mass_missing(lammps: Engine) -> dict[str, Any]:
    entry = ENTRIES["self-mass-missing"]
    command, error = quoted(entry.id, "observed")
    assert error in with_keywords(lammps, command).error
    for words in ("self/mass", "self/mass rho/sum", "rhosum self/mass", "self/mass rhosum", "rhosum"):
        assert with_keywords(lammps, words).ended == "refused"
    n = printed(entry.id)
    masses = (n.mass, n.other_mass)
    lammps_n = lammps.fields(two_masses(masses))[0]
    right = two_masses(masses, self_mass=True).predicted().fields[0]
    shared, own = lammps_n["rho"][0], right["rho"][0]
    errors = [lammps_n[name][0] - right[name][0] for name in ("pressure", "rho")]
    # p = 9 (rho - 0.9): three roundings on one side, two on the other, of the terms 9 (rho + 0.9) of both densities.
    terms = 9.0 * (lammps_n["rho"][0] + right["rho"][0] + 2 * 0.9)
    assert abs(errors[0] - 9.0 * errors[1]) <= 5 * 2.0**-53 * terms
    # The workarounds: equal masses, or no summation.
    equal = two_masses((1.5, 1.5), self_mass=True).predicted()
    assert agree(lammps.fields(two_masses((1.5, 1.5)))[0]["rho"], equal, "rho")
    given = {"rho": [0.95, 0.8], "rheo": {"rho_sum": False}, "compare": ["drho"]}
    plain = two_masses(masses, **given)
    assert agree(lammps.fields(plain)[0]["drho"], plain.predicted(), "drho")
    return {"shared": shared, "own": own, "percent": 100 * (1 - shared / own)}


def test_exclude_takes_one_range(lammps: Engine) -> None:
    entry = ENTRIES["exclude-takes-one-range"]
    command, error, *accepted = quoted(entry.id, "observed")
    assert error in with_keywords(lammps, command).error
    assert accepted == ["1", "1*2", "*"]
    for types in accepted:
        assert with_keywords(lammps, f"shift exclude/type {types}").ended == "answered"
    wanted = {1, 3}
    forms = ["*", *(form.format(m=m, n=n) for m in (1, 2, 3) for n in (1, 2, 3) for form in ("{m}", "*{n}", "{m}*"))]
    forms += [f"{m}*{n}" for m in (1, 2, 3) for n in range(m, 4)]
    assert all(set(type_range(form, 3)) != wanted for form in forms)
    # The workaround, in a fluid of three types.
    (repeated,) = quoted(entry.id, "workaround")
    x = np.random.default_rng(1).uniform(0.3, 0.7, (36, 2)) + np.indices((6, 6)).reshape(2, -1).T
    v = np.random.default_rng(2).uniform(-1, 1, (36, 2))
    options: dict[str, Any] = {"types": [{"mass": 1.0}] * 3, "kind": [1, 2, 3] * 12, "compare": ["shift/v"]}
    listed = small_scene(x, (6, 6), v, rheo={"cut": 2.6, "shift": {"exclude": ["1", "3"]}}, **options)
    one = small_scene(x, (6, 6), v, rheo={"cut": 2.6, "shift": {"exclude": ["1"]}}, **options).job
    commands = tuple(line.replace("shift exclude/type 1", repeated) for line in one.commands)
    assert sum(repeated in line for line in commands) == 1
    found = lammps.answer(replace(one, commands=commands)).snapshots[0]["q.shift/v"][:, :2]
    assert agree(found, listed.predicted(), "shift/v")
    assert set(np.flatnonzero(found.any(axis=1)) % 3) == {1}


def test_reconstruct_refuses_cubic(lammps: Engine) -> None:
    entry = ENTRIES["reconstruct-refuses-cubic"]
    (error,) = quoted(entry.id, "observed")
    rebuilt = (KEYWORDS, f"interface/reconstruct {KEYWORDS}")
    for laws in ("1 cubic 1.0 2 linear", "1 linear 2 cubic 1.0", "* cubic 1.0"):
        assert error in lammps.reply("deck", rebuilt, (PRESSURE, laws)).error
        assert with_law(lammps, laws).ended == "answered", "without interface/reconstruct"
    rho0, cs, a3 = 1.2, 3.0, 2.1
    cubic, linear = EOS("cubic", rho0, cs, a3), EOS("linear", rho0, cs)
    rho = np.linspace(0.1, 4.0, 400)
    assert np.all(np.diff(cubic.pressure(rho)) > 0)
    p = Rounded(cubic.pressure(rho), bounds.reference(cubic, rho))
    assert np.all(np.abs(cubic.density(p.value) - rho) <= rounded_eos.density(cubic, p, None).error)
    more = cs**2 * a3 * (rho - rho0) ** 3  # seven operations, the difference of the densities among them three times
    bound = p.error + bounds.reference(linear, rho) + 7 * 2.0**-53 * cs**2 * a3 * (rho + rho0) * (rho - rho0) ** 2
    assert np.all(np.abs(p.value - linear.pressure(rho) - more) <= bound)
    assert lammps.reply("deck", rebuilt, (PRESSURE, "* linear")).ended == "answered"
    for case in casefile.select(casefile.load(), entry.applies_to):
        problem = problem_of(case.scene, prepared_case.prepare(case).atoms, "", (0,))
        fields = Predictor().predict(problem).fields[0]
        assert all(np.isfinite(values).all() for values in fields.values())


def test_double_star_abort(lammps: Engine) -> None:
    entry = ENTRIES["double-star-abort"]
    *refused, message, _, _, _, _, _ = quoted(entry.id, "observed")
    aborting = quoted(entry.id, "observed")[len(refused) + 1 :]
    assert (refused, message) == (["1;2", "0*", "x"], "Invalid range string")
    assert aborting == ["**", "***", "1**2", "-", '""']
    for types in refused:
        assert f"{message}: {types}" in with_law(lammps, f"{types} linear").error
    for types in (*aborting, "1**", "**1"):
        reply = with_law(lammps, f"{types} linear")
        assert reply.ended == "crashed"
        assert "SIGABRT" in reply.error and "std::invalid_argument" in reply.error
        assert types.replace("-", "- ") not in reply.error and "rheo" not in reply.error
    for types in ("*", "*1*", "1*1**"):
        assert with_law(lammps, f"* linear {types} linear").ended == "answered", (
            "another star not right after the first"
        )


@recomputes("long-range-abort", "digits")
def test_long_range_abort(lammps: Engine) -> dict[str, Any]:
    entry = ENTRIES["long-range-abort"]
    beyond, error, long, wraps, as_if = quoted(entry.id, "observed")
    assert error in with_law(lammps, f"{beyond} linear").error
    reply = with_law(lammps, f"{long} linear")
    assert "SIGABRT" in reply.error and "std::out_of_range" in reply.error
    assert long not in reply.error and "rheo" not in reply.error
    assert (int(wraps[1:]) - int(as_if[1:])) % 2**32 == 0 and "modulo 2^32" in entry.observed
    assert same(with_law(lammps, f"{wraps} linear"), with_law(lammps, f"{as_if} linear"))
    return {"digits": len(long) - 1}


def test_hyphen_range_accepted(lammps: Engine) -> None:
    entry = ENTRIES["hyphen-range-accepted"]
    *pairs, law, alone, error = quoted(entry.id, "observed")
    hyphen = pairs[0]
    for types, read in zip(pairs[::2], pairs[1::2], strict=True):
        assert same(with_law(lammps, law.replace(hyphen, types)), with_law(lammps, law.replace(hyphen, read)))
    assert not same(with_law(lammps, law), with_law(lammps, law.replace(hyphen, "1*2")))
    assert error in with_law(lammps, alone).error
    _, *refused, message = quoted(entry.id, "argument")
    assert len(refused) == 4 and any(types.startswith("-") for types in refused)
    for types in (*refused, "-2", "*-1", "2*-1", "1-x"):
        assert f"{message}: {types}" in with_law(lammps, f"{types} linear").error
    (right,) = quoted(entry.id, "workaround")
    assert same(with_law(lammps, law.replace(hyphen, right)), with_law(lammps, "* tait/water"))


@pytest.mark.slow
def test_unknown_style_misnamed(lammps: Engine, older: Engine) -> None:
    entry = ENTRIES["unknown-style-misnamed"]
    command, error = quoted(entry.id, "observed")
    assert with_law(older, command).error.partition(" (")[0].endswith(error)
    assert "Illegal fix command, taitwater" in with_law(lammps, command).error
    for words in ("1 linear 2 taitwater", "2 taitwater 1 linear"):
        named = with_law(older, words).error.partition("command, ")[2].split()[0]
        assert words.split()[words.split().index(named) + 1] == "taitwater"


def test_specific_heat_zero(lammps: Engine) -> None:
    entry = ENTRIES["specific-heat-zero"]
    (words,) = quoted(entry.id, "observed")

    def given(text: str, law: str = "* ideal/gas 1.4") -> Reply:
        read = (RUN, f"compute q all rheo/property/atom temperature\n{RUN}")
        return lammps.reply("warm-deck", ("specific/heat * constant 0.9", text), ("* ideal/gas 1.4", law), read)

    def planar(reply: Reply, name: str) -> Any:
        return reply.arrays[name][:, :2] if name in "xv" else reply.arrays[name]

    others = ("x", "v", "rho", "pressure")
    gas = given(words)
    assert all(np.isnan(planar(gas, name)).all() for name in ("q", "esph", *others))
    for law in ("* linear", PRESSURE, "* cubic 1.0", "* tait/general 7.0"):
        ours, theirs = given(words, law), given(words.replace("0.0", "0.9"), law)
        assert all(np.isnan(ours.arrays[name]).all() for name in ("q", "esph")), law
        assert all(np.array_equal(ours.arrays[name], theirs.arrays[name]) for name in (*others, "f")), law
    assert quoted(entry.id, "documented")[0] in given(words.replace("0.0", "-1.0")).error
    assert np.isfinite(given(words.replace("0.0", "0.25")).arrays["esph"]).all(), "a positive value"


def test_examples_of_the_manual(lammps: Engine) -> None:
    (surface,) = quoted("example-surface-detection", "documented")
    (error,) = quoted("example-surface-detection", "observed")
    (repaired,) = quoted("example-surface-detection", "workaround")
    assert error in with_keywords(lammps, surface).error
    assert repaired.startswith(surface.removeprefix("shift "))
    assert with_keywords(lammps, repaired).ended == "answered"
    (rhosum,) = quoted("example-rhosum", "documented")
    (error,) = quoted("example-rhosum", "observed")
    (repaired,) = quoted("example-rhosum", "workaround")
    assert error in with_keywords(lammps, rhosum).error
    assert with_keywords(lammps, repaired).ended == "answered"
    assert "self/mass" in with_keywords(lammps, f"{repaired} self/mass").error
    for example in (surface, rhosum):  # the syntax, as the reference reads it
        with pytest.raises(InputError):
            parse_fix_rheo(f"fix rheo all rheo 3.0 quintic 0 {example}", 1)


def test_style_taitwater(lammps: Engine) -> None:
    command, error = quoted("style-taitwater", "observed")
    (style,) = quoted("style-taitwater", "workaround")
    assert error in with_law(lammps, command).error
    assert with_law(lammps, command.replace("taitwater", style.removeprefix("Write "))).ended == "answered"
    with pytest.raises(InputError):
        parse_fix_rheo_pressure(f"fix pressure all rheo/pressure {command}")
    # The syntax, as the reference reads it, has linear, tait/water, cubic and three more.
    entries = ["linear", "tait/water", "cubic 1.0", "tait/general 7.0", "ideal/gas 1.4", "background 0.5"]
    read = parse_fix_rheo_pressure(f"fix pressure all rheo/pressure {' '.join(f'* {entry}' for entry in entries)}")
    assert len(read) == 3 + 3


def test_speed_sound_count(lammps: Engine) -> None:
    (error,) = quoted("speed-sound-count", "observed")
    assert error in with_keywords(lammps, "speed/sound 1.0 3.0 8.0").error
    assert with_keywords(lammps, "speed/sound 3.0 8.0").ended == "answered"


def test_cubic_unit(lammps: Engine) -> None:
    """cubic-unit: a particle of water, compressed, in SI and cgs units; its cubic term is what the linear law lacks."""
    mass, density, velocity = 1e3, 1e-3, 1e2  # of an SI unit, in cgs units
    pressure = density * velocity**2
    assert pressure == 10.0

    def cubic_term(units: str, a3: float, m: float = 1.0, rho: float = 1.0, c: float = 1.0) -> Any:
        types = [{"mass": m, "rho0": 1000.0 * rho, "cs": 1480.0 * c}] * 2
        laws = [{"types": 1, "style": "linear"}, {"types": 2, "style": "cubic", "A3": a3}]
        x = [[2.0, 2.0], [6.0, 6.0]]
        scene = small_scene(
            x, (9, 9), rho=1020.0 * rho, kind=[1, 2], types=types, pressure=laws, compare=["pressure"], units=units
        )
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


@pytest.mark.parametrize("dimension", [2, 3])
def test_support_unit(lammps: Engine, dimension: int) -> None:
    """support-unit: by s in 2D and by s^2 in 3D."""
    cells = (7, 6) if dimension == 2 else (4, 4, 4)
    sites = np.indices(cells).reshape(dimension, -1).T + 0.5
    random = np.random.default_rng(3)
    x = sites + random.uniform(-0.2, 0.2, sites.shape)
    v = random.uniform(-1, 1, sites.shape)
    kind = random.integers(1, 3, len(sites))

    def shifted(size: float, wmin: float) -> Any:
        rheo = {"cut": 2.4 * size, "shift": {"scale_cross_type": [1.0, 0.05, wmin]}}
        types = [{"mass": size**dimension}, {"mass": size**dimension}]
        box = [size * cell for cell in cells]
        scene = small_scene(x * size, box, v * size, kind=kind, types=types, rheo=rheo, compare=["shift/v"])
        return np.any(lammps.fields(scene)[0]["shift/v"] != 0, axis=1)

    wmin = 0.35
    here = shifted(1.0, wmin)
    assert 0 < here.sum() < len(here)
    assert (shifted(2.0, wmin) != here).any()
    assert (shifted(2.0, wmin / 2.0**dimension) != here).any(), "as W scales"
    np.testing.assert_array_equal(shifted(2.0, wmin / 2.0 ** (dimension - 1)), here)


def test_data_file_of_walls(lammps: Engine) -> None:
    entry = ENTRIES["data-file-of-walls"]
    walls = {"interface_reconstruct": True}
    types = [{"mass": 1.0}, {"mass": 1.0, "phase": "solid"}]

    def through(by: str, rheo: dict[str, Any]) -> Any:
        evolve = {"steps": 1, "timestep": 1e-4, "stops": [{"at": 0, "by": by}]}
        scene = small_scene([[4.0, 4.0], [5.0, 4.0]], (9, 9), kind=[2, 1], types=types, rheo=rheo, evolve=evolve)
        return lammps.workers.outcome(lammps.workers.submit(scene.job, 60.0))

    (error,) = quoted("data-file-of-walls", "observed")
    refused = through("data", walls)
    assert isinstance(refused, Failure) and error in refused.message and entry.engine_error in refused.message
    assert isinstance(through("data", {}), Answer), "without interface/reconstruct there is no such section"
    assert quoted("data-file-of-walls", "workaround") == ["nofix"]
    assert isinstance(through("data nofix", walls), Answer)
