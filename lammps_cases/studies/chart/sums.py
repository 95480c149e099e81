"""Chart of the ways to add up a particle sum: density by summation, and a component of a gradient."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from eos_ref.compiled.neighbours import Neighbours
from eos_ref.eos.table import FloatArray
from eos_ref.kernels.quintic import QUINTIC
from eos_ref.model.box import Box
from lammps_cases.records import measure
from lammps_cases.scene.atoms import seed
from lammps_cases.studies.chart.points import MethodPoint, Panel, measured
from lammps_cases.studies.chart.sum_methods import METHODS, Half, error, exact

WAVE = 16.0  # wavelength of the field whose gradient is summed, in spacings
REGIMES = {"2D, cutoff of 3 spacings": (2, 3.0), "3D, cutoff of 4 spacings": (3, 4.0)}
TITLES = {"density": "Adding up a density", "gradient": "Adding up a gradient"}
EDGE = {2: 100, 3: 16}  # 10 000 particles, and 4096 with nearly ten times the neighbours
QUICK_EDGE = {2: 100, 3: 12}


def scene(dimension: int, cut: float, edge: int) -> tuple[Half, dict[str, FloatArray]]:
    """Return the pairs of a periodic, disordered lattice of unit spacing, and their terms (pairs,) of either sum."""
    random = np.random.default_rng(seed(f"sums/{dimension}/{edge}"))
    axes = np.meshgrid(*[np.arange(edge) + 0.5] * dimension, indexing="ij")
    x_nc = np.stack([axis.ravel() for axis in axes], axis=1)
    x_nc += random.uniform(-0.1, 0.1, x_nc.shape)
    near = Neighbours(Box((0.0,) * dimension, (float(edge),) * dimension, (True,) * dimension), cut, 0.0)
    near.build(x_nc)
    x_nc = x_nc if near.order_n is None else x_nc[near.order_n]
    pairs = Half(near.start_n, near.j_p)
    i_p = pairs.i_p
    x_pc = x_nc[i_p] - (x_nc[near.j_p] + near.image_pc * float(edge))
    r_p, h = np.sqrt(np.square(x_pc).sum(axis=1)), cut / QUINTIC.support
    sigma = QUINTIC.normalisation(dimension, cut)
    field_n = np.sin(2 * np.pi / WAVE * x_nc).sum(axis=1)
    slope_p = sigma / h * QUINTIC.slope(r_p / h) / r_p * x_pc[:, 0]
    return pairs, {
        "density": np.asarray(sigma * QUINTIC.shape(r_p / h)),
        "gradient": (field_n[near.j_p] - field_n[i_p]) * slope_p,
    }


def panels(quick: bool, lmp: Any | None) -> Iterator[Panel]:
    """Yield one panel per sum; LAMMPS has no part in it, as the terms are given."""
    scenes = {regime: scene(d, cut, (QUICK_EDGE if quick else EDGE)[d]) for regime, (d, cut) in REGIMES.items()}
    for quantity, title in TITLES.items():
        points: list[MethodPoint] = []
        for regime, (pairs, terms) in scenes.items():
            points += _points(f"sum of a {quantity}", regime, pairs, terms[quantity], quick)
        yield Panel(
            f"sums-{quantity}",
            title,
            "Terms are given and read from memory, in the precision of the method; what is timed is the adding alone. "
            "A half list holds a pair once and adds to both particles; a full list holds it twice.",
            "against the exactly rounded sum of the same double terms, relative to the sum of absolute terms; "
            "worst particle",
            "particle",
            tuple(points),
        )


def _points(quantity: str, regime: str, pairs: Half, term_p: FloatArray, quick: bool) -> tuple[MethodPoint, ...]:
    calls = {method.name: method.prepare(pairs, term_p) for method in METHODS}
    timings = measure.in_turns(calls, *measure.effort(quick))
    sums = exact(pairs, term_p), exact(pairs, np.abs(term_p))
    errors = {m.name: error(calls[m.name](), *sums) for m in METHODS}
    return measured(quantity, regime, errors, timings, len(pairs), {m.name: m.reason for m in METHODS})
