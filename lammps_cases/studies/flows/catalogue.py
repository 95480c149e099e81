"""The flows by name.

`FLOWS` have closed solutions and show the order of convergence; `VALIDATIONS` are compared with published
measurements, computations or solutions, and `PAPER` with the benchmarks of the paper behind RHEO, which is informative
and never a verdict.
"""

from __future__ import annotations

from lammps_cases.studies.flows import (
    cavity,
    drops,
    paper_bulk,
    paper_obstacles,
    paper_walls,
    periodic,
    surfaces,
    walls,
    waves,
)
from lammps_cases.studies.flows.known import Flow

FLOWS: dict[str, Flow] = {
    flow.name: flow for flow in (*periodic.FLOWS, *walls.FLOWS, *surfaces.FLOWS, *surfaces.SHOCKS)
}
VALIDATIONS: dict[str, Flow] = {
    flow.name: flow
    for flow in (
        *walls.VALIDATIONS,
        *cavity.VALIDATIONS,
        *waves.VALIDATIONS,
        *drops.VALIDATIONS,
        *cavity.HEATED,
    )
}
PAPER: dict[str, Flow] = {
    flow.name: flow for flow in (*paper_bulk.BULK, *paper_walls.WALLS, *paper_obstacles.OBSTACLES)
}
COMPARED = FLOWS | VALIDATIONS | PAPER
