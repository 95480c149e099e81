"""Compiled loops: the registers that they take change no bit."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from numba.core import codegen

PRINTS = """
import hashlib
import numpy as np
from eos_ref import EOS
from eos_ref.eos import compiled
rho, out = np.random.default_rng(1).uniform(0.1, 9.0, 1001), np.empty(1001)
compiled.pressure_of_one_type(rho, np.empty(0), *EOS("tait/general", 1.2, 3.4, 1.4).settings, out)
print(hashlib.sha256(out.tobytes()).hexdigest())
"""


@pytest.mark.slow
def test_the_bits_do_not_depend_on_the_registers() -> None:
    """Those taken, those that LLVM takes by itself, and those that every processor has, which fuse nothing."""
    given = {}, {"NUMBA_CPU_FEATURES": codegen.get_host_cpu_features()}, {"NUMBA_CPU_NAME": "generic"}
    said = [
        subprocess.run([sys.executable, "-c", PRINTS], env=os.environ | own, check=True, capture_output=True, text=True)
        for own in given
    ]
    assert len({done.stdout for done in said}) == 1
