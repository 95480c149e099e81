"""Time steps: the integrator, forces, heat, phases, growing boxes, outputs."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest

from eos_ref import InputError
from eos_ref.compiled.evaluator import CompiledEvaluator
from eos_ref.eos.table import EOS, EOSTable
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.kernels.reproducing import basis
from eos_ref.model.box import Box, Deform, Remap
from eos_ref.model.parameters import Force, Thermal, Viscosity
from eos_ref.numbers.rounded import ROUNDING, error
from eos_ref.syntax.fixes import Shift
from tests.support.double_loop import DoubleLoop
from tests.support.particle_scenes import EPS, MELTING, RECIPES, Scene, bounded, recipe, results, scene

pytestmark = pytest.mark.slow


# --- steps

DIMENSIONS = pytest.mark.parametrize("dimension", [2, 3])
DT = 2.0**-8
STATE = ("x_nc", "v_nc", "rho_n", "energy_n")


@pytest.mark.parametrize(("name", "dimension"), [*[(n, 2) for n in RECIPES], ("walls, RK1", 3), ("walls, thermal", 3)])
def test_steps_of_the_double_loop(name: str, dimension: int) -> None:
    """Two steps in longdouble on either side, within the float64 bounds of one evaluation at the end.

    What is left of rounding in either is 2**-11 of that; only the kernel's constants and the inverse of the equation of
    state are float64 in the reference. The state may differ by a step times such a bound and by 8 roundings of itself.
    """
    built = recipe(name, dimension)
    simulation, double = built.longdouble().simulate(), DoubleLoop(built)
    simulation.run(2, DT)
    for _ in range(2):
        double.step(DT)
    s, found = simulation.state, simulation.fields
    float64 = Scene(
        built.model, built.box, replace(s.copy(), **{k: np.asarray(getattr(s, k), float) for k in STATE[:3]})
    )
    if s.energy_n is not None:
        float64 = float64.with_state(energy_n=np.asarray(s.energy_n, float))
    start = built.simulate()  # rounding bounds of the end's evaluation, with its history of forces
    start.state, start.other_nc = float64.state, np.asarray(simulation.other_nc, float)
    start.evaluator.solid_n = s.solid_n
    bound = results(start.rounded())
    for field, expected in double.out.items():
        if field in found and found[field] is not None and field != "rho":
            allowed = 2 * error(bound[field]).max()
            apart = np.abs(found[field] - np.array(expected, np.longdouble)).max()
            assert apart <= allowed, f"{field}: {apart} > {allowed}"
            assert allowed <= 1e-10 * max(1.0, np.abs(found[field]).max()), field
    kick = 2 * DT * error(bound["f"]).max() / built.model.mass.min()
    for array, rows in (("x_nc", double.x), ("v_nc", double.v), ("rho_n", double.rho), ("energy_n", double.E)):
        if rows is None:
            continue
        values = getattr(s, array)
        apart = np.abs(values - np.array(rows, np.longdouble)).max()
        more = 2 * DT * sum(error(bound[q]).max() for q in ("heatflow", "shift/v", "drho", "grad/v") if q in bound)
        more += 2 * error(bound["rho"]).max()
        assert apart <= kick + more + 8 * EPS * np.abs(values).max(), array
    assert s.solid_n.tolist() == double.solid


def alone(dimension: int, forces: tuple[Force, ...] = (), **options: Any) -> Scene:
    """One particle far from a block of others, in an open box."""
    built = scene(dimension, periodic=(False,) * dimension, margin=60.0, forces=forces, **options)
    x_nc = built.state.x_nc.copy()
    x_nc[0] = -32.0
    return built.with_state(x_nc=x_nc)


@DIMENSIONS
@pytest.mark.parametrize("kernel", ["quintic", "RK0", "RK2"])
def test_free_particle_moves_ballistically(kernel: str, dimension: int) -> None:
    """Exactly: dt and velocity are dyadic. Density and energy stay."""
    built = alone(dimension, kernel=kernel, zmin=22, thermal=MELTING, artificial=0.75, damp=0.125, shift=Shift())
    simulation = built.simulate([])
    simulation.run(16, DT)
    s = simulation.state
    assert s.x_nc[0].tolist() == (built.state.x_nc[0] + 16 * DT * built.state.v_nc[0]).tolist()
    assert s.v_nc[0].tolist() == built.state.v_nc[0].tolist()
    assert s.rho_n[0] == built.state.rho_n[0]
    assert s.energy_n[0] == built.state.energy_n[0]
    assert not np.array_equal(s.v_nc[1:], built.state.v_nc[1:])


@DIMENSIONS
def test_gravity_gives_the_parabola(dimension: int) -> None:
    """Velocity Verlet is exact for a constant acceleration; a dyadic one leaves no rounding either.

    Products with the mass are exact too: 1.3125 and 0.8125 have five bits.
    """
    g = np.array([0.25, -1.5, 2.0])[:dimension]
    built = alone(dimension, (Force("gravity", tuple(map(float, g))),))
    simulation = built.simulate([])
    simulation.run(16, DT)
    t = 16 * DT
    assert simulation.state.x_nc[0].tolist() == (built.state.x_nc[0] + t * built.state.v_nc[0] + t * t / 2 * g).tolist()
    assert simulation.state.v_nc[0].tolist() == (built.state.v_nc[0] + t * g).tolist()


def test_forces_in_their_order() -> None:
    """setforce wipes what came before it, in the components it names; what follows adds to it."""
    built = alone(2)
    n = len(built.state.x_nc)
    gravity, add = Force("gravity", (0.0, -1.5)), Force("addforce", (0.5, 0.25))
    wall = Force("setforce", (None, 0.125), (1,))
    mass = built.model.mass[built.state.type_n - 1]
    plain = built.simulate(["f"]).evaluate()["f"]
    first = built.state.type_n == 1
    assert 0 < first.sum() < n

    def force(*forces: Force) -> Any:
        return built.with_model(forces=forces).simulate(["f"]).evaluate()["f"]

    set_last, set_first = force(gravity, add, wall), force(wall, gravity, add)
    assert (set_last[first, 1] == 0.125).all()
    assert np.array_equal(set_first[first, 1], 0.125 - 1.5 * mass[first] + 0.25)
    assert np.array_equal(set_last[:, 0], plain[:, 0] + 0.0 * mass + 0.5)
    assert np.array_equal(set_last[~first, 1], plain[~first, 1] - 1.5 * mass[~first] + 0.25)


@DIMENSIONS
@pytest.mark.parametrize("walls", [False, True])
def test_wall_without_force_stays(walls: bool, dimension: int) -> None:
    """At rest, and its velocity if prescribed; its density too unless it is reconstructed."""
    built = scene(dimension, walls=walls, solids=True)
    solid_n = built.state.solid_n
    type_n = np.where(solid_n, 2, 1)
    v_nc = np.where(solid_n[:, None], [0.5, 0.0, -0.25][:dimension], built.state.v_nc)
    wall = Force("setforce", (0.0,) * dimension, (2,))
    built = built.with_model(forces=(wall,)).with_state(type_n=type_n, v_nc=v_nc)
    simulation = built.simulate([])
    simulation.run(8, DT)
    s = simulation.state
    assert np.array_equal(s.v_nc[solid_n], v_nc[solid_n])
    assert np.array_equal(s.x_nc[solid_n], (built.state.x_nc + 8 * DT * v_nc)[solid_n])
    assert np.array_equal(s.rho_n[solid_n], built.state.rho_n[solid_n]) is not walls
    assert np.abs(s.v_nc - v_nc)[~solid_n].max() > 1e-3


@pytest.mark.parametrize("name", RECIPES)
def test_runs_add_up(name: str) -> None:
    """a + b steps equal a steps, then b, to the last bit; the state given stays as it was."""
    built = recipe(name, 2)
    before = built.state.copy()
    for array in (*STATE, "type_n", "solid_n"):
        if (copied := getattr(before, array)) is not None:
            assert not np.shares_memory(copied, getattr(built.state, array)), array
    whole, parts = built.simulate([]), built.simulate([])
    whole.run(5, DT)
    parts.run(2, DT)
    parts.run(3, DT)
    for array in STATE:
        assert np.array_equal(getattr(whole.state, array), getattr(parts.state, array)), array
    assert np.array_equal(whole.fields["f"], parts.fields["f"])
    for array in (*STATE, "type_n", "solid_n"):
        assert np.array_equal(getattr(before, array), getattr(built.state, array)), array


@DIMENSIONS
@pytest.mark.parametrize("name", ["rho/sum", "self/mass"])
def test_summed_densities_forget_the_initial_ones(name: str, dimension: int) -> None:
    built = recipe(name, dimension)
    other = built.with_state(rho_n=7 * built.state.rho_n[::-1])
    a, b = built.simulate([]), other.simulate([])
    for simulation in (a, b):
        simulation.run(3, DT)
    for array in ("x_nc", "v_nc", "rho_n"):
        assert np.array_equal(getattr(a.state, array), getattr(b.state, array))


def test_self_mass_is_the_number_density() -> None:
    """With self/mass the sum of a particle is independent of the masses of others."""
    built = recipe("self/mass", 2)
    summed = built.simulate(["rho"])
    summed.evaluate()
    per_mass = summed.state.rho_n / summed.mass_n
    same = built.with_state(type_n=np.ones_like(built.state.type_n)).simulate(["rho"])
    same.evaluate()
    assert (np.abs(per_mass - same.state.rho_n / same.mass_n) <= 4 * EPS * per_mass).all()
    plain = recipe("rho/sum", 2).simulate(["rho"])
    plain.evaluate()
    assert np.abs(plain.state.rho_n - summed.state.rho_n).max() > 0.01


def test_expansion_dilutes() -> None:
    r"""v = a x with RK1, whose gradient is exact: d rho/dt = -d a rho.

    The step multiplies rho by (1 - a d dt/2) with G of the old and of the new positions (there a/(1 + a dt)).
    """
    a, dt = 0.5, 2.0**-10
    built = scene(2, kernel="RK1", cut=3.25, periodic=(False, False), margin=2.0, one_type=True)
    idle = EOSTable((EOS("linear", 1.25, 1e-150), EOS("linear", 1.25, 1e-150)))  # negligible pressure
    built = built.with_model(eos=idle, viscosity=(Viscosity("constant", 0.0),) * 2)
    built = built.with_state(v_nc=a * built.state.x_nc, rho_n=np.full(len(built.state.x_nc), 1.25))
    errors = error(built.simulate().rounded().gradient.v_ncc).max()
    simulation = built.simulate([])
    simulation.run(1, dt)
    expected = 1.25 * (1 - a * dt) * (1 - a / (1 + a * dt) * dt)
    assert (np.abs(simulation.state.rho_n - expected) <= 1.25 * dt * 4 * errors + 8 * EPS * 1.25).all()
    assert errors < 1e-9


def test_shift_moves_with_the_gradients() -> None:
    """Rigid velocity, one density: shifting only moves, by dt times the shift of the evaluation before."""
    built = scene(2, shift=Shift(), solids=True, viscosity=RECIPES["walls"]["viscosity"])
    n = len(built.state.x_nc)
    U = np.array([0.5, 0.25])
    built = built.with_state(v_nc=np.tile(U, (n, 1)), rho_n=np.full(n, 1.25))
    simulation = built.simulate()
    fields = simulation.evaluate()
    shift, f = fields["shift/v"], fields["f"]
    assert not shift[built.state.solid_n].any()
    assert shift[~built.state.solid_n].any(axis=1).all()
    simulation.step(DT)
    v_half = U + DT / 2 * (f / simulation.mass_n[:, None])
    expected = built.state.x_nc + DT * v_half + DT * shift
    assert (np.abs(simulation.state.x_nc - expected) <= 4 * EPS * np.abs(expected)).all()


# --- heat


def ice(latent: float, source: float = 0.0) -> Scene:
    """Hot and cold fluid that exchange heat across the freezing point; nothing moves."""
    thermal = (Thermal(0.7, 1.5, latent, 1.0), Thermal(0.7, 1.5, latent, 1.0))
    built = scene(2, thermal=thermal, forces=(Force("setforce", (0.0, 0.0)),), one_type=True, disorder=0.0)
    n = len(built.state.x_nc)
    left = built.state.x_nc[:, 0] < 3
    energy_n = np.where(left, 4.0, 1.25) * 1.3125
    return built.with_state(v_nc=np.zeros((n, 2)), energy_n=energy_n, rho_n=np.full(n, 1.25))


def test_latent_heat_holds_the_temperature() -> None:
    """Energy is conserved; particles between c_v T_c and c_v T_c + L are at T_c; cold fluid freezes, and stays so."""
    built = ice(latent=2.0)
    simulation = built.simulate([])
    total, bound = built.state.energy_n.sum(), bounded(built)["heatflow"][1].sum()
    solid_n = np.zeros(len(built.state.x_nc), bool)
    steps, seen = 40, False
    for k in range(steps):
        simulation.step(2.0**-4)
        s = simulation.state
        e_n = s.energy_n / simulation.mass_n
        T_n = simulation.evaluator.temperature(s.energy_n)
        plateau = (e_n > 1.5) & (e_n < 3.5)
        assert (T_n[plateau] == 1.0).all()
        assert (T_n[e_n > 3.6] > 1).all()
        assert (T_n[e_n < 1.5] < 1).all()
        seen |= bool(plateau.any())
        used_n = simulation.output("temperature")
        solid_n = np.where(used_n < 1, True, np.where(used_n > 1, False, solid_n))
        assert np.array_equal(s.solid_n, solid_n)
        assert np.array_equal(simulation.output("phase"), solid_n.astype(float))
        allowed = (k + 1) * (4 * 2.0**-4 * bound + 4 * EPS * total)
        assert abs(s.energy_n.sum() - total) <= allowed < 1e-9
    assert seen
    assert solid_n.any()


def test_phases_do_not_change_at_set_up() -> None:
    built = ice(latent=0.5)
    simulation = built.simulate([])
    simulation.setup()
    assert not simulation.state.solid_n.any()
    assert (simulation.output("temperature") < 1).any()
    simulation.step(DT)
    assert simulation.state.solid_n.any()


def test_heat_flows_from_hot_to_cold() -> None:
    built = ice(latent=0.0)
    found = built.simulate(["heatflow"]).evaluate()["heatflow"]
    hot = built.state.energy_n > 3
    assert (found[hot] < 0).all()
    assert (found[~hot] > 0).all()


# --- flow


def test_couette_flow_has_its_slope() -> None:
    """Between two reconstructed walls, one moving: the linear profile is a state of rest for the viscous force.

    On a lattice, with the profile v_x = rate y, friction of every fluid particle vanishes by symmetry except next to
    the walls; there it pulls towards the wall's velocity once the fluid lags behind, by sign.
    """
    cells = (6, 16)
    built = scene(
        2, cells=cells, walls=True, disorder=0.0, cut=3.0, one_type=True, viscosity=(Viscosity("constant", 0.5),) * 2
    )
    s = built.state
    y_n = s.x_nc[:, 1]
    solid_n = (y_n < 4) | (y_n > 12)
    v_nc = np.zeros_like(s.v_nc)
    v_nc[:, 0] = np.where(solid_n, np.where(y_n > 12, 1.0, -1.0), (y_n - 8) / 4)
    built = replace(
        built.with_state(solid_n=solid_n, v_nc=v_nc, rho_n=np.full(len(y_n), 1.25)),
        box=Box((0.0, 0.0), (6.0, 16.0), (True, False)),
    )
    found = bounded(built)
    f, errors = found["f"]
    core = (y_n > 7) & (y_n < 9)
    assert (np.abs(f[core, 0]) <= errors[core, 0]).all()
    G = found["grad/v"][0][core]
    # on the square lattice the quintic's gradient of a linear field is off by its discrete moment only
    moment = found["grad/v"][0][core, 0, 1] * 4
    assert (np.abs(moment - 1) < 0.06).all()
    assert (np.abs(G[:, [0, 1, 1], [0, 0, 1]]) <= found["grad/v"][1][core][:, [0, 1, 1], [0, 0, 1]]).all()
    lagging = built.with_state(v_nc=np.where(solid_n[:, None], v_nc, 0.0))
    f = bounded(lagging)["f"][0]
    assert (f[(y_n > 11) & (y_n < 12), 0] > 0.1).all()
    assert (f[(y_n > 4) & (y_n < 5), 0] < -0.1).all()


# --- outputs


def test_outputs() -> None:
    """State outputs are those of the state now, the others of the last evaluation."""
    simulation = recipe("walls, thermal", 2).simulate()
    simulation.run(2, DT)
    s = simulation.state
    assert simulation.output("x") is s.x_nc
    assert simulation.output("v") is s.v_nc
    assert simulation.output("rho") is s.rho_n
    assert simulation.output("energy") is s.energy_n
    assert np.array_equal(simulation.output("phase"), s.solid_n.astype(float))
    assert np.array_equal(simulation.output("pressure"), simulation.evaluator.pressure(s.rho_n, s.energy_n))
    assert not np.array_equal(simulation.output("pressure"), simulation.output("pressure_used"))
    assert set(simulation.output("conductivity")) == {0.7, 0.25}
    assert set(simulation.output("cv")) == {1.5, 2.25}
    assert np.array_equal(simulation.output("status"), s.solid_n.astype(float))
    G, eta, p = simulation.output("grad/v"), simulation.output("viscosity"), simulation.output("pressure")
    viscous = eta[:, None, None] * (G + G.transpose(0, 2, 1))
    assert np.array_equal(simulation.output("stress/v"), viscous)
    assert np.array_equal(simulation.output("stress/t"), viscous + p[:, None, None] * np.eye(2))


def test_outputs_not_evaluated() -> None:
    simulation = scene().simulate(["pressure"])
    simulation.evaluate()
    for field in ("f", "grad/v", "coordination", "viscosity"):
        with pytest.raises(InputError, match=f"field: was not evaluated: name it in fields, found '{field}'") as caught:
            simulation.output(field)
        assert "\n" not in str(caught.value)


# --- growing boxes

GROWS = Deform((0.7, -0.3))


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
    with pytest.raises(InputError, match="sums of all particles at once: use ArrayEvaluator"):
        built.with_model(deform=GROWS).simulate([], evaluator=CompiledEvaluator).run(1, DT)
