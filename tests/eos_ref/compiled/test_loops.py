"""Compiled sums over pairs, by themselves."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow


def test_the_loops_bring_the_compiled_forms_of_elementary_functions_with_them() -> None:
    """In a fresh process, as what is on disk already needs no compilation, and other modules bring them too."""
    code = (
        "from eos_ref.compiled import loops\n"
        "from eos_ref.jit import inline\n"
        "from eos_ref.kernels.quintic import QUINTIC\n"
        "assert inline(QUINTIC.shape)(0.0) == 66.0\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=Path(__file__).parents[3], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
