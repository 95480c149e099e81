"""The samples of a deck that look like a fluid: what findings do to them, and why a run broke off after the last."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from eos_ref.eos.table import FloatArray
from eos_ref.errors import InputError
from eos_ref.model.parameters import IntArray
from eos_ref.numbers.number import Array
from lammps_cases.audit import fields
from lammps_cases.audit.effects import Explained, effects, touching
from lammps_cases.audit.evaluation import TimedSample, acted_on, model_with_forces
from lammps_cases.audit.health import Health, mach
from lammps_cases.audit.options import AuditOptions
from lammps_cases.audit.rerun import boxed, closed, looks, reruns, shortened
from lammps_cases.audit.sample import Sampler
from lammps_cases.findings import Finding
from lammps_cases.records.audit_record import ClosedRecord, EffectRecord, OutlookRecord, SeriesRecord
from lammps_cases.studies.stability.limits import numbers
from lammps_cases.verdict.runaway import Attempts


def outlook(
    good: TimedSample, engine: str, taken: int, brief: str = "", unpredictable: Sequence[Finding] = ()
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


def _limit(good: TimedSample) -> str:
    """Return how many times its limit by theory the time step is, and of what that is."""
    step = numbers(good.sample.model, good.sample.state, good.timestep)
    of = "sound" if step.viscous <= step.acoustic else "conduction" if step.conducts else "viscosity"
    return f"time step is {step.fraction:.3g} times the limit of {of} at step {good.step}"


@dataclass
class FluidSamples:
    """Takes the samples of a deck; those look like a fluid whose particles are slower than sound, and none is missing.

    Attributes
    ----------
    last : the last one of these, if all forces of the deck are known
    first : the first one of the last run
    """

    options: AuditOptions
    engine: str
    last: TimedSample | None = None
    first: TimedSample | None = None
    _open: Explained = field(default_factory=dict)  # by field of the last one, findings that cannot be evaluated
    _harmful: set[str] = field(default_factory=set)  # findings that change a field that steps need, in some sample
    _count: int = 0  # samples that looked so
    _least: int = 0  # particles of a sample that looks so, in this run

    def take(
        self, now: TimedSample | None, sampler: Sampler | None, starts: bool, broke: bool, unpredictable: Explained
    ) -> tuple[EffectRecord, ...]:
        """Take a sample, None if there is none to look at; of the 1st, 2nd, 4th, 8th ... return what findings do to it.

        ``starts``: whether it is the first of a run; ``broke``: whether the state of the deck is no longer a fluid's.
        """
        count = 0 if now is None or sampler is None else len(now.sample.mass_n)
        if starts:
            self._least = count
        looks_so = count >= self._least and now is not None and mach(now.sample.model, now.sample.state) <= 1
        if now is None or sampler is None or not looks_so:
            self._least = count + 1  # what is left of a run that lost particles, or its measure, may look well again
            return ()
        if not broke or self.last is None:
            if "f" in sampler.fields:
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
        """Return runs of the reference from the first sample of the last run, with what a closed solution says of them.

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
        """Return why the state broke or LAMMPS ended a run before its time; nothing if neither, or if nobody knows."""
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
    """Return, of the findings that explain fields, those that leave some particles open."""
    of = {
        name: [e for e in entries if e.model_variant and e.model_variant.undefined]
        for name, entries in explained.items()
    }
    return {name: entries for name, entries in of.items() if entries}
