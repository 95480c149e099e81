"""Whether the state of a deck is that of a fluid, the effects of findings on its samples, and why a run broke off.

A state is not a fluid's if numbers are not finite, or if particles run away or are lost.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from eos_ref.eos.table import FloatArray
from eos_ref.errors import InputError
from eos_ref.model.parameters import IntArray, Model
from eos_ref.model.state import State
from lammps_cases.audit import fields
from lammps_cases.audit.effects import Explained, effects, touching
from lammps_cases.audit.evaluation import TimedSample, acted_on, model_with_forces
from lammps_cases.audit.options import AuditOptions
from lammps_cases.audit.rerun import boxed, closed, looks, reruns, shortened
from lammps_cases.audit.sample import Sampler
from lammps_cases.comparison.compare import components
from lammps_cases.findings import Finding
from lammps_cases.records.case_parts import (
    BreakRecord,
    ClosedRecord,
    EffectRecord,
    LostRecord,
    OutlookRecord,
    SeriesRecord,
)
from lammps_cases.studies.stability.limits import numbers
from lammps_cases.verdict.runaway import RUNAWAY, Attempts, fastest

Array = npt.NDArray[Any]
_LOST = re.compile(r"Lost atoms: original (\d+) current (\d+)")


def mach(model: Model, state: State) -> float:
    """Return the largest component of a velocity over the speed of sound; infinite where numbers are not finite."""
    if not all(np.isfinite(of).all() for of in (state.x_nc, state.v_nc, state.rho_n)):
        return np.inf
    at_rest = replace(state, v_nc=np.zeros(state.v_nc.shape))
    return float(np.abs(state.v_nc).max(initial=0.0)) / fastest(model, at_rest)


@dataclass
class Health:
    """The first sample in which the state of a deck is not that of a fluid, and the particles lost."""

    broke: BreakRecord | None = None
    lost: LostRecord | None = None
    broke_off: int | None = None  # step at which LAMMPS ended a run
    ignores: bool = False  # whether LAMMPS continues when particles are lost
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
        self._runs_away(run, step, id_n, "rho", state.rho_n, density_n <= 0, given=first)
        if not self.changes:  # particles that are added begin with values of their own
            self._runs_away(run, step, id_n, "rho", state.rho_n, density_n > RUNAWAY * self._density)
            if self._energy and not heated:
                self._runs_away(run, step, id_n, "energy", energy_n, energy_n > RUNAWAY * self._energy)

    def ended(self, error: str, run: int, step: int) -> None:
        """Take the error with which LAMMPS ended a run."""
        self.broke_off = step
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

    def _runs_away(
        self, run: int, step: int, id_n: Array, column: str, values_n: Array, beyond_n: Array, given: bool = False
    ) -> None:
        if self.broke is not None or not beyond_n.any():
            return
        row = int(np.argmax(np.where(beyond_n, np.abs(values_n), -1.0)))
        self.broke = BreakRecord(
            kind="runaway", run=run, step=step, column=column, atom=int(id_n[row]), value=float(values_n[row]),
            particles=int(beyond_n.sum()), of=len(id_n), both=False, given=given,
        )  # fmt: skip


def component_name(field: str, shape: tuple[int, ...], component: int) -> str:
    """Return LAMMPS' name of a component of a field: vx of v, fx of f, grad/v/xy of grad/v."""
    axes = ["xyz"[k] for k in np.unravel_index(component, shape)] if shape else []
    if field == "x":
        return axes[0]
    return "".join([field, "/" if "/" in field and axes else "", *axes])


def outlook(
    good: TimedSample, engine: str, taken: int, brief: str = "", unpredictable: Sequence[Finding] = ()
) -> tuple[OutlookRecord | None, list[EffectRecord]]:
    """Return why a run broke off, and what findings do to the particles after the reference's steps from the sample.

    A lattice at rest feels no force yet, right or wrong; some steps later it does. Effects are left out where the
    particles are too many to follow them all.

    Parameters
    ----------
    taken : steps that LAMMPS took from the sample
    brief : the fault of the set-up, in a few words
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


def _limit(good: TimedSample) -> str:
    """Return the time step over its theoretical limit, and the cause of that limit."""
    step = numbers(good.sample.model, good.sample.state, good.timestep)
    of = "sound" if step.viscous <= step.acoustic else "conduction" if step.conducts else "viscosity"
    return f"time step is {step.fraction:.3g} times the limit of {of} at step {good.step}"


@dataclass
class FluidSamples:
    """Takes the samples of a deck; a sample looks like a fluid if its particles are slower than sound and all there.

    Attributes
    ----------
    last : the last such sample, if all forces of the deck are known
    first : the first one of the last run
    """

    options: AuditOptions
    engine: str
    last: TimedSample | None = None
    first: TimedSample | None = None
    _open: Explained = field(default_factory=dict)  # by field of this `last`, findings that cannot be evaluated
    _harmful: set[str] = field(default_factory=set)  # findings that change, in some sample, a field that steps need
    _count: int = 0  # samples that look like a fluid
    _least: int = 0  # particles of such a sample, in this run

    def take(
        self, now: TimedSample | None, sampler: Sampler | None, starts: bool, broke: bool, unpredictable: Explained
    ) -> tuple[EffectRecord, ...]:
        """Take a sample, None without a model; of the 1st, 2nd, 4th, 8th ... return what findings do to it.

        ``starts``: whether it is the first of a run; ``broke``: whether the state of the deck is no longer a fluid's.
        """
        count = 0 if now is None or sampler is None else len(now.sample.mass_n)
        if starts:
            self._least = count
        looks_so = count >= self._least and now is not None and mach(now.sample.model, now.sample.state) <= 1
        if now is None or sampler is None or not looks_so:
            self._least = count + 1  # the rest of a run that lost particles, or its measure, may look sound again
            return ()
        if not broke or self.last is None:
            if sampler.followed:
                self.last = now
                if self.first is None or self.first.run != now.run:
                    self.first = now
            self._open = unpredictable | _undefined(sampler.explained)
        self._count += 1
        doubled = self._count & (self._count - 1) == 0
        seen = {entry.id for entries in sampler.explained.values() for entry in entries}
        if not (doubled or not seen <= self._harmful):
            return ()
        found = tuple(effects(now.sample, self.engine, now.run, now.step, sampler.evaluated, seen))
        self._harmful |= seen | {effect.finding for effect in found}
        return found

    def series(self) -> tuple[list[SeriesRecord], ClosedRecord | None]:
        """Return runs of the reference from the first sample of the last run, compared with a closed solution.

        Nothing unless budgets are wanted and all forces are known.
        """
        if not self.options.budgets or self.first is None or self.last is None:
            return [], None
        steps = self.last.step - self.first.step
        entries = [entry for entry in touching(self.last.sample, self.engine) if entry.id in self._harmful]
        series = reruns(self.first, steps, self.options.every, entries)
        return series, closed(self.first, looks(steps, self.options.every)) if series else None

    def unbudgeted(self) -> list[str]:
        """Return why there is no budget, or no run of the reference, though budgets are wanted."""
        if not self.options.budgets or self.options.fields == fields.PRESSURE:
            return []
        if self.last is None:
            return ["--budgets: nothing is followed, as forces are not compared in any run"]
        if model_with_forces(self.last.sample) is None:
            groups = ", ".join(dict.fromkeys(f"{a.style} on {a.group}" for a, _ in self.last.sample.actions))
            why = f"forces act on groups that are not of types ({groups})"
            return [f"--budgets: the reference does not run on from the first look, as {why}"]
        steps = self.last.step - self.first.step if self.first else 0
        short = shortened(len(self.last.id_n), steps)
        line = f"--budgets: the reference takes fewer than {steps} steps, as particles are many: {short}"
        return [line] if short else []

    def outlook(self, health: Health, brief: str) -> tuple[OutlookRecord | None, list[EffectRecord]]:
        """Return why the state broke or LAMMPS ended a run before its time; None if neither, or if unknown."""
        broke, lost, broke_off = health.broke, health.lost, health.broke_off
        if broke is not None and broke.given:
            given = f"run {broke.run} begins with {broke.column} = {broke.value} of atom {broke.atom}"
            return OutlookRecord(cause="set-up", because=given, run=broke.run, step=broke.step, taken=0, steps=0), []
        if broke_off is None and lost is not None and not lost.ignored:
            broke_off = lost.step
        if broke is not None and brief and (broke.both or self.last is None):
            return OutlookRecord(cause="set-up", because=brief, run=broke.run, step=broke.step, taken=0, steps=0), []
        if self.last is None or (broke is None and broke_off is None):
            return None, []
        at = broke.step if broke is not None and broke.run == self.last.run else broke_off or self.last.step
        record, more = outlook(self.last, self.engine, at - self.last.step, brief, self._open.get("f", ()))
        grown = broke is not None and broke.column == "energy" and broke.kind == "runaway" and broke_off is None
        if grown and (record is None or record.cause == "not understood"):
            health.broke = None  # something heats the deck that is not followed
            return None, []
        return record, more


def _undefined(explained: Explained) -> Explained:
    """Return those findings that explain fields but leave some particles undecided."""
    of = {
        name: [e for e in entries if e.model_variant and e.model_variant.undefined]
        for name, entries in explained.items()
    }
    return {name: entries for name, entries in of.items() if entries}
