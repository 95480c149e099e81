"""All planted faults, family after family."""

from __future__ import annotations

import fnmatch
from collections.abc import Callable, Mapping, Sequence
from functools import cache

from eos_ref.errors import unknown
from lammps_cases.findings import LEDGER
from tests.workshop.faults import formula, input_faults_jobs, input_faults_scene, output_faults, source
from tests.workshop.faults.fault import SECTIONS, Family, Fault, by_id
from tests.workshop.faults.input_faults import InputFault


@cache
def input_faults() -> dict[str, InputFault]:
    """Return the faults in what LAMMPS is given, by id."""
    return by_id((*input_faults_scene.FAULTS, *input_faults_jobs.FAULTS))


LISTED: dict[Family, Callable[[], Mapping[str, Fault]]] = {
    "told": input_faults,
    "read": output_faults.faults,
    "formula": formula.faults,
    "source": source.faults,
}


def check(names: Sequence[str]) -> None:
    """Refuse names and patterns that no fault of any engine has; only families that a name can be of are listed.

    Raises
    ------
    InputError
    """
    for name in names:
        first, point, _ = name.partition(".")
        pattern = bool(set(first) & set("*?["))
        families = [family for family in LISTED if pattern or (point and first == family)]
        if not any(fnmatch.filter(LISTED[family](), name) for family in families):
            near = [id for family in families for id in LISTED[family]()] or [f"{family}.*" for family in LISTED]
            raise unknown("section or fault", name, (*SECTIONS, *near))


@cache
def faults(engine: str = "") -> dict[str, Fault]:
    """Return all faults by id, without those that an engine is known to have."""
    had = {entry.model_variant.stages for entry in LEDGER if entry.model_variant and entry.listed(engine)}
    every = (item for listed in LISTED.values() for item in listed().items())
    return {name: fault for name, fault in every if formula.stages(fault) not in had - {None}}
