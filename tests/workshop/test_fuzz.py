"""Random scenes: over every key of the schema, reproducible, mostly valid; red ones are kept to be run alone."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pydantic
import pytest

from eos_ref.eos.bounds import EPS
from eos_ref.model.box import TILTED
from lammps_cases import findings
from lammps_cases.comparison.trajectory import visit
from lammps_cases.findings import LEDGER
from lammps_cases.findings.entry import ModelFinding
from lammps_cases.findings.units import UnitsUnconverted
from lammps_cases.records.case_parts import Beyond, Blame, HarnessError
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.run.prepared_case import PreparedCase, prepare
from lammps_cases.scene import Scene, casefile
from lammps_cases.scene.casefile import Case
from lammps_cases.scene.particles import AtomType
from lammps_cases.scene.values import Dim, Positive
from lammps_cases.verdict.problems import problem_of
from tests.support.small_scene import small_scene
from tests.workshop.fuzz import draw as drawer
from tests.workshop.fuzz import hunt, rules, schema
from tests.workshop.fuzz.__main__ import main
from tests.workshop.fuzz.draw import SOURCE, DrawnScene, draw
from tests.workshop.fuzz.drawing import rounded
from tests.workshop.fuzz.fit import Fit, fitted
from tests.workshop.fuzz.hunt import ChoiceCounts, argued, is_loss, is_lost, is_unbounded, known_gap, loses

SCENES = 600  # as many as `every choice` needs: the rarest comes once in a hundred
REJECTED = 0.03  # share of attempts that may be invalid
ENGINE = "2025.7.22.4.0"


@pytest.fixture(scope="module")
def drawn() -> list[DrawnScene]:
    return [draw(5, number) for number in range(SCENES)]


@pytest.mark.slow
def test_every_choice_of_the_schema_is_drawn_or_argued(drawn: list[DrawnScene]) -> None:
    """A new key of the schema is drawn from it at once; if it cannot be, this test names it."""
    coverage = ChoiceCounts()
    for one in drawn:
        coverage.add(one.choices)
    missed = [choice for choice, count in coverage.counts().items() if not count]
    assert not missed, f"never drawn: give them a rule, or a reason, in tests.workshop.fuzz.rules ({missed})"
    pairs, possible = coverage.pairs()
    assert pairs > 0.8 * possible


@pytest.mark.slow
def test_most_attempts_are_valid_small_and_short(drawn: list[DrawnScene]) -> None:
    rejected = [reason for one in drawn for reason in one.rejected]
    assert len(rejected) <= REJECTED * (SCENES + len(rejected)), rejected
    assert max(len(one.ready.atoms) for one in drawn) <= 100
    steps = [one.case.scene.evolve.steps for one in drawn if one.case.scene.evolve]
    assert len(steps) > SCENES / 2 and max(steps) <= 20


@pytest.mark.slow
def test_contents_are_plain_data_of_few_digits(drawn: list[DrawnScene]) -> None:
    for one in drawn[:20]:
        assert json.loads(json.dumps(one.content)) == one.content
        for value in _numbers(one.content):
            assert len(re.sub(r"e.*|[-.]|^0\.0*", "", repr(value)).strip("0")) <= 10, value


def _numbers(part: Any) -> Iterator[float]:
    if isinstance(part, dict | list):
        for each in part.values() if isinstance(part, dict) else part:
            yield from _numbers(each)
    elif isinstance(part, float):
        yield part


def test_draw_is_independent_of_earlier_draws_and_of_what_is_imported() -> None:
    """Hypothesis also tries large whole numbers, numbers and words that it finds in the sources of imported modules."""
    alone = draw(7, 3)
    assert [draw(7, number) for number in (1, 2)][-1].content != alone.content
    assert draw(7, 3).content == alone.content
    assert draw(8, 3).content != alone.content
    program = "import json, tests.workshop.fuzz.draw as d; print(json.dumps([d.draw(7, k).content for k in range(8)]))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == [draw(7, k).content for k in range(8)]


def test_choices_of_the_schema_are_those_of_the_models() -> None:
    choices = schema.choices()
    assert len(choices) == len(set(choices)) > 180
    assert {"rheo.kernel=RK2", "twin.split=true", "positions.regions.type=null", "forces.vector=null"} <= set(choices)
    taken = schema.taken(
        {"dimension": 2, "rheo": {"shift": {"exclude": ["1", 2]}}, "forces": [{"vector": [None, 1.0]}]}
    )
    assert taken == {
        *("dimension=2", "rheo", "rheo.shift", "rheo.shift.exclude", "forces"),
        *("forces.vector", "forces.vector=null"),
    }
    assert taken <= set(choices)


def test_rules_and_reasons_name_existing_keys() -> None:
    places = {choice.partition("=")[0] for choice in schema.choices()}
    assert set(rules.NEVER) <= places and all(rules.NEVER.values())
    assert set(rules.GIVEN) | set(rules.RULES) <= places
    assert argued("violate=rheo-twice") and argued("rho.table.csv") and not argued("rho")


class _SizedType(AtomType):
    size: Annotated[Positive, Dim("mass")]


class _NewScene(Scene):
    flavour: Literal["sweet", "sour"] | None = None
    types: tuple[_SizedType, ...] = pydantic.Field(min_length=1)


def test_new_key_is_drawn_without_a_rule_in_the_unit_of_its_annotation(monkeypatch: pytest.MonkeyPatch) -> None:
    made = _NewScene.model_json_schema()
    monkeypatch.setattr(schema, "root", lambda: made)
    monkeypatch.setattr(drawer, "Scene", _NewScene)
    monkeypatch.setattr(drawer, "prepare", lambda case: case)
    monkeypatch.setattr(drawer, "fitted", lambda content, fit, prepare: (content, prepare(content)))
    contents = [draw(1, k).content for k in range(30)]
    assert {content.get("flavour") for content in contents} == {"sweet", "sour", None}
    ratios = [of["size"] / of["mass"] for content in contents for of in content["types"]]
    assert 0.1 < min(ratios) < max(ratios) < 10


# --- what LAMMPS cannot do


def _ready(content: dict[str, Any]) -> PreparedCase:
    return prepare(Case("drawn", "", (), Scene.model_validate(content), SOURCE, shipped=False))


def test_time_step_suits_the_numbers_of_a_twin() -> None:
    """A force that lacks a volume lacks a factor of 1e-6 in lj and of 1 in micro, and particles leave the box."""
    scene: dict[str, Any] = {
        "units": "micro",
        "types": [{"mass": 1.0, "viscosity": 0.1}],
        "positions": {"x": [[0.0, 0.0], [0.0, 1.0]], "low": [-9.0, -9.0], "high": [9.0, 9.0]},
        "pressure": [{"types": "*", "style": "linear"}],
        "rho": {"constant": 1.0},
        "evolve": {"steps": 1, "timestep": 1.0},
        "dimension": 2,
        "compare": ["f"],
    }

    def step(**twin: Any) -> float:
        content = scene | ({"twin": twin} if twin else {})
        return float(fitted(content, Fit(0.1), _ready)[0]["evolve"]["timestep"])

    assert step(newton=False) == step()
    assert step(units="lj") == rounded(1e-6 * step(), 4)  # three numbers of few digits, and their product
    assert step(rescale=2.0) == step()


@pytest.mark.slow
def test_unconverted_backgrounds_leave_particles_in_the_skin(drawn: list[DrawnScene]) -> None:
    """3e9 atm moved particles out of the skin of the neighbour lists in the first step (units-unconverted)."""
    pressed = [one.ready for one in drawn if one.content.get("units") in ("real", "metal") and "evolve" in one.content]
    pressed = [ready for ready in pressed if any(law.P_b for law in ready.case.scene.pressure)]
    for ready in pressed:
        scene = ready.case.scene
        problem = problem_of(scene, ready.atoms, "", scene.snapshots)
        sim = problem.simulation(stepping=UnitsUnconverted)
        for _ in visit(sim, problem.steps[:1], problem.timestep):
            moved = problem.timestep * float(np.abs(sim.state.v_nc).max())
            assert moved < max(scene.engine.skin, scene.positions.spacing) * ready.atoms.spacing / 2
    assert pressed


@pytest.mark.slow
def test_deformed_box_leans_by_less_than_half_an_edge(drawn: list[DrawnScene]) -> None:
    """LAMMPS otherwise flips it by an edge, and an edge without a rate then stays flipped."""
    deformed = [one.ready for one in drawn if one.content.get("evolve", {}).get("deform")]
    assert any(ready.case.scene.evolve.deform.xy for ready in deformed)
    for ready in deformed:
        scene = ready.case.scene
        problem = problem_of(scene, ready.atoms, "", tuple(range(scene.evolve.steps + 1)))
        for box in map(problem.box_at, problem.steps):
            assert all(abs(lean) < box.edge_c[one] / 2 for lean, (one, _) in zip(box.tilt, TILTED, strict=False))


@pytest.mark.slow
def test_scenes_at_which_lammps_ended_are_not_drawn(drawn: list[DrawnScene]) -> None:
    found = dict.fromkeys(("alone", "skin", "walls"), 0)
    for one in drawn:
        scene, atoms, twin = one.case.scene, one.ready.atoms, one.case.scene.twin
        periodic = scene.positions.periodic or (True,)
        if len(atoms) == 1:
            found["alone"] += 1
            # With faces that shrink to it "box size << cutoff"; no temperature of it after clear.
            assert all(periodic) or "s" not in scene.engine.boundary
            halts = scene.evolve.stops if scene.evolve and scene.dimension == 2 else ()
            assert not {"restart", "other scene"} & {stop.by for stop in halts}
        if twin and twin.skin and scene.dimension == 3 and all(periodic):
            found["skin"] += 1
            reach = scene.rheo.cut + twin.skin * atoms.spacing if scene.rheo.cut else (3 + twin.skin) * atoms.spacing
            density = len(atoms) / np.prod(atoms.high_c - atoms.low_c)
            assert 4 / 3 * np.pi * reach**3 * density < 2000  # neighbours of a particle
        if twin and twin.units and scene.rheo.interface_reconstruct:
            found["walls"] += 1
            # Volumes of 4e-22 in units lj: densities of walls have a bound of 4e5 after a step, by force-per-volume.
            assert min(float((a.mass_n / a.rho_n).min()) for _, a in one.ready.sides if a.rho_n is not None) > EPS / 2
    assert all(found.values()), found


# --- the hunt


@pytest.mark.lammps
def test_red_scene_is_kept_as_a_case_and_can_be_drawn_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    judged = hunt.record_of

    def faulty(drawn: Any, outcome: Any, engine: Any) -> CaseRecord:
        blame = Blame(field="f", stage="pair", step=0, atom=1, lammps=1.0, reference=2.0, bound=1e-9, outside=1, of=1)
        found = judged(drawn, outcome, engine)
        return found.model_copy(update={"verdict": "differs", "blame": blame}) if found.as_expected else found

    monkeypatch.setattr(hunt, "record_of", faulty)
    scenes = ((k, draw(3, k).case.scene) for k in range(1000))
    # Of laws alone, and without arguments that LAMMPS refuses.
    number = next(k for k, of in scenes if not of.interacts and isinstance(of.rheo.shift, bool))
    code = main(["--seed", "3", "--draw", str(number), "--jobs", "1", "--out", str(tmp_path)])
    record = json.loads((tmp_path / "fuzz.json").read_text())
    assert (code, record["drawn"], record["verdicts"]) == (1, 1, {"differs": 1})
    (red,) = record["red"]
    assert (red["draw"], red["failure"]) == (number, "differs in f (stage pair)")
    assert "must be red" in red["note"] and not red["small"]  # the fault is not in LAMMPS, so it disappears
    (case,) = casefile.load((Path(red["file"]),))
    assert case.scene == draw(3, number).case.scene
    assert red["reproduce"] == f"eos-ref run --cases {red['file']} drawn-3-{number}"


DIFFERS = CaseRecord(case="drawn", verdict="differs", ended="answered")


def test_gaps_belong_to_findings_of_the_engine_and_the_fields_that_they_reach(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = next(
        one
        for one in (draw(1, k).case.scene for k in range(200))
        if one.rheo.kernel == "RK1" and one.rheo.zmin and not one.pair.harmonic_means
    )
    entries = {entry.id: entry for entry in LEDGER}
    stale, walls = entries["stale-gradient-below-zmin"], entries["wall-velocity-lost"]
    monkeypatch.setattr(findings, "LEDGER", (replace(stale, engines=(ENGINE,)),))
    assert known_gap(DIFFERS, scene, ENGINE) == stale.id
    assert known_gap(DIFFERS.model_copy(update={"ended": "crashed", "verdict": "crashed"}), scene, ENGINE) == ""
    assert known_gap(DIFFERS, scene, "2026.7.4") == ""
    plain = scene.model_copy(update={"rheo": scene.rheo.model_copy(update={"zmin": 0})})
    assert known_gap(DIFFERS, plain, ENGINE) == ""
    assert isinstance(walls, ModelFinding)
    anywhere = replace(walls, gaps=(replace(walls.gaps[0], applies=lambda scene: True),), engines=(ENGINE,))
    monkeypatch.setattr(findings, "LEDGER", (anywhere,))
    assert known_gap(DIFFERS, scene, ENGINE) == ""
    assert known_gap(DIFFERS.model_copy(update={"limits": [walls.id]}), scene, ENGINE) == walls.id


QUINTIC, RK1 = {"kernel": "quintic", "interface_reconstruct": True}, {"kernel": "RK1", "interface_reconstruct": True}
CLOSED = {"lattice": "sq", "spacing": 1.0, "cells": [8, 8], "periodic": [False, False]}


@pytest.mark.parametrize(
    ("changed", "by", "known"),
    [
        ({"rheo": QUINTIC}, "minimize", True),
        ({"rheo": QUINTIC, "positions": CLOSED | {"periodic": [True, False]}}, "minimize", True),
        ({"rheo": QUINTIC, "positions": CLOSED}, "minimize", False),
        ({"rheo": QUINTIC, "positions": CLOSED, "engine": {"ranks": 2}}, "minimize", True),
        ({"rheo": RK1, "positions": CLOSED}, "minimize", True),
        ({"rheo": {"kernel": "RK1"}, "positions": CLOSED}, "minimize", False),
        ({"rheo": RK1}, "set", False),
    ],
)
def test_gap_applies_to_the_scenes_of_its_reason(changed: dict[str, Any], by: str, known: bool) -> None:
    """A minimisation next to reconstructed walls, with images or a corrected kernel."""
    (entry,) = (entry for entry in LEDGER if entry.id == "walls-begin-with-pressure")
    assert isinstance(entry, ModelFinding)
    evolve = {"steps": 2, "timestep": 1e-3, "stops": [{"at": 1, "by": by}]}
    scene = small_scene([[1.0, 1.0]], (8, 8), evolve=evolve, **changed)
    assert any(gap.applies(scene.scene) for gap in entry.gaps) == known


@pytest.mark.parametrize(
    ("bound", "engine", "unbounded"),
    [(np.inf, ENGINE, True), (np.inf, "2026.7.4", False), (1e-9, ENGINE, False)],  # one is not known to have it
)
def test_only_known_findings_leave_scenes_without_bounds(bound: float, engine: str, unbounded: bool) -> None:
    of = {"stage": "integration", "step": 1, "atom": 1, "lammps": 1.0, "reference": 1.0, "outside": 8, "of": 8}
    beyond = Beyond(findings=["cross-type-normal"], blame=Blame(field="x", bound=bound, **of))
    assert is_unbounded(DIFFERS.model_copy(update={"beyond": beyond}), engine) == unbounded
    assert not is_unbounded(DIFFERS, engine)


@pytest.mark.parametrize(
    ("error", "lost"),
    [
        ("Lost atoms: original 36 current 35", True),
        ("Non-numeric atom coords - simulation unstable", True),
        ("Expected floating point parameter instead of 'nan' in input script", True),  # a state put back
        ("Expected floating point parameter instead of '-nan' in input script", True),
        ("Expected floating point parameter instead of 'nanometre' in input script", False),
        ("Replicate did not assign all atoms correctly", True),
        ("Unknown pair style", False),
    ],
)
def test_errors_caused_by_nan(error: str, lost: bool) -> None:
    record = CaseRecord(case="drawn", verdict="refused", ended="refused", engine_error=f"ERROR: {error}")
    assert is_lost(record) == lost
    assert not is_lost(record.model_copy(update={"verdict": "differs"}))


@pytest.mark.parametrize(
    ("periodic", "boundary", "speed", "lost"),
    [
        (False, "f", 3.0, True),
        (False, "f", 0.5, False),
        (True, "f", 3.0, False),  # the next image, to which LAMMPS moves it
        (True, "f", 11.0, True),
        (False, "m", 9.0, False),
        (False, "m", 1e10, True),
        (True, "f", 1e309, True),
    ],
)
def test_scenes_that_lose_particles(periodic: bool, boundary: str, speed: float, lost: bool) -> None:
    """Two particles in the middle of a box of 5, parting for two steps of 0.5."""
    v = min(speed, 1e308)
    content = {
        "dimension": 2,
        "types": [{"mass": 1.0}],
        "positions": {"x": [[2.5, 2.0], [2.5, 3.0]], "low": [0.0] * 2, "high": [5.0] * 2, "periodic": [periodic] * 2},
        "pressure": [{"types": "*", "style": "linear"}],
        "rho": {"constant": 1.0},
        "velocity": {"values": [[v, 0.0], [-v, 0.0]]},
        "evolve": {"steps": 2, "timestep": 0.5 if speed < 1e308 else 1e308},
        "engine": {"boundary": boundary},
        "compare": ["x"],
    }
    ready = _ready(content)
    assert loses(ready, ENGINE) == lost
    # By the reference alone: LAMMPS, whose forces may lack a factor, continues where the reference cannot.
    stopped = CaseRecord(case="drawn", verdict="error", harness_error=HarnessError(exception="InputError", text=""))
    assert is_loss(ready, stopped, ENGINE) == lost
    assert not is_loss(ready, CaseRecord(case="drawn", verdict="differs", ended="answered"), ENGINE)


@pytest.mark.parametrize("arguments", [("--seconds", "0"), ("--draw", "-1")])
def test_wrong_numbers_are_refused(
    arguments: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*arguments, "--out", str(tmp_path)]) == 2 and capsys.readouterr().err.count("\n") == 1
