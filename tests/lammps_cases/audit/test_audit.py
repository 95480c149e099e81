"""The audit of decks: real LAMMPS runs decks with every documented option of flow control; faults are planted."""

from __future__ import annotations

import functools
import json
import os
import shutil
import signal
import time
from collections.abc import Callable
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from eos_ref import EOSTable, InputError
from lammps_cases.audit import place, supervise
from lammps_cases.audit.fields import PRESSURE
from lammps_cases.audit.messages import CommandPlace
from lammps_cases.audit.options import AuditOptions, AuditResult, AuditTask
from lammps_cases.audit.supervise import audit_deck
from lammps_cases.audit.verdict import Findings
from lammps_cases.records.progress import Progress
from tests.support.audited_decks import DECKS, FIXES, MELT, case_of, run_plain, write_deck, written
from tests.support.progress import Steps

pytestmark = pytest.mark.lammps

OF_PRESSURE = AuditOptions(fields=PRESSURE)
HEALTHY = ["plain", "loop", "include", "systems", "gas", "deposit"]


@functools.cache
def audited(name: str, folder: Path) -> AuditResult:
    """Audit a deck of the tests; its output is kept in ``folder``."""
    return audit_deck(DECKS / f"in.{name}", AuditOptions(keep=folder, fields=PRESSURE))


@pytest.fixture(scope="session")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    return functools.cache(lambda name: tmp_path_factory.mktemp(name))


# --- healthy decks ---

# Their densities lie on both sides of rho0 at random, and the audit warns correctly that such a tension would clump
# in time; their masses, densities and speeds are odd numbers, so that none can be confused with another.
DELIBERATE = (
    "the tension at which particles clump",
    " times rho0 V = ",
    " times rho0 = ",
    " times the largest speed ",
    "closer than",
)


@pytest.mark.parametrize("name", HEALTHY)
def test_healthy_deck_is_clean(name: str, kept: Callable[[str], Path]) -> None:
    result = audited(name, kept(name))
    case = case_of(result)
    assert case.verdict in ("exact", "pass"), case.message
    assert result.record.exit_code() == 0
    assert case.tags == ["audit"] and case.case == f"in.{name}"
    assert [warning for warning in case.warnings if not any(part in warning for part in DELIBERATE)] == []
    assert [field.atom_type for field in case.fields] == [1, 2]
    assert all(field.worst_step is not None and (field.max_over_bound or 0) < 1 for field in case.fields)


@pytest.mark.parametrize(
    ("name", "looks"),
    [
        ("plain", {1: [0, 10, 20, 30, 40]}),
        ("loop", {1: [0, 10, 20], 2: [20, 30, 40], 3: [40, 50, 60]}),
        ("include", {1: [0, 10], 2: [15, 20]}),
        ("systems", {1: [0, 10, 20], 2: [30, 40], 3: [0, 10, 20], 4: [20, 30, 30, 40]}),
        ("deposit", {1: [0, 10, 20, 30], 2: [33, 40]}),
    ],
)
def test_every_run_is_sampled(name: str, looks: dict[int, list[int]], kept: Callable[[str], Path]) -> None:
    checks = [check for check in case_of(audited(name, kept(name))).checks if check.type == 1]
    found: dict[int, list[int]] = {}
    for check in checks:
        found.setdefault(check.run, []).append(check.step)
    assert found == looks


def test_minimization_is_not_sampled(tmp_path: Path) -> None:
    """It invokes the callback as a run does, but evaluates no pressure."""
    commands = f"set group all rheo/rho 1.1\n{FIXES}fix 3 all rheo/pressure * linear\n"
    case = case_of(
        audit_deck(write_deck(tmp_path, f"{commands}run 20\nminimize 1e-5 1e-5 50 50\nrun 20\n"), OF_PRESSURE)
    )
    assert case.verdict == "exact" and {check.run for check in case.checks} == {1, 2}
    assert [check.step for check in case.checks if (check.run, check.type) == (1, 1)] == [0, 10, 20]


def test_laws_are_those_after_substitution_and_redefinition(kept: Callable[[str], Path]) -> None:
    loop = case_of(audited("loop", kept("loop"))).laws
    assert [(law.style, law.parameter, law.background) for law in loop] == [("tait/general", 3.5, 0.03)] * 2
    assert [(law.rho0, law.mass) for law in loop] == [(1.1, 1.3), (1.3, 0.7)]
    systems = case_of(audited("systems", kept("systems"))).laws
    assert [(law.style, law.rho0, law.background) for law in systems] == [
        ("tait/water", 1.5, 0.0),
        ("tait/water", 1.4, 0.1),
    ]


def test_created_and_deleted_atoms_are_checked(kept: Callable[[str], Path]) -> None:
    result = audited("deposit", kept("deposit"))
    natoms = [check.natoms for check in case_of(result).checks if check.type == 1]
    assert natoms[0] < natoms[1] < natoms[3] and case_of(result).natoms == 66 == len(result.arrays["id"])


def test_energy_is_per_mass(kept: Callable[[str], Path]) -> None:
    result = audited("gas", kept("gas"))
    arrays = result.arrays
    gamma_n = np.where(arrays["type"] == 1, 1.4, 1.67)
    expected_n = (gamma_n - 1) * arrays["rho"] * arrays["e"] + 0.05
    # All terms are positive and gamma - 1 is exact: five roundings on either side (energy/mass, two products, the sum).
    np.testing.assert_allclose(arrays["pressure.lammps"], expected_n, rtol=10 * 2.0**-53)


def test_arrays_of_the_last_sample(kept: Callable[[str], Path]) -> None:
    arrays = audited("plain", kept("plain")).arrays
    assert np.all(np.diff(arrays["id"]) > 0) and arrays["step"] == 40
    assert arrays["x"].shape == (64, 3) and arrays["box"].tolist() == [[0, 0, -0.01], [8, 8, 0.01]]
    difference = np.abs(arrays["pressure.lammps"] - arrays["pressure.reference"])
    assert np.all(difference <= arrays["pressure.bound"]) and np.all(arrays["pressure.bound"] > 0)


# --- the audit changes nothing ---


@pytest.mark.parametrize("name", [*HEALTHY, "flow"])
def test_deck_does_the_same_as_without_audit(name: str, kept: Callable[[str], Path], tmp_path: Path) -> None:
    shutil.copytree(DECKS, tmp_path / "plain")
    run_plain(f"in.{name}", tmp_path / "plain")
    expected = written(tmp_path / "plain")
    assert len(expected) >= (1 if name == "flow" else 2)
    if name == "flow":
        with pytest.raises(InputError, match="must reach a run command"):
            audited(name, kept(name))
        assert expected["flow.txt"].count(b"\n") == 19
    else:
        audited(name, kept(name))
    assert written(kept(name)) == expected


def test_original_folder_stays_untouched(kept: Callable[[str], Path]) -> None:
    audited("loop", kept("loop"))
    assert (kept("loop") / "passes.txt").exists()
    assert written(DECKS) == {}


# --- planted faults, in the process that runs the deck ---


def _stiffer(task: AuditTask, connection: Connection) -> None:
    from lammps_cases.audit import child, deck

    right = deck.Deck.laws

    def wrong(self: deck.Deck, ntypes: int) -> EOSTable | None:
        table = right(self, ntypes)
        assert table is not None
        one, two = table.laws
        return EOSTable((one, replace(two, cs=two.cs * (1 + 1e-12))))

    deck.Deck.laws = wrong
    child.main(task, connection)


def _at_each_look(act: Callable[[Any, int, int], None], task: AuditTask, connection: Connection) -> None:
    from lammps_cases.audit import child, watch

    right = watch.DeckWatch._sample

    def wrong(self: watch.DeckWatch, run: watch.WatchedRun, table: EOSTable, step: int, tag_n: Any, x_nc: Any) -> None:
        act(self.lmp, step, len(tag_n))
        right(self, run, table, step, tag_n, x_nc)

    watch.DeckWatch._sample = wrong
    child.main(task, connection)


def _one_atom(task: AuditTask, connection: Connection) -> None:
    def act(lmp: Any, step: int, n: int) -> None:
        if step >= 20:
            row = lmp.numpy.extract_atom("id")[:n].tolist().index(17)
            lmp.numpy.extract_atom("pressure")[row] += 1e-13

    _at_each_look(act, task, connection)


def _segfault(task: AuditTask, connection: Connection) -> None:
    def act(lmp: Any, step: int, n: int) -> None:
        if step == 20:
            os.write(2, b"free(): invalid pointer\n")
            os.kill(os.getpid(), signal.SIGSEGV)

    _at_each_look(act, task, connection)


def _wrong_look(task: AuditTask, connection: Connection) -> None:
    def act(lmp: Any, step: int, n: int) -> None:
        raise InputError("look", "must not fail", step)

    _at_each_look(act, task, connection)


def _hang(task: AuditTask, connection: Connection) -> None:
    connection.send(CommandPlace("in.plain:7", "run   45"))
    time.sleep(600)


def test_wrong_law_differs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(supervise, "ENTRY", _stiffer)
    result = audit_deck(DECKS / "in.plain", OF_PRESSURE)
    case = case_of(result)
    assert case.verdict == "differs" and result.record.exit_code() == 1
    assert [field.verdict for field in case.fields] == ["exact", "differs"]
    assert "first at step 0 (run 1), type 2" in case.message


def test_one_wrong_atom_is_named(monkeypatch: pytest.MonkeyPatch, kept: Callable[[str], Path]) -> None:
    monkeypatch.setattr(supervise, "ENTRY", _one_atom)
    result = audit_deck(DECKS / "in.plain", OF_PRESSURE)
    case = case_of(result)
    assert int(result.arrays["step"]) == 20  # the picture shows where it starts
    healthy = audited("plain", kept("plain")).arrays
    assert int(healthy["step"]) == max(check.step for check in case.checks) == 40
    wrong_type = int(healthy["type"][healthy["id"] == 17][0])
    assert f"first at step 20 (run 1), type {wrong_type}, atom 17: 1 of 32 atoms" in case.message
    field = case.fields[wrong_type - 1]
    assert (field.verdict, field.worst_id, field.outside) == ("differs", 17, 1) and field.worst_step in (20, 30, 40)
    bad = {(check.step, check.type) for check in case.checks if check.verdict == "differs"}
    assert bad == {(step, wrong_type) for step in (20, 30, 40)}


def test_crash_keeps_earlier_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(supervise, "ENTRY", _segfault)
    result = audit_deck(DECKS / "in.plain", OF_PRESSURE)
    case = case_of(result)
    assert case.verdict == "crashed" and result.record.exit_code() == 3
    assert {check.step for check in case.checks} == {0, 10}
    assert "SIGSEGV" in case.message and "run 45 (in.plain:12)" in case.message
    assert "free(): invalid pointer" in case.message


def test_quit_inside_a_run_ends_only_the_child() -> None:
    case = case_of(audit_deck(DECKS / "in.quit"))
    assert case.verdict == "crashed" and "exited with code 4" in case.message and case.died == "exit code 4"
    assert max(check.step for check in case.checks) >= 60


def test_hang_is_a_timeout(monkeypatch: pytest.MonkeyPatch) -> None:
    """The time limit expires while LAMMPS hangs, independent of its start-up time."""
    ahead = [0.0]
    clock = SimpleNamespace(monotonic=lambda: time.monotonic() + ahead[0], perf_counter=time.perf_counter)
    take = Findings.take

    def taken(findings: Findings, message: object) -> None:
        take(findings, message)
        ahead[0] = 300.0

    monkeypatch.setattr(supervise, "time", clock)
    monkeypatch.setattr(Findings, "take", taken)
    monkeypatch.setattr(supervise, "ENTRY", _hang)
    case = case_of(audit_deck(DECKS / "in.plain", AuditOptions(timeout=300.0, fields=PRESSURE)))
    assert case.verdict == "timeout" and case.message == (
        "stopped after 300 s, after step 0 of the audit, in: run 45 (in.plain:7)"
    )


def test_error_inside_a_sample_is_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(supervise, "ENTRY", _wrong_look)
    with pytest.raises(InputError, match="look: must not fail"):
        audit_deck(DECKS / "in.plain", OF_PRESSURE)


def test_ctrl_c_leaves_nothing_behind(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    import multiprocessing
    import tempfile

    class Interrupted(Progress):
        def advance(self, done: int, total: int | None, label: str, complaint: str = "") -> None:
            raise KeyboardInterrupt

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with pytest.raises(KeyboardInterrupt):
        audit_deck(DECKS / "in.plain", AuditOptions(progress=Interrupted()))
    assert not list(tmp_path.iterdir()) and not multiprocessing.active_children()


# --- LAMMPS' own errors, limits ---


def test_error_of_lammps_is_bad_input() -> None:
    result = audit_deck(DECKS / "in.error", OF_PRESSURE)
    case = case_of(result)
    assert case.verdict == "refused" and result.record.exit_code() == 3
    assert "Unrecognized fix style 'no_such_style'" in case.message and "in.error:2" in case.message
    assert len(case.checks) == 10 and len(result.arrays["id"]) == 64


@pytest.mark.parametrize(("steps", "looks"), [(25, [0, 10, 20, 20, 25]), (40, [0, 10, 20, 20, 30, 40])])
def test_steps_end_the_deck(steps: int, looks: list[int], tmp_path: Path) -> None:
    progress = Steps()
    options = AuditOptions(steps=steps, keep=tmp_path, progress=progress, fields=PRESSURE)
    case = case_of(audit_deck(DECKS / "in.loop", options))
    assert [check.step for check in case.checks if check.type == 1] == looks
    assert case.steps == steps and progress.done[-1] == (steps, steps, "steps")
    assert not (tmp_path / "final.dump").exists() and (tmp_path / "passes.txt").read_text().count("\n") == 1


def test_every() -> None:
    progress = Steps()
    case = case_of(audit_deck(DECKS / "in.plain", AuditOptions(every=7, fields=PRESSURE, progress=progress)))
    assert [check.step for check in case.checks if check.type == 1] == [0, 7, 14, 21, 28, 35, 42]
    assert progress.done == [(step, 45, "steps") for step in range(0, 45, 7)]


@pytest.mark.parametrize(
    ("command", "steps"),
    [("run  45 pre no", 65), ("run ${n}", None), ("run 45 upto", None), ("minimize 0 0 10 10", None)],
)
def test_steps_of_a_run_are_read_from_its_command(command: str, steps: int | None) -> None:
    assert supervise.steps_after(command, 20) == steps


# --- warnings ---


def test_density_never_set() -> None:
    mass, line = [w for w in case_of(audit_deck(DECKS / "in.never_set")).warnings if w.startswith("type 1")]
    assert "m = 1.3 is 0.0013 times rho0 V" in mass
    assert line.startswith("type 1: rho was never set: all 32 fluid atoms") and "rho0 = 1000" in line


def test_offset_and_density_off_rho0() -> None:
    *_, offset, far = case_of(audit_deck(DECKS / "in.offset")).warnings
    assert offset.startswith("type 1: fixed pressure offset") and "(5 of it is the background" in offset
    assert far.startswith("type 2: rho is 1.66 times rho0 = 0.8 ") and "a pressure of 0.659 rho0 c^2" in far


def test_density_with_constant_offset_from_rho0(tmp_path: Path) -> None:
    commands = f"mass * 1\nset group all rheo/rho 1.05\n{FIXES}fix 3 all rheo/pressure * linear\nrun 1\n"
    lines = case_of(audit_deck(write_deck(tmp_path, commands), OF_PRESSURE)).warnings
    assert len([line for line in lines if ": rho0 = 1 was never reached: " in line]) == 2


def test_run_without_pressure_is_reported(tmp_path: Path) -> None:
    commands = f"set group all rheo/rho 1.0\n{FIXES}fix 3 all rheo/pressure * linear\nrun 5\n"
    deck = write_deck(tmp_path, commands)
    deck.write_text(f"{MELT}clear\n{deck.read_text()}")
    case = case_of(audit_deck(deck))
    assert case.warnings[0] == "run 1: no fix rheo/pressure was defined, nothing was checked"
    assert {check.run for check in case.checks} == {2}


# --- copy, command line ---


def test_copy_is_bounded_and_writable(tmp_path: Path) -> None:
    source = tmp_path / "source"
    (source / "sub").mkdir(parents=True)
    (source / "sub" / "data").write_bytes(b"x" * 100)
    (source / "sub" / "data").chmod(0o400)
    (source / "sub" / "back").symlink_to(source)
    (source / "link").symlink_to(source / "sub" / "data")
    os.mkfifo(source / "fifo")
    place.copy_folder(source, tmp_path / "copy")
    found = sorted(str(path.relative_to(tmp_path / "copy")) for path in (tmp_path / "copy").rglob("*"))
    assert found == ["link", "sub", "sub/data"]
    assert (tmp_path / "copy" / "sub" / "data").stat().st_mode & 0o200
    with pytest.raises(InputError, match="must hold at most"):
        place.copy_folder(source, tmp_path / "other", largest=150)


def test_command_line(tmp_path: Path) -> None:
    from lammps_cases.cli.audit import audit_command

    arguments = [str(DECKS / "in.plain"), "--steps", "20", "--fields", "pressure", "--json", "--out", str(tmp_path)]
    result = CliRunner().invoke(audit_command, arguments, standalone_mode=False)
    assert result.return_value == 0
    document = json.loads(result.stdout)
    assert document["cases"][0]["steps"] == 20 and document["summary"] == {"exact": 1}
