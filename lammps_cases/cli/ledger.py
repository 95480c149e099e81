"""eos-ref ledger."""

from __future__ import annotations

import json
from collections.abc import Sequence

import click

from lammps_cases.cli import shared
from lammps_cases.records.wording import by_file


@click.command("ledger")
@click.argument("names", nargs=-1, metavar="[FINDING]...")
@shared.json_option
def ledger_command(names: tuple[str, ...], as_json: bool) -> int:
    """List the findings, all or some: where LAMMPS differs from its manual, why, and what to do meanwhile.

    \b
    Example:  eos-ref ledger
    """
    from eos_ref.errors import unknown
    from lammps_cases.findings import LEDGER, accepted_cases

    known = [entry.id for entry in LEDGER]
    for name in names:
        if name not in known:
            raise unknown("finding", name, known)
    chosen = [entry for entry in LEDGER if not names or entry.id in names]
    shown_by = accepted_cases()
    if as_json:
        entries = [
            {name: getattr(entry, name) for name in ("id", "title", "severity", "engines", "upstream")}
            | {"cases": shown_by.get(entry.id, []), "variant": entry.named_variant}
            for entry in chosen
        ]
        click.echo(json.dumps({"entries": entries}, indent=1))
        return 0
    for entry in chosen:
        click.secho(f"{entry.id} ({entry.severity}): {entry.title}", bold=True)
        for key in ("documented", "observed", "argument", "workaround"):
            click.echo(f"  {key}: {getattr(entry, key)}")
        if entry.scene:
            click.echo(f"  smallest scene: {entry.scene}; reproduced by: {entry.named_variant}")
        cases = _cases(shown_by.get(entry.id, []), entry.applies_to)
        click.echo(f"  seen in: {', '.join(entry.engines)}; shown by: {cases}")
        click.echo(f"  upstream: {entry.upstream}; eos-ref report-bug {entry.id}")
    return 0


def _cases(cases: Sequence[str], applies_to: Sequence[str]) -> str:
    """Name cases, or count them by their files; without any, name what the finding applies to."""
    return by_file(cases) if cases else f"{', '.join(applies_to) or 'no case'} (in no accepted run)"
