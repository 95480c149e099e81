"""eos-ref report-bug."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import click

from lammps_cases.cli import shared
from lammps_cases.cli.commands import command
from lammps_cases.cli.options import LAUNCHER
from lammps_cases.records.options import Argument, Option
from lammps_cases.run.options import EngineName, Files, paths


@command(LAUNCHER)
def report_bug_command(
    name: Annotated[str, Argument(metavar="FINDING|CASE", complete="findings_and_cases")],
    engine: EngineName = "env",
    files: Files = (),
    out: Annotated[Path | None, Option("Folder of the files.  [default: reports/bug-NAME]")] = None,
) -> int:
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
    made = report.make(name, chosen, tuple(paths(files)))
    folder = out or Path("reports") / f"bug-{folder_name(made.name)}"
    shared.page_folder(folder)
    ending = bare.run(made.deck, chosen)
    written = [*made.deck.write(folder), folder / "issue.md"]
    write_atomically(written[-1], issue.text(made, ending))
    verdict = ending.verdict(made.deck)
    click.secho(f"{verdict} on LAMMPS ({ending.version}): {made.title}", bold=True)
    for file in written:
        click.echo(f"written: {file}")
    return 0
