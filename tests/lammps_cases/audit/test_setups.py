"""A deck followed without executing its runs: the steps of each run, and the commands and dumps before it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lammps_cases.audit.follow import ENDLESS, SetupWatch
from lammps_cases.audit.messages import DeckSetups
from lammps_cases.audit.options import AuditOptions


def lammps() -> Any:
    """A stub of LAMMPS with two atoms at step 100."""
    per_atom = {"id": np.array([2, 1]), "mass": np.array([0.0, 1.5])}
    return SimpleNamespace(
        extract_setting={"world_size": 1, "nlocal": 2, "dimension": 2, "ntypes": 1}.get,
        extract_global={"ntimestep": 100, "dt": 0.01, "units": "lj"}.get,
        extract_atom=lambda name: None,
        numpy=SimpleNamespace(extract_atom=per_atom.get),
        version=lambda: 20250722,
    )


@pytest.fixture
def watch() -> SetupWatch:
    return SetupWatch(lammps(), AuditOptions(), lambda message: None)


def followed(watch: SetupWatch, *lines: str) -> DeckSetups:
    """The set-ups recorded from commands; LAMMPS is given runs of no steps."""
    for line in lines:
        words = line.split()
        if words[0] == "run":
            executed: list[str] = []
            assert not watch.run(words, executed.append), "a deck goes on to its end"
            assert executed == ["run 0"]
        else:
            watch.note(words)
    return watch.setups()


def test_steps_of_successive_runs_are_counted_without_stepping(watch: SetupWatch) -> None:
    runs = followed(watch, "run 20", "run 150 upto", "run 5", "reset_timestep 0", "run 7").runs
    assert [(run.first, run.last) for run in runs] == [(100, 120), (120, 150), (150, 155), (100, 107)]
    assert runs[0].id_n.tolist() == [2, 1] and runs[0].mass_t == [0.0, 1.5] and not runs[0].solid_n.any()


def test_run_records_the_commands_before_it(watch: SetupWatch) -> None:
    lines = ["timestep 0.01", "print hello", "compute p all pressure", "run 1", "uncompute p", "fix 1 all nve", "run 1"]
    kept = followed(watch, *lines)
    assert kept.commands == ["timestep 0.01", "compute p all pressure", "uncompute p", "fix 1 all nve"]
    assert [run.before for run in kept.runs] == [2, 4]
    assert [list(run.computes) for run in kept.runs] == [["p"], []]
    watch.note(["variable", "v", "equal", "1 + 1"])
    assert watch.setups().commands[-1] == 'variable v equal """1 + 1"""'


def test_dump_covers_the_runs_from_definition_to_end(watch: SetupWatch) -> None:
    lines = ["run 1", "dump d all custom 5 f id x", "dump_modify d sort id", "run 1", "undump d", "run 1"]
    last = ["write_dump all custom g id modify sort id", "dump d all custom 9 h id", "clear", "run 1"]
    first, written, second = followed(watch, *lines, *last).dumps
    assert (first.words[3], first.modify, first.begin, first.end) == ("5", ["sort", "id"], 1, 2)
    assert (written.words[3:], written.modify, written.step) == (["0", "g", "id"], ["sort", "id"], 103)
    assert (second.begin, second.end) == (3, 3), "clear ends it"
    assert followed(watch, "dump e all custom 1 f id").dumps[-1].end == ENDLESS
