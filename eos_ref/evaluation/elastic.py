"""Forces of bonds and of contacts between solids, on all particles."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from eos_ref.eos.bounds import EPS
from eos_ref.eos.table import FloatArray
from eos_ref.evaluation.evaluator import Evaluator
from eos_ref.evaluation.pairs import apart, directed_pairs, separations
from eos_ref.model.bonds import Bonds, Elastic
from eos_ref.model.parameters import IntArray
from eos_ref.model.state import State
from eos_ref.numbers.columns import axes, dot, joined
from eos_ref.numbers.elementary import sqrt
from eos_ref.numbers.number import Array
from eos_ref.numbers.rounded import Rounded, value

Pairs = tuple[IntArray, IntArray, FloatArray]  # i and j (p,), by how much the image of j is displaced (p, d)


def elastic_forces(evaluator: Evaluator, bonds: Bonds, state: State) -> Array:
    """Return the forces of bonds and contacts, (n, d), in the number type of the state."""
    elastic, box = evaluator.model.elastic or Elastic(), evaluator.box
    x_nc = value(state.x_nc).astype(float)
    n = len(x_nc)
    i, j = np.concatenate([bonds.i_b, bonds.j_b]), np.concatenate([bonds.j_b, bonds.i_b])
    shift_pc = box.shift(box.periods(x_nc[i] - x_nc[j]))
    type_p, length_p = np.tile(bonds.type_b, 2), np.tile(bonds.length_b, 2)
    force_nc: Any = np.zeros(x_nc.shape)
    for number, law in enumerate(elastic.bonds, 1):
        of = np.flatnonzero(type_p == number)
        pairs, force = (i[of], j[of], shift_pc[of]), partial(evaluator.bond_force, law, length_p[of])
        force_nc = force_nc + _sums(state, pairs, force)
    if contact := elastic.contact:
        solid = np.flatnonzero(state.solid_n)
        # Pairs that rounding may put within the cutoff count: there the force is 0 up to its bound.
        near = directed_pairs(x_nc[solid], box, float(contact.reach_tt.max()) * (1 + 8 * EPS))
        i_p, j_p, shift_pc = solid[near[0]], solid[near[1]], near[2]
        weight_p = np.where(np.isin(i_p * n + j_p, i * n + j), contact.bonded, 1.0)
        reach_p = contact.reach_tt[state.type_n[i_p] - 1, state.type_n[j_p] - 1]
        met = (weight_p != 0) & (separations(x_nc, i_p, j_p, shift_pc) < reach_p * (1 + 8 * EPS))
        pairs, weight_p = (i_p[met], j_p[met], shift_pc[met]), weight_p[met]
        types = state.type_n[pairs[0]] - 1, state.type_n[pairs[1]] - 1
        force_nc = force_nc + _sums(state, pairs, lambda r, closing: weight_p * contact.force(r, closing, types))
    return force_nc  # type: ignore[no-any-return]


def _sums(state: State, pairs: Pairs, force: Callable[[Any, Any], Any]) -> Array:
    """Return the sums of central forces, (n, d), of distances and closing velocities."""
    i, j, shift_pc = pairs
    x = [apart(x_n, i, j, shift_pc[:, a]) for a, x_n in enumerate(axes(state.x_nc))]
    r = sqrt(dot(x, x))
    closing = -(dot(x, [v_n[i] - v_n[j] for v_n in axes(state.v_nc)]) / r)
    over_r = force(r, closing) / r
    return joined([_total(over_r * x_p, i, len(state.type_n)) for x_p in x])


def _total(term_p: Any, i: IntArray, n: int) -> Any:
    return term_p.sum_by(i, n) if isinstance(term_p, Rounded) else np.bincount(i, term_p.astype(float), n)
