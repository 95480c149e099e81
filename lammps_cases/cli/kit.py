"""eos-ref kit."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import click

from lammps_cases.cli import shared


@click.command("kit")
@click.argument("name", required=False)
@click.option("--out", type=shared.PATH, help="Repository to write into.  [default: print]")
@click.option(
    "--repository",
    default="OWNER/eos-ref",
    show_default=True,
    metavar="OWNER/NAME",
    help="Where on GitHub eos-ref lies: the files install it from there.",
)
@shared.json_option
def kit_command(name: str | None, out: Path | None, repository: str, as_json: bool) -> int:
    """Write or print the files of a kit: github, gitlab, lammps, decks, pre-commit. Without NAME: list them.

    \b
    Example:  eos-ref kit github --repository me/eos-ref --out .
              eos-ref kit lammps
    """
    from lammps_cases.ci.kits.files import KITS, kit, write

    if name is None:
        kits = [{"kit": each.name, "about": each.about, "files": list(each.files)} for each in KITS]
        click.echo(json.dumps({"kits": kits}, indent=1) if as_json else "\n".join(map(str, KITS)))
        return 0
    files = kit(name).filled(repository)
    written = write(files, out) if out else []
    if as_json:
        click.echo(json.dumps({"kit": name, "files": [asdict(file) for file in files]}, indent=1))
    elif out:
        for path in written:
            click.echo(path)
    else:
        for file in files:
            if len(files) > 1:
                click.echo(f"# ----- {file.path}")
            click.echo(file.content, nl=False)
    if "OWNER/" in repository:
        click.echo(f"replace {repository} by your repository (--repository)", err=True)
    return 0
