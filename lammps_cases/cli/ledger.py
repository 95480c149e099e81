"""eos-ref ledger."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import click

from lammps_cases.cli import shared
from lammps_cases.cli.commands import command
from lammps_cases.cli.options import Json
from lammps_cases.records.levels import SEVERITIES
from lammps_cases.records.options import Argument
from lammps_cases.records.wording import by_file, counted

if TYPE_CHECKING:
    from lammps_cases.findings import Finding


@command()
def ledger_command(
    names: Annotated[tuple[str, ...], Argument(metavar="[FINDING]...", complete="findings")] = (), as_json: Json = False
) -> int:
    """List the findings, the most severe first: where LAMMPS differs from its manual.

    With names, show the details of these: the argument, and workarounds.

    \b
    Example:  eos-ref ledger
              eos-ref ledger ID
    """
    say(names, as_json)
    return 0


def say(names: Sequence[str], as_json: bool) -> None:
    """Print the ledger, or all about some findings.

    Raises
    ------
    InputError
        A name that is of no finding.
    """
    from lammps_cases.findings import LEDGER, accepted_cases, check_names

    check_names(names)
    chosen = [entry for entry in LEDGER if not names or entry.id in names]
    shown_by = accepted_cases()
    if as_json:
        entries = [
            {name: getattr(entry, name) for name in ("id", "title", "severity", "engines", "upstream")}
            | {"cases": shown_by.get(entry.id, []), "variant": entry.named_variant}
            for entry in chosen
        ]
        click.echo(json.dumps({"entries": entries}, indent=1))
        return
    if names:
        for entry in chosen:
            show(entry, shown_by.get(entry.id, []))
        return
    rows = [
        (entry.severity, entry.id, entry.title, _versions(entry.engines))
        for entry in sorted(chosen, key=lambda entry: SEVERITIES.index(entry.severity))
    ]
    columns = ("severity", "id", "title", "seen on")
    shared.table(columns, rows, counted(len(rows), "finding"), drop=columns[:1:-1], prose=("title",))
    click.echo("eos-ref ledger ID shows the details of one")


def show(entry: Finding, cases: Sequence[str]) -> None:
    """Print all about a finding."""
    shared.show(f"{entry.id} ({entry.severity}): {entry.title}", "  ", bold=True)
    for key in ("documented", "observed", "argument", "workaround"):
        shared.show(f"  {key}: {getattr(entry, key)}", "    ")
    if entry.scene:
        shared.show(f"  smallest scene: {entry.scene}; reproduced by: {entry.named_variant}", "    ")
    shown = _cases(cases, entry.applies_to)
    shared.show(f"  seen in: {', '.join(entry.engines) or 'none'}; shown by: {shown}", "    ")
    shared.show(f"  upstream: {entry.upstream}; eos-ref report-bug {entry.id}", "    ")


def _versions(engines: Sequence[str]) -> str:
    """Return versions of LAMMPS, the first and the last of those in a row."""
    from lammps_cases.findings import KNOWN

    at = [KNOWN.index(engine) for engine in engines if engine in KNOWN]
    in_a_row = len(at) > 2 and at == list(range(at[0], at[0] + len(engines)))
    return f"{engines[0]} to {engines[-1]}" if in_a_row else ", ".join(engines)


def _cases(cases: Sequence[str], applies_to: Sequence[str]) -> str:
    """Name cases, or count them by their files; without any, name what the finding applies to."""
    return by_file(cases) if cases else f"{', '.join(applies_to) or 'no case'} (in no accepted run)"
