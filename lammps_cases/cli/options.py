"""Options that several commands have, as annotations of their parameters, and those that act when they are read."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import click
from annotated_types import Ge

from lammps_cases.records.options import Option, Positional

Run = Annotated[Path, Positional()]
Json = Annotated[bool, Option("Print only one JSON document.", "--json")]
Report = Annotated[Path | None, Option("Report folder.  [default: by date, in reports or reports/parts]")]
Engines = Annotated[
    tuple[str, ...],
    Option("env (default), pypi:VERSION or path:PLACE; may be repeated.", "--engine", complete="engines"),
]
Processes = Annotated[Annotated[int, Ge(1)] | None, Option("Processes at a time (default: one per core).")]
Resume = Annotated[bool, Option("Keep the parts that the folder has (default), or redo all.", "--resume/--fresh")]
Baselines = Annotated[Path, Option("Folder of the baselines, one per engine.")]
ACCEPTED = Path("reports/accepted")
Deck = Annotated[Path | None, Option("Engines audit this deck, or all decks of this folder, instead of running cases.")]


def _use_launcher(_: click.Context, __: click.Parameter, template: str | None) -> None:
    """Leave the launcher where the processes of the engine look for it."""
    if template:
        from lammps_cases.engine import mpi

        os.environ[mpi.VARIABLE] = mpi.checked(template)


def _limit_memory(context: click.Context, _: click.Parameter, text: str | None) -> None:
    """Have the pools of processes of a command keep to a limit."""
    if text:
        from lammps_cases.engine import pool

        context.with_resource(pool.limited(text))


def _use_cluster(context: click.Context, _: click.Parameter, scheduler: str | None) -> None:
    """Have the workers of a cluster do the tasks of a command."""
    if scheduler:
        from lammps_cases.engine import cluster

        context.with_resource(cluster.used(scheduler))


LAUNCHER = click.Option(
    ["--launcher"],
    metavar="COMMAND",
    envvar="EOS_REF_LAUNCHER",
    expose_value=False,
    callback=_use_launcher,
    help="How to start several ranks: 'mpirun -n {n}', 'srun -n {n}' (default: that of LAMMPS' MPI).",
)
MEMORY = click.Option(
    ["--memory"],
    metavar="SIZE",
    envvar="EOS_REF_MEMORY",
    expose_value=False,
    callback=_limit_memory,
    help="Memory of each LAMMPS process: 500M, 4G, 1T (default: its share of 80 % of the machine).",
)


def cluster(what: str) -> click.Option:
    """Return the option of a Dask cluster; ``what`` its workers do."""
    text = f"Scheduler of a Dask cluster (tcp://HOST:PORT), whose workers {what}."
    return click.Option(["--cluster"], metavar="ADDRESS", expose_value=False, callback=_use_cluster, help=text)


CLUSTER = cluster("take the place of --jobs")
