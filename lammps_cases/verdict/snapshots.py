"""LAMMPS' answer by the names of fields: at the steps compared, with the neighbour lists if they were read."""

from __future__ import annotations

from collections.abc import Sequence

from lammps_cases.engine.session import Answer, Array
from lammps_cases.findings import applicable
from lammps_cases.findings.neighbour_lists import NeighbourList
from lammps_cases.findings.variants import Snapshot
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import Atoms
from lammps_cases.scene.casefile import Case
from lammps_cases.scene.fields import FIELDS
from lammps_cases.verdict.problems import problem_of


def snapshot(scene: Scene, arrays: dict[str, Array]) -> Snapshot:
    """Return LAMMPS' fields of one step by name, vectors with as many components as dimensions."""
    return {name: FIELDS[name].of(arrays, scene.dimension) for name in scene.compare}


def read_snapshots(scene: Scene, answer: Answer, steps: Sequence[int] = ()) -> list[Snapshot]:
    """Return LAMMPS' fields at all steps read, or at some of those compared; the first holds its neighbour lists."""
    at = [scene.snapshots.index(step) for step in steps] or range(len(answer.snapshots))
    snapshots = [snapshot(scene, answer.snapshots[k]) for k in at]
    if answer.lists:
        snapshots[0]["lists"] = tuple(NeighbourList.read(answer.arrays["id"], **arrays) for arrays in answer.lists)
    return snapshots


def asks_for_lists(case: Case, scene: Scene, atoms: Atoms) -> bool:
    """Return whether a scene shows findings whose variants need LAMMPS' neighbour lists."""
    variants = (
        entry.model_variant for entry in applicable(problem_of(scene, atoms, case.where, scene.snapshots), True)
    )
    return any(variant is not None and variant.lists for variant in variants)
