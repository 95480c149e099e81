"""Steps in a growing, leaning box: motion of its corners, its images and the particles."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np
import pytest

from eos_ref import InputError
from eos_ref.compiled.evaluator import CompiledEvaluator
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.kernels.reproducing import basis
from eos_ref.model.box import Box, Deform, Remap
from eos_ref.numbers.rounded import ROUNDING
from eos_ref.syntax.fixes import Shift
from tests.support.particle_scenes import EPS, scene

pytestmark = pytest.mark.slow

DT = 2.0**-8
GROWS = Deform((0.7, -0.3))


def test_box_grows_about_its_middle() -> None:
    first = Box((-1.0, 2.0), (3.0, 4.0), (True, False))
    grown = GROWS.box(first, 0.5)
    np.testing.assert_allclose([grown.low_c, grown.high_c], [[-1.7, 2.15], [3.7, 3.85]], rtol=2 * EPS)
    assert grown.periodic == first.periodic and GROWS.box(first, 0.0) == first


@pytest.mark.parametrize("kernel", ["quintic", "RK1", "RK2"])
@pytest.mark.parametrize("remap", ["x", "none"])
def test_steps_in_a_growing_box(kernel: str, remap: Remap) -> None:
    """A step is one in a fixed box; then the box grows by a share of its size at the start of the run."""
    built = scene(2, kernel=kernel).with_model(deform=replace(GROWS, remap=remap))
    growing, fixed = built.simulate([]), built.with_model(deform=None).simulate([])
    first = growing.box
    for simulation in (growing, fixed):
        simulation.run(1, DT)
    assert growing.box == GROWS.box(first, DT)
    fraction_nc = (fixed.state.x_nc - np.array(first.low_c)) / first.edge_c
    moved_nc = np.array(growing.box.low_c) + fraction_nc * growing.box.edge_c
    np.testing.assert_array_equal(growing.state.x_nc, moved_nc if remap == "x" else fixed.state.x_nc)
    for name in ("v_nc", "rho_n"):
        np.testing.assert_array_equal(getattr(growing.state, name), getattr(fixed.state, name))
    growing.run(1, DT)
    assert growing.box == GROWS.box(first, 2 * DT)
    begun = growing.box
    growing.begin_again(np.zeros(len(growing.state.x_nc), bool))
    growing.run(1, DT)
    assert growing.box == GROWS.box(begun, DT)


@pytest.mark.parametrize("kernel", ["quintic", "RK1"])
def test_half_step_gradients_use_the_grown_box(kernel: str) -> None:
    """The first half of a step uses velocities at its own positions; the correction is that of the last forces."""
    simulation = scene(2, kernel=kernel).with_model(deform=GROWS).simulate([])
    simulation.run(1, DT)
    evaluator = cast(ArrayEvaluator, simulation.evaluator)
    kept = evaluator.correction if kernel == "RK1" else None
    evaluator.follow(simulation.state.x_nc)
    other = ArrayEvaluator(simulation.model, simulation.box, simulation.state.type_n, simulation.state.solid_n)
    other.move(simulation.state.x_nc)
    if kept:
        assert evaluator.correction is kept
        other.correction = kept
        other.corrected_gradients(basis(1, [x_p / simulation.model.cut for x_p in other.x]))
    for one, same in zip(evaluator.g, other.g, strict=True):
        np.testing.assert_array_equal(one, same)


LEANS = Deform((0.3, 0.0, -0.2), shear=(0.5, -0.7, 0.9))


def test_box_leans_by_shares_of_the_leaning_edge() -> None:
    first = Box((-1.0, 2.0, 0.0), (3.0, 4.0, 8.0), (True,) * 3, (0.25, 0.0, 0.0))
    grown = LEANS.box(first, 0.5)
    assert grown.tilt == pytest.approx((0.25 + 0.5 * 2 * 0.5, -0.7 * 8 * 0.5, 0.9 * 8 * 0.5), rel=4 * EPS)
    assert replace(LEANS, shear=()).box(first, 0.5).tilt == first.tilt
    image = np.array([1.0, -2.0, 1.0])  # of a particle, which moves as the box does
    moved = (grown.shift(image) - first.shift(image)) / 0.5
    moving = replace(LEANS, remap="v").image_velocity(first)
    assert moving is not None and moved == pytest.approx(image @ moving, rel=16 * EPS)
    assert LEANS.image_velocity(first) is None


def test_velocities_of_images_round_by_the_size_of_the_box() -> None:
    """Where it hardly changes: they may be computed as the difference of its values at the end and at the beginning."""
    first = Box((-1.1, 2.3, 0.7), (3.3, 4.9, 8.1), (True,) * 3, (0.3, 0.0, 0.0))
    deform = replace(LEANS, remap="v", time=1e-9)
    moving = deform.image_velocity(first)
    assert moving is not None
    apart = np.abs((deform.box(first, deform.time).cell_cc - first.cell_cc) / deform.time - moving)
    own = ROUNDING * np.abs(moving)
    assert (apart <= own + deform.image_rounding(first)).all() and (apart > 1e4 * own).any()
    assert not replace(deform, time=0.0).image_rounding(first).any(), "of no run"


@pytest.mark.parametrize("kernel", ["quintic", "RK1"])
def test_flow_has_no_boundary_if_images_move_with_particles(kernel: str) -> None:
    """v = (x, y) E in a box that moves with it: forces and gradients are those of the same flow cut elsewhere."""
    built = scene(2, kernel=kernel, artificial=0.5)
    built = built.with_model(deform=Deform((0.5, -0.25), "v", (0.75,)))
    box = built.box
    assert built.model.deform is not None
    moving = built.model.deform.image_velocity(box)
    flow_cc = np.linalg.inv(box.cell_cc) @ moving
    flow_nc = (built.state.x_nc - np.array(box.low_c)) @ flow_cc
    moved_nc = built.state.x_nc + np.array([1.7, 2.3])  # the same for all: other pairs lie across a boundary
    turned_nc = box.images(moved_nc)
    one, other = (
        built.with_state(x_nc=x_nc, v_nc=v_nc).simulate()
        for x_nc, v_nc in (
            (built.state.x_nc, flow_nc),
            (moved_nc - box.shift(turned_nc), flow_nc - turned_nc @ moving),
        )
    )
    for field in ("grad/v", "f"):
        found, same = (simulation.evaluate()[field] for simulation in (one, other))
        bound = one.rounded().fields[field].error + other.rounded().fields[field].error
        assert (np.abs(found - same) <= bound).all()
    if kernel == "RK1":
        assert (np.abs(one.fields["grad/v"] - flow_cc.T) <= one.rounded().fields["grad/v"].error).all()


def test_invalid_deformations_are_refused() -> None:
    built = scene(2)
    for made, rule in (
        (Deform((0.1,)), "needs 2 rates, found 1"),
        (Deform((0.1, np.inf)), "needs finite rates"),
        (Deform((0.1, 0.1), shear=(np.nan,)), "needs finite rates"),
        (Deform((0.1, 0.1), shear=(0.1, 0.1)), "needs rates of xy in 2D"),
    ):
        with pytest.raises(InputError, match=rule):
            built.with_model(deform=made)
    with pytest.raises(InputError, match="remap v goes without shift"):
        scene(2, shift=Shift()).with_model(deform=replace(GROWS, remap="v"))
    with pytest.raises(InputError, match="sums of all particles at once: take ArrayEvaluator"):
        built.with_model(deform=GROWS).simulate([], evaluator=CompiledEvaluator).run(1, DT)
