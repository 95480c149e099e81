"""eos-ref chart."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Literal

import click

from lammps_cases.cli.commands import command
from lammps_cases.cli.options import LAUNCHER, Engines, Json, Resume, cluster
from lammps_cases.cli.shared import page_folder
from lammps_cases.records.options import Option, Positional
from lammps_cases.records.progress import Bar

SectionName = Literal["laws", "kernels", "timestep", "flows", "codes"]


@command(LAUNCHER, cluster("search the worst errors of the laws; everything timed runs on this machine"))
def chart_command(
    sections: Annotated[tuple[SectionName, ...], Positional()] = (),
    quick: Annotated[bool, Option("Fewer methods, regimes and resolutions: a minute or two.")] = False,
    out: Annotated[Path, Option("Folder of the chart.")] = Path("reports/chart"),
    engines: Engines = (),
    pysph: Annotated[
        str | None, Option("A Python with PySPH: one more of the complete codes.", metavar="PYTHON")
    ] = None,
    save_costs: Annotated[bool, Option('Save the laws\' times as those used by method="auto".')] = False,
    resume: Resume = True,
    as_json: Json = False,
) -> int:
    """Measure how accurate and how fast LAMMPS, the reference and its alternative methods are, and draw it.

    SECTIONS: laws, kernels, timestep, flows, codes; all by default. Writes report.html, chart.json,
    points.csv, convergence.csv and figures/ as SVG and PNG; an interrupted chart is resumed, section by section. For
    several engines the figures overlay the frontiers; each but the first has its own chart in a subfolder.

    \b
    Example:  eos-ref chart --quick
              eos-ref chart laws flows --out reports/chart
              eos-ref chart codes --pysph ~/pysph/bin/python
              eos-ref chart kernels --engine env --engine path:~/lammps/build
    """
    from eos_ref.errors import InputError
    from lammps_cases.run.provenance import command_line
    from lammps_cases.studies.chart import codes, collect, page, record

    if pysph and sections and "codes" not in sections:
        raise InputError("--pysph", "must come with the section codes", pysph)
    page_folder(out)
    with record.sections(out).resumed(resume), Bar(quiet=as_json) as bar:
        first, *others = engines or ("env",)
        chart = collect.collect(sections, quick, out, command_line(), bar, first, pysph)
        charts = [collect.compare_engines(engine, sections, quick, out, resume, bar) for engine in others]
        if charts:
            page.write(chart, out, charts)
        if save_costs:
            from lammps_cases.studies.chart import laws

            laws.save_costs(bar)
    if as_json:
        click.echo(json.dumps(record.points_document(chart), indent=1))
        return 0
    for section in chart.sections:
        best = sum(not p.dominated_by for panel in section.panels for p in panel.points)
        total = sum(len(panel.points) for panel in section.panels)
        flows = f", {len({run.flow for run in section.flows})} flows" if section.flows else ""
        if section.codes:
            for row in codes.rows(section.codes):
                click.echo("{:16s} {:8s} {:12s} N {:>3s} {:>6s} particles {:>6s} steps {:>8s} s  {}".format(*row))
        else:
            click.echo(f"{section.title:28s} {total:4d} points, {best} on a frontier{flows} ({section.seconds:.0f} s)")
    if words := codes.without(chart):
        click.echo(words)
    click.echo(f"report: {out / 'report.html'}")
    return 0
