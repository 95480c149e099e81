"""eos-ref report-bug."""

from __future__ import annotations

from pathlib import Path

import click

from lammps_cases.cli import completion, shared


@click.command("report-bug")
@click.argument("name", metavar="FINDING|CASE", shell_complete=completion.findings_and_cases)
@shared.engine_option
@shared.paths_option
@click.option("--out", type=shared.PATH, help="Folder of the files.  [default: reports/bug-NAME]")
def report_bug_command(name: str, engine: str, paths: tuple[Path, ...], out: Path | None) -> int:
    """Write a self-contained bug report for a finding or a failing case.

    in.lammps computes the number obtained and prints it with the number expected and PASS or FAIL, under LAMMPS alone;
    issue.md is in the form of LAMMPS' template.

    \b
    Example:  eos-ref report-bug walls-moving.driven.quintic
              eos-ref report-bug FINDING --engine pypi:2025.7.22.1.0 --out bug    (eos-ref ledger lists the findings)
    """
    from lammps_cases.bugs import bare, issue, report
    from lammps_cases.engine import installations
    from lammps_cases.records.files import write_atomically
    from lammps_cases.records.wording import folder_name

    chosen = installations.resolve(engine)
    made = report.make(name, chosen, paths)
    folder = out or Path("reports") / f"bug-{folder_name(made.name)}"
    shared.page_folder(folder)
    ending = bare.run(made.deck, chosen)
    files = [*made.deck.write(folder), folder / "issue.md"]
    write_atomically(files[-1], issue.text(made, ending))
    verdict = ending.verdict(made.deck)
    click.secho(f"{verdict} on LAMMPS ({ending.version}): {made.title}", bold=True)
    for file in files:
        click.echo(f"written: {file}")
    return 0
