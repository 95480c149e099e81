"""Single cells of maps, run in this process."""

from __future__ import annotations

from functools import cache, partial

from eos_ref.evaluation.time_step import MakeEvaluator
from lammps_cases.engine.session import Session
from lammps_cases.studies.stability import kinds, probe
from lammps_cases.studies.stability.model import CellOutcome, Engine, MapCell, StabilityMap
from lammps_cases.studies.stability.runs import ReferenceRun, open_run


@cache
def living() -> Session:
    """The LAMMPS of this process."""
    return Session()


def outcome(
    of: StabilityMap,
    x: float,
    y: float,
    layer: str = "",
    side: Engine = "reference",
    evaluator: MakeEvaluator | None = None,
) -> CellOutcome:
    """The outcome of a cell; with an evaluator, in a reference that uses it."""
    cell = MapCell(of.id, x, y, layer)
    start, watch = of.start(cell), of.watch(cell)
    run = (
        partial(ReferenceRun, start, watch, evaluator) if evaluator else partial(open_run, start, watch, side, living())
    )
    return probe.follow(run, kinds.subject(start), watch, start.steps[-1]).outcome
