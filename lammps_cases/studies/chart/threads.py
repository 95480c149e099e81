"""Chart of threads: when a second one pays."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from eos_ref import EOS
from eos_ref.eos.table import FloatArray
from eos_ref.methods.laws import METHODS as LAW_METHODS
from lammps_cases.records import measure
from lammps_cases.scene.atoms import seed
from lammps_cases.studies.chart.points import Crossing, MethodPoint, Panel, bisected, measured
from lammps_cases.studies.chart.prepared import STILL, prepared

STATES, QUICK_STATES = (1_000, 10_000, 100_000, 1_000_000), (1_000, 30_000, 300_000)
EDGES, QUICK_EDGES = (32, 100, 200), (32, 100)  # particles along an edge
ONE, TWO = "compiled", "compiled, 2 threads"
REASONS = {m.name: m.reason for m in LAW_METHODS if m.name in (ONE, TWO)}


def panels(quick: bool) -> Iterator[Panel]:
    """Yield the panel of one law, and that of the whole model."""
    yield _law_threads(quick)
    yield _model_threads(quick)


def _law_calls(n: int) -> dict[str, Callable[[], FloatArray]]:
    law, random = EOS("tait/general", 1.0, 1.0, 1.4), np.random.default_rng(seed("threads"))
    rho_n = random.uniform(0.9, 1.1, n)
    return {m.name: partial(m.prepare(law, 0.9, 1.1), rho_n, None) for m in LAW_METHODS if m.name in (ONE, TWO)}


def _law_threads(quick: bool) -> Panel:
    points: list[MethodPoint] = []
    sizes = QUICK_STATES if quick else STATES

    def one_is_faster(timings: dict[str, measure.Timing]) -> bool | None:
        answer = measure.verdict(timings[ONE].against(timings[TWO]))
        return None if answer == "cannot tell" else answer == "faster"

    answers: dict[int, bool | None] = {}
    for n in sizes:
        calls = _law_calls(n)
        timings = measure.in_turns(calls, *measure.effort(quick))
        true_n = calls[ONE]()
        errors = {name: float(np.max(np.abs(call() - true_n))) for name, call in calls.items()}
        points += measured("pressure", f"{n:,} states", errors, timings, n, REASONS)
        answers[n] = one_is_faster(timings)
    faster, slower = ([n for n in sizes if answers[n] is answer] for answer in (True, False))
    crossings: tuple[Crossing, ...] = ()
    if faster and slower:
        at = bisected(
            lambda n: one_is_faster(measure.in_turns(_law_calls(int(n)), *measure.effort(quick))),
            max(faster),
            min(slower),
            ratio=1.2,
            whole=True,
        )
        crossings = (Crossing("pressure", (ONE, TWO), "states", "less time", at),)
    return Panel(
        "threads-law",
        "A second thread: equation of state",
        "tait/general, both halves of the states at once; on a machine whose cores are free.",
        "largest difference from one thread",
        "state",
        tuple(points),
        crossings=crossings,
    )


def _model_threads(quick: bool) -> Panel:
    points: list[MethodPoint] = []
    for edge in QUICK_EDGES if quick else EDGES:
        moved: dict[str, Any] = {"rho": {"ratio": [0.99, 1.01]}, "velocity": {"random": 0.1}, "compare": ["rho", "x"]}
        setup = prepared("RK1", 3.0, 0.1, edge, **moved)
        sims = {name: setup.simulation((), threads) for threads, name in ((1, "1 thread"), (2, "2 threads"))}
        force_nc = [sim.evaluate()["f"] for sim in sims.values()]  # before they are timed, in steps of other numbers
        calls = {name: partial(sim.run, 1, STILL) for name, sim in sims.items()}
        timings = measure.in_turns(calls, *measure.effort(quick))
        off = float(np.max(np.abs(force_nc[1] - force_nc[0])) / np.max(np.abs(force_nc[0])))
        errors = dict(zip(sims, (0.0, off), strict=True))
        reasons = dict.fromkeys(sims, "the compiled evaluator on as many cores")
        points += measured("step", f"{edge**2:,} particles", errors, timings, edge**2, reasons)
    return Panel(
        "threads-model",
        "A second thread: time step",
        "RK1, cutoff of 3 spacings, the whole model; on a machine whose cores are free.",
        "largest difference of the forces from one thread, relative to the largest force",
        "particle and step",
        tuple(points),
    )
