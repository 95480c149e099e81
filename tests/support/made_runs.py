"""Made-up records of runs."""

from __future__ import annotations

from lammps_cases.records.case_parts import FieldRecord, Seconds, Verdict
from lammps_cases.records.run_record import CaseRecord, EngineRecord, RunRecord


def case(
    name: str,
    verdict: Verdict = "pass",
    ratio: float | None = 0.25,
    digest: str = "00000000000000aa",
    seconds: float = 0.1,
    finding: str | None = None,
    field: str = "f",
) -> CaseRecord:
    """A case with one field."""
    found = FieldRecord(
        field=field,
        stage="pair",
        verdict=verdict,
        max_abs=1e-9,
        max_over_bound=ratio,
        digest=digest,
        explained_by=[finding] if finding else [],
    )
    return CaseRecord(
        case=name, verdict=verdict, natoms=9, steps=3, seconds=Seconds(lammps=seconds, reference=0.5), fields=[found]
    )


def run(
    version: str = "2025.7.22.1.0",
    date: str = "2026-11-01T10:00:00Z",
    cases: list[CaseRecord] | None = None,
    name: str = "",
    sha256: str | None = None,
    seconds: float = 2.0,
) -> RunRecord:
    """A run on a release, or on the engine called `name`."""
    engine = EngineRecord(
        name=name or f"pypi:{version}",
        distribution=version,
        version_string="20250722",
        library_sha256=f"sha-of-{version or name}" if sha256 is None else sha256,
    )
    record = RunRecord(
        engine=engine,
        reference={"eos-ref": "0.1.0"},
        date=date,
        command="eos-ref run",
        cases=[case("one"), case("two.a")] if cases is None else cases,
        seconds=seconds,
    )
    return record.counted()
