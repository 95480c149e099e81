r"""Force evaluation and time step of fix rheo, in the documented order.

`Simulation` holds a state and the results of its last force evaluation; the stages themselves belong to an evaluator
(`eos_ref.evaluation.array_evaluator.ArrayEvaluator` or `eos_ref.compiled.evaluator.CompiledEvaluator`). Only what the
plan names is evaluated (`eos_ref.model.quantities`).
Source: manual, fix rheo, and Palermo et al., Phys. Fluids 36, 113337 (2024); the order and the reuse of old values
are implementation-defined: they are LAMMPS'.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any, Self

import numpy as np

from eos_ref.errors import InputError
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.elastic import elastic_forces
from eos_ref.evaluation.evaluator import Evaluator, PairInput, is_class
from eos_ref.model import per_atom, quantities
from eos_ref.model.bonds import Bonds
from eos_ref.model.box import BoolArray, Box, Deform
from eos_ref.model.consistent import consistent_model, consistent_state
from eos_ref.model.parameters import IntArray, Model
from eos_ref.model.state import Gradients, State, Surface, check_state, masses
from eos_ref.model.units import UNITS, Units
from eos_ref.numbers.columns import axes, dot, joined, matrix, summed
from eos_ref.numbers.elementary import where
from eos_ref.numbers.number import Array
from eos_ref.numbers.rounded import Rounded

MakeEvaluator = Callable[[Model, Box, IntArray, BoolArray], Evaluator]  # a class, or one with some settings
LAYER, SURFACE, SPLASH, BULK = 8, 16, 32, 4  # bits of LAMMPS' status; 1 is solid


class Simulation:
    """A fluid of a model in a box.

    Parameters
    ----------
    model : Model
    box : Box
    state : State
        Copied.
    fields : iterable of str
        The fields to evaluate, by LAMMPS' names; empty: those that time steps need.
    evaluator : class
        `ArrayEvaluator`, a variant of it, or `eos_ref.compiled.evaluator.CompiledEvaluator`.
    check : bool
        Whether to check the state; if many runs begin with the same one, check it once.

    Attributes
    ----------
    state : State
        After `evaluate`, with summed and reconstructed densities.
    fields : dict
        Results of the last evaluation by LAMMPS' names: ``coordination``, ``grad/v`` (n, d, d), ``f`` (n, d), ...
    system, units : Units
        The system of the model, and the units of the arguments and of `output`. All else is in products of its units
        of length, mass and time.

    Raises
    ------
    InputError
        See `check_state`; a field that the model does not have.
    """

    system = units = UNITS["lj"]

    def __init__(
        self,
        model: Model,
        box: Box,
        state: State,
        fields: Iterable[str] = (),
        evaluator: MakeEvaluator = ArrayEvaluator,
        check: bool = True,
    ) -> None:
        if check:
            check_state(model, box, state)
        if isinstance(fields, str):
            raise InputError("fields", "must be a list of names", fields)
        self.system = UNITS[model.units]
        self.units = self.conversion()
        model, own = consistent_model(model, self.units), consistent_state(state.copy(), self.units)
        self._start(own, evaluator(model, box, own.type_n, own.solid_n), tuple(fields))
        self.mass_n = masses(model, own)
        if own.mass_n is not None:
            self.evaluator.weigh(own.mass_n)

    @classmethod
    def with_evaluator(cls, state: State, evaluator: Evaluator, fields: Iterable[str]) -> Self:
        """Return a simulation of a state as it is, neither checked nor copied, by an evaluator that is ready for it.

        For states in other number types, and for particles of one type with different masses (``evaluator.mass_n``).
        """
        simulation = cls.__new__(cls)
        simulation._start(state, evaluator, tuple(fields))
        simulation.mass_n = evaluator.mass_n
        return simulation

    def _start(self, state: State, evaluator: Evaluator, fields: tuple[str, ...]) -> None:
        self.model, self.box, self.state = evaluator.model, evaluator.box, state
        self.evaluator: Evaluator = evaluator
        self.fields_needed = fields or quantities.needed_to_step(self.model)
        self.plan = quantities.required(self.model, self.fields_needed)
        self.other_nc: Any = np.zeros(state.x_nc.shape)  # acceleration that is not pressure's; see `keep_forces`
        self.fields: dict[str, Any] = {}
        self.gradient, self.surface = Gradients(), Surface()
        self.chi_n: Array | None = None
        self.pressure_force_nc: Array | None = None
        self.bonds = Bonds()
        self.virial_ncc: Any = None  # of all particles
        self.set_n = np.zeros(len(state.x_nc), bool)
        self.fresh = True  # no step taken yet
        self._begin_run()
        self.evaluated_in = self.box
        self.evaluated = self.state  # what the last evaluation began with; steps make new arrays of all they change

    def conversion(self) -> Units:
        """Return the units of the arguments and of `output`: those of the system."""
        return self.system

    # --- force evaluation

    def evaluate(self) -> dict[str, Any]:
        """Evaluate everything the plan names, for the state as it is (F of the documentation), and return `fields`."""
        s, e, plan = self.state, self.evaluator, self.plan
        self.fields, self.evaluated, self.evaluated_in = {}, replace(s), self.box
        self.gradient, self.pressure_force_nc = Gradients(), None
        if "pairs" in plan:
            e.move(s.x_nc)
            self.fields["coordination"] = e.counted()
        self._densities()
        if want := [name.removeprefix("grad/") for name in plan if name.startswith("grad/")]:
            self.gradient = e.gradients(s, self.chi_n, want)
        self._surfaces()
        self.properties()
        if "f" in plan or "heatflow" in plan or "drho" in plan:
            self._forces()
        records = quantities.QUANTITIES.values()
        self.fields |= {q.name: q.result(self) for q in records if q.result and q.whole in plan}
        return self.fields

    def _densities(self) -> None:
        s, e, plan = self.state, self.evaluator, self.plan
        if "rho" in plan and self.model.fix.rho_sum:
            s.rho_n = e.density_sum()
        if "correction" in plan:
            e.correct(s.rho_n)
        if "chi" in plan:
            self.reconstruct()

    def reconstruct(self) -> None:
        """Evaluate the same-phase fractions and densities of walls, from the accelerations kept."""
        s = self.state
        self.chi_n, s.rho_n = self.evaluator.interface(s.rho_n, self.other_nc, s.energy_n)
        self.fields["chi"] = self.chi_n

    def _surfaces(self) -> None:
        s, e = self.state, self.evaluator
        shift_nc = e.shift(s.v_nc, s.rho_n) if "shift/v" in self.plan else None
        if "surface" in self.plan:
            self.surface, shift_nc = e.surface(s.rho_n, shift_nc)
        if shift_nc is not None:
            self.fields["shift/v"] = shift_nc

    def properties(self) -> None:
        """Evaluate the properties of a particle that the plan has: viscosity, pressure, temperature."""
        s, e, fields, plan = self.state, self.evaluator, self.fields, self.plan
        if "viscosity" in plan:
            fields["viscosity"] = e.viscosity(self.gradient.v_ncc)
        if "pressure" in plan:
            fields["pressure_used"] = e.pressure(s.rho_n, s.energy_n)
        if "temperature" in plan:
            fields["temperature"] = e.temperature(s.energy_n)

    def _forces(self) -> None:
        fields = self.fields
        pressure_n = self.force_pressure() if "f" in self.plan else np.zeros(len(self.mass_n))
        terms = self.evaluator.pair_terms(self.pair_input(pressure_n))
        if terms.virial_ncc is not None:
            fields["stress/atom"], self.virial_ncc = -terms.virial_ncc, terms.whole_ncc
        fields["drho"] = terms.drho_n
        if terms.heat_n is not None:
            fields["heatflow"] = terms.heat_n
        if "f" in self.plan:
            self.pressure_force_nc = terms.pressure_force_nc
            if self.model.elastic:
                elastic_nc = elastic_forces(self.evaluator, self.bonds, self.state)
                terms = replace(terms, force_nc=terms.force_nc + elastic_nc)
            fields["f"] = self._external(terms.force_nc)

    def force_pressure(self) -> Array:
        """Return the pressure that forces use, of the current state."""
        s, e = self.state, self.evaluator
        return e.pressure(e.apparent_density(s.rho_n), s.energy_n)

    def pair_input(self, pressure_n: Array) -> PairInput:
        """Return the input of the pair terms: the current state, and the results of the evaluation so far."""
        s, fields = self.state, self.fields
        viscosity_n = fields.get("viscosity", np.zeros(len(self.mass_n)))
        sound_n, T_n = self.evaluator.sound_speed(s.energy_n), fields.get("temperature")
        return PairInput(
            *(s.v_nc, s.rho_n, pressure_n, viscosity_n, sound_n, self.chi_n, self.gradient, T_n),
            virial="stress/atom" in self.plan,
        )

    def _external(self, force_nc: Array) -> Array:
        """Add the forces of other fixes, in their order."""
        for force in self.model.forces:
            acts_n = force.acts_on(self.state.type_n)
            if force.style == "setforce":
                self.set_n = self.set_n | acts_n
            rows = acts_n[:, None]
            keep_c = np.array([v is None for v in force.vector])
            vector_c = np.array([0.0 if v is None else v for v in force.vector])
            if force.style == "gravity":
                force_nc = force_nc + np.where(rows, self.mass_n[:, None] * vector_c, 0.0)
            elif force.style == "addforce":
                force_nc = force_nc + np.where(rows, vector_c, 0.0)
            else:
                force_nc = where(rows & ~keep_c, vector_c + np.zeros(force_nc.shape), force_nc)
        return force_nc

    def setup(self) -> None:
        """Evaluate before the first step, without a history of forces."""
        self._begin_run()
        self.evaluate()

    def _begin_run(self) -> None:
        """Remember the box in which the run begins: fix deform changes it relative to that."""
        self.begun, self.run_steps = self.box, 0  # and the steps since
        self._move_images(self.evaluator)

    def _move_images(self, evaluator: Evaluator) -> None:
        if self.model.deform:
            evaluator.image_velocity_cc = self.model.deform.image_velocity(self.begun)
            evaluator.image_rounding_cc = self.model.deform.image_rounding(self.begun)

    def remap(self, box: Box) -> None:
        """Change the box and the positions with it; positions in fractions of the box's edges stay the same."""
        fraction_nc = self.box.upright(self.state.x_nc - np.array(self.box.low_c)) / self.box.edge_c
        self.state.x_nc = np.array(box.low_c) + box.shift(fraction_nc)
        self.box = box
        self.evaluator.take(box)

    def minimize(self) -> None:
        """Evaluate forces as a minimisation does that moves nothing: it has no effect on the next run."""

    def begin_again(self, new_n: BoolArray, read_back: bool = False) -> None:
        """Begin another run: evaluate the current state as if it were given, whatever the earlier runs did.

        ``new_n``, the particles without a history of forces, and ``read_back``, whether the state was read from a
        file, have no effect here; they have one in findings.
        """
        self.other_nc = self.kept_at_stop(new_n)
        self.fresh = True
        self.setup()

    def kept_at_stop(self, new_n: BoolArray) -> Array:
        """Return the accelerations without pressure with which a set-up begins, (n, d): 0, as before any step."""
        return np.zeros(self.state.x_nc.shape)

    # --- time step

    def keep_forces(self) -> None:
        """Keep the accelerations that the extrapolation to walls needs.

        Force without the pairs' pressure and artificial viscosity, over mass; of a particle whose force is set, the set
        force, which contains no pressure.
        """
        mass = self.mass_n[:, None]
        force_nc = self.fields["f"]
        given = self.set_n[:, None]
        self.other_nc = np.where(given, force_nc, force_nc - self.pressure_force_nc) / mass

    def acceleration(self) -> Array:
        """Return the accelerations by the last forces, (n, d)."""
        acceleration_nc: Array = self.fields["f"] / self.mass_n[:, None]
        return acceleration_nc

    def step(self, dt: float) -> None:
        """Take one step of length dt (velocity Verlet with the half-step gradients at old positions)."""
        s, model = self.state, self.model
        self._check_steps()
        if not self.fields:
            self.setup()
        self.fresh = False
        fluid = ~s.solid_n
        s.v_nc = s.v_nc + 0.5 * dt * self.acceleration()
        if model.deform and model.deform.remap != "v":  # else images stay where they were: they move as particles do
            self.evaluator.follow(s.x_nc)
        before = self.fields  # the last evaluation's; the next one makes a dictionary of its own
        if model.fix.interface_reconstruct:
            self.keep_forces()
            self.reconstruct()
        gradient = self._half_step_gradients()
        s.x_nc = s.x_nc + dt * s.v_nc
        if not model.fix.rho_sum:
            self._continuity(0.5 * dt, before["drho"], gradient)
        if model.fix.shift:
            self._shift(dt, np.where(fluid[:, None], before["shift/v"], 0.0), gradient)
        if model.thermal is not None:
            s.energy_n = s.energy_n + 0.5 * dt * before["heatflow"]
            self._change_phase()
        del before, gradient  # a hundred bytes per particle that the next evaluation can use
        self.evaluate()
        s.v_nc = s.v_nc + 0.5 * dt * self.acceleration()
        if not model.fix.rho_sum:
            self._continuity(0.5 * dt, self.fields["drho"], self.gradient)
        if model.thermal is not None:
            s.energy_n = s.energy_n + 0.5 * dt * self.fields["heatflow"]
        if model.deform:
            self.deform(model.deform, dt)

    def deform(self, by: Deform, dt: float) -> None:
        """Change the size and tilt of the box at the end of a step, with or without the positions."""
        self.run_steps += 1
        box = self.grown(by, self.run_steps * dt)
        if by.remap == "x":
            self.remap(box)
        else:
            self.box = box
            self.evaluator.take(box)

    def grown(self, by: Deform, time: float) -> Box:
        """Return the box some time after the run began."""
        return by.box(self.begun, time)

    def run(self, steps: int, dt: float) -> None:
        """Take steps of length dt.

        Raises
        ------
        InputError
            A number of steps that is negative or not whole, or a length that is not positive and finite.
        """
        if not isinstance(steps, int | np.integer) or isinstance(steps, bool) or steps < 0:
            raise InputError("steps", "must be a whole number, at least 0", steps)
        if not (isinstance(dt, int | float | np.floating) and np.isfinite(dt) and (dt > 0 or steps == 0)):
            raise InputError("time step", "must be a positive, finite number", dt)
        if not self.fields:
            self.setup()
        for _ in range(steps):
            self.step(dt)

    def again(self, evaluator: MakeEvaluator = ArrayEvaluator) -> Simulation:
        """Repeat the last evaluation with another evaluator."""
        return self._evaluated_in(lambda array: array, evaluator, self.evaluated.x_nc)

    def rounded(self, evaluator: MakeEvaluator = ArrayEvaluator) -> Simulation:
        """Repeat the last evaluation in `Rounded` arrays: every field with its rounding bound."""
        x_nc = Rounded(self.evaluated.x_nc, self.evaluated_in.rounding(self.model.cut))
        return self._evaluated_in(Rounded, evaluator, x_nc)

    def precise(self, evaluator: MakeEvaluator = ArrayEvaluator) -> Simulation:
        """Repeat the last evaluation in longdoubles, where these have more digits than doubles.

        The inverse of an equation of state, which walls need, stays in doubles.
        """
        x_nc = np.asarray(self.evaluated.x_nc, np.longdouble)
        return self._evaluated_in(lambda array: np.asarray(array, np.longdouble), evaluator, x_nc)

    def _evaluated_in(self, number: Callable[[Any], Array], evaluator: MakeEvaluator, x_nc: Array) -> Simulation:
        s = self.evaluated
        twin: Simulation = copy.copy(self)
        energy_n = None if s.energy_n is None else number(s.energy_n)
        twin.state = State(x_nc, number(s.v_nc), number(s.rho_n), s.type_n, s.solid_n, energy_n, s.mass_n)
        twin.evaluator = evaluator(self.model, self.evaluated_in, s.type_n, s.solid_n)
        self._move_images(twin.evaluator)
        if s.mass_n is not None:
            twin.evaluator.weigh(s.mass_n)
        twin.other_nc = number(self.other_nc)
        twin.setup() if self.fresh else twin.evaluate()
        return twin

    def _check_steps(self) -> None:
        missing = [field for field in quantities.needed_to_step(self.model) if field not in self.plan]
        if missing:
            raise InputError(
                "fields", f"must name what time steps need: {', '.join(missing)}", ", ".join(self.fields_needed)
            )

    def _half_step_gradients(self) -> Gradients:
        s, fix = self.state, self.model.fix
        want = [] if fix.rho_sum and not fix.shift else ["v"]
        if fix.shift:
            want += [] if fix.rho_sum else ["rho"]
            want += ["energy"] if fix.thermal else []
        if not want:
            return Gradients()
        return self.evaluator.gradients(s, self.chi_n, want)

    def _continuity(self, dt: float, drho_n: Array, gradient: Gradients) -> None:
        s = self.state
        trace_n = gradient.v_ncc[:, 0, 0].copy()  # np.trace takes five times as long
        for a in range(1, self.model.dimension):
            trace_n += gradient.v_ncc[:, a, a]
        s.rho_n = np.where(s.solid_n, s.rho_n, s.rho_n + dt * (drho_n - s.rho_n * trace_n))

    def _shift(self, dt: float, shift_nc: Array, gradient: Gradients) -> None:
        s = self.state
        s.x_nc = s.x_nc + dt * shift_nc
        shift = axes(shift_nc)  # sums over a short last axis take ten times as long as sums of columns
        s.v_nc = s.v_nc + dt * joined([dot(row, shift) for row in matrix(gradient.v_ncc)])
        if gradient.rho_nc is not None:
            s.rho_n = s.rho_n + dt * dot(axes(gradient.rho_nc), shift)
        if gradient.energy_nc is not None:
            s.energy_n = s.energy_n + dt * dot(axes(gradient.energy_nc), shift)

    def _change_phase(self) -> None:
        """Melt solids above their freezing temperature, freeze fluid below it."""
        s, thermal = self.state, self.model.thermal
        assert thermal is not None
        if all(p.T_freeze is None for p in thermal):
            return
        T_n = self.evaluator.temperature(s.energy_n)
        T_freeze = np.array([np.nan if p.T_freeze is None else p.T_freeze for p in thermal])[s.type_n - 1]
        s.solid_n = np.where(T_n < T_freeze, True, np.where(T_n > T_freeze, False, s.solid_n))
        self.evaluator.solid_n = s.solid_n

    # --- outputs

    def output(self, field: str) -> Any:
        """Return a field as LAMMPS would output it now, in the model's units: of the state or the last evaluation.

        Raises
        ------
        InputError
            A field that does not exist, that the model does not have, or that this simulation did not evaluate.
        """
        read = quantities.of_model(self.model, field).output
        if not read and field not in self.fields:
            raise InputError("field", "was not evaluated: name it in fields", field)
        values = read(self) if read else self.fields[field]
        unit = self.units.of(field)
        return values if unit == 1 else values / unit

    def stress(self, total: bool) -> Array:
        """Return the viscous or total stresses, (n, d, d), of the last gradients and the present pressure."""
        s, viscosity_n = self.state, self.fields["viscosity"]
        p_n = self.evaluator.pressure(s.rho_n, s.energy_n) if total else None
        return joined(per_atom.stress(matrix(self.gradient.v_ncc), viscosity_n, p_n))

    def virial_of_all(self) -> Array:
        """Return the virial of all particles, the same for all, (n, d, d)."""
        virial_ncc: Array = self.virial_ncc
        return virial_ncc

    def pressure_of_all(self) -> Array:
        r"""Return the pressure tensor :math:`\sum_iW_i/V`, V being that of the box, the same for all, (n, d, d)."""
        tensor: Array = self.virial_of_all() / math.prod(self.box.edge_c)
        return tensor

    def press(self) -> Array:
        r"""Return the pressure :math:`(\sum_im_iv_i^2+\mathrm{tr}\sum_iW_i)/(dV)`, the same for all, (n,)."""
        v, volume = axes(self.state.v_nc), math.prod(self.box.edge_c)
        tensor = matrix(self.virial_of_all())
        twice_kinetic = summed(self.mass_n * dot(v, v))
        trace = sum((tensor[a][a] for a in range(1, len(v))), start=tensor[0][0])
        return (twice_kinetic + trace) / (self.model.dimension * volume)

    def status(self) -> Array:
        """Return the status words, (n,): 1 solid; 4 bulk, 8 layer (bulk next to a surface), 16 surface, 32 splash."""
        solid_n = self.state.solid_n.astype(float)
        if "surface" not in self.fields:
            return solid_n
        class_n, layer = self.surface.class_n, ~self.state.solid_n & (self.surface.r_n < self.model.cut)
        status_n = where(layer, LAYER, BULK + solid_n)
        for number, bit in ((1, SURFACE), (2, SPLASH)):
            status_n = where(is_class(class_n, number), bit + solid_n, status_n)
        return status_n
