"""A scene for the reference: its content, where a run ends and another begins, which fields are compared."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

from eos_ref.eos.table import FloatArray
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import MakeEvaluator, Simulation
from eos_ref.model.box import BoolArray, Box
from eos_ref.model.parameters import Model
from eos_ref.model.quantities import needed_to_step
from eos_ref.model.state import State

S = TypeVar("S", bound=Simulation)


@dataclass(frozen=True)
class ProblemStop:
    """A step at which a run ends and another begins.

    Attributes
    ----------
    timestep : from here on; None: unchanged
    by_nc : displacement of every particle, (n, d); None: none
    read_back : whether the state is read from a file
    digits : significant digits that the state goes through a text file with; None: all
    new_n : particles of which LAMMPS' fixes keep nothing, (n,): all if the fixes are defined again
    box : the box from here on, with which the positions change; None: unchanged
    minimized : whether a minimisation moves nothing, but evaluates forces
    continued : whether the next run continues without a set-up
    """

    step: int
    new_n: BoolArray
    timestep: float | None = None
    by_nc: FloatArray | None = None
    read_back: bool = False
    digits: int | None = None
    box: Box | None = None
    minimized: bool = False
    continued: bool = False


@dataclass(frozen=True)
class Problem:
    """A scene for the reference, with the fields compared and the steps of comparison."""

    model: Model
    box: Box
    state: State
    timestep: float
    fields: tuple[str, ...]
    steps: tuple[int, ...]
    stops: tuple[ProblemStop, ...] = ()
    ranks: int = 1  # of LAMMPS; unused by the reference
    newton: tuple[bool, bool] = (True, True)  # LAMMPS' flags of pairs and of bonds: likewise
    unlists_bonded: bool = False  # whether LAMMPS may leave pairs of bonded particles out of its neighbour lists

    @property
    def has_images(self) -> bool:
        """Return whether particles may meet periodic images, or ghosts of another process' particles."""
        return any(self.box.periodic) or self.ranks > 1

    @property
    def leans(self) -> bool:
        """Return whether the box leans, or does later: LAMMPS then treats it as triclinic from the beginning."""
        return self.box.tilted or (self.model.deform is not None and any(self.model.deform.shear))

    @property
    def goes_on(self) -> bool:
        """Return whether the first evaluation is followed by a step, or by a run that begins again."""
        return bool(self.steps[-1] or self.stops)

    @property
    def wanted(self) -> tuple[str, ...]:
        """The fields compared, and those that steps need, if any: a run leaves its forces to the next one."""
        return tuple(dict.fromkeys((*self.fields, *(needed_to_step(self.model) if self.goes_on else ()))))

    def simulation(self, stages: MakeEvaluator = ArrayEvaluator, stepping: type[S] = Simulation) -> S:  # type: ignore[assignment]
        """Return the reference, or a variant of it, before its first evaluation.

        The state is not checked: that of a scene has been (`lammps_cases.setup.reference_side.state`).
        """
        return stepping(self.model, self.box, self.state, self.wanted, stages, check=False)

    def box_at(self, step: int) -> Box:
        """Return the box at a step, after a stop there."""
        box, begun, dt = self.box, 0, self.timestep
        for stop in self.stops:
            if stop.step <= step:
                box, begun = stop.box or self._grown(box, (stop.step - begun) * dt), stop.step
                dt = stop.timestep or dt
        return self._grown(box, (step - begun) * dt)

    def box_before(self, step: int) -> Box:
        """Return the box at a step, before a stop there."""
        return replace(self, stops=tuple(stop for stop in self.stops if stop.step < step)).box_at(step)

    def box_of_images(self, step: int) -> Box:
        """Return the box that defines the images of the positions at a step.

        It is that of the last forces, not the next one, where images move as particles do (fix deform, remap v).
        """
        moving = self.model.deform is not None and self.model.deform.remap == "v"
        return self.box_at(max(step - 1, 0) if moving else step)

    def image_velocity(self, step: int) -> FloatArray | None:
        """Return the velocities at a step of images one edge away, (d, d), by rows; None: at rest."""
        begun = max((stop.step for stop in self.stops if stop.step <= step), default=0)
        return self.model.deform.image_velocity(self.box_at(begun)) if self.model.deform else None

    def _grown(self, box: Box, time: float) -> Box:
        return self.model.deform.box(box, time) if self.model.deform else box
