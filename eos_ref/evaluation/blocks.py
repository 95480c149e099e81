"""Sums over neighbours in blocks of particles: the same bits as all at once, with memory for the pairs of one block.

The sums of a particle need its neighbours' values and nothing else. A block evaluates the stages of its own particles,
together with the others that these meet; what is done particle by particle is done for all at once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.errors import InputError
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.evaluator import Evaluator, PairInput
from eos_ref.evaluation.pairs import Search, separations
from eos_ref.model.box import BoolArray, Box
from eos_ref.model.parameters import IntArray
from eos_ref.model.state import Gradients, PairTerms, State
from eos_ref.numbers.columns import Axes
from eos_ref.numbers.number import Array, Number
from eos_ref.numbers.rounded import Rounded, error, value

ROWS = 2048  # particles of a block: their pairs' numbers stay in the processor's cache
SKIN = 0.1  # of the cutoff, by which pairs are listed beyond it
KEPT = 2**21  # directed pairs whose values are kept between two stages; of the blocks beyond only who meets whom
COMPILED_ABOVE = 2**13  # particles: loading compiled operations takes as long as they save. The bits are the same
COMPILED_FROM = 2**13  # particles of all scenes of a process
_rounded = 0  # of these so far
FOUND = ("coordination_n", "corrected_n", "counted_n")  # of the particles, by `count`


@dataclass(frozen=True, eq=False)
class Block:
    """Particles of a block and those they meet, ``at_m`` in rising order; pairs count among these.

    ``own_k`` are the block's own among them. Images of j are some edges away; if none is, these are one row of zeros.
    """

    at_m: IntArray
    own_k: IntArray
    i_p: IntArray
    j_p: IntArray
    image_pc: IntArray
    reach: float


@dataclass(frozen=True, eq=False)
class ListedBlocks:
    """Blocks with all pairs that any positions have which lie within half the skin of some."""

    box: Box
    cut: float
    rows: int
    x_nc: FloatArray
    blocks: list[Block]

    def holds(self, box: Box, cut: float, rows: int, x_nc: FloatArray) -> bool:
        """Return whether these are the blocks of other positions, too."""
        if (box, cut, rows, x_nc.shape) != (self.box, self.cut, self.rows, self.x_nc.shape):
            return False
        moved = np.square(x_nc - self.x_nc).sum(axis=1).max(initial=0.0)
        return bool(moved < (0.49 * SKIN * cut) ** 2)  # less than half: both sides round


_last: list[ListedBlocks] = []  # that of one set of positions: a scene is evaluated many times, nearly in one place


def listed(x_nc: FloatArray, box: Box, cut: float, rows: int) -> list[Block]:
    """Return blocks of some particles each, with all that is within the cutoff; nothing is searched twice in a row."""
    if not (_last and _last[0].holds(box, cut, rows, x_nc)):
        _last.clear()  # memory for the new one
        search, n = Search(x_nc, box, cut * (1 + SKIN)), len(x_nc)
        ends = [(first, min(first + rows, n)) for first in range(0, n, rows)]
        blocks = [_block(search, first, last, cut) for first, last in ends]
        _last.append(ListedBlocks(box, cut, rows, x_nc.copy(), blocks))
    return _last[0].blocks


def in_blocks(stages: type[ArrayEvaluator], n: int) -> type[ArrayEvaluator]:
    """Return stages whose sums are taken in blocks, if there are particles for two and nothing hinders it."""
    if n <= ROWS or not stages.by_rows:
        return stages
    if n > COMPILED_ABOVE:
        compile_loops()
    part = type("Part", (BlockStages, stages), {"__module__": __name__})
    return type("InBlocks", (InBlocks, stages), {"__module__": __name__, "part": part})


def compile_loops() -> None:
    """Load compiled loops, which `Rounded` and `ArrayEvaluator` take from here on."""
    import eos_ref.evaluation.pair_loops
    import eos_ref.evaluation.rounded_loops  # noqa: F401


def count_rounded(n: int) -> None:
    """Count particles evaluated with bounds: many small scenes are worth compiled operations as a large one is."""
    global _rounded
    _rounded += n
    if _rounded > COMPILED_FROM:
        compile_loops()


class BlockStages(ArrayEvaluator):
    """Stages of the particles of a block, whose pairs are known."""

    block: Block
    counted_already = False

    def count(self, x_nc: Array) -> None:
        if not self.counted_already:
            super().count(x_nc)

    def pairs(self, x_nc: FloatArray, cut: float) -> tuple[IntArray, IntArray, FloatArray]:
        """Return the block's pairs closer than a cutoff."""
        b = self.block
        assert cut <= b.reach
        shift_pc = self.box.shift(b.image_pc)
        if self.loops:
            return self.loops.near(x_nc, b.i_p, b.j_p, shift_pc, cut)  # type: ignore[no-any-return]
        shift_pc = np.broadcast_to(shift_pc, (len(b.i_p), x_nc.shape[1]))
        inside = separations(x_nc, b.i_p, b.j_p, shift_pc) < cut
        return b.i_p[inside], b.j_p[inside], shift_pc[inside]


class InBlocks(ArrayEvaluator):
    """Stages whose sums over neighbours are taken block by block; made by `in_blocks`."""

    part: type[BlockStages]
    rho_of_correction: Array | None = None

    def move(self, x_nc: Array) -> None:
        """Find the pairs of every block."""
        self.x_nc: Array = x_nc
        self.rho_of_correction = None
        for name in FOUND:
            vars(self).pop(name, None)
        self.r = x_nc[:0, 0]  # tells the number type
        if not np.isfinite(value(x_nc).astype(float)).all():
            raise InputError("positions", "must be finite; the time step may be too long")
        self._list(ROWS)
        self._adopt(*FOUND)

    follow = Evaluator.follow

    def _list(self, rows: int) -> None:
        self.blocks = listed(value(self.x_nc).astype(float), self.box, self.model.cut, rows)
        self.made: list[Any] = [None] * len(self.blocks)  # stages of the blocks, as long as they are kept
        self.kept = np.cumsum([len(block.i_p) for block in self.blocks]) <= KEPT

    def _adopt(self, *names: str) -> None:
        """Take attributes of the particles from the blocks, as far as they have them."""
        attributes = [{name: getattr(s, name)[b.own_k] for name in names if hasattr(s, name)} for b, s in self._each()]
        for name in attributes[0]:
            setattr(self, name, _stacked([each[name] for each in attributes]))

    def _each(self) -> Iterator[tuple[Block, Any]]:
        """Yield every block with its stages, moved and corrected, and with what the particles have now."""
        for at, block in enumerate(self.blocks):
            stages = self.made[at]
            if stages is None:
                stages = self.part.__new__(self.part)
                self._tell(stages, block)
                stages.block, stages.counted_already = block, hasattr(self, "coordination_n")
                stages.move(self.x_nc[block.at_m])
                if self.rho_of_correction is not None:
                    self._tell(stages, block)
                    stages.correct(self.rho_of_correction[block.at_m])
            self._tell(stages, block)
            self.made[at] = stages if self.kept[at] else None
            yield block, stages

    def _tell(self, stages: Any, block: Block) -> None:
        """Give stages of a block all that these have, of particles what the block's have."""
        for name, own in vars(self).items():
            if name not in ("blocks", "made", "x_nc", "r", "kept", "rho_of_correction"):
                setattr(stages, name, own[block.at_m] if name.endswith("_n") and own is not None else own)
        stages.n = len(block.at_m)

    def _sums(self, sums: Callable[[Any, Callable[[Any], Any]], Any]) -> Any:
        """Return what a stage gives for all particles: of every block its own, from the values of those it meets."""

        def taken(block: Block) -> Callable[[Any], Any]:
            return lambda array: None if array is None else array[block.at_m]

        return _joined([_own(sums(stages, taken(block)), block.own_k) for block, stages in self._each()])

    def any_neighbour(self, holds: Callable[[Any, Any], BoolArray], of_n: Any) -> BoolArray:
        return self._sums(lambda s, of: s.any_neighbour(holds, of(of_n)))  # type: ignore[no-any-return]

    def kernel_sum(self, weight_n: Array | None = None) -> Array:
        return self._sums(lambda s, of: s.kernel_sum(of(weight_n)))  # type: ignore[no-any-return]

    def correct(self, rho_n: Array) -> None:
        if self.model.corrects_gradients:
            for block, stages in self._each():
                stages.correct(rho_n[block.at_m])
            self.rho_of_correction = rho_n
            self._adopt("corrected_n")

    def wall_sums(self, pressure_n: Array, rho_n: Array, acceleration_nc: Array) -> tuple[Array, ...]:
        return self._sums(lambda s, of: s.wall_sums(of(pressure_n), of(rho_n), of(acceleration_nc)))  # type: ignore[no-any-return]

    def phase_sums(self) -> tuple[Array, Array]:
        return self._sums(lambda s, of: s.phase_sums())  # type: ignore[no-any-return]

    def shift_sums(self, volume_n: Array, w_h: Number) -> Axes:
        return self._sums(lambda s, of: s.shift_sums(of(volume_n), w_h))  # type: ignore[no-any-return]

    def color_sums(self, volume_n: Array) -> tuple[Axes, Array, Array]:
        return self._sums(lambda s, of: s.color_sums(of(volume_n)))  # type: ignore[no-any-return]

    def surface_sums(self, rho_n: Array) -> tuple[Axes, Array]:
        return self._sums(lambda s, of: s.surface_sums(of(rho_n)))  # type: ignore[no-any-return]

    def nearest(self, class_n: Array) -> Array:
        return self._sums(lambda s, of: s.nearest(of(class_n)))  # type: ignore[no-any-return]

    def gradients(self, state: State, chi_n: Array | None = None, want: Sequence[str] = ("v", "rho")) -> Gradients:
        return self._sums(lambda s, of: s.gradients(_some(state, of), of(chi_n), want))  # type: ignore[no-any-return]

    def pair_terms(self, given: PairInput) -> PairTerms:
        if given.virial and len(self.blocks) > 1:  # that of all is a sum over all particles
            self._list(self.n)

        def terms(stages: Any, of: Callable[[Any], Any]) -> PairTerms:
            arrays = {name: of(array) for name, array in given._asdict().items() if name not in ("gradient", "virial")}
            own: PairTerms = stages.pair_terms(given._replace(gradient=_some(given.gradient, of), **arrays))
            return own

        return self._sums(terms)  # type: ignore[no-any-return]


def _block(search: Search, first: int, last: int, cut: float) -> Block:
    own, (i_p, j_p, shift_pc) = np.arange(first, last), search.rows(first, last, cut * (1 + SKIN))
    at_m = np.union1d(own, j_p)
    own_k, i_p, j_p = (np.searchsorted(at_m, k).astype(np.int32) for k in (own, i_p, j_p))
    image_pc = search.box.periods(shift_pc).astype(np.int16)
    no_image = np.zeros((1, image_pc.shape[1]), np.int16)
    return Block(at_m, own_k, i_p, j_p, image_pc if image_pc.any() else no_image, cut * (1 + 0.01 * SKIN))


def _some(record: Any, of: Callable[[Any], Any]) -> Any:
    """Return a record of arrays of particles for some of them."""
    return type(record)(**{f.name: of(getattr(record, f.name)) for f in fields(record)})


def _own(result: Any, own_k: IntArray) -> Any:
    """Return a block's own part of what a stage gave: an array, None, or several in a record or a sequence."""
    if result is None or isinstance(result, Rounded | np.ndarray):
        return None if result is None else result[own_k]
    if is_dataclass(result) and not isinstance(result, type):
        return replace(result, **{f.name: _own(getattr(result, f.name), own_k) for f in fields(result)})
    return type(result)(_own(each, own_k) for each in result)


def _joined(parts: list[Any]) -> Any:
    """Return the results of all blocks as one."""
    first = parts[0]
    if first is None or isinstance(first, Rounded | np.ndarray):
        return None if first is None else _stacked(parts)
    if is_dataclass(first) and not isinstance(first, type):
        return replace(first, **{f.name: _joined([getattr(part, f.name) for part in parts]) for f in fields(first)})
    return type(first)(_joined(list(each)) for each in zip(*parts, strict=True))


def _stacked(parts: list[Any]) -> Any:
    values = np.concatenate([value(part) for part in parts])
    if any(isinstance(part, Rounded) for part in parts):
        return Rounded(values, np.concatenate([error(part) for part in parts]))
    return values
