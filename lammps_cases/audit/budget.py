r"""What becomes of mass, momentum and energy in one sample: the sums that each part of the model adds to them.

A fluid without heat has the kinetic energy :math:`K=\frac12\sum_im_iv_i^2` and that of its compression, whose rate is
:math:`\dot U=\sum_im_iP_i\dot\rho_i/\rho_i^2`. With the quintic kernel the forces of a pair are opposite, and what
pressure takes from K it gives to U: both sums are 0 but for rounding. Reproducing kernels, walls and shifts keep
neither; viscosity, artificial viscosity and density diffusion take energy away.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.model.quantities import needed_to_step
from eos_ref.numbers.columns import axes, dot, matrix, summed
from eos_ref.numbers.elementary import where
from eos_ref.numbers.number import Array
from eos_ref.numbers.rounded import error, value
from lammps_cases.audit.evaluation import ParticleSample, SampleEvaluation, acted_on
from lammps_cases.findings import Finding
from lammps_cases.records.case_parts import BudgetPart, BudgetRecord


def budget(
    sample: ParticleSample,
    force_nc: Array,
    run: int,
    step: int,
    half_step: float,
    entries: Sequence[Finding] = (),
    of_press: Sequence[str] = (),
) -> BudgetRecord:
    """Return what there is of mass, momentum and kinetic energy, and what each part of the model adds to them.

    Parameters
    ----------
    sample : ParticleSample
    force_nc : (n, d) array
        All forces, LAMMPS' own: they complete the velocities of a sample that are half a step behind.
    half_step : float
        Time by which the velocities are behind, 0 at the set-up of a run.
    entries : sequence of Finding
        Whose effect on the sums is asked for.
    of_press : sequence of str
        Findings that can change the pressure of the system.
    """
    mass_n, state = sample.mass_n, sample.state
    v_nc = state.v_nc + half_step * force_nc / mass_n[:, None]
    whole = Rates(sample)
    silent = replace(sample.model, pair=replace(sample.model.pair, artificial_viscosity=0.0))
    plain = Rates(replace(sample, model=silent)) if sample.model.pair.artificial_viscosity else whole
    pairs = whole.of_pairs("pairs")
    return BudgetRecord(
        run=run,
        step=step,
        mass=float(mass_n.sum()),
        volume=float((mass_n / state.rho_n).sum()),
        momentum=[float(of) for of in (mass_n[:, None] * v_nc).sum(axis=0)],
        kinetic=0.5 * float((mass_n[:, None] * v_nc**2).sum()),
        size=float(np.abs(value(whole.force_nc)).sum()),
        residual={name: _number(of) for name, of in whole.residuals(plain).items()},
        bound={name: float(error(of)[0]) for name, of in whole.residuals(plain).items()},
        parts=[part for part in _parts(whole, plain) if part is not None],
        pairs=pairs,
        press=None if half_step else _press(sample),
        press_findings=[] if half_step else list(of_press),
        findings=[
            Rates(sample, entry.model_variant.stages).of_pairs(entry.id)
            for entry in entries
            if entry.model_variant is not None and entry.model_variant.stages is not None
        ],
    )


def _press(sample: ParticleSample) -> float:
    """Return the pressure of the system, with its kinetic part, as pairs and velocities make it."""
    return _number(SampleEvaluation(replace(sample, actions=()), ("press",)).output("press"))


def _number(of: Array) -> float:
    """Return the sum that `summed` gives every particle."""
    return float(value(of)[0])


def _parts(whole: Rates, plain: Rates) -> list[BudgetPart | None]:
    """Return the parts that the model has."""
    model, thermal = whole.model, whole.model.thermal is not None
    viscous = plain.force_nc - plain.pressure_force_nc
    artificial = whole.pressure_force_nc - plain.pressure_force_nc
    return [
        plain.part("pressure", plain.pressure_force_nc, whole.compressed_n),
        plain.part("viscosity", viscous),
        whole.part("artificial viscosity", artificial) if model.pair.artificial_viscosity else None,
        whole.part("density diffusion", None, whole.diffused_n) if model.pair.rho_damp else None,
        whole.shifting() if model.fix.shift else None,
        BudgetPart(name="heat conduction", heat=_number(summed(whole.heat_n))) if thermal else None,
        whole.part("other fixes", whole.acted_nc - whole.force_nc) if whole.sample.actions else None,
    ]


@dataclass
class Rates:
    """The rates of change of one sample, by the reference or by a variant of it, with rounding bounds."""

    sample: ParticleSample
    stages: type[ArrayEvaluator] = ArrayEvaluator

    @cached_property
    def _own(self) -> SampleEvaluation:
        return SampleEvaluation(replace(self.sample, actions=()), needed_to_step(self.model), self.stages)

    @property
    def model(self) -> Any:
        """The model."""
        return self.sample.model

    @property
    def force_nc(self) -> Array:
        """Forces of pairs, (n, d)."""
        forces: Array = self._own.simulation.fields["f"]
        return forces

    @property
    def pressure_force_nc(self) -> Array:
        """Those of pressure and artificial viscosity, (n, d)."""
        forces: Any = self._own.simulation.pressure_force_nc  # None only where no forces are evaluated
        return forces  # type: ignore[no-any-return]

    @cached_property
    def acted_nc(self) -> Array:
        """Forces after those of other fixes, (n, d)."""
        forces: Array = acted_on(self.force_nc, self.sample.actions, self.sample.mass_n)
        return forces

    @property
    def heat_n(self) -> Array:
        """Heat that flows to each particle, (n,)."""
        heat_n: Array = self._own.simulation.fields["heatflow"]
        return heat_n

    @cached_property
    def _stored_n(self) -> Array:
        """Energy of compression per change of density, m P/rho^2, (n,); 0 for solids, which keep their densities."""
        rho_n, p_n = self._own.stages.given_n, self._own.simulation.fields["pressure_used"]
        stored_n: Array = where(self.sample.state.solid_n, 0.0, self.sample.mass_n * p_n / (rho_n * rho_n))
        return stored_n

    @cached_property
    def compressed_n(self) -> Array | None:
        """Rate of the energy of compression by the velocities, (n,); None if densities are sums."""
        if self.model.fix.rho_sum:
            return None
        rows = matrix(self._own.simulation.gradient.v_ncc)
        trace_n = sum((rows[a][a] for a in range(1, len(rows))), start=rows[0][0])
        rate_n: Array = -(self._stored_n * self._own.stages.given_n * trace_n)
        return rate_n

    @property
    def diffused_n(self) -> Array | None:
        """Rate of the energy of compression by density diffusion, (n,); None if densities are sums."""
        if self.model.fix.rho_sum:
            return None
        rate_n: Array = self._stored_n * self._own.simulation.fields["drho"]
        return rate_n

    def part(self, name: str, force_nc: Array | None, stored_n: Array | None = None) -> BudgetPart:
        """Return what forces and changes of density do."""
        force = [] if force_nc is None else [_number(summed(f_n)) for f_n in axes(force_nc)]
        power = 0.0 if force_nc is None else _number(self._power(force_nc))
        return BudgetPart(
            name=name, force=force, power=power, storage=0.0 if stored_n is None else _number(summed(stored_n))
        )

    def of_pairs(self, name: str) -> BudgetPart:
        """Return what all that pairs do adds up to."""
        rates_n = [of for of in (self.compressed_n, self.diffused_n) if of is not None]
        part = self.part(name, self.force_nc, sum(rates_n[1:], start=rates_n[0]) if rates_n else None)
        return part.model_copy(update={"heat": _number(summed(self.heat_n))}) if self.model.thermal else part

    def shifting(self) -> BudgetPart:
        """Return what the shifts add by taking velocities and densities along their gradients."""
        run = self._own.simulation
        fluid = ~self.sample.state.solid_n
        shift = [where(fluid, s_n, 0.0) for s_n in axes(run.fields["shift/v"])]
        moved = [self.sample.mass_n * dot(row, shift) for row in matrix(run.gradient.v_ncc)]
        stored = None if run.gradient.rho_nc is None else self._stored_n * dot(axes(run.gradient.rho_nc), shift)
        return BudgetPart(
            name="shifting",
            force=[_number(summed(of)) for of in moved],
            power=_number(summed(dot(moved, axes(self._own.simulation.state.v_nc)))),
            storage=0.0 if stored is None else _number(summed(stored)),
        )

    def residuals(self, plain: Rates) -> dict[str, Array]:
        """Return the sums that vanish where the formulas conserve, each in every element; the momentum's largest."""
        sums = [summed(f_n) for f_n in axes(self.force_nc)]
        sums_by_name: dict[str, Array] = {"momentum": max(sums, key=lambda of: abs(value(of)[0]))}
        if self.compressed_n is not None:
            sums_by_name["energy of pressure"] = plain._power(plain.pressure_force_nc) + summed(self.compressed_n)
        if self.model.thermal is not None:
            sums_by_name["heat"] = summed(self.heat_n)
        return sums_by_name

    def _power(self, force_nc: Array) -> Array:
        """Return the work of forces per time."""
        return summed(dot(axes(force_nc), axes(self._own.simulation.state.v_nc)))
