"""A case ready to run: its particles, its laws, the jobs for LAMMPS."""

from __future__ import annotations

from dataclasses import dataclass

from eos_ref import EOSTable
from lammps_cases.engine.session import Answer, Job
from lammps_cases.engine.workers import Failure
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import Atoms, build
from lammps_cases.scene.casefile import Case
from lammps_cases.setup import reference_side, twins
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan
from lammps_cases.setup.twins import Twin

Outcomes = list[Answer | Failure]  # of a case's run, or of the original's and its twin's


@dataclass(frozen=True)
class PreparedCase:
    """A case ready to run: its particles and, unless LAMMPS is to refuse it, its laws."""

    case: Case
    eos: EOSTable | None
    atoms: Atoms
    twin: Twin | None = None

    @property
    def sides(self) -> list[tuple[Scene, Atoms]]:
        """The scene and its particles, or those of the original and its twin."""
        if self.twin is None:
            return [(self.case.scene, self.atoms)]
        return [(self.twin.scene, self.twin.atoms), (self.twin.other_scene, self.twin.other_atoms)]

    @property
    def jobs(self) -> list[Job]:
        """The jobs for LAMMPS: one, or those of the original and its twin."""
        return [job(scene, atoms, plan(scene)) for scene, atoms in self.sides]

    @property
    def reading_lists(self) -> list[Job]:
        """The same jobs, read at every step with the neighbour lists."""
        return [job(scene, atoms, plan(scene), every_step=True, lists=True) for scene, atoms in self.sides]


def prepare(case: Case) -> PreparedCase:
    """Build a case's particles and laws, checking them against each other.

    Raises
    ------
    InputError
    """
    eos = None if case.scene.expect else case.scene.eos(case.where)
    atoms = build(case, eos)
    if case.scene.whole_model and not case.scene.expect:
        reference_side.state(case.scene, atoms, case.where)  # refuses what has no meaning before LAMMPS sees it
    return PreparedCase(case, eos, atoms, twins.make(case, atoms) if case.scene.twin else None)
