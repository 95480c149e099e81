"""The findings about solids at the beginning of a run: every number and every "because" of their texts."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lammps_cases.engine.interlude import Interlude
from lammps_cases.findings.neighbour_lists import after_deletion, first_of_last_cycle, recreated
from tests.support.printed import printed, quoted, recomputes
from tests.support.small_scene import Engine, SmallScene, agree, small_scene

pytestmark = pytest.mark.lammps

FORCES = "force-per-volume"
BEGIN, PARTS = "walls-begin-with-pressure", "walls-begin-with-parts"
CREATED, TWICE = "created-with-forces-of-others", "boundary-pairs-twice"
HELD = [{"style": "setforce", "types": 2, "vector": [0.0, 0.0]}]


def beside_a_wall(
    *stops: dict[str, Any], background: float = -0.3, mass: float = 1.0, density: float = 1.0, **scene: Any
) -> SmallScene:
    """A fluid particle at distance 1 of a solid that is held."""
    x = [[4.0, 4.0], [5.0, 4.0]]
    open_box = {"x": x, "low": [0, 0], "high": [9, 9], "periodic": [False, False]}
    positions, deform = scene.pop("positions", open_box), scene.pop("deform", None)
    linear = [{"types": "*", "style": "linear"}, {"types": "*", "style": "background", "P_b": background}]
    return small_scene(
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


@recomputes(BEGIN, "one distance cut density pressure", given="background slope")
def test_walls_begin_with_pressure(lammps: Engine) -> dict[str, Any]:
    n = printed(BEGIN)
    first, again = beside_a_wall(), beside_a_wall({"at": 0})
    found, right = lammps.fields(again)[0], again.predicted()
    assert agree(lammps.fields(first)[0]["rho"], first.predicted(), "rho")
    assert abs(right.fields[0]["rho"][0] - 1.0) <= right.bounds[0]["rho"][0]
    p, slope = n.pressure, n.slope
    assert found["rho"][0] == pytest.approx(1 + 2 * p * 2 * slope, rel=0, abs=2 * p * 2 * slope.half_unit)
    assert agree(found["rho"], again.predicted(BEGIN), "rho")
    assert not agree(found["f"], right, "f")
    # Neither divided by the mass: the fit in the same scene of other masses is that of forces, not accelerations.
    heavy = beside_a_wall({"at": 0}, mass=1.7, density=1.7)
    assert agree(lammps.fields(heavy)[0]["rho"], heavy.predicted(BEGIN), "rho")
    return {
        "one": 1.0,
        "distance": 1.0,
        "cut": again.problem.model.cut,
        "density": found["rho"][0],
        "pressure": -n.background,
    }


def test_forces_kept_right_after_a_stop_next_to_a_wall(lammps: Engine) -> None:
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


def test_walls_begin_with_the_evaluations_of_a_minimisation(lammps: Engine) -> None:
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
def test_minimisation_evaluates_the_state_of_the_last_step(
    stop: dict[str, Any], change: dict[str, Any], lammps: Engine
) -> None:
    """Pressures of walls are those of the energies found, and pairs those of the positions found."""
    scene = replace(beside_a_wall({"at": 1, "by": "minimize", **stop}, **change), steps=(0, 1))
    found = lammps.fields(scene)[1]["rho"]
    known = (FORCES, BEGIN, *(["heat-is-temperature-rate"] if "e" in change else []))
    assert agree(found, scene.predicted(*known), "rho", 1)
    assert abs(found[0] - scene.predicted(FORCES).fields[1]["rho"][0]) > 1e-3


def test_a_minimisation_meets_images_where_they_are(lammps: Engine) -> None:
    """Even those that the step before has left behind in a box that grows."""
    across = {"x": [[8.6, 4.0], [0.3, 4.0]], "low": [0, 0], "high": [9, 9], "periodic": [True, False]}
    scene = beside_a_wall({"at": 1, "by": "minimize"}, positions=across, deform={"x": 300.0})
    scene = replace(scene, steps=(0, 1))
    first, last = lammps.fields(scene, every_step=True)
    assert len(first["lists"]) == 4, "of the set-up, the step, the minimisation and the next set-up"
    assert agree(last["rho"], scene.predicted(FORCES, PARTS, "images-left-behind", snapshot=first), "rho", 1)
    assert not agree(last["rho"], scene.predicted(FORCES), "rho", 1)


@recomputes(CREATED, "none", given="right created kept")
def test_created_with_forces_of_others(lammps: Engine) -> dict[str, Any]:
    """The slot of the last particle, the first one, is filled by the one before it, whose slot it gets."""
    n = printed(CREATED)
    right, created, kept = n.right, n.created, n.kept
    x, box = [[4.0, 4.0], [4.0, 5.0], [3.0, 4.0]], {"low": [0, 0], "high": [9, 9], "periodic": [False, False]}
    for by, density, finding in (("recreated", created, CREATED), ("run", kept, BEGIN)):
        scene = beside_a_wall({"at": 0, "by": by}, positions={"x": x, **box})
        first, *_ = lammps.fields(scene, every_step=True)
        assert density.is_rounded(first["rho"][0])
        assert agree(first["rho"], scene.predicted(finding, snapshot=first), "rho")
        plain = scene.predicted()
        assert abs(plain.fields[0]["rho"][0] - right) <= plain.bounds[0]["rho"][0]
    scene = beside_a_wall({"at": 0, "by": "recreated"}, positions={"x": x, **box})
    anew = beside_a_wall({"at": 0, "by": "redefined"}, positions={"x": x, **box})
    first, between, *others = scene.job.runs
    assert isinstance(between, Interlude) and isinstance(anew.job.runs[1], Interlude)
    both = replace(between, actions=(*between.actions, *anew.job.runs[1].actions))
    snapshot = lammps.answer(replace(scene.job, runs=(first, both, *others))).snapshots[0]
    assert agree(snapshot["rho"], anew.predicted(), "rho")
    return {"none": scene.predicted(BEGIN).fields[0]["rho"][0]}


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
def test_first_move_in_the_last_cycle_of_sorting(order: list[int], sorted_: list[int], first: int | None) -> None:
    assert first_of_last_cycle(np.array(order), np.array(sorted_)) == first


def test_order_of_recreated_particles() -> None:
    new_n = np.array([False, True, False, True])
    assert recreated(np.array([3, 0, 1, 2]), new_n).tolist() == [2, 0, 1, 3]
    assert recreated(np.array([3, 0, 1, 2]), False).tolist() == [3, 0, 1, 2]


def test_sorting_puts_a_force_into_the_slot_of_the_first_image(lammps: Engine) -> None:
    """Recreated atoms are sorted at the next set-up."""
    x = [[0.6, 0.3], [2.0, 0.2], [1.97, 12.5], [3.5, 0.4]]
    scene = small_scene(
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
    assert before == after == [0, 1, 3, 2]  # between the two it was 0, 1, 2, 3: the last is deleted and created again
    assert agree(first["rho"], scene.predicted(FORCES, PARTS, CREATED, snapshot=first), "rho")


@recomputes(PARTS, given="newton_on newton_off")
def test_walls_begin_with_parts(lammps: Engine) -> dict[str, Any]:
    x = [[8.5, 4.0], [0.5, 4.0]]
    across = {"x": x, "low": [0, 0], "high": [9, 9]}
    n = printed(PARTS)
    on, off = n.newton_on, n.newton_off
    assert on == printed(BEGIN).density, "as inside the box"
    for newton, by, density in ((True, "run", on), (False, "run", off), (True, "restart", off)):
        scene = beside_a_wall({"at": 0, "by": by}, positions=across, engine={"newton": newton})
        first, *_ = lammps.fields(scene, every_step=True)
        assert density.is_rounded(first["rho"][0]), (newton, by)
        assert agree(first["rho"], scene.predicted(PARTS, snapshot=first), "rho")
        assert agree(first["rho"], scene.predicted(BEGIN), "rho") == (density == on)
        assert not agree(first["rho"], scene.predicted(), "rho")
    return {}


def test_a_pair_that_counts_twice_begins_with_the_image_of_either_particle(lammps: Engine) -> None:
    """So that the sum of both forces counts once; a pair within the box has it twice in half the weight."""
    assert quoted(PARTS, "observed") == ["newton off on"]
    x = [[8.5, 4.0], [0.5, 4.0], [7.6, 4.6]]
    across = {"x": x, "low": [0, 0], "high": [9, 9]}
    scene = beside_a_wall({"at": 0}, positions=across, engine={"newton": False, "newton_bond": True})
    first, *_ = lammps.fields(scene, every_step=True)
    assert agree(first["rho"], scene.predicted(TWICE, PARTS, snapshot=first), "rho")
    assert not any(agree(first["rho"], scene.predicted(*one, snapshot=first), "rho") for one in ([TWICE], [PARTS]))
