"""eos-ref kit."""

from __future__ import annotations

import json
import shlex
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import click
from annotated_types import Interval
from click.core import ParameterSource

from lammps_cases.cli.commands import command
from lammps_cases.cli.options import Json
from lammps_cases.records.options import Argument, Option
from lammps_cases.run.options import paths

if TYPE_CHECKING:
    from lammps_cases.ci.kits.files import KitFile
    from lammps_cases.run.shards import Costs


OF_SHARDS = (
    "out",
    "shard",
    "costs",
    "jobs",
    "baseline",
    "as_json",
)  # options of a run that a kit gives, or cannot give


@command()
def kit_command(
    name: Annotated[str | None, Argument()] = None,
    out: Annotated[Path | None, Option("Folder or repository to write into.  [default: print]")] = None,
    repository: Annotated[
        str,
        Option("For CI kits: GitHub repository from which the files install eos-ref.", metavar="OWNER/NAME"),
    ] = "OWNER/eos-ref",
    shards: Annotated[Annotated[int, Interval(ge=1, le=999_999)], Option("For cluster kits: shards.")] = 4,
    options: Annotated[
        str, Option("For cluster kits: cases and options of eos-ref run.", "--run", metavar="OPTIONS")
    ] = "",
    as_json: Json = False,
) -> int:
    """Write or print the files of a kit. Without NAME: list them.

    For CI: github, gitlab, lammps, decks, pre-commit. For a cluster: slurm, parallel, reframe; their shards take about
    equally long according to the durations in the history. For LAMMPS' own tree: unittest.

    \b
    Example:  eos-ref kit github --repository me/eos-ref --out .
              eos-ref kit slurm --shards 16 --run '--tag eos --engine path:build' --out campaign
              eos-ref kit unittest --out lammps
    """
    from eos_ref import InputError
    from lammps_cases.ci.kits.files import KITS, in_repository, in_shards, kit, write

    if name is None:
        kits = [{"kit": each.name, "about": each.about, "files": list(each.files)} for each in KITS]
        click.echo(json.dumps({"kits": kits}, indent=1) if as_json else "\n".join(map(str, KITS)))
        return 0
    chosen, notes = kit(name), list[str]()
    _check_options(name, ("--shards", "--run") if not chosen.cluster else ("--repository",))
    if chosen.cluster:
        try:
            words = shlex.split(options)
        except ValueError as error:
            raise InputError("--run", f"must be words as a shell takes them: {error}", options) from None
        costs, note = _costs(words, shards)
        files = chosen.filled(in_shards(costs, shards, words))
        notes.append(note)
    else:
        files = chosen.filled(in_repository(repository))
        if chosen.tests:
            if out is None and not as_json:
                raise InputError("--out", "is needed: the kit has a hundred files", where="kit unittest")
            files += _upstream_files(out, notes)
        if "OWNER/" in repository:
            notes.append(f"replace {repository} with your repository (--repository)")
    written = write(files, out) if out else []
    if as_json:
        click.echo(json.dumps({"kit": name, "files": [asdict(file) for file in files]}, indent=1))
    elif out:
        for path in written:
            click.echo(path)
    else:
        _print(files)
    for note in notes:
        click.echo(note, err=True)
    return 0


def _check_options(name: str, others: Sequence[str]) -> None:
    """Refuse the options of other kits."""
    from eos_ref import InputError

    context = click.get_current_context()
    for param in context.command.params:
        given = context.get_parameter_source(str(param.name)) is ParameterSource.COMMANDLINE
        if given and param.opts[0] in others:
            raise InputError(f"option {param.opts[0]}", "is not one of this kit", name)


def _upstream_files(out: Path | None, notes: list[str]) -> list[KitFile]:
    """Return the tests and decks for LAMMPS' own tree; note it if no LAMMPS is there that writes the decks' logs."""
    from lammps_cases.engine import installations
    from lammps_cases.engine.session import EngineMissing
    from lammps_cases.upstream.examples import example_files
    from lammps_cases.upstream.files import kit_files

    files = kit_files()
    try:
        return [*files, *example_files(installations.resolve("env"), out)]
    except EngineMissing as error:
        notes.append(f"the decks come without logs: {error}")
        return [*files, *example_files(None)]


def _print(files: Sequence[KitFile]) -> None:
    """Print files one after the other, each under its path if there are more than one."""
    for file in files:
        if len(files) > 1:
            click.echo(f"# ----- {file.path}")
        click.echo(file.content, nl=False)


def _costs(words: list[str], shards: int) -> tuple[Costs, str]:
    """Return what the cases of a run cost, and a line about the shards; the engine is there afterwards.

    Raises
    ------
    InputError, click.UsageError
        Options that ``eos-ref run`` would refuse, or that each shard has of its own.
    """
    from eos_ref import InputError
    from lammps_cases.cli.run import run_command
    from lammps_cases.engine import installations
    from lammps_cases.history.store import History, history_file
    from lammps_cases.records.wording import counted
    from lammps_cases.run.shards import Costs, balanced
    from lammps_cases.scene import casefile

    context = run_command.make_context("eos-ref run", list(words))
    for option in run_command.params:
        given = option.name and context.get_parameter_source(option.name) is ParameterSource.COMMANDLINE
        if given and option.name in OF_SHARDS:
            raise InputError("--run", "must leave to the kit what each shard has of its own", option.opts[0])
    options = context.params
    cases = casefile.select(casefile.load(paths(options["cases"])), options["names"], options["tag"])
    if shards > len(cases):
        raise InputError("--shards", f"must be at most one for each of {counted(len(cases), 'case')}", shards)
    installations.resolve(options["engine"])  # nodes have no internet
    place, slowest = history_file(), dict[str, float]()
    if place:
        with History(place) as history:
            slowest = history.slowest()
    costs = Costs(seconds={case.name: slowest[case.name] for case in cases if case.name in slowest})
    seconds = costs.of(case.name for case in cases)
    busy = [sum(seconds[case] for case in shard) for shard in balanced(seconds, shards)]
    share = f"{len(costs.seconds)} of {counted(len(cases), 'case')} measured"
    return costs, f"{counted(shards, 'shard')} of {min(busy):.1f} to {max(busy):.1f} s, {share}"
