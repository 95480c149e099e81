"""A run of one engine that can be observed between steps."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any, Protocol

import numpy as np

from eos_ref import InputError
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import MakeEvaluator, Simulation
from eos_ref.model import quantities
from eos_ref.numbers.rounded import value
from lammps_cases.engine import session
from lammps_cases.engine.stepping import Instance, Stepping
from lammps_cases.records.wording import one_line
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import Atoms
from lammps_cases.scene.runs import Expect
from lammps_cases.setup import reference_side
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import Plan, plan
from lammps_cases.studies.flows.flow import Start
from lammps_cases.studies.stability.kinds import Observation
from lammps_cases.studies.stability.model import Engine, FailureCriteria, Kind


class Stopped(RuntimeError):
    """A run that its engine ended: the kind of failure, the engine's message, and the atom (id) if one is known."""

    def __init__(self, kind: Kind, message: str, atom: int | None = None) -> None:
        self.kind, self.message, self.atom = kind, one_line(message), atom
        super().__init__(f"{kind}: {self.message}")

    def __reduce__(self) -> tuple[type[Stopped], tuple[Kind, str, int | None]]:
        return Stopped, (self.kind, self.message, self.atom)


class ObservedRun(Protocol):
    """A run that is at step 0 when it is made, and observed between steps; whatever it does may raise `Stopped`."""

    @property
    def step(self) -> int:
        """Steps taken."""

    def advance(self, steps: int) -> None:
        """Take steps."""

    def look(self) -> Observation:
        """Return the particles now, in arrays that the engine does not change."""


def _observation(step: int, *fields: Any) -> Observation:
    copies: list[Any] = [None if array is None else np.array(array) for array in fields]
    return Observation(step, *copies)


def watched(scene: Scene, watch: FailureCriteria) -> Scene:
    """Return the scene with every observed field among those compared."""
    if not scene.interacts:
        return scene
    wanted = ["x", "v", "rho", "pressure", *(["surface"] if watch.surface else [])]
    return scene.model_copy(update={"compare": tuple(dict.fromkeys([*scene.compare, *wanted]))})


# --- reference


@contextmanager
def _refusals() -> Iterator[None]:
    """Stop a run by what the reference refuses in a block."""
    try:
        yield
    except InputError as error:
        raise Stopped("error", str(error)) from None


class LawRun:
    """A law alone, which acts on given densities."""

    step = 0

    def __init__(self, start: Start) -> None:
        self.start = start
        with _refusals():
            self.eos = start.case.scene.eos()

    def advance(self, steps: int) -> None:
        """Take no steps: nothing moves."""

    def look(self) -> Observation:
        """Return the pressures of the given densities."""
        a, d = self.start.atoms, self.start.case.scene.dimension
        assert a.rho_n is not None
        e_n = None if a.energy_n is None else a.energy_n / a.mass_n
        with _refusals():
            pressure_n = self.eos.pressure(a.rho_n, a.type_n, e_n)
        return _observation(0, a.x_nc[:, :d], _velocities(self.start)[:, :d], a.rho_n, pressure_n, a.energy_n)


class ReferenceRun:
    """The reference, by default with compiled sums; what it refuses stops the run."""

    def __init__(self, start: Start, watch: FailureCriteria, evaluator: MakeEvaluator | None = None) -> None:
        self.start, self.step, self.surface = start, 0, bool(watch.surface)
        scene, atoms, where = start.case.scene, start.atoms, start.case.where
        short = atoms.x_nc.dtype == np.float32  # a layer of `maps.precision`
        make = single_simulation if short else partial(reference_side.simulation, evaluator=evaluator)
        with _refusals():
            stepped = quantities.needed_to_step(reference_side.model(scene, atoms, where))
            self.simulation = make(scene, atoms, (*stepped, *(["surface"] if self.surface else [])), where)
            self._run(0)

    def advance(self, steps: int) -> None:
        """Take steps."""
        try:
            self._run(steps)
        except InputError as error:
            # Positions that are not finite, or far from the box: an observation shows the former.
            lost = bool(np.isfinite(self.simulation.state.x_nc).all()) and error.what == "position"
            raise Stopped("lost particles" if lost else "non-finite", str(error)) from None
        except (ArithmeticError, np.linalg.LinAlgError) as error:
            raise Stopped("error", f"{type(error).__name__}: {error}") from None
        self.step += steps

    def _run(self, steps: int) -> None:
        with np.errstate(all="ignore"):
            self.simulation.run(steps, self.start.timestep)

    def look(self) -> Observation:
        """Return the state now, also of a run that has stopped."""
        s, surface_n = self.simulation.state, self.simulation.fields.get("surface") if self.surface else None
        with np.errstate(all="ignore"):
            pressure_n = self.simulation.output("pressure")
        return _observation(self.step, s.x_nc, s.v_nc, s.rho_n, pressure_n, s.energy_n, surface_n)


# --- the reference in float32: the same stages, of arrays half as long


class Single(ArrayEvaluator):
    """Stages in float32. Pairs are found, and positions subtracted, in float64; the results are rounded."""

    def of_type(self, values_t: Iterable[Any]) -> Any:
        """See `Evaluator.of_type`."""
        return super().of_type(values_t).astype(np.float32)

    def move(self, x_nc: Any) -> None:
        """See `ArrayEvaluator.move`."""
        super().move(x_nc)
        self.x = [value(x_p).astype(np.float32) for x_p in self.x]
        self.rr, self.r, self.w = (value(array).astype(np.float32) for array in (self.rr, self.r, self.w))
        self.gradw = [value(g_p).astype(np.float32) for g_p in self.gradw]
        self.g = self.gradw

    def eos_pressure(self, rho_n: Any, e_n: Any) -> Any:
        """See `Evaluator.eos_pressure`; the laws in the number type of the density."""
        pressure_n = np.empty_like(rho_n)
        for t, law in enumerate(self.model.eos, 1):
            mine = self.type_n == t
            pressure_n[mine] = law.evaluate(rho_n[mine], None if e_n is None else e_n[mine])
        return pressure_n

    def diffusion(self, *fields: Any) -> Any:
        """See `ArrayEvaluator.diffusion`."""
        return value(super().diffusion(*fields)).astype(np.float32)


def single_simulation(scene: Scene, atoms: Atoms, fields: Iterable[str] = (), where: str = "") -> Simulation:
    """Return the reference of a scene whose particles are given in float32."""
    sim = reference_side.simulation(scene, atoms, fields, where, Single)
    sim.mass_n, sim.other_nc = sim.mass_n.astype(np.float32), sim.other_nc.astype(np.float32)
    return sim


# --- LAMMPS


# Words in LAMMPS' errors that belong to a kind of their own.
SAYINGS: tuple[tuple[str, Kind], ...] = (
    ("Lost atoms", "lost particles"),
    ("lost", "lost particles"),
    ("Out of range atoms", "lost particles"),
    ("Non-numeric", "non-finite"),
)


def saying(error: str) -> Kind:
    """Return the kind of an error of LAMMPS, by its text."""
    return next((kind for words, kind in SAYINGS if words in error), "error")


class LammpsRun:
    """LAMMPS itself; its errors stop the run."""

    def __init__(self, start: Start, watch: FailureCriteria, instance: Instance) -> None:
        self.start, self.instance, scene = start, instance, watched(start.case.scene, watch)
        whole = job(scene, start.atoms, _planned(scene))
        with _stopping(instance) as lmp:
            self.stepping = Stepping(lmp, whole)
            self.stepping.begin()

    @property
    def step(self) -> int:
        """Steps taken."""
        return self.stepping.step

    def advance(self, steps: int) -> None:
        """Take steps."""
        try:
            with _stopping(self.instance):
                self.stepping.advance(steps)
        except Stopped as stop:
            if stop.kind == "lost particles" and self.instance.is_open:
                missing = np.setdiff1d(self.start.atoms.id_n, session.read(self.stepping.lmp)["id"])
                stop.atom = int(missing[0]) if missing.size else None
            raise

    def look(self) -> Observation:
        """Return LAMMPS' arrays by id."""
        with _stopping(self.instance):
            arrays = self.stepping.read()
        wrong = self.stepping.lost(arrays["id"])
        if wrong.size:
            raise Stopped("lost particles", f"{wrong.size} of {len(self.start.atoms)} atoms", int(wrong[0]))
        d, v_nc = self.start.case.scene.dimension, arrays["v"] if "v" in arrays else _velocities(self.start)
        fields = arrays["x"][:, :d], v_nc[:, :d], arrays["rho"], arrays["q.pressure"]
        return _observation(self.step, *fields, arrays.get("esph"), arrays.get("q.surface"))


def _velocities(start: Start) -> Any:
    """Return the velocities given, shape (n, 3)."""
    return np.zeros(start.atoms.x_nc.shape) if start.atoms.v_nc is None else start.atoms.v_nc


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
    """Return the run of a start on an engine."""
    if side == "lammps":
        return LammpsRun(start, watch, instance)
    return ReferenceRun(start, watch) if start.case.scene.interacts else LawRun(start)
