"""eos-ref list."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Annotated, Any

import click

from lammps_cases.cli import shared
from lammps_cases.cli.commands import command
from lammps_cases.cli.options import Json
from lammps_cases.records.options import Argument
from lammps_cases.run.options import Files, Tag, paths

if TYPE_CHECKING:
    from lammps_cases.scene.casefile import Case


@command()
def list_command(
    names: Annotated[tuple[str, ...], Argument(metavar="[CASE]...", complete="cases")] = (),
    tag: Tag = None,
    files: Files = (),
    as_json: Json = False,
) -> int:
    """List the cases with their tags; --json also says what each is about, and how large it is.

    \b
    Example:  eos-ref list --tag quick
    """
    from lammps_cases.records.wording import counted
    from lammps_cases.scene import casefile

    cases = casefile.load(paths(files))
    if names or tag:
        cases = casefile.select(cases, names, tag)
    if as_json:
        click.echo(json.dumps({"cases": [_document(case) for case in cases]}, indent=1))
        return 0
    rows = [(c.name, ", ".join(c.tags), ", ".join(_laws(c)), c.scene.units) for c in cases]
    shared.table(("case", "tags", "laws", "units"), rows, counted(len(cases), "case"), drop=("units", "laws", "tags"))
    return 0


def _laws(case: Case) -> list[str]:
    """Return the laws of a case, each once."""
    return list(dict.fromkeys(law.style for law in case.scene.pressure))


def _document(case: Case) -> dict[str, Any]:
    """Return what a script chooses cases by."""
    from lammps_cases.scene import atoms

    scene = case.scene
    return {
        "case": case.name,
        "about": case.about,
        "file": str(case.source),
        "tags": list(case.tags),
        "laws": _laws(case),
        "units": scene.units,
        "dimension": scene.dimension,
        "atoms": len(atoms.build(case, None)),
        "steps": scene.evolve.steps if scene.evolve else 0,
        "fields": [] if scene.expect else list(scene.compare),
    }
