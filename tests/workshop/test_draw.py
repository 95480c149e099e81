"""Scenes drawn at random: reproducible, valid by construction, over every key of the schema."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from eos_ref.model.box import TILTED
from lammps_cases.comparison.trajectory import visit
from lammps_cases.findings.units import UnitsUnconverted
from lammps_cases.run.prepared_case import PreparedCase, prepare
from lammps_cases.scene import Scene
from lammps_cases.scene.casefile import Case
from lammps_cases.verdict.problems import problem_of
from tests.workshop.fuzz import rules, schema
from tests.workshop.fuzz.chance import Chance, rounded
from tests.workshop.fuzz.draw import SOURCE, DrawnScene, content_of, draw
from tests.workshop.fuzz.fit import fitted
from tests.workshop.fuzz.hunt import ChoiceCounts, argued

SCENES = 600  # as many as `every choice` needs: the rarest comes once in a hundred
REJECTED = 0.02  # share of attempts that may be invalid


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
def test_few_attempts_are_invalid(drawn: list[DrawnScene]) -> None:
    rejected = [reason for one in drawn for reason in one.rejected]
    assert len(rejected) <= REJECTED * (SCENES + len(rejected)), rejected


@pytest.mark.slow
def test_scenes_are_small_and_their_steps_short(drawn: list[DrawnScene]) -> None:
    assert max(len(one.ready.atoms) for one in drawn) <= 100
    steps = [one.case.scene.evolve.steps for one in drawn if one.case.scene.evolve]
    assert len(steps) > SCENES / 2 and max(steps) <= 20


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

    def ready(content: dict[str, Any]) -> PreparedCase:
        return prepare(Case("drawn", "", (), Scene.model_validate(content), SOURCE, shipped=False))

    def step(**twin: Any) -> float:
        content = scene | ({"twin": twin} if twin else {})
        return float(fitted(content, Chance("step"), ready)[0]["evolve"]["timestep"])

    assert step(newton=False) == step()
    assert step(units="lj") == rounded(1e-6 * step(), 4)  # three numbers of few digits, and their product
    assert step(rescale=2.0) == step()


def test_draw_is_independent_of_earlier_draws() -> None:
    alone = draw(7, 3)
    assert [draw(7, number) for number in (1, 2)][-1].content != alone.content
    assert draw(7, 3).content == alone.content
    assert draw(8, 3).content != alone.content


def test_streams_are_the_same_on_every_machine() -> None:
    """The bits of the stream, and numbers computed with logarithms, after rounding."""
    chance = Chance("1/2").at("rheo").at("kernel")
    numbers = [chance.share(), chance.number(1e-3, 1e3), chance.between(-1.0, 1.0), chance.whole(1, 6)]
    assert numbers == NUMBERS
    assert rounded(0.012345) == 0.0123


def test_every_key_has_its_own_stream(monkeypatch: pytest.MonkeyPatch) -> None:
    """So a key that is new, or drawn differently, leaves all others unchanged."""
    before = _settings(11)
    monkeypatch.setitem(rules.RULES, "pair.rho_damp", lambda scope, chance: 0.123)
    after = _settings(11)
    assert sum(one != other for one, other in zip(before, after, strict=True)) >= 2
    for one, other in zip(before, after, strict=True):
        for each in (one, other):
            (each["pair"] or {}).pop("rho_damp", None)
    assert before == after


def _settings(seed: int) -> list[dict[str, Any]]:
    return [{key: draw(seed, k).content.get(key) for key in ("types", "pair", "rheo")} for k in range(12)]


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


def test_reasons_name_existing_keys() -> None:
    places = {choice.partition("=")[0] for choice in schema.choices()}
    assert set(rules.NEVER) <= places and all(rules.NEVER.values())
    assert set(rules.GIVEN) | set(rules.HANDLED) | set(rules.RULES) <= places | {"dimension"}
    assert argued("violate=rheo-twice") and argued("rho.table.csv") and not argued("rho")


def test_new_key_is_drawn_without_a_rule(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of every kind, at the top and within objects drawn by rules."""
    made = json.loads(json.dumps(Scene.model_json_schema()))
    made["properties"]["flavour"] = {"anyOf": [{"enum": ["sweet", "sour"]}, {"type": "null"}], "default": None}
    made["$defs"]["EngineSettings"]["properties"]["cores"] = {"type": "integer", "minimum": 2, "maximum": 3}
    made["$defs"]["AtomType"]["properties"]["size"] = {"type": "number", "exclusiveMinimum": 0}
    monkeypatch.setattr(schema, "root", lambda: made)
    assert set(schema.choices()) >= {"flavour=sweet", "flavour=sour", "engine.cores", "types.size"}
    found: set[str] = set()
    for k in range(40):
        found |= schema.taken(content_of(Chance(f"new/{k}")))
    assert {"flavour=sweet", "flavour=sour", "engine.cores", "types.size"} <= found


def test_contents_are_plain_data_of_few_digits() -> None:
    for number in range(10):
        content = draw(2, number).content
        assert json.loads(json.dumps(content)) == content
        for value in _numbers(content):
            assert len(re.sub(r"e.*|[-.]|^0\.0*", "", repr(value)).strip("0")) <= 8, value


def _numbers(part: Any) -> Iterator[float]:
    if isinstance(part, dict | list):
        for each in part.values() if isinstance(part, dict) else part:
            yield from _numbers(each)
    elif isinstance(part, float):
        yield part


NUMBERS = [0.21412187934220184, 6.01, -0.105, 4]


def test_time_steps_suit_unconverted_backgrounds() -> None:
    """With 3e9 atm particles would leave the skin of the neighbour lists in the first step (units-unconverted)."""
    ready = draw(203, 302).ready
    problem = problem_of(ready.case.scene, ready.atoms, "", ready.case.scene.snapshots)
    sim = problem.simulation(stepping=UnitsUnconverted)
    moved = 0.0
    for _ in visit(sim, problem.steps, problem.timestep):
        moved += problem.timestep * float(np.abs(sim.state.v_nc).max())
    assert 0 < moved < ready.case.scene.engine.skin * ready.atoms.spacing / 2


def test_twins_avoid_units_in_which_walls_lose_all_digits() -> None:
    """Volumes of 4e-22 in units lj: densities of walls have a bound of 4e5 after a step, by force-per-volume."""
    chance = Chance("203/301")
    assert "units" in content_of(chance)["twin"]
    assert "twin" not in draw(203, 301).content


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


def test_no_box_shrinks_to_nothing() -> None:
    """One particle: with shrink-wrapped faces LAMMPS ends at 'box size << cutoff'."""
    scene = draw(304, 355).case.scene
    assert len(scene.positions.x) == 1 and not all(scene.positions.periodic)
    assert "s" not in scene.engine.boundary


def test_skin_of_a_twin_limits_the_neighbour_lists() -> None:
    """LAMMPS stopped at more than 2000 neighbours of a particle."""
    ready = draw(604, 145).ready
    twin, atoms = ready.case.scene.twin, ready.atoms
    assert twin is not None and twin.skin is not None
    reach = ready.case.scene.rheo.cut + twin.skin * atoms.spacing
    density = len(atoms) / np.prod(atoms.high_c - atoms.low_c)
    assert 4 / 3 * np.pi * reach**3 * density < 2000


def test_single_particle_in_a_plane_avoids_clear() -> None:
    """LAMMPS refuses its temperature afterwards."""
    content = draw(701, 89).content
    assert len(content["positions"]["x"]) == 1 and content["dimension"] == 2 and len(content["evolve"]["stops"]) == 2
    assert not {"restart", "other scene"} & {stop.get("by") for stop in content["evolve"]["stops"]}
