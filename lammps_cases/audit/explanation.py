"""The findings that explain the fields of a sample which lie outside their bounds."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from lammps_cases.audit.evaluation import ParticleSample
from lammps_cases.comparison.problem import Problem
from lammps_cases.findings import Finding, applicable
from lammps_cases.findings.variants import combined

# The fields outside their bounds by some stages; if the flag is set, values without a bound are left out.
Outside = Callable[[type[ArrayEvaluator], bool], frozenset[str]]
Explained = dict[str, list[Finding]]  # by field
_After = Callable[[Sequence[Finding]], frozenset[str]]


def explain(
    sample: ParticleSample,
    snapshot: Mapping[str, Any],
    listed: Sequence[Finding],
    before: frozenset[str],
    outside: Outside,
    last: Explained,
) -> Explained:
    """Return the findings that bring fields back inside their bounds, each field with those that it needs.

    A finding explains nothing if it takes a field out of its bound that was inside.

    Parameters
    ----------
    snapshot : LAMMPS' fields by name
    listed : findings of the engine
    before : the fields outside their bounds by the reference, at least one
    last : what explained fields of earlier samples, tried first
    """
    problem = Problem(sample.model, sample.box, sample.state, 0.0, tuple(snapshot), (0,))

    def after(entries: Sequence[Finding]) -> frozenset[str]:
        variants = [entry.model_variant for entry in entries if entry.model_variant]
        classes = combined(variants, problem, dict(snapshot))
        return outside(classes[0], any(v.undefined for v in variants)) if classes else frozenset(snapshot)

    apply = [e for e in applicable(problem) if e in listed and e.model_variant and e.model_variant.stages is not None]
    return _as_before(last, before, after) or _smallest(apply, before, after)


def _as_before(last: Explained, before: frozenset[str], after: _After) -> Explained:
    """Return the explanation of earlier samples if it holds for this one, too."""
    if not before <= last.keys():
        return {}
    entries = list(dict.fromkeys(entry for field in before for entry in last[field]))
    return {} if after(entries) else {field: last[field] for field in before}


def _smallest(entries: Sequence[Finding], before: frozenset[str], after: _After) -> Explained:
    """Return what all findings together explain, without any that is not needed."""
    left = after(entries) if entries else before
    if not left < before:
        return {}
    needed, without = list(entries), dict[str, frozenset[str]]()
    for entry in entries:
        fewer = [other for other in needed if other is not entry]
        without[entry.id] = after(fewer) if fewer else before
        if without[entry.id] == left:
            needed = fewer
    return {field: [e for e in needed if field in without[e.id]] or needed for field in before - left}
