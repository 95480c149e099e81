"""Vectors against plain components: what is timed computes the same."""

from __future__ import annotations

import numpy as np
import pytest

from lammps_cases.studies.benchmarks import bench_vectors

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(("dimension", "edge", "count"), [(2, 12, 2), (3, 6, 1)])
def test_both_ways_add_the_same_numbers_in_the_same_order(dimension: int, edge: int, count: int) -> None:
    compared = list(bench_vectors.sums(dimension, edge))
    assert len(compared) == count
    for _, by_vectors, plain, columns in compared:
        one_nf, other_nf = np.zeros((2, edge**dimension, columns))
        by_vectors(one_nf)
        plain(other_nf)
        assert np.array_equal(one_nf, other_nf)
        assert (one_nf != 0).all()


def test_a_ratio_is_that_of_the_two_times() -> None:
    [two, moments, three] = bench_vectors.ratios({2: 6, 3: 4}, 3)
    for found in (two, moments, three):
        assert found.peer == "plain components"
        assert min(found.ours_ns.median, found.peer_ns.median, found.ratio.low) > 0
