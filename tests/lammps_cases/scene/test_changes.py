"""The catalogue of changes, and the cases that see them: two of different scenes in every dimension."""

from __future__ import annotations

from collections import defaultdict

from lammps_cases.scene import casefile
from lammps_cases.scene.changes import catalogue
from lammps_cases.verdict.exercise import can_see
from lammps_cases.verdict.mistakes import LAW_MUTANTS, MODEL_MUTANTS

WITNESSES = 2
CASES = casefile.load()


def test_mistakes_of_the_report_are_in_the_catalogue() -> None:
    for of, mistakes in (("law", LAW_MUTANTS), ("stage", MODEL_MUTANTS)):
        assert [change.what for change in catalogue().values() if change.mistake == of] == list(mistakes)
    assert all(bool(change.function) != bool(change.mistake) for change in catalogue().values())


def test_every_case_names_changes_that_it_sees() -> None:
    """A run checks that it does see them; a refusal and a twin of LAMMPS's own see none."""
    assert [case.name for case in CASES if can_see(case) and not case.exercises] == []
    assert [case.name for case in CASES if not can_see(case) and case.exercises] == []


def test_every_change_that_a_case_names_has_two_witnesses_in_2d_and_3d() -> None:
    """A law knows no dimension: its witnesses may be of either."""
    scenes: dict[tuple[str, int], set[str]] = defaultdict(set)
    for case in CASES:
        scene = case.scene.model_dump_json(exclude={"compare", "engine", "manual", "twin"})
        for change in case.exercises:
            scenes[change, case.scene.dimension].add(scene)
    few = []
    for name in dict.fromkeys(name for name, _ in scenes):
        counts = {dimension: len(scenes[name, dimension]) for dimension in (2, 3)}
        of_law = catalogue()[name].mistake == "law" or catalogue()[name].function.startswith("eos_ref.eos")
        if sum(counts.values()) < WITNESSES if of_law else min(counts.values()) < WITNESSES:
            few.append((name, counts))
    assert few == []
