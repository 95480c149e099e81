"""Measure a chart, section by section; sections in the folder are not measured again."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from lammps_cases.comparison.store import code, fingerprint
from lammps_cases.engine import installations
from lammps_cases.engine.installations import library_sha256
from lammps_cases.engine.session import EngineMissing, Session
from lammps_cases.records.folders import folder_name
from lammps_cases.records.measure import machine
from lammps_cases.records.progress import SILENT, Progress
from lammps_cases.studies.chart import codes, flows, kernels, laws, page, record
from lammps_cases.studies.chart.record import Chart, Section

# Title and content of every section.
SECTIONS = {
    "codes": (
        "Whole codes",
        "The same flows, each code by a scheme that it documents: error against the processor time of all steps "
        "of a run on one core. What comes before the first step is left out. Numbers at marks: particles per length.",
    ),
    "laws": (
        "Equations of state",
        "Each law by every method, LAMMPS among them, against Arb. Near rho0 the printed power form loses all digits.",
    ),
    "kernels": (
        "Kernels and cutoffs",
        "Gradients and densities of analytic fields on disordered particles, the reference and LAMMPS.",
    ),
    "timestep": ("Time step", "What a shorter step buys; where longer ones fail, eos-ref stability maps."),
    "flows": ("Kernels in flows", "What a kernel and its cutoff gain in a flow with a closed solution."),
}
PANELS = {
    "laws": laws.panels,
    "kernels": kernels.panels,
    "timestep": flows.step_panels,
    "flows": flows.kernel_panels,
}
MAPS = {"laws": laws.maps, "kernels": kernels.maps}


def collect(
    names: Sequence[str],
    quick: bool,
    out: Path,
    command: str,
    progress: Progress = SILENT,
    engine: str = "env",
    pysph: str | None = None,
) -> Chart:
    """Measure sections, then write and draw the chart, if interrupted that of the finished sections.

    Parameters
    ----------
    pysph : str, optional
        A Python that has PySPH, as a further whole code.

    Raises
    ------
    InputError
        No such engine; that Python cannot run PySPH.
    EngineMissing
    """
    os.environ["OMP_NUM_THREADS"] = "1"  # one core each, for every side
    peers = {"pysph": codes.pysph_version(pysph)} if pysph else {}  # before anything is measured
    site = installations.resolve(engine).site
    session = Session(site)
    about, before = session.describe() | peers, machine()
    chosen = [name for name in SECTIONS if not names or name in names]
    sections, kept, begin = list[Section](), record.sections(out), time.perf_counter()
    origin = code(), library_sha256(about.get("library", "")), quick, pysph or "", sorted(peers.items())
    try:
        for k, name in enumerate(chosen):
            key = fingerprint(name, origin)
            section = kept.get(key)
            if section is None:
                progress.advance(k, len(chosen), SECTIONS[name][0])
                section = kept.add(key, _section(name, quick, session, pysph))
            sections.append(section)
        progress.advance(len(chosen), len(chosen), "report")
    finally:
        seconds = time.perf_counter() - begin + kept.earlier
        chart = Chart(command, before, about, quick, seconds, tuple(sections))
        if sections:
            record.write(chart, out)
            page.write(chart, out)
    return chart


def compare_engines(
    engine: str, names: Sequence[str], quick: bool, out: Path, resume: bool = True, progress: Progress = SILENT
) -> Chart:
    """Measure the same sections on another engine in a separate process, as two libraries do not fit into one.

    Raises
    ------
    EngineMissing
        The other process failed; with its last line.
    """
    folder = out / folder_name(engine)
    switches = [*(["--quick"] if quick else []), "--resume" if resume else "--fresh"]
    options = [*names, *switches, "--engine", engine, "--out", str(folder)]
    progress.advance(0, 1, f"the same on {engine}")
    command = [sys.executable, "-m", "lammps_cases.cli.main", "chart", *options]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise EngineMissing((done.stderr.strip().splitlines() or [f"{engine}: exit code {done.returncode}"])[-1])
    return record.DOCUMENT.read(folder / "chart.json")


def _section(name: str, quick: bool, session: Session, pysph: str | None) -> Section:
    begin = time.perf_counter()
    panels = tuple(PANELS[name](quick, session)) if name in PANELS else ()
    maps = tuple(MAPS[name](quick)) if name in MAPS else ()
    compared = tuple(codes.codes(quick, session.site, pysph)) if name == "codes" else ()
    return Section(name, *SECTIONS[name], time.perf_counter() - begin, panels, maps, compared)
