"""Small scenes of a few particles, for LAMMPS and for the reference."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from eos_ref.eos.bounds import EPS
from lammps_cases.claims.probes.probe import Input, edited
from lammps_cases.claims.probes.run import Reply, put
from lammps_cases.comparison.problem import Problem
from lammps_cases.comparison.trajectory import Prediction, predict
from lammps_cases.engine import installations
from lammps_cases.engine.session import Answer, Job
from lammps_cases.engine.workers import Workers
from lammps_cases.findings import finding
from lammps_cases.findings.variants import Snapshot, combined
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import Atoms
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan
from lammps_cases.verdict.case_arrays import read_snapshots
from lammps_cases.verdict.problems import problem_of

Floats = npt.NDArray[np.floating]


@dataclass(frozen=True)
class SmallScene:
    """A scene with explicit particles."""

    scene: Scene
    atoms: Atoms

    steps: tuple[int, ...] | None = None

    @property
    def problem(self) -> Problem:
        """The problem for the reference, at the steps that the scene compares or at other ones."""
        return problem_of(self.scene, self.atoms, "", self.scene.snapshots if self.steps is None else self.steps)

    @property
    def job(self) -> Job:
        """The job for LAMMPS."""
        return job(self.scene, self.atoms, plan(self.scene))

    def predicted(self, *findings: str, snapshot: Snapshot | None = None) -> Prediction:
        """The prediction of the reference, with the variants of some findings."""
        variants = [variant for name in findings if (variant := finding(name).model_variant)]
        made = combined(variants, self.problem, snapshot or {})
        assert made is not None and len(variants) == len(findings)
        stages, stepping = made
        return predict(self.problem, stages, stepping)


def small_scene(
    x: Any,
    box: Sequence[float],
    v: Any = None,
    rho: Any = 1.0,
    e: Any = None,
    kind: Any = 1,
    own: Any = None,
    **scene: Any,
) -> SmallScene:
    """A scene of particles at ``x``, of types ``kind`` or masses of their ``own``, in a box whose low corner is 0."""
    x_nd = np.asarray(x, float)
    n, d = x_nd.shape
    base = {
        "dimension": d,
        "types": [{"mass": 1.0}],
        "positions": {"lattice": "sq" if d == 2 else "sc", "spacing": 1.0, "cells": [1] * d},
        "pressure": [{"types": "*", "style": "linear"}],
        **({} if rho is None else {"rho": {"constant": 1.0}}),
        "compare": ["f"],
        "rheo": {},
        **({"energy": {"constant": 1.0}} if e is not None else {}),
        **({"mass": {"constant": 1.0}} if own is not None else {}),
    }
    merged = base | scene
    merged["rheo"] = {"cut": 3.0} | merged["rheo"]
    made = Scene.model_validate(merged)
    type_n = np.broadcast_to(np.asarray(kind, np.int32), n).copy()

    def three(values: Any, fill: float = 0.0) -> Floats:
        return np.column_stack([np.broadcast_to(values, (n, d)), np.full((n, 3 - d), fill)]).astype(float)

    half = 0.5 * made.positions.spacing
    low, high = np.zeros(3), np.array([*box, *[half] * (3 - d)], float)
    low[d:] = -half
    periodic = made.positions.periodic or (True,) * d
    of_type_n = np.array([t.mass for t in made.types])[type_n - 1]
    mass_n = of_type_n if own is None else np.broadcast_to(own, n).astype(float)
    energy_n = None if e is None else np.broadcast_to(e, n).astype(float)
    rho_n = None if rho is None else np.broadcast_to(rho, n).astype(float)
    v_nc = None if v is None else three(v)
    atoms = Atoms(
        np.arange(1, n + 1),
        type_n,
        three(x_nd),
        mass_n,
        low,
        high,
        (*periodic, *(True,) * (3 - d)),
        made.positions.spacing,
        v_nc,
        rho_n,
        energy_n,
        (*(made.positions.tilt or ()), 0.0, 0.0, 0.0)[:3],
    )
    return SmallScene(made, atoms)


class Engine:
    """A LAMMPS in a separate process."""

    def __init__(self, workers: Workers) -> None:
        self.workers = workers

    def answer(self, given: SmallScene | Job) -> Answer:
        """LAMMPS' answer to a scene."""
        what = given.job if isinstance(given, SmallScene) else given
        found = self.workers.outcome(self.workers.submit(what, 60.0))
        assert isinstance(found, Answer), found
        return found

    def fields(self, given: SmallScene, every_step: bool = False) -> list[Snapshot]:
        """LAMMPS' fields of a scene at the steps that are compared; at every step with the lists of neighbours."""
        if not every_step:
            return read_snapshots(given.scene, self.answer(given))
        asked = job(given.scene, given.atoms, plan(given.scene), every_step=True, lists=True)
        return read_snapshots(given.scene, self.answer(asked))

    def replies(self, *inputs: Input) -> list[Reply]:
        """LAMMPS' replies to decks."""
        return list(put(self.workers, inputs, 60.0))

    def reply(self, base: str, *edits: tuple[str, str]) -> Reply:
        """LAMMPS' reply to an edited base deck of the probes."""
        return self.replies(edited(base, edits))[0]


@contextmanager
def engine(name: str = "env") -> Iterator[Engine]:
    """Open a LAMMPS by its name."""
    with Workers(installations.resolve(name).site, 1) as workers:
        yield Engine(workers)


def agree(found: Any, prediction: Prediction, field: str, at: int = 0) -> bool:
    """Whether a field of LAMMPS lies within the bound of a prediction on every atom."""
    return bool(np.all(np.abs(found - prediction.fields[at][field]) <= prediction.bounds[at][field]))


def is_multiple(found: Any, factor: Any, right: Prediction, wrong: Prediction, field: str, roundings: int = 4) -> bool:
    """Whether a field of LAMMPS is a prediction times a factor.

    Within the bound of the prediction that LAMMPS follows, that of the other times the factor, and the roundings of
    the factor and the product.
    """
    expected = factor * right.fields[0][field]
    bound = wrong.bounds[0][field] + np.abs(factor) * right.bounds[0][field] + roundings * EPS * np.abs(expected)
    return bool(np.all(np.abs(found - expected) <= bound)) and bool(np.any(expected))
