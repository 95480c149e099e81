"""Momentum, energy and mass are conserved where the formulas say so.

Tolerances are the rounding bounds that `Rounded` runs give, of both sides of a comparison.
"""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.particle_scenes import EPS, Scene, bounded, recipe

pytestmark = pytest.mark.slow

DIMENSIONS = pytest.mark.parametrize("dimension", [2, 3])
CONSERVING = ["quintic", "RK0", "gas", "rho/sum", "self/mass quintic", "droplet"]


def conserving(name: str, dimension: int) -> Scene:
    if name == "self/mass quintic":
        return recipe("self/mass", dimension, kernel="quintic")
    return recipe(name, dimension)


@DIMENSIONS
@pytest.mark.parametrize("name", CONSERVING)
def test_forces_and_heat_add_up_to_zero(name: str, dimension: int) -> None:
    """Quintic spline, no force from outside: also with walls that move, where all that acts is mutual."""
    found = bounded(conserving(name, dimension))
    for field in ("f", "heatflow"):
        if field in found:
            values, errors = found[field]
            total = np.abs(values.sum(axis=0))
            allowed = errors.sum(axis=0) + len(values) * EPS * np.abs(values).sum(axis=0)
            assert (total <= allowed).all()
            assert (allowed < 1e-9 * np.abs(values).sum(axis=0)).all()


@DIMENSIONS
def test_corrected_kernels_do_not_conserve(dimension: int) -> None:
    """The tolerance above is sensitive."""
    values = bounded(recipe("RK1", dimension))["f"][0]
    assert np.abs(values.sum(axis=0)).max() > 1e-6 * np.abs(values).sum()


@DIMENSIONS
def test_density_diffusion_conserves_volume_weighted_mass(dimension: int) -> None:
    """Order 0: V_i drho_i sums to zero, as the pair term is antisymmetric once weighted."""
    built = recipe("quintic", dimension)
    values, errors = bounded(built)["drho"]
    volume_n = built.model.mass[built.state.type_n - 1] / built.state.rho_n
    allowed = (volume_n * errors).sum() + (len(values) + 3) * EPS * np.abs(volume_n * values).sum()
    assert abs((volume_n * values).sum()) <= allowed < 1e-9 * np.abs(volume_n * values).sum()


@DIMENSIONS
@pytest.mark.parametrize("name", ["quintic", "gas"])
def test_momentum_and_energy_over_steps(name: str, dimension: int) -> None:
    """Twenty steps: momentum and heat stay within the roundings of twenty times two additions of an impulse.

    The impulse of a step has the forces' own bound (taken of the first evaluation, four times it for later ones).
    """
    built = recipe(name, dimension)
    dt, steps = 2.0**-9, 20
    errors = bounded(built)
    simulation = built.simulate([])
    mass = simulation.mass_n[:, None]
    before = (mass * simulation.state.v_nc).sum(axis=0)
    energy = None if simulation.state.energy_n is None else simulation.state.energy_n.sum()
    simulation.run(steps, dt)
    s = simulation.state
    allowed = 4 * steps * (dt * errors["f"][1].sum(axis=0) + 4 * EPS * np.abs(mass * s.v_nc).sum(axis=0))
    assert (np.abs((mass * s.v_nc).sum(axis=0) - before) <= allowed).all()
    assert (allowed < 1e-9).all()
    assert np.abs(s.v_nc - built.state.v_nc).max() > 1e-3, "something has happened"
    if energy is not None:
        allowed = 4 * steps * (dt * errors["heatflow"][1].sum() + 4 * EPS * np.abs(s.energy_n).sum())
        assert abs(s.energy_n.sum() - energy) <= allowed < 1e-9
        assert np.abs(s.energy_n - built.state.energy_n).max() > 1e-3
