"""The catalogue of changes, and the cases that detect them: two different scenes in each dimension."""

from __future__ import annotations

from collections import defaultdict

import pytest

from lammps_cases.scene import casefile
from lammps_cases.scene.casefile import Case
from lammps_cases.scene.changes import catalogue
from lammps_cases.verdict.exercise import can_see
from lammps_cases.verdict.mistakes import changes
from tests.workshop import default_cases

WITNESSES = 2
CASES = casefile.load()


def test_every_change_is_an_edit_or_a_class() -> None:
    assert all(bool(change.function) != bool(change.stages) for change in changes().values())
    assert all(change.stages or not change.shows for change in changes().values())


def test_every_case_names_changes() -> None:
    """A run checks that the case detects them; a refusal and a twin of LAMMPS itself can detect none."""
    assert [case.name for case in CASES if can_see(case) and not case.exercises] == []
    assert [case.name for case in CASES if not can_see(case) and case.exercises] == []


@pytest.mark.parametrize("cases", [CASES, casefile.select(CASES)], ids=["all", "default"])
def test_every_named_change_has_two_witnesses_in_2d_and_3d(cases: list[Case]) -> None:
    """A law does not depend on the dimension: its witnesses may have either."""
    scenes: dict[tuple[str, int], set[str]] = defaultdict(set)
    for case in cases:
        scene = case.scene.model_dump_json(exclude={"compare", "engine", "manual", "twin"})
        for change in case.exercises:
            scenes[change, case.scene.dimension].add(scene)
    few = []
    for name in dict.fromkeys(name for name, _ in scenes):
        counts = {dimension: len(scenes[name, dimension]) for dimension in (2, 3)}
        of_law = catalogue()[name].function.startswith(("eos_ref.eos", "lammps_cases.comparison.compare"))
        if sum(counts.values()) < WITNESSES if of_law else min(counts.values()) < WITNESSES:
            few.append((name, counts))
    assert few == []


@pytest.mark.slow
def test_default_cases_are_the_fewest_that_see_as_much() -> None:
    """Repair by ``python -m tests.workshop.default_cases``, which chooses the cases that `eos-ref run` leaves out."""
    found = default_cases.groups()
    chosen = {case.name for case in casefile.select(CASES)}
    assert casefile.more() < {case.name for case in CASES}
    assert default_cases.lacking(chosen, found) == []
    assert default_cases.lacking(chosen - {"forces.all.rk1.2d"}, found) != [], "the check can fail"
    assert len(chosen) == len(default_cases.fewest(found)) < len(CASES) / 2
