"""Findings about solids, also at the beginning of a run: what the numbers in their documents do not show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from eos_ref.numbers.number import Array
from lammps_cases.engine.interlude import Interlude
from lammps_cases.engine.session import RunCommand
from lammps_cases.findings.neighbour_lists import NeighbourList, after_deletion, first_of_last_cycle, recreated
from lammps_cases.findings.walls import WallsSummedAfterSetup
from lammps_cases.run import prepared_case
from lammps_cases.scene import casefile
from tests.support.printed import ENTRIES, printed, quoted, recomputes, works_around
from tests.support.small_scene import Engine, SmallScene, agree, small_scene

pytestmark = pytest.mark.lammps

FORCES, LOST, SUMMED = "force-per-volume", "wall-velocity-lost", "walls-summed-after-setup"
REBUILT, ORDER, ALIGNED = "walls-after-rebuild", "walls-depend-on-pair-order", "aligned-pairs-twice"
BEGIN, PARTS = "walls-begin-with-pressure", "walls-begin-with-parts"
CREATED, TWICE, BEHIND = "created-with-forces-of-others", "boundary-pairs-twice", "images-left-behind"
COLUMNS = 4
HELD = [{"style": "setforce", "types": 2, "vector": [0.0, 0.0]}]
WALL = {"interface_reconstruct": True}
PLAIN = [{"mass": 1.0}, {"mass": 1.0, "phase": "solid"}]


# --- wall-velocity-lost


def over_rows(rows: int, v_fluid: float, v_solid: float, fluids: int = 1, **options: Any) -> SmallScene:
    """Rows of fluid over rows of solids, all volumes 1: a fluid particle sees one solid at most, right below it."""
    n = printed(LOST)
    assert n.spacing == 1 and n.cut < np.sqrt(2)
    x = [[i + 0.5, 5.0 - rows + j] for j in range(rows + fluids) for i in range(COLUMNS)]
    solids, fluid = rows * COLUMNS, fluids * COLUMNS
    return small_scene(
        x,
        (COLUMNS, 11),
        v=[[v_solid, 0.0]] * solids + [[v_fluid, 0.0]] * fluid,
        kind=[2] * solids + [1] * fluid,
        types=[{"mass": 1.0, "viscosity": 0.2}, {"mass": 1.0, "viscosity": 0.2, "phase": "solid"}],
        rheo={"cut": float(n.cut), **WALL},
        **options,
    )


def ratio_of_distances(scene: SmallScene) -> float:
    """d_s/d_f of the pairs of solid and fluid, as the reference computes it."""
    seen: list[Any] = []

    class Recording(ArrayEvaluator):
        def wall_velocity(self, v_solid: Array, v_fluid: Array, ratio: Array) -> Array:
            seen.append(ratio[~self.solid_n[self.i] & self.solid_n[self.j]])
            return super().wall_velocity(v_solid, v_fluid, ratio)

    problem = scene.problem
    Simulation(problem.model, problem.box, problem.state, ("f",), Recording).setup()
    assert np.ptp(seen[0]) == 0
    return float(seen[0][0])


ROWS = [(1, 1, "one_row"), (2, 1, "two_rows"), (1, 2, "rows_1"), (1, 3, "rows_1"), (2, 2, "rows_2"), (2, 3, "rows_2")]


@works_around(LOST, 1)
@pytest.mark.parametrize(("rows", "fluids", "name"), ROWS)
@recomputes(LOST, "one_row two_rows rows_1 rows_2", given="spacing cut", some=True)
def test_wall_velocity_lost(lammps: Engine, rows: int, fluids: int, name: str) -> dict[str, Any]:
    part, u, fluid, beside = vars(printed(LOST))[name], 0.7, slice(rows * COLUMNS, None), slice(COLUMNS)
    scenes = {v: over_rows(rows, v, u, fluids) for v in (0.0, part * u, u)}
    ratio = ratio_of_distances(scenes[0.0])
    force = {v: lammps.fields(scene)[0]["f"][fluid, 0] for v, scene in scenes.items()}
    right = {v: scene.predicted() for v, scene in scenes.items()}
    rounding = right[0.0].bounds[0]["f"].max()
    # Those of the row of fluid that sees solids.
    assert np.all(np.abs(force[part * u]) < 4 * rounding) and np.all(force[0.0][beside] > 0), "drags towards it"
    # Together with the container: no force is right, LAMMPS' fluid sees a wall at 0.
    assert np.all(np.abs(right[u].fields[0]["f"][:, 0]) < rounding)
    assert not over_rows(rows, 0.0, 0.0, fluids).predicted().fields[0]["f"][:, 0].any()
    assert np.all(force[u][beside] < 0)
    # The workaround: in the frame of the wall LAMMPS has the forces of every frame.
    at_rest = lammps.fields(over_rows(rows, 0.2, 0.0, fluids))[0]["f"][fluid]
    moving = over_rows(rows, 0.2 + u, u, fluids)
    assert np.all(np.abs(at_rest - moving.predicted().fields[0]["f"][fluid]) < 4 * rounding)
    in_motion = lammps.fields(moving)[0]["f"][fluid]
    assert np.all(np.abs(at_rest - in_motion)[beside, 0] > 0.1 * np.abs(at_rest[beside, 0]))
    return {name: ratio / (1 + ratio)}


PUSH = {"style": "gravity", "types": 2, "vector": [1.0, 0.0]}


@pytest.mark.parametrize(
    ("forces", "moving"),
    [
        (HELD, False),
        ([*HELD, PUSH], True),
        ([PUSH, *HELD], False),
        ([*HELD, PUSH | {"types": 1}], False),
        ([*HELD, PUSH | {"vector": [0.0, 0.0]}], False),
    ],
)
def test_walls_pushed_after_being_held_move(forces: list[Any], moving: bool, lammps: Engine) -> None:
    given: dict[str, Any] = {"types": PLAIN, "rheo": {"cut": 1.4, **WALL}, "forces": forces, "compare": ["v"]}
    evolve = {"steps": 1, "timestep": 0.01}
    scene = small_scene([[2.5, 4.0], [2.5, 5.0]], (COLUMNS, 9), kind=[2, 1], evolve=evolve, **given)
    assert bool(lammps.fields(scene)[-1]["v"][0].any()) == moving
    assert ENTRIES[LOST].model_variant.applies(scene.problem) == moving


@works_around(LOST, 2)
def test_wall_at_rest_and_fluid_driven(lammps: Engine) -> None:
    """By addforce on the fluid, with volumes of 1."""
    driven = over_rows(1, 0.1, 0.0, forces=[{"style": "addforce", "types": 1, "vector": [0.3, 0.0]}])
    fluid, found, right = slice(-COLUMNS, None), lammps.fields(driven)[0]["f"], driven.predicted()
    assert np.all(np.abs(found - right.fields[0]["f"])[fluid] <= right.bounds[0]["f"][fluid])


def test_a_wall_that_freezes_is_a_wall(lammps: Engine) -> None:
    """A fluid particle below its freezing temperature is solid from the first step on, and its velocity is lost."""
    scene = small_scene(
        [[4.0, 4.0], [5.0, 4.0]],
        (9, 9),
        v=[[0.5, 0.0], [0.5, 0.0]],
        e=[0.5, 1.5],
        types=[{"mass": 1.0, "T_freeze": 1.0}],
        rheo=WALL,
        positions={"lattice": "sq", "spacing": 1.0, "cells": [1, 1], "periodic": [False, False]},
        evolve={"steps": 1, "timestep": 1e-3},
        compare=["grad/v", "phase"],
    )
    found, variant = lammps.fields(scene)[1], ENTRIES[LOST].model_variant
    assert found["phase"].tolist() == [1, 0] and variant and variant.applies(scene.problem)
    assert agree(found["grad/v"], scene.predicted(LOST), "grad/v", 1)
    assert not agree(found["grad/v"], scene.predicted(), "grad/v", 1)


# --- walls-summed-after-setup


def test_walls_are_not_summed_if_no_density_is_requested() -> None:
    """As at the first step of a scene that compares positions: pairs have not been searched yet."""
    rheo = {"cut": 1.4, "rho_sum": True, **WALL}
    problem = small_scene([[2.5, 4.0], [2.5, 5.0]], (COLUMNS, 9), kind=[2, 1], types=PLAIN, rheo=rheo).problem
    sim = WallsSummedAfterSetup(problem.model, problem.box, problem.state, ("x",))
    sim.setup()
    assert np.array_equal(sim.state.rho_n, problem.state.rho_n)


def summed(**rheo: Any) -> SmallScene:
    """Three fluid particles next to two solids."""
    return small_scene(
        [[4.0, 1.0], [5.0, 1.0], [4.0, 2.2], [5.1, 2.1], [4.4, 3.0]],
        (12, 12),
        rho=None,
        kind=[2, 2, 1, 1, 1],
        types=PLAIN,
        rheo={"rho_sum": True, **WALL} | rheo,
        compare=["rho", "f"],
        forces=HELD,
        evolve={"steps": 2, "timestep": 0.004},
    )


@works_around(SUMMED, 1)
@works_around("solids-summed", 2)
def test_walls_summed_after_setup(lammps: Engine) -> None:
    scene, plain, solid = summed(), summed(interface_reconstruct=False), slice(0, 2)
    sums, found, reconstructed = plain.predicted(), lammps.fields(scene), scene.predicted(FORCES)
    assert np.all(np.abs(found[0]["rho"] - sums.fields[0]["rho"])[solid] <= sums.bounds[0]["rho"][solid])
    assert np.all(np.abs(found[0]["rho"] - reconstructed.fields[0]["rho"])[solid] > 0.05)
    for step in (0, 1, 2):
        assert agree(found[step]["f"], reconstructed, "f", step), "of the densities reconstructed"
        assert agree(found[step]["rho"], reconstructed, "rho", step) == (step > 0)
    assert quoted(SUMMED, "observed") == ["pre no"]
    commands = ("run 1 post no", "run 0 post no", "run 0 pre no post no", "run 1 pre no post no", "run 0 post no")
    again = replace(scene.job, runs=tuple(RunCommand(command) for command in commands))
    stepped, setup, continued, later, begun = lammps.answer(again).snapshots
    assert all(np.all(np.abs(at["rho"] - sums.fields[0]["rho"])[solid] > 0.05) for at in (stepped, later))
    for at in (setup, continued, begun):
        there = SmallScene(plain.scene, replace(scene.atoms, x_nc=np.array(at["x"])), (0,)).predicted()
        assert np.all(np.abs(at["rho"] - there.fields[0]["rho"])[solid] <= there.bounds[0]["rho"][solid])


# --- walls-after-rebuild, walls-depend-on-pair-order


def rebuilt(**engine: Any) -> SmallScene:
    """A shipped case with other settings of the lists."""
    (case,) = casefile.select(casefile.load(), ["open.walls-after-rebuild"])
    settings = case.scene.engine.model_copy(update=engine)
    return SmallScene(case.scene.model_copy(update={"engine": settings}), prepared_case.prepare(case).atoms)


@pytest.mark.slow
@works_around(REBUILT, 2)
@recomputes(REBUILT, "percent steps first")
def test_walls_after_rebuild(lammps: Engine) -> dict[str, Any]:
    n, scene = printed(REBUILT), rebuilt()
    steps, first = int(n.steps), int(n.first)
    found = lammps.fields(scene, every_step=True)
    images = [listed.row_s[len(scene.atoms) :] for listed in found[0]["lists"]]
    changes = [k for k in range(1, len(images)) if not np.array_equal(images[k], images[k - 1])]
    assert any("every 1" in line and "check no" in line for line in scene.job.setup)
    # Right before it; wrong in it, in solids alone; and the trajectory keeps a trace.
    plain = replace(scene, steps=tuple(range(first + 2))).predicted(FORCES)
    assert all(agree(found[k]["rho"], plain, "rho", k) for k in range(first))
    off_n, later_n = (np.abs(found[k]["rho"] / plain.fields[k]["rho"] - 1) for k in (first, first + 1))
    solid_n = scene.problem.state.solid_n
    assert off_n[solid_n].max() == off_n.max() > 1e4 * off_n[~solid_n].max() and later_n.max() < 1e-5
    assert not agree(found[first + 1]["rho"], plain, "rho", first + 1)
    assert agree(found[first]["chi"], plain, "chi", first) and not agree(found[first]["f"], plain, "f", first)
    # With LAMMPS' own slots every density of all steps.
    following = replace(scene, steps=tuple(range(steps + 1))).predicted(FORCES, REBUILT, snapshot=found[0])
    assert all(agree(found[k]["rho"], following, "rho", k) for k in range(steps + 1))
    # The workaround: a skin large enough for all steps.
    assert quoted(REBUILT, "workaround") == ["neigh_modify check yes"]
    some = (0, steps // 2, steps)
    large = replace(rebuilt(check=True, skin=1.0), steps=some)
    calm, right = lammps.fields(large, every_step=True), large.predicted(FORCES)
    assert all(np.array_equal(listed.row_s, calm[0]["lists"][0].row_s) for listed in calm[0]["lists"])
    assert all(agree(calm[k]["rho"], right, "rho", at) for at, k in enumerate(some))
    return {"percent": 100 * off_n.max(), "steps": len(found) - 1, "first": changes[0]}


FOUR = np.array([[4.0, 4.0], [4.7, 4.9], [3.2, 5.1], [4.3, 5.6]])
TWELVE = np.indices((3, 4)).reshape(2, -1).T + 4.0 + np.random.default_rng(5).uniform(-0.2, 0.2, (12, 2))


@pytest.mark.slow
@works_around(ORDER, 1)
@pytest.mark.parametrize(("kernel", "x"), [("quintic", FOUR), ("RK1", FOUR), ("RK2", TWELVE)])
def test_walls_depend_on_pair_order(lammps: Engine, older: Engine, kernel: str, x: Any) -> None:
    """A solid, the first particle, and fluid, numbered in either order."""
    n, right_order = len(x), kernel == "quintic"
    v = 0.1 * np.column_stack([np.arange(n) % 3, np.arange(n) % 2])
    v[0] = 0.0
    rho, kind = 1.0 + 0.01 * (np.arange(n) % 4), np.where(np.arange(n) == 0, 2, 1)
    types = [{"mass": 1.0, "cs": 3.0}, {"mass": 1.0, "cs": 3.0, "phase": "solid"}]
    given: dict[str, Any] = {"types": types, "rheo": {"kernel": kernel, **WALL}, "compare": ["rho"], "forces": HELD}
    solids = []
    for order in (np.arange(n), np.arange(n)[::-1]):
        evolve = {"steps": 1, "timestep": 0.004}
        scene = small_scene(x[order], (12, 12), v[order], rho[order], kind=kind[order], evolve=evolve, **given)
        found, right = older.fields(scene, every_step=True), scene.predicted()
        solids.append(found[-1]["rho"][order == 0])
        assert agree(found[0]["rho"], right, "rho") and agree(found[-1]["rho"], right, "rho", -1) == right_order
        assert right_order or agree(found[-1]["rho"], scene.predicted(ORDER, snapshot=found[0]), "rho", -1)
        assert agree(lammps.fields(scene)[-1]["rho"], scene.predicted(FORCES), "rho", -1), "the newer one is right"
    assert (np.ptp(solids) > 1e-4) != right_order, solids


def test_pairs_that_count_twice_have_a_gradient_of_either_particle(older: Engine) -> None:
    """In a leaning box whose distances are small numbers, with newton on: once the first one's, once the second's."""
    spacing = 2.0**-7
    x = (np.indices((3, 4)).reshape(2, -1).T + 0.5) * spacing
    x[:, 0] += (x[:, 1] > 2 * spacing) * spacing  # within the box
    random, kind = np.random.default_rng(3), np.where(x[:, 1] < spacing, 2, 1)
    v = random.uniform(-0.1, 0.1, x.shape) * (kind == 1)[:, None]
    scene = small_scene(
        x,
        (3 * spacing, 4 * spacing),
        v,
        random.uniform(0.95, 1.05, len(x)),
        kind=kind,
        types=[{"mass": spacing**2}, {"mass": spacing**2, "phase": "solid"}],
        positions={"lattice": "sq", "spacing": spacing, "cells": [1, 1], "tilt": [spacing]},
        rheo={"cut": 3 * spacing, "kernel": "RK1", **WALL},
        forces=HELD,
        evolve={"steps": 1, "timestep": 1e-6},
        compare=["rho"],
    )
    found = older.fields(scene, every_step=True)
    for findings, reproduced in (((ORDER, ALIGNED), True), ((ORDER,), False), ((ALIGNED,), False)):
        predicted = scene.predicted(*findings, snapshot=found[0])
        assert agree(found[-1]["rho"], predicted, "rho", -1) == reproduced, findings


# --- walls-begin-with-pressure


def beside_a_wall(
    *stops: dict[str, Any],
    x: Any = ((4.0, 4.0), (5.0, 4.0)),
    periodic: Sequence[bool] = (False, False),
    background: float = -0.3,
    mass: float = 1.0,
    deform: Any = None,
    steps: tuple[int, ...] | None = None,
    **scene: Any,
) -> SmallScene:
    """A fluid particle at distance 1 of a solid that is held; of volume 1."""
    linear = [{"types": "*", "style": "linear"}, {"types": "*", "style": "background", "P_b": background}]
    fluid = {"mass": mass, "rho0": mass, "cs": 1.0}
    given: dict[str, Any] = {
        "types": [fluid, fluid | {"phase": "solid"}],
        "pressure": linear,
        "rheo": WALL,
        "positions": {"x": [list(one) for one in x], "low": [0, 0], "high": [9, 9], "periodic": list(periodic)},
        "forces": HELD,
        "evolve": {"steps": 1, "timestep": 1e-4, "stops": stops} | ({"deform": deform} if deform else {}),
        "compare": ["rho", "f"],
    }
    return replace(small_scene(x, (9, 9), rho=mass, kind=[2, 1, 1][: len(x)], **given | scene), steps=steps)


@pytest.mark.parametrize("mass", [1.0, 1.7])
def test_walls_begin_with_pressure_forces_not_accelerations(lammps: Engine, mass: float) -> None:
    """Neither divided by the mass: the fit in the same scene of other masses is that of forces."""
    first, again = beside_a_wall(mass=mass), beside_a_wall({"at": 0}, mass=mass)
    found, right = lammps.fields(again)[0], again.predicted()
    assert agree(lammps.fields(first)[0]["rho"], first.predicted(), "rho")
    assert agree(found["rho"], again.predicted(BEGIN), "rho") and not agree(found["f"], right, "f")


@works_around(BEGIN, 5)
@pytest.mark.parametrize(
    ("by", "kept"), [("restart", True), ("redefined", False), ("data nofix", False), ("set", True)]
)
def test_forces_kept_right_after_a_stop_next_to_a_wall(lammps: Engine, by: str, kept: bool) -> None:
    """A restart keeps the forces; a set-up with new fixes, and a data file without those of fixes, keep nothing."""
    scene = beside_a_wall({"at": 0, "by": by})
    rho = lammps.fields(scene)[0]["rho"]
    assert agree(rho, scene.predicted(*[BEGIN] * kept), "rho") and kept == (abs(rho[0] - 1.0) > 0.1)


@pytest.mark.parametrize(
    ("moves", "refusal"),
    [("displace", "Cannot displace_atoms after"), ("stretch", "Change_box parameter not allowed after")],
)
def test_moves_after_a_restart_next_to_a_wall_are_refused(lammps: Engine, moves: str, refusal: str) -> None:
    with pytest.raises(AssertionError, match=f"{refusal} reading restart file with per-atom info"):
        lammps.answer(beside_a_wall({"at": 0, "by": "restart", moves: {"x": 1.1}}))


def test_walls_begin_with_the_evaluations_of_a_minimisation(lammps: Engine) -> None:
    """Densities of the end of a step, pressures of its evaluation; a mere run begins with forces of both of these."""
    found = {}
    for by in ("minimize", "run"):
        scene = beside_a_wall({"at": 1, "by": by}, steps=(0, 1))
        found[by] = lammps.fields(scene)[1]["rho"]
        assert agree(found[by], scene.predicted(FORCES, BEGIN), "rho", 1)
    assert not agree(found["minimize"], scene.predicted(FORCES, BEGIN), "rho", 1)


GAS = {"pressure": [{"types": "*", "style": "ideal/gas", "gamma": 1.4}], "e": [1.0, 1.3]}


@pytest.mark.parametrize(
    ("stop", "change"),
    [({}, GAS), ({}, {"deform": {"x": 300.0}}), ({"displace": {"x": 0.1, "types": 2}}, {})],
    ids=["energies", "positions in a box that grew", "positions before they are displaced"],
)
def test_minimisation_evaluates_the_state_of_the_last_step(
    stop: dict[str, Any], change: dict[str, Any], lammps: Engine
) -> None:
    """Pressures of walls are those of the energies found, and pairs those of the positions found."""
    scene = beside_a_wall({"at": 1, "by": "minimize", **stop}, steps=(0, 1), **change)
    found = lammps.fields(scene)[1]["rho"]
    known = (FORCES, BEGIN, *(["heat-is-temperature-rate"] if "e" in change else []))
    assert agree(found, scene.predicted(*known), "rho", 1)
    assert abs(found[0] - scene.predicted(FORCES).fields[1]["rho"][0]) > 1e-3


def test_a_minimisation_meets_images_where_they_are(lammps: Engine) -> None:
    """Even those that the step before has left behind in a box that grows."""
    across: dict[str, Any] = {"x": ((8.6, 4.0), (0.3, 4.0)), "periodic": (True, False), "deform": {"x": 300.0}}
    scene = beside_a_wall({"at": 1, "by": "minimize"}, steps=(0, 1), **across)
    first, last = lammps.fields(scene, every_step=True)
    assert len(first["lists"]) == 4, "of the set-up, the step, the minimisation and the next set-up"
    assert agree(last["rho"], scene.predicted(FORCES, PARTS, BEHIND, snapshot=first), "rho", 1)
    assert not agree(last["rho"], scene.predicted(FORCES), "rho", 1)


# --- created-with-forces-of-others, walls-begin-with-parts


@works_around(CREATED, 1)
def test_created_with_forces_of_others(lammps: Engine) -> None:
    """The slot of the last particle, the first one, is filled by the one before it, whose slot it gets."""
    scene, anew = (
        beside_a_wall({"at": 0, "by": by}, x=((4.0, 4.0), (4.0, 5.0), (3.0, 4.0))) for by in ("recreated", "redefined")
    )
    first, between, *others = scene.job.runs
    assert isinstance(between, Interlude) and isinstance(anew.job.runs[1], Interlude)
    both = replace(between, actions=(*between.actions, *anew.job.runs[1].actions))
    snapshot = lammps.answer(replace(scene.job, runs=(first, both, *others))).snapshots[0]
    assert agree(snapshot["rho"], anew.predicted(), "rho")


@pytest.mark.parametrize(
    ("order", "gone", "held"),
    [
        ([0, 1, 2, 3], [3], [0, 1, 2, 3]),
        ([0, 1, 2, 3], [1], [0, 3, 2, 3]),
        ([3, 1, 0, 2], [1, 2], [3, 0, 0, 2]),
        ([0, 1, 2, 3], [2, 3], [0, 1, 3, 3]),
        ([0, 3, 2, 1], [2, 3], [0, 1, 2, 1]),
    ],
)
def test_contents_of_slots_after_a_deletion(order: list[int], gone: list[int], held: list[int]) -> None:
    assert after_deletion(np.array(order), np.isin(np.arange(len(order)), gone)).tolist() == held


def test_particle_that_moves_over_a_corner_leaves_its_value_on_the_way() -> None:
    """Four processes in a square: two particles go from the first to the last by way of the second, the last on top."""
    low_rc = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]])

    def listed(*row_rs: list[int]) -> NeighbourList:
        row_s, rank_s = np.concatenate(row_rs).astype(int), np.repeat(np.arange(4), [len(rows) for rows in row_rs])
        own_s = np.array([row_s[at] not in row_s[:at] for at in range(len(row_s))])
        pairs = np.zeros((0, 2), int)
        return NeighbourList(row_s, np.zeros((len(row_s), 3)), own_s, pairs, rank_s, low_rc, np.array([True, True]))

    old = listed([0, 1], [2, 3], [4, 5], [6, 7])
    new = listed([], [2, 3, 2, 3, 2], [4, 5], [6, 7, 0, 1])  # the second has three images afterwards
    held_sc = 10.0 * np.arange(8)[:, None]
    content_s = old.left_to(new, held_sc, 1.0 + np.arange(8)[:, None])[:, 0]
    assert content_s.tolist() == [3.0, 4.0, 2.0, 2.0, 0.0, 5.0, 6.0, 7.0, 8.0, 1.0, 2.0]


@pytest.mark.parametrize(
    ("order", "sorted_", "first"),
    [
        ([0, 1, 2], [0, 1, 2], None),
        ([5, 7, 6, 8], [7, 5, 8, 6], 6),
        ([5, 7, 6, 8], [7, 5, 8, 6][::-1], 7),
        ([3, 4, 1, 2], [4, 3, 2, 1], 1),
        ([3, 4, 1, 2], [4, 3, 2, 9], None),
    ],
)
def test_first_move_in_the_last_cycle_of_sorting(order: list[int], sorted_: list[int], first: int | None) -> None:
    assert first_of_last_cycle(np.array(order), np.array(sorted_)) == first


def test_order_of_recreated_particles() -> None:
    assert recreated(np.array([3, 0, 1, 2]), np.array([False, True, False, True])).tolist() == [2, 0, 1, 3]
    assert recreated(np.array([3, 0, 1, 2]), False).tolist() == [3, 0, 1, 2]


def test_sorting_puts_a_force_into_the_slot_of_the_first_image(lammps: Engine) -> None:
    """Recreated atoms are sorted at the next set-up."""
    scene = small_scene(
        [[0.6, 0.3], [2.0, 0.2], [1.97, 12.5], [3.5, 0.4]],
        (4.62, 13.86),
        rho=[0.703, 1.861, 0.595, 1.869],
        kind=[3, 2, 1, 2],
        types=[
            {"mass": 1.26, "rho0": 0.595, "cs": 3.38},
            {"mass": 7.05, "rho0": 1.87, "cs": 4.38, "phase": "solid"},
            {"mass": 2.07, "rho0": 0.704, "cs": 3.12},
        ],
        rheo={"cut": 4.71, **WALL},
        engine={"newton": True},
        forces=[{"style": "setforce", "vector": [0.0, 0.0]}],
        evolve={"steps": 1, "timestep": 1e-4, "stops": [{"at": 0, "by": "recreated"}]},
        compare=["rho"],
    )
    first, *_ = lammps.fields(scene, every_step=True)
    before, after = (listed.row_s[listed.own_s].tolist() for listed in first["lists"][:2])
    assert before == after == [0, 1, 3, 2]  # between the two it was 0, 1, 2, 3: the last is deleted and created again
    assert agree(first["rho"], scene.predicted(FORCES, PARTS, CREATED, snapshot=first), "rho")


@pytest.mark.parametrize(
    ("newton", "by", "inside"), [(True, "run", True), (False, "run", False), (True, "restart", False)]
)
def test_walls_begin_with_parts(lammps: Engine, newton: bool, by: str, inside: bool) -> None:
    """With newton on as inside the box, unless after a restart."""
    assert printed(PARTS).newton_on == printed(BEGIN).density
    across: dict[str, Any] = {"x": ((8.5, 4.0), (0.5, 4.0)), "periodic": (True, True), "engine": {"newton": newton}}
    scene = beside_a_wall({"at": 0, "by": by}, **across)
    first, *_ = lammps.fields(scene, every_step=True)
    assert agree(first["rho"], scene.predicted(PARTS, snapshot=first), "rho")
    assert agree(first["rho"], scene.predicted(BEGIN), "rho") == inside
    assert not agree(first["rho"], scene.predicted(), "rho")


def test_a_pair_that_counts_twice_begins_with_the_image_of_either_particle(lammps: Engine) -> None:
    """So that the sum of both forces counts once; a pair within the box has it twice in half the weight."""
    assert quoted(PARTS, "observed") == ["newton off on"]
    x, apart = ((8.5, 4.0), (0.5, 4.0), (7.6, 4.6)), {"newton": False, "newton_bond": True}
    scene = beside_a_wall({"at": 0}, x=x, periodic=(True, True), engine=apart)
    first, *_ = lammps.fields(scene, every_step=True)
    assert agree(first["rho"], scene.predicted(TWICE, PARTS, snapshot=first), "rho")
    assert not any(agree(first["rho"], scene.predicted(*one, snapshot=first), "rho") for one in ([TWICE], [PARTS]))
