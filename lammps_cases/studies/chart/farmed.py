"""Points of a chart that no clock is needed for: worst errors, searched here or by the workers of a cluster.

What is timed stays on this machine: times of several machines make no chart.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from lammps_cases.engine import cluster
from lammps_cases.engine.session import EngineMissing
from lammps_cases.engine.workers import Failure, Workers

PATIENCE = 3600.0  # seconds that a search may take


def each(task: Callable[..., float], arguments: Sequence[tuple[Any, ...]]) -> list[float]:
    """Return ``task(site, *arguments)`` of each, from the workers of the cluster that is in use, else from here.

    Raises
    ------
    EngineMissing
        A worker failed.
    """
    if not cluster.address():
        return [task(None, *given) for given in arguments]
    results = []
    with Workers(None, 1) as workers:
        for future in [workers.call(task, *given, time_limit=PATIENCE) for given in arguments]:
            outcome = workers.outcome(future)
            if isinstance(outcome, Failure):
                raise EngineMissing(f"a worker of the cluster failed: {outcome.message}")
            results.append(outcome)
    return results
