"""Maps of the laws: boundaries of the reference agree with theory, those of LAMMPS with its known behaviour."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from eos_ref import EOS
from eos_ref.eos import bounds
from lammps_cases.engine.workers import Workers
from lammps_cases.studies.stability import kinds, probe
from lammps_cases.studies.stability.maps import laws
from lammps_cases.studies.stability.model import FailureCriteria, Kind, MapCell, StabilityMap
from lammps_cases.studies.stability.runs import open_run
from tests.support.stability_cells import living, outcome

pytestmark = pytest.mark.slow


def around(of: StabilityMap, layer: str, y: float) -> tuple[float, float, float]:
    """Return a limit of theory, and the places one width below and above it."""
    limit = next(t for t in of.theory if t.layer in (None, layer)).x_of_y(y)
    if of.x.log:
        return limit, limit / 10**of.x.width, limit * 10**of.x.width
    return limit, limit - of.x.width, limit + of.x.width


# Kinds below and above the limit, on the reference.
WANTED: dict[tuple[str, str], tuple[Kind, Kind]] = {
    ("laws-tait-overflow", ""): ("stable", "overflow"),
    ("laws-cubic", "compressed"): ("stable", "loss of hyperbolicity"),
    ("laws-cubic", "stretched"): ("stable", "loss of hyperbolicity"),
    ("laws-cubic", "sign"): ("stable", "negative pressure"),
    ("laws-gas-energy", ""): ("negative pressure", "stable"),
    ("laws-background", "linear"): ("negative pressure", "stable"),
    ("laws-background", "tait/water"): ("negative pressure", "stable"),
}
LINES = [(of, layer, y) for of in laws.MAPS for layer in of.layers for y in of.lines if (of.id, layer) in WANTED]


@pytest.mark.parametrize(("of", "layer", "y"), LINES, ids=lambda part: getattr(part, "id", str(part)))
def test_boundaries_agree_with_theory(of: StabilityMap, layer: str, y: float) -> None:
    limit, below, above = around(of, layer, y)
    assert of.x.low < below < limit < above < of.x.high, "the axis does not reach the limit"
    found = tuple(outcome(of, x, y, layer).kind for x in (below, above))
    assert found == WANTED[of.id, layer]


@pytest.mark.parametrize("gamma", [2.3, 7.0, 60.0, 4000.0])
def test_overflow_begins_at_the_largest_double(gamma: float) -> None:
    """To 1e-12 of the exponent, not only to the width of the axis; the value is the infinite pressure."""
    limit = laws.OVERFLOW.theory[0].x_of_y(gamma)
    assert outcome(laws.OVERFLOW, limit * (1 - 1e-12), gamma).kind == "stable"
    found = outcome(laws.OVERFLOW, limit * (1 + 1e-12), gamma)
    assert (found.kind, found.atom, found.value) == ("overflow", 1, math.inf)
    assert EOS("tait/general", laws.RHO0, laws.CS, gamma).pressure(laws.RHO0 * 10 ** (limit * (1 + 1e-12))) == math.inf


@pytest.mark.parametrize(
    ("gamma", "below"),
    [
        (-1.5, "non-finite"),
        (1.4, "non-finite"),
        (2.3, "non-finite"),
        (4.0, "loss of hyperbolicity"),
        (7.0, "stable"),
    ],
)
def test_negative_densities(gamma: float, below: Kind) -> None:
    assert gamma in laws.NEGATIVE.lines
    assert outcome(laws.NEGATIVE, -0.3, gamma).kind == below
    assert outcome(laws.NEGATIVE, 0.3, gamma).kind == "stable"
    limit = laws.NEGATIVE.theory[0].x_of_y(gamma)
    assert math.isnan(limit) if below == "stable" else limit == 0


def test_gamma_of_a_gas() -> None:
    for e, above in ((-1.0, "negative pressure"), (0.5, "stable"), (2.0, "stable")):
        low = outcome(laws.GAS, 1.0, e)
        assert low.kind == "error" and "must exceed 1" in low.message
        assert outcome(laws.GAS, 1.001, e).kind == above


def test_reference_has_the_limit_of_a_vanishing_exponent() -> None:
    """P -> c^2 rho0 ln(rho/rho0), to eight digits on the whole map."""
    for ratio in laws.LIMIT.lines:
        assert all(outcome(laws.LIMIT, x, ratio).kind == "stable" for x in (1e-18, 1e-9, 1.0))
        law, rho = EOS("tait/general", laws.RHO0, laws.CS, 1e-18), laws.RHO0 * ratio
        bound = float(bounds.reference(law, rho)) + 4 * 2.0**-53 * laws.STIFFNESS * abs(math.log(ratio))
        assert abs(law.pressure(rho) - laws.STIFFNESS * math.log(ratio)) <= bound


def test_lost_digits_are_detected() -> None:
    """A pressure wrong in its ninth digit passes, in its seventh it does not; the value is the count of digits left."""
    cell = MapCell("", 0.5, 1.3)
    start = laws.LIMIT.start(cell)
    run = open_run(start, FailureCriteria(), "reference", living())
    of, look = kinds.subject(start), run.snapshot()
    for error, wanted in ((1e-9, None), (1e-7, "lost digits")):
        found = kinds.first(
            of, FailureCriteria(digits=8), replace(look, pressure_n=look.pressure_n * (1 + error)), None
        )
        assert (found and found.kind) == wanted
        if found:
            # Except for the error of the pressure itself: 1e-7 of it is 1/ln 10 of a digit.
            wrong_n = [float(bounds.reference(of.eos[1], rho)) for rho in look.rho_n.tolist()]
            own = float((wrong_n / np.abs(look.pressure_n)).max())
            assert found.value == pytest.approx(7, rel=0, abs=own / 1e-7 / math.log(10))


def test_maps_are_complete() -> None:
    assert len({of.id for of in laws.MAPS}) == len(laws.MAPS)
    for of in laws.MAPS:
        assert of.x.low < of.x.high
        assert {t.layer for t in of.theory} <= {None, *of.layers}
        for layer in of.layers:
            start = of.start(MapCell(of.id, of.x.high, of.lines[0], layer))
            assert start.steps == (0,) and not start.case.scene.interacts
            assert np.isfinite(start.atoms.rho_n).all()


@pytest.mark.lammps
@pytest.mark.parametrize(
    ("of", "x", "y", "wanted"),
    [
        (laws.OVERFLOW, 50.0, 7.0, "overflow"),
        (laws.NEGATIVE, -0.3, 2.3, "non-finite"),
        (laws.GAS, 0.9, 2.0, "negative pressure"),  # where the reference refuses
        (laws.LIMIT, 1e-12, 1.3, "lost digits"),  # where the reference has sixteen digits
    ],
    ids=lambda part: getattr(part, "id", None),
)
def test_lammps(of: StabilityMap, x: float, y: float, wanted: Kind) -> None:
    with Workers(None, 1) as workers:
        assert probe.examine(of, MapCell(of.id, x, y), "lammps", workers).outcome.kind == wanted
