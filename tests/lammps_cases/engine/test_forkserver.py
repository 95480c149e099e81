"""The servers that workers are forked from."""

from __future__ import annotations

import subprocess
import sys

import pytest

PROGRAM = """
from lammps_cases.engine import forkserver
from lammps_cases.engine.pool import OrderedPool

forkserver.start_for_judging()
for context in (forkserver.context(), forkserver.second_context("json"), forkserver.context()):
    with OrderedPool(max_workers=1, context=context) as pool:
        print(pool.schedule(eval, ["'eos_ref' in __import__('sys').modules"]).result())
"""


@pytest.mark.slow
def test_processes_of_the_second_server_begin_with_no_more_than_is_asked_for() -> None:
    printed = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True).stdout
    assert printed.split() == ["True", "False", "True"]
