"""State that LAMMPS does not hold as given or loses at a stop: what is compared, and that no finding explains it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eos_ref.eos.bounds import EPS
from eos_ref.model.box import Box
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.engine.interlude import Carried
from lammps_cases.engine.session import Answer
from lammps_cases.findings import LEDGER
from lammps_cases.records.case_parts import Beyond, Blame
from lammps_cases.records.run_record import CaseRecord, EngineRecord
from lammps_cases.run.prepared_case import PreparedCase, prepare
from lammps_cases.scene import casefile
from lammps_cases.scene.atoms import kernel_cut
from lammps_cases.verdict.cases import BY_IMAGES, compare_carried, compare_case, first_step, prefer_input
from lammps_cases.verdict.particle_model import Reason
from lammps_cases.verdict.problems import problem_of
from tests.support import made_answers
from tests.support.roundings import rounded

Write = Callable[..., Path]
STATE: dict[str, Any] = {
    "id": np.arange(1, 21),
    "type": np.ones(20, int),
    "x": np.linspace(0.5, 2.0, 60).reshape(20, 3) * [1, 1, 0],
    "v": np.linspace(-1.0, 1.5, 60).reshape(20, 3),
    "rho": np.linspace(0.9, 1.4, 20),
    "rheo_status": np.arange(20) % 4,
}
HALF = 0.5e-15 + 2.0**-53  # half a unit of the 16th digit, relative to a number of one, and the rounding by reading it
TEXT = "half a unit of the 16th digit of the text"


def stopped(case_file: Write, *stops: dict[str, Any], **changes: Any) -> PreparedCase:
    run = {"steps": 3, "timestep": 0.001, "stops": list(stops)}
    return prepare(casefile.load((case_file(**{"compare": ["f"], "evolve": run} | changes),))[0])


def carried_over(ready: PreparedCase, *carried: Carried) -> list[Any]:
    """Return the comparisons of states before and after stops, with their steps."""
    of = problem_of(ready.case.scene, ready.atoms, "", ready.case.scene.snapshots)
    return compare_carried(ready.case, ready.atoms, Answer({}, 0.0, carried=carried), 16, of)


def compared(
    case_file: Write, *stops: dict[str, Any], before: dict[str, Any] | None = None, after: dict[str, Any] | None = None
) -> dict[str, tuple[Any, ...]]:
    """Return verdict, derivation and bound of the fields after stops, in which only ``after`` has changed."""
    state = STATE | (before or {})
    found = carried_over(stopped(case_file, *stops), *(Carried(state, state | (after or {})) for _ in stops))
    assert {comparison.record.stage for _, comparison in found} <= {"input"}
    return {c.record.field: (c.record.verdict, c.record.derivation, c.bound_n.max()) for _, c in found}


def test_state_in_a_binary_file_has_the_same_bits(case_file: Write) -> None:
    names = ("type", "x", "v", "rho", "rheo_status")
    binary = compared(case_file, {"at": 0, "by": "restart"}, {"at": 2, "by": "run"})
    stops = ("restart at 0", "run at 2")
    assert binary == {f"{name} ({stop})": ("exact", "the same doubles", 0.0) for stop in stops for name in names}
    assert compared(case_file, {"at": 1, "by": "data nofix"}) == {
        f"{name} (data nofix at 1)": ("exact", TEXT, rounded(HALF * np.abs(STATE[name]).max(), 2)) for name in names
    }


EDGE = 4.0  # edge of the box, from 0, along x


@pytest.mark.parametrize(
    ("by", "units", "verdict"),
    [("replicated", 1, "pass"), ("replicated", 3, "differs"), ("data", 7, "pass"), ("data", 9, "differs")],
)
def test_particle_outside_the_box_may_return_as_its_image(case_file: Write, by: str, units: int, verdict: str) -> None:
    """Two sums with a period round 4.3 by 2^-53 each, text by 2^-53 and half its 16th digit: 2.2, 8.1 units of 3.7."""
    left, back = STATE["x"].copy(), STATE["x"].copy()
    left[3, 0] = -0.3
    back[3, 0] = left[3, 0] + EDGE
    back[3, 0] += units * np.spacing(back[3, 0])
    fields = compared(case_file, {"at": 1, "by": by}, before={"x": left}, after={"x": back})
    assert fields[f"x ({by} at 1)"][0] == verdict


@pytest.mark.parametrize("axis", [0, 1])
def test_image_rounds_by_the_size_of_edges_along_its_axis(case_file: Write, axis: int) -> None:
    """All edges count: here one of 1, and one tilted over it by 0.25."""
    ready = stopped(case_file, {"at": 1, "by": "replicated"})
    box = Box((0.0, 0.0, 0.0), (1.0, 2.0, 1.0), (True, True, False), (0.25, 0.0, 0.0))
    after = np.full((20, 3), [0.5, 1.0, 0.0])
    before = after + box.cell_cc[axis] * (np.arange(20) == 3)[:, None]
    plane = Box((0.0, 0.0), (1.0, 2.0), (True, True), (0.25,))
    of = replace(problem_of(ready.case.scene, ready.atoms, "", ready.case.scene.snapshots), box=plane)
    carried = Carried({"x": before}, {"x": after})
    ((_, field),) = compare_carried(ready.case, ready.atoms, Answer({}, 0.0, carried=(carried,)), 16, of)
    assert field.record.verdict == "exact"
    reach_nc = np.zeros((20, 2))
    reach_nc[3, axis] = before[3, axis] + (1.25, 2.0)[axis]
    rounding_c = box.rounding(kernel_cut(ready.case.scene, ready.atoms.spacing))[:2]
    np.testing.assert_array_equal(field.bound_n, EPS * reach_nc + rounding_c)


@pytest.mark.parametrize(("dimension", "verdict"), [(2, "exact"), (3, "differs")])
def test_rounding_along_z_is_ignored_in_2d(case_file: Write, dimension: int, verdict: str) -> None:
    ready = stopped(case_file, {"at": 1, "by": "data"})
    scene = ready.case.scene.model_copy(update={"dimension": dimension})
    ready = replace(ready, case=replace(ready.case, scene=scene))
    off = Carried({"x": STATE["x"] - [0, 0, 2.0**-54]}, {"x": STATE["x"]})
    ((_, field),) = carried_over(ready, off)
    assert field.record.verdict == verdict


@pytest.mark.parametrize("name", ["sheared.fluid.leaning", "sheared-3d.open.leaning"])
@pytest.mark.parametrize("at", [0, 1], ids=["upright yet", "leaning"])
@pytest.mark.parametrize(("part", "verdict"), [(0.9, "pass"), (1.1, "differs")])
def test_positions_in_a_tilted_box_round_as_fractions(name: str, at: int, part: float, verdict: str) -> None:
    """Inside the box they may differ by up to `Box.rounding`, also while the tilt is 0."""
    ready = prepare(casefile.select(casefile.load(), [name])[0])
    scene, atoms = ready.case.scene, ready.atoms
    assert scene.evolve is not None
    stops = (scene.evolve.stops[0].model_copy(update={"at": at, "by": "run"}),)
    scene = scene.model_copy(update={"evolve": scene.evolve.model_copy(update={"stops": stops})})
    ready = replace(ready, case=replace(ready.case, scene=scene))
    around = problem_of(scene, atoms, "", scene.snapshots).box_before(at)
    assert any(around.tilt) == bool(at)
    box = Box((*around.low_c, 0.0)[:3], (*around.high_c, 1.0)[:3], (True,) * 3, (*around.tilt, 0.0, 0.0)[:3])
    x_nc = 0.5 * (np.array(box.low_c) + np.array(box.high_c)) * np.ones((len(atoms), 1))
    d, spread_c = scene.dimension, box.rounding(kernel_cut(scene, atoms.spacing))
    x_nc[:, d:] = 0.0
    moved_nc = x_nc + part * spread_c * (np.arange(3) < d)
    ((step, field),) = carried_over(ready, Carried({"x": x_nc}, {"x": moved_nc}))
    assert (step, field.record.verdict) == (at, verdict)
    assert field.record.derivation == f"the same doubles{BY_IMAGES}"


@pytest.mark.parametrize("moves", [{"displace": {"x": 0.1}}, {"stretch": {"x": 1.1}}])
def test_positions_are_not_compared_if_the_stop_moves_particles(case_file: Write, moves: Any) -> None:
    fields = compared(case_file, {"at": 1, "by": "run"} | moves)
    assert list(fields) == [f"{name} (run at 1)" for name in ("type", "v", "rho", "rheo_status")]


def nudged(name: str) -> Any:
    """Return values of which one has changed by one unit of its last place."""
    changed = STATE[name].copy()
    changed.reshape(20, -1)[3, 0] = np.nextafter(changed.reshape(20, -1)[3, 0], np.inf)
    return changed


@pytest.mark.parametrize(
    ("by", "name", "after", "seen"),
    [
        *(("restart", name, nudged(name), True) for name in ("x", "v", "rho")),
        ("restart", "type", STATE["type"] + 1, True),
        ("data", "rho", STATE["rho"] * (1 + 2.0**-52), False),  # half a unit of the 16th digit is 2.3 x 2^-52, or more
        ("data", "rho", STATE["rho"] * (1 + 4 * 2.0**-52), True),
        ("replicated", "x", nudged("x"), True),  # inside the box nothing may move
        # The phase is the first bit of LAMMPS' status; the others follow from the next evaluation.
        *((by, "rheo_status", STATE["rheo_status"] ^ 1, True) for by in ("restart", "data", "set", "recreated")),
        *((by, "rheo_status", STATE["rheo_status"] ^ 2, True) for by in ("restart", "data")),
        *((by, "rheo_status", STATE["rheo_status"] ^ 2, False) for by in ("set", "recreated")),
    ],
)
def test_state_after_a_stop_equals_the_one_before(case_file: Write, by: str, name: str, after: Any, seen: bool) -> None:
    fields = compared(case_file, {"at": 1, "by": by}, after={name: after})
    assert [field for field, (verdict, *_) in fields.items() if verdict == "differs"] == [f"{name} ({by} at 1)"] * seen


@pytest.mark.parametrize("stops", [0, 2])
def test_answers_with_other_stops_raise(case_file: Write, stops: int) -> None:
    """An answer with a stop missing, or with an extra one, is a fault of the harness, never a pass."""
    with pytest.raises(ValueError, match="zip"):
        carried_over(stopped(case_file, *({"at": at} for at in range(stops))), Carried(STATE, STATE))
    assert carried_over(stopped(case_file, evolve=None)) == []


# --- what a difference is blamed on

KNOWN = EngineRecord(distribution="2025.7.22.4.0")
FORCE = next(entry for entry in LEDGER if entry.id == "force-per-volume")


def at(step: int | None, field: str = "f") -> Blame:
    """Return a first difference at a step."""
    return Blame(field=field, stage="input", step=step, atom=7, lammps=2.0, reference=1.0, bound=0.5, outside=1, of=9)


def reason(step: int | None, left: int | None = None, explained: bool = False) -> Reason:
    """Return the reason for a difference from a step on, explained by a finding, or explained up to another step."""
    beyond = None if left is None else Beyond(findings=["one"], blame=at(left))
    return Reason(at(step), beyond, [FORCE] if explained else [])


ALONE = ()


@pytest.mark.parametrize(
    ("of", "step", "known"),  # the findings that the input is new with; None: it changes nothing
    [
        (None, 3, ALONE),
        (reason(3), 3, ALONE),  # input precedes its consequences
        (reason(3), 2, ALONE),
        (reason(0, left=0), None, ALONE),
        (reason(None), 0, ALONE),
        (reason(3, explained=True), 3, ALONE),
        (reason(3, left=5), 1, ALONE),
        (reason(3), 4, None),
        (reason(0), 1, None),
        (reason(2, left=4), 5, None),
        (reason(0, left=0), 1, None),
        (reason(None, left=0), 1, None),
        (reason(2, left=7), 5, ["one"]),
        (reason(2, left=5), 5, ["one"]),
        (reason(2, explained=True), 5, ["force-per-volume"]),
        (reason(2, left=7, explained=True), 5, ["one"]),
    ],
)
def test_input_outside_is_the_reason_unless_a_new_difference_precedes_it(
    of: Reason | None, step: int | None, known: Any
) -> None:
    news = at(step, "x")
    found = prefer_input(of, news)
    assert prefer_input(of, None) is of
    if known == ALONE:
        assert found == Reason(news)
    elif known is None:
        assert found is of
    else:
        assert of is not None and found == Reason(of.first, Beyond(findings=known, blame=news))


# --- whole cases


@pytest.fixture
def ready(case_file: Write) -> PreparedCase:
    """A fluid whose particles go through a text file at step 1."""
    evolve = {"steps": 2, "timestep": 0.001, "compare_at": [0, 1, 2], "stops": [{"at": 1, "by": "data"}]}
    return stopped(case_file, compare=["coordination", "f"], velocity={"random": 0.3}, evolve=evolve)


def answer(ready: PreparedCase, *findings: str, **after: Any) -> Answer:
    """Return an answer of LAMMPS with some findings, with positions outside the box, and arrays after the stop."""
    made = made_answers.of_model(ready.case.scene, ready.atoms, *findings)
    x_nc = ready.atoms.x_nc + np.array([3 * (ready.atoms.high_c[0] - ready.atoms.low_c[0]), 0, 0])
    before = {"x": x_nc, "rho": np.asarray(ready.atoms.rho_n)}
    return replace(made, carried=(Carried(before, {"x": ready.atoms.x_nc, "rho": before["rho"]} | after),))


def judged(ready: PreparedCase, given: Answer) -> CaseRecord:
    return compare_case(ready.case, ready.eos, ready.atoms, given, KNOWN)[0]


def places(found: CaseRecord | Reason) -> list[tuple[Any, ...]]:
    """Return where a case differs first, and first beyond findings."""
    first = found.blame if isinstance(found, CaseRecord) else found.first
    blames = (first, found.beyond.blame if found.beyond else None)
    return [(blame.field, blame.step, blame.atom) for blame in blames if blame is not None]


def test_positions_in_text_agree_with_any_image_to_its_digits(ready: PreparedCase) -> None:
    fields = {field.field: field for field in judged(ready, answer(ready)).fields if "at 1" in field.field}
    assert {name: (field.verdict, field.derivation) for name, field in fields.items()} == {
        "x (data at 1)": ("exact", TEXT),
        "rho (data at 1)": ("exact", TEXT),
    }
    off = judged(ready, answer(ready, rho=np.asarray(ready.atoms.rho_n) * (1 + 1e-15)))
    (red,) = [field for field in off.fields if field.verdict == "differs"]
    assert (red.field, red.stage, red.derivation) == ("rho (data at 1)", "input", TEXT)


def test_state_corrupted_at_a_stop_is_blamed_alone_or_next_to_a_finding(ready: PreparedCase) -> None:
    """The same for an answer read at every step."""
    rho_n = np.array(ready.atoms.rho_n)
    rho_n[4] *= 1.01
    lost = ("rho (data at 1)", 1, 5)
    for findings in ((), (FORCE.id,)):
        given = answer(ready, *findings, rho=rho_n)
        for found in (
            judged(ready, given),
            first_step(ready.case, ready.atoms, given, KNOWN.distribution, Predictor()),
        ):
            assert found is not None
            first, *left = places(found)
            assert left == [lost] * bool(findings) and (first == lost or first[:2] == ("f", 0))
            assert (found.beyond.findings if found.beyond else []) == list(findings)


def test_state_not_held_as_given_is_blamed_at_the_first_step(ready: PreparedCase) -> None:
    made = answer(ready)
    held = made.snapshots[0] | {"rho": made.snapshots[0]["rho"] + (ready.atoms.id_n == 9)}
    record = judged(ready, replace(made, snapshots=(held, *made.snapshots[1:])))
    assert places(record) == [("rho (given)", 0, 9)]


def test_difference_beyond_a_finding_is_reported_with_it(ready: PreparedCase) -> None:
    made = answer(ready, FORCE.id)
    last = made.snapshots[2] | {"f": made.snapshots[2]["f"] + [[0.0, 1.0, 0.0]]}
    record = judged(ready, replace(made, snapshots=(*made.snapshots[:2], last)))
    assert [place[:2] for place in places(record)] == [("f", 0), ("f", 2)]
    assert record.beyond is not None and record.beyond.findings == [FORCE.id]


@pytest.mark.parametrize(("version", "gone"), [("2025.7.22.1.0", True), ("2025.7.22.4.0", False)])
def test_absent_finding_is_one_that_this_version_had(case_file: Write, version: str, gone: bool) -> None:
    types = [{"mass": 1.31, "rho0": 1.2, "cs": 3.1, "conductivity": 0.7, "specific_heat": 1.5}]
    heated = stopped(case_file, types=types, energy={"range": [0.8, 1.9]}, compare=["heatflow"], evolve=None)
    made = made_answers.of_model(heated.case.scene, heated.atoms)
    engine = EngineRecord(distribution=version)
    record = compare_case(heated.case, heated.eos, heated.atoms, made, engine)[0]
    assert ("heat-over-density" in record.unseen) == gone
