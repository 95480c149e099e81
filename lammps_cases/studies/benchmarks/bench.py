"""Speed against peers, measured in one run and given as ratios: machines are noisy, ratios of neighbours less so."""

from __future__ import annotations

import os
import pickle
import platform
import re
import shlex
import subprocess
import sys
import tempfile
import tracemalloc
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from eos_ref import EOS, EOSTable, InputError
from eos_ref.eos import bounds
from eos_ref.eos.table import examples
from lammps_cases.records.measure import Call, ConfidenceInterval, Timing, in_turns

IN_CACHES = 2**14  # densities, which lie with their pressures in the second-level cache
EOS_REF = (sys.executable, "-m", "lammps_cases.cli.main")
# By style; the time of a power depends on its exponent.
LAWS = {law.style + (f" {law.parameter:g}" if law.law.uses_powm1 else ""): law for law in examples(rho0=1.2, cs=3.4)}


@dataclass(frozen=True)
class Ratio:
    """One measurement: nanoseconds per particle (or per run, for whole programs) of ours and of a peer.

    ``ratio`` is ours over peer, below 1 is faster; all three are medians with their intervals.
    ``ours_ns_r`` are ours of every round.
    """

    scene: str
    peer: str
    ours_ns: ConfidenceInterval
    peer_ns: ConfidenceInterval
    ratio: ConfidenceInterval
    ours_ns_r: tuple[float, ...] = ()


def ratio(scene: str, peer: str, ours: Timing, theirs: Timing, per: float, peer_per: float) -> Ratio:
    """Return the ratio of two timings of the same rounds; a call of ours treats ``per`` particles (times steps)."""
    ours_ns, peer_ns = ours.seconds.scaled(1e9 / per), theirs.seconds.scaled(1e9 / peer_per)
    ours_ns_r = tuple(seconds * 1e9 / per for seconds in ours.seconds_r)
    return Ratio(scene, peer, ours_ns, peer_ns, ours.against(theirs).scaled(peer_per / per), ours_ns_r)


def against(
    scene: str,
    peer: str,
    ours: Call,
    theirs: Call,
    repeats: int,
    per: float = 1.0,
    at_least: float = 0.02,
    peer_per: float | None = None,
) -> Ratio:
    """Time ours against a peer, in turns; see `ratio`."""
    timings = in_turns({"ours": ours, "peer": theirs}, repeats, at_least)
    return ratio(scene, peer, timings["ours"], timings["peer"], per, peer_per or per)


def laws_against_copy(n: int, repeats: int) -> list[Ratio]:
    """Time every law on n densities into a given array, against copying the same arrays."""
    from eos_ref.eos import compiled

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


def power_without_memory(n: int, repeats: int) -> Ratio:
    """Time the law with a power on as many densities, but the same few again and again, which caches hold.

    No order of reading and writing makes the law faster than this: it is what arithmetic takes.
    """
    from eos_ref.eos import compiled

    few = min(n, IN_CACHES)
    name, law = next((name, law) for name, law in LAWS.items() if law.law.uses_powm1)
    rho_n, p_n, all_n, copy_n = np.random.default_rng(1).uniform(0.6, 1.8, few), np.empty(few), np.ones(n), np.empty(n)

    def ours() -> None:
        for _ in range(n // few):
            compiled.pressure_of_one_type(rho_n, np.empty(0), *law.settings, p_n)

    scene = f"{name}, {few:,} states {n // few:,} times"
    return against(scene, "memory copy", ours, partial(np.copyto, copy_n, all_n), repeats, n // few * few, peer_per=n)


def power_operations() -> tuple[int, int]:
    """Return the vector operations on doubles that the law with a power takes as compiled here, and their lanes.

    Divisions, which take several cycles each, count as one; moves between registers and memory, comparisons of bits and
    operations on whole numbers do not count.

    Raises
    ------
    InputError
        A processor without the vector registers of x86-64.
    """
    import numba

    from eos_ref.eos import compiled

    law = next(law for law in LAWS.values() if law.law.uses_powm1)
    anew = numba.njit(error_model="numpy")(compiled.pressure_of_one_type.py_func)  # code of a cache is not shown
    anew(np.ones(8), np.empty(0), *law.settings, np.empty(8))
    code = "".join(anew.inspect_asm().values())
    with_division = [block for block in re.split(r"^\.L\w+:", code, flags=re.M) if "vdivpd" in block]
    if not with_division:
        raise InputError("machine code", "must have the vector registers of x86-64", platform.machine())
    loop = max(with_division, key=lambda block: block.count("pd\t"))
    counted = re.findall(r"\tv(?:add|sub|mul|div|max|min|f\w*(?:add|sub)\d+)pd\t.*%([yz])mm", loop)
    lanes = 8 if "z" in counted else 4
    stores = len(re.findall(r"\tvmovupd\t%[yz]mm\d+, \S*\(", loop))
    return len(counted) // stores, lanes


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


def lammps_alone(file: str) -> None:
    """Run jobs from a file as the peer of a whole run: one process, one LAMMPS, and nothing else."""
    from lammps_cases.engine import session

    lmp = session.open_lammps()
    for job in pickle.loads(Path(file).read_bytes()):
        try:
            session.run(lmp, job)
        except session.EngineRefused:
            continue


def run_against_lammps(repeats: int, jobs: int) -> Ratio:
    """Time ``eos-ref run`` on the equations of state against LAMMPS alone on the same scenes, whole processes both.

    The scenes that crash LAMMPS are in ours only, as they would end the peer.
    """
    from lammps_cases.run import prepared_case
    from lammps_cases.scene import casefile
    from lammps_cases.setup.commands import job
    from lammps_cases.setup.plan import plan

    chosen = [case for case in casefile.select(casefile.load(), tag="eos") if "crash" not in case.tags]
    prepared = [prepared_case.prepare(case) for case in chosen]
    lammps_jobs = [job(p.case.scene, p.atoms, plan(p.case.scene)) for p in prepared]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "jobs"
        file.write_bytes(pickle.dumps(lammps_jobs))
        code = f"from lammps_cases.studies.benchmarks.bench import lammps_alone as run; run({str(file)!r})"
        ours = [*EOS_REF, "run", "--tag", "eos", "--jobs", str(jobs), "--out", f"{folder}/run"]
        return _processes(f"eos-ref run --tag eos --jobs {jobs}", "LAMMPS alone", ours, code, repeats)


def worker_against_python(repeats: int) -> Ratio:
    """Time what every run begins with, a worker that has imported what it judges by and opened LAMMPS."""
    from lammps_cases.engine import forkserver

    code = f"import {', '.join((forkserver.OF_WORKERS, *forkserver.OF_JUDGING, forkserver.OF_PAIRS))}"
    ours = [sys.executable, "-c", f"{code}; from lammps_cases.engine import session; session.open_lammps()"]
    return _processes("imports of a worker, LAMMPS opened", "empty Python program", ours, "pass", repeats)


def help_against_python(repeats: int) -> Ratio:
    """Time ``eos-ref --help`` against an empty Python program."""
    return _processes("eos-ref --help", "empty Python program", [*EOS_REF, "--help"], "pass", repeats)


def completion_against_python(repeats: int) -> list[Ratio]:
    """Time what a shell asks for on Tab (commands, cases, findings, tags) against an empty Python program."""
    return [
        _processes(f"completion of {words}", "empty Python program", [*EOS_REF], "pass", repeats, _asked(words))
        for words in ("eos-ref r", "eos-ref run forces.", "eos-ref ledger f", "eos-ref run --tag q")
    ]


def _asked(words: str) -> dict[str, str]:
    """Return what bash sets to ask for the last of some words."""
    return {"_EOS_REF_COMPLETE": "bash_complete", "COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}


def _processes(
    scene: str, peer: str, ours: list[str], code: str, repeats: int, environment: dict[str, str] | None = None
) -> Ratio:
    """Time whole programs as they are when installed: with byte code of all modules, of which some machines keep none.

    What calibrates the measurement leaves it in a folder.
    """
    theirs = [sys.executable, "-c", code]
    with tempfile.TemporaryDirectory() as folder:
        installed = {"PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": folder}
        call, peer_call = partial(_process, ours, installed | (environment or {})), partial(_process, theirs, installed)
        return against(scene, peer, call, peer_call, repeats, at_least=0)


def _process(command: list[str], environment: dict[str, str] | None = None) -> None:
    environ = os.environ | (environment or {})
    done = subprocess.run(command, check=False, capture_output=True, text=True, env=environ)
    if done.returncode:
        raise RuntimeError(f"exit code {done.returncode} of {shlex.join(command)}:\n{done.stdout}{done.stderr}")
