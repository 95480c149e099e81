"""Nothing turns red if nothing is wrong, every kind changes the job, and a real fault is not called known."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from lammps_cases.comparison.store import VARIABLE
from lammps_cases.engine import installations, ranks
from lammps_cases.engine.session import Answer, EngineCrashed
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.run import prepared_case
from lammps_cases.scene import casefile
from tests.support.outcome import Solver
from tests.workshop.faults import alarms
from tests.workshop.faults.alarms import AlarmRun, Kind
from tests.workshop.faults.perturbed import PerturbedCase, in_order

pytestmark = pytest.mark.lammps

CASES = {case.name: case for case in casefile.load()}
LAW, FLUID, TWIN = "near-rho0.ideal-gas.2d", "images.quintic.two", "twins.fluid.ranks"
ALL = [CASES[name] for name in (LAW, FLUID, TWIN)]
HERE: tuple[Kind, ...] = tuple(kind for kind in alarms.KINDS if kind != "machine")


@pytest.fixture(scope="module")
def measured() -> dict[str, AlarmRun]:
    return {run.kind: run for run in alarms.measure(ALL, installations.Engine(), HERE)}


def test_nothing_turns_red(measured: dict[str, AlarmRun]) -> None:
    assert tuple(measured) == HERE
    for run in measured.values():
        assert run.alarms == (), run
        assert run.cases == len(ALL)
        assert run.same_bits + run.within == len(ALL)
        assert sum(run.verdicts.values()) == len(ALL)


def test_renaming_changes_no_bit_and_reordering_does(measured: dict[str, AlarmRun]) -> None:
    assert measured["as given"].same_bits == len(ALL)
    assert measured["renamed"].same_bits == len(ALL)
    assert measured["relabelled"].same_bits < len(ALL)
    assert measured["relabelled"].same_bits == measured["reordered"].same_bits
    assert measured["newton"].same_bits < len(ALL)
    assert measured["ranks"].same_bits < len(ALL)
    assert measured["seed"].same_bits == 0


@pytest.fixture(scope="module")
def solved(solver: Solver) -> Callable[[PerturbedCase], Answer]:
    return lambda perturbed: in_order(solver(perturbed.jobs[0]), perturbed.row_n)


@pytest.mark.parametrize("kind", HERE)
def test_every_kind_changes_the_job_and_particles_return_to_their_rows(
    kind: Kind, solved: Callable[[PerturbedCase], Answer]
) -> None:
    ready = prepared_case.prepare(CASES[FLUID])
    perturbed = alarms.perturbed_case(kind, ready)
    plain, other = ready.jobs[0], perturbed.jobs[0]
    order = not all(np.array_equal(getattr(plain, name), getattr(other, name)) for name in ("id_n", "x_nc"))
    changed = order or (plain.setup, plain.ranks) != (other.setup, other.ranks)
    assert changed == (kind != "as given")
    first = solved(perturbed).snapshots[0]
    atoms = perturbed.ready.atoms
    assert np.array_equal(first["id"], atoms.id_n)
    assert np.array_equal(first["type"], atoms.type_n)
    assert np.array_equal(first["rho"], atoms.rho_n)
    assert np.array_equal(first["v"], atoms.v_nc)


def test_another_seed_gives_another_scene_of_the_same_name() -> None:
    one, other = prepared_case.prepare(CASES[FLUID]), alarms.prepared_anew(CASES[FLUID])
    assert other.case is CASES[FLUID]
    assert one.atoms.rho_n is not None
    assert other.atoms.rho_n is not None
    assert not np.array_equal(one.atoms.x_nc, other.atoms.x_nc)
    assert not np.array_equal(one.atoms.rho_n, other.atoms.rho_n)


def test_rows_out_of_order_raise_an_alarm(monkeypatch: pytest.MonkeyPatch) -> None:
    right = alarms.perturbed_case
    monkeypatch.setattr(alarms, "perturbed_case", lambda kind, ready: replace(right(kind, ready), row_n=None))
    found = {run.kind: run for run in alarms.measure([CASES[LAW]], installations.Engine(), ("relabelled", "reordered"))}
    assert [alarm.case for alarm in found["relabelled"].alarms] == [LAW]
    assert found["relabelled"].false == 1
    assert "rho" in found["relabelled"].alarms[0].message
    assert found["reordered"].alarms == ()


def test_faults_hidden_in_ordinary_runs_are_named() -> None:
    cases = [CASES["cross-type.scale.2d"], CASES["walls-moving.free.rk1"]]
    found = {run.kind: run for run in alarms.measure(cases, installations.Engine(), ("rebuilt", "ranks"))}
    assert found["as given"].alarms == ()
    assert [(a.case, a.finding) for a in found["ranks"].alarms] == [("cross-type.scale.2d", "cross-type-normal")]
    (walls,) = found["rebuilt"].alarms
    assert (walls.case, walls.finding) == ("walls-moving.free.rk1", "walls-after-rebuild")
    assert "in addition to" in walls.message  # the step at which the findings of the scene do not explain everything
    assert found["ranks"].false == found["rebuilt"].false == 0


@pytest.mark.parametrize(
    ("kind", "case", "verdict", "finding"),
    [
        ("ranks", "cross-type.scale.2d", "differs", "cross-type-normal"),
        ("ranks", "cross-type.scale.2d", "crashed", ""),
        ("ranks", "shift.all.2d", "differs", ""),
        ("newton", "cross-type.scale.2d", "differs", ""),
        ("rebuilt", "walls.reconstructed.plain", "differs", "walls-after-rebuild"),
        ("rebuilt", "walls.stored.plain", "differs", ""),
        ("reordered", "power-status.divergence", "differs", "layer-depends-on-pair-order"),
        ("renamed", "power-status.divergence", "differs", ""),
    ],
)
def test_only_predicted_differences_are_called_known(kind: Kind, case: str, verdict: str, finding: str) -> None:
    plain = CaseRecord(case=case, verdict="pass")
    record = CaseRecord(case=case, verdict=verdict)
    run = alarms._run(kind, [CASES[case]], {case: plain}, {case: record}, None)
    assert [alarm.finding for alarm in run.alarms] == [finding]
    assert run.false == (not finding)


def test_death_by_a_signal_has_one_name_on_one_rank_and_on_several() -> None:
    job = replace(prepared_case.prepare(CASES["refused.range-two-stars"]).jobs[0], ranks=2)
    with pytest.raises(EngineCrashed, match="killed by SIGABRT"):
        ranks.solve(None, job)


# --- another machine


def test_older_machine_is_green_and_recomputes_everything(monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[dict[str, str]] = []
    right = subprocess.Popen

    def popen(program: list[str], env: dict[str, str], **options: object) -> object:
        given.append(env)
        return right(program, env=env, **options)  # type: ignore[call-overload]

    monkeypatch.setattr(subprocess, "Popen", popen)
    found = alarms.measure([CASES[FLUID]], installations.Engine(), ("machine",), jobs=1)
    run = next(run for run in found if run.kind == "machine")
    assert (run.cases, run.alarms) == (1, ())
    assert run.same_bits + run.within == 1
    assert run.reference_moved is not None
    here, there = given
    assert "NUMBA_CPU_NAME" not in here
    assert there["NUMBA_CPU_NAME"] == "generic"
    assert there["GLIBC_TUNABLES"].startswith("glibc.cpu.hwcaps=")
    assert here[VARIABLE] == os.environ[VARIABLE]
    assert there[VARIABLE] != here[VARIABLE]  # predictions of this machine are not reused on the other


def test_command_without_a_report_is_an_error() -> None:
    with pytest.raises(RuntimeError, match="no report"):
        alarms.run_apart([replace(CASES[LAW], name="no-such-case")], installations.Engine(), {}, 1)
