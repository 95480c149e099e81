"""`audit_restart`: a restart file of a deck, read by LAMMPS, whose fields at its step are judged."""

from __future__ import annotations

import shlex
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from eos_ref.errors import InputError
from lammps_cases.audit.options import AuditOptions, AuditResult, DeckSetups, RunSetup
from lammps_cases.audit.place import DeckPlace, find
from lammps_cases.audit.scratch import beside, copy_folder
from lammps_cases.audit.supervise import audit_deck, case_name, described
from lammps_cases.records.progress import SILENT

NAME = "eosref_restart"  # of the copy, beside the deck's files


def audit_restart(restart: Path, deck: Path, options: AuditOptions) -> AuditResult:
    """Have LAMMPS read a restart file, define the deck's fixes, evaluate the forces once (``run 0``), and judge them.

    The definitions are those that the deck makes before the run that the file's step belongs to.

    Parameters
    ----------
    restart : Path
    deck : Path
        The deck that has written it.
    options : AuditOptions

    Raises
    ------
    InputError
        No such file; LAMMPS does not read it; a step that the deck does not reach.
    EngineMissing
    """
    if not restart.is_file():
        raise InputError("restart", "must be a readable file", where=str(restart))
    _, setups = described(deck, options)
    run = setups.runs[-1]
    result = _read(restart, deck, setups, run, options)
    step = result.record.cases[0].checks[0].step
    of_step = _run_of(step, setups.runs, restart)
    if of_step.said != run.said:
        result = _read(restart, deck, setups, of_step, options)
    case = result.record.cases[0]
    case.case, case.source = case_name(restart), str(restart)
    case.about = "a restart file of your input deck: what LAMMPS makes of it before a step"
    words = ["--restart", str(restart), "--deck", str(deck), *options.words()]
    case.reproduce = shlex.join(["eos-ref", "audit", *words])
    return result


def _run_of(step: int, runs: Sequence[RunSetup], restart: Path) -> RunSetup:
    within = [run for run in runs if run.first <= step <= run.last]
    if not within:
        steps = ", ".join(f"{run.first} to {run.last}" for run in runs)
        raise InputError("step", f"must be one of the deck's runs (steps {steps})", step, str(restart))
    return within[0]


def _read(restart: Path, deck: Path, setups: DeckSetups, run: RunSetup, options: AuditOptions) -> AuditResult:
    place = find(deck, options.root, options.var)
    with tempfile.TemporaryDirectory(prefix="eos-ref-restart-") as made:
        root = beside(place.root, Path(made).resolve()) if options.trust else Path(made).resolve()
        copy_folder(place.root, root, links_out=options.trust)
        folder = root / place.within
        shutil.copyfile(restart, folder / NAME)
        commands = setups.commands[: run.said]
        early = [command for command in commands if command.startswith("newton")]
        rest = [command for command in commands if command not in early]
        script = folder / f"in.{NAME}"
        script.write_text("\n".join([*early, f"read_restart {NAME}", *rest, "run 0", ""]), encoding="utf-8")
        result = audit_deck(script, replace(options, steps=None, progress=SILENT), DeckPlace(root, folder))
    case = result.record.cases[0]
    if case.engine_error:
        message = case.engine_error.replace(f"in.{NAME}", "the restart")
        raise InputError("restart", f"must be readable by LAMMPS with the deck's fixes ({message})", where=str(restart))
    return result
