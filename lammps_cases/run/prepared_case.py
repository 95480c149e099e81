"""A case ready to run: its particles, its laws, the jobs for LAMMPS, and LAMMPS' answers to them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from eos_ref import EOSTable
from lammps_cases.engine.session import Answer, Array, Job
from lammps_cases.engine.workers import Failure, KeptAnswer, solve
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import Atoms, build
from lammps_cases.scene.casefile import Case
from lammps_cases.setup import reference_side, twins
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan
from lammps_cases.setup.twins import Twin

Outcomes = list[Answer | Failure]  # of a case's run, or of the original's and its twin's
Kept = Sequence[Answer | KeptAnswer | Failure]  # answers, or the files that workers left them in


@dataclass(frozen=True)
class PreparedCase:
    """A case ready to run: its particles and, unless LAMMPS is to refuse it, its laws."""

    case: Case
    eos: EOSTable | None
    atoms: Atoms
    twin: Twin | None = None

    @property
    def sides(self) -> list[tuple[Scene, Atoms]]:
        """Return the scene and its particles, or those of the original and its twin."""
        if self.twin is None:
            return [(self.case.scene, self.atoms)]
        return [(self.twin.scene, self.twin.atoms), (self.twin.other_scene, self.twin.other_atoms)]

    @property
    def jobs(self) -> list[Job]:
        """Return the jobs for LAMMPS: one, or those of the original and its twin."""
        return [job(scene, atoms, plan(scene)) for scene, atoms in self.sides]

    @property
    def reading_lists(self) -> list[Job]:
        """Return the same jobs, read at every step with the neighbour lists."""
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
        reference_side.state(case.scene, atoms, case.where)  # rejects undefined input before LAMMPS sees it
    return PreparedCase(case, eos, atoms, twins.make(case, atoms) if case.scene.twin else None)


@dataclass(frozen=True)
class Answers:
    """The outcomes of a case, by a LAMMPS at ``site``, which is run again for missing data."""

    site: str | None
    ready: PreparedCase
    outcomes: Outcomes

    @classmethod
    def read(cls, site: str | None, ready: PreparedCase, kept: Kept) -> Answers:
        """Read answers from files; LAMMPS is run again if a temporary file no longer exists."""

        def outcome(each: Answer | KeptAnswer | Failure, job: Job) -> Answer | Failure:
            if not isinstance(each, KeptAnswer):
                return each
            try:
                return each.read()
            except OSError:
                return solve(site, job)

        return cls(site, ready, [outcome(*of) for of in zip(kept, ready.jobs, strict=True)])

    def with_lists(self) -> Outcomes:
        """Return the outcomes with the neighbour lists of the same runs; empty if the runs differ."""
        return with_lists(self.site, self.ready, self.outcomes, self.ready.reading_lists)

    def at_every_step(self, lists: bool) -> Answer:
        """Return the answer to the case read at every step, with its neighbour lists or without."""
        scene = self.ready.case.scene
        return solve(self.site, job(scene, self.ready.atoms, plan(scene), every_step=True, lists=lists))


def with_lists(site: str | None, ready: PreparedCase, outcomes: Outcomes, reading: Sequence[Job]) -> Outcomes:
    """Return outcomes with the lists that ``reading`` jobs read at every step; empty if the runs differ."""
    reread: Outcomes = []
    for (scene, _), outcome, every_step in zip(ready.sides, outcomes, reading, strict=True):
        if isinstance(outcome, Failure):
            return []
        again = solve(site, every_step)
        compared = zip(scene.snapshots, outcome.snapshots, strict=True)
        if not all(_same(arrays, again.snapshots[step]) for step, arrays in compared):
            return []
        reread.append(replace(outcome, lists=again.lists))
    return reread


def _same(arrays: dict[str, Array], others: dict[str, Array]) -> bool:
    """Return whether the particles of two runs, on which the lists depend, are in the same places."""
    return all(arrays[name].tobytes() == others[name].tobytes() for name in ("id", "x"))


def discard(kept: Kept) -> None:
    """Delete the files of the answers of a judged case."""
    for each in kept:
        if isinstance(each, KeptAnswer):
            each.forget()
