"""Flows with closed solutions: their convergence, and what kernel and cutoff buy in them.

The reference and LAMMPS run the same start in turns. Convergence takes each flow's own options; the panels hold the
resolution and change kernel and cutoff.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, get_args

from eos_ref.kernels.styles import KERNELS, KernelStyle
from lammps_cases.studies.benchmarks.measure import ROUNDS, Timing
from lammps_cases.studies.chart.points import LAMMPS, ONE_PER_CENT, Panel, compared, point
from lammps_cases.studies.flows import FLOWS
from lammps_cases.studies.flows.converge import Convergence, Result, by_lammps, by_reference, converge
from lammps_cases.studies.flows.flow import Flow, Options, Start

# RK0 has the gradients of the quintic spline.
STYLES: tuple[KernelStyle, ...] = tuple(style for style in get_args(KernelStyle) if KERNELS[style].order != 0)
CUTS = (2.5, 3.0, 4.0)
RESOLUTION = 32
SHOWN = ("taylor-green", "sound-wave-tait-water")


def flows(quick: bool) -> Iterator[Convergence]:
    """Every flow at its resolutions, on the reference and on LAMMPS."""
    for flow in FLOWS.values():
        chosen = (flow.quick or flow.resolutions)[:3] if quick else flow.resolutions
        yield from converge(flow, resolutions=chosen)


def panels(quick: bool, lmp: Any) -> Iterator[Panel]:
    """Error of the headline against time per particle and step, for kernels and cutoffs."""
    for name in SHOWN[:1] if quick else SHOWN:
        yield _panel(FLOWS[name], STYLES[:2] if quick else STYLES, CUTS[1:2] if quick else CUTS, quick, lmp)


def _panel(flow: Flow, kernels: tuple[KernelStyle, ...], cuts: tuple[float, ...], quick: bool, lmp: Any) -> Panel:
    n = 16 if quick else RESOLUTION
    regime, rounds = f"{n} particles per wavelength", 3 if quick else ROUNDS
    options = {
        f"{kernel}, cut {cut:g}": replace(flow.options, kernel=kernel, cut=cut) for kernel in kernels for cut in cuts
    }
    runs: dict[str, tuple[Options, Callable[[], Result]]] = {}
    for name, chosen in options.items():
        start = flow.start(n, chosen)
        runs[name] = chosen, _ours(start)
        runs[f"{LAMMPS} {name}"] = chosen, _theirs(start, lmp)
    results: dict[str, list[Result]] = {name: [] for name in runs}
    for _ in range(rounds):
        for name, (_, run) in runs.items():
            results[name].append(run())
    timings, points = {}, []
    for name, (chosen, _) in runs.items():
        found = results[name]
        last = found[-1]
        if last.message:
            continue
        measured = flow.measures(n, chosen, last.snapshots)
        per = last.n * last.steps
        timings[name] = Timing(tuple(result.seconds / per for result in found), 1, 0.0)
        error = next(iter(measured.values()))
        points.append(point(flow.name, regime, name, error, timings[name], 1.0, "kernel and cutoff in spacings"))
    return Panel(
        id=f"flow-{flow.name}-options",
        title=f"{flow.name}: kernel and cutoff",
        about=f"{flow.about} {last.n:,} particles, {rounds} runs of each.",
        error_of=f"{next(iter(measured))}, relative to the closed solution",
        unit="particle and step",
        points=compared(points, timings, ONE_PER_CENT),
    )


def _ours(start: Start) -> Callable[[], Result]:
    return lambda: by_reference(start)


def _theirs(start: Start, lmp: Any) -> Callable[[], Result]:
    return lambda: by_lammps(start, lmp)
