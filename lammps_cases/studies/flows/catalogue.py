"""The flows by name.

`FLOWS` have closed solutions and show the order of convergence; `VALIDATIONS` are compared with what others have
measured, computed or solved, which is informative and never a verdict.
"""

from __future__ import annotations

from lammps_cases.studies.flows import (
    cavity,
    channel,
    convection,
    dam,
    drops,
    periodic,
    shock,
    surfaces,
    walls,
    waves,
)
from lammps_cases.studies.flows.flow import Flow

FLOWS: dict[str, Flow] = {flow.name: flow for module in (periodic, walls, surfaces, shock) for flow in module.FLOWS}
VALIDATIONS: dict[str, Flow] = {
    flow.name: flow for module in (channel, cavity, dam, waves, drops, convection) for flow in module.VALIDATIONS
}
