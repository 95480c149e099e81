"""Compiled loops: the choice of registers changes no bit."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from numba.core import codegen

ROOT = Path(__file__).parents[2]
PRINTS = """
import hashlib
import numpy as np
from eos_ref import EOS
from eos_ref.eos import compiled
rho, out = np.random.default_rng(1).uniform(0.1, 9.0, 1001), np.empty(1001)
compiled.pressure_of_one_type(rho, np.empty(0), *EOS("tait/general", 1.2, 3.4, 1.4).settings, out)
print(hashlib.sha256(out.tobytes()).hexdigest())
"""


def test_registers_are_chosen_before_anything_is_compiled() -> None:
    """The first function that numba decorates fixes them for the process."""
    sources = [path for package in ("eos_ref", "lammps_cases") for path in (ROOT / package).rglob("*.py")]
    by_numba = [path for path in sources if re.search("^(import|from) numba", path.read_text(), re.MULTILINE)]
    late = [path for path in by_numba if "eos_ref.jit import" not in path.read_text() and not chooses(path)]
    assert len(by_numba) > 5
    assert {path.name for path in late} == {"jit.py", "vectors.py"}  # the latter declares types alone


def chooses(path: Path) -> bool:
    return "\nimport eos_ref.jit " in path.read_text()


@pytest.mark.slow
def test_bits_do_not_depend_on_the_registers() -> None:
    """The chosen ones, LLVM's default, and those that every processor has, without fused operations."""
    given = {}, {"NUMBA_CPU_FEATURES": codegen.get_host_cpu_features()}, {"NUMBA_CPU_NAME": "generic"}
    said = [
        subprocess.run([sys.executable, "-c", PRINTS], env=os.environ | own, check=True, capture_output=True, text=True)
        for own in given
    ]
    assert len({done.stdout for done in said}) == 1
