"""Atoms that a reader of a report looks at: the worst of each field outside its bound, with what their pairs add."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lammps_cases.comparison.pair_sums import LARGEST
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import Atoms
from lammps_cases.verdict.model_cases import problem_of
from lammps_cases.verdict.outcome import Arrays


def pair_arrays(
    record: CaseRecord, scene: Scene, atoms: Atoms, where: str, steps: Sequence[int], predictor: Predictor
) -> Arrays:
    """Return the pairs of these atoms by the reference; see `lammps_cases.comparison.pair_sums.columns`.

    None of a scene whose particles do not interact, nor of a large one.
    """
    looked = looks(record, steps)
    if not looked or not scene.interacts or len(atoms) > LARGEST:
        return {}
    rows = [(step, int(np.searchsorted(atoms.id_n, atom))) for step, atom in looked]
    columns = dict(predictor.pair_sums(problem_of(scene, atoms, where, tuple(steps), predictor), rows))
    ids = {"atom": atoms.id_n[columns.pop("row")], "id": atoms.id_n[columns.pop("other")]}
    return {f"@pairs {name}": values for name, values in (columns | ids).items()}


def looks(record: CaseRecord, steps: Sequence[int]) -> list[tuple[int, int]]:
    """Return steps and ids: where each field leaves its bound furthest, and where the first does so first."""
    outside = [field for field in record.fields if field.steps and field.verdict not in ("exact", "pass")]
    places: list[tuple[int | None, int | None]] = [(record.blame.step, record.blame.atom)] if record.blame else []
    places += [(field.worst_step, field.worst_id) for field in outside]
    there = [(step, atom) for step, atom in places if step is not None and atom is not None and step in steps]
    return list(dict.fromkeys(there))
