r"""Evaluate the particle model by compiled sums over pairs, each pair taken once and its kernel evaluated once.

What is shared by all sums of a force evaluation is stored per pair: displacement, :math:`W`, :math:`W'/r`, and the
gradients of a reproducing kernel. The sums themselves are in
`eos_ref.compiled.loops`, `eos_ref.compiled.corrections` and `eos_ref.compiled.forces`. Sources are named in
`eos_ref.evaluation.evaluator` and `eos_ref.evaluation.array_evaluator`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

import eos_ref.eos.compiled  # noqa: F401  teaches numba the elementary functions
from eos_ref.compiled import corrections, forces, loops
from eos_ref.compiled.neighbours import Neighbours
from eos_ref.eos.table import FloatArray
from eos_ref.errors import InputError
from eos_ref.evaluation.evaluator import Evaluator, PairInput
from eos_ref.jit import announce_first_use
from eos_ref.model.box import Box
from eos_ref.model.state import Gradients, PairTerms, State
from eos_ref.numbers.columns import Axes, axes, joined, matrix, summed, symmetric
from eos_ref.numbers.number import Array

SKIN = 0.1  # of the cutoff
LANES = (1.0,) * 8  # doubles in a register


@dataclass(eq=False, repr=False)
class CompiledEvaluator(Evaluator):
    """Stages of a force evaluation by compiled sums, float64 only; see `Evaluator` for the other parameters.

    Parameters
    ----------
    skin : float, optional
        How far beyond the cutoff pairs are listed: the list lasts until a particle has moved by half of it.
    threads : int, optional
        How many share the sums over pairs; what is done particle by particle stays with one.

    Notes
    -----
    Results have the same bits on every run. They do not depend on the age of the neighbour list, but on the order of
    summation: on the number of threads, and on the positions that came first where those were without spatial order.
    """

    skin: float | None = None
    threads: int = 1

    def __post_init__(self) -> None:
        super().__post_init__()
        announce_first_use(loops.quintic_geometry)
        model = self.model
        self.like = (0.0,) * model.dimension
        self.take(self.box)
        self.reach = _least_square(model.cut)
        self.basis = corrections.Basis(model.order, model.dimension) if model.corrects_gradients else None
        if not isinstance(self.threads, int) or self.threads < 1:
            raise InputError("threads", "must be a whole number, at least 1", self.threads)
        self.workers = ThreadPoolExecutor(self.threads)  # without threads until there is something for two of them
        self.parts: list[Any] = []  # `loops.Pairs` for every thread, with the rows of the others empty
        self._buffers: dict[str, Any] = {}

    def take(self, box: Box) -> None:
        """Continue in another box, and list its pairs again.

        Raises
        ------
        InputError
            A tilted box.
        """
        if box.tilted:
            raise InputError("tilt of the box", "must be 0 for compiled sums: take ArrayEvaluator", box.tilt)
        super().take(box)
        cut = self.model.cut
        self.neighbours = Neighbours(box, cut, SKIN * cut if self.skin is None else self.skin)
        self.edge = tuple(edge if p else 0.0 for edge, p in zip(box.edge_c, box.periodic, strict=True))

    # --- internal order

    def _in(self, array_n: Any) -> Any:
        """Return a caller's array in internal order."""
        array_n = np.ascontiguousarray(array_n)
        if array_n.dtype not in (np.float64, np.bool_):
            array_n = array_n.astype(np.float64 if array_n.dtype.kind == "f" else np.int64)
        order_n = self.neighbours.order_n
        return array_n if order_n is None else np.take(array_n, order_n, axis=0)

    def _out(self, array_n: Any) -> Any:
        """Return an array in internal order as the caller has it."""
        order_n = self.neighbours.order_n
        if order_n is None:
            return array_n
        result_n = np.empty_like(array_n)
        result_n[order_n] = array_n
        return result_n

    def _buffer(self, name: str, width: int = 0, dtype: Any = np.float64) -> Any:
        """Return an array for what is kept of every listed pair, for as long as the list lasts."""
        if name not in self._buffers:
            # Pages of pairs that turn out to be too far are never touched, so that they take no memory.
            size = len(self.neighbours.j_p)
            self._buffers[name] = np.empty((size, width) if width else size, dtype)
        return self._buffers[name]

    def _volume_among_solids(self, rho_n: Any) -> Any:
        """Return the volumes with which solids meet each other, (n,); see `ArrayEvaluator.density_pair`."""
        return self.mass_n / (self.rho0_n if self.walls else rho_n)

    def _spline(self) -> list[Any]:
        """Return the pairs with the gradients of the quintic spline, whatever the kernel."""
        return [pairs._replace(gi_pc=None, gj_pc=None) for pairs in self.parts]

    def _shares(self, start_n: Any) -> list[Any]:
        """Return where the rows begin, for every thread with the others' rows empty; about as many pairs for each."""
        start_n = start_n.view(np.uint64)
        even = int(start_n[-1]) * np.arange(self.threads + 1) // self.threads
        ends = start_n[np.searchsorted(start_n, even.astype(np.uint64))]
        return [np.clip(start_n, *share) for share in pairwise(ends)]

    def _each(
        self, loop: Any, parts: list[Any], inputs: Sequence[Any], sums: Sequence[Any], join: Any = np.add
    ) -> None:
        """Run a loop on every part of the pairs; the sums of the parts are joined in their order."""
        if len(parts) == 1:
            loop(*parts, *inputs, *sums)
            return
        own = [sums, *([out.copy() for out in sums] for _ in parts[1:])]
        list(self.workers.map(lambda pairs, sums: loop(pairs, *inputs, *sums), parts, own))
        for part in own[1:]:
            for total, out in zip(sums, part, strict=True):
                join(total, out, out=total)

    # --- pairs, kernel values, coordination; sums over neighbours

    def move(self, x_nc: Any) -> None:
        """Find the pairs of new positions (n, d), any image of each, and evaluate the kernel once for all sums."""
        x_nc = np.ascontiguousarray(x_nc, float)
        model, near, d = self.model, self.neighbours, self.model.dimension
        if not near.holds(x_nc):
            self.parts = []  # memory for a new list
            self._buffers.clear()
            near.build(x_nc)
        kept = self._buffer("j", dtype=np.uint32), self._buffer("x", d), self._buffer("w"), self._buffer("slope")
        sigma = model.kernel.normalisation(d, model.cut)
        self.parts = [loops.Pairs(start_n, *kept, None, None) for start_n in self._shares(near.start_n)]
        count_n = np.zeros(self.n, np.uint64)
        inputs = self._in(x_nc), near.j_p, near.image_pc, self.edge, self.reach, model.h, sigma
        self._each(loops.geometry(model.kernel), self.parts, inputs, (count_n,))
        self._count_n = count_n.view(np.int64)
        self.coordination_n = self._out(self._count_n)
        self.corrected_n = np.zeros(self.n, bool)

    def kernel_sum(self, weight_n: Any = None) -> FloatArray:
        sum_n = np.zeros(self.n)
        weight_n = np.ones(self.n) if weight_n is None else self._in(weight_n)
        self._each(loops.kernel_sum, self.parts, (weight_n,), (sum_n,))
        return np.asarray(self._out(sum_n))

    def correct(self, rho_n: Any) -> None:
        """Evaluate the gradients of the reproducing kernels; see `ArrayEvaluator.correct`."""
        basis, model = self.basis, self.model
        if basis is None:
            return
        d = model.dimension
        like_m, like_b = (0.0,) * basis.moments, (0.0,) * len(basis.factor_b)
        moment_nm = np.zeros((self.n, basis.moments))
        inputs = self._in(self.volume_of_wall(rho_n)), model.cut, self.like, like_m
        self._each(corrections.moments, self.parts, inputs, (moment_nm,))
        corrected_n = self._count_n >= model.fix.zmin
        like_f = like_b * d
        coefficient_nf = np.zeros((self.n, len(like_f)))
        tables = basis.index_bb, basis.place_b, basis.factor_b
        corrections.coefficients(moment_nm, *tables, -1 / model.cut, corrected_n, LANES, coefficient_nf)
        sides = self._buffer("gi", d), self._buffer("gj", d)
        spline, coefficients = self._spline(), (coefficient_nf, corrected_n, model.cut)
        likes = self.like, like_b, like_f
        self._each(corrections.corrected_gradients, spline, (*coefficients, *likes, *sides), ())
        self.parts = [pairs._replace(gi_pc=sides[0], gj_pc=sides[1]) for pairs in spline]
        self.corrected_n = self._out(corrected_n)

    def wall_sums(self, pressure_n: Any, rho_n: Any, acceleration_nc: Any) -> tuple[FloatArray, ...]:
        all_n, same_n, wall_nf = np.zeros(self.n), np.zeros(self.n), np.zeros((self.n, 2))
        inputs = map(self._in, (self.solid_n, pressure_n, rho_n, acceleration_nc))
        self._each(loops.wall_sums, self._spline(), (*inputs, self.like), (all_n, same_n, wall_nf))
        return self._out(all_n), self._out(same_n), *axes(self._out(wall_nf))

    def gradients(self, state: State, chi_n: Any = None, want: Sequence[str] = ("v", "rho")) -> Gradients:
        """Return gradients of some fields of a state, from one pass over the pairs; see `Evaluator.gradients`."""
        gradients, d, v_nc = Gradients(), self.model.dimension, state.v_nc
        scalars: dict[str, Any] = {"rho": self.apparent_density(state.rho_n), "energy": state.energy_n}
        names = [name for name in scalars if name in want]
        velocity: list[Any] = axes(v_nc) if "v" in want else []
        if not velocity and not names:
            return gradients
        count = len(velocity) + len(names)
        slips = (1.0,) * len(velocity) + (0.0,) * len(names)
        sum_nf = np.zeros((self.n, count * d))
        field_nf = np.column_stack([*velocity, *(scalars[name] for name in names)]) if names else v_nc
        inputs = [self.mass_n / scalars["rho"], field_nf, *[None] * 4]
        if self.walls and self.solid_n.any():
            scalars["rho"] = self.rho0_n
            rest_nf = np.column_stack([*velocity, *(scalars[name] for name in names)]) if names else v_nc
            inputs[2:] = [self.mass_n / self.rho0_n, rest_nf, self.solid_n, chi_n]
        arrays = (None if array is None else self._in(array) for array in inputs)
        self._each(loops.gradients, self.parts, (*arrays, self.model.cut, slips, self.like), (sum_nf,))
        sum_nf = self._out(sum_nf)
        if velocity:
            gradients.v_ncc = sum_nf[:, : d * d].reshape(self.n, d, d)
        for k, name in enumerate(names, len(velocity)):
            setattr(gradients, f"{name}_nc", sum_nf[:, k * d : (k + 1) * d])
        return gradients

    def shift_sums(self, volume_n: Any, w_h: Any) -> Axes:
        sum_nc = np.zeros((self.n, self.model.dimension))
        self._each(loops.shift_sums, self._spline(), (self._in(volume_n), w_h, self.like), (sum_nc,))
        return axes(self._out(sum_nc))

    def color_sums(self, volume_n: Any) -> tuple[Axes, FloatArray, FloatArray]:
        gradient_nc, color_n, same_n = np.zeros((self.n, self.model.dimension)), np.zeros(self.n), np.zeros(self.n)
        inputs = self._in(volume_n), self._in(self.type_n), self.model.weighs_distance, self.like
        self._each(loops.color_sums, self._spline(), inputs, (gradient_nc, color_n, same_n))
        return axes(self._out(gradient_nc)), self._out(color_n), self._out(same_n)

    def surface_sums(self, rho_n: Any) -> tuple[Axes, FloatArray]:
        gradient_nc, divr_n = np.zeros((self.n, self.model.dimension)), np.zeros(self.n)
        inputs = (self.volume_of_wall(rho_n), self._volume_among_solids(rho_n), self.solid_n)
        self._each(loops.surface_sums, self._spline(), (*map(self._in, inputs), self.like), (gradient_nc, divr_n))
        return axes(self._out(gradient_nc)), self._out(divr_n)

    def nearest(self, class_n: Any) -> FloatArray:
        r_n = np.full(self.n, self.model.cut)
        self._each(loops.nearest, self._spline(), (self._in(class_n == 1), self.like), (r_n,), np.minimum)
        return np.asarray(self._out(r_n))

    def pair_terms(self, fields: PairInput) -> PairTerms:
        v_nc, rho_n, pressure_n, viscosity_n, sound_n, chi_n, grad, temperature_n, virial = fields
        model, pair, n, d = self.model, self.model.pair, self.n, self.model.dimension
        hot, damped = model.thermal is not None, pair.rho_damp and model.corrects_gradients
        solids = self.solid_n.any()
        walls = self.walls and solids
        volume_n = self.volume_of_wall(rho_n)
        properties = [
            *(volume_n, v_nc, rho_n, self.rho0_n, pressure_n, viscosity_n, sound_n),
            self.solid_n if solids else None,
            self.mass_n / self.rho0_n if walls else None,
            chi_n if walls else None,
            grad.v_ncc.reshape(n, d * d) if pair.artificial_viscosity else None,
            grad.rho_nc if damped else None,
            self.conduction() if hot else None,
            temperature_n if hot else None,
        ]
        arrays = forces.Fields(*(None if array is None else self._in(array) for array in properties))
        terms = forces.Terms(
            float(pair.artificial_viscosity), float(pair.rho_damp), pair.harmonic_means, model.h, model.cut
        )
        force_nf, drho_n, heat_n = np.zeros((n, 2 * d)), np.zeros(n), np.zeros(n)
        inputs = arrays, terms, self.like, self.like * d
        virial_nf = np.zeros((n, d * d))
        self._each(forces.pair_terms, self.parts, inputs, (force_nf, drho_n, heat_n, *([virial_nf] if virial else [])))
        force_nf = self._out(force_nf)
        pressure, rest = axes(force_nf[:, :d]), axes(force_nf[:, d:])
        force_nc = joined([a + b for a, b in zip(pressure, rest, strict=True)])
        flow_n = self._out(heat_n) if hot else None
        virials = self._virials(virial_nf) if virial else ()
        return PairTerms(force_nc, force_nf[:, :d], self._out(drho_n), flow_n, *virials)

    def _virials(self, virial_nf: FloatArray) -> tuple[Array, Array]:
        """Return the virials of every particle, and that of all; see `ArrayEvaluator.virials`."""
        d = self.model.dimension
        virial = symmetric(matrix(self._out(virial_nf).reshape(self.n, d, d)))
        return joined(virial), joined([[summed(w_n) for w_n in row] for row in virial])

    # --- properties of a particle

    def eos_pressure(self, rho_n: Any, e_n: Any) -> FloatArray:
        return self.model.eos.pressure(rho_n, self.type_n, e_n)


def _least_square(cut: float) -> float:
    """Return the least number whose square root reaches the cutoff: r*r below it is the same as r < cut."""
    square = cut * cut
    while math.sqrt(square) >= cut:
        square = math.nextafter(square, 0.0)
    while math.sqrt(square) < cut:
        square = math.nextafter(square, math.inf)
    return square
