"""Whether a scene loses its particles: what LAMMPS says then is that they are lost, not where they are."""

from __future__ import annotations

import numpy as np

from eos_ref.errors import InputError
from eos_ref.evaluation.time_step import Simulation
from eos_ref.numbers.number import Array
from lammps_cases.comparison.trajectory import visit
from lammps_cases.findings import LEDGER
from lammps_cases.findings.variants import combined
from lammps_cases.run.prepared_case import PreparedCase
from lammps_cases.verdict.model_cases import problem_of

BINS = 2**31 - 1


def loses(ready: PreparedCase, engine: str = "") -> bool:
    """Return whether particles leave the box, or are nowhere.

    By the reference, with the findings that the engine has, if one is named, and that need none of its numbers. They
    leave it through faces that are not periodic; through periodic ones where a step takes them further than to the next
    image; and with faces that follow them (shrink-wrapped) where the box has more bins than LAMMPS can count.
    """
    scene = ready.case.scene
    if scene.evolve is None:
        return False
    problem = problem_of(scene, ready.atoms, ready.case.where, tuple(range(scene.evolve.steps + 1)))
    variants = [entry.model_variant for entry in LEDGER if engine and entry.model_variant and entry.listed(engine)]
    known = [one for one in variants if not (one.fit or one.undefined) and one.applies(problem)]
    stages, stepping = combined(known, problem, {}) or (None, Simulation)
    assert stages is not None
    sim = problem.simulation(stages, stepping)
    before_nc, wrapped = sim.state.x_nc, scene.engine.boundary != "f"
    try:
        with np.errstate(all="ignore"):
            for _ in visit(sim, problem.steps, problem.timestep, problem.stops):
                if _outside(sim, before_nc, wrapped):
                    return True
                before_nc = sim.state.x_nc
    except InputError:  # positions that are not finite
        return True
    return False


def _outside(sim: Simulation, before_nc: Array, wrapped: bool) -> bool:
    x_nc, box = sim.state.x_nc, sim.box
    around_c, edge_c = np.array(box.periodic), np.array(box.edge_c)
    moved_nc = box.upright(x_nc - before_nc) if box.tilted else x_nc - before_nc
    if not np.isfinite(x_nc).all() or (np.abs(moved_nc) > edge_c)[:, around_c].any():
        return True
    if wrapped:  # bins of half a cutoff, in which neighbours are sought
        size_c = np.where(around_c, edge_c, np.ptp(x_nc, axis=0))
        return bool(np.prod(np.maximum(size_c / (sim.model.cut / 2), 1.0)) > BINS)
    return bool(((x_nc < box.low_c) | (x_nc > box.high_c))[:, ~around_c].any())
