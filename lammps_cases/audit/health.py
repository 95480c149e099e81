"""Whether the state of a deck is that of a fluid: numbers that are none, particles that run away, particles lost.

Why a deck's run broke off: what the reference makes of the last good sample.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from eos_ref.eos.table import FloatArray
from eos_ref.errors import InputError
from eos_ref.model.parameters import IntArray, Model
from eos_ref.model.state import State
from lammps_cases.audit.effects import effects
from lammps_cases.audit.evaluation import ParticleSample, acted_on, model_with_forces
from lammps_cases.comparison.compare import components
from lammps_cases.findings import Finding
from lammps_cases.records.audit_record import BreakRecord, EffectRecord, LostRecord, OutlookRecord
from lammps_cases.studies.stability.limits import numbers
from lammps_cases.verdict.runaway import RUNAWAY, Attempts, fastest

Array = npt.NDArray[Any]
_LOST = re.compile(r"Lost atoms: original (\d+) current (\d+)")
_AXES = "xyz"


def mach(model: Model, state: State) -> float:
    """Return the largest component of a velocity over the speed of sound; infinite where numbers are not finite."""
    if not all(np.isfinite(of).all() for of in (state.x_nc, state.v_nc, state.rho_n)):
        return np.inf
    at_rest = replace(state, v_nc=np.zeros(state.v_nc.shape))
    return float(np.abs(state.v_nc).max(initial=0.0)) / fastest(model, at_rest)


@dataclass
class Health:
    """The first sample in which the state of a deck is none of a fluid, and the particles that it has lost."""

    broke: BreakRecord | None = None
    lost: LostRecord | None = None
    ignores: bool = False  # whether LAMMPS goes on when particles are lost
    changes: bool = False  # whether fixes add or remove particles
    _count: int = 0  # particles at the beginning of the run
    _energy: float = 0.0  # largest at the beginning of the run
    _density: float = 0.0  # the same over the equilibrium density

    def note(self, values: list[str]) -> None:
        """Take a command that LAMMPS has executed."""
        if values[0] == "thermo_modify" and "lost" in values[:-1]:
            self.ignores = values[values.index("lost") + 1] != "error"
        if values[0] == "fix" and values[3].startswith(("evaporate", "deposit", "pour")):
            self.changes = True

    def begin(self, natoms: int) -> None:
        """Take the number of particles with which a run begins."""
        self._count = natoms

    def state(self, run: int, step: int, id_n: Array, columns: Mapping[str, Array], first: bool) -> bool:
        """Take the state of a sample as LAMMPS has it, by column; return whether all its numbers are finite.

        That of the ``first`` sample of a run is given to the run.
        """
        lost = 0 if self.changes else self._count - len(id_n)
        if lost > (self.lost.lost if self.lost else 0):
            self.lost = LostRecord(lost=lost, of=self._count, run=run, step=step, ignored=self.ignores)
        return self._all_finite(run, step, id_n, columns, given=first)

    def fields(
        self, run: int, step: int, id_n: Array, lammps: Mapping[str, Array], reference: Mapping[str, Array]
    ) -> None:
        """Take the fields of a sample on both sides."""
        for name, values_n in lammps.items():
            both = name in reference and not np.isfinite(reference[name]).all()
            self._all_finite(run, step, id_n, {name: values_n}, both)

    def fluid(self, run: int, step: int, id_n: Array, model: Model, state: State, heated: bool, first: bool) -> None:
        """Take a sample whose numbers are finite; ``heated``: whether something else adds to energies."""
        rho0_n = model.rho0[state.type_n - 1]
        gas_n = np.array([law.needs_energy for law in model.eos.laws])[state.type_n - 1]
        density_n = np.where(state.solid_n | gas_n, 1.0, state.rho_n / rho0_n)
        energy_n = np.zeros(len(id_n)) if state.energy_n is None else np.abs(state.energy_n)
        if first:
            self._density, self._energy = float(np.abs(density_n).max(initial=1.0)), float(energy_n.max(initial=0.0))
        speed_n = np.abs(state.v_nc).max(axis=1, initial=0.0)
        at_rest = replace(state, v_nc=np.zeros(state.v_nc.shape))
        self._runs_away(run, step, id_n, "v", speed_n, speed_n > RUNAWAY * fastest(model, at_rest))
        beyond_n = (density_n > RUNAWAY * self._density) | ((density_n <= 0) & (not first))
        self._runs_away(run, step, id_n, "rho", state.rho_n, beyond_n)
        if self._energy and not heated and not self.changes:
            self._runs_away(run, step, id_n, "energy", energy_n, energy_n > RUNAWAY * self._energy)

    def ended(self, error: str, run: int, step: int) -> None:
        """Take the error with which LAMMPS ended a run."""
        if match := _LOST.search(error):
            of, left = int(match[1]), int(match[2])
            self.lost = LostRecord(lost=of - left, of=of, run=run, step=step, ignored=False)

    def _all_finite(
        self, run: int, step: int, id_n: Array, columns: Mapping[str, Array], both: bool = False, given: bool = False
    ) -> bool:
        for name, values in columns.items():
            wrong_nk = ~np.isfinite(components(np.asarray(values, float)))
            if not wrong_nk.any():
                continue
            if self.broke is None:
                rows = np.flatnonzero(wrong_nk.any(axis=1))
                row = rows[np.argmin(id_n[rows])]
                component = int(np.argmax(wrong_nk[row]))
                self.broke = BreakRecord(
                    kind="not a number", run=run, step=step, column=component_name(name, values.shape[1:], component),
                    atom=int(id_n[row]), value=float(components(values)[row, component]),
                    particles=len(rows), of=len(id_n), both=both, given=given,
                )  # fmt: skip
            return False
        return True

    def _runs_away(self, run: int, step: int, id_n: Array, column: str, values_n: Array, beyond_n: Array) -> None:
        if self.broke is not None or not beyond_n.any():
            return
        row = int(np.argmax(np.where(beyond_n, np.abs(values_n), -1.0)))
        self.broke = BreakRecord(
            kind="runaway", run=run, step=step, column=column, atom=int(id_n[row]), value=float(values_n[row]),
            particles=int(beyond_n.sum()), of=len(id_n), both=False,
        )  # fmt: skip


def component_name(field: str, shape: tuple[int, ...], component: int) -> str:
    """Return LAMMPS' name of a component of a field: vx of v, fx of f, grad/v/xy of grad/v."""
    axes = [_AXES[k] for k in np.unravel_index(component, shape)] if shape else []
    if field == "x":
        return axes[0]
    return "".join([field, "/" if "/" in field and axes else "", *axes])


@dataclass(frozen=True)
class Good:
    """The last sample before the end that looks like a fluid: with the time step, the run and the step it is of."""

    sample: ParticleSample
    timestep: float
    run: int
    step: int
    id_n: IntArray


def outlook(
    good: Good, engine: str, taken: int, brief: str = "", unpredictable: Sequence[Finding] = ()
) -> tuple[OutlookRecord | None, list[EffectRecord]]:
    """Return why a run broke off, and what findings do to the particles that the reference makes of the sample.

    A lattice at rest feels no force yet, right or wrong; some steps later it does. The latter is left out where the
    particles are too many to follow them all.

    Parameters
    ----------
    taken : steps that LAMMPS took from the sample
    brief : what is wrong with the set-up, in a few words
    unpredictable : findings that change forces of the sample in a way that cannot be evaluated
    """
    sample, model = boxed(good.sample), model_with_forces(good.sample)

    def forces(force_nc: Array, mass_n: FloatArray, rows_n: IntArray) -> Any:
        return acted_on(force_nc, [(action, acts_n[rows_n]) for action, acts_n in sample.actions], mass_n)

    start = replace(sample.problem(("f",)), model=model or sample.model, timestep=good.timestep)
    attempts = Attempts(start, taken, good.id_n, None if model else forces)
    try:
        record = attempts.cause(engine, good.run, good.step)
        if record.cause == "findings" and record.of_particles is None:
            state = attempts.state_after(record.after or 0)
            step = good.step + (record.after or 0)
            return record, effects(replace(good.sample, state=state), engine, good.run, step)
    except InputError:  # the reference does not take the particles as they are
        return None, []
    if record.cause == "not understood" and unpredictable:
        names = [entry.id for entry in unpredictable]
        return record.model_copy(update={"cause": "findings", "findings": names}), []
    because = {"set-up": brief, "time step": _limit(good)}.get(record.cause, "")
    return record.model_copy(update={"because": because}), []


def _limit(good: Good) -> str:
    """Return how many times its limit by theory the time step is, and of what that is."""
    step = numbers(good.sample.model, good.sample.state, good.timestep)
    of = "sound" if step.viscous <= step.acoustic else "conduction" if step.conducts else "viscosity"
    return f"time step is {step.fraction:.3g} times the limit of {of} at step {good.step}"


def boxed(sample: ParticleSample) -> ParticleSample:
    """Return a sample whose particles lie in its box: between two lists of neighbours LAMMPS lets them leave it."""
    box, x_nc = sample.box, sample.state.x_nc
    x_nc = x_nc - box.shift(box.images(x_nc))
    ends = np.where(box.periodic, (box.low_c, box.high_c), (x_nc.min(axis=0), x_nc.max(axis=0)))
    low_c, high_c = np.minimum(box.low_c, ends[0]), np.maximum(box.high_c, ends[1])
    grown = replace(box, low_c=tuple(map(float, low_c)), high_c=tuple(map(float, high_c)))
    return replace(sample, box=grown, state=replace(sample.state, x_nc=x_nc))
