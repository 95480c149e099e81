r"""Equations of state: every method of `eos_ref.methods.laws`, and LAMMPS, against Arb; and what methods cost.

Errors are the worst that a search finds in each regime, a range of :math:`|\rho/\rho_0-1|`; times are of shuffled
states of that regime, for which tables and series are prepared. The costs (seconds to start, nanoseconds per state) are
the basis of `eos_ref.methods.choice`.
"""

from __future__ import annotations

import json
import math
import re
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from eos_ref import EOS
from eos_ref.eos.table import FloatArray, examples
from eos_ref.methods.choice import COSTS
from eos_ref.methods.laws import Evaluate, LawMethod, methods_of
from eos_ref.methods.worst import SAMPLES, Regime, Worst, worst_case
from lammps_cases.engine import cluster
from lammps_cases.engine.session import EngineMissing, Session
from lammps_cases.engine.workers import Failure, Workers
from lammps_cases.records.files import write_atomically
from lammps_cases.records.measure import Timing, in_turns, machine
from lammps_cases.records.progress import SILENT, Progress
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import Atoms, build
from lammps_cases.scene.casefile import Case
from lammps_cases.scene.particles import entries
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan
from lammps_cases.studies.chart.record import Map, MethodPanel, MethodPoint, measured

# Gamma 4 represents whole exponents of tait/general.
LAWS: tuple[EOS, ...] = (
    *examples(1.2345, 7.89),
    EOS("tait/general", 1.2345, 7.89, 4.0),
    EOS("tait/water", 1.2345, 7.89, background=3.21),
)
REGIMES = tuple(Regime(low, high) for low, high in ((1e-12, 1e-9), (1e-9, 1e-6), (1e-6, 1e-3), (1e-3, 0.1), (0.1, 10)))
ENERGY = 1.7  # per mass, for laws that need one
STATES, QUICK_STATES = 300_000, 100_000
OUTPUT = "LAMMPS"
PATIENCE = 3600.0  # seconds for a search


def name(law: EOS) -> str:
    """Return the name of a law with its parameters."""
    parameter = "" if law.parameter is None else f" {law.parameter:g}"
    return f"{law.style}{parameter}" + (" + background" if law.background else "")


def panels(quick: bool, session: Session | None) -> Iterator[MethodPanel]:
    """Yield one panel per law."""
    for law in LAWS[1:4] if quick else LAWS:
        yield _panel(law, REGIMES[1::2] if quick else REGIMES, QUICK_STATES if quick else STATES, session)


def _panel(law: EOS, regimes: Sequence[Regime], n: int, session: Session | None) -> MethodPanel:
    methods = methods_of(law)
    reasons = {m.name: m.reason for m in methods}
    reasons[OUTPUT] = "LAMMPS' own output, less what an output costs that needs no law"
    points: list[MethodPoint] = []
    timed = [timings(law, methods, regime, n, session) for regime in regimes]  # before searches, which compile
    searched = iter(each(worst_of, [(law, m.name, regime, SAMPLES) for regime in regimes for m in methods]))
    for regime, (took, _) in zip(regimes, timed, strict=True):
        worst = {m.name: next(searched) for m in methods}
        if session is not None:
            worst[OUTPUT] = _worst(EngineLaw(session, law).pressure, law, regime, SAMPLES)
        errors = {name: found.error for name, found in worst.items()}
        for point in measured(f"pressure of {name(law)}", str(regime), errors, took, n, reasons):
            found = worst[point.method]
            points.append(replace(point, median=found.median, p99=found.p99, worst_at=f"rho = {found.rho!r}"))
    return MethodPanel(
        id="law-" + re.sub("[^a-z0-9.]+", "-", name(law)),
        title=f"Pressure of {name(law)}",
        about=f"{n:,} states in float64, shuffled; rho0 {law.rho0!r}, cs {law.cs!r}, background {law.background!r}"
        + (f", e {ENERGY!r}." if law.needs_energy else "."),
        error_of="relative error of the pressure: the worst found by search, certified with Arb; median and 99th "
        f"percentile of {SAMPLES:,} densities spread evenly in the logarithm of the distance",
        unit="state",
        points=tuple(points),
        roofline_ns=median(copying for _, copying in timed) * 1e9 / n,
    )


def worst_of(site: str | None, law: EOS, method: str, regime: Regime, samples: int) -> Worst:
    """Task: return the worst case of a method, by its name, in a regime."""
    named = {m.name: m for m in methods_of(law)}
    return _worst(named[method].function(law, *regime.ends(law)), law, regime, samples)


def _worst(evaluate: Evaluate, law: EOS, regime: Regime, samples: int) -> Worst:
    """Return the worst case of a method in a regime, by a search that begins at some samples."""
    e = ENERGY if law.needs_energy else None
    return worst_case(evaluate, law, regime.densities(law, samples), partial(regime.holds, law), e)


def timings(
    law: EOS, methods: Sequence[LawMethod], regime: Regime, n: int, session: Session | None
) -> tuple[dict[str, Timing], float]:
    """Return the times of all methods in turns, and the seconds that copying the states takes."""
    rho_n = np.random.default_rng(1).permutation(regime.densities(law, n))
    e_n = np.full(n, ENERGY) if law.needs_energy else None
    copy_n = np.empty(n)

    def copy() -> None:
        np.copyto(copy_n, rho_n)
        if e_n is not None:
            np.copyto(copy_n, e_n)

    calls: dict[str, Callable[[], object]] = {"copy": copy}
    for method in methods:
        evaluate = method.function(law, float(rho_n.min()), float(rho_n.max()))
        calls[method.name] = partial(evaluate, rho_n, e_n)
    if session is not None:
        calls[OUTPUT], calls["LAMMPS, no law"] = EngineLaw(session, law).timed(rho_n, e_n)
    took = in_turns(calls, at_least=0.01)
    if session is not None:
        whole, bare = took[OUTPUT], took.pop("LAMMPS, no law")
        alone = tuple(a - b for a, b in zip(whole.seconds_r, bare.seconds_r, strict=True))
        took[OUTPUT] = Timing(alone, whole.calls, alone[0])
    return took, took.pop("copy").seconds.median


# --- LAMMPS as one more method, and searches for worst errors


class EngineLaw:
    """A law as LAMMPS evaluates it.

    Parameters
    ----------
    session : Session
    law : EOS
    """

    def __init__(self, session: Session, law: EOS) -> None:
        self.session, self.law = session, law

    def pressure(self, rho_n: FloatArray, e_n: FloatArray | None = None) -> FloatArray:
        """Return LAMMPS' output of pressures (n,) for densities and energies."""
        scene, atoms = self._scene(len(rho_n), rho_n, e_n)
        answer = self.session.run(job(scene, atoms, plan(scene)))
        return np.asarray(answer.arrays["q.pressure"][: len(rho_n)])

    def timed(self, rho_n: FloatArray, e_n: FloatArray | None = None) -> tuple[Callable[[], None], Callable[[], None]]:
        """Return two calls to be timed: the output of all pressures, and that of as many numbers without a law.

        A new count of steps makes LAMMPS evaluate an output again; the difference of the two is the law alone.
        """
        self.pressure(rho_n, e_n)
        lmp = self.session.open()
        lmp.command("compute copied all rheo/property/atom phase")

        def output(name: str) -> None:
            lmp.command(f"reset_timestep {int(lmp.extract_global('ntimestep')) + 1}")
            lmp.extract_compute(name, 1, 1)

        return lambda: output("q"), lambda: output("copied")

    def _scene(self, n: int, rho_n: FloatArray, e_n: FloatArray | None) -> tuple[Scene, Atoms]:
        law, edge = self.law, math.ceil(math.sqrt(n))
        data = {
            "dimension": 2,
            "types": [{"mass": 1.0, "rho0": law.rho0, "cs": law.cs}],
            "positions": {"lattice": "sq", "spacing": 1.0, "cells": [edge, edge]},
            "pressure": entries(law),
            "rho": {"constant": law.rho0},
            **({} if e_n is None else {"energy": {"constant": 1.0}}),
        }
        scene = Scene.model_validate(data)
        atoms = build(Case("states", "", (), scene, Path("states")), scene.eos())
        all_rho_n, all_e_n = np.full(len(atoms), law.rho0), np.ones(len(atoms))
        all_rho_n[:n] = rho_n
        if e_n is not None:
            all_e_n[:n] = e_n
        return scene, replace(atoms, rho_n=all_rho_n, energy_n=None if e_n is None else all_e_n)


def each(task: Callable[..., Worst], arguments: Sequence[tuple[Any, ...]]) -> list[Worst]:
    """Return ``task(site, *arguments)`` of each, from the workers of the cluster in use, else from this process.

    These need no clock; timing stays on this machine, as times of several machines cannot be compared.

    Raises
    ------
    EngineMissing
        A worker failed.
    """
    if not cluster.address():
        return [task(None, *given) for given in arguments]
    results = []
    with Workers(None, 1) as workers:
        for future in [workers.call(task, *given, time_limit=PATIENCE) for given in arguments]:
            outcome = workers.outcome(future)
            if isinstance(outcome, Failure):
                raise EngineMissing(f"a worker of the cluster failed: {outcome.message}")
            results.append(outcome)
    return results


# --- maps


def maps(quick: bool) -> Iterator[Map]:
    """Yield the worst errors over distance from rho0 and gamma, for the forms of Tait's law."""
    gammas = np.linspace(1.5, 7.5, 5 if quick else 13)
    distances = np.geomspace(1e-10, 3.0, 9 if quick else 22)
    laws = [EOS("tait/general", 1.2345, 7.89, float(gamma)) for gamma in gammas]
    near = [Regime(float(d) / 1.3, float(d) * 1.3) for d in distances]
    for method in ("textbook", "numpy"):
        searched = each(worst_of, [(law, method, regime, 256) for law in laws for regime in near])
        value = np.reshape([found.error for found in searched], (len(gammas), len(distances)))
        yield Map(
            id=f"tait-{method}",
            title=f"tait/general, {method}",
            x_name="|rho/rho0 - 1|",
            y_name="gamma",
            x=tuple(distances.tolist()),
            y=tuple(gammas.tolist()),
            value=tuple(tuple(row) for row in value.tolist()),
            unit="worst relative error",
        )


FLUID = Regime(1e-9, 0.1)  # the densities for which tables and series are prepared


def save_costs(progress: Progress = SILENT, path: Path = COSTS) -> None:
    """Measure and write ``costs.json``; times in two digits, so that a new measurement changes the file little."""
    laws = [law for law in LAWS if not law.background]
    costs: dict[str, dict[str, Any]] = {}
    for k, law in enumerate(laws):
        progress.advance(k, len(laws), f"costs of {law.style}")
        methods = methods_of(law)
        took, _ = timings(law, methods, FLUID, QUICK_STATES, None)
        for method in methods:
            ns = took[method.name].seconds.median / QUICK_STATES * 1e9
            entry = {"ns": float(f"{ns:.2g}"), "startup": float(f"{_startup(law, method.name):.2g}")}
            costs.setdefault(law.style, {}).setdefault(method.name, entry)
    document = {"machine": machine(), "states": QUICK_STATES, "laws": costs}
    write_atomically(path, json.dumps(document, indent=1) + "\n")


def _startup(law: EOS, method: str, rounds: int = 3) -> float:
    """Return the seconds that the first evaluation of ten states takes in a fresh process beyond the second.

    The minimum of some rounds after an extra one, in which numba may compile and cache.
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
