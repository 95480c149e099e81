"""Flows with closed solutions: their convergence, and what kernel and cutoff buy in them.

The reference and LAMMPS run the same start in turns. Convergence takes each flow's own options; the panels hold the
resolution and change kernel and cutoff.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import get_args

from eos_ref.kernels.styles import KERNELS, KernelStyle
from lammps_cases.engine import cluster
from lammps_cases.engine.session import Session
from lammps_cases.records.measure import ROUNDS, Timing
from lammps_cases.studies.chart.record import LAMMPS, ONE_PER_CENT, Panel, measured
from lammps_cases.studies.flows.catalogue import FLOWS
from lammps_cases.studies.flows.converge import Convergence, FlowResult, by_lammps, by_reference, converge
from lammps_cases.studies.flows.flow import Flow, Options

# RK0 has the gradients of the quintic spline.
STYLES: tuple[KernelStyle, ...] = tuple(style for style in get_args(KernelStyle) if KERNELS[style].order != 0)
CUTS = (2.5, 3.0, 4.0)
RESOLUTION = 32
SHOWN = ("taylor-green", "sound-wave-tait-water")


def flows(quick: bool, site: str | None = None) -> Iterator[Convergence]:
    """Solve every flow at its resolutions, on the reference and on a LAMMPS, both timed on this machine."""
    for flow in FLOWS.values():
        chosen = (flow.quick or flow.resolutions)[:3] if quick else flow.resolutions
        with cluster.used(""):
            yield from converge(flow, resolutions=chosen, site=site)


def panels(quick: bool, session: Session) -> Iterator[Panel]:
    """Yield the error of the headline against time per particle and step, for kernels and cutoffs."""
    for name in SHOWN[:1] if quick else SHOWN:
        yield _panel(FLOWS[name], STYLES[:2] if quick else STYLES, CUTS[1:2] if quick else CUTS, quick, session)


def _panel(
    flow: Flow, kernels: tuple[KernelStyle, ...], cuts: tuple[float, ...], quick: bool, session: Session
) -> Panel:
    n = 16 if quick else RESOLUTION
    regime, rounds = f"{n} particles per wavelength", 3 if quick else ROUNDS
    options = {
        f"{kernel}, cut {cut:g}": replace(flow.options, kernel=kernel, cut=cut) for kernel in kernels for cut in cuts
    }
    runs: dict[str, tuple[Options, Callable[[], FlowResult]]] = {}
    for name, chosen in options.items():
        start = flow.start(n, chosen)
        runs[name] = chosen, partial(by_reference, start)
        runs[f"{LAMMPS} {name}"] = chosen, partial(by_lammps, start, session)
    results: dict[str, list[FlowResult]] = {name: [] for name in runs}
    for _ in range(rounds):
        for name, (_, run) in runs.items():
            results[name].append(run())
    timings, errors = {}, {}
    for name, (chosen, _) in runs.items():
        last = results[name][-1]
        if last.message:
            continue
        headline, errors[name] = next(iter(flow.measures(n, chosen, last.snapshots).items()))
        timings[name] = Timing(tuple(result.seconds / (last.n * last.steps) for result in results[name]), 1, 0.0)
    reasons = dict.fromkeys(errors, "the kernel and its cutoff in spacings")
    return Panel(
        id=f"flow-{flow.name}-options",
        title=f"{flow.name}: kernel and cutoff",
        about=f"{flow.about} {last.n:,} particles, {rounds} runs of each.",
        error_of=f"{headline}, relative to the closed solution",
        unit="particle and step",
        points=measured(flow.name, regime, errors, timings, 1.0, reasons, ONE_PER_CENT),
    )
