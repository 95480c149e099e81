"""The server that workers are forked from."""

from __future__ import annotations

import gc
import subprocess
import sys
from pathlib import Path

import pytest

from lammps_cases.engine.workers import Failure, Workers

PROGRAM = """
from lammps_cases.engine import forkserver
from lammps_cases.engine.pool import LocalPool

forkserver.start_for_judging()
for fresh in (False, True, False):
    pool = LocalPool(1, fresh)
    print(pool.schedule(eval, ("'eos_ref' in __import__('sys').modules",), 60.0).result())
    pool.finish()
"""


def _garbage(_: str | None) -> tuple[bool, int]:
    return gc.isenabled(), gc.get_freeze_count()


@pytest.mark.slow
def test_workers_collect_garbage_except_among_imports_of_the_server() -> None:
    with Workers(None, 1) as pool:
        found = pool.outcome(pool.call(_garbage, time_limit=60.0))
    assert not isinstance(found, Failure)
    enabled, set_aside = found
    assert enabled and set_aside > 10_000


@pytest.mark.slow
def test_fresh_processes_import_nothing_in_advance() -> None:
    printed = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True).stdout
    assert printed.split() == ["True", "False", "True"]


@pytest.mark.lammps
def test_modules_in_the_current_folder_are_not_imported(tmp_path: Path) -> None:
    for name in ("lammps_cases", "lammps", "yaml", "numbers"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('not this one')\n")
    cases = "units.si.linear", "newton.bonds-two-ranks.thermal-3d"
    command = [sys.executable, Path(sys.executable).with_name("eos-ref"), "run", *cases, "--out", "out"]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert run.returncode == 0 and "2 cases: 1 exact" in run.stdout, run.stdout + run.stderr
