"""Another machine, as far as one machine can be another: the same command with newer instructions switched off.

The C library takes other code for pow, exp and log, which LAMMPS and the reference call, numpy and OpenBLAS take other
loops, and numba compiles for a plain processor. Every prediction is computed anew, in a store of its own.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lammps_cases.comparison.store import VARIABLE
from lammps_cases.engine.installations import Engine
from lammps_cases.records.files import read_arrays
from lammps_cases.records.progress import SILENT, Progress
from lammps_cases.records.run_record import CaseRecord, digest, read_run
from lammps_cases.scene.casefile import Case


@dataclass(frozen=True)
class MachineRun:
    """Cases run by a process of its own: their records, and digests of the reference's fields."""

    records: dict[str, CaseRecord]
    references: dict[str, str]


def older() -> dict[str, str]:
    """Return environment variables that switch off what newer processors have; other libraries ignore them."""
    simd: Any = np.show_config(mode="dicts")
    extensions = simd["SIMD Extensions"].get("found", [])
    switches = {
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX,-AVX2,-FMA,-FMA4,-AVX512F",
        "NUMBA_CPU_NAME": "generic",
        "OPENBLAS_CORETYPE": "Nehalem",
    }
    return switches | ({"NPY_DISABLE_CPU_FEATURES": " ".join(extensions)} if extensions else {})


def run(
    cases: Sequence[Case],
    engine: Engine,
    settings: Mapping[str, str],
    jobs: int = 2,
    progress: Progress = SILENT,
) -> MachineRun:
    """Run cases by ``eos-ref run`` with some environment variables; without any, with the user's store.

    Raises
    ------
    RuntimeError
        The process left no report.
    """
    with tempfile.TemporaryDirectory(prefix="eos-ref-machine-") as folder:
        report = Path(folder) / "report"
        own = {VARIABLE: str(Path(folder) / "store")} if settings else {}
        own["EOS_REF_HISTORY"] = "off"  # a run that serves a purpose of its own
        here = os.pathsep.join([str(Path(__file__).parents[3]), *filter(None, [os.environ.get("PYTHONPATH")])])
        sources = sorted({str(case.source) for case in cases})
        program = [sys.executable, "-m", "lammps_cases.cli.main", "run", "--engine", engine.name, "--jobs", str(jobs)]
        program += ["--out", str(report), *(word for path in sources for word in ("--cases", path))]
        with subprocess.Popen(
            [*program, *(case.name for case in cases)],
            env={**os.environ, **settings, **own, "PYTHONPATH": here},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        ) as process:
            last = ""
            try:
                for line in process.stderr or ():
                    last = line.strip() or last
                    progress.advance(0, None, f"machine: {last}")
            except BaseException:
                process.terminate()
                raise
        if not (report / "run.json").exists():
            raise RuntimeError(f"eos-ref run on the other machine left no report: {last}")
        records = {record.case: record for record in read_run(report).cases}
        return MachineRun(records, {name: _reference(report / "fields" / f"{name}.npz") for name in records})


def _reference(file: Path) -> str:
    if not file.exists():
        return ""
    arrays = read_arrays(file)
    return digest(*(arrays[name] for name in sorted(arrays) if name.endswith(".reference")))
