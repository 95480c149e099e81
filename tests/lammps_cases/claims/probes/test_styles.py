"""The styles and keywords that LAMMPS accepts: of many words tried, only the known ones."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from lammps_cases.claims.probes.probe import Edits, edited
from lammps_cases.findings import LEDGER
from tests.support.printed import quoted
from tests.support.small_scene import Engine, engine

pytestmark = [pytest.mark.lammps, pytest.mark.slow]


def words(text: str) -> list[str]:
    """The words of a text."""
    return text.split()


# Words of the manual, of other LAMMPS styles and of the field, in other cases and spellings.
KERNELS = words(
    """
    quintic RK0 RK1 RK2 RK3 RK rk0 rk1 RK00 RK1x CRK0 CRK1 CRKSPH Quintic QUINTIC quinticx quintic/spline
    wendland wendland/c2 wendland/c4 wendland/c6 wendland/C4 Wendland/c4 WENDLAND/C4 wendland/c4x wendlandc4
    wendland/c4/RK1 cubic cubic/spline quartic gaussian super/gaussian lucy spiky poly6 spline standard shepard
    sph MLS none * 0 1 3
    """
)
LAWS = words(
    """
    linear tait/water tait/general cubic ideal/gas background taitwater tait Linear LINEAR water general gas
    ideal stiffened stiffened/gas quadratic quartic none constant * 0 lin linearx murnaghan morris birch power
    """
)
VISCOSITIES = words(
    """
    constant power Constant none newtonian bingham herschel carreau cross arrhenius type exp powerlaw casson
    """
)
SURFACES = words(
    """
    coordination divergence Coordination coord div none density color normal both curvature gradient
    """
)
THERMAL = words(
    """
    constant type none linear power Constant exp
    """
)
PROPERTIES = words(
    """
    conductivity specific/heat latent/heat Tfreeze density viscosity cv emissivity Tmelt Conductivity
    """
)
PAIR = ("artificial/visc 0.5", "rho/damp 0.1", "harmonic/means", "artificial/viscosity 0.5", "harmonic/mean")
PAIR += ("arithmetic/means", "surface/tension 1", "thermal", "laplacian/order 2", "visc 1", "damp 1", "none")


def _law(word: str) -> Edits:
    argument = " 1.7" * (word in ("tait/general", "cubic", "background"))
    return (("1 linear 2 tait/water", f"{'* linear ' * (word == 'background')}* {word}{argument}"),)


ASKED: dict[str, tuple[str, dict[str, Edits], set[str]]] = {
    "kernel": (
        "deck",
        {word: (("quintic 0", f"{word} 5"),) for word in KERNELS},
        {"quintic", "RK0", "RK1", "RK2", *quoted("kernel-wendland-c4", "observed")},
    ),
    "law": (
        "deck",
        {word: _law(word) for word in LAWS},
        {"linear", "tait/water", "tait/general", "cubic", "background"},  # ideal/gas needs other atoms
    ),
    "viscosity": (
        "deck",
        {f"{word}{' 0.1' * n}": (("* constant 0.1", f"* {word}{' 0.1' * n}"),) for word in VISCOSITIES for n in (1, 4)},
        {"constant 0.1", "power 0.1 0.1 0.1 0.1"},
    ),
    "surface": (
        "deck",
        {word: (("quintic 0", f"quintic 0 surface/detection {word} 20 8"),) for word in SURFACES},
        {"coordination", "divergence"},
    ),
    "thermal": (
        "warm-deck",
        {word: (("conductivity * constant 0.2", f"conductivity * {word} 0.2"),) for word in THERMAL},
        {"constant"},
    ),
    "property": (
        "warm-deck",
        {word: (("constant 0.9", f"constant 0.9 {word} * constant 0.2"),) for word in PROPERTIES},
        {"conductivity", "specific/heat", "Tfreeze"},  # latent/heat needs Tfreeze
    ),
    "pair": (
        "deck",
        {word: (("pair_style rheo 3.0", f"pair_style rheo 3.0 {word}"),) for word in PAIR},
        {"artificial/visc 0.5", "rho/damp 0.1", "harmonic/means"},
    ),
}


@pytest.fixture(scope="module")
def lammps() -> Iterator[Engine]:
    """The LAMMPS of this environment."""
    with engine() as opened:
        yield opened


@pytest.mark.parametrize("what", ASKED)
def test_no_other_word_is_accepted(lammps: Engine, what: str) -> None:
    """All others are refused, and none terminates LAMMPS."""
    base, asked, known = ASKED[what]
    replies = lammps.replies(*(edited(base, (*edits, ("run 3", "run 0"))) for edits in asked.values()))
    ended = {word: reply.ended for word, reply in zip(asked, replies, strict=True)}
    assert {word for word, how in ended.items() if how == "answered"} == known
    assert set(ended.values()) == {"answered", "refused"}


def test_latent_heat_alone_is_refused_by_name(lammps: Engine) -> None:
    reply = lammps.reply("warm-deck", ("constant 0.9", "constant 0.9 latent/heat * constant 0.2"))
    assert reply.ended == "refused" and "latent" in reply.error
    pair = "constant 0.9 Tfreeze * constant 0.3 latent/heat * constant 0.2"
    assert lammps.reply("warm-deck", ("constant 0.9", pair), ("run 3", "run 0")).ended == "answered"


def test_finding_lists_more_words_than_these() -> None:
    (entry,) = [entry for entry in LEDGER if entry.id == "kernel-wendland-c4"]
    assert "2000 other names" in entry.argument and len(KERNELS) == len(set(KERNELS))
