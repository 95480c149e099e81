"""Nothing turns red if nothing is wrong, every kind changes the job, and a real fault is not called known."""

from __future__ import annotations

import os
import subprocess
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lammps_cases.comparison.store import VARIABLE
from lammps_cases.engine import installations, ranks
from lammps_cases.engine.session import EngineCrashed
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.run.prepared_case import prepare
from lammps_cases.scene import casefile
from tests.support.outcome import Solver
from tests.workshop.faults import alarms
from tests.workshop.faults.alarms import AlarmRun, Kind, measure
from tests.workshop.faults.perturbed import in_order

pytestmark = pytest.mark.lammps

CASES = {case.name: case for case in casefile.load()}
LAW, FLUID, TWIN = "near-rho0.ideal-gas.2d", "images.quintic.two", "twins.fluid.ranks"
ALL = [CASES[name] for name in (LAW, FLUID, TWIN)]
HERE: tuple[Kind, ...] = tuple(kind for kind in alarms.KINDS if kind != "machine")
CROSS, WALLS, STORED, LAYER = (
    *("cross-type.scale.2d", "walls.reconstructed.plain", "walls.stored.plain", "power-status.divergence"),
)


def _measured(names: list[str], *kinds: Kind) -> dict[str, AlarmRun]:
    return {run.kind: run for run in measure([CASES[name] for name in names], installations.Engine(), kinds, jobs=1)}


def test_nothing_turns_red_and_renaming_changes_no_bit() -> None:
    measured = _measured([case.name for case in ALL], *HERE)
    assert tuple(measured) == HERE
    for run in measured.values():
        assert run.alarms == (), run
        assert run.cases == run.same_bits + run.within == sum(run.verdicts.values()) == len(ALL)
    same = {kind: run.same_bits for kind, run in measured.items()}
    assert same["as given"] == same["renamed"] == len(ALL)
    assert same["seed"] == 0
    assert same["relabelled"] == same["reordered"] < len(ALL)
    assert max(same["newton"], same["ranks"]) < len(ALL)


@pytest.mark.parametrize("kind", HERE)
def test_every_kind_changes_the_job_and_particles_return_to_their_rows(kind: Kind, solver: Solver) -> None:
    ready = prepare(CASES[FLUID])
    perturbed = alarms.perturbed_case(kind, ready)
    plain, other = ready.jobs[0], perturbed.jobs[0]
    order = not all(np.array_equal(getattr(plain, name), getattr(other, name)) for name in ("id_n", "x_nc"))
    changed = order or (plain.setup, plain.ranks) != (other.setup, other.ranks)
    assert changed == (kind != "as given")
    first, atoms = in_order(solver(other), perturbed.row_n).snapshots[0], perturbed.ready.atoms
    for key, array in {"id": atoms.id_n, "type": atoms.type_n, "rho": atoms.rho_n, "v": atoms.v_nc}.items():
        assert array is not None and np.array_equal(first[key], array)


def test_another_seed_gives_another_scene_of_the_same_name() -> None:
    one, other = prepare(CASES[FLUID]), alarms.prepared_anew(CASES[FLUID])
    assert other.case is CASES[FLUID]
    assert not np.array_equal(one.atoms.x_nc, other.atoms.x_nc)
    assert one.atoms.rho_n is not None and not np.array_equal(one.atoms.rho_n, other.atoms.rho_n)


def test_rows_out_of_order_raise_an_alarm(monkeypatch: pytest.MonkeyPatch) -> None:
    right = alarms.perturbed_case
    monkeypatch.setattr(alarms, "perturbed_case", lambda kind, ready: replace(right(kind, ready), row_n=None))
    found = _measured([LAW], "relabelled", "reordered")
    assert [alarm.case for alarm in found["relabelled"].alarms] == [LAW]
    assert found["relabelled"].false == 1
    assert "rho" in found["relabelled"].alarms[0].message
    assert found["reordered"].alarms == ()


def test_faults_hidden_in_ordinary_runs_are_named() -> None:
    found = _measured([CROSS, "walls-moving.free.rk1"], "rebuilt", "ranks")
    assert found["as given"].alarms == ()
    assert [(a.case, a.finding) for a in found["ranks"].alarms] == [(CROSS, "cross-type-normal")]
    (walls,) = found["rebuilt"].alarms
    assert (walls.case, walls.finding) == ("walls-moving.free.rk1", "walls-after-rebuild")
    assert "in addition to" in walls.message  # the step at which the findings of the scene do not explain everything
    assert found["ranks"].false == found["rebuilt"].false == 0


@pytest.mark.parametrize(
    ("kind", "case", "verdict", "finding"),
    [
        ("ranks", CROSS, "differs", "cross-type-normal"),
        ("ranks", CROSS, "crashed", ""),
        ("ranks", "shift.all.2d", "differs", ""),
        ("newton", CROSS, "differs", ""),
        ("rebuilt", WALLS, "differs", "walls-after-rebuild"),
        ("rebuilt", STORED, "differs", ""),
        ("reordered", LAYER, "differs", "layer-depends-on-pair-order"),
        ("renamed", LAYER, "differs", ""),
    ],
)
def test_only_predicted_differences_are_called_known(kind: Kind, case: str, verdict: str, finding: str) -> None:
    record = CaseRecord(case=case, verdict=verdict)
    run = alarms.alarm_run(kind, [CASES[case]], {case: CaseRecord(case=case, verdict="pass")}, {case: record})
    assert [alarm.finding for alarm in run.alarms] == [finding]
    assert run.false == (not finding)


def test_death_by_a_signal_has_one_name_on_one_rank_and_on_several() -> None:
    job = replace(prepare(CASES["refused.range-two-stars"]).jobs[0], ranks=2)
    with pytest.raises(EngineCrashed, match="killed by SIGABRT"):
        ranks.solve(None, job)


# --- another machine


def test_older_machine_is_green_and_recomputes_everything(monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[dict[str, str]] = []
    right = subprocess.run

    def run(program: list[str], env: dict[str, str], **options: Any) -> Any:
        given.append(env)
        return right(program, env=env, **options)

    monkeypatch.setattr(subprocess, "run", run)
    found = _measured([FLUID], "machine")["machine"]
    assert (found.cases, found.alarms) == (1, ())
    assert found.same_bits + found.within == 1
    assert found.reference_moved is not None
    here, there = (env for env in given if "EOS_REF_HISTORY" in env and "PYTHONPATH" in env)
    assert "NUMBA_CPU_NAME" not in here
    assert there["NUMBA_CPU_NAME"] == "generic"
    assert there["GLIBC_TUNABLES"].startswith("glibc.cpu.hwcaps=")
    assert here[VARIABLE] == os.environ[VARIABLE]
    assert there[VARIABLE] != here[VARIABLE]  # predictions of this machine are not reused on the other


def test_command_without_a_report_is_an_error() -> None:
    with pytest.raises(RuntimeError, match="no report"):
        alarms.run_apart([replace(CASES[LAW], name="no-such-case")], installations.Engine(), {}, 1)
