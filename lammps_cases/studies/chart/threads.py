"""Chart of threads: when a second one pays."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from eos_ref import EOS
from eos_ref.eos.table import FloatArray
from eos_ref.evaluation.time_step import Simulation
from eos_ref.methods.laws import METHODS as LAW_METHODS
from lammps_cases.scene.atoms import seed
from lammps_cases.studies.benchmarks import measure
from lammps_cases.studies.benchmarks.measure import ConfidenceInterval
from lammps_cases.studies.chart.points import Crossing, MethodPoint, Panel, measured
from lammps_cases.studies.chart.prepared import STILL, prepared

STATES, QUICK_STATES = (1_000, 10_000, 100_000, 1_000_000), (1_000, 30_000, 300_000)
EDGES, QUICK_EDGES = (32, 100, 200), (32, 100)  # particles along an edge


def panels(quick: bool) -> Iterator[Panel]:
    """Time one law, and the whole model where the reference has threads."""
    yield _law_threads(quick)
    yield from _model_threads(quick)


def _law_calls(n: int) -> dict[str, Callable[[], FloatArray]]:
    law, random = EOS("tait/general", 1.0, 1.0, 1.4), np.random.default_rng(seed("threads"))
    rho_n = random.uniform(0.9, 1.1, n)
    methods = [m for m in LAW_METHODS if m.name in ("compiled", "compiled, 2 threads")]
    return {m.name: partial(m.prepare(law, 0.9, 1.1), rho_n, None) for m in methods}


def _law_threads(quick: bool) -> Panel:
    points: list[MethodPoint] = []
    sizes = QUICK_STATES if quick else STATES
    rounds = (6, 0.004) if quick else (measure.ROUNDS, 0.02)
    answers: dict[int, measure.Answer] = {}
    for n in sizes:
        calls = _law_calls(n)
        one, two = calls
        timings = measure.in_turns(calls, *rounds)
        true_n = calls[one]()
        errors = {name: float(np.max(np.abs(call() - true_n))) for name, call in calls.items()}
        points += measured("pressure", f"{n:,} states", errors, timings, n)
        answers[n] = measure.verdict(timings[one].against(timings[two]))
    quicker = [n for n in sizes if answers[n] == "faster"]
    slower = [n for n in sizes if answers[n] == "slower"]
    crossing = (_second_pays(max(quicker), min(slower), rounds),) if quicker and slower else ()
    return Panel(
        "threads-law",
        "A second thread: equation of state",
        "tait/general, both halves of the states at once; on a machine whose cores are free.",
        "largest difference from one thread",
        "state",
        tuple(points),
        crossings=crossing,
    )


def _second_pays(low: int, high: int, rounds: tuple[int, float]) -> Crossing:
    """Return the number of states from which two threads are faster."""
    while high > 1.2 * low:
        middle = round(math.sqrt(low * high))
        calls = _law_calls(middle)
        one, two = (timing for timing in measure.in_turns(calls, *rounds).values())
        answer = measure.verdict(one.against(two))
        if answer == "cannot tell":
            break
        low, high = (middle, high) if answer == "faster" else (low, middle)
    at = ConfidenceInterval(math.sqrt(low * high), low, high)
    return Crossing("pressure", ("compiled", "compiled, 2 threads"), "states", "less time", at)


def _model_threads(quick: bool) -> Iterator[Panel]:
    from eos_ref.compiled.evaluator import CompiledEvaluator

    if "threads" not in inspect.signature(CompiledEvaluator).parameters:
        return
    points: list[MethodPoint] = []
    for edge in QUICK_EDGES if quick else EDGES:
        moved: dict[str, Any] = {"rho": {"ratio": [0.99, 1.01]}, "velocity": {"random": 0.1}, "compare": ["rho", "x"]}
        old = prepared("RK1", 3.0, 0.1, edge, **moved).simulation(())
        make: Any = CompiledEvaluator
        sims = {
            f"{threads} thread{'s' * (threads > 1)}": Simulation(
                old.model, old.box, old.state, (), partial(make, threads=threads)
            )
            for threads in (1, 2)
        }
        calls = {name: partial(sim.run, 1, STILL) for name, sim in sims.items()}
        timings = measure.in_turns(calls, *((6, 0.004) if quick else (measure.ROUNDS, 0.02)))
        force_nc = [sim.evaluate()["f"] for sim in sims.values()]
        off = float(np.max(np.abs(force_nc[1] - force_nc[0])) / np.max(np.abs(force_nc[0])))
        errors = dict(zip(sims, (0.0, off), strict=True))
        points += measured("step", f"{edge**2:,} particles", errors, timings, edge**2)
    yield Panel(
        "threads-model",
        "A second thread: time step",
        "RK1, cutoff of 3 spacings, the whole model; on a machine whose cores are free.",
        "largest difference of the forces from one thread, relative to the largest force",
        "particle and step",
        tuple(points),
    )
