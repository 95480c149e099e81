"""A flow on the reference or on LAMMPS: set up, stepped and read."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.evaluation.time_step import MakeEvaluator, Simulation
from eos_ref.model import quantities
from eos_ref.numbers.number import Array
from lammps_cases.engine.session import EngineBroken, EngineRefused, Session, kept
from lammps_cases.engine.workers import Failure, Workers
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import IntArray
from lammps_cases.scene.fields import FIELDS
from lammps_cases.setup import reference_side
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import Plan, plan
from lammps_cases.studies.flows.flow import ALWAYS, Body, Snapshot, Start


class FlowRun(Protocol):
    """A flow on one engine, set up when it is made."""

    @property
    def step(self) -> int:
        """Steps taken."""

    def advance(self, steps: int) -> None:
        """Take steps."""

    def snapshot(self) -> Snapshot:
        """Return the particles now, in arrays that the engine does not change."""


class Driven(Simulation):
    """A simulation whose fluid is subject to a `Body` force, and some of whose particles keep their energy."""

    flow: Start

    def _external(self, force_nc: Array) -> Array:
        """Add the force of the body, and those of other fixes; take the heat from particles that keep their energy."""
        if self.flow.held and not self.fresh:  # fix add/heat acts in time steps, not in a set-up
            held_n = np.isin(self.state.type_n, self.flow.held)
            self.fields["heatflow"] = np.where(held_n, 0.0, self.fields["heatflow"])
        if self.flow.body:
            added_nc = self.flow.body.force(self.mass_n, self.state.x_nc, self.fields.get("temperature"))
            force_nc = force_nc + np.where(self.state.solid_n[:, None], 0.0, added_nc)
        return super()._external(force_nc)


class ReferenceFlow:
    """A flow on the reference, by default compiled. Classes of surfaces are evaluated if ``surface``."""

    def __init__(self, start: Start, evaluator: MakeEvaluator | None = None, surface: bool = False) -> None:
        self.start, self.step = start, 0
        self.more = tuple(more(start.case.scene))
        wanted: tuple[str, ...] = ()  # fields that a step needs
        if surface or self.more:
            model = reference_side.model(start.case.scene, start.atoms, start.case.where)
            wanted = (*quantities.needed_to_step(model), *dict.fromkeys((*["surface"] * surface, *self.more)))
        self.simulation = self.make(wanted, evaluator)
        if isinstance(self.simulation, Driven):
            self.simulation.flow = start
        self._run(0)

    def make(self, fields: Iterable[str], evaluator: MakeEvaluator | None) -> Simulation:
        """Return the simulation that is stepped."""
        case, stepping = self.start.case, Driven if self.start.body or self.start.held else Simulation
        return reference_side.simulation(case.scene, self.start.atoms, fields, case.where, evaluator, stepping)

    def advance(self, steps: int) -> None:
        """Take steps."""
        self._run(steps)
        self.step += steps

    def _run(self, steps: int) -> None:
        with np.errstate(all="ignore"):
            self.simulation.run(steps, self.start.timestep)

    def snapshot(self) -> Snapshot:
        """Return the particles now, also of a run that failed in the middle of a step."""
        sim = self.simulation
        names = ("x", "v", "rho", "pressure", *(["energy"] if sim.state.energy_n is not None else []))
        with np.errstate(all="ignore"):
            fields = {name: sim.output(name) for name in (*names, *self.more)} | {"surface": sim.fields.get("surface")}
            return snapshot(self.start, self.step, fields)


class AtomsLost(EngineRefused):
    """Atoms that LAMMPS lost without an error, by their ``ids``."""

    def __init__(self, ids: IntArray, natoms: int) -> None:
        super().__init__(f"LAMMPS lost {ids.size} of {natoms} atoms, first id {ids[0]}")
        self.ids, self.natoms = ids, natoms


class LammpsFlow:
    """A flow in a session of LAMMPS, held there until another begins.

    Raises
    ------
    EngineRefused
        LAMMPS' error, when made or in any method.
    """

    finite = True  # whether positions and velocities must be finite

    def __init__(self, start: Start, session: Session, scene: Scene | None = None, order: Plan | None = None) -> None:
        scene = scene or start.case.scene
        self.start, self.session = start, session
        whole = job(scene, start.atoms, order or plan(scene))
        if start.body:
            whole = replace(whole, commands=(*whole.commands, *_body(start.body, scene)))
        if start.held:
            keep = (
                f"group held type {' '.join(map(str, start.held))}",
                "fix keep held add/heat constant 0 overwrite yes",
            )
            whole = replace(whole, commands=(*whole.commands, *keep))
        session.begin(whole)

    @property
    def step(self) -> int:
        """Steps taken."""
        return self.session.step

    def advance(self, steps: int) -> None:
        """Take steps."""
        self.session.advance(steps)

    def snapshot(self) -> Snapshot:
        """Return the particles now.

        Raises
        ------
        AtomsLost
        EngineRefused
            A position or velocity is not finite.
        """
        arrays = self.session.read()
        lost = np.setxor1d(arrays["id"], self.start.atoms.id_n)
        if lost.size:
            raise AtomsLost(lost, len(self.start.atoms))
        if self.finite and not (np.isfinite(arrays["x"]).all() and np.isfinite(arrays["v"]).all()):
            raise EngineRefused("a position or velocity of LAMMPS is no finite number")
        names = {"pressure": "q.pressure", "energy": "esph", "surface": "q.surface"}
        read = {ours: arrays[name] for ours, name in names.items() if name in arrays}
        scene = self.start.case.scene
        return snapshot(
            self.start,
            self.step,
            arrays | read | {name: FIELDS[name].of(arrays, scene.dimension) for name in more(scene)},
        )

    def lost(self) -> IntArray:
        """Return the ids of lost atoms, also after an error."""
        return self.session.lost()


def _body(body: Body, scene: Scene) -> Iterator[str]:
    """Yield the commands of a body's force: fix addforce by atom-style variables, on the types that are fluid."""
    yield f"group fluid type {' '.join(str(k) for k, t in enumerate(scene.types, 1) if t.phase == 'fluid')}"
    if body.warm:
        yield "compute warm all rheo/property/atom temperature"
    for axis, formula in zip("xy", body.formulas, strict=True):
        yield f'variable body_{axis} atom "{formula}"'
    yield "fix body fluid addforce v_body_x v_body_y 0.0"


def more(scene: Scene) -> Iterator[str]:
    """Yield the fields that a scene compares beyond those of every flow."""
    return (name for name in scene.compare if name not in (*ALWAYS, "energy"))


def snapshot(start: Start, step: int, fields: Mapping[str, Any]) -> Snapshot:
    """Return copies of two-dimensional or three-dimensional arrays by the reference's names."""
    d, v_nc = start.case.scene.dimension, fields.get("v", start.atoms.v_nc)
    energy_n = None if fields.get("energy") is None else np.array(fields["energy"])
    return Snapshot(
        step,
        np.array(fields["x"][:, :d]),
        np.zeros((len(start.atoms), d)) if v_nc is None else np.array(v_nc[:, :d]),
        np.array(fields["rho"]),
        np.array(fields["pressure"]),
        energy_n,
        None if fields.get("surface") is None else np.array(fields["surface"]),
        step * start.timestep,
        None if energy_n is None else energy_n / _heat_capacity(start),
        {name: np.array(fields[name]) for name in more(start.case.scene)},
    )


def _heat_capacity(start: Start) -> FloatArray:
    """Return the mass times specific heat."""
    specific: FloatArray = np.array([t.specific_heat for t in start.case.scene.types])[start.atoms.type_n - 1]
    return specific * start.atoms.mass_n


@dataclass(frozen=True)
class FlowResult:
    """Outcome of a flow: snapshots, processor time of its steps, particles, steps taken.

    For a failed run also the error, and whether particles were lost.
    """

    snapshots: tuple[Snapshot, ...]
    seconds: float
    n: int
    steps: int
    message: str = ""
    lost: bool = False


def by_reference(start: Start, evaluator: Callable[..., Any] | None = None) -> FlowResult:
    """Run a flow on the reference, by default on its compiled evaluator."""
    ReferenceFlow(start, evaluator).advance(1)  # compiles
    return _timed(start, lambda: ReferenceFlow(start, evaluator))


def by_lammps(start: Start, session: Session) -> FlowResult:
    """Run a flow on LAMMPS; an error of LAMMPS, or lost atoms, become the message.

    Raises
    ------
    EngineBroken
    """
    return _timed(start, lambda: LammpsFlow(start, session))


def _timed(start: Start, begin: Callable[[], FlowRun]) -> FlowResult:
    """Return the snapshots at the steps of a flow, with the processor time of the steps alone: of one core."""
    snapshots, seconds, done, message, lost = [], 0.0, 0, "", False
    run = None
    try:
        run = begin()
        for step in start.steps:
            before = time.process_time()
            if step > done:
                run.advance(step - done)
            seconds += time.process_time() - before
            snapshots.append(run.snapshot())
            done = step
    except EngineBroken:
        raise
    except EngineRefused as error:
        message, lost = " ".join(str(error).split()), isinstance(run, LammpsFlow) and bool(run.lost().size)
    return FlowResult(tuple(snapshots), seconds, len(start.atoms), done, message, lost)


def solve(site: str | None, start: Start) -> FlowResult:
    """Run a flow on the LAMMPS of a worker process."""
    return by_lammps(start, kept(site))


def in_worker(start: Start, workers: Workers, time_limit: float = 600.0) -> FlowResult:
    """Run a flow on LAMMPS in a separate process, whose death becomes the message."""
    outcome = workers.outcome(workers.call(solve, start, time_limit=time_limit))
    return FlowResult((), np.nan, len(start.atoms), 0, outcome.message) if isinstance(outcome, Failure) else outcome


@dataclass(frozen=True)
class Fit:
    """Order of convergence, minus the slope of log error over log resolution by least squares; its standard error."""

    order: float
    standard_error: float


def fit(resolutions: Sequence[int], errors: Sequence[float]) -> Fit:
    """Fit the order of finite errors other than 0; NaN for fewer than two, no standard error for fewer than three."""
    x, y = np.log(np.array(resolutions, float)), np.array(errors, float)
    usable = np.isfinite(y) & (y > 0)
    x, y = x[usable], np.log(y[usable])
    if len(x) < 3:
        return Fit(-float(np.diff(y)[0] / np.diff(x)[0]) if len(x) == 2 else np.nan, np.nan)
    # scipy's linregress takes the error from 1 - r^2, which leaves half the digits of a fit that is nearly exact.
    (slope, _), covariance = np.polyfit(x, y, 1, cov=True)
    return Fit(-float(slope), float(np.sqrt(covariance[0, 0])))
