"""Whole codes on the same flows: the reference, LAMMPS, and PySPH if a Python with it is given.

PySPH is optional: scripts run under that Python, and print one JSON document.
"""

from __future__ import annotations

import functools
import json
import subprocess
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from eos_ref import InputError
from lammps_cases.claims.probes.probe import error_words
from lammps_cases.engine import cluster
from lammps_cases.engine.workers import Workers
from lammps_cases.records.wording import brief
from lammps_cases.studies.chart.record import ONE_PER_CENT, Chart
from lammps_cases.studies.flows.cavity import CAVITY, STORED
from lammps_cases.studies.flows.flow import Options, Snapshot, Start
from lammps_cases.studies.flows.known import Flow
from lammps_cases.studies.flows.periodic import VORTICES
from lammps_cases.studies.flows.record import LAMMPS, REFERENCE, FlowRecord, by_side, recorded
from lammps_cases.studies.flows.solve import FlowResult, by_reference, in_worker
from lammps_cases.studies.flows.surfaces import DROP, disc, radius_of
from lammps_cases.studies.flows.waves import DAM

SCRIPTS = Path(__file__).parent / "peers"
_NAME = "Python of PySPH"
LIMIT = 3600.0  # seconds for a run of PySPH
REYNOLDS = 100.0  # of the vortices, as in PySPH's example


def pysph_answer(python: str, *arguments: str, limit: float = 600.0) -> dict[str, Any]:
    """Return the document that a script prints in its last line.

    Parameters
    ----------
    python : str
        A Python that has PySPH.
    arguments : str
        Of that Python: a script, and its arguments.
    limit : float
        Seconds after which it is stopped.

    Raises
    ------
    InputError
        That Python cannot be run, the script fails or takes too long, or its last line is not a document.
    """
    try:
        done = subprocess.run([python, *arguments], check=False, capture_output=True, text=True, timeout=limit)
    except OSError as error:
        raise InputError(_NAME, f"cannot be run: {error.strerror}", python) from None
    except subprocess.TimeoutExpired:
        raise InputError(_NAME, f"must answer within {limit:g} s", python) from None
    if done.returncode:
        words = done.stderr.strip().splitlines()
        raise InputError(_NAME, f"cannot run its example: {words[-1] if words else 'no message'}", python)
    try:
        document = json.loads(done.stdout.splitlines()[-1])
        assert isinstance(document, dict)
    except (IndexError, ValueError, AssertionError):
        raise InputError(_NAME, "must print a JSON document in its last line", done.stdout[-80:]) from None
    return document


def pysph_version(python: str) -> str:
    """Return the version of the PySPH that a Python has; see `pysph_answer`."""
    code = "import json, pysph; print(json.dumps({'version': pysph.__version__}))"
    return str(pysph_answer(python, "-c", code)["version"])


@dataclass(frozen=True)
class Compared:
    """A flow that several codes solve.

    Attributes
    ----------
    flow : what it is
    measure : the plotted error
    example, schemes : PySPH's, its default first
    speed : by the resolution, PySPH's unit of speed in units of the flow, whose spacing is 1
    """

    flow: Flow
    measure: str
    example: str
    schemes: tuple[str, ...]
    speed: Callable[[int], float] = lambda n: 1.0

    @property
    def about(self) -> str:
        """What each code solves."""
        return (
            f"{self.flow.about} PySPH: its example {self.example}, schemes {' (its default) and '.join(self.schemes)}."
        )


SWIRL = replace(
    VORTICES,
    name=f"taylor-green-{REYNOLDS:g}",
    about=f"Vortices in a periodic square at Re {REYNOLDS:g}, c = 10 times their speed, from a lattice disordered by a "
    "tenth of the spacing, until they have decayed to 1/e. With RK1, shift and rho/damp 0.3 h c as in LAMMPS' own "
    "example, and a tenth of its artificial viscosity, 0.1.",
    options=Options(
        kernel="RK1",
        extra={"Re": REYNOLDS, "disorder": 0.1, "shift": "yes", "artificial-visc": 0.1, "rho-damp": 0.3},
    ),
    resolutions=(12, 16, 25, 36),
    quick=(12,),
    title="Vortices of Taylor and Green",
)
_SIZES: dict[str, Any] = {"resolutions": (12, 16, 24), "quick": (12,)}
COMPARED = (
    Compared(SWIRL, "profile", "taylor_green", ("tvf", "edac"), lambda n: REYNOLDS / n),
    # PySPH uses its own walls in both cavities.
    *(Compared(replace(flow, **_SIZES), "u", "cavity", ("tvf", "edac")) for flow in (STORED, CAVITY)),
    Compared(replace(DAM, **_SIZES, title="Dam break"), "front", "dam_break_2d", ("wcsph", "edac")),
    Compared(
        replace(DROP, resolutions=(16, 24, 36), quick=(16,), title="Stretching drop"),
        *("displacement", "elliptical_drop", ("wcsph", "iisph"), lambda n: n / radius_of(disc(n))),
    ),
)


def codes(quick: bool, site: str | None, pysph: str | None) -> Iterator[FlowRecord]:
    """Solve every flow by every code.

    Raises
    ------
    InputError
        PySPH fails.
    """
    with cluster.used(""), Workers(site, 1) as workers:  # timed: on this machine
        for case in COMPARED:
            of = replace(case.flow, panels=(), quantities=())
            for n in of.quick if quick else of.resolutions:
                start = of.start(n, of.options)
                yield recorded(of, n, REFERENCE, by_reference(start))
                yield recorded(of, n, LAMMPS, in_worker(start, workers))
                for scheme in case.schemes if pysph else ():
                    yield recorded(of, n, f"PySPH {scheme}", by_pysph(pysph or "", case, scheme, n, start))


def by_pysph(python: str, case: Compared, scheme: str, n: int, start: Start) -> FlowResult:
    """Run PySPH's example of a flow to the times of the flow's snapshots.

    Raises
    ------
    InputError
        It fails, or has other particles.
    """
    speed = case.speed(n)
    times = [repr(float(step * start.timestep * speed / n)) for step in start.steps]
    answer = _answer(python, case.example, scheme, str(n), *times)
    shots = tuple(_snapshot(shot, n, speed, start) for shot in answer["shots"])
    finite = all(np.isfinite(shot.x_nc[start.atoms.type_n == 1]).all() for shot in shots)
    message = "" if finite else "a position of PySPH is no finite number"
    return FlowResult(shots, answer["seconds"], answer["particles"], answer["steps"], message)


@functools.cache
def _answer(python: str, *arguments: str) -> Any:
    """Run PySPH, once for the flows that it solves in the same way."""
    return pysph_answer(python, str(SCRIPTS / "pysph_flow.py"), *arguments, limit=LIMIT)


def _snapshot(shot: Mapping[str, Any], n: int, speed: float, start: Start) -> Snapshot:
    """Return PySPH's fluid in units of the flow, at the indices of the start's; all else is unknown."""
    fluid_n = start.atoms.type_n == 1
    if len(shot["x"]) != fluid_n.sum():
        raise InputError("PySPH", f"must have {fluid_n.sum()} particles of fluid", len(shot["x"]))
    x_nc, v_nc = np.full((2, len(fluid_n), 2), np.nan)
    x_nc[fluid_n] = n * np.stack([shot["x"], shot["y"]], axis=1)
    v_nc[fluid_n] = speed * np.stack([shot["u"], shot["v"]], axis=1)
    unknown_n = np.full(len(fluid_n), np.nan)
    return Snapshot(0, x_nc, v_nc, unknown_n, unknown_n, time=shot["time"] * n / speed)


Runs = Mapping[str, Sequence[FlowRecord]]  # of a flow, by code, from the coarsest on


def compared(runs: Sequence[FlowRecord]) -> Iterator[tuple[Compared, Runs]]:
    """Yield the flows that were solved, each with the runs of every code."""
    for case in COMPARED:
        if of := by_side(runs, case.flow.name):
            yield case, of


def rows(runs: Sequence[FlowRecord]) -> Iterator[tuple[str, ...]]:
    """Yield the rows of a table: flow, error of, code, N, particles, steps, seconds, error."""
    for case, of in compared(runs):
        for run in (run for of_code in of.values() for run in of_code):
            error = f"{run.errors[case.measure]:.2g}" if run.errors else error_words(run.message)
            cost = str(run.particles), str(run.steps), f"{run.seconds:.2g}"
            yield case.flow.name, case.measure, run.side, str(run.n), *cost, error


def recommendation(case: Compared, runs: Runs) -> str:
    """State the seconds that every code needs for an error that all reach, and which code reaches the least one."""
    every = {code: [(run.errors.get(case.measure, np.nan), run.seconds) for run in of] for code, of in runs.items()}
    solved = {code: [pair for pair in pairs if np.isfinite(pair[0])] for code, pairs in every.items()}
    stopped = [code for code, pairs in solved.items() if not pairs]
    best = {code: min(pairs) for code, pairs in solved.items() if pairs}
    if not best:
        return f"{case.flow.title}: no code solves it."
    common = max(error for error, _ in best.values())
    took = {code: min(s for error, s in solved[code] if error <= common) for code in best}
    order = sorted(took, key=took.__getitem__)
    smallest = min(error for error, _ in best.values())
    least = min((code for code in best if best[code][0] <= ONE_PER_CENT * smallest), key=lambda code: best[code][1])
    return (
        f"{case.flow.title}: an error of {brief(common)} takes {', '.join(f'{c} {took[c]:.2g} s' for c in order)}; "
        f"the least error is that of {least}, {brief(best[least][0])} in {best[least][1]:.2g} s"
        + (f"; {' and '.join(stopped)} stops at every N." if stopped else ".")
    )


def without(chart: Chart) -> str:
    """State that PySPH is missing on a chart of whole codes, and how to add it; empty if it is there."""
    missing = any(section.codes for section in chart.sections) and "pysph" not in chart.engine
    return "PySPH is not among them: --pysph PYTHON names a Python that has it." if missing else ""
