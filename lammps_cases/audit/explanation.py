"""The findings that explain the fields of a sample which lie outside their bounds, and those that leave fields open."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any, NamedTuple

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from lammps_cases.audit.evaluation import ParticleSample
from lammps_cases.findings import Finding, applicable
from lammps_cases.findings.entry import DeckRun
from lammps_cases.findings.neighbour_lists import NeighbourList
from lammps_cases.findings.variants import combined

Explained = dict[str, list[Finding]]  # by field


class Left(NamedTuple):
    """The fields with particles outside their bounds, and those of which no particle has a bound."""

    outside: frozenset[str]
    unbounded: frozenset[str] = frozenset()


# What the stages of some findings leave; if the flag is set, particles without a bound are left out.
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
    """Return the findings that bring fields back inside their bounds, and for the others those that reach them.

    Of the findings that apply, those whose variants can be fitted to the sample explain; they explain nothing if they
    take a field out of its bound that was inside. What depends on a quantity that another one changes, by lists that
    were not read or memory that nobody knows, cannot be predicted.

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
    # What follows lists says by its own rule whether it acts, and must not be tried where it does not.
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
