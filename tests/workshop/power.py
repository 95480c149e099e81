"""eos-ref power."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from lammps_cases.cli import shared
from lammps_cases.records.levels import FailOn
from lammps_cases.records.progress import Bar

if TYPE_CHECKING:
    from tests.workshop.faults.record import Power

FAMILIES = ("told", "read", "formula", "source")


@click.command("power")
@click.argument("names", nargs=-1, metavar="[SECTION|FAULT]...")
@click.option("--family", type=click.Choice(FAMILIES), help="Only faults of this family.")
@click.option("--quick-only", is_flag=True, help="Only the quick cases.")
@click.option("--sample", type=click.IntRange(1), help="Only N of the faults, the same ones each time.")
@click.option("--all", "every", is_flag=True, help="Find every case that catches a fault, not only those of two files.")
@shared.processes_option
@shared.cluster_option
@shared.resume_option
@shared.folder_option("--out", "reports/power", "Folder of the report.")
@shared.engine_option
@shared.fail_on_option
@shared.json_option
def power_command(
    names: tuple[str, ...],
    family: str | None,
    quick_only: bool,
    sample: int | None,
    every: bool,
    jobs: int,
    resume: bool,
    out: Path,
    engine: str,
    fail_on: FailOn | None,
    as_json: bool,
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
    from tests.workshop.faults import catalogue, collect, page, record
    from tests.workshop.faults.fault import SECTIONS

    patterns = [name for name in names if name not in SECTIONS]
    sections = [name for name in names if name in SECTIONS] or (
        ["faults"] if patterns or family or sample else list(SECTIONS)
    )
    catalogue.check(patterns)
    shared.page_folder(out)
    with record.planted(out).resumed(resume), Bar(quiet=as_json) as bar:
        power = collect.collect(
            sections, patterns, family, sample, quick_only, every, engine, jobs, out, command_line(), bar
        )
        record.write(power, out)
        page.write(power, out, fail_on or "new")
    if as_json:
        click.echo(json.dumps(record.document(power), indent=1))
    else:
        _show(power, out)
    headline = power.headline(fail_on or "new")
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
