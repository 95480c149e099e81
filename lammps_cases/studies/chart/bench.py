"""Speed against peers, measured in one run and given as ratios, which are less noisy than times.

The particle model is timed against LAMMPS on the same scene, one core each, in turns.
"""

from __future__ import annotations

import os
import pickle
import shlex
import subprocess
import sys
import tempfile
import tracemalloc
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from timeit import timeit
from typing import Any

import numpy as np

import eos_ref.jit  # noqa: F401  selects the registers before anything is compiled
from eos_ref import EOS, EOSTable
from eos_ref.compiled.evaluator import CompiledEvaluator
from eos_ref.eos import bounds, compiled
from eos_ref.eos.table import examples
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.box import Box
from eos_ref.model.state import State
from lammps_cases.engine.ranks import Ranks
from lammps_cases.engine.session import RunCommand, Session
from lammps_cases.records.measure import Call, ConfidenceInterval, Timing, in_turns, interval
from lammps_cases.run import prepared_case
from lammps_cases.scene import Scene, casefile
from lammps_cases.scene.atoms import build
from lammps_cases.scene.casefile import Case
from lammps_cases.setup import reference_side
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan
from lammps_cases.studies.chart import codes
from lammps_cases.studies.flows.catalogue import FLOWS
from lammps_cases.studies.flows.flow import Options, Start, rows
from lammps_cases.studies.flows.solve import ReferenceFlow

VORTICES = 100  # particles along the edge of the box
PEER_STEPS = 20
PEER_TIME = 0.005  # of PySPH's example: some 20 steps
WARM = 3
EOS_REF = (sys.executable, "-m", "lammps_cases.cli.main")
# By style, as the time of a power depends on its exponent.
LAWS = {law.style + (f" {law.parameter:g}" if law.law.uses_powm1 else ""): law for law in examples(rho0=1.2, cs=3.4)}


@dataclass(frozen=True)
class Ratio:
    """One measurement: nanoseconds per particle (or per run, for whole programs) of ours and of a peer.

    ``ratio`` is ours over peer, below 1 if ours is faster; all three are medians with their intervals.
    """

    scene: str
    peer: str
    ours_ns: ConfidenceInterval
    peer_ns: ConfidenceInterval
    ratio: ConfidenceInterval


def ratio(scene: str, peer: str, ours: Timing, theirs: Timing, per: float) -> Ratio:
    """Return the ratio of two timings of the same rounds; either call treats ``per`` particles (times steps)."""
    ns = 1e9 / per
    return Ratio(scene, peer, ours.seconds.scaled(ns), theirs.seconds.scaled(ns), ours.against(theirs))


def against(
    scene: str, peer: str, ours: Call, theirs: Call, repeats: int, per: float = 1.0, at_least: float = 0.02
) -> Ratio:
    """Time ours against a peer, in turns; see `ratio`."""
    timings = in_turns({"ours": ours, "peer": theirs}, repeats, at_least)
    return ratio(scene, peer, timings["ours"], timings["peer"], per)


def measured(part: str, states: int, repeats: int, python: str | None) -> Iterator[Ratio]:
    """Yield the ratios of a part of ``eos-ref bench``; ``python``, if given, has PySPH."""
    if part == "laws":
        yield from laws_against_copy(states, repeats)
        yield table_against_copy(states, repeats)
    elif part == "model":
        yield from against_lammps((2, 3), repeats)
    elif part == "peers":
        yield from taylor_green(repeats, python)
    else:
        yield from (run_against_lammps(repeats, jobs) for jobs in (1, 2))
        yield from programs_against_python(repeats)


def laws_against_copy(n: int, repeats: int) -> list[Ratio]:
    """Time every law on n densities into a given array, against copying the same arrays."""
    random = np.random.default_rng(1)
    rho_n, e_n = random.uniform(0.6, 1.8, n), random.uniform(0.5, 2.0, n)
    p_n, copy_n = np.empty(n), np.empty(n)
    ratios = []
    for name, law in LAWS.items():
        energy_n = e_n if law.needs_energy else np.empty(0)

        def ours(law: EOS = law, energy_n: object = energy_n) -> None:
            compiled.pressure_of_one_type(rho_n, energy_n, *law.settings, p_n)

        def peer(gas: bool = law.needs_energy) -> None:
            np.copyto(copy_n, rho_n)
            if gas:  # the same arrays: this law also reads the energy
                np.copyto(copy_n, e_n)

        ratios.append(against(f"{name}, {n:,} states", "memory copy", ours, peer, repeats, n))
    return ratios


def table_against_copy(n: int, repeats: int) -> Ratio:
    """Time four laws on particles of interleaved types, against copying density and type."""
    random = np.random.default_rng(2)
    table = EOSTable((*list(LAWS.values())[:3], EOS("linear", 0.9, 2.0, background=0.1)))
    rho_n, type_n = random.uniform(0.6, 1.8, n), random.integers(1, 5, n)
    return against(
        f"four types interleaved, {n:,} states",
        "memory copy",
        lambda: table.pressure(rho_n, type_n),
        lambda: (rho_n.copy(), type_n.copy()),
        repeats,
        n,
    )


def bytes_per_particle(n: int = 1_000_000) -> float:
    """Return the peak memory of pressure and bound of n particles of four types, per particle, inputs included."""
    random = np.random.default_rng(3)
    table = EOSTable(tuple(list(LAWS.values())[:4]))
    tracemalloc.start()
    rho_n, type_n = random.uniform(0.6, 1.8, n), random.integers(1, 5, n)
    table.pressure(rho_n, type_n)
    bounds.comparison(table, rho_n, type_n)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak / n


def run_against_lammps(repeats: int, jobs: int) -> Ratio:
    """Time ``eos-ref run`` on the equations of state against LAMMPS alone on the same scenes, both as whole processes.

    Only ours has the scenes that crash LAMMPS, as they would end the peer.
    """
    chosen = [case for case in casefile.select(casefile.load(), tag="eos") if "crash" not in case.tags]
    prepared = [prepared_case.prepare(case) for case in chosen]
    lammps_jobs = [job(p.case.scene, p.atoms, plan(p.case.scene)) for p in prepared]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "jobs"
        file.write_bytes(pickle.dumps(lammps_jobs))
        code = f"""if True:
            import pickle
            from lammps_cases.engine.session import EngineRefused, Session
            session = Session()
            with open({str(file)!r}, "rb") as file:
                jobs = pickle.load(file)
            for job in jobs:
                try:
                    session.run(job)
                except EngineRefused:
                    continue"""
        ours = [*EOS_REF, "run", "--tag", "eos", "--jobs", str(jobs), "--out", f"{folder}/run"]
        return _processes(f"eos-ref run --tag eos --jobs {jobs}", "LAMMPS alone", ours, code, repeats)


def programs_against_python(repeats: int) -> Iterator[Ratio]:
    """Time ``eos-ref --help``, and a shell's completion on Tab, against an empty Python program."""
    yield _processes("eos-ref --help", "empty Python program", [*EOS_REF, "--help"], "pass", repeats)
    for words in ("eos-ref r", "eos-ref run forces.", "eos-ref findings f", "eos-ref run --tag q"):
        what = f"completion of {words}"
        yield _processes(what, "empty Python program", [*EOS_REF], "pass", repeats, asked(words))


def asked(words: str) -> dict[str, str]:
    """Return the variables that bash sets to complete the last of some words."""
    return {"_EOS_REF_COMPLETE": "bash_complete", "COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}


def _processes(
    scene: str, peer: str, ours: list[str], code: str, repeats: int, environment: dict[str, str] | None = None
) -> Ratio:
    """Time whole programs as installed: with byte code of all modules, which some machines do not keep.

    The calibration of the measurement leaves it in a folder.
    """
    theirs = [sys.executable, "-c", code]
    with tempfile.TemporaryDirectory() as folder:
        installed = {"PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": folder}
        call, peer_call = partial(process, ours, installed | (environment or {})), partial(process, theirs, installed)
        return against(scene, peer, call, peer_call, repeats, at_least=0)


def process(command: list[str], environment: dict[str, str] | None = None) -> None:
    """Run a program; RuntimeError with its output if it fails."""
    environ = os.environ | (environment or {})
    done = subprocess.run(command, check=False, capture_output=True, text=True, env=environ)
    if done.returncode:
        raise RuntimeError(f"exit code {done.returncode} of {shlex.join(command)}:\n{done.stdout}{done.stderr}")


# --- other codes


def taylor_green(repeats: int, python: str | None) -> Iterator[Ratio]:
    """Yield the time per particle and step of Taylor-Green vortices, ours against every other code that is installed.

    Codes that run as separate programs cannot take turns step by step with ours; each of their runs is followed by
    one of ours of about the same length, so that a drift of the machine affects both.

    Parameters
    ----------
    python : str or None
        A Python that has PySPH; None: without it.

    Raises
    ------
    InputError
        That Python cannot run PySPH.
    """
    start = FLOWS["taylor-green"].start(VORTICES, Options(kernel="quintic"))
    with Ranks(None, 1) as one, Ranks(None, 2) as two:
        peers: dict[str, Callable[[], list[float]]] = {
            "LAMMPS": partial(_lammps, start, one),
            "LAMMPS, 2 ranks": partial(_lammps, start, two),
        }
        if python:
            peers["PySPH"] = partial(_pysph, python)
        for threads in (1, 2):
            flow = ReferenceFlow(start, partial(CompiledEvaluator, threads=threads))
            flow.advance(WARM)
            scene = f"Taylor-Green, {VORTICES**2:,} particles" + (f", {threads} threads" if threads > 1 else "")
            for peer, steps in peers.items():
                yield _against(scene, peer, partial(flow.advance, PEER_STEPS), steps, repeats)


def _lammps(start: Start, ranks: Ranks) -> list[float]:
    """Return the seconds of one step of LAMMPS on a number of ranks, after a few steps to warm up."""
    lammps_job = job(start.case.scene, start.atoms, plan(start.case.scene))
    runs = (RunCommand(f"run {WARM} post no", read=False), RunCommand(f"run {PEER_STEPS} pre no post no"))
    answer = ranks.run(replace(lammps_job, runs=runs, ranks=ranks.count))
    return [answer.run_seconds[-1] / PEER_STEPS]


def _pysph(python: str) -> list[float]:
    """Return the mean seconds of a step of PySPH's example."""
    flow = str(codes.SCRIPTS / "pysph_flow.py"), "taylor_green", "wcsph", str(VORTICES), str(PEER_TIME)
    result = codes.pysph_answer(python, *flow)
    assert result["particles"] == VORTICES**2
    return [float(result["seconds"]) / result["steps"]]


def _against(scene: str, peer: str, ours: Callable[[], None], theirs: Callable[[], list[float]], repeats: int) -> Ratio:
    own, other = [], []
    for _ in range(repeats):
        other.append(interval(tuple(theirs())).median)
        own.append(timeit(ours, number=1) / PEER_STEPS)
    return ratio(scene, peer, Timing(tuple(own), 1, own[0]), Timing(tuple(other), 1, other[0]), VORTICES**2)


OPTIONS: dict[str, dict[str, Any]] = {
    "quintic": {},
    "shift": {"rheo": {"shift": True}},
    "RK1": {"rheo": {"kernel": "RK1"}},
    "RK2": {"rheo": {"kernel": "RK2"}},
    "rho/sum": {"rheo": {"rho_sum": True}, "rho": None},
    "thermal": {"energy": {"range": [0.9, 1.1]}},
}
EDGE = {2: 200, 3: 31}  # particles along an edge: 40 000 and 29 791
MODEL_STEPS = {2: 10, 3: 4}
TIMESTEP = 0.002


def scene(option: str, dimension: int, edge: int) -> Case:
    """Return a fluid of unit volumes, so that LAMMPS' forces are those of the reference, cutoff of 3 spacings."""
    lattice = "sq" if dimension == 2 else "sc"
    data = {
        "dimension": dimension,
        "types": [{"mass": 1.0, "rho0": 1.0, "cs": 10.0}],
        "positions": {"lattice": lattice, "spacing": 1.0, "cells": [edge] * dimension, "disorder": 0.1},
        "pressure": [{"types": "*", "style": "linear"}],
        "rho": {"ratio": [0.99, 1.01]},
        "velocity": {"random": 0.1},
        "evolve": {"steps": 1, "timestep": TIMESTEP},
        "compare": ["f"],
        **OPTIONS[option],
    }
    parsed = Scene.model_validate({key: value for key, value in data.items() if value is not None})
    return Case(f"bench-{option}", "", (), parsed, Path("bench"))


def simulation(case: Case, fields: Sequence[str] = ()) -> Simulation:
    """Return the compiled reference at the start of a case."""
    return reference_side.simulation(case.scene, build(case, case.scene.eos()), fields, case.where)


def against_lammps(dimensions: tuple[int, ...] = (2, 3), repeats: int = 5) -> Iterator[Ratio]:
    """Yield the time per particle and step of the reference and of LAMMPS, for every option."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    session = Session()
    for dimension in dimensions:
        for option in OPTIONS:
            case, steps = scene(option, dimension, EDGE[dimension]), MODEL_STEPS[dimension]
            atoms = build(case, case.scene.eos())
            session.run(job(case.scene, atoms, plan(case.scene)))
            yield against(
                f"{dimension}D {option}, {len(atoms):,} particles",
                "LAMMPS",
                partial(simulation(case).run, steps, TIMESTEP),
                partial(session.advance, steps),
                repeats,
                steps * len(atoms),
            )


# --- memory


def model_bytes_per_particle(option: str = "RK1", edge: int = 1000) -> float:
    """Return the peak memory that a million particles add to a process that has everything loaded, per particle."""
    code = f"from lammps_cases.studies.chart.bench import grown; print(grown({option!r}, {edge}))"
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    return float(done.stdout.split()[-1]) / edge**2


def grown(option: str, edge: int) -> float:
    """Return the peak resident bytes of a simulation of ``edge`` squared particles, less those of a small one."""
    _run_lattice(option, 40)
    # A new process inherits the peak of its parent: count from here (Linux).
    Path("/proc/self/clear_refs").write_text("5")
    before = _peak()
    _run_lattice(option, edge)
    return 1024.0 * (_peak() - before)


def _peak() -> int:
    """Return the peak resident memory of this process (kB)."""
    lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))


def _run_lattice(option: str, edge: int) -> None:
    """Run two steps from a state made here, so that the arrays of a scene do not count."""
    random, x_nc = np.random.default_rng(1), rows(0, edge, edge)
    x_nc += random.uniform(-0.1, 0.1, x_nc.shape)
    v_nc, n = random.uniform(-0.1, 0.1, x_nc.shape), len(x_nc)
    state = State(x_nc, v_nc, np.ones(n), np.ones(n, np.int32), np.zeros(n, bool), None)
    box = Box((0.0, 0.0), (float(edge), float(edge)), (True, True))
    Simulation(simulation(scene(option, 2, 10)).model, box, state, (), CompiledEvaluator).run(2, TIMESTEP)
