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
from lammps_cases.records.measure import machine
from lammps_cases.records.progress import SILENT, Progress
from lammps_cases.studies.chart.laws import LAWS, QUICK_STATES, timings

FLUID = Regime(1e-9, 0.1)  # the densities for which tables and series are prepared


def save(progress: Progress = SILENT, path: Path = COSTS) -> None:
    """Measure and write ``costs.json``; times in two digits, so that measuring again changes little of the file."""
    laws = [law for law in LAWS if not law.background]
    costs: dict[str, dict[str, Any]] = {}
    for k, law in enumerate(laws):
        progress.advance(k, len(laws), f"costs of {law.style}")
        methods = usable(law)
        took, _ = timings(law, methods, FLUID, QUICK_STATES, None)
        for method in methods:
            ns = took[method.name].seconds.median / QUICK_STATES * 1e9
            entry = {"ns": float(f"{ns:.2g}"), "startup": float(f"{_startup(law, method.name):.2g}")}
            costs.setdefault(law.style, {}).setdefault(method.name, entry)
    document = {"machine": machine(), "states": QUICK_STATES, "laws": costs}
    write_atomically(path, json.dumps(document, indent=1) + "\n")


def _startup(law: EOS, method: str, rounds: int = 3) -> float:
    """Return the seconds that the first evaluation of ten states takes in a fresh process beyond the second.

    The least of some rounds; one more comes before them, in which numba may compile for good.
    """
    code = f"""if True:
        import time
        import numpy as np
        from eos_ref import EOS
        from eos_ref.methods import laws
        law = EOS({law.style!r}, {law.rho0!r}, {law.cs!r}, {law.parameter!r}, {law.background!r})
        method = next(m for m in laws.METHODS if m.name == {method!r})
        rho_n, e_n = np.linspace(0.99, 1.01, 10) * law.rho0, np.ones(10)
        t = [time.perf_counter()]
        evaluate = method.function(law, 0.99 * law.rho0, 1.01 * law.rho0)
        for _ in range(2):
            evaluate(rho_n, e_n)
            t.append(time.perf_counter())
        print(2 * t[1] - t[0] - t[2])"""
    seconds = []
    for _ in range(rounds + 1):
        process = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
        seconds.append(max(float(process.stdout.split()[-1]), 0.0))
    return min(seconds[1:])
