"""A recipe of ARCHITECTURE.md, done on a copy of both packages, and a script that uses what is new."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import eos_ref

ROOT = Path(eos_ref.__file__).parents[1]


def walk(folder: Path, edits: Mapping[str, Callable[[str], str]], script: str) -> str:
    """Return what ``tests/support/SCRIPT`` prints with the edited packages; a file that does not exist begins empty."""
    for package in ("eos_ref", "lammps_cases"):
        shutil.copytree(ROOT / package, folder / package, ignore=shutil.ignore_patterns("__pycache__"))
    for name, edit in edits.items():
        file = folder / name
        before = file.read_text(encoding="utf-8") if file.exists() else ""
        file.write_text(edit(before), encoding="utf-8")
        assert file.read_text(encoding="utf-8") != before, f"{name} is unchanged"
    environment = os.environ | {"PYTHONPATH": f"{folder}:{ROOT}", "XDG_CACHE_HOME": str(folder / "cache")}
    program = [sys.executable, "-W", "error::UserWarning", str(ROOT / "tests" / "support" / script)]
    ran = subprocess.run(program, env=environment, cwd=folder, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    return ran.stdout.strip()


def after(line: str, more: str) -> Callable[[str], str]:
    """Return an edit that inserts text behind another one."""
    return lambda text: text.replace(line, line + more, 1)
