"""The audit of decks: real LAMMPS runs decks with every documented option of flow control; faults are planted."""

from __future__ import annotations

import functools
import json
import os
import pickle
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
from syrupy.assertion import SnapshotAssertion

from eos_ref import EOSTable, InputError
from lammps_cases.audit import fields, place, sample, share, supervise
from lammps_cases.audit.fields import PRESSURE
from lammps_cases.audit.messages import CommandPlace
from lammps_cases.audit.options import AuditOptions, AuditResult, AuditTask
from lammps_cases.audit.sample import JudgedSample
from lammps_cases.audit.supervise import audit_deck
from lammps_cases.audit.verdict import Findings
from lammps_cases.records.progress import Progress
from lammps_cases.records.run_record import CaseRecord
from tests.support.audited_decks import DECKS, case_of, run_plain, written
from tests.support.outcome import Outcome
from tests.support.pages import unpacked
from tests.support.progress import Steps

pytestmark = pytest.mark.lammps

OF_PRESSURE = AuditOptions(fields=PRESSURE)
PASSING = ("exact", "pass")
HEALTHY = ["plain", "loop", "include", "systems", "gas", "deposit"]
BUG, MOVED = "force-per-volume", "wall-velocity-lost"
OF_WALLS = dict.fromkeys(("grad/v", "stress/v", "stress/t"), MOVED) | {"f": f"{BUG}, {MOVED}"}
# What the ledger has to explain in decks of which every field is checked that can be.
EXPLAINED: dict[str, dict[str, str]] = {
    **{name: {"f": BUG} for name in ("summed", "tilted", "overlay")},
    **dict.fromkeys(("walls_quintic", "walls_summed"), OF_WALLS),
    "walls_corrected": {},
    **{key: {"f": BUG, "heatflow": "heat-is-temperature-rate"} for key in ("power", "gas")},
}
DUMPING = [*dict.fromkeys([*HEALTHY, *EXPLAINED])]
JUDGED = "judged.{}.pickle"  # what a sample is judged by, kept by these decks
KEEPING = ("summed", "power")


def _keeping(task: AuditTask, connection: Connection) -> None:
    from lammps_cases.audit import child, sample

    right = sample.judged
    taken: list[int] = []

    def keep(of: Any, names: Any, tag_n: Any, shown: Any, *rest: Any, **more: Any) -> Any:
        Path(JUDGED.format(len(taken))).write_bytes(pickle.dumps((of, names, tag_n.copy(), shown)))
        taken.append(1)
        return right(of, names, tag_n, shown, *rest, **more)

    sample.judged = keep
    child.main(task, connection)


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    return functools.cache(lambda name: tmp_path_factory.mktemp(name))


@pytest.fixture(scope="module")
def audited(kept: Callable[[str], Path]) -> Callable[[str], AuditResult]:
    """Audit all fields of a deck of the tests, once; its output is kept."""

    @functools.cache
    def audit(name: str) -> AuditResult:
        with pytest.MonkeyPatch.context() as patch:
            if name in KEEPING:
                patch.setattr(supervise, "ENTRY", _keeping)
            return audit_deck(DECKS / f"in.{name}", AuditOptions(keep=kept(name), fields=("all",)))

    return audit


Audited = Callable[[str], AuditResult]


# --- healthy decks ---

# Their densities lie on both sides of rho0 at random, and the audit warns correctly that such a tension would clump
# in time; their masses, densities and speeds are odd numbers, so that none can be confused with another.
DELIBERATE = (
    *("the tension at which particles clump", " times rho0 V = ", " times rho0 = ", " times the largest speed "),
    *("closer than", "neighbours at another height"),
)


@pytest.mark.parametrize("name", HEALTHY)
def test_healthy_deck_is_clean(name: str, audited: Audited) -> None:
    result = audited(name)
    case = case_of(result)
    of_pressure = [field for field in case.fields if field.field == "pressure"]
    assert result.record.exit_code() == 0 and case.tags == ["audit"] and case.case == f"in.{name}"
    assert [warning for warning in case.warnings if not any(part in warning for part in DELIBERATE)] == []
    assert [field.atom_type for field in of_pressure] == [1, 2]
    assert all(field.verdict in PASSING and field.worst_step is not None for field in of_pressure)
    assert all((field.max_over_bound or 0) < 1 for field in of_pressure)
    assert case.natoms == len(result.arrays["id"])


def table(case: CaseRecord) -> str:
    """The laws, the fields with what explains them, and of every sample the number of particles per field and type."""
    lines = [f"{law.style} {law.parameter}: rho0 {law.rho0}, mass {law.mass}, {law.background}" for law in case.laws]
    lines += [
        " ".join([f.field, "inside" if f.verdict in PASSING else f.verdict, *f.explained_by]) for f in case.fields
    ]
    samples: list[tuple[str, dict[int, list[str]]]] = []
    first = (case.checks[0].field, case.checks[0].type)
    for check in case.checks:
        if (check.field, check.type) == first or f"run {check.run}, step {check.step}" != samples[-1][0]:
            samples.append((f"run {check.run}, step {check.step}", {}))
        samples[-1][1].setdefault(check.natoms, []).append(f"{check.field} {check.type or ''}".strip())
    return "\n".join(
        [*lines, *(f"{of}: {n} of {', '.join(names)}" for of, rows in samples for n, names in rows.items())]
    )


@pytest.mark.parametrize("name", DUMPING)
def test_laws_fields_and_samples(name: str, audited: Audited, snapshot: SnapshotAssertion) -> None:
    """Laws are those after substitution and redefinition; created and deleted atoms are judged.

    A second set-up invokes the callback twice on a step, with different half-step velocities; both samples count.
    At a set-up with summed wall densities LAMMPS outputs densities of solids that it did not use: only fluid is judged.
    Atoms deposited into a slab (in.deposit) lie off the plane of a 2D deck: fields near them are not two-dimensional.
    """
    case = case_of(audited(name))
    assert table(case) == snapshot
    checked = {field.field for field in case.fields}
    explained = {f.field: ", ".join(f.explained_by) for f in case.fields if f.verdict == "explained"}
    assert explained == EXPLAINED.get(name, explained)
    assert all(f.verdict in PASSING and (f.max_over_bound or 0) < 1 for f in case.fields if f.field not in explained)
    touched = {effect.finding for effect in case.effects if effect.field not in checked}  # a known bug, unseen
    assert case.verdict in (["explained"] if explained or touched else PASSING)
    named = {line.partition(":")[0].removesuffix(" with all that adds to it") for line in case.not_checked}
    assert named | checked == set(fields.offered())
    assert name != "deposit" or "atoms of this 2D deck have neighbours at another height" in case.warnings[-1]


def test_energy_is_per_mass(audited: Audited) -> None:
    arrays = audited("gas").arrays
    gamma_n = np.where(arrays["type"] == 1, 1.4, 1.67)
    expected_n = (gamma_n - 1) * arrays["rho"] * arrays["e"] + 0.05
    # All terms are positive and gamma - 1 is exact: five roundings on either side (energy/mass, two products, the sum).
    np.testing.assert_allclose(arrays["pressure.lammps"], expected_n, rtol=10 * 2.0**-53)


def test_arrays_of_the_last_sample(audited: Audited) -> None:
    arrays = audited("plain").arrays
    assert np.all(np.diff(arrays["id"]) > 0) and arrays["step"] == 40
    assert arrays["x"].shape == (64, 3) and arrays["box"].tolist() == [[0, 0, -0.01], [8, 8, 0.01]]
    difference = np.abs(arrays["pressure.lammps"] - arrays["pressure.reference"])
    assert np.all(difference <= arrays["pressure.bound"]) and np.all(arrays["pressure.bound"] > 0)


def test_fields_have_values(audited: Audited) -> None:
    """A comparison of zeros would pass, too."""
    summed, walls, power = (audited(name).arrays for name in ("summed", "walls_quintic", "power"))
    assert set(np.unique(summed["surface.lammps"])) == {0.0, 1.0, 2.0}
    for field in ("shift/v", "grad/v", "surface/n", "surface/r", "stress/v"):
        assert np.abs(summed[f"{field}.lammps"]).max() > 1e-6
    assert 0.3 < walls["chi.lammps"].min() < 0.9 and np.abs(walls["drho.lammps"]).max() > 1e-6
    assert len(np.unique(power["viscosity.lammps"][power["type"] == 1])) > 16
    assert np.abs(power["heatflow.lammps"]).max() > 1e-6


# --- the audit changes nothing ---


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of folders in which LAMMPS has run the decks without an audit."""
    root = tmp_path_factory.mktemp("plain")
    for name in [*DUMPING, "flow"]:
        shutil.copytree(DECKS, root / name)
    run_plain(*(root / name / f"in.{name}" for name in [*DUMPING, "flow"]))
    return root


@pytest.mark.parametrize("name", [*DUMPING, "flow"])
def test_deck_does_the_same_as_without_audit(
    name: str, audited: Audited, kept: Callable[[str], Path], plain: Path
) -> None:
    expected = written(plain / name)
    assert len(expected) >= (1 if name == "flow" else 2)
    if name == "flow":
        with pytest.raises(InputError, match="must reach a run command"):
            audited(name)
        assert expected["flow.txt"].count(b"\n") == 19
    else:
        audited(name)
    assert written(kept(name)) == expected
    assert written(DECKS) == {}, "the folder of the deck stays untouched"


# --- planted faults: in what a sample is judged by


@pytest.fixture(scope="module")
def judge(audited: Audited, kept: Callable[[str], Path]) -> Callable[..., JudgedSample]:
    """Judge the first two samples of a deck, which LAMMPS wrote, after a change of either side of the second."""

    def judged(name: str, change: Callable[[Any, Any, Any], Any]) -> JudgedSample:
        who = audited(name).who["distribution"]
        explained: dict[str, Any] = {}
        for number in (0, 1):
            of, names, tag_n, shown = pickle.loads((kept(name) / JUDGED.format(number)).read_bytes())
            if number:
                of = change(of, tag_n, shown) or of
            found = sample.judged(of, names, tag_n, shown, sample.known(who), explained)
            explained = found.explained
            red = {field for field, c in found.comparisons.items() if c.record.verdict == "differs"}
            assert number or not red
        return found

    return judged


def red_of(found: JudgedSample) -> set[str]:
    return {field for field, c in found.comparisons.items() if c.record.verdict == "differs"}


SUMMED_WRONG = ["coordination", "rho", "grad/v", "shift/v", "surface/r", "surface/n", "surface/divr", "f", "drho"]


@pytest.mark.parametrize("field", SUMMED_WRONG)
def test_one_wrong_value_is_named(field: str, judge: Callable[..., JudgedSample]) -> None:
    def damage(of: Any, tag_n: Any, shown: Any) -> None:
        shown[field] = np.array(shown[field])
        values = shown[field].reshape(len(tag_n), -1)
        values[tag_n.tolist().index(17), -1] += 1 if field == "coordination" else 1e-9

    found = judge("summed", damage)
    assert red_of(found) == {field}
    record = found.comparisons[field].record
    assert (record.worst_id, record.outside) == (17, 1) or field == "f"  # that also the finding moves elsewhere


@pytest.mark.parametrize(
    ("name", "red"), [("power", {"viscosity", "stress/v", "stress/t", "f"}), ("summed", {"rho", "shift/v"})]
)
def test_wrong_parameter_differs(name: str, red: set[str], judge: Callable[..., JudgedSample]) -> None:
    def change(of: Any, tag_n: Any, shown: Any) -> Any:
        if name == "summed":
            return replace(of, mass_n=of.mass_n * (1 + 1e-12))
        one, two = of.model.viscosity
        return replace(of, model=replace(of.model, viscosity=(replace(one, K=one.K * (1 + 1e-10)), two)))

    found = red_of(judge(name, change))
    assert red <= found and not found & {"coordination", "pressure", "temperature"}


# --- planted faults, in the process that runs the deck


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


def _one_atom(lmp: Any, step: int, n: int) -> None:
    if step >= 20:
        row = lmp.numpy.extract_atom("id")[:n].tolist().index(17)
        lmp.numpy.extract_atom("pressure")[row] += 1e-13


def _segfault(lmp: Any, step: int, n: int) -> None:
    if step == 20:
        os.write(2, b"free(): invalid pointer\n")
        os.kill(os.getpid(), signal.SIGSEGV)


def _wrong_look(lmp: Any, step: int, n: int) -> None:
    raise InputError("look", "must not fail", step)


def _hang(task: AuditTask, connection: Connection) -> None:
    connection.send(CommandPlace("in.plain:7", "run   45"))
    time.sleep(600)


def _shown(field: str, of_deck: str, task: AuditTask, connection: Connection) -> None:
    """From the second sample of `of_deck` on, or all of the deck of pair_style rheo alone, one wrong value."""
    from lammps_cases.audit import child, sample

    right, calls = sample.Sampler.shown, []

    def wrong(self: Any, n: int, of_pairs: Any) -> Any:
        shown = right(self, n, of_pairs)
        calls.append(n)
        if len(calls) > (task.deck != share.SCRIPT):
            row = self.lmp.numpy.extract_atom("id")[:n].tolist().index(17)
            shown[field].reshape(n, -1)[row, -1] += 1e-9
        return shown

    if task.deck == of_deck:
        sample.Sampler.shown = wrong
    child.main(task, connection)


@pytest.fixture
def audit_with(monkeypatch: pytest.MonkeyPatch) -> Callable[..., AuditResult]:
    """Audit a deck with another entry of its process."""

    def audit(entry: Callable[..., None], name: str = "plain", **options: Any) -> AuditResult:
        monkeypatch.setattr(supervise, "ENTRY", entry)
        return audit_deck(DECKS / f"in.{name}", AuditOptions(**({"fields": PRESSURE} | options)))

    return audit


AuditWith = Callable[..., AuditResult]


def test_wrong_law_differs(audit_with: AuditWith) -> None:
    result = audit_with(_stiffer)
    case = case_of(result)
    assert case.verdict == "differs" and result.record.exit_code() == 1
    assert [field.verdict for field in case.fields] == ["exact", "differs"]
    assert "first at step 0 (run 1), type 2" in case.message


def test_one_wrong_atom_is_named(audit_with: AuditWith, audited: Audited) -> None:
    healthy = audited("plain").arrays
    result = audit_with(functools.partial(_at_each_look, _one_atom))
    case = case_of(result)
    assert int(result.arrays["step"]) == 20  # the picture shows where it starts
    assert int(healthy["step"]) == max(check.step for check in case.checks) == 40
    wrong_type = int(healthy["type"][healthy["id"] == 17][0])
    assert f"first at step 20 (run 1), type {wrong_type}, atom 17: 1 of 32 atoms" in case.message
    field = case.fields[wrong_type - 1]
    assert (field.verdict, field.worst_id, field.outside) == ("differs", 17, 1) and field.worst_step in (20, 30, 40)
    bad = {(check.step, check.type) for check in case.checks if check.verdict == "differs"}
    assert bad == {(step, wrong_type) for step in (20, 30, 40)}


def test_wrong_value_of_a_field_is_named_with_its_first_step(audit_with: AuditWith) -> None:
    result = audit_with(functools.partial(_shown, "grad/v", "in.summed"), "summed", fields=("all",), steps=20)
    case = case_of(result)
    assert case.verdict == "differs" and result.record.exit_code() == 1
    assert "grad/v leaves its bound first at step 10 (run 1), atom 17: 1 of 75 atoms" in case.message
    bad = {(check.field, check.step) for check in case.checks if check.verdict == "differs"}
    assert bad == {("grad/v", 10), ("grad/v", 20)}
    assert int(result.arrays["step"]) == 10  # where it starts, not where the audit ends


def test_crash_keeps_earlier_samples(audit_with: AuditWith) -> None:
    result = audit_with(functools.partial(_at_each_look, _segfault))
    case = case_of(result)
    assert case.verdict == "crashed" and result.record.exit_code() == 3
    assert {check.step for check in case.checks} == {0, 10}
    assert "SIGSEGV" in case.message and "run 45 (in.plain:12)" in case.message
    assert "free(): invalid pointer" in case.message


def test_quit_inside_a_run_ends_only_the_child() -> None:
    case = case_of(audit_deck(DECKS / "in.quit"))
    assert case.verdict == "crashed" and "exited with code 4" in case.message and case.died == "exit code 4"
    assert max(check.step for check in case.checks) >= 60


def test_hang_is_a_timeout(audit_with: AuditWith, monkeypatch: pytest.MonkeyPatch) -> None:
    """The time limit expires while LAMMPS hangs, independent of its start-up time."""
    ahead, take = [0.0], Findings.take
    clock = SimpleNamespace(monotonic=lambda: time.monotonic() + ahead[0], perf_counter=time.perf_counter)

    def taken(findings: Findings, message: object) -> None:
        take(findings, message)
        ahead[0] = 300.0

    monkeypatch.setattr(supervise, "time", clock)
    monkeypatch.setattr(Findings, "take", taken)
    case = case_of(audit_with(_hang, timeout=300.0))
    assert case.verdict == "timeout"
    assert case.message == "stopped after 300 s, after step 0 of the audit, in: run 45 (in.plain:7)"


def test_error_inside_a_sample_is_raised(audit_with: AuditWith) -> None:
    with pytest.raises(InputError, match="look: must not fail"):
        audit_with(functools.partial(_at_each_look, _wrong_look))


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


# --- forces to which other styles add


def soft_forces(x_nc: Any, edge: float, amplitude: float, cut: float) -> Any:
    """Forces of E = A (1 + cos(pi r/cut)) in a periodic square, (n, 2)."""
    apart = x_nc[:, None] - x_nc[None]
    apart -= edge * np.round(apart / edge)
    r = np.sqrt((apart**2).sum(axis=2))
    np.fill_diagonal(r, np.inf)
    size = np.where(r < cut, amplitude * np.pi / cut * np.sin(np.pi * np.minimum(r, cut) / cut) / r, 0.0)
    return (size[..., None] * apart).sum(axis=1)


def test_force_of_pair_rheo_is_the_remainder_of_the_total(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    results: list[AuditResult] = []

    def kept(*given: Any) -> AuditResult:
        results.append(audit_deck(*given))
        return results[-1]

    monkeypatch.setattr(supervise, "audit_deck", kept)
    case = case_of(audit_deck(DECKS / "in.overlay", AuditOptions(keep=tmp_path)))
    rows = np.loadtxt(tmp_path / "final.dump", skiprows=9)
    rows = rows[np.argsort(rows[:, 0])]
    second = results[0].arrays
    periods = (second["x"] - rows[:, 2:5]) / 8
    assert np.array_equal(second["type"], rows[:, 1]) and np.array_equal(periods, np.round(periods))
    edge, amplitude, cut = 8.0, 0.5, 1.2
    total = second["f.lammps"] + soft_forces(rows[:, 2:4], edge, amplitude, cut)
    # Of each of the other particles: ten roundings of its force, and those of two places, which change it by pi/cut.
    size, moved = amplitude * np.pi / cut, 2 * edge * np.pi / cut
    assert np.abs(total - rows[:, 8:10]).max() < 2 * len(rows) * (10 + moved) * 2.0**-53 * size
    assert np.abs(second["f.lammps"] - rows[:, 8:10]).max() > 0.01
    assert [(check.run, check.step) for check in case.checks if check.field == "f"] == [(1, 20)]
    line = next(line for line in case.not_checked if line.startswith("f "))
    assert line.startswith(
        "f with all that adds to it: pair_style soft adds to it; compared is that of pair_style rheo"
    )


def test_wrong_force_of_pair_rheo_is_detected(audit_with: AuditWith) -> None:
    case = case_of(audit_with(functools.partial(_shown, "f", share.SCRIPT), "overlay", fields=fields.DEFAULT))
    assert case.verdict == "differs" and {f.field for f in case.fields if f.verdict == "differs"} == {"f"}
    assert case.blame is not None and (case.blame.field, case.blame.step) == ("f", 20)


def test_failure_of_the_second_lammps_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    write = share.write
    monkeypatch.setattr(share, "write", lambda asked, to: write(replace(asked, commands=["bogus"]), to))
    case = case_of(audit_deck(DECKS / "in.overlay", AuditOptions(steps=1)))
    line = next(line for line in case.not_checked if line.startswith("f: "))
    assert "pair_style soft adds to it; of pair_style rheo alone" in line and "cannot be had (ERROR" in line
    assert case.verdict == "explained" and case.findings == [BUG]  # which no sample of f contradicts


# --- LAMMPS' own errors, options ---


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


# --- fields requested


@pytest.mark.parametrize(
    ("name", "field", "why"),
    [
        ("plain", "surface", "fix rheo has no surface/detection in this deck"),
        ("plain", "rho", "integrated over time"),
        ("plain", "x", "input to the check, not a result"),
        ("walls_corrected", "f", "reproducing kernels use wall densities"),
    ],
)
def test_field_missing_from_the_deck(name: str, field: str, why: str) -> None:
    with pytest.raises(InputError, match=rf"{field}: cannot be checked in this deck: .*{why}"):
        audit_deck(DECKS / f"in.{name}", AuditOptions(fields=("pressure", field)))


def test_bad_names_of_fields_give_a_one_line_message(eos_ref_command: Callable[..., Outcome]) -> None:
    code, out, err = eos_ref_command("audit", DECKS / "in.plain", "--fields", "pressure,densty")
    (line,) = err.splitlines()
    assert (code, out) == (2, "") and "densty" in line and "must be one of all, coordination, rho, chi, grad/v" in line
    with pytest.raises(InputError, match="must name at least one"):
        AuditOptions(fields=())


def test_only_chosen_fields_are_compared() -> None:
    case = case_of(audit_deck(DECKS / "in.summed", AuditOptions(fields=("surface/n", "rho"), steps=10)))
    assert [field.field for field in case.fields] == ["rho", "surface/n"] and case.verdict == "pass"
    assert "--fields rho,surface/n" in case.reproduce and case.not_checked == []


# --- command line


def test_command_line_writes_a_document(eos_ref_command: Callable[..., Outcome], tmp_path: Path) -> None:
    words = ("--steps", "20", "--fields", "pressure", "--json", "--out", tmp_path / "out")
    code, out, _ = eos_ref_command("audit", DECKS / "in.plain", *words)
    document = json.loads(out)
    assert code == 0 and document["cases"][0]["steps"] == 20 and document["summary"] == {"exact": 1}


def test_command_line_prints_fields(eos_ref_command: Callable[..., Outcome], tmp_path: Path) -> None:
    words = ("--fields", "all", "--steps", "10", "--out", tmp_path / "out")
    code, out, _ = eos_ref_command("audit", DECKS / "in.summed", *words)
    lines = {line.split()[0]: line.split() for line in out.splitlines() if line.strip()}
    assert code == 0
    assert lines["f"][1:4] == ["all", "2", "75"] and lines["f"][-3:] == ["explained", "by", BUG]
    assert [line for line in out.splitlines() if line.startswith("not checked")] == [
        "not checked: chi, conductivity, cv, temperature, heatflow, rho_wall, energy: fix rheo of this deck has no "
        "such feature",
        "not checked: stress/atom, virial, press, x, v, phase, status: not in any audit (the report says why)",
    ]
    page = unpacked((tmp_path / "out" / "report.html").read_text())
    assert "<td>surface/divr</td>" in page and "Not checked" in page


def test_output_states_each_error_once_within_the_width(
    eos_ref_command: Callable[..., Outcome], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "110")
    code, out, _ = eos_ref_command("audit", DECKS / "in.column", "--out", tmp_path / "out")
    assert code == 3 and " ".join(out.split()).count("ERROR: Lost atoms") == 1
    assert max(len(line) for line in out.splitlines() if str(tmp_path) not in line) <= 110
