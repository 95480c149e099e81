"""Flows with closed solutions, run on the reference and on LAMMPS; see `lammps_cases.studies.flows.flow`."""

from lammps_cases.studies.flows import periodic, shock, surfaces, walls
from lammps_cases.studies.flows.flow import Flow

FLOWS: dict[str, Flow] = {flow.name: flow for module in (periodic, walls, surfaces, shock) for flow in module.FLOWS}
