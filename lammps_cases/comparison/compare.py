"""Comparison of a field of LAMMPS with the reference: verdict, blame, digits lost."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from eos_ref import EOSTable
from eos_ref.eos import bounds, lammps_rounding, rigorous
from eos_ref.eos.table import FloatArray
from lammps_cases.records.case_parts import DigitsLost, FieldRecord, Verdict, digest

IntArray = npt.NDArray[np.integer]
CERTIFIED = 24  # atoms per field whose error is certified with Arb: the worst by an extended-precision screening


@dataclass(frozen=True)
class EosState:
    """Per-atom state on which the equation of state acts, sorted by id, as LAMMPS holds it.

    ``energy_n`` is the energy of the whole particle (LAMMPS' esph), ``mass_n`` its mass; e = energy/mass.
    """

    id_n: IntArray
    type_n: IntArray
    rho_n: FloatArray
    mass_n: FloatArray
    energy_n: FloatArray | None = None

    @property
    def e_n(self) -> FloatArray | None:
        """Return the internal energy per unit mass."""
        return None if self.energy_n is None else self.energy_n / self.mass_n


def evaluate(table: EOSTable, state: EosState, number: type[np.floating[Any]] = np.float64) -> npt.NDArray[Any]:
    """Evaluate the reference's law of every particle, shape (n,), in a floating type.

    By the law's own formula in numpy (`eos_ref.EOS.evaluate`): loading the compiled loops takes longer than
    evaluating the law for any scene.
    """
    p_n = np.empty(state.rho_n.shape, number)
    rho_n, e_n = state.rho_n.astype(number), state.e_n
    with np.errstate(all="ignore"):
        for t, law in enumerate(table.laws, 1):
            of_type = state.type_n == t
            rho, e = rho_n[of_type], None if e_n is None else e_n[of_type]
            if rho.size:
                p_n[of_type] = law.evaluate(rho, e)
    return p_n


@dataclass(frozen=True)
class Comparison:
    """A field of both sides with its bound, and the verdict."""

    record: FieldRecord
    lammps_n: FloatArray
    reference_n: FloatArray
    bound_n: FloatArray


def same_bits(a: FloatArray, b: FloatArray) -> bool:
    """Return whether all values agree in every bit; NaN is never the same as anything."""
    return bool(np.all(a == b)) and bool(np.all(np.signbit(a) == np.signbit(b)))


def excess(lammps_n: FloatArray, reference_n: FloatArray, bound_n: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the absolute difference and its ratio to the bound; both infinite where a side is not a finite number."""
    with np.errstate(all="ignore"):
        difference = np.abs(np.subtract(lammps_n, reference_n, dtype=float))  # counts and types too
        difference[~(np.isfinite(lammps_n) & np.isfinite(reference_n))] = np.inf
        ratio = difference / bound_n
        ratio[difference == 0] = 0.0
        ratio[~np.isfinite(bound_n) | np.isinf(difference)] = np.inf
    return difference, ratio


def worst_component(values_n: FloatArray, ratio_n: FloatArray) -> FloatArray:
    """Return the value of every particle's component of the largest ratio."""
    picked: FloatArray = components(values_n)[np.arange(len(values_n)), components(ratio_n).argmax(axis=1)]
    return picked


def components(values_n: FloatArray) -> FloatArray:
    """Return the components of every particle in one row, also of no particles."""
    return values_n.reshape(len(values_n), math.prod(values_n.shape[1:]))


def compare_field(
    field: str,
    stage: str,
    id_n: IntArray,
    lammps_n: FloatArray,
    reference_n: FloatArray,
    bound_n: FloatArray,
    same_order_n: FloatArray | None = None,
    derivation: str = "",
) -> Comparison:
    """Judge one field: `exact`, `pass` or `differs` (a ledger may turn the last into `explained`).

    Parameters
    ----------
    lammps_n, reference_n, bound_n : (n, ...) arrays sorted by id
        The two sides and the largest difference that rounding can make; of vectors and tensors the component
        closest to its bound represents the particle.
    same_order_n : (n,) array, optional
        The reference in LAMMPS' order of operations; equal bits to either one make the field `exact`.
    """
    lammps_n, reference_n = np.asarray(lammps_n, float), np.asarray(reference_n, float)
    difference, ratio = excess(lammps_n, reference_n, bound_n)
    bound = worst_component(bound_n, ratio)
    difference, ratio = (components(side).max(axis=1) for side in (difference, ratio))
    outside = ~(ratio <= 1)
    verdict: Verdict = "pass"
    if outside.any() or not ratio.size:  # LAMMPS' order of operations explains only what the bound allows
        verdict = "differs"
    elif same_bits(lammps_n, reference_n) or (same_order_n is not None and same_bits(lammps_n, same_order_n)):
        verdict = "exact"
    at = int(np.argmax(ratio)) if ratio.size else None
    record = FieldRecord(
        field=field,
        stage=stage,
        verdict=verdict,
        max_abs=float(difference.max(initial=0.0)),
        max_over_bound=float(ratio.max(initial=0.0)),
        bound=None if at is None else float(bound[at]),
        derivation=derivation,
        worst_id=None if at is None else int(id_n[at]),
        outside=int(outside.sum()),
        first_id=int(id_n[outside].min()) if outside.any() else None,
        digest=digest(_by_id(id_n, lammps_n)),
    )
    return Comparison(record, lammps_n, reference_n, bound_n)


def _by_id(id_n: IntArray, values_n: FloatArray) -> FloatArray:
    """Return values in the order of the ids: the order in LAMMPS depends on its version and on sorting."""
    return values_n if np.all(id_n[1:] > id_n[:-1]) else values_n[np.argsort(id_n)]


def compare_pressure(
    table: EOSTable,
    state: EosState,
    pressure_n: FloatArray,
    field: str = "pressure",
    digits: bool = True,
) -> Comparison:
    """Compare LAMMPS' pressure with the reference law of LAMMPS' own density and energy (stage `eos`)."""
    reference_n = evaluate(table, state)
    bound_n = bounds.comparison(table, state.rho_n, state.type_n, state.e_n)
    same_order_n = lammps_rounding.pressure(table, state.rho_n, state.type_n, state.energy_n, state.mass_n)
    types = np.flatnonzero(np.bincount(state.type_n)).tolist()
    derivation = "; ".join(f"type {t}: {bounds.comparison_derivation(table[t])}" for t in types)
    comparison = compare_field(field, "eos", state.id_n, pressure_n, reference_n, bound_n, same_order_n, derivation)
    if digits:
        comparison.record.digits_lost = digits_lost(table, state, pressure_n, reference_n)
    return comparison


def digits_lost(
    table: EOSTable, state: EosState, lammps_n: FloatArray, reference_n: FloatArray, certified: int = CERTIFIED
) -> DigitsLost:
    """Return the decimal digits that each side loses against the rigorous value, worst atom.

    log10 of the relative error over eps, at least 0. All atoms are screened in extended precision; the worst ones
    of either side, and evenly spaced others, are certified with Arb. ideal/gas takes e = energy/mass as given.
    """
    if not state.rho_n.size:
        return DigitsLost()
    screened = evaluate(table, state, np.longdouble)
    even = np.linspace(0, state.rho_n.size - 1, certified // 2).astype(int)
    picks = [even]
    with np.errstate(all="ignore"):
        for side in (lammps_n, reference_n):
            relative = np.abs((side - screened) / screened)
            relative[~np.isfinite(relative)] = 0.0  # no law, or no number: none is worse than another
            picks.append(np.argsort(relative)[-(certified // 4) :])
    lost = {"lammps": 0.0, "reference": 0.0}
    e_n = state.e_n
    for i in np.unique(np.concatenate(picks)).tolist():
        law = table[int(state.type_n[i])]
        rho, e = float(state.rho_n[i]), None if e_n is None else float(e_n[i])
        if not law.is_defined(rho):
            continue
        exact = rigorous.pressure(law, rho, e)
        size = float(abs(exact).lower())
        for name, value in (("lammps", float(lammps_n[i])), ("reference", float(reference_n[i]))):
            ratio = rigorous.error(value, exact) / size if size else float(value != 0)
            lost[name] = max(lost[name], float(np.log10(max(ratio / bounds.EPS, 1.0))))
    return DigitsLost(**{name: round(min(value, 99.0), 2) for name, value in lost.items()})
