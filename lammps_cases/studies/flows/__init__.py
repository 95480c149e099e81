"""Flows with closed solutions, run on the reference and on LAMMPS; see `lammps_cases.studies.flows.flow`."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lammps_cases.studies.flows.flow import Flow

MODULES = ("periodic", "walls", "surfaces", "shock")  # each with a tuple FLOWS


def __getattr__(name: str) -> dict[str, Flow]:
    # On demand, so that what needs one module of this package does not load all of them.
    if name != "FLOWS":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    flows: dict[str, Flow] = {}
    for module in MODULES:
        flows |= {flow.name: flow for flow in importlib.import_module(f"{__name__}.{module}").FLOWS}
    globals()["FLOWS"] = flows
    return flows
