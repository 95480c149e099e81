"""eos-ref examples."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import click

from lammps_cases.cli import shared
from lammps_cases.cli.commands import command
from lammps_cases.cli.options import LAUNCHER, Json, Resume
from lammps_cases.records.options import Argument, Option
from lammps_cases.records.progress import Bar
from lammps_cases.run.options import EngineName


@command(LAUNCHER)
def examples_command(
    names: Annotated[tuple[str, ...], Argument(metavar="[DECK]...")] = (),
    folder: Annotated[Path | None, Option("Folder with the decks, in.*.", "--from", metavar="DIR")] = None,
    full: Annotated[bool, Option("Run every deck to its end: about an hour.")] = False,
    trust: Annotated[bool, Option("Run decks of DIR with your own file permissions.", envvar="EOS_REF_TRUST")] = False,
    out: Annotated[Path, Option("Report folder.")] = Path("reports/examples"),
    resume: Resume = True,
    engine: EngineName = "env",
    as_json: Json = False,
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
