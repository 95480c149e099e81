"""`audit`: what ``eos-ref audit`` does, as a function that returns the result and prints nothing."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

from lammps_cases.audit.options import TIMEOUT, AuditOptions, trusted
from lammps_cases.audit.supervise import audit_deck
from lammps_cases.engine import installations
from lammps_cases.engine.installations import Engine
from lammps_cases.records.checked import checked
from lammps_cases.records.files import write_arrays
from lammps_cases.records.run_record import FailOn, RunRecord
from lammps_cases.run import campaign
from lammps_cases.run.output_folder import output_folder
from lammps_cases.run.results import Result, report_folder


@checked
def audit(
    deck: str | Path,
    *,
    every: int = 10,
    steps: int | None = None,
    fields: str | Sequence[str] = "all",
    timeout: float = TIMEOUT,
    trust: bool = False,
    suffix: str | None = None,
    engine: str = "env",
    fail_on: FailOn = "new",
    out: str | Path | None = None,
) -> Result:
    """Check every atom while LAMMPS runs an input deck, unchanged, in a copy of its folder, as ``eos-ref audit`` does.

    Parameters
    ----------
    deck : path
        The input script.
    every, steps, timeout, trust, suffix :
        See `lammps_cases.audit.options.AuditOptions`.
    fields : str or sequence of str
        What to check, by LAMMPS' names; all: whatever can be.
    engine, fail_on, out :
        See `lammps_cases.run.command.run`.

    Raises
    ------
    InputError
        Bad input, in one line.
    EngineMissing
        There is no LAMMPS with RHEO.
    """
    chosen, deck = installations.resolve(engine), Path(deck)
    names = (fields,) if isinstance(fields, str) else tuple(fields)
    options = AuditOptions(every, steps, timeout, trust or trusted(), chosen.site, fields=names, suffix=suffix)
    command = shlex.join(["eos-ref", "audit", str(deck), *options.words()])
    with report_folder(out) as (folder, temporary):
        return Result(audit_into(folder, deck, options, chosen, command, fail_on), folder, temporary)


def audit_into(
    directory: Path, deck: Path, options: AuditOptions, engine: Engine, command: str, fail_on: FailOn
) -> RunRecord:
    """Audit a deck, and write its report into a folder."""
    with output_folder(directory) as folder:
        result = audit_deck(deck, options)
        run = campaign.provenance(campaign.engine_record(engine, result.who), command)
        run.cases, run.seconds = result.record.cases, result.record.seconds
        run.fail_on = fail_on
        if result.arrays:
            write_arrays(folder / "fields" / f"{run.cases[0].case}.npz", result.arrays)
        campaign.write_run(run.counted(), folder)
    return run
