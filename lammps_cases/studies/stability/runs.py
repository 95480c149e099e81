"""A run of one engine that stops to be looked at, and can be taken up again from the look before."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Protocol

import numpy as np

from eos_ref import InputError
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model import quantities
from lammps_cases.engine import session
from lammps_cases.engine.stepping import Instance, Stepping
from lammps_cases.records.wording import one_line
from lammps_cases.scene import Scene
from lammps_cases.scene.runs import Expect
from lammps_cases.setup import reference_side
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import Plan, plan
from lammps_cases.studies.flows.flow import Start
from lammps_cases.studies.stability import single
from lammps_cases.studies.stability.kinds import Observation
from lammps_cases.studies.stability.model import Engine, FailureCriteria, Kind


class Stopped(RuntimeError):
    """A run that its engine ended: how that is called, what the engine said, and the atom (id) if one is known."""

    def __init__(self, kind: Kind, message: str, atom: int | None = None) -> None:
        self.kind, self.message, self.atom = kind, one_line(message), atom
        super().__init__(f"{kind}: {self.message}")

    def __reduce__(self) -> tuple[type[Stopped], tuple[Kind, str, int | None]]:
        return Stopped, (self.kind, self.message, self.atom)


class ObservedRun(Protocol):
    """A run that stops to be looked at.

    `look`, `begin` and `advance` raise `Stopped`.
    """

    step: int

    def begin(self) -> None:
        """Set up, to step 0."""

    def advance(self, steps: int) -> None:
        """Take steps."""

    def look(self) -> Observation:
        """Return the particles now."""

    def back(self) -> None:
        """Return to where the last stretch began."""


def again(run: ObservedRun, stretches: Sequence[int]) -> None:
    """Run from the start through the same stretches: the same bits."""
    run.begin()
    for steps in stretches:
        run.advance(steps)


def watched(scene: Scene, watch: FailureCriteria) -> Scene:
    """Return the scene with every observed field among those compared."""
    if not scene.interacts:
        return scene
    wanted = ["x", "v", "rho", "pressure", *(["surface"] if watch.surface else [])]
    return scene.model_copy(update={"compare": tuple(dict.fromkeys([*scene.compare, *wanted]))})


def _copied(step: int, *fields: Any) -> Observation:
    """Return an observation that shares no array with the engine."""
    copies: list[Any] = [None if array is None else np.array(array) for array in fields]
    return Observation(step, *copies)


# --- reference


class LawRun:
    """A law alone, which acts on given densities: step 0 is all of it."""

    step = 0

    def __init__(self, start: Start) -> None:
        self.start = start

    def begin(self) -> None:
        """Resolve the laws, which may be refused."""
        try:
            self.eos = self.start.case.scene.eos()
        except InputError as error:
            raise Stopped("error", str(error)) from None

    def advance(self, steps: int) -> None:
        """Nothing moves."""

    def look(self) -> Observation:
        """Return the pressures of the densities given."""
        a = self.start.atoms
        assert a.rho_n is not None
        e_n = None if a.energy_n is None else a.energy_n / a.mass_n
        try:
            pressure_n = self.eos.pressure(a.rho_n, a.type_n, e_n)
        except InputError as error:
            raise Stopped("error", str(error)) from None
        d = self.start.case.scene.dimension
        v_nc = np.zeros(a.x_nc.shape) if a.v_nc is None else a.v_nc
        return Observation(0, a.x_nc[:, :d], v_nc[:, :d], a.rho_n, pressure_n, a.energy_n)

    def back(self) -> None:
        """Nothing moves."""


class ReferenceRun:
    """The compiled reference; what it refuses stops the run."""

    def __init__(self, start: Start, watch: FailureCriteria) -> None:
        self.start, self.step = start, 0
        self.fields = ("surface",) if watch.surface else ()
        self._stretches: list[int] = []

    def begin(self) -> None:
        """Set up and evaluate once."""
        from eos_ref.compiled.evaluator import CompiledEvaluator

        self.step, self._stretches = 0, []
        scene, atoms, where = self.start.case.scene, self.start.atoms, self.start.case.where
        try:
            model, box = reference_side.model(scene, atoms, where), reference_side.box(scene, atoms)
            state = reference_side.state(scene, atoms, where)
            fields = (*quantities.needed_to_step(model), *self.fields)
            short = state.x_nc.dtype == np.float32  # a layer of `maps.precision`
            self.simulation = (
                single.simulation(model, box, state, fields)
                if short
                else Simulation(model, box, state, fields, CompiledEvaluator)
            )
            self._run(0)
        except InputError as error:
            raise Stopped("error", str(error)) from None

    def advance(self, steps: int) -> None:
        """Take steps."""
        self._stretches.append(steps)
        try:
            self._run(steps)
        except InputError as error:
            # Positions that are no numbers, or far from the box: the look tells the former.
            gone = bool(np.isfinite(self.simulation.state.x_nc).all()) and "near the box" in str(error)
            raise Stopped("lost particles" if gone else "non-finite", str(error)) from None
        except (ArithmeticError, np.linalg.LinAlgError) as error:
            raise Stopped("error", f"{type(error).__name__}: {error}") from None
        self.step += steps

    def _run(self, steps: int) -> None:
        with np.errstate(all="ignore"):
            self.simulation.run(steps, self.start.timestep)

    def look(self) -> Observation:
        """Return the state now, also of a run that has stopped."""
        simulation = self.simulation
        s = simulation.state
        with np.errstate(all="ignore"):
            pressure_n = simulation.output("pressure")
        surface_n = simulation.fields.get("surface") if self.fields else None
        fields = s.x_nc, s.v_nc, s.rho_n, pressure_n, s.energy_n, surface_n
        return _copied(self.step, *fields)

    def back(self) -> None:
        """Run again, up to the last stretch."""
        again(self, self._stretches[:-1])


# --- LAMMPS


# How LAMMPS calls what has another name here.
SAYINGS: tuple[tuple[str, Kind], ...] = (
    ("Lost atoms", "lost particles"),
    ("lost", "lost particles"),
    ("Out of range atoms", "lost particles"),
    ("Non-numeric", "non-finite"),
)


def saying(error: str) -> Kind:
    """Classify an error of LAMMPS by its text."""
    return next((kind for words, kind in SAYINGS if words in error), "error")


class LammpsRun:
    """LAMMPS itself; its errors stop the run."""

    def __init__(self, start: Start, watch: FailureCriteria, instance: Instance) -> None:
        self.start, self.instance, self.step = start, instance, 0
        scene = watched(start.case.scene, watch)
        self.job = job(scene, start.atoms, _planned(scene))
        self.dimension = scene.dimension
        self._stretches: list[int] = []

    def begin(self) -> None:
        """Set up, run 0."""
        self.step, self._stretches = 0, []
        with _stopping(self.instance) as lmp:
            self.stepping = Stepping(lmp, self.job)
            self.stepping.begin()

    def advance(self, steps: int) -> None:
        """Take steps."""
        self._stretches.append(steps)
        try:
            with _stopping(self.instance):
                self.stepping.advance(steps)
        except Stopped as stop:
            if stop.kind == "lost particles" and self.instance.is_open:
                stop.atom = self._missing()
            raise
        self.step += steps

    def _missing(self) -> int | None:
        """Return the first id that LAMMPS no longer has."""
        missing = np.setdiff1d(self.start.atoms.id_n, session.read(self.stepping.lmp)["id"])
        return int(missing[0]) if missing.size else None

    def look(self) -> Observation:
        """LAMMPS' arrays by id."""
        with _stopping(self.instance):
            arrays = self.stepping.read()
        wrong = self.stepping.lost(arrays["id"])
        if wrong.size:
            raise Stopped("lost particles", f"{wrong.size} of {len(self.start.atoms)} atoms", int(wrong[0]))
        d, a = self.dimension, self.start.atoms
        v_nc = arrays.get("v", np.zeros(a.x_nc.shape) if a.v_nc is None else a.v_nc)
        fields = arrays["x"][:, :d], v_nc[:, :d], arrays["rho"], arrays["q.pressure"]
        more = arrays.get("esph"), arrays.get("q.surface")
        return _copied(self.step, *fields, *more)

    def back(self) -> None:
        """Run again, up to the last stretch."""
        again(self, self._stretches[:-1])


def _planned(scene: Scene) -> Plan:
    """Return the plan of a scene, also of one that the reference refuses."""
    try:
        return plan(scene)
    except InputError as error:
        return plan(scene.model_copy(update={"expect": Expect(refused=str(error))}))


@contextmanager
def _stopping(instance: Instance) -> Iterator[Any]:
    """Give LAMMPS to a block; its errors become `Stopped`, any other is this project's own."""
    try:
        with instance.use() as lmp:
            yield lmp
    except session.EngineRefused as error:
        raise Stopped(saying(str(error)), str(error)) from None


def open_run(start: Start, watch: FailureCriteria, side: Engine, instance: Instance) -> ObservedRun:
    """Return the run of a start on an engine, not begun."""
    if side == "lammps":
        return LammpsRun(start, watch, instance)
    return ReferenceRun(start, watch) if start.case.scene.interacts else LawRun(start)
