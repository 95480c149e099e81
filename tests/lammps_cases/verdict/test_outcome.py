"""Parts of every judgement: the record of a case before its run, its ending, the state carried over at stops."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eos_ref import EOS, EOSTable
from eos_ref.eos.bounds import EPS
from eos_ref.model.box import Box
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.engine.interlude import Carried
from lammps_cases.engine.session import Answer
from lammps_cases.engine.workers import Failure
from lammps_cases.records.case_parts import Blame, LawRecord, LostAtoms, Predictions
from lammps_cases.records.progress import taken
from lammps_cases.records.run_record import CaseRecord, EngineRecord
from lammps_cases.run import prepared_case
from lammps_cases.run.prepared_case import PreparedCase
from lammps_cases.scene import casefile
from lammps_cases.scene.atoms import kernel_cut, seed
from lammps_cases.verdict.case_arrays import sampled
from lammps_cases.verdict.cases import BY_IMAGES, compare_carried, compare_case
from lammps_cases.verdict.outcome import blank_record, explain_ending, finish
from lammps_cases.verdict.problems import problem_of
from tests.support import made_answers
from tests.support.roundings import rounded

Write = Callable[..., Path]
ENGINE = EngineRecord(name="pypi:2099.1.1", distribution="2099.1.1")


def prepared(file: Path) -> prepared_case.PreparedCase:
    return prepared_case.prepare(casefile.load((file,))[0])


# --- before and after a run


@pytest.mark.parametrize("shipped", [False, True])
def test_blank_record_describes_the_case(case_file: Write, shipped: bool) -> None:
    run = {"compare": ["f"], "evolve": {"steps": 7, "timestep": 0.001}, "twin": {"newton": False}, "units": "si"}
    path = case_file(**run, types=[{"mass": 1.5, "rho0": 1.2, "cs": 3.1}, {"mass": 0.5, "rho0": 1.1, "cs": 2.5}])
    ready = prepared(path)
    case = replace(ready.case, tags=("one", "two"), shipped=shipped)
    table = EOSTable([EOS("linear", 1.2, 3.1), EOS("cubic", 1.1, 2.5, 0.3, 0.7)])
    file = [] if shipped else ["--cases", str(path)]
    assert blank_record(case, table, ready.atoms, ENGINE) == CaseRecord(
        case="mine",
        tags=["one", "two"],
        about="A scene of the tests.",
        verdict="skipped",
        ended="skipped",
        natoms=20,
        steps=7,
        dimension=2,
        units="si",
        twin="newton",
        laws=[
            LawRecord(type=1, style="linear", rho0=1.2, cs=3.1, mass=1.5),
            LawRecord(type=2, style="cubic", rho0=1.1, cs=2.5, parameter=0.3, background=0.7, mass=0.5),
        ],
        seed=seed("mine"),
        source=path.name if shipped else str(path),
        reproduce=" ".join(["eos-ref run", *file, "--engine pypi:2099.1.1 mine"]),
    )


def test_record_of_an_expected_refusal_has_its_words(case_file: Write) -> None:
    ready = prepared(case_file(violate="missing-argument", expect={"refused": "Invalid range"}))
    record = blank_record(ready.case, ready.eos, ready.atoms, ENGINE)
    assert (record.expects, record.laws, record.steps, record.twin) == ("Invalid range", [], 0, "")


def test_finished_record_has_message_times_and_prediction_counts() -> None:
    blame = Blame(field="f", stage="pair", step=3, atom=7, lammps=2.0, reference=1.0, bound=0.5, outside=1, of=9)
    record = CaseRecord(case="one", verdict="differs", blame=blame)
    begin = time.perf_counter() - 100.0
    finish(record, 2.5, begin, Predictor(computed=3, stored=4))
    assert record.message.startswith("f (stage pair) leaves its bound at step 3")
    assert record.seconds.lammps == 2.5
    assert 100.0 <= record.seconds.reference <= time.perf_counter() - begin
    assert record.seconds.total == 2.5 + record.seconds.reference
    assert record.predictions == Predictions(computed=3, stored=4)


@pytest.mark.parametrize(
    ("compare", "ended", "words", "explained_by"),
    [
        (["stress/t"], "crashed", "SIGSEGV", ["stress-without-pressure-segfault"]),
        (["stress/t", "pressure"], "crashed", "SIGSEGV", []),
        (["stress/t"], "crashed", "SIGFPE", []),
        (["stress/t"], "refused", "SIGSEGV", []),
    ],
)
def test_scene_predicts_an_ending(
    case_file: Write, compare: list[str], ended: Any, words: str, explained_by: list[str]
) -> None:
    ready = prepared(case_file(compare=compare))
    record, arrays = compare_case(ready.case, ready.eos, ready.atoms, Failure(ended, words), ENGINE)
    assert (record.explained_by, arrays) == (explained_by, {})
    assert record.verdict == ("explained" if explained_by else ended)
    assert record.ended == ended


def test_predicted_ending_explains_only_the_same_verdict(case_file: Write) -> None:
    """The finding does not cover another verdict, such as that of a refusal in other words."""
    scene = prepared(case_file(compare=["stress/t"])).case.scene
    record = CaseRecord(case="any", verdict="differs", ended="crashed", engine_error="SIGSEGV")
    explain_ending(record, scene)
    assert record.verdict == "differs"


@pytest.mark.parametrize(
    ("error", "lacks"),
    [
        ("ERROR: Unrecognized fix style 'rheo/thermal' (src/modify.cpp:929)\nLast input line: fix 1", "rheo/thermal"),
        ("ERROR: Illegal fix rheo command: self/mass (src/RHEO/fix_rheo.cpp:181)", "self/mass"),
        ("ERROR: Illegal fix command, cubic (src/RHEO/fix_rheo_pressure.cpp:123)", "cubic"),
        ("ERROR: Unknown kernel style RK2 in fix rheo (src/RHEO/fix_rheo.cpp:113)", "RK2"),
        ("ERROR: Unknown fix rheo/thermal keyword: react (src/RHEO/fix_rheo_thermal.cpp:201)", "react"),
        ("ERROR: Illegal surface/detection option in fix rheo, divergence (src/RHEO/fix_rheo.cpp:154)", "divergence"),
        ("ERROR: Illegal pair_style command, harmonic/means (src/RHEO/pair_rheo.cpp:445)", "harmonic/means"),
        ("ERROR: Invalid keyword surface/r for atom style rheo in compute rheo/property/atom command", "surface/r"),
        ("ERROR: Unrecognized set or fix set command keyword rheo/rho (src/set.cpp:410)", "rheo/rho"),
        ("ERROR: Illegal fix rheo command: missing argument(s) (src/RHEO/fix_rheo.cpp:181)", ""),
        ("ERROR: Illegal fix rheo command: 0.9", ""),
        ("ERROR: Unknown command: no_such_command (src/input.cpp:408)", ""),
        ("ERROR: Lost atoms: original 20 current 19 (src/thermo.cpp:494)", ""),
    ],
)
def test_word_that_lammps_lacks_is_not_a_difference(case_file: Write, error: str, lacks: str) -> None:
    ready = prepared(case_file())
    record, _ = compare_case(ready.case, ready.eos, ready.atoms, Failure("refused", error), ENGINE)
    assert (record.verdict, record.lacks) == ("skipped" if lacks else "refused", lacks)
    assert (record.message == f"this LAMMPS has no {lacks!r}") == bool(lacks)


def test_refusal_expected_in_other_words_differs(case_file: Write) -> None:
    ready = prepared(case_file(violate="missing-argument", expect={"refused": "Invalid range"}))
    refused = Failure("refused", "ERROR: Illegal fix command, cubic")
    record, _ = compare_case(ready.case, ready.eos, ready.atoms, refused, ENGINE)
    assert (record.verdict, record.lacks) == ("differs", "")


@pytest.mark.parametrize("where", ["first", "before", "after"])
def test_atoms_lost_before_the_end_are_reported(case_file: Write, where: str) -> None:
    ready = prepared(
        case_file(evolve={"timestep": 0.01, "steps": 2, "compare_at": [0, 2], "stops": [{"at": 1, "by": "run"}]})
    )
    answer = made_answers.of_model(ready.case.scene, ready.atoms)
    fewer: dict[str, Any] = {name: array[1:] for name, array in answer.snapshots[0].items()}
    if where == "first":
        answer = replace(answer, snapshots=(fewer, *answer.snapshots[1:]))
    else:
        answer = replace(answer, carried=(replace(answer.carried[0], **{where: fewer}),))
    record, _ = compare_case(ready.case, ready.eos, ready.atoms, answer, ENGINE)
    assert (record.verdict, record.unusable) == ("differs", LostAtoms(returned=19, given=20, first_id=1))


# --- stops

STATE: dict[str, Any] = {
    "id": np.arange(1, 21),
    "type": np.ones(20, int),
    "x": np.linspace(0.5, 2.0, 60).reshape(20, 3) * [1, 1, 0],
    "rho": np.linspace(0.9, 1.4, 20),
    "rheo_status": np.arange(20) % 4,
}
HALF = 0.5e-15 + 2.0**-53  # half a unit of the 16th digit, relative to a number of one, and the rounding by reading it


def carried_over(ready: PreparedCase, *carried: Carried) -> list[Any]:
    """Return the comparisons of states before and after stops, with their steps."""
    of = problem_of(ready.case.scene, ready.atoms, "", ready.case.scene.snapshots)
    return compare_carried(ready.case, ready.atoms, Answer({}, 0.0, carried=carried), 16, of)


def compared(case_file: Write, *stops: dict[str, Any], after: dict[str, Any] | None = None) -> list[tuple[Any, ...]]:
    """Return field, verdict and bound of the state after stops, in which only ``after`` has changed."""
    ready = prepared(case_file(compare=["f"], evolve={"steps": 3, "timestep": 0.001, "stops": list(stops)}))
    carried = tuple(Carried(STATE, STATE | (after or {})) for _ in stops)
    fields = [c for _, c in carried_over(ready, *carried)]
    assert {comparison.record.stage for comparison in fields} <= {"input"}
    return [(c.record.field, c.record.verdict, c.record.derivation, c.bound_n.max()) for c in fields]


SAME = "the same doubles", 0.0


def test_state_in_a_binary_file_has_the_same_bits(case_file: Write) -> None:
    assert compared(case_file, {"at": 0, "by": "restart"}, {"at": 2, "by": "run"}) == [
        (f"{name} ({stop})", "exact", *SAME)
        for stop in ("restart at 0", "run at 2")
        for name in ("type", "x", "rho", "rheo_status")
    ]


def test_state_in_text_has_its_digits(case_file: Write) -> None:
    text = "half a unit of the 16th digit of the text"
    assert compared(case_file, {"at": 1, "by": "data nofix"}) == [
        (f"{name} (data nofix at 1)", "exact", text, rounded(HALF * STATE[name].max(), 2))
        for name in ("type", "x", "rho", "rheo_status")
    ]


PLANE = (0.0, 0.0), (1.0, 2.0), (True, True), (0.25,)
EDGE = 4.0  # edge of the box, from 0, along x


@pytest.mark.parametrize(
    ("by", "units", "verdict"),
    [("replicated", 1, "pass"), ("replicated", 3, "differs"), ("data", 7, "pass"), ("data", 9, "differs")],
)
def test_particle_outside_the_box_may_return_as_its_image(
    case_file: Write, by: str, units: int, verdict: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two sums with a period round 4.3 by 2^-53 each, text by 2^-53 and half its 16th digit: 2.2, 8.1 units of 3.7."""
    left = STATE["x"].copy()
    left[3, 0] = -0.3
    monkeypatch.setitem(STATE, "x", left)
    back = left.copy()
    back[3, 0] += EDGE
    back[3, 0] += units * np.spacing(back[3, 0])
    fields = {field: of for field, of, *_ in compared(case_file, {"at": 1, "by": by}, after={"x": back})}
    assert fields[f"x ({by} at 1)"] == verdict


@pytest.mark.parametrize("axis", [0, 1])
def test_image_rounds_by_the_size_of_edges_along_its_axis(case_file: Write, axis: int) -> None:
    """All edges count: here one of 1, and one tilted over it by 0.25."""
    ready = prepared(
        case_file(compare=["f"], evolve={"steps": 3, "timestep": 0.001, "stops": [{"at": 1, "by": "replicated"}]})
    )
    box = Box((0.0, 0.0, 0.0), (1.0, 2.0, 1.0), (True, True, False), (0.25, 0.0, 0.0))
    before = np.full((20, 3), [0.5, 1.0, 0.0]) + box.cell_cc[axis] * (np.arange(20) == 3)[:, None]
    after = np.full((20, 3), [0.5, 1.0, 0.0])
    of = replace(problem_of(ready.case.scene, ready.atoms, "", ready.case.scene.snapshots), box=Box(*PLANE))
    carried = Carried({"x": before}, {"x": after})
    ((_, field),) = compare_carried(ready.case, ready.atoms, Answer({}, 0.0, carried=(carried,)), 16, of)
    assert field.record.verdict == "exact"
    reach_nc = np.zeros((20, 2))
    reach_nc[3, axis] = before[3, axis] + (1.25, 2.0)[axis]
    rounding_c = box.rounding(kernel_cut(ready.case.scene, ready.atoms.spacing))[:2]
    np.testing.assert_array_equal(field.bound_n, EPS * reach_nc + rounding_c)


def test_particle_inside_the_box_may_not_move(case_file: Write) -> None:
    moved = STATE["x"].copy()
    moved[3, 0] += np.spacing(moved[3, 0])
    fields = {field: of for field, of, *_ in compared(case_file, {"at": 1, "by": "replicated"}, after={"x": moved})}
    assert fields["x (replicated at 1)"] == "differs"


def test_rounding_along_z_is_ignored_in_2d(case_file: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    rounded = STATE["x"].copy()
    rounded[:, 2] = -(2.0**-54)
    monkeypatch.setitem(STATE, "x", rounded)
    read = rounded * [1, 1, 0]
    for dimension, verdict in ((2, "exact"), (3, "differs")):
        ready = prepared(
            case_file(compare=["f"], evolve={"steps": 3, "timestep": 0.001, "stops": [{"at": 1, "by": "data"}]})
        )
        scene = ready.case.scene.model_copy(update={"dimension": dimension})
        ready = replace(ready, case=replace(ready.case, scene=scene))
        (field,) = (c for _, c in carried_over(ready, Carried(STATE, STATE | {"x": read})) if c.record.field[0] == "x")
        assert field.record.verdict == verdict


@pytest.mark.parametrize("name", ["sheared.fluid.leaning", "sheared-3d.open.leaning"])
@pytest.mark.parametrize("at", [0, 1], ids=["upright yet", "leaning"])
@pytest.mark.parametrize(("part", "verdict"), [(0.9, "pass"), (1.1, "differs")])
def test_positions_in_a_tilted_box_round_as_fractions(name: str, at: int, part: float, verdict: str) -> None:
    """Inside the box they may differ by up to `Box.rounding`, also while the tilt is 0."""
    ready = prepared_case.prepare(casefile.select(casefile.load(), [name])[0])
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
    assert [field for field, *_ in fields] == [f"{name} (run at 1)" for name in ("type", "rho", "rheo_status")]


@pytest.mark.parametrize("by", ["restart", "data", "set", "recreated"])
@pytest.mark.parametrize(("changed", "seen"), [(2, False), (1, True)], ids=["surface", "phase"])
def test_set_carries_only_the_phase_of_a_status(case_file: Write, by: str, changed: int, seen: bool) -> None:
    """The phase is the first bit of LAMMPS' status; the others follow from the next evaluation."""
    fields = compared(case_file, {"at": 1, "by": by}, after={"rheo_status": STATE["rheo_status"] ^ changed})
    red = [field for field, verdict, *_ in fields if verdict == "differs"]
    assert red == ([f"rheo_status ({by} at 1)"] if seen or by in ("restart", "data") else [])


@pytest.mark.parametrize(
    ("by", "units", "verdict"), [("restart", 1, "differs"), ("data", 1, "pass"), ("data", 4, "differs")]
)
def test_state_after_a_stop_equals_the_one_before(case_file: Write, by: str, units: int, verdict: str) -> None:
    """Half a unit of the 16th digit of a number is 2.3 x 2^-52 of it, or more."""
    fields = compared(case_file, {"at": 1, "by": by}, after={"rho": STATE["rho"] * (1 + units * 2.0**-52)})
    assert {field: of for field, of, *_ in fields}[f"rho ({by} at 1)"] == verdict


@pytest.mark.parametrize("stops", [0, 2])
def test_answers_with_other_stops_raise(case_file: Write, stops: int) -> None:
    """An answer with a stop missing, or with an extra one, is a fault of the harness, never a pass."""
    evolve = {"steps": 3, "timestep": 0.001, "stops": [{"at": at} for at in range(stops)]}
    ready = prepared(case_file(compare=["f"], evolve=evolve))
    with pytest.raises(ValueError, match="zip"):
        carried_over(ready, Carried(STATE, STATE))


def test_case_without_runs_carries_nothing_over(case_file: Write) -> None:
    ready = prepared(case_file())
    assert carried_over(ready) == []


# --- saved arrays of very many atoms


def test_sample_and_worst_atoms_are_saved_from_very_many(monkeypatch: pytest.MonkeyPatch) -> None:
    n = 1000
    zero_n, f_nc, rho_n = np.zeros(n), np.zeros((n, 2)), np.random.default_rng(1).permutation(n) / n
    f_nc[123, 1], rho_n[877] = 1.0, np.nan
    sides = {"f.lammps": f_nc, "f.reference": 0 * f_nc, "f.bound": 0 * f_nc + 2.0, "@1 lammps f": f_nc}
    sides |= {"rho.lammps": rho_n, "rho.reference": zero_n, "rho.bound": zero_n + 2.0}
    arrays = {"id": np.arange(1, n + 1), "box": np.zeros((2, 3)), "periodic": np.ones(3, bool), **sides}
    arrays["@pairs sum"] = np.zeros((2, 4))
    monkeypatch.setattr("lammps_cases.verdict.case_arrays.ALL_KEPT", n)
    assert sampled(arrays) is arrays
    for name, number in (("ALL_KEPT", n - 1), ("SAMPLE", 10), ("WORST", 1)):
        monkeypatch.setattr(f"lammps_cases.verdict.case_arrays.{name}", number)
    kept, even = sampled(arrays), {1, 112, 223, 334, 445, 556, 667, 778, 889, 1000}
    assert set(kept["id"].tolist()) == even | {124, 878}
    assert kept["f.lammps"][kept["id"] == 124].tolist() == [[0.0, 1.0]]
    assert {len(kept[name]) for name in sides} == {12}
    assert [kept[name].shape for name in ("box", "periodic", "@pairs sum")] == [(2, 3), (3,), (2, 4)]
    assert sampled({}) == {}


def test_differing_field_is_saved_at_its_other_steps(case_file: Write) -> None:
    """This is in addition to its worst step; a field that agrees throughout is saved once."""
    run = {"steps": 2, "timestep": 0.001, "compare_at": [0, 1, 2]}
    ready = prepared(case_file(compare=["coordination", "f"], velocity={"random": 0.3}, evolve=run))
    answer = made_answers.of_model(ready.case.scene, ready.atoms)
    last = answer.snapshots[2] | {"f": answer.snapshots[2]["f"] + [[1.0, 0.0, 0.0]]}
    answer = replace(answer, snapshots=(*answer.snapshots[:2], last))
    _, arrays = compare_case(ready.case, ready.eos, ready.atoms, answer, ENGINE)
    names = [name for name in arrays if name.startswith("@")]
    assert names == [f"@{step} {side} f" for step in (0, 1) for side in ("lammps", "reference", "bound")]
    np.testing.assert_array_equal(arrays["@1 lammps f"], answer.snapshots[1]["f"][:, :2])
    np.testing.assert_array_equal(arrays["f.lammps"], last["f"][:, :2])
    np.testing.assert_array_equal(arrays["mass"], ready.atoms.mass_n)
    assert arrays["periodic"].tolist() == list(ready.atoms.periodic)


def test_time_of_a_judgement_is_reported_by_stage(case_file: Write) -> None:
    ready = prepared(case_file(compare=["f"]))
    taken()
    compare_case(ready.case, ready.eos, ready.atoms, made_answers.of_model(ready.case.scene, ready.atoms), ENGINE)
    assert set(taken()) == {"reference", "bounds", "variants", "digits", "mistakes", "rest"}
