r"""Mass, momentum and energy of a sample, what each part of the model adds to them, and what that shows of a deck.

A fluid without heat has the kinetic energy :math:`K=\frac12\sum_im_iv_i^2` and that of its compression, whose rate is
:math:`\dot U=\sum_im_iP_i\dot\rho_i/\rho_i^2`. With the quintic kernel the forces of a pair are opposite, and what
pressure takes from K it gives to U: both sums are 0 up to rounding. Reproducing kernels, walls and shifts keep
neither; viscosity, artificial viscosity and density diffusion take energy away.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
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
from lammps_cases.audit.rerun import AS_IT_IS, deviation
from lammps_cases.findings import Finding
from lammps_cases.records.case_parts import BudgetPart, BudgetRecord, ClosedRecord, SeriesRecord
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.records.wording import number

LAMMPS = "LAMMPS"


def budget(
    sample: ParticleSample,
    force_nc: Array,
    run: int,
    step: int,
    half_step: float,
    entries: Sequence[Finding] = (),
    of_press: Sequence[str] = (),
) -> BudgetRecord:
    """Return mass, momentum and kinetic energy, and what each part of the model adds to them.

    Parameters
    ----------
    sample : ParticleSample
    force_nc : (n, d) array
        All forces, LAMMPS' own: they complete the velocities of a sample that are half a step behind.
    half_step : float
        Time by which the velocities are behind, 0 at the set-up of a run.
    entries : sequence of Finding
        Findings whose effect on the sums is wanted.
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
        press=None if half_step else _number(SampleEvaluation(replace(sample, actions=()), ("press",)).output("press")),
        press_findings=[] if half_step else list(of_press),
        findings=[
            Rates(sample, entry.model_variant.stages).of_pairs(entry.id)
            for entry in entries
            if entry.model_variant is not None and entry.model_variant.stages is not None
        ],
    )


def _number(of: Array) -> float:
    """Return the sum that `summed` gives every particle."""
    return float(value(of)[0])


def _parts(whole: Rates, plain: Rates) -> list[BudgetPart | None]:
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
        """Forces of pressure and artificial viscosity, (n, d)."""
        forces: Any = self._own.simulation.pressure_force_nc  # None only where no forces are evaluated
        return forces  # type: ignore[no-any-return]

    @cached_property
    def acted_nc(self) -> Array:
        """Forces after other fixes have acted, (n, d)."""
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
        """Return the total of all that pairs do."""
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
        return summed(dot(axes(force_nc), axes(self._own.simulation.state.v_nc)))


@dataclass(frozen=True)
class Conserved:
    """A sum that is 0 where the formulas conserve a quantity, in the sample in which it is largest.

    Attributes
    ----------
    quantity : its name
    kept : whether rounding alone makes it in every sample
    share : the sum over that of its absolute terms, by the formulas
    broken_by : findings that change it, with the share by which
    """

    quantity: str
    kept: bool
    share: float
    broken_by: dict[str, float]


@dataclass(frozen=True)
class Part:
    """What one change of the reference does to the deviation from a closed solution, all at one step.

    ``deviation`` is that of the run, ``contribution`` what the change adds to it; None if the run broke off.
    """

    name: str
    step: int
    deviation: float | None
    contribution: float | None
    ended: str


def conserved(budgets: Sequence[BudgetRecord]) -> Iterator[Conserved]:
    """Yield what the formulas may conserve."""
    for quantity in budgets[0].residual if budgets else ():
        shares = [_share(abs(of.residual[quantity]), _size(of, quantity)) for of in budgets]
        kept = all(abs(of.residual[quantity]) <= of.bound[quantity] for of in budgets)
        broken: dict[str, float] = {}
        for of in budgets:
            for finding in of.findings:
                change = _share(_change(of, finding, quantity), _size(of, quantity))
                if _change(of, finding, quantity) > of.bound[quantity]:
                    broken[finding.name] = max(change, broken.get(finding.name, 0.0))
        yield Conserved(quantity, kept, max(shares), broken)


def _share(of: float, size: float) -> float:
    return of / size if size else 0.0


def _size(of: BudgetRecord, quantity: str) -> float:
    """Return the scale of a sum: the forces of pairs, or the powers of the parts."""
    if quantity == "momentum":
        return of.size
    return sum(abs(part.power) + abs(part.storage) + abs(part.heat) for part in of.parts)


def _change(of: BudgetRecord, finding: BudgetPart, quantity: str) -> float:
    if quantity == "momentum":
        return max((abs(a - b) for a, b in zip(finding.force, of.pairs.force, strict=True)), default=0.0)
    if quantity == "heat":
        return abs(finding.heat - of.pairs.heat)
    return abs(finding.power + finding.storage - of.pairs.power - of.pairs.storage)


def measured(case: CaseRecord) -> SeriesRecord:
    """Return LAMMPS' own run as a series: its samples of the last run."""
    own = [of for of in case.budgets if of.run == case.budgets[-1].run]
    return SeriesRecord(
        name=LAMMPS,
        steps=[of.step - own[0].step for of in own],
        kinetic=[of.kinetic for of in own],
        momentum=[of.momentum for of in own],
    )


def parts(case: CaseRecord) -> list[Part]:
    """Return the deviation of every run from the closed solution, LAMMPS' own first; empty without one."""
    exact = case.closed
    if exact is None or not case.series:
        return []
    right = next(series for series in case.series if series.name == AS_IT_IS)
    deviations = []
    for series in [measured(case), *case.series]:
        own = deviation(exact, series)
        at = max((step for step in series.steps if step in exact.steps), default=0)
        reference = deviation(exact, right, at) if at else None
        away = None if own is None or reference is None or series is right or series.name == LAMMPS else reference - own
        if away is not None and series.findings:  # which such a run has, but not the unchanged reference
            away = -away
        deviations.append(Part(series.name, at, own, away, series.ended))
    return deviations


def log_deviation(exact: ClosedRecord | None, columns: Mapping[str, Sequence[float]]) -> tuple[int, float] | None:
    """Return last step and deviation of a decay by the thermo output of a log; None for any other flow."""
    energy, steps = columns.get("KinEng", []), columns.get("Step", [])
    if exact is None or not exact.decays or not energy or not all(of > 0 for of in energy[:: len(energy) - 1 or 1]):
        return None
    rate = math.log(exact.values[-1] / exact.values[0]) / (exact.steps[-1] - exact.steps[0])
    return int(steps[-1]), math.log(energy[-1] / energy[0]) / (steps[-1] - steps[0]) / rate - 1


def dissipated(budgets: Sequence[BudgetRecord]) -> dict[str, float]:
    """Return what each part of the model does to the energy on average over the samples, by name."""
    totals: dict[str, float] = {}
    for of in budgets:
        for part in of.parts:
            totals[part.name] = totals.get(part.name, 0.0) + (part.power + part.storage) / len(budgets)
    return totals


def percent(of: float | None) -> str:
    """Format a relative difference, without a sign if it rounds to 0; empty for None."""
    if of is None:
        return ""
    rounded = round(100 * of, 2)
    return f"{rounded:+.2f} %".replace("-", "\N{MINUS SIGN}") if rounded else "0.00 %"


def lines(case: CaseRecord) -> Iterator[str]:
    """Yield in words what is conserved, and what makes up the difference to the closed solution."""
    for of in conserved(case.budgets):
        lost = f"not conserved by the formulas, {number(of.share, 2)} of its terms remain"
        broken = "".join(f"; {name} changes it by {number(by, 2)} of its terms" for name, by in of.broken_by.items())
        yield f"{of.quantity}: {'conserved up to rounding' if of.kept else lost}{broken}"
    if case.closed is not None:
        yield f"closed solution of the {case.closed.quantity}: {case.closed.flow}, {case.closed.about}"
    for part in parts(case):
        adds = f", so that this adds {percent(part.contribution)}" if part.contribution is not None else ""
        away = percent(part.deviation) if part.deviation is not None else part.ended
        who = part.name if part.name == LAMMPS else f"reference, {part.name}"
        yield f"{who}: {away} at step {part.step}{adds}"
