"""All planted faults, family after family."""

from __future__ import annotations

from functools import cache

from lammps_cases.findings import LEDGER
from lammps_cases.studies.mutation import formula, input_faults_jobs, input_faults_scene, output_faults, source
from lammps_cases.studies.mutation.fault import Fault, by_id
from lammps_cases.studies.mutation.input_faults import InputFault


@cache
def input_faults() -> dict[str, InputFault]:
    """Return the faults in what LAMMPS is given, by id."""
    return by_id((*input_faults_scene.FAULTS, *input_faults_jobs.FAULTS))


@cache
def faults(engine: str = "") -> dict[str, Fault]:
    """Return all faults by id, without those that an engine is known to have."""
    had = {entry.model_variant.stages for entry in LEDGER if entry.model_variant and entry.listed(engine)}
    every: dict[str, Fault] = {**input_faults(), **output_faults.faults(), **formula.faults(), **source.faults()}
    return {name: fault for name, fault in every.items() if formula.stages(fault) not in had - {None}}
