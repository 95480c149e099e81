"""Probes of the manual (``probes.yaml``): restarts, minimisation, outputs, the order and form of commands.

The record of a probe is that of a case named ``probes.ID``, so that claims and findings refer to probes as they do
to cases.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from pydantic import TypeAdapter, model_validator

from lammps_cases.claims.probes import PREFIX, run
from lammps_cases.claims.probes.probe import FOLDER, Edits, Input, Probe, edited
from lammps_cases.claims.probes.run import Reply
from lammps_cases.engine.workers import Workers
from lammps_cases.findings import explain_outcome
from lammps_cases.records import case_wording
from lammps_cases.records.case_parts import Mismatch, Verdict
from lammps_cases.records.progress import SILENT, Progress
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.records.yaml_files import OfManual, read_yaml

TIME_LIMIT = 30.0  # seconds that LAMMPS has for a deck; they take 0.1
FILE = "probes.yaml"


class ManualProbe(OfManual, Probe):
    """A deck and its required result: exactly one of ``refused``, ``accepted``, ``lacks``, ``same``, ``measured``,
    ``columns``.

    Attributes
    ----------
    id : the name, without the prefix
    about : the question in words
    refused : LAMMPS must stop with an error that holds this text
    accepted : LAMMPS must run it, and leave finite numbers
    lacks : LAMMPS' log must not hold this text
    same : the deck edited in this way must give the same ``fields``, to the last bit
    same_base : the deck that is edited for that; by default the base
    times : except for these factors
    fields : the arrays compared; all by default
    measured : the deck's measurement: its variable ``found`` must be ``expected``, up to ``within``
    bound : how ``within`` is derived
    columns : arrays of atoms, each with the column of its compute ``q``, from 1 on, that must hold the same bits
    control : the deck edited in this way must *not* pass: otherwise the probe could be blind
    """

    about: str
    base: str = "deck"
    refused: str = ""
    accepted: bool = False
    lacks: str = ""
    same: Edits | None = None
    same_base: str = ""
    times: dict[str, float] | None = None
    fields: tuple[str, ...] = ()
    measured: str = ""
    bound: str = ""
    columns: dict[str, int] | None = None
    control: Edits | None = None

    @model_validator(mode="after")
    def _one_expectation(self) -> ManualProbe:
        given = [self.refused != "", self.accepted, self.lacks != "", self.same is not None, self.measured != ""]
        given.append(self.columns is not None)
        if sum(given) != 1:
            raise ValueError(f"{self.id}: needs exactly one of refused, accepted, lacks, same, measured, columns")
        if (self.lacks or self.same is not None or self.measured or self.columns) and self.control is None:
            raise ValueError(f"{self.id}: needs a control")
        if bool(self.measured) != bool(self.bound):
            raise ValueError(f"{self.id}: what is measured needs a bound, and nothing else has one")
        return self

    @property
    def name(self) -> str:
        """Return the name of its record."""
        return PREFIX + self.id

    @property
    def inputs(self) -> list[Input]:
        """Return the deck itself, the deck that must give the same, the deck that must not pass."""
        same = [] if self.same is None else [edited(self.same_base or self.base, self.same)]
        return [self.input, *same, *([] if self.control is None else [edited(self.base, self.control)])]


@functools.cache
def probes() -> tuple[ManualProbe, ...]:
    """Return all probes, in the order of the file.

    An entry with ``each`` stands for several, named ``ID.NAME``, with more edits by NAME.
    """
    entries: list[dict[str, Any]] = read_yaml(FOLDER / FILE, "probes")
    return TypeAdapter(tuple[ManualProbe, ...]).validate_python([one for entry in entries for one in _each(entry)])


def _each(entry: dict[str, Any]) -> Iterator[dict[str, Any]]:
    several: dict[str, Any] | None = entry.get("each")
    if several is None:
        yield entry
        return
    shared = {key: value for key, value in entry.items() if key != "each"}
    for name, edits in several.items():
        yield shared | {"id": f"{entry['id']}.{name}", "edits": [*entry.get("edits", ()), *edits]}


# --- judgement


def judge(probe: ManualProbe, replies: Sequence[Reply]) -> CaseRecord:
    """Compare the replies to a probe's inputs, in their order, with the manual; explain what a finding predicts."""
    compared = replies if probe.control is None else replies[:-1]
    lacking = next((reply for reply in replies if reply.ended == "skipped"), None)
    worst = lacking or next((reply for reply in compared if reply.ended != "answered"), compared[0])
    accepted = worst.ended == "answered" and probe.refused
    record = CaseRecord(
        case=probe.name,
        tags=["probe"],
        about=probe.about,
        verdict="pass",
        ended="accepted" if accepted else worst.ended,
        engine_error=case_wording.error_text(worst.error),
        mismatch=_mismatch(probe, replies) if worst.ended == "answered" else None,
        expects=probe.refused,
        source=FILE,
        reproduce=f"eos-ref claims {probe.name}",
    )
    record.verdict = _verdict(record)
    entry = explain_outcome(record) if record.verdict not in ("pass", "skipped") else None
    if entry is not None:
        record.verdict, record.explained_by = "explained", [entry.id]
    record.message = case_wording.message(record)
    return record


def _verdict(record: CaseRecord) -> Verdict:
    match record.ended:
        case "answered":
            return "differs" if record.mismatch else "pass"
        case "refused" if record.expects:
            return "pass" if record.expects in record.engine_error else "differs"
        case "refused" | "crashed" | "timeout" | "error" | "skipped":
            return record.ended
    return "differs"


def _mismatch(probe: ManualProbe, replies: Sequence[Reply]) -> Mismatch | None:
    """Return the mismatch of decks that ran, or of their control."""
    other = replies[0 if probe.same is None else 1]
    wrong = _against(probe, replies[0], other)
    if wrong is not None or probe.control is None:
        return wrong
    control = replies[-1]
    if control.ended == "answered" and _against(probe, control, other):
        return None
    return Mismatch(kind="blind", text=case_wording.error_text(control.error) or "no difference")


def _against(probe: ManualProbe, reply: Reply, other: Reply) -> Mismatch | None:
    """Return how a deck that ran violates its expectation; None if it does not."""
    if probe.lacks:
        return Mismatch(kind="logged", text=probe.lacks) if probe.lacks in reply.log else None
    if probe.measured:
        value, expected, within = (float(reply.arrays[name][0]) for name in run.MEASURED)
        inside = abs(value - expected) <= within
        return None if inside else Mismatch(kind="measured", fields=[probe.measured], values=[value, expected, within])
    for name, column in (probe.columns or {}).items():
        shown_n, held_n = reply.arrays["q"][:, column - 1], reply.arrays[name]
        if not np.array_equal(shown_n, held_n):
            return _worst(name, shown_n, held_n)
    if probe.same is None:
        bad = [name for name, values_n in reply.arrays.items() if not np.isfinite(values_n).all()]
        return Mismatch(kind="not finite", fields=bad) if bad else None
    for name in probe.fields or tuple(reply.arrays):
        ours_n, theirs_n = reply.arrays[name] * (probe.times or {}).get(name, 1.0), other.arrays[name]
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


def put(chosen: Sequence[ManualProbe], workers: Workers, progress: Progress = SILENT) -> list[CaseRecord]:
    """Run probes in LAMMPS and judge them; ``progress`` advances with every probe."""
    inputs = [probe.inputs for probe in chosen]
    once = list({_key(given): given for of in inputs for given in of}.values())  # decks compared are often the same
    replies, heard = run.put(workers, once, TIME_LIMIT), dict[Any, Reply]()
    keys_left = iter(map(_key, once))
    records = []
    for done, (probe, of) in enumerate(zip(chosen, inputs, strict=True), 1):
        keys = [_key(given) for given in of]
        while not heard.keys() >= set(keys):
            heard[next(keys_left)] = next(replies)
        records.append(judge(probe, [heard[key] for key in keys]))
        progress.advance(done, len(chosen), "probes")
    return records


def _key(given: Input) -> Any:
    """Return the key shared by equal inputs: commands are compared, a scene equals only itself."""
    return given if isinstance(given, tuple) else id(given)
