"""eos-ref list."""

from __future__ import annotations

import json
from pathlib import Path

import click

from lammps_cases.cli import completion, shared


@click.command("list")
@click.argument("names", nargs=-1, metavar="[CASE]...", shell_complete=completion.cases)
@shared.tag_option
@shared.paths_option
@shared.json_option
def list_command(names: tuple[str, ...], tag: str | None, paths: tuple[Path, ...], as_json: bool) -> int:
    """List the cases with their tags.

    \b
    Example:  eos-ref list --tag quick
    """
    from lammps_cases.records.wording import counted
    from lammps_cases.scene import casefile

    cases = casefile.load(paths)
    if names or tag:
        cases = casefile.select(cases, names, tag)
    if as_json:
        click.echo(json.dumps({"cases": [{"case": c.name, "tags": list(c.tags)} for c in cases]}, indent=1))
        return 0
    laws = [", ".join(dict.fromkeys(law.style for law in c.scene.pressure)) for c in cases]
    rows = [(c.name, ", ".join(c.tags), styles, c.scene.units) for c, styles in zip(cases, laws, strict=True)]
    shared.table(("case", "tags", "laws", "units"), rows, counted(len(cases), "case"), drop=("units", "laws", "tags"))
    return 0
