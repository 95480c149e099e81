"""eos-ref accept."""

from __future__ import annotations

import json
from typing import Annotated, Any

import click

from lammps_cases.cli.commands import command
from lammps_cases.cli.options import ACCEPTED, Baselines, Json, Run
from lammps_cases.records.options import Option


@command()
def accept_command(
    run: Run,
    *,
    reason: Annotated[str, Option("Why; kept with the baseline.")],
    baselines: Baselines = ACCEPTED,
    with_failures: Annotated[bool, Option("Accept even a run with unexpected failures.")] = False,
    prune: Annotated[bool, Option("Drop cases that are not in the run.")] = False,
    as_json: Json = False,
) -> int:
    """Accept a run as the baseline of its engine, and say what that changes.

    A run of some cases replaces only these. eos-ref run --baseline compares later runs with it.

    \b
    Example:  eos-ref accept reports/latest --reason "first baseline of 2025.7.22.4.0"
    """
    from lammps_cases.regression import evidence, pairs
    from lammps_cases.regression.acceptance import accept
    from lammps_cases.run.provenance import command_line

    accepted = accept(run, reason, baselines, command_line(), with_failures, prune)
    changes = accepted.changes
    if accepted.written and baselines.resolve() == evidence.BASELINES:
        evidence.publish()
    if as_json:
        document: dict[str, Any] = {
            "baseline": str(accepted.folder),
            "cases": accepted.cases,
            "written": accepted.written,
            "counts": changes.counts if changes else None,
            "dropped": list(accepted.dropped),
            "fields": [pairs.row(change) for change in changes.faults] if changes else [],
        }
        click.echo(json.dumps(document, indent=1))
        return 0
    if changes is None:
        click.echo(f"first baseline of this engine: {accepted.cases} cases")
    else:
        for line in (*pairs.lines(changes, "the old", "the new"), *pairs.faults(changes)):
            click.echo(line)
    if accepted.dropped:
        click.echo(f"dropped: {', '.join(accepted.dropped)}")
    click.secho(f"baseline: {accepted.folder}{'' if accepted.written else ' (unchanged)'}", bold=True)
    return 0
