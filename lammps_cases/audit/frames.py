"""A snapshot of a dump as a sample: the state that the forces saw, and what the columns themselves say.

A dump is written at the end of a step, half a step after the forces: velocities have moved on by half a step of f/m,
densities of fluid by half a step of the rate of the continuity equation, energies by half a step of the heat flow. All
are taken back with the columns of the dump, so that nothing is compared that it does not hold. Positions and phases are
those of the forces; the pressure and the total stress are those of the densities and energies of the dump itself. On
the set-up of a run nothing has moved on.
"""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.pairs import directed_pairs
from eos_ref.model.parameters import Model
from eos_ref.model.quantities import dependencies
from eos_ref.model.state import Gradients, State
from eos_ref.numbers.elementary import where
from eos_ref.numbers.rounded import Rounded, error, value
from lammps_cases.audit.evaluation import ParticleSample, SampleEvaluation
from lammps_cases.audit.fields import needs

NAMED = {
    "x": "columns x y z",
    "v": "columns vx vy vz",
    "f": "columns fx fy fz",
    "mass": "a column mass",
    "drho": "a column of drho (compute property/atom)",
}
OF_GRADIENT = ("viscosity", "stress/v", "stress/t")  # follow from the velocity gradient, particle by particle


def by_columns(name: str, held: Container[str]) -> bool:
    """Return whether a field follows from other columns of the same particle."""
    return name == "pressure" or (name in OF_GRADIENT and "grad/v" in held)


class _Printed(ArrayEvaluator):
    """Pairs of positions known to some digits: all that may be within the cutoff; beyond it their kernel is 0."""

    spread = 0.0

    def pairs(self, x_nc: FloatArray, cut: float) -> Any:
        """Return the directed pairs that may be closer than a cutoff."""
        return directed_pairs(x_nc, self.box, cut + self.spread)


@dataclass(frozen=True)
class FrameSample(ParticleSample):
    """A snapshot.

    Attributes
    ----------
    of_forces : the state that the forces saw, with the errors of the printed digits
    at_end : densities and energies of the dump, as far as it has them
    gradient_ncc : its velocity gradients, if it has them
    """

    of_forces: State | None = None
    at_end: Mapping[str, Rounded] = field(default_factory=dict)
    gradient_ncc: Rounded | None = None

    def rounded(self) -> State:
        """Return the state that the forces saw."""
        assert self.of_forces is not None
        return replace(self.of_forces)


class FrameEvaluation(SampleEvaluation):
    """What follows from a snapshot."""

    sample: FrameSample

    def __init__(
        self, sample: FrameSample, fields: Sequence[str], stages: type[ArrayEvaluator] = ArrayEvaluator
    ) -> None:
        held = () if sample.gradient_ncc is None else ("grad/v",)
        self.by_columns = {name for name in fields if by_columns(name, held)}
        of_state = [name for name in fields if name not in self.by_columns]
        spread = 2 * float(np.sqrt(sample.model.dimension) * error(sample.rounded().x_nc).max(initial=0.0))
        printed = type("Printed", (_Printed,), {"spread": spread, "by_rows": False})
        together = printed if stages is ArrayEvaluator else type("Printed", (printed, stages), {})
        super().__init__(sample, of_state, together if spread else stages)
        now = self.simulation.state
        now.rho_n, now.energy_n = (sample.at_end.get(name, old) for name, old in
                                   (("rho", now.rho_n), ("energy", now.energy_n)))  # fmt: skip
        if sample.gradient_ncc is not None:
            self.simulation.gradient = Gradients(v_ncc=sample.gradient_ncc)
            self.simulation.fields["viscosity"] = self.stages.viscosity(sample.gradient_ncc)

    def comparable(self, field: str) -> Any:
        """Return the particles for which a field can be compared, (n,): those that the digits do not leave open."""
        n = len(self.sample.state.solid_n)
        may_n = np.ones(n, bool) if field in self.by_columns else super().comparable(field)
        return may_n & np.isfinite(error(self.output(field)).reshape(n, -1)).all(axis=1) if may_n.any() else may_n


def lacking(name: str, model: Model, held: Container[str], set_up: bool, whole: str) -> str:
    """Return what is missing to check a field of a snapshot that holds some quantities; nothing if it can be."""
    wanted = _at_end(name, model)
    if not by_columns(name, held) and needs(name, "pairs", model):
        if whole:
            return f"{whole}, and sums need the neighbours"
        wanted += ["x", *_of_forces(name, model, set_up)]
    if name == "temperature":
        wanted += ["energy", *([] if set_up else ["heatflow"])]
    missing = [NAMED.get(each, each) for each in dict.fromkeys(wanted) if each not in held]
    if not missing:
        return ""
    back = "" if set_up or not _moved(name, model) else ", as the forces saw the state half a step before the dump"
    return f"the dump lacks {', '.join(missing)}{back}"


def _at_end(name: str, model: Model) -> list[str]:
    if name not in ("pressure", "stress/t"):
        return []
    return ["rho", *(["energy", "mass"] if model.eos.needs_energy else [])]


def _of_forces(name: str, model: Model, set_up: bool) -> list[str]:
    """Return what gives the densities, velocities and energies that a field's sums take."""
    quantities = dependencies(model, name)
    wanted = ["mass"]
    if "rho" in quantities and name != "rho":
        wanted += ["rho"]
        if not (set_up or model.fix.rho_sum):
            wanted += ["grad/v", *(["drho"] if model.pair.rho_damp else [])]
    if "v" in quantities:
        wanted += ["v", *([] if set_up else ["f"])]
    if "temperature" in quantities or ("f" in quantities and model.eos.needs_energy):
        wanted += ["energy", *([] if set_up else ["heatflow"])]
    return wanted


def _moved(name: str, model: Model) -> bool:
    return set(_of_forces(name, model, False)) != set(_of_forces(name, model, True))


def state_of_forces(
    held: Mapping[str, Rounded], model: Model, type_n: Any, solid_n: Any, dt: float, set_up: bool
) -> State:
    r"""Return the state that the forces saw; parts that do not follow from what is held are 0.

    :math:`\mathbf v-\frac{\Delta t}2\mathbf f/m`, of fluid :math:`\rho` from
    :math:`\rho+\frac{\Delta t}2(D-\rho\nabla\cdot\mathbf v)` with the diffusion D, and the energy less half a step
    of the heat flow.
    """
    n, d, half = len(type_n), model.dimension, 0.0 if set_up else 0.5 * dt
    none_n = Rounded(np.zeros(n))
    v_nc, rho_n = held.get("v", Rounded(np.zeros((n, d)))), held.get("rho", none_n)
    energy_n = held.get("energy", none_n) if model.thermal is not None else None
    if half and "f" in held and "mass" in held:
        v_nc = v_nc - half * (held["f"] / held["mass"][:, None])
    if half and not model.fix.rho_sum and "grad/v" in held:
        gradient_ncc = held["grad/v"]
        trace_n = gradient_ncc[:, 0, 0]
        for a in range(1, d):
            trace_n = trace_n + gradient_ncc[:, a, a]
        diffusion_n = held.get("drho", none_n) if model.pair.rho_damp else none_n
        rho_n = where(solid_n, rho_n, (rho_n - half * diffusion_n) / (1.0 - half * trace_n))
    if half and energy_n is not None and "heatflow" in held:
        energy_n = energy_n - half * held["heatflow"]
    return State(held.get("x", Rounded(np.zeros((n, d)))), v_nc, rho_n, type_n, solid_n, energy_n)


def plain(state: State) -> State:
    """Return a state without errors."""
    energy_n = None if state.energy_n is None else value(state.energy_n)
    return State(value(state.x_nc), value(state.v_nc), value(state.rho_n), state.type_n, state.solid_n, energy_n)
