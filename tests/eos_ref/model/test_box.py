"""The box: leaning edges, images, faces, and growth; in exact numbers."""

from __future__ import annotations

import math

import numpy as np
import pytest

from eos_ref import InputError
from eos_ref.model.box import Box, Deform

UPRIGHT = Box((-1.0, 2.0), (3.0, 4.0), (True, False))
LEANING = Box((0.0, 0.0, 0.0), (4.0, 2.0, 8.0), (True,) * 3, (1.0, 2.0, -0.5))


@pytest.mark.parametrize(
    ("arguments", "rule"),
    [
        (((0.0,), (1.0,), (True,)), "needs low, high and periodic for 2 or 3 axes, found 1"),
        (((0.0, 0.0), (1.0, 1.0), (True,) * 3), "needs low, high and periodic"),
        (((0.0, 0.0), (1.0, 0.0), (True,) * 2), r"finite edges with low < high, found \(0.0, 0.0\)"),
        (((0.0, 0.0), (1.0, math.inf), (True,) * 2), "finite edges with low < high"),
        (((0.0, 0.0), (1.0, 1.0), (True,) * 2, (0.1, 0.0, 0.0)), "must be xy in 2D, xy, xz and yz in 3D"),
        (((0.0, 0.0), (1.0, 1.0), (True, False), (0.1,)), "0 but between periodic axes"),
        (((0.0, 0.0), (1.0, 1.0), (True, True), (math.nan,)), "must be finite"),
    ],
)
def test_invalid_boxes_are_refused(arguments: tuple[tuple[float, ...], ...], rule: str) -> None:
    with pytest.raises(InputError, match=rule):
        Box(*arguments)


def test_edges() -> None:
    assert UPRIGHT.edge_c == (4.0, 2.0) and not UPRIGHT.tilted
    assert np.array_equal(UPRIGHT.cell_cc, [[4.0, 0.0], [0.0, 2.0]])
    assert LEANING.tilted and not Box((0.0, 0.0), (1.0, 1.0), (True, True), (0.0,)).tilted
    assert np.array_equal(LEANING.cell_cc, [[4.0, 0.0, 0.0], [1.0, 2.0, 0.0], [2.0, -0.5, 8.0]])


def test_fractions_of_the_edges_become_those_of_the_upright_box() -> None:
    fraction_nc = np.array([[0.25, 0.5, 0.75], [-1.0, 2.0, 0.5], [0.0, 0.0, 0.0]])
    assert np.array_equal(LEANING.upright(fraction_nc @ LEANING.cell_cc), fraction_nc * LEANING.edge_c)
    distance_nc = np.array([[0.1, 0.2]])
    assert UPRIGHT.upright(distance_nc) is distance_nc, "a rectangular box rounds nothing"


def test_images_are_counted_along_periodic_axes_alone() -> None:
    assert np.array_equal(UPRIGHT.images(np.array([[7.0, 9.0], [-1.0, 2.0], [-1.5, 0.0]])), [[2, 0], [0, 0], [-1, 0]])
    image_nc = np.array([[1.0, -2.0, 3.0], [0.0, 1.0, 0.0]])
    inside_nc = np.array([[0.5, 0.25, 0.125]]) @ LEANING.cell_cc
    assert np.array_equal(LEANING.images(inside_nc + LEANING.shift(image_nc)), image_nc)
    assert np.array_equal(LEANING.periods(LEANING.shift(image_nc)), image_nc)
    assert np.array_equal(UPRIGHT.periods(np.array([[2.5, 2.5], [-6.5, 0.0]])), [[1, 0], [-2, 0]])


def test_positions_beyond_a_face() -> None:
    assert UPRIGHT.outside(np.array([[-1.0, 2.0], [3.0, 4.0], [3.5, 3.0], [0.0, 1.5]])).tolist() == [0, 0, 1, 1]
    x_nc = np.array([[0.0, 0.0, 4.0], [1.0, -0.25, 4.0], [5.0, -0.25, 4.0], [5.25, -0.25, 4.0]])
    assert LEANING.outside(x_nc).tolist() == [1, 0, 0, 1], "x from yz / 2 + xz / 2, y from -1/4, half way up"


def test_rounding_moves_no_position_beyond_a_leaning_face() -> None:
    """On the plane y = z of a box of edges 2.72 that leans by one of them, found 1e-13 inside and outside of it."""
    box = Box((0.0,) * 3, (2.72,) * 3, (True,) * 3, (0.0, 0.0, 2.72))
    x_nc = np.array([[0.34, 1.0199999999999798, 1.0199999999999836], [0.34, 1.02, 1.02], [0.34, 1.02 - 1e-12, 1.02]])
    assert box.outside(x_nc).tolist() == [False, False, True]
    upright = Box(box.low_c, box.high_c, box.periodic, (0.0,) * 3)
    assert upright.outside(np.array([[0.0, -5e-324, 0.0]])).all(), "a face that does not lean is not rounded"


def test_roundings_of_positions_in_a_leaning_box() -> None:
    """With N = xy/ly = 1/2 both 1 + |N| + |N|^2 and 1 + |N| have this one element other than 1: N^2 is 0 in 2D."""
    assert UPRIGHT.rounding(1.0).tolist() == [0.0, 0.0]
    box = Box((0.0, 0.0), (4.0, 2.0), (True, True), (1.0,))
    lean_cc = np.array([[1.0, 0.0], [0.5, 1.0]])
    terms_c = (np.array([5.0, 2.0]) + 1.0) @ lean_cc @ lean_cc
    assert np.array_equal(box.rounding(1.0), 14 * 2.0**-53 * terms_c)


def test_box_grows_about_its_middle_and_leans_by_its_first_edges() -> None:
    deform = Deform((0.5, -0.25), shear=(0.125,), time=2.0)
    box = Box((0.0, 0.0), (4.0, 2.0), (True, True))
    assert deform.box(box, 2.0) == Box((-2.0, 0.5), (6.0, 1.5), (True, True), (0.5,))
    assert deform.box(box, 0.0) == Box((0.0, 0.0), (4.0, 2.0), (True, True), (0.0,))
    assert deform.changes and not Deform((0.0, 0.0), shear=(0.0,)).changes


def test_velocities_of_images() -> None:
    box = Box((0.0, 0.0), (4.0, 2.0), (True, True))
    moving = Deform((0.5, -0.25), "v", (0.125,), 2.0)
    velocity_cc = moving.image_velocity(box)
    assert velocity_cc is not None and velocity_cc.tolist() == [[2.0, 0.0], [0.25, -0.5]]
    assert Deform((0.5, -0.25)).image_velocity(box) is None, "positions move instead"
    size_cc = [[4.0 + 8.0 + 8.0, 0.0], [0.5, 2.0 + 1.0 + 2.0]]
    assert np.array_equal(moving.image_rounding(box), 2.0**-54 * np.array(size_cc))
    assert not Deform((0.5, 0.0), "v").image_rounding(box).any(), "no run, no time"
