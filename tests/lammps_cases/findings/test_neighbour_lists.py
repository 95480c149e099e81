"""Findings that depend on LAMMPS' neighbour lists: reading the lists, the variants they give, and faults in them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.problem import Problem
from lammps_cases.comparison.trajectory import visit
from lammps_cases.engine.session import Answer, Job
from lammps_cases.findings import shown_by
from lammps_cases.findings.neighbour_lists import CountingSteps, FollowingLists, NeighbourList
from lammps_cases.findings.surfaces import LayerOfFirst, StatusOfLayers
from lammps_cases.findings.variants import Variant, combined
from lammps_cases.findings.walls import AccelerationsOfOldImages, GradientOfSecond
from lammps_cases.records.run_record import CaseRecord, EngineRecord
from lammps_cases.run import flow, prepared_case
from lammps_cases.scene import casefile
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan
from lammps_cases.verdict.problems import problem_of
from tests.support.outcome import Outcome, Solver
from tests.workshop.faults.substitute import in_place_of

pytestmark = pytest.mark.lammps

ENGINE = EngineRecord(distribution=version("lammps"))
OLDER = EngineRecord(distribution="2025.7.22.1.0")  # whose order of pairs matters
NEWER = EngineRecord(distribution="2099.1.1")
FIRST = 6  # the first step of the scene of walls-after-rebuild at which the images of the list change

Make = Callable[..., prepared_case.PreparedCase]


def _walls(steps: int, columns: int, **rheo: Any) -> dict[str, Any]:
    """The scene of open.walls-after-rebuild, of which only a few steps are needed here."""
    (known,) = casefile.select(casefile.load(), ["open.walls-after-rebuild"])
    scene: dict[str, Any] = known.scene.model_dump(mode="json", exclude_unset=True)
    scene["rheo"] |= rheo
    scene["evolve"] = {"steps": steps, "timestep": 0.004}
    scene["positions"]["cells"][0] = columns
    return scene


@dataclass(frozen=True)
class Seen:
    """A case, LAMMPS' answer, and the answer with every step and list."""

    ready: prepared_case.PreparedCase
    answer: Answer
    every: Answer

    @property
    def problem(self) -> Problem:
        """The scene with all its steps."""
        steps = tuple(range(len(self.every.snapshots)))
        return problem_of(self.ready.case.scene, self.ready.atoms, "", steps)

    @property
    def lists(self) -> tuple[NeighbourList, ...]:
        """LAMMPS' list at every step."""
        return tuple(NeighbourList.read(self.every.arrays["id"], **arrays) for arrays in self.every.lists)

    def following(self, stages: type[Any]) -> type[Any]:
        """An evaluator that follows LAMMPS' lists."""
        return type("Evaluator", (stages,), {"lists": self.lists})

    def placed(self, stages: type[Any], x_nc: Any = None) -> Any:
        """Such an evaluator at the first positions, or at others."""
        state = self.problem.state
        made = self.following(stages)(self.problem.model, self.problem.box, state.type_n, state.solid_n)
        made.move(state.x_nc if x_nc is None else x_nc)
        return made


@pytest.fixture(scope="module")
def seen(solver: Solver, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Seen]:
    known: dict[str, Seen] = {}

    def ask(steps: int, newton: bool = True, columns: int = 9, sort: int | None = None, **rheo: Any) -> Seen:
        scene = _walls(steps, columns, **rheo)
        scene["engine"] = {"check": False, "newton": newton}
        if sort:
            scene["engine"]["sort"], scene["velocity"] = sort, {"random": 3.0}
        name = f"{steps} {newton} {columns} {sort} {rheo}"
        if name not in known:
            path: Path = tmp_path_factory.mktemp("case") / "case.yaml"
            # The name of the shipped case, as it seeds the particles.
            matrix = {"what": {"walls-after-rebuild": {}}}
            text = {"name": "open", "about": "x", "tags": ["model"], "matrix": matrix, "scene": scene}
            path.write_text(yaml.safe_dump(text))
            ready = prepared_case.prepare(casefile.load_file(path)[0])
            told = job(ready.case.scene, ready.atoms, plan(ready.case.scene), every_step=True, lists=True)
            known[name] = Seen(ready, solver(ready.jobs[0]), solver(told))
        return known[name]

    return ask


@pytest.fixture
def judged(monkeypatch: pytest.MonkeyPatch) -> Callable[..., CaseRecord]:
    """Judge a case; LAMMPS answers the second request with ``every``."""

    def judge(given: Seen, engine: EngineRecord = ENGINE) -> CaseRecord:
        monkeypatch.setattr(prepared_case, "solve", lambda site, told: given.every)
        monkeypatch.setattr(flow, "first_step_outside", lambda *of: None)
        return flow.judge(None, given.ready, [given.answer], engine)[0]

    return judge


def _explained(record: CaseRecord) -> set[str]:
    return {name for field in record.fields for name in field.explained_by}


# --- the lists


@pytest.mark.parametrize("newton", [True, False])
def test_lists_hold_every_pair_and_the_place_of_every_slot(seen: Callable[..., Seen], newton: bool) -> None:
    given = seen(FIRST, newton)
    n, edge = len(given.ready.atoms), np.array(given.problem.box.edge_c)
    for listed, arrays in zip(given.lists, given.every.snapshots, strict=True):
        assert sorted(listed.row_s[:n]) == list(range(n))
        periods_sc = (listed.x_sc - arrays["x"][listed.row_s])[:, :2] / edge
        # Two coordinates inside three boxes, each rounded once, in units of the box.
        assert np.abs(periods_sc - np.round(periods_sc)).max() < 8 * 2.0**-53
        assert listed.pair_ps[:, 0].max() < n
    assert len(given.answer.lists) == 0
    sim = given.problem.simulation(given.following(FollowingLists), CountingSteps)
    crossing = 0
    for _ in visit(sim, given.problem.steps, given.problem.timestep):
        e = sim.evaluator
        forward_p, backward_p = e.forward_p >= 0, e.backward_p >= 0
        assert np.all(forward_p | backward_p)
        assert np.array_equal(forward_p[e.reverse_p], backward_p)
        crossing += np.count_nonzero(forward_p & backward_p)
    assert (crossing > 0) == (not newton)  # without newton a pair across a boundary is listed for each particle


def test_particles_that_left_the_box_are_found(seen: Callable[..., Seen]) -> None:
    given = seen(FIRST)
    found = []
    for turns in (0.0, 3.0):
        x_nc = given.problem.state.x_nc.copy()
        x_nc[::5, 0] += turns * given.problem.box.edge_c[0]
        stages = given.placed(FollowingLists, x_nc)
        found.append((stages.forward_p, stages.backward_p, stages.reverse_p))
    assert all(np.array_equal(one, other) for one, other in zip(*found, strict=True))
    assert np.all(found[0][0] * found[0][1] < 0) and np.all(found[0][2] >= 0)


def test_two_images_of_a_particle_are_two_pairs(seen: Callable[..., Seen]) -> None:
    given = seen(1, columns=4)  # shorter than two cutoffs
    stages = given.placed(FollowingLists)
    assert len(np.unique(np.column_stack([stages.i, stages.j]), axis=0)) < len(stages.i)
    entries_p = np.maximum(stages.forward_p, stages.backward_p)
    assert np.all(np.bincount(entries_p)[entries_p] == 2)  # each for both of its particles
    apart_sc = given.lists[0].x_sc[given.lists[0].pair_ps]
    r_p = np.sqrt(((apart_sc[:, 0] - apart_sc[:, 1]) ** 2).sum(axis=1))
    # Places of two boxes at most, rounded once each on either side; other images are a box away.
    assert np.abs(r_p[entries_p] - stages.r).max() < 16 * 2.0**-53 * max(given.problem.box.edge_c)


@pytest.mark.parametrize(("by", "at"), [("continued", 0), ("continued", 2), ("dt/reset", 2), ("run", 2)])
def test_every_evaluation_has_its_list_across_stops(
    by: str, at: int, case_file: Callable[..., Path], eos_ref_command: Callable[..., Outcome], tmp_path: Path
) -> None:
    """A run that begins without a set-up has the list of the run before; lists are built every step."""
    timestep = {"timestep": 0.01} if by == "dt/reset" else {}
    path = case_file(
        dimension=3,
        positions={"lattice": "sc", "spacing": 1.0, "cells": [4, 4, 4], "disorder": 0.2},
        mass={"ratio": [0.5, 2.0]},
        velocity={"random": 2.0},
        engine={"sort": 1},
        evolve={"steps": 4, "timestep": 0.02, "stops": [{"at": at, "by": by, **timestep}]},
        compare=["f"],
    )
    left = eos_ref_command("run", "--cases", path, "--out", tmp_path / "out")
    assert "1 case: 1 explained" in left.out and "mass-of-first" in left.out


# --- walls after lists were rebuilt, which every wheel shows


def test_slots_explain_walls_after_a_rebuild(seen: Callable[..., Seen], judged: Callable[..., CaseRecord]) -> None:
    given = seen(FIRST)
    record = judged(given)
    assert record.verdict == judged(given, NEWER).verdict == "explained", record.message
    assert "walls-after-rebuild" in _explained(record)
    assert "walls-after-rebuild" in record.message


def test_particles_keep_their_accelerations_when_they_are_sorted(
    seen: Callable[..., Seen], judged: Callable[..., CaseRecord]
) -> None:
    given = seen(9, sort=4)
    n = len(given.ready.atoms)
    orders = [tuple(listed.row_s[:n]) for listed in given.lists]
    assert len(set(orders)) > 1
    record = judged(given)
    assert record.verdict == "explained", record.message
    assert "walls-after-rebuild" in _explained(record)


def test_nothing_else_is_wrong_before_the_images_change(
    seen: Callable[..., Seen], judged: Callable[..., CaseRecord]
) -> None:
    record = judged(seen(FIRST - 1))
    assert record.verdict == "explained", record.message
    assert "walls-after-rebuild" not in _explained(record)


def _with_rows(given: Seen, change: Callable[[Any, int], Any]) -> Seen:
    """The same run with other particles in the slots."""
    n = len(given.ready.atoms)
    lists = tuple(arrays | {"id_s": change(arrays["id_s"], n)} for arrays in given.every.lists)
    return replace(given, every=replace(given.every, lists=lists))


SPOILT: dict[str, Callable[[Seen], Seen]] = {
    "the list after in place of the list before": lambda s: replace(
        s, every=replace(s.every, lists=(*s.every.lists[:-2], s.every.lists[-1], s.every.lists[-1]))
    ),
    "images in another order": lambda s: _with_rows(
        s, lambda id_s, n: np.concatenate([id_s[:n], np.roll(id_s[n:], 1)])
    ),
    "lists of too few steps": lambda s: replace(s, every=replace(s.every, lists=s.every.lists[:-1])),
    "no lists": lambda s: replace(s, every=replace(s.every, lists=())),
    "another run": lambda s: replace(
        s,
        every=replace(
            s.every, snapshots=(*s.every.snapshots[:-1], s.every.snapshots[-1] | {"x": s.answer.arrays["x"] + 1e-15})
        ),
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("fault", SPOILT)
def test_other_lists_explain_nothing(fault: str, seen: Callable[..., Seen], judged: Callable[..., CaseRecord]) -> None:
    assert judged(SPOILT[fault](seen(FIRST))).verdict == "differs"


def test_one_wrong_density_is_not_explained(seen: Callable[..., Seen], judged: Callable[..., CaseRecord]) -> None:
    given = seen(FIRST)
    last = given.answer.arrays
    spoilt_n = last["q.pressure"].copy()
    spoilt_n[3] += 1e-9
    arrays = last | {"q.pressure": spoilt_n}
    answer = replace(given.answer, arrays=arrays, snapshots=(*given.answer.snapshots[:-1], arrays))
    every = replace(given.every, snapshots=(*given.every.snapshots[:-1], arrays))
    assert judged(replace(given, answer=answer, every=every)).verdict == "differs"


def test_slots_beyond_the_old_list_hold_zeros(seen: Callable[..., Seen]) -> None:
    given = seen(FIRST)
    stages, n = given.placed(AccelerationsOfOldImages), len(given.ready.atoms)
    stages.kept_sc = np.ones((n, 2))  # of the atoms alone: all images are new
    images_ps = given.lists[0].pair_ps >= n
    expected_p = (
        np.where(stages.forward_p >= 0, -1.0, 1.0)
        * images_ps.any(axis=1)[np.maximum(stages.forward_p, stages.backward_p)]
    )
    assert np.array_equal(stages._read()[:, 0], expected_p)
    assert expected_p.any()


# --- the order of pairs, which older wheels show


@pytest.mark.parametrize("newton", [True, False])
def test_first_of_a_pair_keeps_the_values_of_the_second(seen: Callable[..., Seen], newton: bool) -> None:
    """Against a loop over LAMMPS' list, pair by pair."""
    given = seen(2, newton, kernel="RK1")
    problem = given.problem
    sim = problem.simulation(given.following(GradientOfSecond), CountingSteps)
    sim.setup()
    e, listed, n = sim.evaluator, given.lists[0], len(given.ready.atoms)
    rho_i, rho_j = e.density_pair(sim.state.rho_n)
    p_n = e.pressure(e.apparent_density(sim.state.rho_n))
    coefficient_p = -(e.mass_n[e.i] / rho_i) * (e.mass_n[e.j] / rho_j) * (p_n[e.i] + p_n[e.j])
    coefficient_p[sim.state.solid_n[e.i] & sim.state.solid_n[e.j]] = 0.0
    directed = {(i, j): p for p, (i, j) in enumerate(zip(e.i.tolist(), e.j.tolist(), strict=True))}
    expected_nc, size_n = np.zeros((n, 2)), np.zeros(n)
    for one, other in listed.pair_ps:
        i, j = listed.row_s[[one, other]].tolist()
        if (i, j) not in directed:  # listed beyond the cutoff
            continue
        own, second = directed[i, j], directed[j, i]
        alone = not newton and other >= n
        g_own, g_second = (np.array([g_a[p] for g_a in e.g]) for p in (own, second))
        expected_nc[i] += coefficient_p[own] * (g_own if alone else -g_second)
        if not alone:
            expected_nc[j] += coefficient_p[second] * g_second
        for k, p in ((i, own), (j, second)):
            size_n[k] += abs(coefficient_p[p]) * max(np.abs(g_own).max(), np.abs(g_second).max())
    # Either sum rounds once per term, and each of its terms at most eight times.
    bound_nc = (2 * 2.0**-53 * (e.coordination_n + 8) * size_n)[:, None]
    assert np.all(np.abs(sim.pressure_force_nc - expected_nc) <= bound_nc)
    plain = problem.simulation()
    plain.setup()
    assert np.array_equal(plain.fields["f"], sim.fields["f"])  # only the kept quantity differs
    assert isinstance(plain.evaluator, ArrayEvaluator)
    assert np.array_equal(plain.evaluator.g, e.g)
    assert np.abs(plain.pressure_force_nc - expected_nc).max() > 1e-3


def _as_older(given: Seen) -> Seen:
    """LAMMPS' answer with the fields that its lists give under the older wheels' findings."""
    problem, scene = given.problem, given.ready.case.scene
    lists = {"lists": given.lists}
    made = combined(
        [e.model_variant for e in shown_by(problem, "2025.7.22.1.0", True) if e.model_variant], problem, lists
    )
    assert made is not None and issubclass(made[0], GradientOfSecond)
    snapshots = []
    for fields, arrays in zip(Predictor().values(problem, made), given.every.snapshots, strict=True):
        snapshots.append(in_place_of(arrays, {name: fields[name].astype(float) for name in scene.compare}))
    compared = tuple(snapshots[step] for step in scene.snapshots)
    answer = replace(given.answer, arrays=compared[-1], snapshots=compared)
    return replace(given, answer=answer, every=replace(given.every, snapshots=tuple(snapshots)))


def test_order_of_pairs_explains_older_wheels(seen: Callable[..., Seen], judged: Callable[..., CaseRecord]) -> None:
    given = _as_older(seen(2, kernel="RK1"))
    record = judged(given, OLDER)
    assert record.verdict == "explained", record.message
    assert _explained(record) == {"walls-depend-on-pair-order"}
    assert judged(given, ENGINE).verdict == "explained"  # also on a wheel that is not known to have it
    turned = tuple(arrays | {"pair_ps": arrays["pair_ps"][:, ::-1]} for arrays in given.every.lists)
    assert judged(replace(given, every=replace(given.every, lists=turned)), OLDER).verdict == "differs"


# --- the layer next to a surface


@pytest.mark.parametrize("case", ["open-layers.reference", "open-layers.newton"])
def test_order_of_pairs_explains_the_layer(case: str, solver: Solver, monkeypatch: pytest.MonkeyPatch) -> None:
    ready = prepared_case.prepare(casefile.select(casefile.load(), [case])[0])
    outcomes: prepared_case.Outcomes = [solver(told) for told in ready.jobs]
    monkeypatch.setattr(prepared_case, "solve", lambda site, told: solver(told))
    record = flow.judge(None, ready, outcomes, ENGINE)[0]
    assert record.verdict == "explained", record.message
    assert _explained(record) == {"layer-depends-on-pair-order"}
    assert flow.judge(None, ready, outcomes, NEWER)[0].verdict == "explained"

    def turned(site: str | None, told: Job) -> Answer:
        answer = solver(told)
        return replace(answer, lists=tuple(a | {"pair_ps": a["pair_ps"][:, ::-1]} for a in answer.lists))

    monkeypatch.setattr(prepared_case, "solve", turned)
    assert flow.judge(None, ready, outcomes, ENGINE)[0].verdict == "differs"


def test_variants_that_share_steps_are_combined_in_any_order(seen: Callable[..., Seen]) -> None:
    given = seen(2, kernel="RK1")
    steps = [CountingSteps, StatusOfLayers, CountingSteps]
    stages = [FollowingLists, LayerOfFirst, GradientOfSecond]
    for order in (1, -1):
        parts = zip(stages[::order], steps[::order], strict=True)
        made = combined([Variant(lambda scene: True, *part) for part in parts], given.problem, {})
        assert made is not None
        assert {GradientOfSecond, LayerOfFirst} <= set(made[0].__mro__)
        assert StatusOfLayers in made[1].__mro__
