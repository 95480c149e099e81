"""Rules of fields: one that is compared is worth it only where its values differ from 0, and from each other."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from eos_ref.model.quantities import QUANTITIES
from lammps_cases.scene.rules.rule import Evaluated, Rule

PER_TYPE = ("conductivity", "cv")  # constants of a type
OF_ALL = ("virial", "press")  # particles have one together
NOT_SHOWN = ("pairs", "kernel", "correction", "grad/rho", "grad/energy")  # by LAMMPS


def _shown(name: str) -> Callable[[Evaluated], Any]:
    """Return the particles whose values of a compared field are not 0; none if all have the same."""

    def which(at: Evaluated) -> Any:
        n = at.evaluator.n
        if name not in at.compared:
            return np.zeros(n, bool)
        rows = np.asarray(at.sim.output(name), float).reshape(n, -1)
        constant = name not in (*PER_TYPE, *OF_ALL) and n > 1 and bool((rows == rows[0]).all())
        return rows.any(axis=1) & (not constant)

    return which


RULES = tuple(
    Rule(
        f"field/{name}",
        f"The {quantity.about} are compared, and are neither 0 everywhere nor the same.",
        _shown(name),
    )
    for name, quantity in QUANTITIES.items()
    if name not in NOT_SHOWN
)
