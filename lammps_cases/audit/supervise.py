"""`audit_deck`: the copy, the process that runs the deck in it, and the record made of its messages."""

from __future__ import annotations

import contextlib
import multiprocessing
import re
import shlex
import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path

from eos_ref.errors import InputError
from lammps_cases.audit.guard import check_script
from lammps_cases.audit.options import AuditOptions, AuditResult, SampleRows, Task
from lammps_cases.audit.scratch import copy_folder
from lammps_cases.audit.verdict import Findings
from lammps_cases.engine.forkserver import without_main
from lammps_cases.engine.workers import Failure
from lammps_cases.records.progress import SILENT
from lammps_cases.records.run_record import EngineRecord, RunRecord

PATIENCE = 0.5  # seconds between two checks of the time limit


def run_child(task: Task, connection: Connection) -> None:
    """Entry of the child process; the heavy imports stay out of the parent."""
    from lammps_cases.audit import child

    child.main(task, connection)


ENTRY: Callable[[Task, Connection], None] = run_child


def audit_deck(deck: Path, options: AuditOptions | None = None) -> AuditResult:
    """Run a deck, unchanged, in a copy of its folder, and check the requested fields at every atom.

    Every so many steps (`AuditOptions`), and at the start of every run, it checks what a force evaluation has just
    used: the pressure, P = EOS(rho, e) with the laws that fix rheo and fix rheo/pressure hold at that moment, and
    whatever else follows from the state of that moment (`fields`).

    Parameters
    ----------
    deck : Path
        The input script.
    options : AuditOptions, optional

    Returns
    -------
    AuditResult
        One case: its fields (the pressure per atom type), a check per sample, what was not checked, and warnings.
        LAMMPS' own error makes it ``refused``; its death ``crashed`` or ``timeout``, with what had been checked before.

    Raises
    ------
    InputError
        The deck cannot be read, is not allowed to run, cannot be followed, or has nothing to check; a requested field
        cannot be checked in it.
    EngineMissing
        There is no LAMMPS with RHEO.
    """
    options = options or AuditOptions()
    deck = Path(deck)
    if not deck.is_file():
        raise InputError("deck", "must be a readable file", where=str(deck))
    try:
        if not options.allow_shell:
            check_script(deck)
    except OSError as error:
        raise InputError("deck", f"cannot be read: {error.strerror}", where=str(deck)) from None
    begin = time.perf_counter()
    findings, failure = _run(deck, options)
    name = re.sub(r"[^A-Za-z0-9._-]+", "_", deck.name).lstrip(".-") or "deck"
    case = findings.case(name, failure)
    case.source = str(deck)
    case.reproduce = shlex.join(["eos-ref", "audit", str(deck), *options.words()])
    if findings.ended is not None and not findings.checks and case.verdict == "skipped":
        rule = (
            "must define fix rheo and fix rheo/pressure before a run"
            if findings.ended.runs
            else "must reach a run command"
        )
        raise InputError("deck", rule, where=str(deck))
    case.seconds.total = time.perf_counter() - begin
    record = RunRecord(engine=EngineRecord(), reference={}, cases=[case], seconds=case.seconds.total).counted()
    return AuditResult(record, findings.who, findings.ended.arrays if findings.ended else {})


def _run(deck: Path, options: AuditOptions) -> tuple[Findings, Failure | None]:
    findings = Findings()
    with contextlib.ExitStack() as stack:
        folder = options.keep or Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="eos-ref-audit-")))
        outside = stack.enter_context(tempfile.TemporaryDirectory(prefix="eos-ref-audit-"))
        copy_folder(deck.resolve().parent, folder.resolve())
        output = Path(outside) / "output"
        task = Task(deck.name, str(folder.resolve()), replace(options, progress=SILENT), str(output))
        context = multiprocessing.get_context("spawn")
        receiver, sender = context.Pipe(duplex=False)
        process = context.Process(target=ENTRY, args=(task, sender), daemon=True)
        with without_main():
            process.start()
        sender.close()  # the child holds the only other end: its death ends the messages
        try:
            return findings, _listen(receiver, findings, options, process, output)
        finally:
            process.kill()
            process.join()


def _messages(receiver: Connection, deadline: float | None) -> Iterator[object]:
    """Yield messages until the other side ends.

    Raises
    ------
    TimeoutError
    """
    while True:
        left = PATIENCE if deadline is None else deadline - time.monotonic()
        if left <= 0:
            raise TimeoutError
        if receiver.poll(min(PATIENCE, left)):
            try:
                yield receiver.recv()
            except EOFError:
                return


def _listen(
    receiver: Connection, findings: Findings, options: AuditOptions, process: BaseProcess, output: Path
) -> Failure | None:
    deadline = None if options.timeout is None else time.monotonic() + options.timeout
    try:
        for message in _messages(receiver, deadline):
            if isinstance(message, Exception):
                raise message
            findings.take(message)
            if isinstance(message, SampleRows):
                options.progress.advance(message.done, options.steps, "steps")
    except TimeoutError:
        return Failure("timeout", f"stopped after {options.timeout:g} s, {_at(findings)}")
    if findings.ended is not None:
        return Failure("refused", findings.ended.refused) if findings.ended.refused else None
    process.join(5.0)
    return Failure("crashed", f"LAMMPS {_death(process.exitcode)}, {_at(findings)}{_tail(output)}")


def _at(findings: Findings) -> str:
    place = findings.place
    if not place.where:
        return "before the first command"
    return f"after step {findings.done} of the audit, in: {' '.join(place.command.split())} ({place.where})"


def _death(code: int | None) -> str:
    if code is not None and code < 0:
        return f"died of {signal.Signals(-code).name}"
    return f"ended the process with exit status {code}"


def _tail(output: Path) -> str:
    """Return the last line that the dying process printed."""
    lines = output.read_text(errors="replace").split("\n") if output.exists() else []
    printed = [line.strip() for line in lines if line.strip()]
    return f": {printed[-1][:300]}" if printed else ""
