"""The Taylor-Green vortices of 10 000 particles on every code at hand: ours, LAMMPS on one and two ranks, others.

Codes that run as programs of their own cannot take turns step by step with ours; each of their runs is followed by
one of ours of about the same length, so that a drift of the machine meets both.
"""

from __future__ import annotations

import inspect
import json
import subprocess
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from eos_ref.errors import InputError
from lammps_cases.engine import ranks
from lammps_cases.engine.session import RunCommand
from lammps_cases.setup import reference_side
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan
from lammps_cases.studies.benchmarks.bench import Ratio
from lammps_cases.studies.benchmarks.measure import ConfidenceInterval, interval
from lammps_cases.studies.flows import FLOWS
from lammps_cases.studies.flows.flow import Options, Start

EDGE = 100  # particles along the edge of the box
STEPS = 20
WARM = 3


def taylor_green(repeats: int, pysph: str | None) -> Iterator[Ratio]:
    """Yield the time per particle and step of ours against every other code.

    Parameters
    ----------
    pysph : str or None
        A Python that has PySPH; None: without it.

    Raises
    ------
    InputError
        That Python cannot run PySPH.
    """
    start = FLOWS["taylor-green"].start(EDGE, Options(kernel="quintic"))
    peers: dict[str, Callable[[], list[float]]] = {
        "LAMMPS": lambda: _lammps(start, 1),
        "LAMMPS, 2 ranks": lambda: _lammps(start, 2),
    }
    if pysph:
        peers["PySPH"] = lambda: _pysph(pysph)
    for threads in _threads():
        ours = _stepping(start, threads)
        scene = f"Taylor-Green, {EDGE**2:,} particles" + (f", {threads} threads" if threads > 1 else "")
        for peer, seconds in peers.items():
            yield _against(scene, peer, ours, seconds, repeats)


def _threads() -> tuple[int, ...]:
    from eos_ref.compiled.evaluator import CompiledEvaluator

    return (1, 2) if "threads" in inspect.signature(CompiledEvaluator.__init__).parameters else (1,)


def _stepping(start: Start, threads: int) -> Callable[[], float]:
    """Return a function that times one step of ours (seconds)."""
    from eos_ref.compiled.evaluator import CompiledEvaluator
    from eos_ref.evaluation.time_step import Simulation

    scene, atoms = start.case.scene, start.atoms
    settings: dict[str, Any] = {"threads": threads} if threads > 1 else {}
    sim = Simulation(
        reference_side.model(scene, atoms, ""),
        reference_side.box(scene, atoms),
        reference_side.state(scene, atoms),
        (),
        lambda *given: CompiledEvaluator(*given, **settings),
    )
    sim.run(WARM, start.timestep)

    def step() -> float:
        begin = time.perf_counter()
        sim.run(STEPS, start.timestep)
        return (time.perf_counter() - begin) / STEPS

    return step


def _lammps(start: Start, count: int) -> list[float]:
    """Return the seconds of one step of LAMMPS on some ranks, after a few to warm up."""
    lammps_job = job(start.case.scene, start.atoms, plan(start.case.scene))
    runs = (RunCommand(f"run {WARM} post no", read=False), RunCommand(f"run {STEPS} pre no post no"))
    answer = ranks.solve(None, replace(lammps_job, runs=runs, ranks=count))
    return [answer.run_seconds[-1] / STEPS]


def _pysph(python: str) -> list[float]:
    script = Path(__file__).parent / "peers" / "pysph_taylor_green.py"
    try:
        done = subprocess.run(
            [python, str(script), str(EDGE), str(STEPS)], check=False, capture_output=True, text=True, timeout=600
        )
    except OSError as error:
        raise InputError("Python of PySPH", f"cannot be run: {error.strerror}", python) from None
    if done.returncode:
        words = done.stderr.strip().splitlines()
        raise InputError("Python of PySPH", f"cannot run its example: {words[-1] if words else 'no message'}", python)
    result = json.loads(done.stdout.splitlines()[-1])
    assert result["particles"] == EDGE**2
    return [float(seconds) for seconds in result["seconds"]]


def _against(
    scene: str, peer: str, ours: Callable[[], float], theirs: Callable[[], list[float]], repeats: int
) -> Ratio:
    own, other, ratio = [], [], []
    for _ in range(repeats):
        seconds = interval(tuple(theirs())).median
        other.append(seconds)
        own.append(ours())
        ratio.append(own[-1] / seconds)
    scale = 1e9 / EDGE**2

    def summary(values: list[float], factor: float) -> ConfidenceInterval:
        return interval(tuple(values)).scaled(factor)

    return Ratio(scene, peer, summary(own, scale), summary(other, scale), summary(ratio, 1.0))
