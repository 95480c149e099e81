r"""Chart of kernels and cutoffs: gradients and densities of analytic fields on disordered particles, on both engines.

The particles are a periodic, disordered lattice in 2D, in the reference and in LAMMPS. The field is
:math:`v = (\sin kx\,\cos ky,\ \cos kx\,\sin ky)` of wavelength 16 spacings. Densities are those of an even
distribution, and of one that a diverging flow has deformed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from eos_ref.compiled.evaluator import CompiledEvaluator
from eos_ref.eos.table import FloatArray
from eos_ref.evaluation.time_step import Simulation
from eos_ref.kernels.styles import KERNELS, KernelStyle
from lammps_cases.engine.session import Answer, Session
from lammps_cases.records import measure
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import Atoms, build
from lammps_cases.scene.casefile import Case
from lammps_cases.setup import reference_side
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan
from lammps_cases.studies.chart.record import ONE_PER_CENT, Map, MethodPanel, MethodPoint, measured
from lammps_cases.studies.flows.flow import relative

STILL = 1e-12  # time step in which particles hardly move


@dataclass(frozen=True)
class LatticeSetup:
    """Particles of one kernel and cutoff, for either engine."""

    case: Case
    atoms: Atoms

    def simulation(self, fields: Sequence[str]) -> Simulation:
        """Return the compiled reference, evaluated once."""
        scene, where = self.case.scene, self.case.where
        sim = reference_side.simulation(scene, self.atoms, fields, where, evaluator=CompiledEvaluator)
        sim.evaluate()
        return sim

    def started(self, session: Session) -> Answer:
        """Run the scene in LAMMPS, which stays open with it, and return its answer."""
        scene = self.case.scene
        return session.run(job(scene, self.atoms, plan(scene)))


def prepared(
    kernel: KernelStyle, cut: float, disorder: float, edge: int, rho_sum: bool = False, **more: Any
) -> LatticeSetup:
    """Return unit masses on a disordered square lattice of unit spacing, at rest; ``more`` are keys of a scene."""
    data = {
        "dimension": 2,
        "types": [{"mass": 1.0, "rho0": 1.0, "cs": 1.0, "viscosity": 0.0}],
        "positions": {"lattice": "sq", "spacing": 1.0, "cells": [edge, edge], "disorder": disorder},
        "pressure": [{"types": "*", "style": "linear"}],
        "rheo": {"kernel": kernel, "cut": cut, "rho_sum": rho_sum},
        "rho": None if rho_sum else {"constant": 1.0},
        "velocity": {"uniform": [0.0, 0.0]},
        "evolve": {"steps": 1, "timestep": STILL, "compare_at": [0, 1]},
        "compare": ["rho"] if rho_sum else ["grad/v"],
        **more,
    }
    # The same name gives the same particles for every kernel and cutoff.
    case = Case("chart-kernels", "", (), Scene.model_validate(data), Path("chart"))
    return LatticeSetup(case, build(case, case.scene.eos()))


def moving(setup: LatticeSetup, v_nc: FloatArray) -> LatticeSetup:
    """Return the same particles with velocities (n, 2)."""
    return replace(setup, atoms=replace(setup.atoms, v_nc=np.hstack([v_nc, np.zeros((len(v_nc), 1))])))


def worst(error_n: FloatArray, scale_n: FloatArray) -> float:
    """Return the largest error over the root mean square of its scale."""
    return float(np.max(np.abs(error_n)) / np.sqrt(np.mean(np.square(scale_n))))


def still_step(session: Session) -> Callable[[], object]:
    """Return a call that takes a step of LAMMPS in which nothing moves."""
    session.open().command(f"timestep {STILL!r}")
    return partial(session.advance, 1)


def opened(session: Session | None, stack: ExitStack) -> Session | None:
    """Open a further LAMMPS, closed with the stack, so that all methods can be timed in turns; None without LAMMPS."""
    return session and stack.enter_context(closing(Session(session.site)))


CUTS, QUICK_CUTS = (2.0, 2.5, 3.0, 3.5, 4.0), (2.0, 3.0, 4.0)
DISORDERS, QUICK_DISORDERS = (0.0, 0.1, 0.3), (0.1,)  # largest displacement along an axis, in spacings
EDGE, QUICK_EDGE = 64, 32  # particles along an edge
K = 2 * np.pi / 16
DEFORMED, STEPS = 0.25, 20  # largest displacement by the diverging flow along an axis (spacings), and its steps
COLD = 1e-6  # speed of sound of freely flying particles: their pressure is below rounding
_EVALUATION = (
    "A reference time is one evaluation: pairs, kernel values, corrections and this field. A LAMMPS time is one time "
    "step with nothing else in the scene: LAMMPS evaluates forces and both velocity gradients in every step."
)


def field(x_nc: FloatArray) -> FloatArray:
    """Return the velocities (n, 2)."""
    x, y = K * x_nc[:, 0], K * x_nc[:, 1]
    return np.stack([np.sin(x) * np.cos(y), np.cos(x) * np.sin(y)], axis=1)


def gradient(x_nc: FloatArray) -> FloatArray:
    """Return the gradients of `field`, (n, 2, 2): component, axis."""
    x, y = K * x_nc[:, 0], K * x_nc[:, 1]
    straight_n, across_n = K * np.cos(x) * np.cos(y), -K * np.sin(x) * np.sin(y)
    return np.stack([straight_n, across_n, across_n, straight_n], axis=1).reshape(-1, 2, 2)


# --- methods


@dataclass(frozen=True)
class Method:
    """A kernel and cutoff on some particles, and the arguments for it, of the reference and of LAMMPS.

    The field is read at once if ``steps`` is 0, else after that many steps, in which a unit of time passes.
    """

    name: str
    setup: LatticeSetup
    field: str
    reason: str
    lammps_reason: str
    steps: int = 0


@dataclass(frozen=True)
class TimedMethod:
    """The field that a method computes (n, ...), and a call to be timed."""

    value_n: FloatArray
    call: Callable[[], object]
    reason: str


def run(methods: Iterable[Method], session: Session | None, stack: ExitStack) -> dict[str, TimedMethod]:
    """Run methods on the reference, and each on a separate instance of LAMMPS."""
    runs: dict[str, TimedMethod] = {}
    for m in methods:
        sim = m.setup.simulation(() if m.steps else (m.field,))
        call: Callable[[], object] = sim.evaluate
        if m.steps:
            sim.run(m.steps, 1.0 / m.steps)
            call = partial(sim.run, 1, STILL)
        runs[m.name] = TimedMethod(sim.output(m.field).copy(), call, m.reason)
        if (living := opened(session, stack)) is not None:
            first = m.setup.started(living).snapshots[0]
            value_n = first["q.grad/v" if m.field == "grad/v" else m.field]
            runs[f"LAMMPS {m.name}"] = TimedMethod(value_n, still_step(living), m.lammps_reason)
    return runs


def gradients(cuts: Sequence[float], disorder: float, edge: int) -> Iterator[Method]:
    """Yield every kernel and cutoff on the same particles, moving with `field`."""
    for kernel, corrected in KERNELS.items():
        for cut in cuts:
            setup, reason = prepared(kernel, cut, disorder, edge), corrected.about
            setup = moving(setup, field(setup.atoms.x_nc))
            yield Method(f"{kernel}, cutoff {cut:g}", setup, "grad/v", reason, f"{reason}; time of a whole step")


def _summed(cuts: Sequence[float], disorder: float, edge: int) -> Iterator[Method]:
    for cut in cuts:
        setup = prepared("quintic", cut, disorder, edge, rho_sum=True)
        reason = "densities summed over neighbours: more of them average more"
        yield Method(f"summation, cutoff {cut:g}", setup, "rho", reason, f"{reason}; time of a whole step")


def _deformed_methods(cuts: Sequence[float], disorder: float, edge: int) -> Iterator[Method]:
    ways: list[tuple[str, KernelStyle, str]] = [
        ("summation", "quintic", "densities summed over neighbours: no history, mass is conserved")
    ]
    ways += [
        (f"continuity, {k}", k, f"densities by the continuity equation: no noise of the particles; {corrected.about}")
        for k, corrected in KERNELS.items()
        if corrected.order != 0
    ]
    for cut in cuts:
        for way, kernel, reason in ways:
            setup = deformed(kernel, cut, disorder, edge, way == "summation")
            yield Method(f"{way}, cutoff {cut:g}", setup, "rho", reason, reason, STEPS)


def deformed(kernel: KernelStyle, cut: float, disorder: float, edge: int, rho_sum: bool) -> LatticeSetup:
    """Return freely flying particles, each with the diverging velocity (sin kx, sin ky) of its initial position."""
    evolve = {"steps": STEPS, "timestep": 1.0 / STEPS, "compare_at": [STEPS]}
    cold = [{"mass": 1.0, "rho0": 1.0, "cs": COLD, "viscosity": 0.0}]
    setup = prepared(kernel, cut, disorder, edge, rho_sum, types=cold, evolve=evolve, compare=["rho", "x"])
    return moving(setup, DEFORMED * np.sin(K * setup.atoms.x_nc[:, :2]))


def exact_density(x_nc: FloatArray) -> FloatArray:
    """Return the density (n,) at time 1 of particles that began at x: the inverse determinant of the deformation."""
    return np.asarray(1 / np.prod(1 + DEFORMED * K * np.cos(K * x_nc[:, :2]), axis=1))


# --- panels


Methods = Callable[[Sequence[float], float, int], Iterator[Method]]


def _points(
    quantity: str,
    methods: Methods,
    cuts: Sequence[float],
    exact: Callable[[FloatArray], tuple[FloatArray, FloatArray]],
    quick: bool,
    session: Session | None,
) -> tuple[tuple[MethodPoint, ...], tuple[MethodPoint, ...]]:
    """Return the points with root mean squares as errors, and the same with the worst errors.

    ``exact`` gives for positions (n, 3) the exact values, and the scale that errors are relative to.
    """
    edge = QUICK_EDGE if quick else EDGE
    points: dict[Callable[[FloatArray, FloatArray], float], tuple[MethodPoint, ...]] = {relative: (), worst: ()}
    for disorder in QUICK_DISORDERS if quick else DISORDERS:
        exact_n, scale_n = exact(prepared("quintic", 3.0, disorder, edge).atoms.x_nc)
        with ExitStack() as stack:
            runs = run(methods(cuts, disorder, edge), session, stack)
            timings = measure.in_turns({name: r.call for name, r in runs.items()}, *measure.effort(quick))
        regime, reasons = f"disorder of {disorder:g} spacings", {name: r.reason for name, r in runs.items()}
        for norm in points:
            errors = {name: norm(r.value_n - exact_n, scale_n) for name, r in runs.items()}
            points[norm] += measured(quantity, regime, errors, timings, edge**2, reasons, ONE_PER_CENT)
    return points[relative], points[worst]


def panels(quick: bool, session: Session | None) -> Iterator[MethodPanel]:
    """Yield gradients, summed densities, and densities of a deformed fluid; with ``session`` also those of LAMMPS.

    More instances of LAMMPS are opened, one per method of a regime, and closed again.
    """
    cuts, particles = QUICK_CUTS if quick else CUTS, f"{(QUICK_EDGE if quick else EDGE) ** 2:,} particles"
    about = f"{particles} of known density in 2D, field of wavelength 16 spacings. {_EVALUATION}"
    mean, largest = _points("velocity gradient", gradients, cuts, lambda x_nc: (gradient(x_nc),) * 2, quick, session)
    yield MethodPanel(
        "kernels-gradient",
        "Kernels and cutoffs: gradients",
        about,
        "root mean square error of all components, relative to the root mean square of the gradient",
        "particle and evaluation",
        mean,
    )
    yield MethodPanel(
        "kernels-gradient-worst",
        "Kernels and cutoffs: worst gradients",
        about,
        "largest error of a component, relative to the root mean square of the gradient",
        "particle and evaluation",
        largest,
    )
    yield MethodPanel(
        "kernels-density",
        "Cutoffs: density by summation",
        f"{particles} in 2D, one per unit area. Sums take the plain quintic whatever the kernel. {_EVALUATION}",
        "root mean square error, relative to the mean density",
        "particle and evaluation",
        _points("summed density", _summed, cuts, lambda x_nc: (np.ones(len(x_nc)),) * 2, quick, session)[0],
    )

    def deformation(x_nc: FloatArray) -> tuple[FloatArray, FloatArray]:
        rho_n = exact_density(x_nc)
        return rho_n, rho_n - 1

    yield MethodPanel(
        "kernels-deformation",
        "Density of a deformed fluid: summation against continuity",
        f"{particles} fly freely for {STEPS} steps with a diverging velocity of wavelength 16 spacings, "
        f"which moves each by up to {DEFORMED:g} spacings along either axis. Both times are of a whole time step.",
        "root mean square error, relative to the root mean square of the change of density",
        "particle and step",
        _points(
            "deformed density", _deformed_methods, (3.0,) if quick else (2.0, 3.0, 4.0), deformation, quick, session
        )[0],
    )


def maps(quick: bool) -> Iterator[Map]:
    """Yield the error of the reference's gradient over cutoff and disorder, one map per kernel."""
    cuts = np.arange(2.0, 4.01, 0.5 if quick else 0.125).tolist()
    disorders = np.arange(0.0, 0.31, 0.15 if quick else 0.05).tolist()

    def error(kernel: KernelStyle, cut: float, disorder: float) -> float:
        setup = prepared(kernel, cut, disorder, QUICK_EDGE)
        true_n = gradient(setup.atoms.x_nc)
        sim = moving(setup, field(setup.atoms.x_nc)).simulation(("grad/v",))
        return relative(sim.output("grad/v") - true_n, true_n)

    for kernel in KERNELS:
        yield Map(
            f"kernels-{kernel.lower()}",
            f"Error of the velocity gradient, {kernel}",
            "cutoff (spacings)",
            "disorder (spacings)",
            tuple(cuts),
            tuple(disorders),
            tuple(tuple(error(kernel, cut, disorder) for cut in cuts) for disorder in disorders),
            "relative root mean square error",
        )
