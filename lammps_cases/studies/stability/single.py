"""The reference in float32: the same stages, of arrays half as long."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from eos_ref.numbers.rounded import value
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import Atoms
from lammps_cases.setup import reference_side


class Single(ArrayEvaluator):
    """Stages in float32. Pairs are found, and positions subtracted, in float64; the results are rounded."""

    def of_type(self, values_t: Iterable[Any]) -> Any:
        """See `Evaluator.of_type`."""
        return super().of_type(values_t).astype(np.float32)

    def move(self, x_nc: Any) -> None:
        """See `ArrayEvaluator.move`."""
        super().move(x_nc)
        self.x = [value(x_p).astype(np.float32) for x_p in self.x]
        self.rr, self.r, self.w = (value(array).astype(np.float32) for array in (self.rr, self.r, self.w))
        self.gradw = [value(g_p).astype(np.float32) for g_p in self.gradw]
        self.g = self.gradw

    def eos_pressure(self, rho_n: Any, e_n: Any) -> Any:
        """See `Evaluator.eos_pressure`; the laws in the number type of the density."""
        pressure_n = np.empty_like(rho_n)
        for t, law in enumerate(self.model.eos, 1):
            mine = self.type_n == t
            pressure_n[mine] = law.evaluate(rho_n[mine], None if e_n is None else e_n[mine])
        return pressure_n

    def diffusion(self, *fields: Any) -> Any:
        """See `ArrayEvaluator.diffusion`."""
        return value(super().diffusion(*fields)).astype(np.float32)


def simulation(scene: Scene, atoms: Atoms, fields: Iterable[str] = (), where: str = "") -> Simulation:
    """Return the reference of a scene whose particles are given in float32."""
    sim = reference_side.simulation(scene, atoms, fields, where, Single)
    sim.mass_n, sim.other_nc = sim.mass_n.astype(np.float32), sim.other_nc.astype(np.float32)
    return sim
