"""A flow that is stepped and read, on the reference or on LAMMPS."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.evaluation.time_step import MakeEvaluator, Simulation
from eos_ref.model import quantities
from eos_ref.numbers.number import Array
from lammps_cases.engine.session import EngineRefused, Session
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import IntArray
from lammps_cases.setup import reference_side
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import Plan, plan
from lammps_cases.studies.flows.flow import Body, Snapshot, Start


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
    """A simulation whose fluid feels a `Body`."""

    body: Body

    def _external(self, force_nc: Array) -> Array:
        """Add the force of the body, and those of other fixes."""
        added_nc = self.body.force(self.mass_n, self.state.x_nc, self.fields.get("temperature"))
        return super()._external(force_nc + np.where(self.state.solid_n[:, None], 0.0, added_nc))


class ReferenceFlow:
    """A flow on the reference; by default on the compiled one. Classes of surfaces are evaluated if ``surface``."""

    def __init__(self, start: Start, evaluator: MakeEvaluator | None = None, surface: bool = False) -> None:
        self.start, self.step = start, 0
        wanted: tuple[str, ...] = ()  # what a step needs
        if surface:
            model = reference_side.model(start.case.scene, start.atoms, start.case.where)
            wanted = (*quantities.needed_to_step(model), "surface")
        self.simulation = self.make(wanted, evaluator)
        if isinstance(self.simulation, Driven) and start.body:
            self.simulation.body = start.body
        self._run(0)

    def make(self, fields: Iterable[str], evaluator: MakeEvaluator | None) -> Simulation:
        """Return the simulation that is stepped."""
        case, stepping = self.start.case, Driven if self.start.body else Simulation
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
            fields = {name: sim.output(name) for name in names} | {"surface": sim.fields.get("surface")}
            return snapshot(self.start, self.step, fields)


class LostAtoms(EngineRefused):
    """Atoms that LAMMPS lost without an error; ``ids`` are theirs."""

    def __init__(self, ids: IntArray, natoms: int) -> None:
        super().__init__(f"LAMMPS lost {ids.size} of {natoms} atoms, first id {ids[0]}")
        self.ids, self.natoms = ids, natoms


class LammpsFlow:
    """A flow in a session of LAMMPS, which has it until another begins.

    Raises
    ------
    EngineRefused
        LAMMPS' error, when made or in any method.
    """

    finite = True  # whether positions and velocities must be

    def __init__(self, start: Start, session: Session, scene: Scene | None = None, order: Plan | None = None) -> None:
        scene = scene or start.case.scene
        self.start, self.session = start, session
        whole = job(scene, start.atoms, order or plan(scene))
        if start.body:
            whole = replace(whole, commands=(*whole.commands, *_body(start.body, scene)))
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
        LostAtoms
        EngineRefused
            A position or velocity is not finite.
        """
        arrays = self.session.read()
        lost = np.setxor1d(arrays["id"], self.start.atoms.id_n)
        if lost.size:
            raise LostAtoms(lost, len(self.start.atoms))
        if self.finite and not (np.isfinite(arrays["x"]).all() and np.isfinite(arrays["v"]).all()):
            raise EngineRefused("a position or velocity of LAMMPS is no finite number")
        names = {"pressure": "q.pressure", "energy": "esph", "surface": "q.surface"}
        return snapshot(
            self.start, self.step, arrays | {ours: arrays[name] for ours, name in names.items() if name in arrays}
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
    )


def _heat_capacity(start: Start) -> FloatArray:
    """Return the mass times specific heat."""
    specific: FloatArray = np.array([t.specific_heat for t in start.case.scene.types])[start.atoms.type_n - 1]
    return specific * start.atoms.mass_n
