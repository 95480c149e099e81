"""Run validations: every flow at its resolutions on the reference and on LAMMPS, and the effect of each finding."""

from __future__ import annotations

import functools
import hashlib
import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from eos_ref import InputError
from lammps_cases.comparison import store
from lammps_cases.engine import installations
from lammps_cases.engine.installations import library_sha256
from lammps_cases.engine.workers import Workers
from lammps_cases.findings.entry import Finding
from lammps_cases.records.journal import Parts
from lammps_cases.records.measure import machine
from lammps_cases.records.progress import SILENT, Progress
from lammps_cases.setup.twins import Scale, rescaled, rescaled_atoms
from lammps_cases.studies.flows import page, record
from lammps_cases.studies.flows.flow import Snapshot, Start
from lammps_cases.studies.flows.known import Flow
from lammps_cases.studies.flows.record import LAMMPS, REFERENCE, START, UNIT, FlowRecord, Lost, Validated
from lammps_cases.studies.flows.solve import FlowResult, ReferenceFlow, by_reference, in_worker

LIMIT = 3600.0  # seconds for one run
SPACING = 0.75  # between particles, in another unit of length
STARTS, DISPLACED = 2, 0.05  # further starts for the error bar; their displacement in spacings
STRIDE = 10  # steps between snapshots
PATIENCE = 1.25  # the reference may take this many times the steps of LAMMPS


@dataclass(frozen=True)
class FlowTask:
    """A flow to be run at a resolution by one side; ``explained``: whether a loss of atoms by LAMMPS is explained."""

    of: Flow
    n: int
    side: str
    solve: Callable[[Start], FlowResult]
    explained: bool = False


def validate(
    chosen: Sequence[Flow],
    out: Path,
    command: str,
    *,
    quick: bool = False,
    full: bool = False,
    engine: str = "env",
    progress: Progress = SILENT,
) -> Validated:
    """Run validations, and write document and page after each; runs in the folder are not repeated.

    Raises
    ------
    InputError
        No such engine.
    EngineMissing
    """
    site, begin, before = installations.resolve(engine).site, time.perf_counter(), machine()
    kept, runs = record.journal(out), list[FlowRecord]()
    with ThreadPoolExecutor(1) as thread, Workers(site, 1) as workers:
        about = workers.identify().result()
        about["library_sha256"] = library_sha256(about.pop("library", ""))
        tasks = [task for of in chosen for task in _tasks(of, quick, full, workers)]
        for k, (task, key, run) in enumerate(_in_turn(tasks, kept, about, thread)):
            ran = kept.get(key)
            if ran is None:
                progress.advance(k, len(tasks), f"{task.of.name}, {task.n}, {task.side}")
                ran = kept.add(key, run())
            runs.append(ran)
    progress.advance(len(tasks), len(tasks), "report")
    seconds = time.perf_counter() - begin + kept.earlier
    validated = Validated(command, before, about, quick, seconds, tuple(runs), time.strftime("%Y-%m-%d"))
    page.write(validated, out)
    return validated


def _in_turn(
    tasks: Iterable[FlowTask], kept: Parts[FlowRecord], about: dict[str, Any], thread: Executor
) -> Iterator[tuple[FlowTask, str, Callable[[], FlowRecord]]]:
    """Yield tasks with their keys and runs; LAMMPS begins with the next one in another thread."""

    def begin(task: FlowTask) -> tuple[FlowTask, str, Callable[[], FlowRecord]]:
        start = task.of.start(task.n, task.of.options)
        key, run = _key(task, start, about), partial(_run, task, start)
        waits = task.side in (LAMMPS, UNIT) and kept.get(key) is None
        return task, key, thread.submit(run).result if waits else run

    ahead = map(begin, tasks)
    following = next(ahead, None)
    while following:
        current, following = following, next(ahead, None)
        yield current


def _tasks(of: Flow, quick: bool, full: bool, workers: Workers) -> Iterator[FlowTask]:
    """Yield both sides at every resolution; unless quick also set-ups, and at the coarsest starts, findings, a unit."""
    resolutions = (of.quick or of.resolutions[:1]) if quick else (*of.resolutions, *(of.full if full else ()))
    lammps = partial(in_worker, workers=workers, time_limit=LIMIT)
    for n in resolutions:
        yield FlowTask(of, n, REFERENCE, by_reference)
        yield FlowTask(of, n, LAMMPS, lammps, n == resolutions[0])
    if not quick:
        for name, options in of.setups.items():
            other = replace(of, options=options)
            yield from (FlowTask(other, n, f"{REFERENCE}, {name}", by_reference) for n in of.resolutions)
        if of.quantities:
            starts = range(1, STARTS + 1)
            yield from (FlowTask(of, resolutions[0], f"{START}{k}", partial(_displaced, k)) for k in starts)
        first = of.start(resolutions[0], of.options)
        if any(first.steps) and first.body is None:  # whose formulas are in the first unit
            yield FlowTask(of, resolutions[0], UNIT, partial(_in_another_unit, solve=lammps))
        for finding in of.findings:
            yield FlowTask(of, resolutions[0], finding.id, partial(_with, finding))


def _displaced(k: int, start: Start) -> FlowResult:
    """Run a flow on the reference from another start: the fluid displaced by up to a twentieth of a spacing."""
    atoms, d = start.atoms, start.case.scene.dimension
    fluid_n = np.array([kind.phase == "fluid" for kind in start.case.scene.types])[atoms.type_n - 1]
    by_nc = np.random.default_rng(k).uniform(-DISPLACED, DISPLACED, (len(atoms), d))
    x_nc = atoms.x_nc.copy()
    x_nc[:, :d] += np.where(fluid_n[:, None], by_nc, 0.0)
    edge_c = np.where(atoms.periodic, np.array(atoms.high_c) - atoms.low_c, np.inf)
    x_nc = np.where(np.isinf(edge_c), x_nc, atoms.low_c + np.mod(x_nc - atoms.low_c, edge_c))
    return by_reference(replace(start, atoms=replace(atoms, x_nc=x_nc)))


def _with(finding: Finding, start: Start) -> FlowResult:
    """Run a flow on the reference with a finding of LAMMPS."""
    variant = finding.model_variant
    assert variant is not None and variant.stages is not None
    return by_reference(start, variant.stages)


def _in_another_unit(start: Start, solve: Callable[[Start], FlowResult]) -> FlowResult:
    """Run a flow in other units of length and time; snapshots are in the first ones."""
    case, scale = start.case, Scale.of_size(SPACING, start.case.scene.dimension)
    cut = case.scene.rheo.cut
    assert cut is not None
    other = Start(
        replace(case, scene=rescaled(case.scene, scale, cut)),
        rescaled_atoms(start.atoms, scale),
        start.steps,
        start.timestep * scale.of("time"),
    )
    result = solve(other)
    return replace(result, snapshots=tuple(_back(shot, scale) for shot in result.snapshots))


def _back(shot: Snapshot, scale: Scale) -> Snapshot:
    """Return a snapshot in the first units; velocities, densities and pressures are the same."""
    return replace(shot, time=shot.time / scale.of("time"), x_nc=shot.x_nc / scale.of("x"))


def _key(task: FlowTask, start: Start, about: dict[str, Any]) -> str:
    """Hash all that a run depends on: sources, start, side, and LAMMPS' description."""
    a, lammps = start.atoms, repr(sorted(about.items())) if task.side.startswith(LAMMPS) else ""
    arrays = (a.type_n, a.x_nc, a.v_nc, a.rho_n, a.energy_n, a.low_c, a.high_c)
    problem = start.case.scene.model_dump_json(), start.steps, start.timestep, start.body.formulas if start.body else ()
    return store.fingerprint(_sources(), problem, task.side, SPACING, lammps, arrays)


@functools.cache
def _sources() -> str:
    """Hash the code that determines runs and their reading, with the reference and its libraries."""
    digest = hashlib.sha256(store.context().encode())
    package = Path(__file__).parents[2]
    for room in ("scene", "setup", "engine", "studies/flows"):
        for path in sorted((package / room).glob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()


def _solved(task: FlowTask, start: Start) -> FlowResult:
    """Run a task; a loss of particles becomes the message, in the reference as in LAMMPS."""
    try:
        return task.solve(start)
    except InputError as error:
        return FlowResult((), math.nan, len(start.atoms), 0, str(error))


def _run(task: FlowTask, start: Start) -> FlowRecord:
    result = _solved(task, start)
    explained = explain(start, task.solve, task.of.findings) if task.explained and result.lost else None
    return record.recorded(task.of, task.n, task.side, result, explained)


# --- particles that LAMMPS loses


def explain(start: Start, lammps: Callable[[Start], FlowResult], findings: Sequence[Finding]) -> Lost:
    """Return LAMMPS' last step with all particles, and the first findings with which the reference loses some.

    Findings are tried each alone, then all together.
    """
    looks = range(STRIDE, start.steps[-1] + 1, STRIDE)
    step = lammps(replace(start, steps=tuple(looks))).steps
    for entries in _sets(findings):
        after = last_with_all(start, entries, min(int(PATIENCE * step), start.steps[-1]))
        if after is not None:
            return Lost(step, tuple(entry.id for entry in entries), after)
    return Lost(step)


def _sets(findings: Sequence[Finding]) -> Iterator[tuple[Finding, ...]]:
    yield from ((entry,) for entry in findings)
    if len(findings) > 1:
        yield tuple(findings)


def last_with_all(start: Start, findings: Sequence[Finding], steps: int) -> int | None:
    """Return the last step at which the reference with findings has all particles; None if it keeps them."""
    stages: list[Any] = [entry.model_variant.stages for entry in findings if entry.model_variant]
    run = ReferenceFlow(start, type("Together", tuple(stages), {}) if stages else None)
    with np.errstate(all="ignore"):
        while run.step < steps:
            run.advance(STRIDE)
            if gone(start, run.snapshot()):
                return run.step - STRIDE
    return None


def gone(start: Start, shot: Snapshot) -> bool:
    """Return whether a particle is beyond an open face of the box, or not at a finite position."""
    d = shot.x_nc.shape[1]
    fixed_c = ~np.array(start.atoms.periodic[:d])
    low_c, high_c = np.array(start.atoms.low_c)[:d][fixed_c], np.array(start.atoms.high_c)[:d][fixed_c]
    x_nc = shot.x_nc[:, fixed_c]
    inside = (x_nc >= low_c) & (x_nc <= high_c)
    return not (inside.all() and np.isfinite(shot.x_nc).all() and np.isfinite(shot.v_nc).all())
