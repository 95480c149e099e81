"""eos-ref merge."""

from __future__ import annotations

from pathlib import Path

import click

from lammps_cases.cli import shared


@click.command("merge")
@click.argument("runs", nargs=-1, required=True, type=shared.PATH)
@shared.report_option
@shared.json_option
def merge_command(runs: tuple[Path, ...], out: Path, as_json: bool) -> int:
    """Join the report folders of a run's shards into one.

    \b
    Example:  eos-ref merge reports/shard-1 reports/shard-2 --out reports/latest
    """
    from lammps_cases.run.merge import merge

    return shared.finish(merge(runs, out), out, as_json)
