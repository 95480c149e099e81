"""The findings of an engine in a deck: those that explain fields, the effect of each, those that act on the deck.

The effects are fields of one sample with and without a finding, computed from the model of the deck alone, also where
LAMMPS' own field cannot be compared because other styles add to it. A finding acts on a deck by its definitions, before
its first step and whether or not a field shows it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.errors import InputError
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.model.quantities import needed_to_step
from eos_ref.model.units import UNITS
from eos_ref.numbers.rounded import error, value
from lammps_cases.audit.deck import Deck
from lammps_cases.audit.evaluation import ParticleSample, SampleEvaluation, model_with_forces
from lammps_cases.audit.lints import FEW, MOST
from lammps_cases.findings import LEDGER, Finding, accepting, applicable, refusing
from lammps_cases.findings.entry import DeckRun
from lammps_cases.findings.neighbour_lists import NeighbourList
from lammps_cases.findings.outcomes import GAS_WITHOUT_WORK
from lammps_cases.findings.variants import combined
from lammps_cases.records.case_parts import ActingRecord, EffectRecord
from lammps_cases.verdict import runaway

Explained = dict[str, list[Finding]]  # by field
NOTHING: Mapping[str, SampleEvaluation] = {}
MULTIPLE = 0.01  # fraction of the largest value by which a field may differ from a multiple of the right one
PRINTED = "thermo_style press"  # of a deck that names it


class Left(NamedTuple):
    """The fields with particles outside their bounds, and those of which no particle has a bound."""

    outside: frozenset[str]
    unbounded: frozenset[str] = frozenset()


# The fields that the stages of some findings leave; with the flag, particles without a bound are left out.
Outside = Callable[[Sequence[Finding], type[ArrayEvaluator], bool], Left]


@dataclass(frozen=True)
class SampleExplanation:
    """The findings by which fields are inside their bounds, and those by which other fields cannot be predicted."""

    explained: Explained = field(default_factory=dict)
    unpredictable: Explained = field(default_factory=dict)


def explain(
    sample: ParticleSample,
    shown: Mapping[str, Any],
    listed: Sequence[Finding],
    before: frozenset[str],
    outside: Outside,
    last: Explained,
    lists: Callable[[], Sequence[NeighbourList]] = tuple,
) -> SampleExplanation:
    """Return the findings that bring fields back inside their bounds, and for the other fields those that affect them.

    Of the findings that apply, those whose variants can be fitted to the sample explain; they explain nothing if they
    take a field out of its bound that was inside. What depends on a quantity that another one changes, by lists that
    were not read or unknown memory, cannot be predicted.

    Parameters
    ----------
    shown : LAMMPS' fields by name
    listed : findings of the engine
    before : the fields outside their bounds by the reference, at least one
    last : what explained fields of earlier samples, tried first
    lists : reads LAMMPS' neighbour list; for variants that follow it alone, as that takes as long as an evaluation
    """
    problem, read = sample.problem(tuple(shown)), cache(lists)
    setting = DeckRun(problem)
    of_stages = [
        e for e in applicable(problem, lists=True) if e in listed and e.model_variant and e.model_variant.stages
    ]
    # A finding that follows lists has its own rule on when it acts, and must not be tried elsewhere.
    acting = [e for e in of_stages if not (e.model_variant and e.model_variant.lists) or e.acting(setting)]
    known: dict[tuple[str, ...], Left] = {(): Left(before)}

    def fitted(entries: Sequence[Finding]) -> type[ArrayEvaluator] | None:
        variants = [entry.model_variant for entry in entries if entry.model_variant]
        follows = any(variant.lists for variant in variants) and read()
        classes = combined(variants, problem, {**shown, **({"lists": follows} if follows else {})})
        return classes[0] if classes else None

    def after(entries: Sequence[Finding]) -> Left:
        names = tuple(entry.id for entry in entries)
        if names not in known:
            undefined = any(entry.model_variant.undefined for entry in entries if entry.model_variant)
            known[names] = outside(entries, stages, undefined) if (stages := fitted(entries)) else Left(before)
        return known[names]

    if before <= last.keys():
        of_last = dict.fromkeys(entry for name in before for entry in last[name])
        entries = [entry for entry in of_last if entry in acting and fitted([entry])]
        if not after(entries).outside and not before & after(entries).unbounded:
            return SampleExplanation({name: last[name] for name in before})
    fitting = [entry for entry in acting if fitted([entry])]
    needed = _necessary(fitting, after)
    left = after(needed)
    if not left.outside <= before:
        needed, left = [], Left(before)
    explained = {name: _without(name, needed, after) for name in before - left.outside - left.unbounded}
    open_ = [e for e in acting if e not in fitting and e.acting(setting)]
    open_ += [e for e in needed if e.model_variant and e.model_variant.undefined]
    unpredictable = {
        name: [e for e in open_ if e.model_variant and e.model_variant.reaches(sample.model, name)]
        for name in before - explained.keys()
    }
    return SampleExplanation(explained, {name: entries for name, entries in unpredictable.items() if entries})


def _necessary(entries: Sequence[Finding], after: Callable[[Sequence[Finding]], Left]) -> list[Finding]:
    """Return the entries without those whose absence leaves nothing more outside."""
    needed = list(entries)
    for entry in entries:
        fewer = [other for other in needed if other is not entry]
        if after(fewer).outside <= after(needed).outside:
            needed = fewer
    return needed


def _without(name: str, entries: list[Finding], after: Callable[[Sequence[Finding]], Left]) -> list[Finding]:
    """Return the entries that a field needs: those without which it is outside; all if none is alone."""
    own = [e for e in entries if name in after([other for other in entries if other is not e]).outside]
    return own or entries


def touching(sample: ParticleSample, engine: str) -> list[Finding]:
    """Return the findings of an engine that can make a difference to a sample, by one evaluation of it."""
    return runaway.touching(sample.problem(needed_to_step(sample.model)), engine)


def of_pressure(sample: ParticleSample, engine: str) -> list[str]:
    """Return the findings of an engine that can change what LAMMPS prints as the pressure of the system."""
    return [entry.id for entry in applicable(sample.problem(("press",)), lists=True) if entry.listed(engine)]


def effects(
    sample: ParticleSample,
    engine: str,
    run: int,
    step: int,
    evaluated: Mapping[str, SampleEvaluation] = NOTHING,
    seen: Collection[str] = (),
) -> list[EffectRecord]:
    """Return what each finding of an engine changes in the fields that a step of the sample's model needs.

    Gravity, which would hide changes of pair forces, is left out. Of many particles those around the likeliest to run
    away are evaluated. Changes inside the bounds are left out, except of findings ``seen`` to explain LAMMPS'
    fields.

    Parameters
    ----------
    evaluated : existing evaluations of the sample, by id of the finding; that of the reference has no name
    """
    variants = [(entry.id, v) for entry in touching(sample, engine) if (v := entry.model_variant) and v.stages]
    reached = {name: [f for f in needed_to_step(sample.model) if v.reaches(sample.model, f)] for name, v in variants}
    fields = list(dict.fromkeys(field for of in reached.values() for field in of))
    if not fields:
        return []
    judged_n = np.ones(len(sample.mass_n), bool)
    if len(judged_n) > MOST:
        force_nc = value(evaluated[""].of_pairs) if "" in evaluated else None
        problem = sample.problem(tuple(fields))
        part = runaway.cut_out(problem, runaway.likeliest(problem, force_nc), FEW)
        sample, judged_n, evaluated = sample.of(part.rows_k), ~part.held_k, {}

    def evaluation(name: str, wanted: Sequence[str], stages: type[ArrayEvaluator]) -> SampleEvaluation:
        made = evaluated.get(name)
        return made if made and {*wanted} <= {*made.simulation.plan} else SampleEvaluation(sample, wanted, stages)

    right, records = evaluation("", fields, ArrayEvaluator), []
    for finding, variant in variants:
        wrong = evaluation(finding, reached[finding], variant.stages or ArrayEvaluator)
        for name in reached[finding]:
            sides = [by.own(name) for by in (right, wrong)]
            a, b = (np.asarray(value(side), float)[judged_n] for side in sides)
            bound = (np.asarray(error(sides[0]), float) + np.asarray(error(sides[1]), float))[judged_n]
            if effect := compare(a, b, bound) or (compare(a, b, 0 * bound) if finding in seen else None):
                particles, relative, factor = effect
                records.append(
                    EffectRecord(
                        finding=finding, field=name, run=run, step=step,
                        particles=particles, of=len(a), relative=relative, factor=factor,
                    )
                )  # fmt: skip
    return records


def compare(right: FloatArray, wrong: FloatArray, bound: FloatArray) -> tuple[int, float | None, float | None] | None:
    """Compare a field, (n, ...), with the same field under a finding.

    Returns
    -------
    The number of particles outside the bound; the largest difference over the largest right value, None if the right
    values are 0; the factor, if the wrong field is a multiple of the right one. None if nothing is outside.
    """
    difference = np.abs(wrong - right)
    outside_n = (difference > bound).reshape(len(right), -1).any(axis=1)
    if not outside_n.any():
        return None
    size, finite = float(np.abs(right).max()), bool(np.isfinite(wrong).all() and np.isfinite(right).all())
    if not size or not finite:
        return int(outside_n.sum()), None, None
    factor = float((right * wrong).sum() / (right * right).sum())
    is_multiple = np.abs(wrong - factor * right).max() <= MULTIPLE * np.abs(wrong).max()
    return int(outside_n.sum()), float(difference.max()) / size, factor if is_multiple else None


def worst(known: Sequence[EffectRecord], more: Sequence[EffectRecord]) -> list[EffectRecord]:
    """Return the largest effect of every finding and field."""

    def size(effect: EffectRecord) -> float:
        return effect.relative or 0.0

    kept: dict[tuple[str, str], EffectRecord] = {}
    for effect in (*known, *more):
        key = (effect.finding, effect.field)
        if key not in kept or size(effect) > size(kept[key]):
            kept[key] = effect
    return list(kept.values())


@dataclass
class Acting:
    """Takes the commands of a deck and the beginnings of its runs; ``found`` holds the bugs by id."""

    engine: str
    found: dict[str, ActingRecord] = field(default_factory=dict)
    _shown: set[str] = field(default_factory=lambda: {"press"})  # by thermo_style one, the default
    _kept: list[str] | None = None  # fix rheo of the previous run, or of the file that was read
    _created: bool = False  # whether particles were created after a run
    _stepping: str = ""  # run_style, if it is not the default
    _computes: dict[str, str] = field(default_factory=dict)  # those of RHEO's attributes

    def note(self, values: list[str]) -> None:
        """Take a command that LAMMPS has executed."""
        match values:
            case ["compute", name, _, style, *words]:
                self._computes |= {name: " ".join(values)} if style == "rheo/property/atom" else {}
                self._shown |= {f"compute {style}", *(words if style == "rheo/property/atom" else ())}
            case ["thermo_style", style, *columns]:
                self._shown.discard("press")
                self._shown |= {"press"} if style in ("one", "multi") else {*columns}
                self._shown |= {PRINTED} if "press" in self._shown else set()
            case ["uncompute", name]:
                self._computes.pop(name, None)
            case ["read_restart", *_]:
                self._kept = values
            case ["run_style", *_]:
                self._stepping = " ".join(values)
            case ["create_atoms", *_]:
                self._created = self._kept is not None
            case ["clear"]:
                self._kept, self._created, self._stepping, self._computes = None, False, "", {}

    def accepted(self, error: InputError) -> InputError:
        """Record an argument that LAMMPS accepted and the reference refuses; return its error with the known bug."""
        entry = accepting(error, self.engine)
        if entry is None:
            return error
        self._take(entry, entry.effect)
        rule = f"{error.rule} (LAMMPS accepts it: known bug {entry.id})"
        return InputError(error.what, rule, error.found, error.where, error.key)

    def begin(self, lmp: Any, deck: Deck, sample: ParticleSample, steps: int, set_up: bool) -> None:
        """Take the particles at the beginning of a run of some steps; ``set_up``: whether its forces are computed."""
        units: Any = str(lmp.extract_global("units"))
        model = model_with_forces(sample) or sample.model
        model = replace(model, units=units) if units in UNITS else model
        fields = needed_to_step(model)
        problem = replace(sample.problem(fields, (0, steps) if steps else (0,)), model=model)
        rheo = deck.fix("rheo")
        setting = DeckRun(
            problem,
            again=set_up and self._kept is not None and (self._kept is rheo or self._kept[0] == "read_restart"),
            reacts="react" in (deck.fix("rheo/thermal") or ()),
            created=self._created,
            deforms=deck.fix("deform") is not None and not deck.moves_images(),
            shown=frozenset(self._shown),
        )
        self._kept = rheo
        for entry in LEDGER:
            if entry.id not in self.found and entry.listed(self.engine) and (does := entry.acting(setting)):
                self._take(entry, does)

    def refused(self, error: str, deck: Deck) -> None:
        """Take the error with which LAMMPS refuses the deck."""
        if entry := self._ending(error, deck):
            self._take(entry, entry.effect)

    def killing(self, deck: Deck) -> str:
        """Return the finding by which a segmentation fault would end the deck; or nothing."""
        entry = self._ending("SIGSEGV", deck)
        return entry.id if entry else ""

    def _ending(self, error: str, deck: Deck) -> Finding | None:
        lines = [self._stepping, *(" ".join(words) for words in deck.fixes.values()), *self._computes.values()]
        return refusing(error, "\n".join(lines), self.engine)

    def gas(self) -> None:
        """Take a gas without a model of its particles."""
        if GAS_WITHOUT_WORK.listed(self.engine):
            self._take(GAS_WITHOUT_WORK, GAS_WITHOUT_WORK.effect)

    def _take(self, entry: Finding, does: str) -> None:
        self.found[entry.id] = record_of(entry, does)


def record_of(entry: Finding, does: str) -> ActingRecord:
    """Return the record of a finding that acts on a deck."""
    return ActingRecord(finding=entry.id, does=does, own=does != entry.effect, severity=entry.severity)
