"""eos-ref validate."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import click

from lammps_cases.cli.shared import engine_option, folder_option, json_option, page_folder, resume_option
from lammps_cases.records.progress import Bar


@click.command("validate")
@click.argument("names", nargs=-1, metavar="[FLOW]...")
@click.option("--quick", is_flag=True, help="Coarse and short, for flows that allow it: about a minute.")
@folder_option("--out", "reports/validate", "Folder of the validation.")
@resume_option
@engine_option
@json_option
def validate_command(names: tuple[str, ...], quick: bool, out: Path, resume: bool, engine: str, as_json: bool) -> int:
    """Run flows with experimental, numerical or analytic data, in the reference and in LAMMPS. Never a verdict.

    FLOW: names as in the table; all by default. Writes report.html, validate.json, curves.csv and figures/ as SVG and
    PNG. Finished flows are kept: the same command resumes an interrupted run.

    \b
    Example:  eos-ref validate --quick
              eos-ref validate cavity bingham --out reports/validate

    Exit codes: 0, also where LAMMPS lost atoms, which page and table say; 2 for bad input, 3 without a LAMMPS.
    """
    import json

    from eos_ref.errors import InputError, nearest
    from lammps_cases.run.provenance import command_line
    from lammps_cases.studies.flows import record, run
    from lammps_cases.studies.flows.catalogue import VALIDATIONS

    for name in names:
        if name not in VALIDATIONS:
            raise InputError("flow", f"must be one of {', '.join(VALIDATIONS)}{nearest(name, VALIDATIONS)}", name)
    short = [name for name, of in VALIDATIONS.items() if of.quick or not quick]
    chosen = [VALIDATIONS[name] for name in dict.fromkeys(names or short)]
    page_folder(out)
    with record.runs(out).resumed(resume), Bar(quiet=as_json) as bar:
        validated = run.validate(chosen, out, command_line(), quick=quick, engine=engine, progress=bar)
    if as_json:
        click.echo(json.dumps(record.DOCUMENT.plain(validated), indent=1))
    else:
        _show(validated, out)
    return 0


def _show(validated: Any, out: Path) -> None:
    from lammps_cases.studies.flows.catalogue import VALIDATIONS
    from lammps_cases.studies.flows.page import stopped
    from lammps_cases.studies.flows.record import LAMMPS, REFERENCE

    for name in validated.flows:
        for panel in VALIDATIONS[name].panels:
            parts = []
            for side in (REFERENCE, LAMMPS):
                last = validated.of(name, side)[-1]
                order = validated.order(name, side, panel.name).order
                rate = f", order {order:5.2f}" if math.isfinite(order) else ""
                error = f"{last.errors[panel.name]:8.2g}{rate}" if last.errors else ""
                error = error or stopped(validated, name, side)
                parts.append(f"{side} {error}")
            click.echo(f"{name:18s} {panel.name:14s} {'; '.join(parts)}")
    click.echo(f"report: {out / 'report.html'}")
