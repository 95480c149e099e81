"""Measure a chart, section by section; what is finished is on disk before the next section begins."""

from __future__ import annotations

import importlib
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lammps_cases.records.progress import SILENT, Progress
from lammps_cases.studies.benchmarks.measure import machine
from lammps_cases.studies.chart import page, record
from lammps_cases.studies.chart.record import Chart, Section


@dataclass(frozen=True)
class Part:
    """A section to be: the module that has ``panels(quick, lmp)``, and maybe ``maps(quick)``, ``flows(quick)``."""

    name: str
    title: str
    about: str


PARTS: tuple[Part, ...] = (
    Part(
        "laws",
        "Equations of state",
        "Each law by every method, LAMMPS among them, against Arb. Near rho0 the printed power form loses all digits.",
    ),
    Part(
        "sums",
        "Sums over neighbours",
        "The same terms added up in different ways, against the exactly rounded sum.",
    ),
    Part(
        "kernels",
        "Kernels and cutoffs",
        "Gradients and densities of analytic fields on disordered particles, the reference and LAMMPS.",
    ),
    Part(
        "searches",
        "Neighbour search",
        "Pairs found, missed and invented; how often a list is built, and what it costs.",
    ),
    Part(
        "timestep",
        "Time step and threads",
        "What a shorter step buys, where the longest one lies, what two cores give.",
    ),
    Part("flows", "Flows with closed solutions", "The reference and LAMMPS, in turns, at several resolutions."),
)


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
    parts = [part for part in PARTS if not names or part.name in names]
    sections: list[Section] = []
    begin = time.perf_counter()
    for k, part in enumerate(parts):
        progress.advance(k, len(parts), part.title)
        sections.append(_section(part, quick, lmp))
        chart = Chart(command, before, about, quick, time.perf_counter() - begin, tuple(sections))
        record.write(chart, out)
    progress.advance(len(parts), len(parts), "report")
    page.write(chart, out)
    return chart


def _section(part: Part, quick: bool, lmp: Any) -> Section:
    module, begin = importlib.import_module(f"lammps_cases.studies.chart.{part.name}"), time.perf_counter()
    panels = tuple(module.panels(quick, lmp))
    maps = tuple(module.maps(quick)) if hasattr(module, "maps") else ()
    flows = tuple(module.flows(quick)) if hasattr(module, "flows") else ()
    return Section(part.name, part.title, part.about, time.perf_counter() - begin, panels, maps, flows)
