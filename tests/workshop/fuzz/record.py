"""The record of random scenes: the document fuzz.json."""

from __future__ import annotations

from pydantic import Field

from lammps_cases.records.documents import Record
from lammps_cases.records.run_record import EngineRecord


class Red(Record):
    """A scene that is not as expected and not explained by a finding."""

    draw: int
    verdict: str
    failure: str = Field(description="how it fails; scenes that fail the same way are made small once")
    message: str
    particles: int
    file: str = Field(description="case file of the scene as drawn")
    small: str = Field("", description="case file of the smallest scene that fails the same way; empty: none was made")
    small_particles: int | None = None
    note: str = Field("", description="why it was not made small")
    reproduce: str


class FuzzRecord(Record):
    """Random scenes of one seed on one engine."""

    engine: EngineRecord
    command: str = ""
    seed: int
    first: int = Field(0, description="number of the first draw")
    drawn: int = Field(0, description="scenes judged")
    rejected: dict[str, int] = Field({}, description="attempts that were no scene, by reason")
    verdicts: dict[str, int] = Field({})
    twins: int = Field(0, description="scenes judged against a second run of LAMMPS")
    findings: dict[str, int] = Field({}, description="scenes that each finding explains")
    gaps: dict[str, int] = Field({}, description="scenes that a finding changes and its variant does not reproduce")
    lost: int = Field(
        0, description="scenes whose particles are lost: by LAMMPS and the reference, or by the latter alone"
    )
    unbounded: int = Field(
        0,
        description="scenes in which something has no bound, and known findings reproduce the rest",
    )
    red: list[Red] = Field([])
    choices: dict[str, int] = Field({}, description="choices of the schema, and how many scenes take each")
    never: dict[str, str] = Field({}, description="keys that are never drawn, and why")
    pairs_drawn: int = 0
    pairs: int = Field(0, description="pairs of choices of different keys, possible or not")
    seconds: float = 0.0
    interrupted: bool = False

    @property
    def exit_code(self) -> int:
        """Exit code: 1 if something is not explained."""
        return int(bool(self.red))

    @property
    def rejection(self) -> float:
        """Share of invalid attempts."""
        failed = sum(self.rejected.values())
        return failed / max(failed + self.drawn, 1)
