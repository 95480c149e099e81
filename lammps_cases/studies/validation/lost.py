"""Why LAMMPS loses particles of a flow: with which of its findings the reference loses some too."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from lammps_cases.findings.entry import Finding
from lammps_cases.studies.flows.converge import FlowResult
from lammps_cases.studies.flows.flow import Snapshot, Start
from lammps_cases.studies.flows.stepping import ReferenceFlow
from lammps_cases.studies.validation.record import Lost

STRIDE = 10  # steps between looks
PATIENCE = 1.25  # times as many steps as LAMMPS took are given to the reference


def explain(start: Start, lammps: Callable[[Start], FlowResult], findings: Sequence[Finding]) -> Lost:
    """Return the last step that LAMMPS has all particles at, and the first findings with which the reference has not.

    They are tried each alone, then all together.
    """
    looks = range(STRIDE, start.steps[-1] + 1, STRIDE)
    step = lammps(replace(start, steps=tuple(looks))).steps
    for entries in _sets(findings):
        after = last_with_all(start, entries, min(int(PATIENCE * step), start.steps[-1]))
        if after is not None:
            return Lost(step, tuple(entry.id for entry in entries), after)
    return Lost(step)


def _sets(findings: Sequence[Finding]) -> Iterator[tuple[Finding, ...]]:
    yield from ((entry,) for entry in findings)
    if len(findings) > 1:
        yield tuple(findings)


def last_with_all(start: Start, findings: Sequence[Finding], steps: int) -> int | None:
    """Return the last step that the reference with findings has all particles at; None if it keeps them."""
    stages: list[Any] = [entry.model_variant.stages for entry in findings if entry.model_variant]
    run = ReferenceFlow(start, type("Together", tuple(stages), {}) if stages else None)
    with np.errstate(all="ignore"):
        while run.step < steps:
            run.advance(STRIDE)
            if gone(start, run.snapshot()):
                return run.step - STRIDE
    return None


def gone(start: Start, shot: Snapshot) -> bool:
    """Return whether a particle is beyond the box, where it ends, or nowhere."""
    d = shot.x_nc.shape[1]
    fixed_c = ~np.array(start.atoms.periodic[:d])
    low_c, high_c = np.array(start.atoms.low_c)[:d][fixed_c], np.array(start.atoms.high_c)[:d][fixed_c]
    x_nc = shot.x_nc[:, fixed_c]
    inside = (x_nc >= low_c) & (x_nc <= high_c)
    return not (inside.all() and np.isfinite(shot.x_nc).all() and np.isfinite(shot.v_nc).all())
