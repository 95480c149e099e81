"""Whether the state of a deck is that of a fluid: numbers that are not finite, particles that run away or are lost."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from eos_ref.model.parameters import Model
from eos_ref.model.state import State
from lammps_cases.comparison.compare import components
from lammps_cases.records.audit_record import BreakRecord, LostRecord
from lammps_cases.verdict.runaway import RUNAWAY, fastest

Array = npt.NDArray[Any]
_LOST = re.compile(r"Lost atoms: original (\d+) current (\d+)")


def mach(model: Model, state: State) -> float:
    """Return the largest component of a velocity over the speed of sound; infinite where numbers are not finite."""
    if not all(np.isfinite(of).all() for of in (state.x_nc, state.v_nc, state.rho_n)):
        return np.inf
    at_rest = replace(state, v_nc=np.zeros(state.v_nc.shape))
    return float(np.abs(state.v_nc).max(initial=0.0)) / fastest(model, at_rest)


@dataclass
class Health:
    """The first sample in which the state of a deck is not that of a fluid, and the particles that it has lost."""

    broke: BreakRecord | None = None
    lost: LostRecord | None = None
    broke_off: int | None = None  # step at which LAMMPS ended a run
    ignores: bool = False  # whether LAMMPS goes on when particles are lost
    changes: bool = False  # whether fixes add or remove particles
    _count: int = 0  # particles at the beginning of the run
    _energy: float = 0.0  # largest at the beginning of the run
    _density: float = 0.0  # the same over the equilibrium density

    def note(self, values: list[str]) -> None:
        """Take a command that LAMMPS has executed."""
        if values[0] == "thermo_modify" and "lost" in values[:-1]:
            self.ignores = values[values.index("lost") + 1] != "error"
        if values[0] == "fix" and values[3].startswith(("evaporate", "deposit", "pour")):
            self.changes = True

    def begin(self, natoms: int) -> None:
        """Take the number of particles with which a run begins."""
        self._count = natoms

    def state(self, run: int, step: int, id_n: Array, columns: Mapping[str, Array], first: bool) -> bool:
        """Take the state of a sample as LAMMPS has it, by column; return whether all its numbers are finite.

        That of the ``first`` sample of a run is given to the run.
        """
        lost = 0 if self.changes else self._count - len(id_n)
        if lost > (self.lost.lost if self.lost else 0):
            self.lost = LostRecord(lost=lost, of=self._count, run=run, step=step, ignored=self.ignores)
        return self._all_finite(run, step, id_n, columns, given=first)

    def fields(
        self, run: int, step: int, id_n: Array, lammps: Mapping[str, Array], reference: Mapping[str, Array]
    ) -> None:
        """Take the fields of a sample on both sides."""
        for name, values_n in lammps.items():
            both = name in reference and not np.isfinite(reference[name]).all()
            self._all_finite(run, step, id_n, {name: values_n}, both)

    def fluid(self, run: int, step: int, id_n: Array, model: Model, state: State, heated: bool, first: bool) -> None:
        """Take a sample whose numbers are finite; ``heated``: whether something else adds to energies."""
        rho0_n = model.rho0[state.type_n - 1]
        gas_n = np.array([law.needs_energy for law in model.eos.laws])[state.type_n - 1]
        density_n = np.where(state.solid_n | gas_n, 1.0, state.rho_n / rho0_n)
        energy_n = np.zeros(len(id_n)) if state.energy_n is None else np.abs(state.energy_n)
        if first:
            self._density, self._energy = float(np.abs(density_n).max(initial=1.0)), float(energy_n.max(initial=0.0))
        speed_n = np.abs(state.v_nc).max(axis=1, initial=0.0)
        at_rest = replace(state, v_nc=np.zeros(state.v_nc.shape))
        self._runs_away(run, step, id_n, "v", speed_n, speed_n > RUNAWAY * fastest(model, at_rest))
        beyond_n = (density_n > RUNAWAY * self._density) | ((density_n <= 0) & (not first))
        self._runs_away(run, step, id_n, "rho", state.rho_n, beyond_n)
        if self._energy and not heated and not self.changes:
            self._runs_away(run, step, id_n, "energy", energy_n, energy_n > RUNAWAY * self._energy)

    def ended(self, error: str, run: int, step: int) -> None:
        """Take the error with which LAMMPS ended a run."""
        self.broke_off = step
        if match := _LOST.search(error):
            of, left = int(match[1]), int(match[2])
            self.lost = LostRecord(lost=of - left, of=of, run=run, step=step, ignored=False)

    def _all_finite(
        self, run: int, step: int, id_n: Array, columns: Mapping[str, Array], both: bool = False, given: bool = False
    ) -> bool:
        for name, values in columns.items():
            wrong_nk = ~np.isfinite(components(np.asarray(values, float)))
            if not wrong_nk.any():
                continue
            if self.broke is None:
                rows = np.flatnonzero(wrong_nk.any(axis=1))
                row = rows[np.argmin(id_n[rows])]
                component = int(np.argmax(wrong_nk[row]))
                self.broke = BreakRecord(
                    kind="not a number", run=run, step=step, column=component_name(name, values.shape[1:], component),
                    atom=int(id_n[row]), value=float(components(values)[row, component]),
                    particles=len(rows), of=len(id_n), both=both, given=given,
                )  # fmt: skip
            return False
        return True

    def _runs_away(self, run: int, step: int, id_n: Array, column: str, values_n: Array, beyond_n: Array) -> None:
        if self.broke is not None or not beyond_n.any():
            return
        row = int(np.argmax(np.where(beyond_n, np.abs(values_n), -1.0)))
        self.broke = BreakRecord(
            kind="runaway", run=run, step=step, column=column, atom=int(id_n[row]), value=float(values_n[row]),
            particles=int(beyond_n.sum()), of=len(id_n), both=False,
        )  # fmt: skip


def component_name(field: str, shape: tuple[int, ...], component: int) -> str:
    """Return LAMMPS' name of a component of a field: vx of v, fx of f, grad/v/xy of grad/v."""
    axes = ["xyz"[k] for k in np.unravel_index(component, shape)] if shape else []
    if field == "x":
        return axes[0]
    return "".join([field, "/" if "/" in field and axes else "", *axes])
