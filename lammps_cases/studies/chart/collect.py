"""Measure a chart, section by section; what is finished is on disk before the next section begins."""

from __future__ import annotations

import importlib
import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from lammps_cases.records.progress import SILENT, Progress
from lammps_cases.studies.benchmarks.measure import machine
from lammps_cases.studies.chart import page, record
from lammps_cases.studies.chart.record import Chart, Section

# Title and content of every section: a module with ``panels(quick, lmp)``, and maybe ``maps(quick)``, ``flows(quick)``.
SECTIONS = {
    "laws": (
        "Equations of state",
        "Each law by every method, LAMMPS among them, against Arb. Near rho0 the printed power form loses all digits.",
    ),
    "sums": ("Sums over neighbours", "The same terms added up in different ways, against the exactly rounded sum."),
    "kernels": (
        "Kernels and cutoffs",
        "Gradients and densities of analytic fields on disordered particles, the reference and LAMMPS.",
    ),
    "searches": ("Neighbour search", "Pairs found, missed and invented; how often a list is built, and what it costs."),
    "timestep": (
        "Time step and threads",
        "What a shorter step buys, where the longest one lies, what two cores give.",
    ),
    "flows": ("Flows with closed solutions", "The reference and LAMMPS, in turns, at several resolutions."),
}


def collect(names: Sequence[str], quick: bool, out: Path, command: str, progress: Progress = SILENT) -> Chart:
    """Measure sections, and write chart and page after each of them.

    Raises
    ------
    EngineMissing
    """
    os.environ["OMP_NUM_THREADS"] = "1"  # one core each, for every side
    from lammps_cases.engine import session

    lmp = session.open_lammps()
    about, before = session.describe(lmp), machine()
    chosen = [name for name in SECTIONS if not names or name in names]
    sections: list[Section] = []
    begin = time.perf_counter()
    for k, name in enumerate(chosen):
        progress.advance(k, len(chosen), SECTIONS[name][0])
        sections.append(_section(name, quick, lmp))
        chart = Chart(command, before, about, quick, time.perf_counter() - begin, tuple(sections))
        record.write(chart, out)
    progress.advance(len(chosen), len(chosen), "report")
    page.write(chart, out)
    return chart


def _section(name: str, quick: bool, lmp: Any) -> Section:
    module, begin = importlib.import_module(f"lammps_cases.studies.chart.{name}"), time.perf_counter()
    panels = tuple(module.panels(quick, lmp))
    maps = tuple(module.maps(quick)) if hasattr(module, "maps") else ()
    flows = tuple(module.flows(quick)) if hasattr(module, "flows") else ()
    return Section(name, *SECTIONS[name], time.perf_counter() - begin, panels, maps, flows)
