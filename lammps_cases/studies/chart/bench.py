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
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import eos_ref.jit  # noqa: F401  selects the registers before anything is compiled
from eos_ref import EOS, EOSTable
from eos_ref.eos import compiled
from eos_ref.eos.table import examples
from eos_ref.evaluation.time_step import Simulation
from lammps_cases.engine.session import Session
from lammps_cases.records.measure import Call, ConfidenceInterval, Timing, in_turns
from lammps_cases.run import prepared_case
from lammps_cases.scene import Scene, casefile
from lammps_cases.scene.atoms import build
from lammps_cases.scene.casefile import Case
from lammps_cases.setup import reference_side
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan

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


def measured(part: str, states: int, repeats: int) -> Iterator[Ratio]:
    """Yield the ratios of a part of ``eos-ref bench``."""
    if part == "laws":
        yield from laws_against_copy(states, repeats)
        yield table_against_copy(states, repeats)
    elif part == "model":
        yield from against_lammps((2, 3), repeats)
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
        yield _processes(what, "empty Python program", [*EOS_REF], "pass", repeats, completion_of(words))


def completion_of(words: str) -> dict[str, str]:
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


# --- the particle model

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
