"""eos-ref power."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import click
from annotated_types import Ge

from lammps_cases.cli import shared
from lammps_cases.cli.commands import command
from lammps_cases.cli.options import CLUSTER, LAUNCHER, Json, Processes, Resume
from lammps_cases.records.options import Option, Positional
from lammps_cases.records.progress import Bar
from lammps_cases.run.options import EngineName, LevelOptions, processes

if TYPE_CHECKING:
    from lammps_cases.studies.mutation.record import Power

Family = Literal["told", "read", "formula", "source"]


@command(LAUNCHER, CLUSTER)
def power_command(
    names: Annotated[tuple[str, ...], Positional(metavar="[SECTION|FAULT]...")] = (),
    family: Annotated[Family | None, Option("Only faults of this family.")] = None,
    quick_only: Annotated[bool, Option("Only the quick cases.")] = False,
    sample: Annotated[Annotated[int, Ge(1)] | None, Option("Only N of the faults, the same ones each time.")] = None,
    every: Annotated[
        bool, Option("Find every case that catches a fault, not only those of two files.", "--all")
    ] = False,
    jobs: Processes = None,
    resume: Resume = True,
    out: Annotated[Path, Option("Folder of the report.")] = Path("reports/power"),
    engine: EngineName = "env",
    *,
    level: LevelOptions,
    as_json: Json = False,
) -> int:
    """Plant faults in LAMMPS' input, in its output and in the formulas, and report which case catches each.

    Sections: faults, resolution (the smallest visible change of every parameter), alarms (failures although nothing is
    wrong); all by default, only the first if faults are named. Writes power.html and power.json; an interrupted run is
    resumed.

    \b
    Families: told     LAMMPS' input is altered    read    its output is corrupted
              formula  named mistakes in formulas  source  automatic mutations
    Example:  eos-ref power
              eos-ref power faults --quick-only
              eos-ref power 'told.cs-*' --all
    """
    from lammps_cases.run.provenance import command_line
    from lammps_cases.studies.mutation import catalogue, collect, page, record
    from lammps_cases.studies.mutation.fault import SECTIONS

    patterns = [name for name in names if name not in SECTIONS]
    sections = [name for name in names if name in SECTIONS] or (
        ["faults"] if patterns or family or sample else list(SECTIONS)
    )
    catalogue.check(patterns)
    shared.page_folder(out)
    with record.planted(out).resumed(resume), Bar(quiet=as_json) as bar:
        power = collect.collect(
            sections, patterns, family, sample, quick_only, every, engine, processes(jobs), out, command_line(), bar
        )
        record.write(power, out)
        page.write(power, out, level.level)
    if as_json:
        click.echo(json.dumps(record.document(power), indent=1))
    else:
        _show(power, out)
    headline = power.headline(level.level)
    if not as_json:
        shared.say(headline)
    return int(headline.state == "FAIL")


def _show(power: Power, out: Path) -> None:
    total = len(power.faults)
    for control in power.controls:
        own = [fault for fault in power.faults if fault.family == control.family]
        if not own:
            continue
        caught, quick = sum(bool(fault.caught_by) for fault in own), sum(fault.quick for fault in own)
        click.echo(f"{control.family:8s} {caught:4d} of {len(own):4d} caught, {quick:4d} by quick cases")
    if total:
        argued = sum(bool(fault.argued) for fault in power.missed)
        text = f"{power.caught} of {total} faults caught ({power.caught / total:.1%}), {power.quick} by quick cases"
        click.secho(f"{text} ({power.quick / total:.1%}); {argued} argued ({power.seconds:.0f} s)", bold=True)
        if power.whole:
            click.echo(power.statement)
        for fault in power.single:
            click.echo(f"  caught by a single file only: {fault.id}: {', '.join(fault.caught_by)}")
    for one in power.resolution:
        where = f"{one.relative_change:.1e} in {one.case}" if one.relative_change is not None else "not seen"
        click.echo(f"{one.parameter:28s} {where}")
    for run in power.alarms:
        click.echo(f"{run.kind:12s} {run.cases:4d} cases, {run.same_bits} bit-identical, {run.false} false alarms")
    for complaint in power.complaints:
        click.secho(f"  {complaint}", fg="red")
    click.echo(f"report: {out / 'power.html'}")
