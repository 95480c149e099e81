"""Scenes drawn at random over the whole schema, against real LAMMPS; `make fuzz` draws many."""

from __future__ import annotations

from pathlib import Path

import pytest

from lammps_cases.engine.installations import Engine
from tests.workshop.fuzz.hunt import Hunt
from tests.workshop.fuzz.record import FuzzRecord

SEED, SCENES = 31, 12


@pytest.mark.lammps
@pytest.mark.slow
def test_nothing_is_unexplained(tmp_path: Path) -> None:
    record = Hunt(Engine(), SEED, 600.0, 1, tmp_path, scenes=SCENES).run()
    assert [red.message for red in record.red] == []
    assert record.exit_code == 0 and not record.interrupted
    assert record.drawn == sum(record.verdicts.values()) == SCENES
    assert "explained" in record.verdicts and {"exact", "pass"} & set(record.verdicts) and record.twins
    assert sum(record.gaps.values()) <= SCENES // 4  # limits that no variant reproduces
    assert FuzzRecord.model_validate_json((tmp_path / "fuzz.json").read_bytes()) == record
