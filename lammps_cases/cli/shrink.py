"""eos-ref shrink."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import click

from lammps_cases.cli import shared
from lammps_cases.cli.commands import command
from lammps_cases.cli.options import LAUNCHER, Json
from lammps_cases.records.options import Argument, Option
from lammps_cases.records.progress import Bar
from lammps_cases.run.options import EngineName, Files, paths


@command(LAUNCHER)
def shrink_command(
    name: Annotated[str, Argument(metavar="CASE", complete="cases")],
    files: Files = (),
    engine: EngineName = "env",
    finding: Annotated[str, Option("Preserve a finding that explains the case, not a difference.")] = "",
    out: Annotated[Path | None, Option("Case file to write.  [default: reports/shrunk/CASE.yaml]")] = None,
    as_json: Json = False,
) -> int:
    """Make the smallest scene that still fails the same way: particles, types, keywords, steps, digits.

    The same way: the same verdict, in the same field; or the same finding explains it; or LAMMPS ends with the same
    error. Parts are removed until none can be; the result is a new case file.

    \b
    Example:  eos-ref shrink mine --cases mine.yaml --out small.yaml
              eos-ref shrink forces.all.rk1.2d --finding ID
    """
    shared.start_fork_server()
    from eos_ref import InputError
    from lammps_cases.engine import installations
    from lammps_cases.findings import check_names
    from lammps_cases.records.files import write_atomically
    from lammps_cases.scene import casefile
    from lammps_cases.shrink import shrink

    check_names([finding] if finding else [])
    case = casefile.only(casefile.load(paths(files)), name)
    file = out or Path("reports") / "shrunk" / f"{case.name}.yaml"
    if file.is_dir():
        raise InputError("--out", "must be a file to write, found a folder", str(file))
    with Bar(quiet=as_json) as bar:
        shrunk = shrink.shrink_on(case, installations.resolve(engine), finding, bar)
    write_atomically(file, shrunk.text)
    reproduce = shrink.reproduced_by(shrunk, file, engine)
    report = shrunk.report(file, reproduce)
    if as_json:
        click.echo(json.dumps(report, indent=1))
        return 0
    click.secho(f"{shrunk.case.name}: {shrunk.failure.words}", bold=True)
    before, after = report["before"], report["after"]
    shared.table(("", "before", "after"), [(key, str(before[key]), str(after[key])) for key in before])
    left = "" if shrunk.complete else "; stopped early, not everything was tried"
    click.echo(f"{shrunk.candidates} candidates judged in {shrunk.seconds:.1f} s{left}")
    click.echo(f"written: {file}\nreproduce: {reproduce}")
    return 0
