"""`audit_deck`: the copy, the process that runs the deck in it, and the record made of its messages.

The messages are `lammps_cases.audit.messages`, plain data. The deck may have taken over the process: a pickle could
then call anything here.
"""

from __future__ import annotations

import contextlib
import io
import os
import pickle
import re
import shlex
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from eos_ref.errors import InputError
from lammps_cases.audit import child, share
from lammps_cases.audit.messages import (
    CommandPlace,
    DeckEnd,
    DeckSetups,
    EngineIdentity,
    PairShare,
    RunFacts,
    SampleRows,
)
from lammps_cases.audit.options import AuditOptions, AuditResult, AuditTask
from lammps_cases.audit.place import DeckPlace, check_script, copy_folder, find, nested_folder
from lammps_cases.audit.verdict import Findings
from lammps_cases.engine import containment, ranks
from lammps_cases.engine.session import EngineMissing, death, how_it_died
from lammps_cases.engine.workers import Failure, Workers
from lammps_cases.records import case_wording
from lammps_cases.records.case_parts import worst
from lammps_cases.records.progress import SILENT
from lammps_cases.records.run_record import CaseRecord, EngineRecord, RunRecord
from lammps_cases.verdict.outcome import leave_unchecked

LAUNCHER = 120.0  # seconds to find the launcher of several ranks
PATIENCE = 0.5  # seconds between two checks of the time limit
LAST = 65536  # bytes of a dead process' output that are searched
LARGEST_MESSAGE = 2**32  # bytes of a message: the arrays of 1e7 atoms
_RECORDS = ("lammps_cases.records.case_parts", "lammps_cases.records.run_record")
DATA_MODULES = ("lammps_cases.audit.deck", "lammps_cases.audit.messages", *_RECORDS)  # whose classes are data
_NUMPY = (("multiarray", "_reconstruct"), ("multiarray", "scalar"), ("numeric", "_frombuffer"))
DATA_NAMES = {
    *{("eos_ref.errors", name) for name in ("InputError", "InputErrors")},
    ("lammps_cases.engine.session", "EngineMissing"),
    *{("numpy", name) for name in ("ndarray", "dtype")},
    *{("builtins", name) for name in ("set", "frozenset")},
    ("_codecs", "encode"),
    *((f"numpy._core.{module}", name) for module, name in _NUMPY),
    *((f"numpy.core.{module}", name) for module, name in _NUMPY),
}
KINDS: dict[type, TypeAdapter[Any]] = {
    kind: TypeAdapter(kind) for kind in (EngineIdentity, CommandPlace, RunFacts, SampleRows, DeckSetups, DeckEnd)
}


class DiskFull(RuntimeError):
    """A deck has written too much."""


ENTRY: child.Entry = child.main


def audit_deck(deck: Path, options: AuditOptions | None = None, place: DeckPlace | None = None) -> AuditResult:
    """Run an unchanged deck in a copy of the folder where it runs, and check the requested fields at every atom.

    At an interval of steps (`AuditOptions`), and at the start of every run, it checks what a force evaluation has just
    used: the pressure, P = EOS(rho, e) with the laws that fix rheo and fix rheo/pressure hold at that moment, and
    whatever else follows from the state of that moment (`fields`).

    Parameters
    ----------
    deck : Path
        The input script.
    options : AuditOptions, optional
    place : DeckPlace, optional
        Where the deck runs; found by `lammps_cases.audit.place.find` by default.

    Returns
    -------
    AuditResult
        One case: its fields (the pressure per atom type), a check per sample, what was not checked, and warnings.
        LAMMPS' own error makes it ``refused``; its death ``crashed`` or ``timeout``, with the checks up to then.

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
    place = _check(deck, options, place)
    begin = time.perf_counter()
    findings, failure = _run(deck, options, place)
    case = findings.case(case_name(deck), failure)
    case.source = str(deck)
    case.reproduce = shlex.join(["eos-ref", "audit", str(deck), *options.words()])
    if findings.ended is not None and not findings.checks and case.verdict == "skipped" and failure is None:
        rule = (
            "must define fix rheo and fix rheo/pressure before a run"
            if findings.ended.runs
            else "must reach a run command"
        )
        raise InputError("deck", rule, where=str(deck))
    if findings.ended is not None and findings.ended.share is not None:
        _take_share(case, findings.ended.share, options)
    case.seconds.total = time.perf_counter() - begin
    record = RunRecord(engine=EngineRecord(), reference={}, cases=[case], seconds=case.seconds.total).counted()
    arrays, kept = (findings.ended.arrays, findings.ended.kept) if findings.ended else ({}, {})
    return AuditResult(record, findings.who, arrays, kept)


def _take_share(case: CaseRecord, pairs: PairShare, options: AuditOptions) -> None:
    """Evaluate pair_style rheo alone in a second LAMMPS on the particles of a sample, and compare the forces."""
    where = f"of pair_style rheo alone, by a second LAMMPS at the particles of step {pairs.step}"
    own = AuditOptions(options.every, None, options.timeout, options.trust, options.engine, fields=("f",))
    try:
        with tempfile.TemporaryDirectory(prefix="eos-ref-share-") as folder:
            script = share.write(pairs, Path(folder))
            second = audit_deck(script, own, DeckPlace(script.parent, script.parent)).record.cases[0]
        failure = second.engine_error
    except InputError as error:
        failure = str(error)
    compared = [] if failure else second.fields
    for record in compared:
        update = {"worst_step": pairs.step, "derivation": f"{where}; {record.derivation}"}
        case.fields.append(record.model_copy(update=update))
        case.checks += [c.model_copy(update={"step": pairs.step, "run": pairs.run}) for c in second.checks]
        if case.blame is None and second.blame is not None:
            case.blame = second.blame.model_copy(update={"step": pairs.step, "run": pairs.run})
    failure = failure.replace(f"{folder}/", "")
    if compared:
        forces = ("f with all that adds to it", f"{pairs.reason}; compared is that {where}")
    else:
        forces = ("f", f"{pairs.reason}; {where} it cannot be had ({failure})")
    leave_unchecked(case, dict(forces if name == "f" else (name, reason) for name, reason in case.unchecked.items()))
    case.verdict = worst([case.verdict, *(record.verdict for record in compared)])
    case.message = case_wording.message(case)


def case_name(file: Path) -> str:
    """Return the name of the case that audits a file."""
    return re.sub(r"[^A-Za-z0-9._-]+", "_", file.name).lstrip(".-") or "deck"


def described(deck: Path, options: AuditOptions) -> tuple[Findings, DeckSetups]:
    """Return the identity of LAMMPS, and the runs of a deck, set up but not carried out.

    Raises
    ------
    InputError
        The deck cannot be read or followed, LAMMPS refuses it or dies, or it has no run.
    EngineMissing
    """
    place = _check(deck, options)
    findings, failure = _run(deck, options, place, setups=True)
    if failure is not None:
        raise InputError("deck", f"must be set up by LAMMPS, without its runs ({failure.message})", where=str(deck))
    if findings.setups is None or not findings.setups.runs:
        raise InputError("deck", "must reach a run command", where=str(deck))
    return findings, findings.setups


def _check(deck: Path, options: AuditOptions, place: DeckPlace | None = None) -> DeckPlace:
    if not deck.is_file():
        rule = "must be a readable file" if deck.exists() else "no such file"
        raise InputError("deck", rule, where=str(deck))
    place = place or find(deck, options.root, options.var)
    if not options.trust:
        check_script(deck, place, options.var)
    return place


def _run(deck: Path, options: AuditOptions, place: DeckPlace, setups: bool = False) -> tuple[Findings, Failure | None]:
    findings, launcher = Findings(), _launcher(options)
    with contextlib.ExitStack() as stack:
        folder = options.keep or Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="eos-ref-audit-")))
        outside = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="eos-ref-audit-")))
        folder = folder.resolve()
        if options.trust and options.keep is None:
            folder = nested_folder(place.root, folder)
        copy_folder(place.root, folder, links_out=options.trust)
        silent = replace(options, progress=SILENT)
        script = _brought(deck.resolve(), place, folder)
        task = AuditTask(script, str(folder), silent, confined(options), str(outside), setups, place)
        output = outside / "output"
        with child.running(ENTRY, task, output, launcher) as (process, receiver):
            return findings, _listen(receiver, findings, options, process, output)


def _brought(deck: Path, place: DeckPlace, folder: Path) -> str:
    """Return the name of the deck in the copy, relative to where it runs; a deck from elsewhere is copied there."""
    if deck.is_relative_to(place.root):
        return os.path.relpath(deck, place.working)
    shutil.copyfile(deck, folder / place.within / deck.name)
    return deck.name


def _launcher(options: AuditOptions) -> list[str]:
    """Return the words of the launcher of several ranks; empty for one.

    Raises
    ------
    InputError
        LAMMPS was built without MPI, or its MPI has no launcher here.
    EngineMissing
    """
    if options.ranks == 1:
        return []
    with Workers(options.engine, 1) as workers:
        found = workers.outcome(workers.call(ranks.launcher_of, options.ranks, time_limit=LAUNCHER))
    if isinstance(found, Failure):
        raise InputError("ranks", f"cannot be started ({found.message})", options.ranks, "option --ranks")
    return shlex.split(found)


def confined(options: AuditOptions) -> containment.Means:
    """Return the containment of a deck's process.

    Raises
    ------
    InputError
        This machine has no containment, and the deck is not trusted.
    """
    if options.trust:
        return "none"
    means = containment.means()
    if means == "bubblewrap" and options.ranks > 1:
        rule = "can be contained on several ranks by Landlock alone (Linux 5.13); use --trust if you trust it"
        raise InputError("deck", rule)
    if means == "none":
        rule = "cannot be contained here without Landlock (Linux 5.13) or bubblewrap; use --trust if you trust it"
        raise InputError("deck", rule)
    return means


def _messages(receiver: Connection, deadline: float, folder: Path) -> Iterator[object]:
    """Yield messages until the other side ends.

    Raises
    ------
    TimeoutError
    DiskFull
        The deck has filled half of what was free when it began.
    """
    least = shutil.disk_usage(folder).free // 2
    while True:
        left = deadline - time.monotonic()
        if left <= 0:
            raise TimeoutError
        if shutil.disk_usage(folder).free < least:
            raise DiskFull
        if receiver.poll(min(PATIENCE, left)):
            try:
                yield received(receiver)
            except EOFError:
                return


def _listen(
    receiver: Connection, findings: Findings, options: AuditOptions, process: child.Process, output: Path
) -> Failure | None:
    deadline, total = time.monotonic() + options.timeout, options.steps
    try:
        for message in _messages(receiver, deadline, output.parent):
            if isinstance(message, Exception):
                raise message
            if isinstance(message, CommandPlace) and options.steps is None:
                total = steps_after(message.command, findings.done)
            findings.take(message)
            if isinstance(message, SampleRows):
                options.progress.advance(message.done, total, "steps")
            if findings.ended is not None:
                break
    except TimeoutError:
        return Failure("timeout", f"stopped after {options.timeout:g} s, {_at(findings)}")
    except DiskFull:
        return Failure("crashed", f"stopped because it had filled half of the disk, {_at(findings)}")
    except Foreign as error:
        return Failure("crashed", f"LAMMPS' process sent what is no message of an audit ({error}), {_at(findings)}")
    if findings.ended is not None:
        if findings.ended.lacks:
            return Failure("skipped", findings.ended.lacks)
        return Failure("refused", findings.ended.refused) if findings.ended.refused else None
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(5.0)
    if (code := process.returncode) is None:
        return Failure("crashed", f"LAMMPS' process says nothing any more, {_at(findings)}{_tail(output)}")
    if options.ranks > 1:
        crash = ranks.crash(_printed(output), code)
        return Failure("crashed", f"{crash}, {_at(findings)}", crash.died)
    return Failure("crashed", f"LAMMPS' process {how_it_died(code)}, {_at(findings)}{_tail(output)}", death(code))


def steps_after(command: str, done: int) -> int | None:
    """Return the steps that an audit has done when a run command ends; None where the command does not give them."""
    match command.split():
        case ["run", steps, *words] if steps.isdecimal() and "upto" not in words:
            return done + int(steps)
    return None


def _at(findings: Findings) -> str:
    place = findings.place
    if not place.where:
        return "before the first command"
    return f"after step {findings.done} of the audit, in: {' '.join(place.command.split())} ({place.where})"


def _tail(output: Path) -> str:
    printed = [line.strip() for line in _printed(output).split("\n") if line.strip()]
    return f": {printed[-1][:300]}" if printed else ""


def _printed(output: Path) -> str:
    with output.open("rb") as file:
        file.seek(max(0, output.stat().st_size - LAST))
        return file.read(LAST).decode(errors="replace")


class Foreign(ValueError):
    """Data that is not a message of an audit."""


class _Reader(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        if (module, name) in DATA_NAMES:
            return super().find_class(module, name)
        if module in DATA_MODULES and "." not in name:
            cls = super().find_class(module, name)
            if isinstance(cls, type) and cls.__module__ == module:
                return cls
        raise Foreign(f"{module}.{name}"[:100])


def received(connection: Connection) -> object:
    """Wait for a message, and return it.

    Raises
    ------
    Foreign
    EOFError
        The other side has ended.
    """
    try:
        message = _Reader(io.BytesIO(connection.recv_bytes(LARGEST_MESSAGE))).load()
    except (Foreign, EOFError):
        raise
    except Exception as error:  # damaged bytes may raise anything
        raise Foreign(type(error).__name__) from None
    if isinstance(message, InputError | EngineMissing):
        return message
    if type(message) not in KINDS:
        raise Foreign(type(message).__name__)
    try:
        return KINDS[type(message)].validate_python(vars(message))
    except ValidationError as error:
        raise Foreign(f"{type(message).__name__}: {error.errors()[0]['msg']}"[:100]) from None
