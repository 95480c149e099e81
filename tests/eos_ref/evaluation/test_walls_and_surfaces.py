"""Reconstructed walls move with the fluid without friction; surfaces are where neighbours are missing.

Tolerances are the rounding bounds that `Rounded` runs give, of both sides of a comparison.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eos_ref.model.box import Box
from tests.support.particle_scenes import EPS, scene

pytestmark = pytest.mark.slow

DIMENSIONS = pytest.mark.parametrize("dimension", [2, 3])


@DIMENSIONS
@pytest.mark.parametrize("kernel", ["quintic", "RK1", "RK2"])
def test_rigid_motion_has_no_friction(kernel: str, dimension: int) -> None:
    """Fluid and reconstructed wall with one velocity: no gradient, no viscous force, no artificial viscosity."""
    base = scene(dimension, walls=True, kernel=kernel)
    U = np.array([4.0, -3.0, 2.5])[:dimension]
    moving = base.with_state(v_nc=np.broadcast_to(U, base.state.v_nc.shape).copy())
    frictionless = moving.with_model(viscosity=tuple(replace(v, eta=0.0) for v in base.model.viscosity))
    sticky = moving.with_model(pair=replace(base.model.pair, artificial_viscosity=0.75))
    found = moving.simulate()
    found.evaluate()
    assert not found.fields["grad/v"].any()
    for other in (frictionless, sticky):
        simulation = other.simulate()
        simulation.evaluate()
        assert np.array_equal(simulation.fields["f"], found.fields["f"])
    slipping = base.simulate()
    slipping.evaluate()
    assert np.abs(slipping.fields["grad/v"]).max() > 0.1


@pytest.mark.parametrize("style", ["coordination", "divergence"])
def test_surfaces_of_a_half_filled_box(style: str) -> None:
    """Block with a free surface above and below: layers near it are surface, the middle bulk, one splash."""
    from eos_ref.syntax.fixes import SurfaceDetection

    limit = 22 if style == "coordination" else 1.75
    surface = SurfaceDetection(style, limit, 3)
    built = scene(
        2, cells=(8, 9), disorder=0.05, periodic=(True, False), margin=0.0, surface=surface, cut=3.0, one_type=True
    )
    s = built.state
    rho_n = np.full_like(s.rho_n, 1.3125)  # mass over unit spacing: divr is then near 2 inside
    built = replace(built.with_state(rho_n=rho_n), box=Box((0.0, -4.0), (8.0, 20.0), (True, False)))
    lone = built.state.x_nc.copy()
    lone[0] = (0.5, 18.0)
    built = built.with_state(x_nc=lone)
    simulation = built.simulate()
    found = simulation.evaluate()
    y_n, class_n = built.state.x_nc[:, 1], found["surface"]
    assert class_n[0] == 2
    inside = (y_n > 3.1) & (y_n < 5.9)
    assert not class_n[inside].any()
    edge = ((y_n < 1) | (y_n > 8)) & (np.arange(len(y_n)) > 0)
    assert (class_n[edge] == 1).all()
    assert (np.abs(found["surface/divr"][inside] - 2) < 0.1).all()
    normal = found["surface/n"][edge]
    assert (np.abs(np.hypot(*normal.T) - 1) < 1e-8).all()  # the softening 1e-10 over |grad C| > 0.01
    assert (normal[:, 1] * np.sign(y_n[edge] - 4.5) > 0.5).all()  # also next to the hole that the lone particle left
    assert not found["surface/n"][class_n != 1].any()
    assert (found["surface/r"][class_n > 0] == 0).all()
    at = built.state.x_nc[class_n == 1]
    for k in np.flatnonzero(class_n == 0):
        apart = at - built.state.x_nc[k]
        apart[:, 0] -= 8 * np.round(apart[:, 0] / 8)
        nearest = min(3.0, np.sqrt((apart**2).sum(axis=1)).min())
        assert abs(found["surface/r"][k] - nearest) <= 8 * EPS * 3
    status_n = simulation.output("status")
    layer = (class_n == 0) & (found["surface/r"] < 3)
    assert np.array_equal(status_n, np.select([class_n == 2, class_n == 1, layer], [32, 16, 8], 4))
