"""How a case fails, and when two cases fail the same way."""

from __future__ import annotations

import dataclasses
import math
import re
import traceback
from dataclasses import asdict, dataclass
from typing import Any

from eos_ref import InputError
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.scene import Scene
from lammps_cases.setup import reference_side

_NUMBER = re.compile(r"[-+]?\d[\d.]*(?:e[-+]?\d+)?")


@dataclass(frozen=True)
class FailureMode:
    """How a case fails. Two are equal if they fail the same way, whichever step and atom show it first.

    Attributes
    ----------
    field, stage : what is blamed, beyond the findings that the scene shows; empty where LAMMPS gave no numbers
    finding : id of the finding that is followed, whatever field shows it; empty for a difference
    error : LAMMPS' error without its numbers, or how its process ended
    bounded : whether the reference and its bound are finite there; a scene in which rounding decides is another failure
    shown_in, step, atom : field, step and atom where it shows first
    """

    verdict: str
    ended: str = "answered"
    field: str = ""
    stage: str = ""
    finding: str = ""
    error: str = ""
    bounded: bool = True
    shown_in: str = dataclasses.field(default="", compare=False)
    step: int | None = dataclasses.field(default=None, compare=False)
    atom: int | None = dataclasses.field(default=None, compare=False)

    @property
    def words(self) -> str:
        """Return in words how the case fails."""
        if self.finding:
            return f"shows {self.finding}"
        if self.field:
            return f"{self.verdict} in {self.field}" + f" (stage {self.stage})" * bool(self.stage)
        return f"{self.verdict}" + f": {self.error}" * bool(self.error)

    def document(self) -> dict[str, Any]:
        """Return the parts that are given, as data."""
        return {key: value for key, value in asdict(self).items() if value not in ("", None)}


def failure_mode(record: CaseRecord, finding: str = "") -> FailureMode | None:
    """Return how a case fails, or that it shows a finding; None if it does not."""
    blame = record.headline
    place: dict[str, Any] = {"shown_in": blame.field, "step": blame.step, "atom": blame.atom} if blame else {}
    place["bounded"] = not blame or all(v is None or math.isfinite(v) for v in (blame.reference, blame.bound))
    if finding:
        shown = record.verdict == "explained" and finding in record.findings
        return FailureMode("explained", record.ended, finding=finding, **place) if shown else None
    if record.as_expected:
        return None
    if record.ended == "answered" and blame:
        return FailureMode(record.verdict, record.ended, blame.field, blame.stage, **place)
    lost = type(record.unusable).__name__ if record.unusable else ""
    fault = record.harness_error.exception if record.harness_error else ""
    return FailureMode(record.verdict, record.ended, error=lost or fault or _kind(record))


def rule_broken(scene: Scene) -> tuple[str, ...]:
    """Return the rule that a scene breaks, which LAMMPS is expected to refuse; empty if it is not, or none is known.

    A scene that breaks none is accepted too, which would not be the same failure.
    """
    if scene.expect is None:
        return ()
    if scene.violate:
        return (scene.violate,)
    try:
        reference_side.with_cut(scene, scene.rheo.cut or 1.0)
    except InputError as error:
        return error.what, _raised_in(error)
    return ()


def _raised_in(error: BaseException) -> str:
    """Return the line of the reference that refuses: the same rule has other numbers in another scene."""
    while isinstance(error.__context__, InputError):  # before places were put in front
        error = error.__context__
    last = traceback.extract_tb(error.__traceback__)[-1]
    return f"{last.filename}:{last.lineno}"


def _kind(record: CaseRecord) -> str:
    """Return what is the same of two errors that differ in numbers alone; of a process that died, how it did."""
    if record.ended in ("crashed", "timeout"):
        return record.died
    return _NUMBER.sub("#", record.engine_error)
