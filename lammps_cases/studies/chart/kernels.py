r"""Chart of kernels and cutoffs: gradients and densities of analytic fields on disordered particles, on both engines.

The field is :math:`v = (\sin kx\,\cos ky,\ \cos kx\,\sin ky)` of wavelength 16 spacings. Densities are those of an even
distribution, and of one that a diverging flow has deformed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from typing import Any, get_args

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.kernels.styles import KernelStyle
from lammps_cases.studies.benchmarks import measure
from lammps_cases.studies.chart.points import ONE_PER_CENT, Map, MethodPoint, Panel, measured
from lammps_cases.studies.chart.prepared import STILL, Instances, LatticeSetup, moving, prepared, still_step, worst
from lammps_cases.studies.flows.layout import relative

KERNELS: tuple[KernelStyle, ...] = get_args(KernelStyle)
REASONS = {
    "quintic": "no correction: cheapest, forces of a pair are opposite",
    "RK0": "documented as order 0; its gradients are the quintic's",
    "RK1": "gradients of linear fields are exact",
    "RK2": "gradients of quadratic fields are exact",
}
CUTS, QUICK_CUTS = (2.0, 2.5, 3.0, 3.5, 4.0), (2.0, 3.0, 4.0)
DISORDERS, QUICK_DISORDERS = (0.0, 0.1, 0.3), (0.1,)  # largest displacement along an axis, in spacings
EDGE, QUICK_EDGE = 64, 32  # particles along an edge
K = 2 * np.pi / 16
DEFORMED, STEPS = 0.25, 20  # spacings that the diverging flow moves a particle at most along an axis; in so many steps
COLD = 1e-6  # speed of sound of particles that fly freely: their pressure is below rounding
_EVALUATION = (
    "A reference time is one evaluation: pairs, kernel values, corrections and this field. A LAMMPS time is one time "
    "step with nothing else in the scene: LAMMPS evaluates forces and both velocity gradients in every step."
)


def field(x_nc: FloatArray) -> FloatArray:
    """Return the velocities (n, 2)."""
    x, y = K * x_nc[:, 0], K * x_nc[:, 1]
    return np.stack([np.sin(x) * np.cos(y), np.cos(x) * np.sin(y)], axis=1)


def gradient(x_nc: FloatArray) -> FloatArray:
    """Their gradients (n, 2, 2): component, axis."""
    x, y = K * x_nc[:, 0], K * x_nc[:, 1]
    straight_n, across_n = K * np.cos(x) * np.cos(y), -K * np.sin(x) * np.sin(y)
    return np.stack([straight_n, across_n, across_n, straight_n], axis=1).reshape(-1, 2, 2)


# --- measuring


@dataclass(frozen=True)
class TimedMethod:
    """One method: what it found, and a call whose time counts."""

    value_n: FloatArray
    call: Callable[[], object]
    reason: str


def _timed(runs: Mapping[str, TimedMethod], quick: bool) -> dict[str, measure.Timing]:
    calls = {name: run.call for name, run in runs.items()}
    return measure.in_turns(calls, *((6, 0.002) if quick else (measure.ROUNDS, 0.01)))


def _points(
    quantity: str, regime: str, runs: Mapping[str, TimedMethod], true_n: FloatArray, scale_n: FloatArray, quick: bool
) -> tuple[tuple[MethodPoint, ...], tuple[MethodPoint, ...]]:
    """Return the points whose errors are root mean squares, and the same with the worst errors."""
    timings = _timed(runs, quick)
    reasons = {name: run.reason for name, run in runs.items()}

    def points(norm: Callable[[FloatArray, FloatArray], float]) -> tuple[MethodPoint, ...]:
        errors = {name: norm(run.value_n - true_n, scale_n) for name, run in runs.items()}
        return measured(quantity, regime, errors, timings, len(true_n), reasons, ONE_PER_CENT)

    return points(relative), points(worst)


def _regime(disorder: float) -> str:
    return f"disorder of {disorder:g} spacings"


# --- gradients


def gradient_runs(
    cuts: Sequence[float], disorder: float, edge: int, lammps: Instances | None
) -> dict[str, TimedMethod]:
    """Evaluate every kernel and cutoff on the same particles; `TimedMethod.value_n` is the gradient (n, 2, 2)."""
    runs: dict[str, TimedMethod] = {}
    for kernel in KERNELS:
        for cut in cuts:
            setup = prepared(kernel, cut, disorder, edge)
            setup = moving(setup, field(setup.atoms.x_nc))
            sim = setup.simulation(("grad/v",))
            name = f"{kernel}, cutoff {cut:g}"
            runs[name] = TimedMethod(sim.output("grad/v"), sim.evaluate, REASONS[kernel])
            if lammps:
                lmp = lammps.one_more()
                value_n = setup.started(lmp).snapshots[0]["q.grad/v"]
                runs[f"LAMMPS {name}"] = TimedMethod(
                    value_n, still_step(lmp), f"{REASONS[kernel]}; time of a whole step"
                )
    return runs


def _gradients(quick: bool, lmp: Any | None) -> Iterator[Panel]:
    mean: list[MethodPoint] = []
    largest: list[MethodPoint] = []
    edge = QUICK_EDGE if quick else EDGE
    for disorder in QUICK_DISORDERS if quick else DISORDERS:
        with ExitStack() as stack:
            runs = gradient_runs(QUICK_CUTS if quick else CUTS, disorder, edge, Instances(lmp, stack))
            true_n = gradient(prepared("quintic", 3.0, disorder, edge).atoms.x_nc)
            both = _points("velocity gradient", _regime(disorder), runs, true_n, true_n, quick)
        mean += both[0]
        largest += both[1]
    about = f"{edge**2:,} particles of known density in 2D, field of wavelength 16 spacings. {_EVALUATION}"
    yield Panel(
        "kernels-gradient",
        "Kernels and cutoffs: gradients",
        about,
        "root mean square error of all components, relative to the root mean square of the gradient",
        "particle and evaluation",
        tuple(mean),
    )
    yield Panel(
        "kernels-gradient-worst",
        "Kernels and cutoffs: worst gradients",
        about,
        "largest error of a component, relative to the root mean square of the gradient",
        "particle and evaluation",
        tuple(largest),
    )


# --- densities


def _density_runs(cuts: Sequence[float], disorder: float, edge: int, lammps: Instances) -> dict[str, TimedMethod]:
    runs: dict[str, TimedMethod] = {}
    for cut in cuts:
        setup = prepared("quintic", cut, disorder, edge, rho_sum=True)
        sim = setup.simulation(("rho",))
        runs[f"summation, cutoff {cut:g}"] = TimedMethod(
            sim.output("rho"), sim.evaluate, "more neighbours average more"
        )
        if lammps:
            lmp = lammps.one_more()
            value_n = setup.started(lmp).snapshots[0]["rho"]
            runs[f"LAMMPS summation, cutoff {cut:g}"] = TimedMethod(
                value_n, still_step(lmp), "the same; time of a whole step"
            )
    return runs


def _densities(quick: bool, lmp: Any | None) -> Panel:
    points: list[MethodPoint] = []
    edge = QUICK_EDGE if quick else EDGE
    for disorder in QUICK_DISORDERS if quick else DISORDERS:
        with ExitStack() as stack:
            runs = _density_runs(QUICK_CUTS if quick else CUTS, disorder, edge, Instances(lmp, stack))
            even_n = np.ones(edge**2)
            points += _points("summed density", _regime(disorder), runs, even_n, even_n, quick)[0]
    return Panel(
        "kernels-density",
        "Cutoffs: density by summation",
        f"{edge**2:,} particles in 2D, one per unit area. Sums take the plain quintic whatever the kernel. "
        + _EVALUATION,
        "root mean square error, relative to the mean density",
        "particle and evaluation",
        tuple(points),
    )


def deformed(kernel: KernelStyle, cut: float, disorder: float, edge: int, rho_sum: bool) -> LatticeSetup:
    """Return particles that fly freely, each with the diverging velocity (sin kx, sin ky) of where it was at first."""
    evolve = {"steps": STEPS, "timestep": 1.0 / STEPS, "compare_at": [STEPS]}
    cold = [{"mass": 1.0, "rho0": 1.0, "cs": COLD, "viscosity": 0.0}]
    setup = prepared(kernel, cut, disorder, edge, rho_sum, types=cold, evolve=evolve, compare=["rho", "x"])
    return moving(setup, DEFORMED * np.sin(K * setup.atoms.x_nc[:, :2]))


def exact_density(setup: LatticeSetup) -> FloatArray:
    """Inverse of the determinant of the deformation at time 1, for each particle."""
    return np.asarray(1 / np.prod(1 + DEFORMED * K * np.cos(K * setup.atoms.x_nc[:, :2]), axis=1))


def _deformed_runs(
    cuts: Sequence[float], disorder: float, edge: int, lammps: Instances
) -> tuple[dict[str, TimedMethod], FloatArray]:
    runs: dict[str, TimedMethod] = {}
    setup = deformed("quintic", 3.0, disorder, edge, rho_sum=False)
    for cut in cuts:
        ways: list[tuple[str, KernelStyle, bool]] = [("summation", "quintic", True)]
        ways += [(f"continuity, {k}", k, False) for k in KERNELS if k != "RK0"]
        for way, kernel, rho_sum in ways:
            setup = deformed(kernel, cut, disorder, edge, rho_sum)
            reason = "no history, mass is conserved" if rho_sum else f"no noise of the particles; {REASONS[kernel]}"
            sim = setup.simulation(())
            sim.run(STEPS, 1.0 / STEPS)
            name = f"{way}, cutoff {cut:g}"
            # The density itself, before steps that change nothing.
            runs[name] = TimedMethod(sim.output("rho").copy(), partial(sim.run, 1, STILL), reason)
            if lammps:
                lmp = lammps.one_more()
                runs[f"LAMMPS {name}"] = TimedMethod(setup.started(lmp).arrays["rho"], still_step(lmp), reason)
    return runs, exact_density(setup)


def _deformation(quick: bool, lmp: Any | None) -> Panel:
    points: list[MethodPoint] = []
    edge = QUICK_EDGE if quick else EDGE
    for disorder in QUICK_DISORDERS if quick else DISORDERS:
        with ExitStack() as stack:
            cuts = (3.0,) if quick else (2.0, 3.0, 4.0)
            runs, true_n = _deformed_runs(cuts, disorder, edge, Instances(lmp, stack))
            points += _points("deformed density", _regime(disorder), runs, true_n, true_n - 1, quick)[0]
    return Panel(
        "kernels-deformation",
        "Density of a deformed fluid: summation against continuity",
        f"{edge**2:,} particles fly freely for {STEPS} steps with a diverging velocity of wavelength 16 spacings, "
        f"which moves each by up to {DEFORMED:g} spacings along either axis. Both times are of a whole time step.",
        "root mean square error, relative to the root mean square of the change of density",
        "particle and step",
        tuple(points),
    )


def panels(quick: bool, lmp: Any | None) -> Iterator[Panel]:
    """Yield gradients, summed densities, and densities of a deformed fluid; with ``lmp`` LAMMPS' too.

    More instances of LAMMPS are opened, one per method of a regime, and closed again.
    """
    yield from _gradients(quick, lmp)
    yield _densities(quick, lmp)
    yield _deformation(quick, lmp)


def maps(quick: bool) -> Iterator[Map]:
    """Yield the error of the gradient over cutoff and disorder, one map per kernel; of the reference."""
    cuts = np.arange(2.0, 4.01, 0.5 if quick else 0.125)
    disorders = np.arange(0.0, 0.31, 0.15 if quick else 0.05)
    for kernel in KERNELS:
        rows = []
        for disorder in disorders:
            row = []
            for cut in cuts:
                setup = prepared(kernel, float(cut), float(disorder), QUICK_EDGE)
                true_n = gradient(setup.atoms.x_nc)
                sim = moving(setup, field(setup.atoms.x_nc)).simulation(("grad/v",))
                row.append(relative(sim.output("grad/v") - true_n, true_n))
            rows.append(tuple(row))
        yield Map(
            f"kernels-{kernel.lower()}",
            f"Error of the velocity gradient, {kernel}",
            "cutoff (spacings)",
            "disorder (spacings)",
            tuple(cuts.tolist()),
            tuple(disorders.tolist()),
            tuple(rows),
            "relative root mean square error",
        )
