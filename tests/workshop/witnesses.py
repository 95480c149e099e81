"""eos-ref witnesses."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from lammps_cases.cli import completion, shared
from lammps_cases.records.progress import Bar
from lammps_cases.records.wording import counted

if TYPE_CHECKING:
    from tests.workshop.faults.witnesses import RuleRow

MOST_NAMES = 3  # of the cases of a rule and dimension; the rest is counted


@click.command("witnesses")
@click.argument("names", nargs=-1, metavar="[CASE]...", shell_complete=completion.cases)
@click.option("--all", "every", is_flag=True, help="All rules that a case exercises, not only those it names: minutes.")
@shared.folder_option("--out", "reports/witnesses", "Folder of the page.")
@shared.processes_option
@shared.fresh_option
@shared.json_option
def witnesses_command(names: tuple[str, ...], every: bool, out: Path, jobs: int, fresh: bool, as_json: bool) -> int:
    """List every rule of the reference with the cases that depend on it, found by breaking the rule.

    A case is a witness of a rule if a mistake that breaks it takes a compared field out of its bound. Every rule needs
    two witnesses in different scenes, in 2D and in 3D; and a case has to be a witness of every rule that it names
    (`exercises`). Writes witnesses.html; LAMMPS is not run. Exit code 1 if a rule or a case falls short.

    \b
    Example:  eos-ref witnesses
              eos-ref witnesses 'surfaces-3d.*' --all
    """
    from lammps_cases.comparison.prediction_keys import open_store
    from lammps_cases.run.provenance import command_line
    from lammps_cases.scene import casefile
    from tests.workshop.faults import witnesses, witnesses_page

    cases = casefile.select(casefile.load(), names)
    shared.page_folder(out)
    with Bar(quiet=as_json) as bar:
        examined = witnesses.collect(cases, every, jobs, open_store(fresh), bar)
    rows = witnesses.rows(examined)
    complaints = list(witnesses.complaints(cases, examined, rules=not names))
    witnesses_page.write(rows, complaints, len(examined), out, command_line(), whole=not names)
    if as_json:
        table = [asdict(row) | {"missing": row.missing} for row in rows]
        click.echo(json.dumps({"rules": table, "complaints": complaints}, indent=1))
        return int(bool(complaints))
    columns = ("rule", "witnesses in 2D", "in 3D", "what the reference does")
    shown = [row for row in rows if not names or any(row.cases.values())]  # of some cases those alone that they witness
    shared.table(
        columns, [(row.rule, _cases(row, 2), _cases(row, 3), row.sentence) for row in shown], prose=columns[1:]
    )
    of_all = f"{len(shown)} of {counted(len(rows), 'rule')}" if names else counted(len(rows), "rule")
    complained = counted(len(complaints), "complaint")
    click.secho(f"{of_all}, {counted(len(examined), 'case')}, {complained}", bold=True)
    for complaint in complaints:
        click.secho(f"  {complaint}", fg="red")
    click.echo(f"report: {out / 'witnesses.html'}")
    return int(bool(complaints))


def _cases(row: RuleRow, dimension: int) -> str:
    names: Sequence[str] = row.cases[dimension]
    more = f", {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    return ", ".join(names[:MOST_NAMES]) + more
