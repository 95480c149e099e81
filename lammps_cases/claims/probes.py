"""Questions that no scene can put to LAMMPS: restarts, minimisation, outputs, the order and form of commands.

A probe is a small deck (``probes.yaml``), some of its parts replaced, and what the manual says becomes of it. Every
probe runs on a LAMMPS of its own in a worker, which it may kill. Its record is that of a case named ``probes.ID``, so
that claims and findings speak of probes as they do of cases.
"""

from __future__ import annotations

import functools
import os
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, TypeAdapter, model_validator

from lammps_cases.claims.model import PROBE
from lammps_cases.engine import session
from lammps_cases.engine.workers import Failure, Workers
from lammps_cases.findings import explain_outcome
from lammps_cases.records import wording
from lammps_cases.records.progress import SILENT, Progress
from lammps_cases.records.run_record import CaseRecord, Ended, Failed, Mismatch, Verdict
from lammps_cases.records.yaml_files import read_yaml

TIME_LIMIT = 30.0  # seconds that LAMMPS has for a deck; they take 0.1
FILE = Path(__file__).with_name("probes.yaml")
PROPERTIES = ("type", "x", "v", "f", "rho", "pressure", "drho", "esph")  # read where the atom style has them

Deck = Mapping[str, str | None]  # its parts in order; None: left out
Arrays = dict[str, Any]


class Probe(BaseModel):
    """A deck and what must become of it: exactly one of ``refused``, ``accepted``, ``lacks`` and ``same``.

    Attributes
    ----------
    id : the name, without the prefix
    about : the question in words
    base : the deck that is changed
    change : parts of the deck that are replaced; None leaves one out
    refused : LAMMPS must stop with an error that holds this text
    accepted : LAMMPS must run it, and leave finite numbers
    lacks : LAMMPS' log must not hold this text
    same : the deck changed in this way must give the same ``fields``, to the last bit
    same_base : the deck that is changed for that; by default the base
    times : but for these factors
    fields : the arrays compared; all by default
    control : the deck changed in this way must *not* pass: without it a probe could be blind
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    id: str
    about: str
    base: str = "two"
    change: dict[str, str | None] | None = None
    refused: str = ""
    accepted: bool = False
    lacks: str = ""
    same: dict[str, str | None] | None = None
    same_base: str = ""
    times: dict[str, float] | None = None
    fields: tuple[str, ...] = ()
    control: dict[str, str | None] | None = None

    @model_validator(mode="after")
    def _one_expectation(self) -> Probe:
        given = [self.refused != "", self.accepted, self.lacks != "", self.same is not None]
        if sum(given) != 1:
            raise ValueError(f"{self.id}: needs exactly one of refused, accepted, lacks, same")
        if (self.lacks or self.same is not None) and self.control is None:
            raise ValueError(f"{self.id}: needs a control")
        return self

    @property
    def name(self) -> str:
        """The name of its record."""
        return PROBE + self.id


@dataclass(frozen=True)
class Ran:
    """What LAMMPS made of a deck: its last arrays and its log, or its error."""

    arrays: Arrays
    log: str = ""
    error: str = ""


@functools.cache
def _data() -> dict[str, Any]:
    data: dict[str, Any] = read_yaml(FILE)
    return data


@functools.cache
def probes() -> tuple[Probe, ...]:
    """All probes, in the order of the file."""
    return TypeAdapter(tuple[Probe, ...]).validate_python(_data()["probes"])


def deck(base: str, change: Mapping[str, str | None] | None) -> str:
    """The commands of a base with parts replaced.

    Raises
    ------
    ValueError
        A part that the base has not.
    """
    parts: dict[str, str | None] = dict(_data()["bases"][base])
    if unknown := set(change or {}) - set(parts):
        raise ValueError(f"parts that the base {base} has not: {', '.join(sorted(unknown))}")
    parts |= change or {}
    return "\n".join(part.strip() for part in parts.values() if part) + "\n"


def ask(site: str | None, text: str) -> Ran:
    """Task of a worker: run a deck in a folder of its own, on a LAMMPS that no other deck has touched."""
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            lmp = session.open_lammps(site)
            try:
                return _run(lmp, text)
            finally:
                lmp.close()
        finally:
            os.chdir(before)


def _run(lmp: Any, text: str) -> Ran:
    lmp.command("log deck.log")
    error = ""
    try:
        with session.translated():
            lmp.commands_string(text)
    except session.EngineRefused as raised:
        error = wording.error_text(str(raised))
    arrays = {} if error else _arrays(lmp)
    lmp.command("log none")
    return Ran(arrays, Path("deck.log").read_text(errors="replace"), error)


def _arrays(lmp: Any) -> Arrays:
    n = lmp.extract_global("nlocal")
    order_n = np.argsort(lmp.numpy.extract_atom("id")[:n])
    arrays: Arrays = {}
    for name in PROPERTIES:
        values_n = lmp.numpy.extract_atom(name)
        if values_n is not None:
            arrays[name] = np.array(values_n[:n][order_n], float)
    if lmp.has_id("compute", "q"):
        columns = lmp.numpy.extract_compute("q", 1, 2 if lmp.extract_compute("q", 1, 5) else 1)
        arrays["q"] = np.array(columns[:n][order_n], float)
    return arrays


# --- judged


@dataclass(frozen=True)
class End:
    """How LAMMPS ended a probe; ``verdict`` is `pass` where all is as the manual says."""

    verdict: Verdict
    ended: Ended = "answered"
    error: str = ""
    mismatch: Mismatch | None = None


def judge(probe: Probe, outcome: Ran | Failure, other: Ran | Failure | None, control: Ran | Failure | None) -> End:
    """Hold what LAMMPS did against the manual.

    Parameters
    ----------
    outcome : of the probe's own deck
    other : of the deck that must give the same
    control : of the deck that must not pass
    """
    if probe.refused:
        return _refusal(probe, outcome)
    for ran in (outcome, other):
        if isinstance(ran, Failure):
            return End(ran.verdict, ran.verdict, ran.message)
        if ran is not None and ran.error:
            return End("refused", "refused", ran.error)
    assert isinstance(outcome, Ran)
    wrong = _against(probe, outcome, other)
    if wrong is None and control is not None:
        blind = isinstance(control, Failure) or control.error or _against(probe, control, other) is None
        wrong = Mismatch(kind="blind", text=_words(control)) if blind else None
    return End("differs" if wrong else "pass", mismatch=wrong)


def _refusal(probe: Probe, outcome: Ran | Failure) -> End:
    if isinstance(outcome, Failure):
        return End(outcome.verdict, outcome.verdict, outcome.message)
    if not outcome.error:
        return End("differs", "accepted", mismatch=_not_finite(outcome))
    return End("pass" if probe.refused in outcome.error else "differs", "refused", outcome.error)


def _not_finite(ran: Ran) -> Mismatch | None:
    bad = [name for name, values_n in ran.arrays.items() if not np.isfinite(values_n).all()]
    return Mismatch(kind="not finite", fields=bad) if bad else None


def _words(ran: Ran | Failure) -> str:
    return ran.message if isinstance(ran, Failure) else ran.error or "no difference"


def _against(probe: Probe, ran: Ran, other: Ran | Failure | None) -> Mismatch | None:
    """The expectation of a deck that ran."""
    if probe.lacks:
        return Mismatch(kind="logged", text=probe.lacks) if probe.lacks in ran.log else None
    if probe.same is None:
        return _not_finite(ran)
    assert isinstance(other, Ran)
    for name in probe.fields or tuple(ran.arrays):
        ours_n, theirs_n = ran.arrays[name] * (probe.times or {}).get(name, 1.0), other.arrays[name]
        if ours_n.shape != theirs_n.shape:
            return Mismatch(kind="other atoms", fields=[name], counts=[len(ours_n), len(theirs_n)])
        if not np.array_equal(ours_n, theirs_n):
            return _worst(name, ours_n.ravel(), theirs_n.ravel())
    return None


def _worst(name: str, ours: Any, theirs: Any) -> Mismatch:
    off = np.where(ours == theirs, -1.0, np.nan_to_num(np.abs(ours - theirs), nan=np.inf))
    at, wrong = int(np.argmax(off)), int(np.sum(ours != theirs))
    values = [float(ours[at]), float(theirs[at])]
    return Mismatch(kind="other numbers", fields=[name], counts=[wrong, ours.size], values=values)


def record(probe: Probe, end: End, died: Failed | None, version: str) -> CaseRecord:
    """Make the record of a probe; what a finding predicts is explained.

    ``died`` is how LAMMPS ended on one of its decks, if that was without an answer or an error.
    """
    made = CaseRecord(
        case=probe.name,
        tags=["probe"],
        about=probe.about,
        verdict=died or end.verdict if end.verdict != "pass" else "pass",
        ended=end.ended,
        engine_error=end.error,
        mismatch=end.mismatch,
        expects=probe.refused,
        source=FILE.name,
        reproduce=f"eos-ref claims {probe.name}",
    )
    entry = explain_outcome(made, version) if made.verdict != "pass" else None
    if entry is not None:
        made.verdict, made.explained_by = "explained", [entry.id]
    made.message = wording.message(made)
    return made


def put(chosen: Sequence[Probe], workers: Workers, version: str, progress: Progress = SILENT) -> list[CaseRecord]:
    """Put probes to LAMMPS and judge them.

    Parameters
    ----------
    version : str
        Of LAMMPS' distribution, for the findings.
    progress : Progress, optional
        Is told of every probe.
    """
    queue = []
    for probe in chosen:
        texts = [deck(probe.base, probe.change)]
        texts += [] if probe.same is None else [deck(probe.same_base or probe.base, probe.same)]
        texts += [] if probe.control is None else [deck(probe.base, probe.control)]
        queue.append([workers.call(ask, text, time_limit=TIME_LIMIT) for text in texts])
    records = []
    for done, (probe, futures) in enumerate(zip(chosen, queue, strict=True), 1):
        outcomes: list[Ran | Failure] = []
        for future in futures:
            outcome = workers.outcome(future, TIME_LIMIT)
            outcomes.append(outcome)
        other = outcomes[1] if probe.same is not None else None
        control = outcomes[-1] if probe.control is not None else None
        died = next((o.verdict for o in outcomes if isinstance(o, Failure)), None)
        records.append(record(probe, judge(probe, outcomes[0], other, control), died, version))
        progress.advance(done, len(chosen), "probes")
    return records
