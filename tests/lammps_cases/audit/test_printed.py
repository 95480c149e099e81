"""Output of eos-ref audit: each statement once, within the width of the terminal."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.support.outcome import Outcome

pytestmark = pytest.mark.lammps
COLUMNS = 110


def test_deck_that_fails_midway(
    eos_ref_command: Callable[..., Outcome], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", str(COLUMNS))
    done = eos_ref_command("audit", ROOT / "tests" / "decks" / "in.column", "--out", tmp_path / "out")
    assert done.code == 3
    assert " ".join(done.out.split()).count("ERROR: Lost atoms") == 1
    lines = [line for line in done.out.splitlines() if str(tmp_path) not in line]
    assert max(map(len, lines)) <= COLUMNS
