"""The findings that explain the fields of a sample which lie outside their bounds, and those that leave fields open."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from lammps_cases.audit.evaluation import ParticleSample
from lammps_cases.findings import Finding, applicable
from lammps_cases.findings.entry import DeckRun
from lammps_cases.findings.variants import combined

Explained = dict[str, list[Finding]]  # by field


class Left(NamedTuple):
    """The fields with particles outside their bounds, and those of which no particle has a bound."""

    outside: frozenset[str]
    unbounded: frozenset[str] = frozenset()


# What some stages leave; if the flag is set, particles without a bound are left out.
Outside = Callable[[type[ArrayEvaluator], bool], Left]


@dataclass(frozen=True)
class SampleExplanation:
    """The findings by which fields are inside their bounds, and those by which other fields cannot be predicted."""

    explained: Explained = field(default_factory=dict)
    unpredictable: Explained = field(default_factory=dict)


def explain(
    sample: ParticleSample,
    snapshot: Mapping[str, Any],
    listed: Sequence[Finding],
    before: frozenset[str],
    outside: Outside,
    last: Explained,
) -> SampleExplanation:
    """Return the findings that bring fields back inside their bounds, and for the others those that reach them.

    Of the findings that apply, those whose variants can be fitted to the sample explain; they explain nothing if they
    take a field out of its bound that was inside. What depends on a quantity that another one changes, by lists that
    were not read or memory that nobody knows, cannot be predicted.

    Parameters
    ----------
    snapshot : LAMMPS' fields by name, and its neighbour list (``lists``) if it was read
    listed : findings of the engine
    before : the fields outside their bounds by the reference, at least one
    last : what explained fields of earlier samples, tried first
    """
    problem = sample.problem(tuple(name for name in snapshot if name != "lists"))
    setting = DeckRun(problem, sample.newton)
    of_stages = [
        e for e in applicable(problem, lists=True) if e in listed and e.model_variant and e.model_variant.stages
    ]
    # What follows lists says by its own rule whether it acts, and must not be tried where it does not.
    acting = [e for e in of_stages if not (e.model_variant and e.model_variant.lists) or e.acting(setting)]
    fitting = [e for e in acting if e.model_variant and combined([e.model_variant], problem, dict(snapshot))]
    known: dict[tuple[str, ...], Left] = {(): Left(before)}

    def after(entries: Sequence[Finding]) -> Left:
        names = tuple(entry.id for entry in entries)
        if names not in known:
            variants = [entry.model_variant for entry in entries if entry.model_variant]
            classes = combined(variants, problem, dict(snapshot))
            known[names] = outside(classes[0], any(v.undefined for v in variants)) if classes else Left(before)
        return known[names]

    if before <= last.keys():
        entries = list(dict.fromkeys(entry for name in before for entry in last[name] if entry in fitting))
        if not after(entries).outside and not before & after(entries).unbounded:
            return SampleExplanation({name: last[name] for name in before})
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
