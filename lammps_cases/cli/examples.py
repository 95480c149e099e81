"""eos-ref examples."""

from __future__ import annotations

import json
from pathlib import Path

import click

from lammps_cases.cli import shared
from lammps_cases.records.progress import Bar


@click.command("examples")
@click.argument("names", nargs=-1, metavar="[DECK]...")
@click.option("--from", "folder", type=shared.PATH, metavar="DIR", help="Folder with the decks, in.*.")
@click.option("--full", is_flag=True, help="Run every deck to its end: about an hour.")
@click.option("--trust", is_flag=True, envvar="EOS_REF_TRUST", help="Run decks of DIR with your own file permissions.")
@click.option("--out", type=shared.PATH, default="reports/examples", show_default=True, help="Report folder.")
@shared.resume_option
@shared.engine_option
@shared.json_option
def examples_command(
    names: tuple[str, ...],
    folder: Path | None,
    full: bool,
    trust: bool,
    out: Path,
    resume: bool,
    engine: str,
    as_json: bool,
) -> int:
    """Judge LAMMPS' own RHEO examples, and break them down: what they conserve, what their errors consist of.

    Every field is checked while LAMMPS runs the deck. Momentum and energy are followed part by part of the model. Where
    the flow has a closed solution, the reference runs the deck with one thing changed at a time. Decks are those that
    are installed with this LAMMPS, otherwise those of --from DIR. An interrupted run is resumed, deck by deck.

    \b
    Examples: eos-ref examples --engine path:~/lammps/build
              eos-ref examples taylor-green --from ~/lammps/examples/rheo
    """
    from lammps_cases.engine import installations
    from lammps_cases.examples import collect, decks, page
    from lammps_cases.run import provenance

    chosen = installations.resolve(engine)
    shipped = decks.decks(chosen, folder, names)
    shared.page_folder(out)
    with collect.judged(out).resumed(resume), Bar(quiet=as_json) as bar:
        made = collect.collect(
            shipped, chosen, out, provenance.command_line(), full=full, trust=trust or folder is None, progress=bar
        )
        page.write(made, out)
    if as_json:
        click.echo(json.dumps(collect.DOCUMENT.plain(made), indent=1))
        return page.of_outcome(made).exit_code
    for line in page.lines(made):
        click.echo(line)
    click.echo(f"report: {out / 'report.html'}")
    shared.say(page.of_outcome(made).headline)
    return page.of_outcome(made).exit_code
