"""`run`: what ``eos-ref run`` does, as a function that returns the result and prints nothing."""

from __future__ import annotations

import shlex
from pathlib import Path

from lammps_cases.comparison.store import open_store
from lammps_cases.engine import forkserver, installations
from lammps_cases.findings import check_names
from lammps_cases.records.checked import checked
from lammps_cases.records.options import flat
from lammps_cases.run import campaign
from lammps_cases.run.options import RunOptions, several
from lammps_cases.run.results import Result, report_folder
from lammps_cases.scene import casefile


@checked
@flat
def run(options: RunOptions, *, out: str | Path | None = None) -> Result:
    """Run cases against LAMMPS and compare them atom by atom, as ``eos-ref run`` does.

    Parameters
    ----------
    out : path, optional
        Folder of the report; by default a temporary one, which goes with the result.
    (options)

    Raises
    ------
    InputError
        Bad input, in one line.
    EngineMissing
        There is no LAMMPS with RHEO.
    """
    chosen, allowed, engine = several(options.names), several(options.allow), options.engine
    given = [
        ("--allow", allowed),
        ("--tag", [options.tag] if options.tag else []),
        ("--cases", map(str, options.paths)),
    ]
    words = [*chosen, *(word for option, values in given for value in values for word in (option, value))]
    check_names(allowed)
    command = shlex.join(["eos-ref", "run", *words, *([] if engine == "env" else ["--engine", engine])])
    forkserver.start_for_judging()
    selected = casefile.select(casefile.load(options.paths), chosen, options.tag)
    resolved, store = installations.resolve(engine), open_store(options.fresh)
    asked = campaign.Request(command, options.level, allow=allowed)
    with report_folder(out) as (folder, temporary):
        record = campaign.run_cases(selected, resolved, options.processes, folder, asked, store=store)
        return Result(record, folder, temporary)
