"""Faults in what real LAMMPS is given: its input says something else than the scene that judges it.

A change of the scene goes through `lammps_cases.setup.commands` as any other scene; what no scene can say (a fix
dropped, an atom moved) is changed in the job itself. A change that leaves a job as it was does not apply to its case.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from eos_ref import InputError
from lammps_cases.engine.session import Job
from lammps_cases.run.prepared_case import PreparedCase
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import Atoms
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan
from tests.workshop.faults.fault import Fault
from tests.workshop.faults.scene_changes import SceneChange

JobChange = Callable[[Job], Job]


@dataclass(frozen=True)
class InputFault(Fault):
    """A fault in what LAMMPS is given: a change of the scene, or of the job made from it."""

    change_scene: SceneChange | None = None
    change_job: JobChange | None = None


def jobs(fault: InputFault, ready: PreparedCase, lists: bool = False) -> list[Job] | None:
    """Return the jobs of a case, or of both runs of a twin, with a fault; None if it does not apply.

    With ``lists`` those that read every step and the neighbour lists.
    """
    right_jobs, faulty = ready.reading_lists if lists else ready.jobs, []
    for (scene, atoms), right in zip(ready.sides, right_jobs, strict=True):
        wrong = right
        if fault.change_scene is not None:
            try:
                changed = fault.change_scene(scene)
                wrong = _job(changed, atoms, scene, lists) if changed != scene else right
            except (InputError, ValueError, IndexError, ZeroDivisionError, OverflowError):
                return None  # the change makes no sense for this scene
        if fault.change_job is not None:
            wrong = fault.change_job(wrong)
        faulty.append(wrong)
    same = [_same(one, other) for one, other in zip(faulty, right_jobs, strict=True)]
    return None if all(same) else faulty


def _job(changed: Scene, atoms: Atoms, scene: Scene, lists: bool) -> Job:
    """Return the job of a changed scene; it may ask for what it no longer has, which is LAMMPS' to refuse."""
    try:
        items = plan(changed)
    except InputError:
        items = plan(scene)
    return job(changed, atoms, items, every_step=lists, lists=lists)


def _same(one: Job, other: Job) -> bool:
    def equal(a: Any, b: Any) -> bool:
        return np.array_equal(a, b) if isinstance(a, np.ndarray) or isinstance(b, np.ndarray) else bool(a == b)

    per_atom = [(one.per_atom.get(name), other.per_atom.get(name)) for name in {*one.per_atom, *other.per_atom}]
    others = [(getattr(one, f.name), getattr(other, f.name)) for f in fields(Job) if f.name != "per_atom"]
    return all(equal(a, b) for a, b in (*others, *per_atom))
