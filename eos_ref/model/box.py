"""The box: where positions repeat, which edges lean, and how it grows."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from eos_ref.eos.table import FloatArray
from eos_ref.errors import InputError

BoolArray = npt.NDArray[np.bool_]
TILTED = ((0, 1), (0, 2), (1, 2))  # xy, xz and yz: along which axis the edge of which leans
Remap = Literal["x", "v", "none"]  # what fix deform changes with the box


@dataclass(frozen=True)
class Box:
    """A box with the edges (lx, 0, 0), (xy, ly, 0) and (xz, yz, lz); in 2D the third axis is without meaning.

    Attributes
    ----------
    low_c, high_c : one corner, and that of the upright box, in which the edges lean by nothing
    periodic : one flag per axis
    tilt : by how much the edges lean, xy or xy, xz, yz, between periodic axes alone; empty: the box is rectangular,
        and positions in it never go to fractions of its edges
    """

    low_c: tuple[float, ...]
    high_c: tuple[float, ...]
    periodic: tuple[bool, ...]
    tilt: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if not len(self.low_c) == len(self.high_c) == len(self.periodic) in (2, 3):
            raise InputError("box", "needs low, high and periodic for 2 or 3 axes", len(self.low_c))
        for low, high in zip(self.low_c, self.high_c, strict=True):
            if not (math.isfinite(low) and math.isfinite(high) and low < high):
                raise InputError("box", "needs finite edges with low < high", (low, high))
        if self.tilt and len(self.tilt) != (1 if len(self.low_c) == 2 else 3):
            raise InputError("tilt of the box", "must be xy in 2D, xy, xz and yz in 3D", self.tilt)
        for tilt, (one, other) in zip(self.tilt, TILTED, strict=False):
            if not math.isfinite(tilt) or (tilt and not (self.periodic[one] and self.periodic[other])):
                raise InputError("tilt of the box", "must be finite, and 0 but between periodic axes", self.tilt)

    @property
    def edge_c(self) -> tuple[float, ...]:
        """Return the edge lengths, of the upright box."""
        return tuple(high - low for low, high in zip(self.low_c, self.high_c, strict=True))

    @property
    def tilted(self) -> bool:
        """Return whether an edge leans."""
        return any(self.tilt)

    @property
    def cell_cc(self) -> FloatArray:
        """Return the edges as rows."""
        cell_cc = np.diag(self.edge_c)
        for tilt, (to, of) in zip(self.tilt, TILTED, strict=False):
            cell_cc[of, to] = tilt
        return cell_cc

    def upright(self, distance_nc: FloatArray) -> FloatArray:
        """Return distances, (n, d), without what they lean: in a rectangular box the same."""
        if not self.tilted:
            return distance_nc
        upright_nc, cell_cc = np.array(distance_nc, float), self.cell_cc
        for axis in reversed(range(1, len(self.edge_c))):
            upright_nc[:, :axis] -= (upright_nc[:, axis] / self.edge_c[axis])[:, None] * cell_cc[axis, :axis]
        return upright_nc

    def images(self, x_nc: FloatArray) -> FloatArray:
        """Return by how many edges positions, (n, d), lie outside, in whole numbers; 0 along open axes."""
        fraction_nc = self.upright(x_nc - np.array(self.low_c)) / self.edge_c
        return np.where(self.periodic, np.floor(fraction_nc), 0.0)

    def periods(self, distance_nc: FloatArray) -> FloatArray:
        """Return the whole numbers of edges nearest to distances, (n, d); 0 along open axes."""
        return np.where(self.periodic, np.round(self.upright(distance_nc) / self.edge_c), 0.0)

    def shift(self, image_nc: npt.NDArray[Any]) -> FloatArray:
        """Return whole numbers of edges as distances, (n, d)."""
        return np.asarray(image_nc @ self.cell_cc if self.tilted else image_nc * np.array(self.edge_c))

    def outside(self, x_nc: FloatArray) -> BoolArray:
        """Return which positions, (n, d), lie beyond a face, (n,): one that leans by more than rounding."""
        low_c, high_c = np.array(self.low_c), np.array(self.high_c)
        upright_nc = low_c + self.upright(x_nc - low_c) if self.tilted else x_nc
        size_c = self.rounding(0.0) if self.tilted else 0.0
        return np.asarray(((upright_nc < low_c - size_c) | (upright_nc > high_c + size_c)).any(axis=1))

    def rounding(self, reach: float) -> FloatArray:
        r"""Return how far the same position may lie in two codes, (d,), up to a reach outside; 0 if rectangular.

        A position in a tilted box goes to fractions of its edges and back, :math:`\mathbf x=\mathbf x_0+H(H^{-1}
        (\mathbf x-\mathbf x_0))`, whenever neighbour lists are built. Roundings of the absolute terms of both products:
        the difference 1, an element of the inverse 5, its products and sums 3, the number of an image 1, the products
        and sums back 3, the corner 1.
        """
        if not self.tilt:
            return np.zeros(len(self.low_c))
        cell_cc = np.abs(self.cell_cc)
        lean_cc = cell_cc / np.array(self.edge_c)[:, None]  # of H = E (1 + N), N being triangular: 1 + |N|
        inverse_cc = np.linalg.inv(2 * np.eye(len(lean_cc)) - lean_cc)  # 1 + |N| + |N|^2
        terms_c = np.abs(self.low_c) + (cell_cc.sum(axis=0) + reach) @ inverse_cc @ lean_cc
        return np.asarray(14 * 2.0**-53 * terms_c)


@dataclass(frozen=True)
class Deform:
    """A box whose edges grow and lean at engineering strain rates (fix deform, style erate).

    Attributes
    ----------
    rate_c : of the edges, one per axis
    remap : positions keep their fractions of the edges (x), or stay where they are (v, none); with v a particle that
        crosses a periodic boundary takes on the velocity of its image, which moves with the box
    shear : of the tilts, xy or xy, xz, yz; empty: none
    time : from the beginning of a run to its end
    """

    rate_c: tuple[float, ...]
    remap: Remap = "x"
    shear: tuple[float, ...] = ()
    time: float = 0.0

    @property
    def changes(self) -> bool:
        """Return whether the box changes at all."""
        return any((*self.rate_c, *self.shear))

    def box(self, first: Box, time: float) -> Box:
        r"""Return the box some time after the run began in another one.

        :math:`L(t)=L_0(1+\dot\varepsilon t)`, the middle of every edge staying where it is, and
        :math:`T(t)=T_0+L_0\dot\gamma t`, :math:`L_0` being that of the axis along which the edge that leans goes.
        """
        growth = np.array(self.rate_c) * (0.5 * time) * np.array(first.edge_c)
        low_c, high_c = np.array(first.low_c) - growth, np.array(first.high_c) + growth
        tilt = first.tilt
        if self.shear:
            edges = [first.edge_c[of] for (_, of), _ in zip(TILTED, self.shear, strict=False)]
            lean = np.array(self.shear) * time * np.array(edges)
            tilt = tuple((np.array(first.tilt or np.zeros(len(lean))) + lean).tolist())
        return replace(first, low_c=tuple(low_c.tolist()), high_c=tuple(high_c.tolist()), tilt=tilt)

    def image_velocity(self, first: Box) -> FloatArray | None:
        """Return how fast images move that are one edge away, (d, d), by rows: with remap v, else not at all."""
        if self.remap != "v":
            return None
        velocity_cc = np.diag(np.array(self.rate_c) * np.array(first.edge_c))
        for rate, (to, of) in zip(self.shear, TILTED, strict=False):
            velocity_cc[of, to] = rate * first.edge_c[of]
        return velocity_cc

    def image_rounding(self, first: Box) -> FloatArray:
        """Return how far these velocities may lie apart in two codes, (d, d), apart from roundings of their own size.

        The other side may take the box at the end of a run, less that at its beginning, over the time: a rounding of
        both faces, of both edges, and of both tilts.
        """
        if not self.time:
            return np.zeros((len(first.edge_c),) * 2)
        last = self.box(first, self.time)
        size_cc = np.abs(first.cell_cc) + np.abs(last.cell_cc) + np.diag(np.abs([last.low_c, last.high_c]).sum(axis=0))
        return np.asarray(2.0**-53 * size_cc / self.time)
