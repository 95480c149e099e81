"""Measure what methods cost, for `eos_ref.methods.choice`: seconds to start, nanoseconds per state."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from eos_ref import EOS
from eos_ref.methods.choice import COSTS, usable
from eos_ref.methods.worst import Regime
from lammps_cases.records.files import write_atomically
from lammps_cases.records.progress import SILENT, Progress
from lammps_cases.studies.benchmarks.measure import machine
from lammps_cases.studies.chart.laws import LAWS, QUICK_STATES, timings

FLUID = Regime(1e-9, 0.1)  # the densities for which tables and series are prepared


def save(progress: Progress = SILENT, path: Path = COSTS) -> None:
    """Measure and write ``costs.json``; times in two digits, so that measuring again changes little of the file."""
    laws = [law for law in LAWS if not law.background]
    costs: dict[str, dict[str, Any]] = {}
    for k, law in enumerate(laws):
        progress.advance(k, len(laws), f"costs of {law.style}")
        methods = usable(law)
        took, _ = timings(law, methods, (FLUID,), QUICK_STATES, None)
        for method in methods:
            ns = took[method.name].seconds.median / QUICK_STATES * 1e9
            seconds = _started(law, method.name)
            entry = {"ns": _two_digits(ns), "startup": _two_digits(seconds)}
            costs.setdefault(law.style, {}).setdefault(method.name, entry)
    document = {"machine": machine(), "states": QUICK_STATES, "laws": costs}
    write_atomically(path, json.dumps(document, indent=1) + "\n")


def _two_digits(value: float) -> float:
    return float(f"{value:.2g}")


def _started(law: EOS, method: str) -> float:
    """Return the seconds that the first evaluation of ten states takes in a fresh process beyond the second."""
    return _in_fresh_process(
        "import numpy as np\n"
        "from eos_ref import EOS\n"
        "from eos_ref.methods import laws\n"
        f"law = EOS({law.style!r}, {law.rho0!r}, {law.cs!r}, {law.parameter!r}, {law.background!r})\n"
        f"method = next(m for m in laws.METHODS if m.name == {method!r})\n"
        "rho_n, e_n = np.linspace(0.99, 1.01, 10) * law.rho0, np.ones(10)\n"
        "made = []\n"
        "def call():\n"
        "    if not made:\n"
        "        made.append(method.function(law, 0.99 * law.rho0, 1.01 * law.rho0))\n"
        "    made[0](rho_n, e_n)\n"
    )


def _in_fresh_process(code: str, rounds: int = 3) -> float:
    """Return the least seconds of a first ``call()`` beyond a second one; the first process may compile for good."""
    timing = (
        "import time\nt = [time.perf_counter()]\nfor _ in range(2):\n    call()\n    t.append(time.perf_counter())\n"
    )
    seconds = []
    for _ in range(rounds + 1):
        command = [sys.executable, "-c", code + timing + "print(2 * t[1] - t[0] - t[2])"]
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        seconds.append(max(float(done.stdout.split()[-1]), 0.0))
    return min(seconds[1:])
