"""The Taylor-Green vortices of 10 000 particles on every code at hand: ours, LAMMPS on one and two ranks, others.

Codes that run as programs of their own cannot take turns step by step with ours; each of their runs is followed by
one of ours of about the same length, so that a drift of the machine meets both.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from timeit import timeit

from lammps_cases.engine.ranks import Ranks
from lammps_cases.engine.session import RunCommand
from lammps_cases.records.measure import Timing, interval
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan
from lammps_cases.studies.benchmarks import pysph as pysph_peer
from lammps_cases.studies.benchmarks.bench import Ratio, ratio
from lammps_cases.studies.flows.catalogue import FLOWS
from lammps_cases.studies.flows.flow import Options, Start
from lammps_cases.studies.flows.stepping import ReferenceFlow

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
    from eos_ref.compiled.evaluator import CompiledEvaluator

    start = FLOWS["taylor-green"].start(EDGE, Options(kernel="quintic"))
    with Ranks(None, 1) as one, Ranks(None, 2) as two:
        peers: dict[str, Callable[[], list[float]]] = {
            "LAMMPS": partial(_lammps, start, one),
            "LAMMPS, 2 ranks": partial(_lammps, start, two),
        }
        if pysph:
            peers["PySPH"] = partial(_pysph, pysph)
        for threads in (1, 2):
            flow = ReferenceFlow(start, partial(CompiledEvaluator, threads=threads))
            flow.advance(WARM)
            scene = f"Taylor-Green, {EDGE**2:,} particles" + (f", {threads} threads" if threads > 1 else "")
            for peer, steps in peers.items():
                yield _against(scene, peer, partial(flow.advance, STEPS), steps, repeats)


def _lammps(start: Start, ranks: Ranks) -> list[float]:
    """Return the seconds of one step of LAMMPS on a number of ranks, after a few steps to warm up."""
    lammps_job = job(start.case.scene, start.atoms, plan(start.case.scene))
    runs = (RunCommand(f"run {WARM} post no", read=False), RunCommand(f"run {STEPS} pre no post no"))
    answer = ranks.run(replace(lammps_job, runs=runs, ranks=ranks.count))
    return [answer.run_seconds[-1] / STEPS]


def _pysph(python: str) -> list[float]:
    """Return the seconds of every step of PySPH's example."""
    result = pysph_peer.answer(python, str(pysph_peer.SCRIPTS / "pysph_taylor_green.py"), str(EDGE), str(STEPS))
    assert result["particles"] == EDGE**2
    return [float(seconds) for seconds in result["seconds"]]


def _against(scene: str, peer: str, ours: Callable[[], None], theirs: Callable[[], list[float]], repeats: int) -> Ratio:
    own, other = [], []
    for _ in range(repeats):
        other.append(interval(tuple(theirs())).median)
        own.append(timeit(ours, number=1) / STEPS)
    return ratio(scene, peer, Timing(tuple(own), 1, own[0]), Timing(tuple(other), 1, other[0]), EDGE**2, EDGE**2)
