"""What kernel, cutoff and time step gain in flows with closed solutions, at one resolution.

The reference and LAMMPS run the same start in turns. Orders of convergence are those of `eos-ref validate solutions`;
where a longer step fails, `lammps_cases.studies.stability` maps.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

from eos_ref.eos.table import FloatArray
from eos_ref.kernels.styles import KERNELS, KernelStyle
from lammps_cases.engine.session import Session
from lammps_cases.records import measure
from lammps_cases.records.measure import ROUNDS, Timing
from lammps_cases.studies.chart.kernels import opened
from lammps_cases.studies.chart.record import LAMMPS, ONE_PER_CENT, MethodPanel, measured
from lammps_cases.studies.flows.catalogue import FLOWS
from lammps_cases.studies.flows.flow import Options, Snapshot, Start, relative
from lammps_cases.studies.flows.known import Flow
from lammps_cases.studies.flows.solve import (
    Fit,
    FlowResult,
    FlowRun,
    LammpsFlow,
    ReferenceFlow,
    by_lammps,
    by_reference,
    fit,
)

# RK0 has the gradients of the quintic spline.
STYLES = tuple(style for style, corrected in KERNELS.items() if corrected.order != 0)
CUTS = (2.5, 3.0, 4.0)
KERNEL_RESOLUTION = 32
SHOWN = ("taylor-green", "sound-wave-tait-water")


def kernel_panels(quick: bool, session: Session) -> Iterator[MethodPanel]:
    """Yield the error of the headline against time per particle and step, for kernels and cutoffs."""
    for name in SHOWN[:1] if quick else SHOWN:
        yield _panel(FLOWS[name], STYLES[:2] if quick else STYLES, CUTS[1:2] if quick else CUTS, quick, session)


def _panel(
    flow: Flow, kernels: tuple[KernelStyle, ...], cuts: tuple[float, ...], quick: bool, session: Session
) -> MethodPanel:
    n = 16 if quick else KERNEL_RESOLUTION
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
    return MethodPanel(
        id=f"flow-{flow.name}-options",
        title=f"{flow.name}: kernel and cutoff",
        about=f"{flow.about} {last.n:,} particles, {rounds} runs of each.",
        error_of=f"{headline}, relative to the closed solution",
        unit="particle and step",
        points=measured(flow.name, regime, errors, timings, 1.0, reasons, ONE_PER_CENT),
    )


FRACTIONS = (1.0, 1 / 2, 1 / 4, 1 / 8)  # of the flow's limit
RESOLUTION, QUICK_RESOLUTION = 24, 16  # spacings per wavelength
FINE = 1 / 32  # of the run that represents no error of the step
TIMED = 10  # steps of a call that is timed


@dataclass(frozen=True)
class Wave:
    """A flow with varied step, and the compared field: velocity, or density less its mean."""

    flow: Flow
    field: Callable[[Snapshot], FloatArray]


def _density(shot: Snapshot) -> FloatArray:
    return shot.rho_n - float(shot.rho_n.mean())


def _velocity(shot: Snapshot) -> FloatArray:
    return shot.v_nc


def waves() -> tuple[Wave, ...]:
    """Return a flow whose time step is limited by viscosity, and one limited by sound and viscosity."""
    return Wave(FLOWS["shear-wave"], _velocity), Wave(FLOWS["sound-wave-linear"], _density)


def stepping(start: Start, session: Session | None) -> FlowRun:
    """Return a flow set up on the reference, or on LAMMPS."""
    return ReferenceFlow(start) if session is None else LammpsFlow(start, session)


def shots(run: FlowRun, steps: Sequence[int]) -> list[Snapshot]:
    """Return the snapshots of a flow after some numbers of steps, in increasing order."""
    snapshots = []
    for step in steps:
        run.advance(step - run.step)
        snapshots.append(run.snapshot())
    return snapshots


def started(flow: Flow, n: int, fraction: float) -> Start:
    """Return the start of a flow with a time step that is a fraction of the flow's limit."""
    return flow.start(n, replace(flow.options, dt_fraction=fraction))


# --- error against time


@dataclass(frozen=True)
class Solved:
    """A flow solved with one time step: its field, errors against a short step and the closed solution, a call."""

    field_n: FloatArray
    temporal: float
    total: float
    start: Start
    call: Callable[[], object]


def solve(
    wave: Wave, n: int, fractions: Sequence[float], fine: float, sessions: Sequence[Session | None]
) -> list[Solved]:
    """Solve a flow with several time steps, each in a session of LAMMPS, the last for the ``fine`` one, or None."""
    flow = wave.flow
    finest = started(flow, n, fine)
    limit = wave.field(shots(stepping(finest, sessions[-1]), finest.steps)[-1])
    solutions = []
    for fraction, session in zip(fractions, sessions, strict=False):
        start = started(flow, n, fraction)
        run = stepping(start, session)
        read = shots(run, start.steps)
        field_n = wave.field(read[-1])
        total = flow.measures(n, replace(flow.options, dt_fraction=fraction), read)["profile"]
        solutions.append(Solved(field_n, relative(field_n - limit, limit), total, start, partial(run.advance, TIMED)))
    return solutions


def order(solved: Sequence[Solved]) -> Fit:
    """Return the order of the temporal error in the step, from the differences between successive steps."""
    changes = [relative(one.field_n - other.field_n, other.field_n) for one, other in pairwise(solved)]
    return fit([s.start.steps[-1] for s in solved[:-1]], changes)


def _wave_panels(wave: Wave, quick: bool, session: Session | None) -> Iterator[MethodPanel]:
    n, flow = QUICK_RESOLUTION if quick else RESOLUTION, wave.flow
    with ExitStack() as stack:
        solved = {"": solve(wave, n, FRACTIONS, FINE, [None] * (len(FRACTIONS) + 1))}
        if session is not None:
            sessions = [opened(session, stack) for _ in range(len(FRACTIONS) + 1)]
            solved["LAMMPS "] = solve(wave, n, FRACTIONS, FINE, sessions)
        of_name = {
            f"{prefix}step 1/{round(1 / f)}": s
            for prefix, all_steps in solved.items()
            for f, s in zip(FRACTIONS, all_steps, strict=True)
        }
        took = measure.in_turns({name: s.call for name, s in of_name.items()}, *measure.effort(quick))
    timings = {name: took[name].scaled(s.start.steps[-1] / TIMED) for name, s in of_name.items()}
    any_start = solved[""][0].start
    per = len(any_start.atoms) * any_start.steps[-1] * any_start.timestep
    orders = "; ".join(
        f"{prefix or 'reference '}{fitted.order:.2f} ± {fitted.standard_error:.2f}"
        for prefix, fitted in ((prefix, order(s)) for prefix, s in solved.items())
    )
    for kind, what, error in (
        ("", "closed solution", "total"),
        ("-temporal", "same run with a short step", "temporal"),
    ):
        errors = {name: getattr(s, error) for name, s in of_name.items()}
        against = "" if error == "total" else f" Order of the temporal error in the step: {orders}."
        reasons = {name: f"a time step of {name.split()[-1]} min(h/4c, h^2/8nu)" for name in of_name}
        regime = f"{n} spacings per wavelength"
        yield MethodPanel(
            f"timestep-{flow.name}{kind}",
            f"Time step of the {flow.name.replace('-', ' ')}, against the {what}",
            f"Steps in units of min(h/4c, h^2/8nu). {len(any_start.atoms)} particles; time is in units of spacing over "
            f"speed of sound.{against}",
            f"root mean square of the error over that of the wave, at the end, against the {what}"
            + (f" (1/{round(1 / FINE)})" if error == "temporal" else ""),
            "particle and unit of time",
            measured(f"{flow.name}, {what}", regime, errors, timings, per, reasons, ONE_PER_CENT),
        )


def step_panels(quick: bool, session: Session | None) -> Iterator[MethodPanel]:
    """Yield time steps of two waves, each against the closed solution and a short step."""
    for wave in waves()[: 1 if quick else None]:
        yield from _wave_panels(wave, quick, session)
