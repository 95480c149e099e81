"""A flow that is stepped and read, on the reference or on LAMMPS."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.evaluation.time_step import MakeEvaluator, Simulation
from eos_ref.numbers.number import Array
from lammps_cases.engine import session
from lammps_cases.engine.session import EngineRefused
from lammps_cases.engine.stepping import Stepping
from lammps_cases.scene import Scene
from lammps_cases.setup import reference_side
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan
from lammps_cases.studies.flows.flow import Body, Snapshot, Start


class FlowRun(Protocol):
    """A flow on one engine, set up when it is made."""

    @property
    def step(self) -> int:
        """Steps taken."""

    def advance(self, steps: int) -> None:
        """Take steps."""

    def snapshot(self) -> Snapshot:
        """Return the fields now."""

    def keeps_all(self) -> bool:
        """Return whether all particles are still there, also after an error."""


class Driven(Simulation):
    """A simulation whose fluid feels a `Body`."""

    body: Body

    def _external(self, force_nc: Array) -> Array:
        """Add the force of the body, and those of other fixes."""
        added_nc = self.body.force(self.mass_n, self.state.x_nc, self.fields.get("temperature"))
        return super()._external(force_nc + np.where(self.state.solid_n[:, None], 0.0, added_nc))


class ReferenceFlow:
    """A flow on the reference; by default on the compiled one."""

    def __init__(self, start: Start, evaluator: MakeEvaluator | None = None) -> None:
        case = start.case
        self.start, self.step = start, 0
        stepping = Driven if start.body else Simulation
        self.simulation = reference_side.simulation(case.scene, start.atoms, (), case.where, evaluator, stepping)
        if isinstance(self.simulation, Driven) and start.body:
            self.simulation.body = start.body
        self.simulation.run(0, start.timestep)

    def advance(self, steps: int) -> None:
        """Take steps."""
        self.simulation.run(steps, self.start.timestep)
        self.step += steps

    def snapshot(self) -> Snapshot:
        """Return the fields now."""
        names = ("x", "v", "rho", "pressure", *(["energy"] if self.simulation.state.energy_n is not None else []))
        return _snapshot(self.start, self.step, {name: self.simulation.output(name) for name in names})

    def keeps_all(self) -> bool:
        """Return that all are: none is taken away."""
        return True


class LammpsFlow:
    """A flow on an instance of LAMMPS.

    Raises
    ------
    EngineRefused
        LAMMPS' error, when made or in any method; after an `EngineBroken` the instance must not be used again.
    """

    def __init__(self, start: Start, lmp: Any) -> None:
        scene = start.case.scene
        self.start = start
        whole = job(scene, start.atoms, plan(scene))
        if start.body:
            whole = replace(whole, commands=(*whole.commands, *_body(start.body, scene)))
        self._stepping = Stepping(lmp, whole)
        self._stepping.begin()

    @property
    def step(self) -> int:
        """Steps taken."""
        return self._stepping.step

    def advance(self, steps: int) -> None:
        """Take steps."""
        self._stepping.advance(steps)

    def snapshot(self) -> Snapshot:
        """Return the fields now.

        Raises
        ------
        EngineRefused
            Atoms were lost, or a position or velocity is not finite.
        """
        arrays = self._stepping.read()
        wrong = self._stepping.lost(arrays["id"])
        if wrong.size:
            raise EngineRefused(f"LAMMPS lost {wrong.size} of {len(self.start.atoms)} atoms, first id {wrong[0]}")
        if not (np.isfinite(arrays["x"]).all() and np.isfinite(arrays["v"]).all()):
            raise EngineRefused("a position or velocity of LAMMPS is no finite number")
        fields = arrays | {"pressure": arrays["q.pressure"]} | ({"energy": arrays["esph"]} if "esph" in arrays else {})
        return _snapshot(self.start, self.step, fields)

    def keeps_all(self) -> bool:
        """Return whether LAMMPS has all atoms."""
        return not self._stepping.lost(session.read(self._stepping.lmp)["id"]).size


def _body(body: Body, scene: Scene) -> Iterator[str]:
    """Yield the commands of a body's force: fix addforce by atom-style variables, on the types that are fluid."""
    yield f"group fluid type {' '.join(str(k) for k, t in enumerate(scene.types, 1) if t.phase == 'fluid')}"
    if body.warm:
        yield "compute warm all rheo/property/atom temperature"
    for axis, formula in zip("xy", body.formulas, strict=True):
        yield f'variable body_{axis} atom "{formula}"'
    yield "fix body fluid addforce v_body_x v_body_y 0.0"


def _snapshot(start: Start, step: int, fields: Mapping[str, Any]) -> Snapshot:
    """Return copies of two-dimensional or three-dimensional arrays by the reference's names."""
    d, energy_n = start.case.scene.dimension, fields.get("energy")
    return Snapshot(
        step * start.timestep,
        np.array(fields["x"][:, :d]),
        np.array(fields["v"][:, :d]),
        np.array(fields["rho"]),
        None if energy_n is None else np.array(energy_n),
        np.array(fields["pressure"]),
        None if energy_n is None else energy_n / _heat_capacity(start),
    )


def _heat_capacity(start: Start) -> FloatArray:
    """Return the mass times specific heat."""
    specific: FloatArray = np.array([t.specific_heat for t in start.case.scene.types])[start.atoms.type_n - 1]
    return specific * start.atoms.mass_n
