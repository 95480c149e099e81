"""Findings about sentences of the pages, measured by probes: what the numbers in their documents do not show."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lammps_cases.claims.probes.probe import edited
from lammps_cases.claims.probes.run import Reply
from tests.support.printed import Printed, printed, quoted, recomputes, works_around
from tests.support.recomputed import probe_of, w
from tests.support.roundings import rounded
from tests.support.small_scene import Engine, engine

pytestmark = pytest.mark.lammps

NUMBER = r"\d+(?:\.\d+)?"  # as docs/accuracy.md prints it


def put(lammps: Engine, id: str, *more: tuple[str, str]) -> Reply:
    """The reply to a probe, edited further."""
    return lammps.reply(probe_of(id).base, *probe_of(id).edits, *more)


def found(lammps: Engine, id: str) -> float:
    """The number that a probe measures."""
    reply = put(lammps, id)
    assert reply.ended == "answered", reply.error
    return float(reply.arrays["found"][0])


@recomputes("force-per-volume", given="volume speed c")
def test_sound_of_force_per_volume(lammps: Engine) -> dict[str, Any]:
    """The speed is c over the root of the volume, to the accuracy of the measurement."""
    n = printed("force-per-volume")
    reply = put(lammps, "sound.linear")
    within = float(reply.arrays["within"][0]) / n.c
    assert abs(float(reply.arrays["found"][0]) / n.speed - 1) <= within
    assert float(reply.arrays["expected"][0]) == n.c

    def travels(spacing: float) -> float:
        edits = (
            ("lattice sq 1.5625", f"lattice sq {spacing**-2}"),
            ("mass 1 0.832", f"mass 1 {1.3 * spacing**2}"),
            ("pair_style rheo 2.4", f"pair_style rheo {3 * spacing}"),
            ("rheo 2.4 quintic", f"rheo {3 * spacing} quintic"),
            ("timestep 0.008", f"timestep {0.01 * spacing**2}"),
        )
        return float(lammps.reply("wave", *edits).arrays["found"][0] / n.c)

    assert abs(travels(1.0) - 1) <= within, "at a volume of 1 it is right"
    page = (Path(__file__).parents[3] / "docs" / "accuracy.md").read_text()
    measured = re.search(rf"spacings of {NUMBER} travels at ({NUMBER}) c, of ({NUMBER}) in 2D .*at ({NUMBER}) c,", page)
    assert measured
    unit, spacing, fine = map(Printed, measured.groups())
    assert unit.is_rounded(travels(1.0)) and fine.is_rounded(travels(spacing))
    assert abs(fine * spacing - 1) <= within + fine.half_unit, "c over the root of the volume"
    return {}


@works_around("kernel-corrects-gradients-only", 2)
@recomputes("kernel-corrects-gradients-only", "rho", given="force none")
def test_kernel_corrects_gradients_only(lammps: Engine) -> dict[str, Any]:
    n = printed("kernel-corrects-gradients-only")
    assert found(lammps, "order-zero.rk0") > n.force and found(lammps, "order-zero.rk1") < n.none
    summed = probe_of("sum-of-constant.rk1").edits
    without = lammps.reply("field", *(edit for edit in summed if "rho/sum" not in edit[1]))
    assert float(without.arrays["found"][0]) == 0, "without rho/sum"
    both = [
        lammps.reply("deck", ("quintic 0", f"{kernel} 0"), ("pair_style rheo 3.0", "pair_style rheo 3.0 rho/damp 0.1"))
        for kernel in ("quintic", "RK0")
    ]
    assert all(np.array_equal(both[0].arrays[name], both[1].arrays[name]) for name in both[0].arrays)
    return {"rho": 1.2}


@works_around("no-mass-diffusion", 1)
@recomputes("no-mass-diffusion", given="damping steps")
def test_no_mass_diffusion(lammps: Engine) -> dict[str, Any]:
    n = printed("no-mass-diffusion")
    assert f"rho/damp {n.damping}" in " ".join(new for _, new in probe_of("density-diffuses-damped").edits)
    assert f"run {int(n.steps)} " in probe_of("density-diffuses").edits[-1][1]
    # Each step rounds densities of 1.1 and rates that are 0 up to rounding; the profile is a third as high.
    assert abs(found(lammps, "density-diffuses")) < n.steps * 1.1 * 3 * 2 * 2.0**-52
    return {}


@works_around("bonds-across-boundary", 1, 2)
@recomputes("bonds-across-boundary", "along between all before printed", given="row")
def test_bonds_across_a_boundary(lammps: Engine) -> dict[str, Any]:
    """LAMMPS' count and that of its list, periodic or not, on the last engine of the earlier kind and on this one."""
    cells = printed("bonds-across-boundary").row
    along, between = 3 * cells, 2 * cells
    fixed, counted = ("boundary p f p", "boundary f f p"), probe_of("thermal-react-count").edits[0]
    with engine("pypi:2025.7.22.0.2") as old:
        numbers = [
            [float(each.reply("frost", *edits).arrays["found"][0]) for edits in ((), (fixed,), (counted,))]
            for each in (old, lammps)
        ]
    (before, *_), (*_, doubled) = numbers
    assert numbers == [[before, before, 0], [along + between, before, doubled]]
    assert float(lammps.reply("frost", fixed, counted).arrays["found"][0]) == before, "away from periodic boundaries"
    assert found(lammps, "thermal-react-melting") == 0 and doubled == along + between + 3
    return {"along": along, "between": between, "all": along + between, "before": before, "printed": doubled}


@recomputes("solids-summed", "summed pressure own mass distance cut c", given="given")
def test_solids_summed(lammps: Engine) -> dict[str, Any]:
    reply = lammps.reply("wall-pair", probe_of("solid-density-summed").edits[0])
    return {
        "summed": (reply.arrays["rho"][0], w(0.0, 3.0) + w(1.0, 3.0)),
        "pressure": reply.arrays["pressure"][0],
        "own": 2.0**2 * (printed("solids-summed").given - 1),
        **{"mass": 1.0, "distance": 1.0, "cut": 3.0, "c": 2.0},
    }


@works_around("shell-softens", 1)
@recomputes("shell-softens", given="documented observed")
def test_shell_softens(lammps: Engine) -> dict[str, Any]:
    n, relative = printed("shell-softens"), 0.2 / 0.5  # of the probe's bond: r0 = k = 1, eps = 0.5, at r = 1.2
    within = float(put(lammps, "shell-force").arrays["within"][0])  # derived there
    assert found(lammps, "shell-force") == pytest.approx(0.4 * (1 - relative**2), abs=within)
    assert n.observed.is_rounded(found(lammps, "shell-force"))
    assert n.documented.is_rounded(0.4 * (1 + relative**2))
    pushed = float(put(lammps, "shell-force", ("move 0.2", "move -0.2")).arrays["found"][0])
    assert pushed == pytest.approx(-found(lammps, "shell-force"), abs=within), "under compression"
    at_the_end = float(put(lammps, "shell-force", ("move 0.2", "move 0.499999")).arrays["found"][0])
    assert 0 < at_the_end < 1e-5, "the force vanishes"
    return {}


@works_around("shells-shift", 1)
def test_shells_shift(lammps: Engine) -> None:
    """Particles of a shell are shifted by a length; a run without the keyword shifts nothing."""
    assert found(lammps, "shell-shift") > 0.01
    assert "shift" not in " ".join(edited("oxide", ())) and lammps.reply("oxide").ended == "answered"


@works_around("shell-time-refused", 1)
def test_shell_time_refused(lammps: Engine) -> None:
    """The bonds of the last layer are counted."""
    assert float(lammps.reply("oxide").arrays["found"][0]) == 1


@recomputes("special-bonds-remove-pairs", given="left all")
def test_special_bonds_remove_pairs(lammps: Engine) -> dict[str, Any]:
    """Of two bonded particles and a third one; and of chains, whose ends are two and three bonds apart."""
    name, default = "special-bonds-remove-pairs", "lj 0 1 1 coul 0 1 1"
    left, all_ = vars(printed(name))["left"], vars(printed(name))["all"]

    def neighbours(*edits: tuple[str, str]) -> list[float]:
        return [float(count) for count in lammps.reply("bonded", *edits).arrays["q"]]

    bonds, one = quoted(name, "argument")
    assert bonds == f"special_bonds {default}" and f"{bonds[:-10]}{one}" in quoted(name, "workaround")
    assert neighbours() == [left, left, all_]
    assert neighbours((default, f"lj 0 1 1 {one}")) == [all_] * 3
    four = (("5.5 7 0 units box", "5.5 7 0 units box\ncreate_atoms 1 single 6.5 7 0 units box"),)
    four += (("bond 1 1 2", "bond 1 1 2\ncreate_bonds single/bond 1 2 3\ncreate_bonds single/bond 1 3 4"),)
    four += (("extra/bond/per/atom 1 extra/special/per/atom 2", "extra/bond/per/atom 2 extra/special/per/atom 9"),)
    chain = {"0 1 1": [2, 1, 1, 2], "1 0 1": [2, 2, 2, 2], "1 1 0": [2, 3, 3, 2], "0 0 0": [0] * 4}
    for weights, expected in chain.items():
        assert neighbours(*four, (default, f"lj {weights} coul {weights}")) == expected, weights
    assert neighbours(*four, (f"special_bonds {default}", "")) == [0] * 4, "the default"
    assert neighbours(*four, (default, "lj 0 0 0 coul 1 1 1")) == [3] * 4
    return {}


@recomputes("wall-density-stored", "rho0", given="thinner least")
def test_wall_density_stored(lammps: Engine) -> dict[str, Any]:
    """Next to a fluid that is thinner still, a tenth of rho0; the pressure reported belongs to the density reported."""
    n, below = printed("wall-density-stored"), put(lammps, "solid-density-floor")
    assert below.arrays["pressure"][0] == rounded(4 * (n.reported - 1), 3, terms=4 * (n.reported + 1))
    assert n.least == 0.1
    for equilibrium in (1.0, 2.0):
        scales = ("density 1.0 1.0", f"density {equilibrium} {equilibrium}")
        for law in ("* linear", "* tait/water", "* tait/general 1.4"):
            edits = (scales, ("rheo/rho 0.8", f"rheo/rho {equilibrium}\nset atom 2 rheo/rho {n.thinner * equilibrium}"))
            far = lammps.reply("wall-pair", *edits, ("* linear", f"2 linear 1 linear 1 background -9 2 {law[2:]}"))
            assert far.arrays["rho"][0] == rounded(n.least * equilibrium, 1), law
    return {"rho0": 1.0}


@works_around("wall-density-stored", 1)
def test_a_density_set_again_after_interface_reconstruct(lammps: Engine) -> None:
    """After the keyword is gone, and before the run without it."""
    own = printed("wall-density-stored").own
    fixes = [line for line in edited("wall-pair", ()) if line.startswith("fix") and "rheo" in line]
    without = [*(f"unfix {k}" for k in (3, 2, 1)), *fixes]
    for again, density in ((f"\nset atom 1 rheo/rho {own}", own), ("", 1.2)):
        lines = "\n".join(without).replace(" interface/reconstruct", "") + again
        reply = put(lammps, "solid-density-temporary", ("run 0 post no", f"run 0 post no\n{lines}\nrun 3 post no"))
        assert reply.arrays["rho"][0] == rounded(density, 1)


@works_around("wall-density-stored", 2)
@recomputes("walls-attract", "fluid c", given="rho solid")
def test_walls_attract(lammps: Engine) -> dict[str, Any]:
    n = printed("walls-attract")
    assert n.solid == 0
    limited, free = put(lammps, "walls-do-not-attract"), lammps.reply("wall-pair", ("interface/reconstruct", ""))
    forces = [reply.arrays["f"][1, 1] for reply in (limited, free)]
    assert forces[1] < forces[0] < 0
    # without the limit the solid has its own density, and both pressures are the fluid's
    volumes = n.rho / 1.0  # that of the solid, at rho0 in place of rho
    assert forces[0] / volumes == rounded(forces[1] / 2, 16)
    raised = lammps.reply("wall-pair", ("* linear", "* linear * background 1.0"))
    assert raised.arrays["f"][1, 1] > 0, "the workaround"
    return {"fluid": 2.0**2 * (n.rho - 1), "c": 2.0}


@works_around("gas-without-work", 1)
def test_gas_without_work(lammps: Engine) -> None:
    n, reply = printed("gas-without-work"), put(lammps, "sound-gas-adiabatic")
    assert abs(n.seen - math.sqrt((n.gamma - 1) * n.e)) < float(reply.arrays["within"][0])
    assert np.all(reply.arrays["esph"] == reply.arrays["esph"][0]), "no energy has changed"


def test_rmin_unit() -> None:
    """rmin-unit: the newer manual has a deck of its own; the dimensions of the sum are derived elsewhere."""
    assert probe_of("rheo-unit-rmin").since == "2026.7.4"


def test_gas_on_other_atoms(lammps: Engine) -> None:
    style, error = quoted("gas-on-other-atoms", "observed")[0], quoted("gas-on-other-atoms", "argument")[0]
    assert f"atom_style {style}" in probe_of("pressure-gas-hybrid").edits[0][1]
    reply = put(lammps, "pressure-gas-hybrid", ("run 3", "run 0"))
    mass_n = np.where(reply.arrays["type"] == 1, 1.25, 0.75)
    by_hand = 0.4 * reply.arrays["rho"] * 1.5 / mass_n  # gamma - 1 and three operations, on either side
    np.testing.assert_allclose(reply.arrays["pressure"], by_hand, rtol=2 * 4 * 2.0**-53)
    assert error in lammps.reply("deck", ("1 linear 2 tait/water", "* ideal/gas 1.4")).error


@recomputes("wall-density-shared", given="cut part whole before after rho0")
def test_wall_density_shared(lammps: Engine) -> dict[str, Any]:
    n, reply = printed("wall-density-shared"), put(lammps, "solid-density-of-every-pair")
    assert n.distance > n.cut
    grown = float(reply.arrays["found"][0] / reply.arrays["expected"][0])
    assert grown == rounded(1 + n.part / n.whole, 100)
    # The solid has the mean of both densities, and so the sum of both pressures over its volume grows.
    mean = (n.before + n.after) / 2
    sums = (n.before + mean - 2 * n.rho0) / mean, (2 * n.before - 2 * n.rho0) / n.before
    assert grown == rounded(sums[0] / sums[1], 100)
    return {}
