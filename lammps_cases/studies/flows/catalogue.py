"""The flows by name.

`FLOWS` have closed solutions and show the order of convergence; `VALIDATIONS` are compared with published
measurements, computations or solutions, which is informative and never a verdict.
"""

from __future__ import annotations

from lammps_cases.studies.flows import cavity, drops, periodic, surfaces, walls, waves
from lammps_cases.studies.flows.flow import Flow

FLOWS: dict[str, Flow] = {
    flow.name: flow for flow in (*periodic.FLOWS, *walls.FLOWS, *surfaces.FLOWS, *surfaces.SHOCKS)
}
VALIDATIONS: dict[str, Flow] = {
    flow.name: flow
    for flow in (
        *walls.VALIDATIONS,
        *cavity.VALIDATIONS,
        *waves.DAMS,
        *waves.VALIDATIONS,
        *drops.VALIDATIONS,
        *cavity.HEATED,
    )
}
