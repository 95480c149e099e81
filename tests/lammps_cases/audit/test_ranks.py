"""Decks on several MPI ranks: the same verdicts, the trajectory of LAMMPS on as many ranks, and how runs end."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eos_ref import InputError
from lammps_cases.audit import supervise
from lammps_cases.audit.command import audit_restart
from lammps_cases.audit.options import AuditOptions, AuditResult, AuditTask
from lammps_cases.audit.supervise import audit_deck
from lammps_cases.engine import containment, mpi, ranks
from lammps_cases.engine.session import EngineLacks, package_directory
from lammps_cases.records.run_record import CaseRecord
from tests.support.audited_decks import DECKS, PLAIN, case_of, written
from tests.support.outcome import Outcome

pytestmark = pytest.mark.lammps

Edits = dict[str, str]


def deck_of(name: str, folder: Path, edits: Edits | None = None) -> Path:
    """A deck of tests/decks, with changes, in a separate folder."""
    shutil.copytree(DECKS, folder, dirs_exist_ok=True)
    deck = folder / f"in.{name}"
    text = deck.read_text()
    for old, new in (edits or {}).items():
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    deck.write_text(text)
    return deck


def audited(deck: Path, count: int, every: int = 5, keep: Path | None = None) -> AuditResult:
    return audit_deck(deck, AuditOptions(every=every, ranks=count, keep=keep))


def verdicts(case: CaseRecord) -> dict[str, tuple[str, list[str]]]:
    return {f"{f.field}.{f.atom_type}": (f.verdict, f.explained_by) for f in case.fields}


def judged(result: AuditResult) -> dict[str, Any]:
    """Positions, and whether each value of a field lies in its bound, sorted by position, as ids depend on ranks."""
    a = result.arrays
    x_nc = a["x"].round(6)
    order_n = np.lexsort(x_nc.T)
    names = [name.removesuffix(".bound") for name in a if name.endswith(".bound")]
    inside = {name: np.abs(a[f"{name}.lammps"] - a[f"{name}.reference"]) <= a[f"{name}.bound"] for name in names}
    return {name: values[order_n] for name, values in {"x": x_nc, **inside}.items()}


KINDS: dict[str, tuple[str, Edits, Edits]] = {  # deck, edits, edits on one rank
    "3D": ("box", {}, {}),
    "newton on": ("box", {"newton          off": "newton on"}, {}),
    "walls": ("basin", {"run ": "dump out all custom 5 out.dump id x y vx vy fx fy\nrun "}, {}),
    "atoms that come and go": ("deposit", {}, {}),
    "a rank without atoms": ("halves", {}, {"processors      2 1 1": ""}),
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_two_ranks_give_the_verdict_of_one(kind: str, tmp_path: Path) -> None:
    name, edits, alone = KINDS[kind]
    (tmp_path / "kept").mkdir()
    one = audited(deck_of(name, tmp_path / "one", edits | alone), 1)
    two = audited(deck_of(name, tmp_path / "deck", edits), 2, keep=tmp_path / "kept")
    assert case_of(two).natoms == case_of(one).natoms and case_of(two).engine_error == ""
    assert verdicts(case_of(two)) == verdicts(case_of(one))
    of_one, of_two = judged(one), judged(two)
    assert len(of_one) > 2 and of_two.keys() == of_one.keys()
    assert [name for name in of_one if not np.array_equal(of_two[name], of_one[name])] == []

    plain = deck_of(name, tmp_path / "plain", edits)
    command, environment = mpi.launcher(package_directory().parent, 2)
    words = [*command, sys.executable, "-c", PLAIN, str(plain)]
    subprocess.run(words, env=environment, check=True, capture_output=True, timeout=120)
    assert written(plain.parent) and written(plain.parent) == written(tmp_path / "kept")


@pytest.mark.slow
def test_pairs_between_processes_show_known_bugs(tmp_path: Path) -> None:
    edits = {"units           lj": "units lj\nnewton off on", "block 1 7 1 5": "block 11 15 1 5"}
    case = case_of(audited(deck_of("halves", tmp_path, edits), 2, every=20))
    assert "boundary-pairs-twice" in {record.finding for record in case.acting}
    assert case.verdict == "explained" and "because of the known bug boundary-pairs-twice" in case.unchecked["grad/v"]


def test_deck_needing_more_ranks_is_refused(tmp_path: Path) -> None:
    case = case_of(audit_deck(deck_of("halves", tmp_path, {"2 1 1": "2 3 1"})))
    assert case.verdict == "refused"
    assert "Specified processors != physical processors" in case.message and "--ranks 6 starts as many" in case.message


def test_error_on_one_rank_ends_all(tmp_path: Path) -> None:
    """An atom far in the right half has an invalid position, which only the rank there sees; the other waits for it."""
    far = "region far block 22.5 23.5 1.5 2.5 -0.5 0.5 units box\ngroup far region far\nvelocity far set 1e305 0 0\n"
    edits = {"block 1 7 1 5": "block 1 25 1 5", "run             20": f"{far}timestep 1e5\nrun 20"}
    case = case_of(audited(deck_of("halves", tmp_path, edits), 2))
    assert case.verdict == "refused" and "ERROR on proc 1: Non-numeric atom coords" in case.engine_error
    assert case.broke is not None and case.broke.particles == 1


def _segfault(task: AuditTask, connection: Connection) -> None:
    from lammps_cases.audit import child, watch

    right = watch.DeckWatch._sample

    def wrong(self: watch.DeckWatch, run: watch.WatchedRun, table: Any, step: int, *arrays: Any) -> None:
        if step == 10 and self.lmp.extract_setting("world_rank") == 1:
            os.kill(os.getpid(), signal.SIGSEGV)
        right(self, run, table, step, *arrays)

    watch.DeckWatch._sample = wrong
    child.main(task, connection)


def test_death_of_one_rank_ends_all(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(supervise, "ENTRY", _segfault)
    case = case_of(audited(deck_of("halves", tmp_path), 2))
    assert (case.verdict, case.died) == ("crashed", "SIGSEGV")
    assert "LAMMPS on several ranks was killed by SIGSEGV" in case.message and "after step 5" in case.message


@pytest.mark.slow
def test_restart_of_a_deck_for_two_ranks(tmp_path: Path) -> None:
    deck = deck_of("halves", tmp_path / "deck")
    (tmp_path / "kept").mkdir()
    audited(deck, 2, keep=tmp_path / "kept")
    case = case_of(audit_restart(tmp_path / "kept" / "kept.10", deck, AuditOptions(ranks=2)))
    assert case.natoms == 35 and case.checks[0].step == 10 and "--ranks 2" in case.reproduce


@pytest.mark.slow
def test_large_messages_pass_between_contained_ranks(tmp_path: Path) -> None:
    edits = {"block 0 26 0 6": "block 0 300 0 300", "block 1 7 1 5": "block 1 299 1 299", "run             20": "run 1"}
    deck = deck_of("halves", tmp_path, edits)
    case = case_of(audit_deck(deck, AuditOptions(ranks=2, trust=False, fields=("pressure",))))
    assert case.verdict == "exact" and case.natoms == 299 * 299


# --- what is refused


@pytest.mark.parametrize("count", [0, -1, 65])
def test_number_of_ranks(count: int, eos_ref_command: Callable[..., Outcome], tmp_path: Path) -> None:
    refused = eos_ref_command("audit", DECKS / "in.halves", "--ranks", str(count), "--out", tmp_path / "out")
    assert refused.code == 2 and refused.err.count("\n") == 1 and not (tmp_path / "out").exists()
    assert f"ranks: must be 1 to 64 processes, found {count}" in refused.err


def _without_mpi(site: str | None, count: int) -> str:
    raise EngineLacks(f"{count} ranks need MPI, and this LAMMPS was built without")


def test_ranks_need_mpi_and_landlock(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ranks, "launcher_of", _without_mpi)
    with pytest.raises(InputError, match=r"^ranks: cannot be started \(2 ranks need MPI, and this LAMMPS was built"):
        audited(DECKS / "in.halves", 2)
    monkeypatch.setattr(containment, "means", lambda: "bubblewrap")
    with pytest.raises(InputError, match=r"^deck: can be contained on several ranks by Landlock alone .* --trust"):
        supervise.confined(AuditOptions(ranks=2, trust=False))
