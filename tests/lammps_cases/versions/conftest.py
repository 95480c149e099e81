"""One small run on the LAMMPS of this environment, for all tests here, and edited copies of it."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from lammps_cases.engine.installations import Engine
from lammps_cases.run import campaign
from lammps_cases.scene import casefile
from tests.support.edited_runs import NAMES, Edit


@pytest.fixture(scope="session")
def small_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run two quick cases without steps, one of the particle model that a finding explains, and one that is refused."""
    folder = tmp_path_factory.mktemp("regression") / "run"
    cases = casefile.select(casefile.load(), NAMES)
    campaign.run_cases(cases, Engine(), 2, folder, campaign.Request("eos-ref run"))
    return folder


@pytest.fixture
def changed_run(small_run: Path, tmp_path: Path) -> Callable[..., Path]:
    """Copy the run and edit its document; ``edit`` gets the record of a case, by default the first."""

    def change(
        edit: Edit | None = None, case: str = NAMES[0], whole: Edit | None = None, name: str = "changed"
    ) -> Path:
        folder = tmp_path / name
        shutil.copytree(small_run, folder)
        document = json.loads((folder / "run.json").read_text())
        if edit:
            edit(next(record for record in document["cases"] if record["case"] == case))
        if whole:
            whole(document)
        (folder / "run.json").write_text(json.dumps(document))
        return folder

    return change
