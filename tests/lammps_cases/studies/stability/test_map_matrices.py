"""Maps of moment matrices: they fail if neighbours are too few, or in a row."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.kernels import reproducing
from eos_ref.kernels.quintic import QUINTIC
from lammps_cases.findings.forces import ForcePerVolume
from lammps_cases.studies.flows.flow import Start
from lammps_cases.studies.stability import kinds
from lammps_cases.studies.stability.maps import matrices
from lammps_cases.studies.stability.model import Kind, MapCell, StabilityMap
from tests.support.roundings import rounded
from tests.support.stability_cells import outcome

pytestmark = pytest.mark.slow

FAILED = ("failed matrix", "ill-conditioned matrix")


def kind(of: StabilityMap, x: float, y: float, layer: str) -> Kind:
    return outcome(of, x, y, layer).kind


def condition(start: Start, atom: int, order: int) -> Any:
    """Condition number of the matrix of a particle of an open box, from the definition; lengths over the cutoff.

    Sums over neighbours of products of ten roundings, on either side; the smallest singular value loses as many of them
    as the condition number, in every row.
    """
    cut = start.case.scene.rheo.cut
    assert cut is not None
    r_nc = start.atoms.x_nc[atom - 1, :2] - start.atoms.x_nc[:, :2]
    r_n = np.hypot(*r_nc.T)
    near = (r_n > 0) & (r_n < cut)
    h = np.stack([np.broadcast_to(b, near.sum()) for b in reproducing.basis(order, list(r_nc[near].T / cut))])
    w = QUINTIC.normalisation(2, cut) * QUINTIC.shape(QUINTIC.support * r_n[near] / cut)
    found = float(np.linalg.cond((h * w) @ h.T))
    return rounded(found, int(2 * len(h) * (near.sum() + 10) * found))


@pytest.mark.parametrize(("layer", "limit"), [("RK0", 1.0), ("RK1", 1.0), ("RK2", math.sqrt(2))])
def test_lattice(layer: str, limit: float) -> None:
    """On a lattice without disorder, a shell of neighbours decides."""
    theory = next(t for t in matrices.LATTICE.theory if t.layer == layer)
    assert theory.x_of_y(0.0) == limit
    assert kind(matrices.LATTICE, limit - 0.005, 0.0, layer) == "failed matrix"
    assert kind(matrices.LATTICE, limit + 0.05, 0.0, layer) == "stable"


@pytest.mark.parametrize("cut", matrices.ZMIN.lines)
@pytest.mark.parametrize("layer", ["RK1", "RK2"])
def test_least_zmin_follows_the_neighbour_count(layer: str, cut: float) -> None:
    """The least sufficient zmin is one more than the largest insufficient number of neighbours."""
    needed = matrices.zmin_needed("RK1" if layer == "RK1" else "RK2", cut)
    assert kind(matrices.ZMIN, needed, cut, layer) == "stable"
    if needed:
        assert kind(matrices.ZMIN, needed - 0.1, cut, layer) in FAILED


def test_neighbours() -> None:
    assert matrices.neighbours(1.2) == (2, 3, 4)
    assert matrices.neighbours(1.6) == (3, 5, 8)
    assert matrices.neighbours(3.0)[2] == 24


@pytest.mark.parametrize(("layer", "order"), [("RK1", 1), ("RK2", 2)])
def test_surface(layer: str, order: int) -> None:
    """Matrices fail at corners; the condition number is that of the definition."""
    limit = next(t for t in matrices.SURFACE.theory if t.layer == layer).x_of_y(0.0)
    assert kind(matrices.SURFACE, limit - 0.01, 0.0, layer) in FAILED
    assert kind(matrices.SURFACE, limit + 0.1, 0.0, layer) == "stable"
    start = matrices.SURFACE.start(MapCell("matrices-surface", limit + 0.2, 0.1, layer))
    of = kinds.subject(start)
    assert of.model is not None
    evaluator = ArrayEvaluator(of.model, of.box, of.type_n, of.solid_n)
    evaluator.move(start.atoms.x_nc[:, :2])
    m_nbb, definite_n, _ = kinds.moment_matrices(evaluator, np.ones(len(start.atoms)))
    assert definite_n.all()
    for atom in (1, 4, 25):
        assert np.linalg.cond(m_nbb[atom - 1]) == condition(start, atom, order)


@pytest.mark.parametrize("cut", matrices.ROW.lines)
def test_row(cut: float) -> None:
    """The offset predicted by theory has the condition number it is predicted for."""
    limit = matrices.ROW.theory[0].x_of_y(cut)
    assert kind(matrices.ROW, limit / 1.05, cut, "RK1") in FAILED
    assert kind(matrices.ROW, limit * 1.05, cut, "RK1") == "stable"
    assert kind(matrices.ROW, 1e-12, cut, "RK1") in FAILED


@pytest.mark.lammps
@pytest.mark.parametrize("cut", matrices.ROW.lines)
def test_rows_fail_as_in_a_reference_with_the_finding(cut: float) -> None:
    """The same failure at the same step as with force-per-volume, at offsets where the plain reference differs."""
    offsets = np.geomspace(1e-3, 0.1, 13).tolist()
    ends = {
        what: [(end.kind, end.step) for end in (outcome(matrices.ROW, x, cut, "RK1 run", *how) for x in offsets)]
        for what, how in {"LAMMPS": ("lammps",), "": (), "finding": ("reference", ForcePerVolume)}.items()
    }
    assert ends["LAMMPS"] == ends["finding"] != ends[""]


@pytest.mark.lammps
@pytest.mark.parametrize("disorder", matrices.SURFACE.lines)
def test_surfaces_differ_only_where_matrices_fail(disorder: float) -> None:
    """Finding stale-gradient-below-zmin: also with zmin 0, where a matrix has no factor."""
    cuts = np.linspace(0.8, 2.0, 25).tolist()
    differing = [
        cut
        for cut in cuts
        if outcome(matrices.SURFACE, cut, disorder, "RK1 run").kind
        != outcome(matrices.SURFACE, cut, disorder, "RK1 run", "lammps").kind
    ]
    assert {kind(matrices.SURFACE, cut, disorder, "RK1") for cut in differing} <= set(FAILED)
    assert differing or disorder < max(matrices.SURFACE.lines)


def test_layers_of_the_matrix_do_not_move() -> None:
    for of in matrices.MAPS:
        for layer in of.layers:
            start, watch = (
                of.start(MapCell(of.id, of.x.high, of.lines[0], layer)),
                of.watch(MapCell(of.id, 1, 1, layer)),
            )
            moves = layer.endswith("run")
            assert (start.steps == (0,)) != moves
            assert (watch.condition is None) == moves
