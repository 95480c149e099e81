"""Commands between runs: each route restores the same physics, by the same lines as in the beginning."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import pytest

from lammps_cases.engine.interlude import FOLDER, Interlude
from lammps_cases.engine.session import RunCommand
from lammps_cases.run import prepared_case
from lammps_cases.run.prepared_case import PreparedCase
from lammps_cases.scene import Scene, casefile
from lammps_cases.scene.runs import FOR_EACH_ATOM, ROUTES, Route, Stop
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan

MODEL = ("fix ", "compute ", "pair_")
KEPT = ("mass", "set type", "create_", "region")  # what files hold


@cache
def prepared(name: str) -> PreparedCase:
    (case,) = casefile.select(casefile.load(), [name])
    return prepared_case.prepare(case)


def changed(ready: PreparedCase, **evolve: Any) -> Scene:
    """Return a scene with other settings of its time steps."""
    assert ready.case.scene.evolve
    return ready.case.scene.model_copy(update={"evolve": ready.case.scene.evolve.model_copy(update=evolve)})


def runs_of(ready: PreparedCase, scene: Scene, every_step: bool = False) -> Sequence[RunCommand | Interlude]:
    return job(scene, ready.atoms, plan(scene), every_step).runs


def lines(by: Route, **stop: object) -> tuple[list[str], list[str]]:
    """Return the initial commands of a case with walls, and those at a stop after step 1."""
    ready = prepared("runs-walls.fluid.settings")
    told = Stop.model_validate({"at": 1, "by": by, "timestep": 0.002 if by == "dt/reset" else None} | stop)
    scene = changed(ready, stops=(told,))
    given = job(scene, ready.atoms, plan(scene))
    (between,) = (stretch for stretch in given.runs if isinstance(stretch, Interlude))
    return [*given.setup, *given.commands], [action.text for action in between.actions]


@pytest.mark.parametrize("by", [by for by in ROUTES if by != "replaced"])
def test_exactly_the_removed_definitions_are_restored(by: Route) -> None:
    first, between = lines(by)
    fixes = [line for line in first if line.startswith(MODEL)]
    last_clear = max((k for k, line in enumerate(between) if line == "clear"), default=-1)
    taken = [line.split()[1] for line in between if line.startswith(("unfix", "uncompute")) and "no_such" not in line]
    if last_clear >= 0:
        assert [
            line for line in between[last_clear:] if line in first and line.startswith(("fix ", "compute ", "pair_"))
        ] == fixes
        assert not [line for line in between[last_clear:] if line.startswith(KEPT)], "the file holds them"
    elif taken:
        assert sorted(taken) == sorted(line.split()[1] for line in fixes if not line.startswith("pair_"))
        assert [line for line in between if line in fixes] == fixes
    else:
        assert not [line for line in between if line in fixes]


@pytest.mark.parametrize("by", ["restart", "data", "data nofix", "other scene"])
def test_file_is_read_where_it_was_written(by: Route) -> None:
    _, between = lines(by)
    (written,) = (line.split()[1] for line in between if line.startswith("write_"))
    (read,) = (line.split()[1] for line in between if line.startswith("read_"))
    assert written == read and written.startswith(FOLDER)
    assert any(line.endswith("nofix") for line in between) == (by == "data nofix")


def test_settings_follow_the_route() -> None:
    _, between = lines("restart", timestep=0.002, count=7, displace={"x": 0.5, "types": 1})
    assert between[-4:] == [
        "timestep 0.002",
        "reset_timestep 7",
        "group displaced_1 type 1",
        "displace_atoms displaced_1 move 0.5 0.0 0.0 units box",
    ]
    assert lines("run", displace={"y": 0.5})[1] == ["displace_atoms all move 0.0 0.5 0.0 units box"]
    low, (x, y) = -0.9, (7 * 0.9 + 0.9, 6 * 0.9 + 0.9)  # corners of the box; the faces of y stay where they are
    told = f"x final {low} {low + 1.5 * (x - low)!r} y final {low} {y!r}"
    assert lines("run", stretch={"x": 1.5})[1] == [f"change_box all {told} remap units box"]


def test_runs_begin_with_a_set_up_and_a_read_after_each_stop() -> None:
    ready = prepared("runs.fluid.settings")
    for every_step in (False, True):
        runs = runs_of(ready, ready.case.scene, every_step)
        read = [stretch for stretch in runs if not isinstance(stretch, Interlude) and stretch.read]
        assert len(read) == len(ready.case.scene.snapshots) == 5
        for k, stretch in enumerate(runs):
            if isinstance(stretch, Interlude):
                before, after = runs[k - 1], runs[k + 1]
                assert not isinstance(before, Interlude) and not before.read
                assert not isinstance(after, Interlude) and after.command == "run 0 post no" and after.read


def test_printed_data_file_has_all_attributes_in_the_manuals_order() -> None:
    _, between = lines("by hand")
    written = [line.split('"')[1] for line in between if line.startswith("print")]
    assert written[:5] == ["by hand", "", "42 atoms", "2 atom types", ""]
    atoms, velocities = "{id} {type} {phase} {rho} {x} {y} 0.0", "{id} {vx} {vy} {vz}"
    assert written[-8:] == ["", "Atoms", "", atoms, "", "Velocities", "", velocities]
    assert f"read_data {FOLDER}/hand.1" in between


def test_fix_rheo_is_replaced_and_then_restored() -> None:
    first, between = lines("replaced")
    (own,) = (line for line in first if line.startswith("fix rheo "))
    assert between[1:] == ["run 0 post no", own]
    assert between[0].split()[:4] == own.split()[:4] and between[0] != own
    assert len(between[0].split()) == len(own.split())


def test_continued_run_has_its_time_step_and_no_set_up() -> None:
    ready = prepared("edges-steps.continued.fluid.2d")
    runs = runs_of(ready, ready.case.scene)
    texts = [s.command if isinstance(s, RunCommand) else [a.text for a in s.actions] for s in runs]
    assert texts[3:6] == [["timestep 0.006"], "run 0 pre no post no", "run 1 pre no post no"]


def test_fix_dt_reset_sets_the_time_step_alone() -> None:
    _, between = lines("dt/reset")
    assert between == ["fix reset all dt/reset 1 0.002 0.0020000000000000005 1e-30 units box"]


def test_every_appears_in_runs_that_begin_with_a_set_up() -> None:
    ready = prepared("runs.fluid.settings")
    for halts, last in (((1,), 5), ((1, 5), 5)):
        stops = tuple(Stop(at=at) for at in halts)
        scene = changed(ready, steps=last, every=2, compare_at=(last,), stops=stops)
        told = [s for s in runs_of(ready, scene) if not isinstance(s, Interlude)]
        ends = ["run 1 post no every 2 NULL", "run 4 post no every 2 NULL"]
        assert [s.command for s in told] == [*ends, *["run 0 post no"] * (last in halts)]
        assert [s.read for s in told] == [False] * (len(told) - 1) + [True]
        # Read at every step, for neighbour lists, its pieces are separate runs.
        pieces = runs_of(ready, scene, every_step=True)
        at = [k for k, s in enumerate(pieces) if isinstance(s, Interlude)]
        assert [pieces[k + 1] for k in at] == [RunCommand("run 0 post no")] * (2 + (last in halts))


def test_step_count_continues_after_a_data_file() -> None:
    ready = prepared("runs.fluid.settings")
    scene = changed(ready, stops=(Stop(at=1, count=100), Stop(at=3, by="data")))
    between = [s for s in runs_of(ready, scene) if isinstance(s, Interlude)]
    assert between[1].actions[-1].text == "reset_timestep 102"


def test_recreated_atoms_rejoin_the_groups_of_forces() -> None:
    first, between = lines("recreated")
    groups = [line for line in first if line.startswith("group ")]
    assert groups and between[-len(groups) :] == groups


def test_time_step_and_communication_survive_a_data_file() -> None:
    ready = prepared("runs.fluid.settings")
    scene = changed(ready, stops=(Stop(at=0, timestep=0.25), Stop(at=1, by="data")))
    scene = scene.model_copy(update={"engine": scene.engine.model_copy(update={"communication": "tiled"})})
    between = [s for s in runs_of(ready, scene) if isinstance(s, Interlude)][1]
    texts = [action.text for action in between.actions]
    read = next(k for k, text in enumerate(texts) if text.startswith("read_data"))
    assert "comm_style tiled" in texts[read + 1 :] and texts[-1] == "timestep 0.25"


def test_atoms_in_2d_are_recreated_at_z_0() -> None:
    """Stretching the box rounds z, and LAMMPS refuses z other than 0."""
    _, between = lines("recreated")
    assert "create_atoms {type} single {x} {y} 0.0 units box" in between


@pytest.mark.parametrize("by", [by for by in FOR_EACH_ATOM if by != "by hand"])
def test_commands_for_each_atom_name_every_attribute(by: Route) -> None:
    _, between = lines(by)
    for word in ("type {type}", "x {x}", "vy {vy}", "rheo/rho {rho}", "rheo/status {phase}"):
        assert word in next(line for line in reversed(between) if line.startswith("set atom"))
