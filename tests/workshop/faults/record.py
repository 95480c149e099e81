"""The results of `make power` on disk: ``power.json``, and ``planted.jsonl`` with every fault as it is done."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from pydantic import BaseModel, ConfigDict, TypeAdapter

from lammps_cases.records.documents import INFINITE
from lammps_cases.records.files import write_atomically
from lammps_cases.records.journal import Parts
from lammps_cases.records.yaml_files import read_yaml
from tests.workshop.faults.alarms import AlarmRun
from tests.workshop.faults.fault import FAMILIES, Detection, Family, Fault, files
from tests.workshop.faults.resolution import Resolution
from tests.workshop.faults.tasks import Control

ALL_RATE, QUICK_RATE = 0.99, 0.90  # shares of all faults that some case and a quick case must catch
ARGUED = Path(__file__).with_name("argued.yaml")


class FaultArgument(BaseModel):
    """Why no case can see a fault, as ``argued.yaml`` holds it."""

    model_config = ConfigDict(extra="forbid")

    id: str
    what: str
    reason: str


@dataclass(frozen=True)
class FaultRecord:
    """A planted fault.

    Attributes
    ----------
    caught_by : cases that detect it: until they are of two files, or all
    quick : whether a quick case is among them
    seen : their verdicts, and the field that each names
    argued : why no case can see it; empty if a case does, or if nothing is known
    """

    id: str
    family: Family
    kind: str
    what: str
    caught_by: tuple[str, ...]
    quick: bool
    seen: tuple[Detection, ...] = ()
    argued: str = ""


@dataclass(frozen=True)
class ControlRecord:
    """A family without a fault: its cases, and those that are red nevertheless."""

    family: Family
    cases: int
    red: tuple[str, ...]


@dataclass(frozen=True)
class Power:
    """Everything found.

    Attributes
    ----------
    whole : whether all faults were planted in all cases, so that the rates count
    """

    __pydantic_config__ = INFINITE

    command: str
    machine: dict[str, str]
    engine: dict[str, str]
    whole: bool
    quick_only: bool
    seconds: float
    controls: tuple[ControlRecord, ...]
    faults: tuple[FaultRecord, ...]
    resolution: tuple[Resolution, ...] = ()
    alarms: tuple[AlarmRun, ...] = ()

    @property
    def caught(self) -> int:
        """Return the number of faults that some case detects."""
        return sum(bool(fault.caught_by) for fault in self.faults)

    @property
    def quick(self) -> int:
        """Return the number of faults that a quick case detects."""
        return sum(fault.quick for fault in self.faults)

    @property
    def single(self) -> list[FaultRecord]:
        """Return the faults that cases of one file alone detect."""
        return [fault for fault in self.faults if len(files(fault.seen)) == 1]

    @property
    def hidden(self) -> list[FaultRecord]:
        """Return the faults in code that findings of the engine replace: detected only for a LAMMPS without these."""
        return [fault for fault in self.faults if fault.seen and all(one.manual for one in fault.seen)]

    @property
    def complaints(self) -> list[str]:
        """Return what is wrong, one line each."""
        lines = [f"control {control.family}: {red}" for control in self.controls for red in control.red]
        if not self.quick_only:
            unseen = (fault for fault in self.faults if not fault.caught_by and not fault.argued)
            lines += [f"unseen: {fault.id}: {fault.what}" for fault in unseen]
        if self.whole:
            rates = [("quick", self.quick, QUICK_RATE)]
            rates += [] if self.quick_only else [("all", self.caught, ALL_RATE)]
            for name, count, least in rates:
                if count < least * len(self.faults):
                    lines.append(f"{name} cases catch {count} of {len(self.faults)} faults, fewer than {least:.0%}")
        alarms = [alarm for run in self.alarms for alarm in run.alarms if not alarm.finding]
        return lines + [f"false alarm, {alarm.kind}: {alarm.case}: {alarm.message}" for alarm in alarms]


def arguments(path: Path = ARGUED) -> dict[tuple[str, str], str]:
    """Return the reasons why faults are undetected, by id and change."""
    entries = TypeAdapter(list[FaultArgument]).validate_python(read_yaml(path, "arguments"))
    return {(argument.id, argument.what): argument.reason for argument in entries}


def fault_record(fault: Fault, detections: tuple[Detection, ...], quick: set[str]) -> FaultRecord:
    """Return the record of a fault that was planted."""
    names = tuple(detection.case for detection in detections)
    return FaultRecord(fault.id, fault.family, fault.kind, fault.what, names, bool(quick & set(names)), detections)


def with_arguments(records: Sequence[FaultRecord]) -> tuple[FaultRecord, ...]:
    """Return the records of faults, with the reasons why some are undetected."""
    reasons = arguments()
    return tuple(
        replace(fault, argued="" if fault.caught_by else reasons.get((fault.id, fault.what), "")) for fault in records
    )


def controls(measured: Sequence[Control]) -> tuple[ControlRecord, ...]:
    """Return the control of every family: of `told` and `read` LAMMPS' own answers, of `formula` the reference's."""

    def of(family: Family) -> ControlRecord:
        by_lammps = family != "formula"
        used = [c for c in measured if by_lammps or c.played is not None]
        red = [c for c in used if not (c.answered if by_lammps else c.played and c.manual is not False)]
        return ControlRecord(family, len(used), tuple(f"{c.case}: {'; '.join(c.red)}" for c in red))

    return tuple(of(family) for family in FAMILIES)


def write(power: Power, folder: Path) -> None:
    """Write ``power.json``."""
    write_atomically(folder / "power.json", TypeAdapter(Power).dump_json(power, indent=1) + b"\n")


# --- faults as they are done


def sources() -> str:
    """Return the SHA-256 of the sources and cases that determine which faults are planted and detected."""
    digest = hashlib.sha256()
    root = Path(__file__).parents[3]
    for package in ("eos_ref", "lammps_cases", "tests/workshop/faults"):
        for path in sorted((root / package).rglob("*")):
            if path.suffix in (".py", ".yaml", ".csv", ".extxyz") and path != ARGUED:
                digest.update(path.relative_to(root).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()


def planted(folder: Path) -> Parts[FaultRecord]:
    """Return ``planted.jsonl``, to which faults are added as they are done."""
    return Parts(folder / "planted.jsonl", FaultRecord)
