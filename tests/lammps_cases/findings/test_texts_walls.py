"""What the findings about solids say: every number and every "because" of their texts, by LAMMPS and the reference."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from eos_ref.numbers.number import Array
from lammps_cases.engine.interlude import Interlude
from lammps_cases.engine.session import RunCommand
from lammps_cases.findings.neighbour_lists import after_deletion, first_of_last_cycle, recreated
from lammps_cases.findings.walls import WallsSummedAfterSetup
from lammps_cases.run import prepared_case
from lammps_cases.scene import casefile
from tests.support.told import ENTRIES, Engine, Told, agree, quoted, said, told

pytestmark = pytest.mark.lammps

FORCES, LOST, SUMMED = "force-per-volume", "wall-velocity-lost", "walls-summed-after-setup"
REBUILT, ORDER = "walls-after-rebuild", "walls-depend-on-pair-order"
BEGIN, PARTS = "walls-begin-with-pressure", "walls-begin-with-parts"
CREATED, TWICE = "created-with-forces-of-others", "boundary-pairs-twice"
COLUMNS = 4
HELD = [{"style": "setforce", "types": 2, "vector": [0.0, 0.0]}]


def over_rows(rows: int, v_fluid: float, v_solid: float) -> Told:
    """A row of fluid over rows of solids, all volumes 1: a fluid particle sees one solid, right below it."""
    spacing, cut = said(LOST, "argument", r"\(spacing #, cutoff #\)")
    assert spacing == 1 and cut < np.sqrt(2)
    x = [[i + 0.5, 4.0 - j] for j in range(rows) for i in range(COLUMNS)] + [[i + 0.5, 5.0] for i in range(COLUMNS)]
    solids = rows * COLUMNS
    return told(
        x,
        (COLUMNS, 9),
        v=[[v_solid, 0.0]] * solids + [[v_fluid, 0.0]] * COLUMNS,
        kind=[2] * solids + [1] * COLUMNS,
        types=[{"mass": 1.0, "viscosity": 0.2}, {"mass": 1.0, "viscosity": 0.2, "phase": "solid"}],
        rheo={"cut": float(cut), "interface_reconstruct": True},
    )


def ratio_of_distances(scene: Told) -> float:
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


def test_wall_velocity_lost(lammps: Engine) -> None:
    for rows, part in enumerate(said(LOST, "argument", "over one row of solids # U, over two rows # U"), 1):
        u = 0.7
        ratio = ratio_of_distances(over_rows(rows, 0.0, u))
        assert part.is_rounded(ratio / (1 + ratio))
        force = {v: lammps.fields(over_rows(rows, v, u))[0]["f"][-COLUMNS:, 0] for v in (0.0, part * u, u)}
        right = {v: over_rows(rows, v, u).predicted() for v in force}
        rounding = right[0.0].bounds[0]["f"].max()
        assert np.all(np.abs(force[part * u]) < 4 * rounding) and np.all(force[0.0] > 0), "drags towards this velocity"
        # Together with the container: no force is right, LAMMPS' fluid sees a wall at 0.
        assert np.all(np.abs(right[u].fields[0]["f"][:, 0]) < rounding)
        at_zero = over_rows(rows, 0.0, 0.0).predicted().fields[0]["f"]
        assert not at_zero[:, 0].any()
        assert np.all(force[u] < 0)
        # The workaround: in the frame of the wall LAMMPS has the forces of every frame.
        at_rest = lammps.fields(over_rows(rows, 0.2, 0.0))[0]["f"][-COLUMNS:]
        moving = over_rows(rows, 0.2 + u, u)
        assert np.all(np.abs(at_rest - moving.predicted().fields[0]["f"][-COLUMNS:]) < 4 * rounding)
        in_motion = lammps.fields(moving)[0]["f"][-COLUMNS:]
        assert np.all(np.abs(at_rest - in_motion)[:, 0] > 0.1 * np.abs(at_rest[:, 0]))


def test_walls_are_not_summed_where_no_density_is_asked_for() -> None:
    """As at the first step alone, of a scene that compares positions: nothing has looked for pairs yet."""
    rheo = {"cut": 1.4, "interface_reconstruct": True, "rho_sum": True}
    types = [{"mass": 1.0}, {"mass": 1.0, "phase": "solid"}]
    problem = told([[2.5, 4.0], [2.5, 5.0]], (COLUMNS, 9), kind=[2, 1], types=types, rheo=rheo).problem
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
def test_walls_move_that_are_pushed_after_they_were_held(forces: list[Any], moving: bool, lammps: Engine) -> None:
    scene = told(
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
    driven = Told(model, scene.atoms)
    fluid = slice(-COLUMNS, None)
    found, right = lammps.fields(driven)[0]["f"], driven.predicted()
    assert np.all(np.abs(found - right.fields[0]["f"])[fluid] <= right.bounds[0]["f"][fluid])


def summed(**rheo: Any) -> Told:
    """Three fluid particles beside two solids."""
    return told(
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
    stepped, setup, continued, later, begun = (at["rho"][solid] for at in lammps.answer(again).snapshots)
    assert np.all(np.abs(stepped - sums[solid]) > 0.05) and np.all(np.abs(later - sums[solid]) > 0.05)
    np.testing.assert_allclose([setup, continued, begun], [sums[solid]] * 3, rtol=1e-4)
    assert ENTRIES[SUMMED].workaround == "Look at solids after a step, not after run 0."


def rebuilt(name: str, **engine: Any) -> Told:
    """A shipped case with other settings of the lists."""
    (case,) = casefile.select(casefile.load(), [name])
    settings = case.scene.engine.model_copy(update=engine)
    return Told(case.scene.model_copy(update={"engine": settings}), prepared_case.prepare(case).atoms)


@pytest.mark.slow
def test_walls_after_rebuild(lammps: Engine) -> None:
    percent, name = said(REBUILT, "observed", "by # % in the scene")[0], "open.walls-after-rebuild"
    assert f"in the scene {name}" in ENTRIES[REBUILT].observed
    steps, first = map(
        int, said(REBUILT, "argument", "over # steps with a rebuild in each and other images from step #")
    )
    scene = rebuilt(name)
    found = lammps.fields(scene, every_step=True)
    assert len(found) == 1 + steps
    images = [listed.row_s[len(scene.atoms) :] for listed in found[0]["lists"]]
    changes = [k for k in range(1, len(images)) if not np.array_equal(images[k], images[k - 1])]
    assert changes[0] == first
    assert any("every 1" in line and "check no" in line for line in scene.job.setup)
    # Right before it; wrong in it, in solids alone; and the trajectory keeps a trace.
    every = Told(scene.scene, scene.atoms, tuple(range(first + 2)))
    plain = every.predicted(FORCES)
    assert all(agree(found[k]["rho"], plain, "rho", k) for k in range(first))
    off_n, later_n = (np.abs(found[k]["rho"] / plain.fields[k]["rho"] - 1) for k in (first, first + 1))
    assert percent.is_rounded(100 * off_n.max())
    solid_n = scene.problem.state.solid_n
    assert off_n[solid_n].max() == off_n.max() > 1e4 * off_n[~solid_n].max() and later_n.max() < 1e-5
    assert not agree(found[first + 1]["rho"], plain, "rho", first + 1)
    assert agree(found[first]["chi"], plain, "chi", first) and not agree(found[first]["f"], plain, "f", first)
    # With LAMMPS' own slots every density of all steps.
    all_steps = Told(scene.scene, scene.atoms, tuple(range(steps + 1)))
    following = all_steps.predicted(FORCES, REBUILT, snapshot=found[0])
    assert all(agree(found[k]["rho"], following, "rho", k) for k in range(steps + 1))
    # The workaround: a skin large enough for all steps.
    (check,) = quoted(REBUILT, "workaround")
    assert check == "neigh_modify check yes"
    large = rebuilt(name, check=True, skin=1.0)
    calm = lammps.fields(large, every_step=True)
    assert all(np.array_equal(listed.row_s, calm[0]["lists"][0].row_s) for listed in calm[0]["lists"])
    right = Told(large.scene, large.atoms, (0, steps // 2, steps)).predicted(FORCES)
    assert all(agree(calm[k]["rho"], right, "rho", at) for at, k in enumerate((0, steps // 2, steps)))


FOUR = np.array([[4.0, 4.0], [4.7, 4.9], [3.2, 5.1], [4.3, 5.6]])
TWELVE = np.indices((3, 4)).reshape(2, -1).T + 4.0 + np.random.default_rng(5).uniform(-0.2, 0.2, (12, 2))


def numbered(x: Any, order: Any, kernel: str) -> Told:
    """A solid, the first particle, and fluid, numbered in some order."""
    n = len(x)
    v = 0.1 * np.column_stack([np.arange(n) % 3, np.arange(n) % 2])
    v[0] = 0.0
    rho, kind = 1.0 + 0.01 * (np.arange(n) % 4), np.where(np.arange(n) == 0, 2, 1)
    return told(
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
    assert len(FOUR) == 4 and "the same four particles" in ENTRIES[ORDER].argument
    assert ENTRIES[ORDER].workaround == "Use the quintic kernel, or 2025.7.22.2.0 or newer."
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


def beside_a_wall(
    *stops: dict[str, Any], background: float = -0.3, mass: float = 1.0, density: float = 1.0, **scene: Any
) -> Told:
    """A fluid particle at distance 1 of a solid that is held."""
    x = [[4.0, 4.0], [5.0, 4.0]]
    open_box = {"x": x, "low": [0, 0], "high": [9, 9], "periodic": [False, False]}
    positions, deform = scene.pop("positions", open_box), scene.pop("deform", None)
    linear = [{"types": "*", "style": "linear"}, {"types": "*", "style": "background", "P_b": background}]
    return told(
        positions["x"],
        (9, 9),
        rho=density,
        kind=[2, 1, 1][: len(positions["x"])],
        types=[
            {"mass": mass, "rho0": density, "cs": 1.0},
            {"mass": mass, "rho0": density, "cs": 1.0, "phase": "solid"},
        ],
        pressure=scene.pop("pressure", linear),
        rheo={"interface_reconstruct": True},
        positions=positions,
        forces=HELD,
        evolve={"steps": 1, "timestep": 1e-4, "stops": stops} | ({"deform": deform} if deform else {}),
        compare=["rho", "f"],
        **scene,
    )


def test_walls_begin_with_pressure(lammps: Engine) -> None:
    text = "linear, both of mass, rho0, c and density #, background #, the solid held"
    one, background = said(BEGIN, "argument", text)
    assert one == 1
    first, again = beside_a_wall(), beside_a_wall({"at": 0})
    found, right = lammps.fields(again)[0], again.predicted()
    assert agree(lammps.fields(first)[0]["rho"], first.predicted(), "rho")
    assert abs(right.fields[0]["rho"][0] - 1.0) <= right.bounds[0]["rho"][0]
    density, p, slope = said(BEGIN, "argument", r"the density 1, after a second 'run 0' # = 1 \+ 2 \* # \* 2 \* #")
    assert p == -background and density.is_rounded(found["rho"][0])
    assert found["rho"][0] == pytest.approx(1 + 2 * p * 2 * slope, abs=1e-3)
    assert agree(found["rho"], again.predicted(BEGIN), "rho")
    assert not agree(found["f"], right, "f")
    # Neither divided by the mass: the fit in the same scene of other masses is that of forces, not accelerations.
    heavy = beside_a_wall({"at": 0}, mass=1.7, density=1.7)
    assert agree(lammps.fields(heavy)[0]["rho"], heavy.predicted(BEGIN), "rho")


def test_what_begins_right_after_a_stop_beside_a_wall(lammps: Engine) -> None:
    """A restart keeps the forces; a set-up with new fixes, and a data file without those of fixes, keep nothing."""
    for by, kept in (("restart", True), ("redefined", False), ("data nofix", False), ("set", True)):
        scene = beside_a_wall({"at": 0, "by": by})
        rho = lammps.fields(scene)[0]["rho"]
        assert agree(rho, scene.predicted(BEGIN) if kept else scene.predicted(), "rho"), by
        assert kept == (abs(rho[0] - 1.0) > 0.1)
    refusals = {"displace": "Cannot displace_atoms after", "stretch": "Change_box parameter not allowed after"}
    for moves, refusal in refusals.items():
        with pytest.raises(AssertionError, match=f"{refusal} reading restart file with per-atom info"):
            lammps.answer(beside_a_wall({"at": 0, "by": "restart", moves: {"x": 1.1}}))
    assert "displace_atoms and change_box are refused" in ENTRIES[BEGIN].observed
    # The workarounds: continue, or define the fixes anew after read_restart.
    continued = replace(beside_a_wall(), steps=(0, 1))
    assert all(agree(at["rho"], continued.predicted(FORCES), "rho", k) for k, at in enumerate(lammps.fields(continued)))
    assert quoted(BEGIN, "workaround") == ["run N pre no", "nofix"]


def test_walls_begin_with_what_a_minimisation_evaluates(lammps: Engine) -> None:
    """Densities of the end of a step, pressures of its evaluation; a mere run begins with forces of both of these."""
    found = {}
    for by in ("minimize", "run"):
        scene = replace(beside_a_wall({"at": 1, "by": by}), steps=(0, 1))
        found[by] = lammps.fields(scene)[1]["rho"]
        assert agree(found[by], scene.predicted(FORCES, BEGIN), "rho", 1)
    assert not agree(found["minimize"], scene.predicted(FORCES, BEGIN), "rho", 1)


GAS = {"pressure": [{"types": "*", "style": "ideal/gas", "gamma": 1.4}], "e": [1.0, 1.3]}


@pytest.mark.parametrize(
    ("stop", "change"),
    [({}, GAS), ({}, {"deform": {"x": 300.0}}), ({"displace": {"x": 0.1, "types": 2}}, {})],
    ids=["energies", "positions in a box that grew", "positions before they are displaced"],
)
def test_a_minimisation_evaluates_what_the_last_step_has_left(
    stop: dict[str, Any], change: dict[str, Any], lammps: Engine
) -> None:
    """Pressures of walls are those of the energies found, and pairs those of the positions found."""
    scene = replace(beside_a_wall({"at": 1, "by": "minimize", **stop}, **change), steps=(0, 1))
    found = lammps.fields(scene)[1]["rho"]
    known = (FORCES, BEGIN, *(["heat-is-temperature-rate"] if "e" in change else []))
    assert agree(found, scene.predicted(*known), "rho", 1)
    assert abs(found[0] - scene.predicted(FORCES).fields[1]["rho"][0]) > 1e-3
    assert "positions, densities and energies that it finds" in ENTRIES[BEGIN].observed


def test_a_minimisation_meets_images_where_they_are(lammps: Engine) -> None:
    """Whatever the step before has left behind, in a box that grows."""
    across = {"x": [[8.6, 4.0], [0.3, 4.0]], "low": [0, 0], "high": [9, 9], "periodic": [True, False]}
    scene = beside_a_wall({"at": 1, "by": "minimize"}, positions=across, deform={"x": 300.0})
    scene = replace(scene, steps=(0, 1))
    first, last = lammps.fields(scene, every_step=True)
    assert len(first["lists"]) == 4, "of the set-up, the step, the minimisation and the next set-up"
    assert agree(last["rho"], scene.predicted(FORCES, PARTS, "images-left-behind", snapshot=first), "rho", 1)
    assert not agree(last["rho"], scene.predicted(FORCES), "rho", 1)


def test_created_with_forces_of_others(lammps: Engine) -> None:
    """The slot of the last particle, the first one, is filled by the one before it, whose slot it gets."""
    right, created, kept, none = said(
        CREATED,
        "argument",
        "the density #, and has #, as the new .*; it has # if nothing is created, and would have # if",
    )
    x, box = [[4.0, 4.0], [4.0, 5.0], [3.0, 4.0]], {"low": [0, 0], "high": [9, 9], "periodic": [False, False]}
    for by, density, finding in (("recreated", created, CREATED), ("run", kept, BEGIN)):
        scene = beside_a_wall({"at": 0, "by": by}, positions={"x": x, **box})
        first, *_ = lammps.fields(scene, every_step=True)
        assert density.is_rounded(first["rho"][0])
        assert agree(first["rho"], scene.predicted(finding, snapshot=first), "rho")
        plain = scene.predicted()
        assert abs(plain.fields[0]["rho"][0] - right) <= plain.bounds[0]["rho"][0]
    scene = beside_a_wall({"at": 0, "by": "recreated"}, positions={"x": x, **box})
    assert none.is_rounded(scene.predicted(BEGIN).fields[0]["rho"][0])
    assert ENTRIES[CREATED].workaround == "Take the RHEO fixes away (unfix) and define them anew after create_atoms."
    anew = beside_a_wall({"at": 0, "by": "redefined"}, positions={"x": x, **box})
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
def test_what_slots_hold_after_a_deletion(order: list[int], gone: list[int], held: list[int]) -> None:
    gone_n = np.isin(np.arange(len(order)), gone)
    assert after_deletion(np.array(order), gone_n).tolist() == held


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
def test_what_sorting_moves_first_in_its_last_cycle(order: list[int], sorted_: list[int], first: int | None) -> None:
    assert first_of_last_cycle(np.array(order), np.array(sorted_)) == first


def test_order_of_particles_created_anew() -> None:
    new_n = np.array([False, True, False, True])
    assert recreated(np.array([3, 0, 1, 2]), new_n).tolist() == [2, 0, 1, 3]
    assert recreated(np.array([3, 0, 1, 2]), False).tolist() == [3, 0, 1, 2]


def test_sorting_puts_a_force_into_the_slot_of_the_first_image(lammps: Engine) -> None:
    """Atoms created anew are sorted at the next set-up."""
    assert ENTRIES[PARTS].observed.endswith("the first image has the force of one that was moved.")
    x = [[0.6, 0.3], [2.0, 0.2], [1.97, 12.5], [3.5, 0.4]]
    scene = told(
        x,
        (4.62, 13.86),
        rho=[0.703, 1.861, 0.595, 1.869],
        kind=[3, 2, 1, 2],
        types=[
            {"mass": 1.26, "rho0": 0.595, "cs": 3.38},
            {"mass": 7.05, "rho0": 1.87, "cs": 4.38, "phase": "solid"},
            {"mass": 2.07, "rho0": 0.704, "cs": 3.12},
        ],
        rheo={"cut": 4.71, "interface_reconstruct": True},
        engine={"newton": True},
        forces=[{"style": "setforce", "vector": [0.0, 0.0]}],
        evolve={"steps": 1, "timestep": 1e-4, "stops": [{"at": 0, "by": "recreated"}]},
        compare=["rho"],
    )
    first, *_ = lammps.fields(scene, every_step=True)
    before, after = (listed.row_s[listed.own_s].tolist() for listed in first["lists"][:2])
    assert before == after == [0, 1, 3, 2]  # between the two it was 0, 1, 2, 3: the last is deleted, and made anew
    assert agree(first["rho"], scene.predicted(FORCES, PARTS, CREATED, snapshot=first), "rho")


def test_walls_begin_with_parts(lammps: Engine) -> None:
    x = [[8.5, 4.0], [0.5, 4.0]]
    across = {"x": x, "low": [0, 0], "high": [9, 9]}
    on, off = said(PARTS, "argument", "the density # with newton on, as inside the box, but # with newton off")
    inside = said(BEGIN, "argument", r"a second 'run 0' # =")[0]
    assert on == inside
    for newton, by, density in ((True, "run", on), (False, "run", off), (True, "restart", off)):
        scene = beside_a_wall({"at": 0, "by": by}, positions=across, engine={"newton": newton})
        first, *_ = lammps.fields(scene, every_step=True)
        assert density.is_rounded(first["rho"][0]), (newton, by)
        assert agree(first["rho"], scene.predicted(PARTS, snapshot=first), "rho")
        assert agree(first["rho"], scene.predicted(BEGIN), "rho") == (density == on)
        assert not agree(first["rho"], scene.predicted(), "rho")
    anew = beside_a_wall({"at": 0, "by": "redefined"}, positions=across, engine={"newton": False})
    assert agree(lammps.fields(anew)[0]["rho"], anew.predicted(), "rho"), "the workaround"


def test_a_pair_that_counts_twice_begins_with_the_image_of_either_particle(lammps: Engine) -> None:
    """So that the sum of both forces counts once; a pair within the box has it twice in half the weight."""
    assert "where the pair counts twice, it does so with the image of either particle. " in ENTRIES[PARTS].observed
    assert quoted(PARTS, "observed") == ["newton off on"]
    x = [[8.5, 4.0], [0.5, 4.0], [7.6, 4.6]]
    across = {"x": x, "low": [0, 0], "high": [9, 9]}
    scene = beside_a_wall({"at": 0}, positions=across, engine={"newton": False, "newton_bond": True})
    first, *_ = lammps.fields(scene, every_step=True)
    assert agree(first["rho"], scene.predicted(TWICE, PARTS, snapshot=first), "rho")
    assert not any(agree(first["rho"], scene.predicted(*one, snapshot=first), "rho") for one in ([TWICE], [PARTS]))


def test_a_wall_that_freezes_is_a_wall(lammps: Engine) -> None:
    """A fluid particle below its freezing temperature is solid from the first step on, and its velocity is lost."""
    scene = told(
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
