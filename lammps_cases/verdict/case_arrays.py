"""The per-atom arrays of a case: LAMMPS' fields by name, both sides and the bound of each, and their files.

``CASE.npz`` holds the atoms and every field at its worst step; ``CASE@page.npz`` the additional data of a report's
page, with names that begin with ``@``: other steps, pairs of the worst atoms; ``CASE@steps.npz`` LAMMPS' fields of a
red case at all steps compared. No case has a name with ``@``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lammps_cases.comparison.compare import Comparison, components, excess, worst_component
from lammps_cases.comparison.pair_sums import LARGEST
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.engine.session import Answer, Array
from lammps_cases.findings import applicable
from lammps_cases.findings.neighbour_lists import NeighbourList
from lammps_cases.findings.variants import Snapshot
from lammps_cases.records.files import arrays_files, read_arrays, write_arrays
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import Atoms
from lammps_cases.scene.casefile import Case
from lammps_cases.scene.fields import FIELDS
from lammps_cases.verdict.problems import problem_of

Arrays = dict[str, Any]
SIDES = ("lammps", "reference", "bound")
ALL_KEPT = 50_000  # atoms of a case; of larger cases only some are written to disk
SAMPLE, WORST = 5000, 50  # evenly spaced atoms, and the worst of each field


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


def field_arrays(
    atoms: Atoms, got: Arrays, comparisons: list[Comparison], table: Mapping[str, Sequence[Comparison]] | None = None
) -> Arrays:
    """Return the arrays of ``fields/CASE.npz``: the atoms, their box, and both sides and the bound of fields.

    The other steps of a ``table`` at which fields differ are included, by names such as ``@10 lammps f``.
    """
    arrays: Arrays = {name: got[name] for name in ("id", "type", "x", "v", "rho")}
    arrays["mass"] = atoms.mass_n
    arrays["box"] = np.stack([atoms.low_c, atoms.high_c, *[atoms.tilt] * any(atoms.tilt)])
    arrays["periodic"] = np.array(atoms.periodic)
    for comparison in comparisons:
        name = comparison.record.field
        arrays[f"{name}.lammps"] = comparison.lammps_n
        arrays[f"{name}.reference"] = comparison.reference_n
        arrays[f"{name}.bound"] = comparison.bound_n
    for record in (comparison.record for comparison in comparisons):
        if not (table and record.steps and record.max_abs):
            continue
        for at, other in zip(record.steps, table[record.field], strict=True):
            if at.step != record.worst_step:
                sides = {"lammps": other.lammps_n, "reference": other.reference_n, "bound": other.bound_n}
                arrays |= {f"@{at.step} {side} {record.field}": values for side, values in sides.items()}
    return arrays


def pair_arrays(
    record: CaseRecord, scene: Scene, atoms: Atoms, where: str, steps: Sequence[int], predictor: Predictor
) -> Arrays:
    """Return the reference's pairs of these atoms; see `lammps_cases.comparison.pair_sums.columns`.

    Empty for a scene whose particles do not interact, and for a large one.
    """
    looked = looked_at(record, steps)
    if not looked or not scene.interacts or len(atoms) > LARGEST:
        return {}
    rows = [(step, int(np.searchsorted(atoms.id_n, atom))) for step, atom in looked]
    columns = dict(predictor.pair_sums(problem_of(scene, atoms, where, tuple(steps), predictor), rows))
    ids = {"atom": atoms.id_n[columns.pop("row")], "id": atoms.id_n[columns.pop("other")]}
    return {f"@pairs {name}": values for name, values in (columns | ids).items()}


def looked_at(record: CaseRecord, steps: Sequence[int]) -> list[tuple[int, int]]:
    """Return steps and ids: where each field exceeds its bound most, and where the first one does so first."""
    outside = [field for field in record.fields if field.steps and field.verdict not in ("exact", "pass")]
    places: list[tuple[int | None, int | None]] = [(record.blame.step, record.blame.atom)] if record.blame else []
    places += [(field.worst_step, field.worst_id) for field in outside]
    there = [(step, atom) for step, atom in places if step is not None and atom is not None and step in steps]
    return list(dict.fromkeys(there))


def sampled(arrays: Arrays) -> Arrays:
    """Return the arrays of some atoms of a very large case: evenly spaced ones, and the worst of every field.

    Their ids identify them; verdicts cover all atoms.
    """
    n = len(arrays.get("id", ()))
    if n <= ALL_KEPT:
        return arrays
    picked = [np.linspace(0, n - 1, SAMPLE).astype(int)]
    for name in (name.removesuffix(".lammps") for name in arrays if name.endswith(".lammps")):
        sides = (arrays[f"{name}.{side}"] for side in ("lammps", "reference", "bound"))
        ratio_n = components(excess(*sides)[1]).max(axis=1)
        picked.append(np.argpartition(ratio_n, -WORST)[-WORST:])
    at = np.unique(np.concatenate(picked))
    whole = ("box", "periodic")
    return {name: a if name in whole or name.startswith("@pairs ") else a[at] for name, a in arrays.items()}


def write(fields: Path, case: str, arrays: Arrays) -> None:
    """Write the arrays of a case; of vectors and tensors at other steps the component closest to its bound."""
    own, further = ({n: a for n, a in arrays.items() if n.startswith("@") == other} for other in (False, True))
    for name in [name for name in further if " lammps " in name]:
        names = [name.replace(" lammps ", f" {side} ") for side in SIDES]
        sides = [np.asarray(further[each], float) for each in names]
        if sides[0].ndim > 1:
            ratio_n = excess(*sides)[1]
            further |= {of: worst_component(values, ratio_n) for of, values in zip(names, sides, strict=True)}
    write_arrays(fields / f"{case}.npz", own)
    if further:
        write_arrays(fields / f"{case}@page.npz", further)


def read(fields: Path, case: str) -> tuple[Arrays, Arrays]:
    """Return the arrays of a case, and those of its page, from the files that exist."""
    own, further = (read_arrays(path) if path.is_file() else {} for path in arrays_files(fields, case)[:2])
    return own, further


def write_steps(fields: Path, case: str, scene: Scene, answer: Answer) -> None:
    """Write LAMMPS' fields at the steps compared."""
    arrays: Arrays = {}
    for step, snapshot in zip(scene.snapshots, read_snapshots(scene, answer), strict=True):
        arrays |= {f"{step} {name}": values for name, values in snapshot.items() if name != "lists"}
    write_arrays(arrays_files(fields, case)[2], arrays)


def read_steps(fields: Path, case: str, scene: Scene) -> list[Snapshot] | None:
    """Return LAMMPS' fields at the steps compared; None if they were not written."""
    path = arrays_files(fields, case)[2]
    arrays = read_arrays(path) if path.is_file() else {}
    if {f"{step} {name}" for step in scene.snapshots for name in scene.compare} != set(arrays):
        return None
    return [{name: arrays[f"{step} {name}"] for name in scene.compare} for step in scene.snapshots]
