"""Real LAMMPS is told something else than the scene says, and judged against the scene.

A change of the scene goes through `lammps_cases.setup.commands` as any other scene; what no scene can say (a fix
dropped, an atom moved) is changed in the job itself. A change that leaves a job as it was does not apply to its case.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from eos_ref import InputError
from lammps_cases.engine.session import Job
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import Atoms
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan
from lammps_cases.studies.mutation.fault import Fault

Alter = Callable[[Scene], Scene]
Retell = Callable[[Job], Job]


@dataclass(frozen=True)
class Told(Fault):
    """A fault in what LAMMPS is told: a change of the scene, or of the job made from it."""

    alter: Alter | None = None
    retell: Retell | None = None


@cache
def faults() -> dict[str, Told]:
    """All faults of this family by their id, in order."""
    from lammps_cases.studies.mutation import told_jobs, told_laws, told_model

    found = (*told_laws.FAULTS, *told_model.FAULTS, *told_jobs.FAULTS)
    assert len({fault.id for fault in found}) == len(found), "two faults of one id"
    return {fault.id: fault for fault in found}


def jobs(fault: Told, sides: list[tuple[Scene, Job]], atoms: list[Atoms]) -> list[Job] | None:
    """What LAMMPS is told instead; None if the fault does not apply.

    Parameters
    ----------
    sides : scene and job of the case, or of both runs of a twin
    atoms : particles of each
    """
    told = []
    for (scene, right), particles in zip(sides, atoms, strict=True):
        wrong = right
        if fault.alter is not None:
            try:
                altered = fault.alter(scene)
                wrong = _job(altered, particles, scene) if altered != scene else right
            except (InputError, ValueError, IndexError, ZeroDivisionError, OverflowError):
                return None  # the change makes no sense for this scene
        if fault.retell is not None:
            wrong = fault.retell(wrong)
        told.append(wrong)
    same = [_same(one, other) for one, (_, other) in zip(told, sides, strict=True)]
    return None if all(same) else told


def _job(altered: Scene, atoms: Atoms, scene: Scene) -> Job:
    """The job of an altered scene; it may ask for what it no longer has, which is LAMMPS' to refuse."""
    try:
        items = plan(altered)
    except InputError:
        items = plan(scene)
    return job(altered, atoms, items)


def _same(one: Job, other: Job) -> bool:
    def text(of: Job) -> tuple[object, ...]:
        return of.setup, of.commands, of.runs, tuple(of.outputs.items()), of.atom_arrays, of.ranks

    if one is other:
        return True
    arrays = ((one.id_n, other.id_n), (one.type_n, other.type_n), (one.x_nc, other.x_nc), (one.v_nc, other.v_nc))
    values = [(one.per_atom.get(name), other.per_atom.get(name)) for name in {*one.per_atom, *other.per_atom}]
    return text(one) == text(other) and all(
        (a is None) == (b is None) and (a is None or b is None or np.array_equal(a, b)) for a, b in (*arrays, *values)
    )


def replaced_text(old: str, new: str) -> Retell:
    """Text of commands replaced, wherever it stands."""

    def retell(of: Job) -> Job:
        def lines(text: tuple[str, ...]) -> tuple[str, ...]:
            return tuple(line.replace(old, new) for line in text)

        return replace(of, setup=lines(of.setup), commands=lines(of.commands))

    return retell


def without(*beginnings: str) -> Retell:
    """Commands left out that begin with some words."""

    def retell(of: Job) -> Job:
        keep = tuple(line for line in of.commands if not line.startswith(beginnings))
        return replace(of, setup=tuple(s for s in of.setup if not s.startswith(beginnings)), commands=keep)

    return retell
