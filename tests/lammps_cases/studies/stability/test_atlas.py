"""Boundaries are bisected, engines compared, cells saved and reused."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from eos_ref import InputError
from lammps_cases.engine.session import Session
from lammps_cases.studies.stability import atlas, kinds, model
from lammps_cases.studies.stability.atlas import agreement, bisected, boundaries, places, sequence, wanted
from lammps_cases.studies.stability.maps import MAPS
from lammps_cases.studies.stability.model import (
    ENGINES,
    Atlas,
    Axis,
    CellOutcome,
    CellRun,
    Engine,
    FailureCriteria,
    Kind,
    MapCell,
    MapLine,
    StabilityMap,
)
from lammps_cases.studies.stability.probe import Examined, follow
from lammps_cases.studies.stability.runs import open_run
from tests.support.roundings import rounded
from tests.support.stability_scenes import resting, viscous

pytestmark = pytest.mark.slow

LINEAR = Axis("x", 0.0, 1.0, 0.05)
LOG = Axis("x", 0.01, 100.0, 0.1, log=True)


def plain(axis: Axis = LINEAR, coarse: int = 4, **more: object) -> StabilityMap:
    made = StabilityMap(
        "m", "", "", axis, LINEAR, (0.0, 1.0), lambda cell: resting(1), lambda cell: FailureCriteria(), coarse=coarse
    )
    return replace(made, **more)


def kinds_along(of: StabilityMap, kind: Callable[[float], Kind]) -> dict[float, Kind]:
    known: dict[float, Kind] = {}
    while asked := wanted(of, known):
        known |= {x: kind(x) for x in asked}
    return known


# --- lines


@pytest.mark.parametrize("axis", [LINEAR, LOG])
def test_places_are_evenly_spaced_and_include_the_ends(axis: Axis) -> None:
    found = places(axis, 5)
    assert (found[0], found[-1]) == (axis.low, axis.high)
    gaps = np.diff(np.log10(found) if axis.log else found)
    assert gaps == rounded([gaps[0]] * 4, 8, terms=float(np.abs(np.log10(found) if axis.log else found).max()))


@pytest.mark.parametrize("axis", [LINEAR, LOG])
@settings(deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_boundaries_are_found_to_the_width_in_order(axis: Axis, data: st.DataObject) -> None:
    """Kinds change at some edges, at most one between two coarse places; each edge is found, with few cells."""
    gaps = data.draw(st.lists(st.floats(0.05, 0.95), min_size=1, max_size=3))
    low, high = axis.coordinate(axis.low), axis.coordinate(axis.high)
    edges = [low + (high - low) * (k + gap) / 3 for k, gap in enumerate(gaps)]
    ends: list[Kind] = ["stable", "overflow", "stable", "clumping"]
    known = kinds_along(plain(axis), lambda x: ends[int(np.searchsorted(edges, axis.coordinate(x), side="right"))])
    assert sequence(known) == tuple(ends[: len(edges) + 1])
    found = boundaries(MapLine("m", "", 0.0, "lammps"), known)
    for k, (b, edge) in enumerate(zip(found, edges, strict=True)):
        assert axis.coordinate(b.low) < edge <= axis.coordinate(b.high)
        assert (b.below, b.above) == (ends[k], ends[k + 1])
        assert axis.width * (0.5 - 1e-9) <= axis.coordinate(b.high) - axis.coordinate(b.low) <= axis.width
    assert len(known) <= 4 + len(edges) * np.ceil(np.log2((high - low) / 3 / axis.width))


def test_third_kind_found_by_bisection_gets_both_edges() -> None:
    known = kinds_along(plain(), lambda x: "stable" if x < 0.4 else "overflow" if x < 0.55 else "clumping")
    assert sequence(known) == ("stable", "overflow", "clumping")


@pytest.mark.parametrize(
    ("edge", "verdict"), [(0.39, "same"), (0.43, "same"), (0.53, "differs"), (0.25, "differs"), (2.0, "differs")]
)
def test_engines_agree_within_the_width(edge: float, verdict: str) -> None:
    of = plain()
    ours, theirs = (kinds_along(of, lambda x, e=e: "stable" if x < e else "overflow") for e in (0.39, edge))
    found = agreement(of, "", 0.0, ours, theirs)
    assert found.verdict == verdict
    assert [len(side) for side in found.boundaries] == [1, 0 if edge > 1 else 1]


def test_different_kinds_at_the_same_place_differ() -> None:
    of = plain()
    ours, theirs = (kinds_along(of, lambda x, k=k: "stable" if x < 0.4 else k) for k in ("overflow", "non-finite"))
    assert agreement(of, "", 0.0, ours, theirs).verdict == "differs"
    ours, theirs = ({0.0: k, 1.0: k} for k in ("stable", "error"))
    assert agreement(of, "", 0.0, ours, theirs).verdict == "differs"


# --- a survey without LAMMPS


@dataclass
class Later:
    """A cell that is examined in its own thread."""

    future: Future[Examined]


class Threads:
    """An examiner that answers in random order; the second engine is the reference with a planted fault."""

    def __init__(self, fault: float = 1.0, delays: int = 0) -> None:
        self.random, self.factor, self.asked = np.random.default_rng(delays), fault, 0

    def ask(self, of: StabilityMap, cell: MapCell, side: Engine) -> Later:
        self.asked += 1
        later = Later(Future())
        faulty = viscous(self.factor if side == "lammps" else 1.0)
        start, watch = faulty.start(cell), of.watch(cell)

        def work() -> None:
            run = partial(open_run, start, watch, "reference", Session())
            later.future.set_result(follow(run, kinds.subject(start), watch, start.steps[-1]))

        threading.Timer(float(self.random.uniform(0, 0.01)), work).start()
        return later

    def settle(self, asked: Later) -> Examined:
        return asked.future.result()

    def key(self, of: StabilityMap, cell: MapCell, side: Engine) -> str:
        return f"{cell} {side}"


def surveyed(source: Threads, out: Path) -> Atlas:
    of = viscous(1.0)
    lines = [MapLine(of.id, "", y, side) for y in of.lines for side in ENGINES]
    out.mkdir(exist_ok=True)
    kept = model.cells(out)
    with ThreadPoolExecutor(2) as threads:
        runs = threads.map(lambda line: bisected(of, line, source, source.key, kept, out), lines)
        found = dict(zip(lines, runs, strict=True))
    return Atlas("", {}, {}, False, 0.0, (atlas.map_record(of, False, found, ENGINES),))


def test_second_survey_examines_nothing_and_the_order_of_answers_does_not_matter(tmp_path: Path) -> None:
    """An engine agrees with itself. A killed survey loses only the cells that were not written."""
    first, other = (surveyed(Threads(delays=k), tmp_path / str(k)).maps for k in (1, 2))
    [found] = first[0].agreement
    assert (found.verdict, found.reference) == ("same", ("stable", "energy growth"))
    assert {ran.engine for ran in first[0].cells} == set(ENGINES)
    kept = [{part.key: part.result for part in model.cells(tmp_path / str(k)).journal.entries()} for k in (1, 2)]
    assert (first, kept[0]) == (other, kept[1])
    file = tmp_path / "1" / "cells.jsonl"
    lines = file.read_bytes().splitlines(keepends=True)
    for asked, content in ((0, lines), (3, [*lines[:-3], lines[-3][:40]])):
        file.write_bytes(b"".join(content))
        again = Threads()
        assert surveyed(again, tmp_path / "1").maps == first
        assert again.asked == asked
    assert len({one.key for one in model.cells(tmp_path / "1").journal.entries()}) == len(lines)


def test_wrong_viscosity_differs(tmp_path: Path) -> None:
    """A viscosity twice as large halves the limit of the time step."""
    whole = surveyed(Threads(2.0), tmp_path)
    [found] = whole.maps[0].agreement
    assert found.verdict == "differs"
    assert whole.disagreements == [found]
    ours, theirs = found.boundaries
    assert theirs[0].low < ours[0].high / 2 < theirs[0].high * 1.13


# --- a whole atlas, with LAMMPS


@pytest.fixture(scope="module")
def small() -> list[StabilityMap]:
    return [
        replace(MAPS["laws-tait-negative"], lines=(2.3, 4.0)),
        replace(viscous(1.0), x=Axis("step", 3.0, 6.0, 0.1)),
    ]


@pytest.mark.lammps
def test_atlas_is_measured_saved_and_reused(tmp_path: Path, small: list[StabilityMap]) -> None:
    first = atlas.measure(small, tmp_path, "test")
    kept = (tmp_path / "cells.jsonl").read_bytes()
    assert kept.count(b"\n") == sum(len(m.cells) for m in first.maps)
    assert repr(model.DOCUMENT.read(tmp_path / "atlas.json")) == repr(first)  # NaN is not equal to itself
    assert [a.verdict for m in first.maps for a in m.agreement] == ["same"] * 3
    states = {model.state_file(tmp_path, r.cell, r.engine) for r in first.maps[1].cells if r.outcome.kind != "stable"}
    assert states == set((tmp_path / "states").glob("*.npz"))
    failed = next(r for r in first.maps[1].cells if r.outcome.kind == "energy growth")
    before = model.read_state(tmp_path, failed.cell, failed.engine)
    assert before is not None
    assert before["failing"].tolist() == [failed.outcome.atom]
    assert before["x"].shape == (100, 2) and int(before["step"]) == (failed.outcome.step or 0) - 1

    table = (tmp_path / "cells.csv").read_bytes()
    again = atlas.measure(small, tmp_path, "test")
    assert (tmp_path / "cells.jsonl").read_bytes() == kept  # no cell was run again
    assert (tmp_path / "cells.csv").read_bytes() == table
    assert repr(again.maps) == repr(first.maps)

    other = [replace(small[0], start=lambda cell: MAPS["laws-tait-negative"].start(replace(cell, y=cell.y + 1)))]
    stale = atlas.measure(other, tmp_path, "test")
    grown = (tmp_path / "cells.jsonl").read_bytes()
    assert grown.count(b"\n") - kept.count(b"\n") == len(stale.maps[0].cells)


def test_file_of_another_kind_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        model.DOCUMENT.read(tmp_path / "atlas.json")
    (tmp_path / "atlas.json").write_text("{}")
    with pytest.raises(InputError, match="eos-ref/stability/1"):
        model.DOCUMENT.read(tmp_path / "atlas.json")


def test_numbers_outside_json_round_trip(tmp_path: Path) -> None:
    ran = CellRun(MapCell("m", 0.1, 1.0), "lammps", CellOutcome("overflow", 3, 5, float("inf")))
    model.cells(tmp_path).add("k", ran)
    assert model.cells(tmp_path).get("k") == ran
