"""The findings about solids: every number and every "because" of their texts, by LAMMPS and the reference."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from eos_ref.numbers.number import Array
from lammps_cases.engine.session import RunCommand
from lammps_cases.findings.walls import WallsSummedAfterSetup
from lammps_cases.run import prepared_case
from lammps_cases.scene import casefile
from tests.support.printed import ENTRIES, printed, quoted, recomputes
from tests.support.small_scene import Engine, SmallScene, agree, small_scene

pytestmark = pytest.mark.lammps

FORCES, LOST, SUMMED = "force-per-volume", "wall-velocity-lost", "walls-summed-after-setup"
REBUILT, ORDER, ALIGNED = "walls-after-rebuild", "walls-depend-on-pair-order", "aligned-pairs-twice"
COLUMNS = 4
HELD = [{"style": "setforce", "types": 2, "vector": [0.0, 0.0]}]


def over_rows(rows: int, v_fluid: float, v_solid: float, fluids: int = 1) -> SmallScene:
    """Rows of fluid over rows of solids, all volumes 1: a fluid particle sees one solid at most, right below it."""
    n = printed(LOST)
    spacing, cut = n.spacing, n.cut
    assert spacing == 1 and cut < np.sqrt(2)
    x = [[i + 0.5, 5.0 - rows + j] for j in range(rows + fluids) for i in range(COLUMNS)]
    solids, fluid = rows * COLUMNS, fluids * COLUMNS
    return small_scene(
        x,
        (COLUMNS, 11),
        v=[[v_solid, 0.0]] * solids + [[v_fluid, 0.0]] * fluid,
        kind=[2] * solids + [1] * fluid,
        types=[{"mass": 1.0, "viscosity": 0.2}, {"mass": 1.0, "viscosity": 0.2, "phase": "solid"}],
        rheo={"cut": float(cut), "interface_reconstruct": True},
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


@recomputes(LOST, "one_row two_rows rows_1 rows_2", given="spacing cut")
def test_wall_velocity_lost(lammps: Engine) -> dict[str, Any]:
    n, parts = printed(LOST), defaultdict(list)
    rows_of = [
        (1, 1, "one_row"),
        (2, 1, "two_rows"),
        *((1, fluids, "rows_1") for fluids in (2, 3)),
        *((2, fluids, "rows_2") for fluids in (2, 3)),
    ]
    for rows, fluids, name in rows_of:
        part = getattr(n, name)
        u, fluid = 0.7, slice(rows * COLUMNS, None)
        scenes = {v: over_rows(rows, v, u, fluids) for v in (0.0, part * u, u)}
        ratio = ratio_of_distances(scenes[0.0])
        parts[name].append(ratio / (1 + ratio))
        force = {v: lammps.fields(scene)[0]["f"][fluid, 0] for v, scene in scenes.items()}
        right = {v: scene.predicted() for v, scene in scenes.items()}
        rounding = right[0.0].bounds[0]["f"].max()
        beside = slice(COLUMNS)  # the row of fluid that sees solids
        assert np.all(np.abs(force[part * u]) < 4 * rounding) and np.all(force[0.0][beside] > 0), "drags towards it"
        # Together with the container: no force is right, LAMMPS' fluid sees a wall at 0.
        assert np.all(np.abs(right[u].fields[0]["f"][:, 0]) < rounding)
        at_zero = over_rows(rows, 0.0, 0.0, fluids).predicted().fields[0]["f"]
        assert not at_zero[:, 0].any()
        assert np.all(force[u][beside] < 0)
        # The workaround: in the frame of the wall LAMMPS has the forces of every frame.
        at_rest = lammps.fields(over_rows(rows, 0.2, 0.0, fluids))[0]["f"][fluid]
        moving = over_rows(rows, 0.2 + u, u, fluids)
        assert np.all(np.abs(at_rest - moving.predicted().fields[0]["f"][fluid]) < 4 * rounding)
        in_motion = lammps.fields(moving)[0]["f"][fluid]
        assert np.all(np.abs(at_rest - in_motion)[beside, 0] > 0.1 * np.abs(at_rest[beside, 0]))
    return parts


def test_walls_are_not_summed_if_no_density_is_requested() -> None:
    """As at the first step of a scene that compares positions: pairs have not been searched yet."""
    rheo = {"cut": 1.4, "interface_reconstruct": True, "rho_sum": True}
    types = [{"mass": 1.0}, {"mass": 1.0, "phase": "solid"}]
    problem = small_scene([[2.5, 4.0], [2.5, 5.0]], (COLUMNS, 9), kind=[2, 1], types=types, rheo=rheo).problem
    sim = WallsSummedAfterSetup(problem.model, problem.box, problem.state, ("x",))
    sim.setup()
    assert np.array_equal(sim.state.rho_n, problem.state.rho_n)


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
    scene = small_scene(
        [[2.5, 4.0], [2.5, 5.0]],
        (COLUMNS, 9),
        kind=[2, 1],
        types=[{"mass": 1.0}, {"mass": 1.0, "phase": "solid"}],
        rheo={"cut": 1.4, "interface_reconstruct": True},
        forces=forces,
        evolve={"steps": 1, "timestep": 0.01},
        compare=["v"],
    )
    assert bool(lammps.fields(scene)[-1]["v"][0].any()) == moving
    assert ENTRIES[LOST].model_variant.applies(scene.problem) == moving


def test_wall_at_rest_and_fluid_driven(lammps: Engine) -> None:
    """The other workaround: addforce on the fluid, with volumes of 1."""
    scene = over_rows(1, 0.1, 0.0)
    force = [{"style": "addforce", "types": 1, "vector": [0.3, 0.0]}]
    model = scene.scene.model_validate(scene.scene.model_dump(exclude_unset=True) | {"forces": force})
    driven = SmallScene(model, scene.atoms)
    fluid = slice(-COLUMNS, None)
    found, right = lammps.fields(driven)[0]["f"], driven.predicted()
    assert np.all(np.abs(found - right.fields[0]["f"])[fluid] <= right.bounds[0]["f"][fluid])


def summed(**rheo: Any) -> SmallScene:
    """Three fluid particles next to two solids."""
    return small_scene(
        [[4.0, 1.0], [5.0, 1.0], [4.0, 2.2], [5.1, 2.1], [4.4, 3.0]],
        (12, 12),
        rho=None if rheo.get("rho_sum", True) else 1.0,
        kind=[2, 2, 1, 1, 1],
        types=[{"mass": 1.0}, {"mass": 1.0, "phase": "solid"}],
        rheo={"rho_sum": True, "interface_reconstruct": True} | rheo,
        compare=["rho", "f"],
        forces=HELD,
        evolve={"steps": 2, "timestep": 0.004},
    )


def test_walls_summed_after_setup(lammps: Engine) -> None:
    scene = summed()
    plain = summed(interface_reconstruct=False).predicted()
    sums = plain.fields[0]["rho"]
    found, reconstructed = lammps.fields(scene), scene.predicted(FORCES)
    solid = slice(0, 2)
    assert np.all(np.abs(found[0]["rho"] - sums)[solid] <= plain.bounds[0]["rho"][solid])
    assert np.all(np.abs(found[0]["rho"] - reconstructed.fields[0]["rho"])[solid] > 0.05)
    for step in (0, 1, 2):
        assert agree(found[step]["f"], reconstructed, "f", step), "of the densities reconstructed"
        assert agree(found[step]["rho"], reconstructed, "rho", step) == (step > 0)
    assert quoted(SUMMED, "observed") == ["pre no"]
    commands = ("run 1 post no", "run 0 post no", "run 0 pre no post no", "run 1 pre no post no", "run 0 post no")
    again = replace(scene.job, runs=tuple(RunCommand(command) for command in commands))
    stepped, setup, continued, later, begun = lammps.answer(again).snapshots
    assert all(np.all(np.abs(at["rho"] - sums)[solid] > 0.05) for at in (stepped, later))
    for at in (setup, continued, begun):
        moved = replace(scene.atoms, x_nc=np.array(at["x"]))
        there = SmallScene(summed(interface_reconstruct=False).scene, moved, (0,)).predicted()
        assert np.all(np.abs(at["rho"] - there.fields[0]["rho"])[solid] <= there.bounds[0]["rho"][solid])


def rebuilt(name: str, **engine: Any) -> SmallScene:
    """A shipped case with other settings of the lists."""
    (case,) = casefile.select(casefile.load(), [name])
    settings = case.scene.engine.model_copy(update=engine)
    return SmallScene(case.scene.model_copy(update={"engine": settings}), prepared_case.prepare(case).atoms)


@pytest.mark.slow
@recomputes(REBUILT, "percent steps first")
def test_walls_after_rebuild(lammps: Engine) -> dict[str, Any]:
    name = "open.walls-after-rebuild"
    n = printed(REBUILT)
    steps, first = int(n.steps), int(n.first)
    scene = rebuilt(name)
    found = lammps.fields(scene, every_step=True)
    images = [listed.row_s[len(scene.atoms) :] for listed in found[0]["lists"]]
    changes = [k for k in range(1, len(images)) if not np.array_equal(images[k], images[k - 1])]
    assert any("every 1" in line and "check no" in line for line in scene.job.setup)
    # Right before it; wrong in it, in solids alone; and the trajectory keeps a trace.
    every = SmallScene(scene.scene, scene.atoms, tuple(range(first + 2)))
    plain = every.predicted(FORCES)
    assert all(agree(found[k]["rho"], plain, "rho", k) for k in range(first))
    off_n, later_n = (np.abs(found[k]["rho"] / plain.fields[k]["rho"] - 1) for k in (first, first + 1))
    solid_n = scene.problem.state.solid_n
    assert off_n[solid_n].max() == off_n.max() > 1e4 * off_n[~solid_n].max() and later_n.max() < 1e-5
    assert not agree(found[first + 1]["rho"], plain, "rho", first + 1)
    assert agree(found[first]["chi"], plain, "chi", first) and not agree(found[first]["f"], plain, "f", first)
    # With LAMMPS' own slots every density of all steps.
    all_steps = SmallScene(scene.scene, scene.atoms, tuple(range(steps + 1)))
    following = all_steps.predicted(FORCES, REBUILT, snapshot=found[0])
    assert all(agree(found[k]["rho"], following, "rho", k) for k in range(steps + 1))
    # The workaround: a skin large enough for all steps.
    (check,) = quoted(REBUILT, "workaround")
    assert check == "neigh_modify check yes"
    large = rebuilt(name, check=True, skin=1.0)
    calm = lammps.fields(large, every_step=True)
    assert all(np.array_equal(listed.row_s, calm[0]["lists"][0].row_s) for listed in calm[0]["lists"])
    right = SmallScene(large.scene, large.atoms, (0, steps // 2, steps)).predicted(FORCES)
    assert all(agree(calm[k]["rho"], right, "rho", at) for at, k in enumerate((0, steps // 2, steps)))
    return {"percent": 100 * off_n.max(), "steps": len(found) - 1, "first": changes[0]}


FOUR = np.array([[4.0, 4.0], [4.7, 4.9], [3.2, 5.1], [4.3, 5.6]])
TWELVE = np.indices((3, 4)).reshape(2, -1).T + 4.0 + np.random.default_rng(5).uniform(-0.2, 0.2, (12, 2))


def numbered(x: Any, order: Any, kernel: str) -> SmallScene:
    """A solid, the first particle, and fluid, numbered in some order."""
    n = len(x)
    v = 0.1 * np.column_stack([np.arange(n) % 3, np.arange(n) % 2])
    v[0] = 0.0
    rho, kind = 1.0 + 0.01 * (np.arange(n) % 4), np.where(np.arange(n) == 0, 2, 1)
    return small_scene(
        x[order],
        (12, 12),
        v[order],
        rho[order],
        kind=kind[order],
        types=[{"mass": 1.0, "cs": 3.0}, {"mass": 1.0, "cs": 3.0, "phase": "solid"}],
        rheo={"kernel": kernel, "interface_reconstruct": True},
        compare=["rho"],
        forces=HELD,
        evolve={"steps": 1, "timestep": 0.004},
    )


@pytest.mark.slow
@pytest.mark.parametrize(("kernel", "x"), [("quintic", FOUR), ("RK1", FOUR), ("RK2", TWELVE)])
def test_walls_depend_on_pair_order(lammps: Engine, older: Engine, kernel: str, x: Any) -> None:
    solids = []
    for order in (np.arange(len(x)), np.arange(len(x))[::-1]):
        scene = numbered(x, order, kernel)
        found, right = older.fields(scene, every_step=True), scene.predicted()
        solids.append(found[-1]["rho"][order == 0])
        assert agree(found[0]["rho"], right, "rho")
        assert agree(found[-1]["rho"], right, "rho", -1) == (kernel == "quintic")
        if kernel != "quintic":
            assert agree(found[-1]["rho"], scene.predicted(ORDER, snapshot=found[0]), "rho", -1)
        assert agree(lammps.fields(scene)[-1]["rho"], scene.predicted(FORCES), "rho", -1), "the newer one is right"
    assert (np.ptp(solids) > 1e-4) == (kernel != "quintic"), solids


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
        rheo={"cut": 3 * spacing, "kernel": "RK1", "interface_reconstruct": True},
        forces=HELD,
        evolve={"steps": 1, "timestep": 1e-6},
        compare=["rho"],
    )
    found = older.fields(scene, every_step=True)
    for findings, reproduced in (((ORDER, ALIGNED), True), ((ORDER,), False), ((ALIGNED,), False)):
        predicted = scene.predicted(*findings, snapshot=found[0])
        assert agree(found[-1]["rho"], predicted, "rho", -1) == reproduced, findings


def test_a_wall_that_freezes_is_a_wall(lammps: Engine) -> None:
    """A fluid particle below its freezing temperature is solid from the first step on, and its velocity is lost."""
    scene = small_scene(
        [[4.0, 4.0], [5.0, 4.0]],
        (9, 9),
        v=[[0.5, 0.0], [0.5, 0.0]],
        e=[0.5, 1.5],
        types=[{"mass": 1.0, "T_freeze": 1.0}],
        rheo={"interface_reconstruct": True},
        positions={"lattice": "sq", "spacing": 1.0, "cells": [1, 1], "periodic": [False, False]},
        evolve={"steps": 1, "timestep": 1e-3},
        compare=["grad/v", "phase"],
    )
    found = lammps.fields(scene)[1]
    assert found["phase"].tolist() == [1, 0]
    variant = ENTRIES[LOST].model_variant
    assert variant and variant.applies(scene.problem)
    assert agree(found["grad/v"], scene.predicted(LOST), "grad/v", 1)
    assert not agree(found["grad/v"], scene.predicted(), "grad/v", 1)
