"""Handmade answers, as if LAMMPS were the reference."""

from __future__ import annotations

from typing import Any

import numpy as np

from lammps_cases.comparison.predictor import Predictor
from lammps_cases.engine.interlude import Carried
from lammps_cases.engine.session import Answer
from lammps_cases.findings import LEDGER
from lammps_cases.findings.variants import combined
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import Atoms
from lammps_cases.scene.fields import FIELDS
from lammps_cases.verdict.problems import problem_of

SECONDS = 0.5
PREDICTOR = Predictor()  # each answer is computed once


def given(atoms: Atoms) -> dict[str, Any]:
    """The arrays given to LAMMPS."""
    arrays: dict[str, Any] = {"id": atoms.id_n, "type": atoms.type_n, "x": atoms.x_nc, "rho": atoms.rho_n}
    arrays["v"] = np.zeros((len(atoms), 3)) if atoms.v_nc is None else atoms.v_nc
    return arrays if atoms.energy_n is None else arrays | {"esph": atoms.energy_n}


def of_model(scene: Scene, atoms: Atoms, *findings: str, carries: float = 1.0) -> Answer:
    """The fields of a scene from a LAMMPS with some findings; densities are multiplied by a number at every stop."""
    problem = problem_of(scene, atoms, "", scene.snapshots)
    variants = [entry.model_variant for entry in LEDGER if entry.model_variant and entry.id in findings]
    made = combined(variants, problem, {})
    assert made is not None and len(variants) == len(findings)
    snapshots = [
        given(atoms) | {FIELDS[name].key: _placed(name, np.asarray(array)) for name, array in fields.items()}
        for fields in PREDICTOR.values(problem, made)
    ]
    one_n = np.ones(len(atoms))
    carried = (Carried({"rho": one_n}, {"rho": one_n * carries}),) * len(problem.stops)
    return Answer(snapshots[-1], SECONDS, tuple(snapshots), scene.counts, carried=carried)


def _placed(name: str, array: Any) -> Any:
    return FIELDS[name].placed(array, np.zeros((len(array), *FIELDS[name].shape(3))))
