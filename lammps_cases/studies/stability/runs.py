"""Runs of one engine, observed between steps; any early end raises `Stopped`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from eos_ref import InputError
from eos_ref.evaluation.time_step import MakeEvaluator
from lammps_cases.engine.session import EngineRefused, Session
from lammps_cases.records.wording import one_line
from lammps_cases.scene import Scene
from lammps_cases.scene.runs import Expect
from lammps_cases.setup.plan import Plan, plan
from lammps_cases.studies.flows.flow import Snapshot, Start
from lammps_cases.studies.flows.solve import AtomsLost, FlowRun, LammpsFlow, ReferenceFlow, snapshot
from lammps_cases.studies.stability.model import Engine, FailureCriteria, Kind


class Stopped(RuntimeError):
    """A run ended by its engine: the kind of failure, the engine's message, and the atom (id) if known."""

    def __init__(self, kind: Kind, message: str, atom: int | None = None) -> None:
        self.kind, self.message, self.atom = kind, one_line(message), atom
        super().__init__(f"{kind}: {self.message}")

    def __reduce__(self) -> tuple[type[Stopped], tuple[Kind, str, int | None]]:
        return Stopped, (self.kind, self.message, self.atom)


def watched(scene: Scene, watch: FailureCriteria) -> Scene:
    """Return the scene with every observed field among those compared."""
    if not scene.interacts:
        return scene
    wanted = ["x", "v", "rho", "pressure", *(["surface"] if watch.surface else [])]
    return scene.model_copy(update={"compare": tuple(dict.fromkeys([*scene.compare, *wanted]))})


# --- reference


@contextmanager
def _refusals() -> Iterator[None]:
    """Stop a run if the reference refuses something in a block."""
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

    def snapshot(self) -> Snapshot:
        """Return the pressures of the given densities."""
        a = self.start.atoms
        assert a.rho_n is not None
        e_n = None if a.energy_n is None else a.energy_n / a.mass_n
        with _refusals():
            pressure_n = self.eos.pressure(a.rho_n, a.type_n, e_n)
        return snapshot(self.start, 0, {"x": a.x_nc, "rho": a.rho_n, "pressure": pressure_n, "energy": a.energy_n})


class ReferenceRun(ReferenceFlow):
    """The reference, by default with compiled sums; its refusals stop the run."""

    def __init__(self, start: Start, watch: FailureCriteria, evaluator: MakeEvaluator | None = None) -> None:
        with _refusals():
            super().__init__(start, evaluator, bool(watch.surface))

    def advance(self, steps: int) -> None:
        """Take steps."""
        try:
            super().advance(steps)
        except InputError as error:
            # Positions are not finite, or far from the box: an observation shows the former.
            lost = bool(np.isfinite(self.simulation.state.x_nc).all()) and error.what == "position"
            raise Stopped("lost particles" if lost else "non-finite", str(error)) from None
        except (ArithmeticError, np.linalg.LinAlgError) as error:
            raise Stopped("error", f"{type(error).__name__}: {error}") from None


# --- LAMMPS


# Words in LAMMPS' errors that identify a kind.
SAYINGS: tuple[tuple[str, Kind], ...] = (
    ("Lost atoms", "lost particles"),
    ("lost", "lost particles"),
    ("Out of range atoms", "lost particles"),
    ("Non-numeric", "non-finite"),
)


def saying(error: str) -> Kind:
    """Return the kind of an error of LAMMPS, by its text."""
    return next((kind for words, kind in SAYINGS if words in error), "error")


class LammpsRun(LammpsFlow):
    """LAMMPS itself; its errors stop the run."""

    finite = False

    def __init__(self, start: Start, watch: FailureCriteria, session: Session) -> None:
        scene = watched(start.case.scene, watch)
        with _errors():
            super().__init__(start, session, scene, _planned(scene))

    def advance(self, steps: int) -> None:
        """Take steps."""
        try:
            with _errors():
                super().advance(steps)
        except Stopped as stop:
            if stop.kind == "lost particles" and self.session.is_open:
                lost = self.lost()
                stop.atom = int(lost[0]) if lost.size else None
            raise

    def snapshot(self) -> Snapshot:
        """See `LammpsFlow.snapshot`."""
        with _errors():
            return super().snapshot()


def _planned(scene: Scene) -> Plan:
    """Return the plan of a scene, even if the reference refuses it."""
    try:
        return plan(scene)
    except InputError as error:
        return plan(scene.model_copy(update={"expect": Expect(refused=str(error))}))


@contextmanager
def _errors() -> Iterator[None]:
    """Stop a run by an error of LAMMPS in a block; any other error is this project's."""
    try:
        yield
    except AtomsLost as error:
        raise Stopped("lost particles", f"{error.ids.size} of {error.natoms} atoms", int(error.ids[0])) from None
    except EngineRefused as error:
        raise Stopped(saying(str(error)), str(error)) from None


def open_run(start: Start, watch: FailureCriteria, side: Engine, session: Session) -> FlowRun:
    """Return the run of a start on an engine."""
    if side == "lammps":
        return LammpsRun(start, watch, session)
    return ReferenceRun(start, watch) if start.case.scene.interacts else LawRun(start)
