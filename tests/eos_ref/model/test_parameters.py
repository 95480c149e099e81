"""Parameters, boxes, commands and units of the model; bad input is refused in one line that names the value."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from eos_ref import EOS, EOSTable, InputError
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.box import Box, Deform
from eos_ref.model.commands import parse_fix_rheo_thermal, parse_fix_rheo_viscosity, parse_pair_style_rheo
from eos_ref.model.consistent import consistent_model, consistent_state
from eos_ref.model.parameters import Force, Model, PairRheo, Thermal, Viscosity
from eos_ref.model.quantities import QUANTITIES
from eos_ref.model.state import State, check_state
from eos_ref.model.units import KINDS, UNITS
from eos_ref.syntax.fixes import FixRheo, Shift
from tests.support.particle_scenes import HOT, TWO_LAWS, scene
from tests.support.roundings import rounded

# --- the box

UPRIGHT = Box((-1.0, 2.0), (3.0, 4.0), (True, False))
LEANING = Box((0.0, 0.0, 0.0), (4.0, 2.0, 8.0), (True,) * 3, (1.0, 2.0, -0.5))


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


# --- parameters and states

NAN, INF, PERIODIC = math.nan, math.inf, (True, True)
ONE_LAW = EOSTable((EOS("linear"),))
GAS = EOSTable((EOS("ideal/gas", parameter=1.4), EOS("linear")))


def one_line(caught: Any) -> str:
    text = str(caught.value)
    assert "\n" not in text
    assert len(text) < 200
    return text


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Box((0, 0), (1, 1), (True,)), "box: needs low, high and periodic for 2 or 3 axes"),
        (lambda: Box((0, 0), (1, 1), (True,) * 3), "box: needs low, high and periodic"),
        (lambda: Box((0,), (1,), (True,)), "box: needs .* found 1"),
        (lambda: Box((0, 0), (1, 0), PERIODIC), r"box: needs finite edges with low < high, found \(0, 0\)"),
        (lambda: Box((0, 2), (1, 1), PERIODIC), r"box: .* found \(2, 1\)"),
        (lambda: Box((0, NAN), (1, 1), PERIODIC), r"box: .* found \(nan, 1\)"),
        (lambda: Box((0, 0), (INF, 1), PERIODIC), r"box: .* found \(0, inf\)"),
        (lambda: Box((0, 0), (1, 1), PERIODIC, (0.5, 0.0)), r"tilt .*must be xy in 2D, .* found \(0.5, 0.0\)"),
        (lambda: Box((0, 0), (1, 1), PERIODIC, (NAN,)), r"tilt of the box: must be finite, .* found \(nan,\)"),
        (lambda: Box((0, 0), (1, 1), (False, True), (0.5,)), r"tilt .* 0 but between periodic axes, found \(0.5,\)"),
        (lambda: Viscosity("constant", NAN), "eta of rheo/viscosity: must be a finite number, found nan"),
        (lambda: Viscosity("constant", -1.5), "eta of rheo/viscosity: must not be negative, found -1.5"),
        (lambda: Viscosity("power", 1, 0.0, 1, 0.5), "gd0 of rheo/viscosity: must be positive for power, found 0.0"),
        (lambda: Viscosity("power", 1.0, -2.5, 1.0, 0.5), "gd0 of rheo/viscosity: must not be negative, found -2.5"),
        (lambda: Viscosity("power", 1.0, 1.0, -2.5, 0.5), "K of rheo/viscosity: must not be negative, found -2.5"),
        (lambda: Viscosity("power", 1.0, 1.0, 1.0, INF), "n of rheo/viscosity: must be a finite number, found inf"),
        (lambda: Viscosity("power", 1.0, 1.0, 1.0, -0.5), "n of rheo/viscosity: must not be negative, found -0.5"),
        (lambda: Viscosity("bingham", 1.0), "style of rheo/viscosity: must be constant or power, found 'bingham'"),
        (lambda: Thermal(-0.5, 1.0), "conductivity: must be finite and not negative, found -0.5"),
        (lambda: Thermal(NAN, 1.0), "conductivity: .* found nan"),
        (lambda: Thermal(1.0, 0.0), "specific/heat: must be positive, found 0.0"),
        (lambda: Thermal(1.0, INF), "specific/heat: must be positive, found inf"),
        (lambda: Thermal(1.0, 1.0, -2.0, 1.0), "latent/heat: must be finite and not negative, found -2.0"),
        (lambda: Thermal(1.0, 1.0, 2.0), "latent/heat: needs a freezing temperature"),
        (lambda: Thermal(1.0, 1.0, 2.0, NAN), "Tfreeze: must be a finite number, found nan"),
        (lambda: PairRheo(1.0, artificial_viscosity=-0.5), "artificial_viscosity of pair rheo: .* found -0.5"),
        (lambda: PairRheo(1.0, rho_damp=NAN), "rho_damp of pair rheo: must be finite and not negative, found nan"),
        (lambda: Force("push", (0.0, 0.0)), "force: must be one of gravity, addforce, setforce, found 'push'"),
        (lambda: Force("gravity", (None, -1.0)), r"gravity: needs a number for every axis .*found \(None, -1.0\)"),
        (lambda: Force("addforce", (0.0, INF)), "addforce: needs finite components, found inf"),
        (lambda: Force("setforce", (None, NAN)), "setforce: needs finite components, found nan"),
    ],
)
def test_parts(make: Any, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        make()
    one_line(caught)


FIX = {"cut", "kernel", "zmin", "rho0", "cs", "self_mass", "rho_sum", "shift", "thermal_key"}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"dimension": 4}, "dimension: must be 2 or 3, found 4"),
        ({"dimension": 1}, "dimension: must be 2 or 3, found 1"),
        ({"pair": PairRheo(2.5)}, r"cutoff of pair_style rheo: must equal that of fix rheo \(2.625\), found 2.5"),
        ({"pair": PairRheo(NAN)}, "cutoff of pair_style rheo: .* found nan"),
        ({"cut": -2.0}, "cut: must be positive, found -2.0"),
        ({"cut": 0.0}, "cut: must be positive, found 0.0"),
        ({"cut": INF}, "cut: must be positive, found inf"),
        ({"cut": NAN}, "cut: must be positive, found nan"),
        ({"kernel": "cubic"}, "kernel: must be one of quintic, RK0, RK1, RK2, found 'cubic'"),
        ({"mass_t": (1.0, 0.0)}, "mass: must be positive, found 0.0"),
        ({"mass_t": (1.0, NAN)}, "mass: must be positive, found nan"),
        ({"mass_t": (1.0,)}, r"equation of state: needs one value per atom type \(1\), found 2"),
        ({"eos": ONE_LAW}, r"equation of state: needs one value per atom type \(2\), found 1"),
        ({"viscosity": (Viscosity("constant", 1.0),)}, r"viscosity: needs one value per atom type \(2\), found 1"),
        ({"thermal": HOT}, "thermal: needs the keyword thermal of fix rheo"),
        ({"thermal_key": True}, "thermal: needs fix rheo/thermal"),
        ({"thermal_key": True, "thermal": HOT[:1]}, r"thermal: needs one value per atom type \(2\), found 1"),
        ({"eos": GAS}, "ideal/gas: needs particles with energy"),
        ({"self_mass": True}, "self/mass: is an argument of rho/sum"),
        ({"rho0": (1.0,)}, r"density: needs one value per atom type \(2\), found 1"),
        ({"cs": (1.0, 2.0, 3.0)}, r"speed/sound: needs one value per atom type \(2\), found 3"),
        ({"rho0": (1.0, -2.0)}, "density: must be positive, found -2.0"),
        ({"cs": (NAN, 1.0)}, "speed/sound: must be positive, found nan"),
        ({"shift": Shift(("3",))}, "exclude/type"),
        ({"cut": 1e-310, "pair": PairRheo(1e-310)}, "cut: must lie within 1e-100 and 1e100, .* found 1e-310"),
        ({"cut": 1e200, "pair": PairRheo(1e200)}, r"cut: must lie within .* found 1e\+200"),
        (
            {"rho0": (1.0, 1e308), "cs": (1.0, 2.0)},
            "scale of the pressure: density times speed/sound squared .* type 2",
        ),
        ({"rho0": (1e-308, 1.0), "cs": (1e-3, 2.0)}, "scale of the pressure: .* for type 1, found 1e-314"),
        ({"forces": (Force("gravity", (0.0, 0.0, -1.0)),)}, "gravity: needs 2 components, found 3"),
        ({"forces": (Force("setforce", (0.0, 0.0), (1, 3)),)}, "types of setforce: must lie within 1 to 2, found 3"),
    ],
)
def test_models(changes: dict[str, Any], message: str) -> None:
    model = scene().model
    of_fix = {"thermal" if k == "thermal_key" else k: v for k, v in changes.items() if k in FIX}
    rest = {k: v for k, v in changes.items() if k not in FIX}
    with pytest.raises(InputError, match=message) as caught:
        replace(model, fix=replace(model.fix, **of_fix), **rest)
    one_line(caught)


def put(array: str, at: Any, number: Any) -> Any:
    def change(s: State) -> dict[str, Any]:
        changed = getattr(s, array).copy()
        changed[at] = number
        return {array: changed}

    return change


def one_spot(s: State) -> dict[str, Any]:
    x_nc = s.x_nc.copy()
    x_nc[7] = x_nc[2]
    return {"x_nc": x_nc}


def one_spot_across(s: State) -> dict[str, Any]:
    """On both faces of a periodic box, which coincide."""
    x_nc = s.x_nc.copy()
    x_nc[2], x_nc[7] = (0.0, 2.5), (6.0, 2.5)
    return {"x_nc": x_nc}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s: {"x_nc": s.x_nc[:0]}, "particles: must be at least one, found 0"),
        (lambda s: {"x_nc": s.x_nc[:, :1]}, r"positions: must have the shape \(30, 2\), found \(30, 1\)"),
        (lambda s: {"v_nc": s.v_nc[1:]}, r"velocities: must have the shape \(30, 2\), found \(29, 2\)"),
        (lambda s: {"v_nc": s.v_nc[:, 0]}, r"velocities: must have the shape \(30, 2\), found \(30,\)"),
        (lambda s: {"rho_n": s.rho_n[None]}, r"density: must have the shape \(30,\), found \(1, 30\)"),
        (lambda s: {"type_n": s.type_n[1:]}, r"type: must have the shape \(30,\), found \(29,\)"),
        (lambda s: {"solid_n": s.solid_n[1:]}, r"solid: must have the shape \(30,\), found \(29,\)"),
        (lambda s: {"energy_n": s.rho_n[1:]}, r"energy: must have the shape \(30,\), found \(29,\)"),
        (put("x_nc", (4, 1), NAN), "positions: must be finite, but is not for particle 5"),
        (put("v_nc", (4, 1), INF), "velocities: must be finite, but is not for particle 5"),
        (put("rho_n", 4, NAN), "density: must be finite, but is not for particle 5"),
        (put("rho_n", 4, -0.5), "density: must be positive, but is not for particle 5, found -0.5"),
        (put("rho_n", 4, 0.0), "density: must be positive, but is not for particle 5, found 0.0"),
        (put("type_n", 4, 3), "type: must lie within 1 to 2, found 3"),
        (put("type_n", 4, 0), "type: must lie within 1 to 2, found 0"),
        (lambda s: {"type_n": s.type_n.astype(float)}, "type: must be whole numbers, found 'float64'"),
        (lambda s: {"solid_n": s.solid_n.astype(int)}, "solid: must be flags, found 'int64'"),
        (put("x_nc", 4, (6.5, 1.0)), r"position: of particle 5 must lie in the box, found \(6.5, 1.0\)"),
        (put("x_nc", 4, (1.0, -0.5)), r"position: of particle 5 must lie in the box, found \(1.0, -0.5\)"),
        (one_spot, "position: of particle 8 must differ from those of all others, found"),
        (one_spot_across, r"position: of particle 8 must differ from those of all others, found \(6.0, 2.5\)"),
    ],
)
def test_states(change: Any, message: str) -> None:
    built = scene()
    state = replace(built.state, **change(built.state))
    with pytest.raises(InputError, match=message) as caught:
        check_state(built.model, built.box, state, "the place")
    assert one_line(caught).endswith("(the place)")
    with pytest.raises(InputError, match=message):
        Simulation(built.model, built.box, state)


def test_faces_of_an_open_box_are_apart() -> None:
    built = scene(periodic=(False, True))
    state = replace(built.state, **one_spot_across(built.state))
    check_state(built.model, built.box, state)


def test_energies_of_a_thermal_model() -> None:
    built = scene(thermal=HOT)
    with pytest.raises(InputError, match="energy: must be given for every particle of a thermal model") as caught:
        check_state(built.model, built.box, replace(built.state, energy_n=None))
    one_line(caught)


def test_gas_has_no_negative_energy() -> None:
    """Its speed of sound would be imaginary; to conduction alone the zero of energies is arbitrary."""
    built = scene(thermal=HOT)
    energy_n = np.where(np.arange(30) == 4, -0.5, 1.0)
    state = replace(built.state, energy_n=energy_n)
    check_state(built.model, built.box, state)
    gas = replace(built.model, eos=EOSTable((EOS("ideal/gas", parameter=1.4),) * 2))
    with pytest.raises(InputError, match="energy: of gas particle 5 must not be negative") as caught:
        check_state(gas, built.box, state)
    one_line(caught)
    check_state(gas, built.box, replace(state, energy_n=np.maximum(energy_n, 0.0)))


def test_box_of_another_dimension() -> None:
    built = scene()
    with pytest.raises(InputError, match="box: needs 2 axes, found 3") as caught:
        check_state(built.model, Box((0, 0, 0), (9, 9, 9), (True,) * 3), built.state)
    one_line(caught)


def test_summed_densities_need_no_initial_one() -> None:
    built = scene(rho_sum=True)
    check_state(built.model, built.box, replace(built.state, rho_n=np.zeros(30)))


def test_properties() -> None:
    built = scene(kernel="RK2", shift=Shift(("2",)))
    model = built.model
    assert (model.cut, model.h, model.order) == (2.625, 0.875, 2)
    assert model.corrects_gradients
    assert model.shifted_t.tolist() == [True, False]
    assert [scene(kernel=k).model.corrects_gradients for k in ("quintic", "RK0", "RK1")] == [False, False, True]
    bare = replace(model, fix=replace(model.fix, rho0=None, cs=None))
    assert bare.rho0.tolist() == bare.cs.tolist() == [1.0, 1.0], "defaults of fix rheo"
    assert built.box.edge_c == (6.0, 5.0)
    assert model.eos == TWO_LAWS
    assert Force("gravity", (0.0, 0.0), (2,)).acts_on(np.array([1, 2, 2])).tolist() == [False, True, True]
    assert Force("gravity", (0.0, 0.0)).acts_on(np.array([1, 2])).all()


# --- commands

VISCOUS, HEATED = "fix 2 all rheo/viscosity ", "fix 5 all rheo/thermal "


def test_commands_of_the_manual() -> None:
    assert parse_pair_style_rheo("pair_style rheo 3.0 rho/damp 1.0 artificial/visc 2.0") == PairRheo(3.0, 2.0, 1.0)
    assert parse_pair_style_rheo("pair_style rheo 3.0 harmonic/means") == PairRheo(3.0, harmonic_means=True)
    assert parse_fix_rheo_viscosity(VISCOUS + "1 constant 1.0 2 power 0.1 5e-4 0.001 0.5", 2) == (
        Viscosity("constant", 1.0),
        Viscosity("power", 0.1, 5e-4, 0.001, 0.5),
    )
    text = HEATED + "conductivity * constant 1 specific/heat * constant 2 Tfreeze 2 constant 3 latent/heat 2 constant 4"
    assert parse_fix_rheo_thermal(text, 2) == (Thermal(1, 2), Thermal(1, 2, 4, 3))
    text = HEATED + "react 1.5 1 conductivity * constant 1 conductivity 2 constant 5 specific/heat * constant 2"
    assert parse_fix_rheo_thermal(text, 2) == (Thermal(1, 2), Thermal(5, 2)), "the last value counts"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("pair_style rheo", "cutoff of pair rheo: is missing"),
        ("pair_style rheo 0", "cutoff of pair rheo: must be positive"),
        ("pair_style RHEO 3.0", "pair style: must be one of rheo"),
        ("pair_style rheo 3.0 rho/damp", "rho/damp of pair rheo: is missing"),
        ("pair_style rheo 3.0 rho/damp -1", r"rho_damp of pair rheo: must be .* not negative, found -1.0 \(pair_style"),
        ("pair_style rheo 3.0 damp 1", "pair_style rheo: takes nothing more, found 'damp'"),
        (VISCOUS, "types and viscosity style: is missing"),
        (VISCOUS + "1 constant 1", "atom type 2: needs a viscosity"),
        (VISCOUS + "* newton 1", "viscosity style: must be one of constant, power"),
        (VISCOUS + "* power 1 1 1", "n of rheo/viscosity power: is missing"),
        (VISCOUS + "* power 1 1 1 -0.5", "n of rheo/viscosity: must not be negative, found -0.5"),
        (HEATED + "conductivity * constant 1", "atom type 1: needs a specific/heat"),
        (HEATED + "conductivity * 1", "style of conductivity: must be one of constant"),
        (HEATED + "conductivity * constant 1 specific/heat * constant 0", "specific/heat: must be positive, found 0.0"),
        (HEATED + "react 0 1", "cut of react: must be positive"),
        (HEATED + "react 1 0", "type of react: must be a bond type"),
        (HEATED + "heat * constant 1", "attribute of rheo/thermal: must be one of"),
    ],
)
def test_bad_commands_of_properties(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        if text.startswith("pair"):
            parse_pair_style_rheo(text)
        elif text.startswith(VISCOUS):
            parse_fix_rheo_viscosity(text, 2)
        else:
            parse_fix_rheo_thermal(text, 2)


# --- units

CALORIE, CHARGE, MOLE = 4.184, 1.602176634e-19, 6.02214076e23  # J, C, 1/mol (SI since 2019)
UNIT_OF_ENERGY = {"real": 1000 * CALORIE / MOLE, "metal": CHARGE}
UNIT_OF_PRESSURE = {"real": 101325.0, "metal": 1e5}
# How far constants of any age may lie from today's: Avogadro's constant and the charge of CODATA 1986, added.
SINCE_1986 = abs(6.0221367e23 / MOLE - 1) + abs(1.60217733e-19 / CHARGE - 1)


@pytest.mark.parametrize("name", ["real", "metal"])
def test_factors_are_ratios_of_units(name: str) -> None:
    """To the accuracy of LAMMPS' constants, which predate today's definitions."""
    u = UNITS[name]
    energy = u.mass * u.length**2 / u.time**2
    assert u.mass == pytest.approx(1e-3 / MOLE, rel=SINCE_1986, abs=0)
    assert u.energy == pytest.approx(UNIT_OF_ENERGY[name] / energy, rel=SINCE_1986, abs=0)
    assert u.pressure == pytest.approx(UNIT_OF_PRESSURE[name] / (energy / u.length**3), rel=SINCE_1986, abs=0)
    assert u.density == pytest.approx(1000.0 / (u.mass / u.length**3), rel=SINCE_1986, abs=0)
    assert u.viscosity == pytest.approx(0.1 / (energy * u.time / u.length**3), rel=SINCE_1986, abs=0)


def test_other_systems_have_no_factors() -> None:
    assert {name for name, u in UNITS.items() if not u.consistent} == {"real", "metal"}
    assert all(UNITS["si"].of(name) == 1 for name in QUANTITIES)


def test_every_quantity_with_mass_has_a_kind() -> None:
    """Mass comes in through energy, pressure, density and viscosity alone; so a new field cannot be forgotten."""
    u = UNITS["metal"]
    with_mass = {name for name, q in QUANTITIES.items() if q.dimension.mass}
    assert {name for name in QUANTITIES if u.of(name) != 1} == with_mass | {"cv"}
    shapes = {kind: {QUANTITIES[n].dimension.volume for n in names if n in QUANTITIES} for kind, names in KINDS.items()}
    assert shapes["density"] == shapes["viscosity"] == {-1}
    assert shapes["pressure"] == {-1, 0}  # stress/atom is a pressure times a volume


def test_unit_of_a3_follows_from_the_formula() -> None:
    assert UNITS["real"].of("A3") == rounded(UNITS["real"].density ** -2, 3)


# --- models in units

REAL = UNITS["real"]
MODEL = Model(
    dimension=3,
    fix=FixRheo(3.0, "quintic", 0, thermal=True, rho0=(1.1, 0.9), cs=(0.2, 0.3)),
    mass_t=(1.3, 0.7),
    eos=EOSTable((EOS("cubic", 1.1, 0.2, 2.1, 0.4), EOS("tait/general", 0.9, 0.3, 2.3))),
    pair=PairRheo(3.0, 0.3, 0.1, True),
    viscosity=(Viscosity("constant", 0.4), Viscosity("power", 0.5, 1e-4, 0.3, 0.6)),
    thermal=(Thermal(0.3, 0.4, 0.02, 1.7), Thermal(0.2, 0.6)),
    forces=(Force("gravity", (0.1, 0.2, -0.3)), Force("setforce", (None, 0.4, 0.0), (2,))),
    units="real",
)
BOX = Box((0.0,) * 3, (7.0,) * 3, (True,) * 3)
OUTPUTS = (
    *("grad/v", "viscosity", "pressure", "stress/t", "temperature", "heatflow"),
    *("energy", "drho", "f", "rho", "v"),
)


def state_in_units() -> State:
    random = np.random.default_rng(5)
    n = 30
    return State(
        random.uniform(0.5, 6.5, (n, 3)),
        random.uniform(-0.1, 0.1, (n, 3)),
        random.uniform(0.8, 1.2, n),
        np.arange(n) % 2 + 1,
        np.zeros(n, bool),
        random.uniform(1.0, 2.0, n),
    )


def test_prediction_is_the_same_in_consistent_numbers() -> None:
    """Every parameter has its factor, and every output the inverse one."""
    plain = consistent_model(MODEL, REAL)
    assert plain.units == "lj" and plain.cut == MODEL.cut and plain.fix.cs == MODEL.fix.cs
    of_units = Simulation(MODEL, BOX, state_in_units(), OUTPUTS)
    by_hand = Simulation(plain, BOX, consistent_state(state_in_units(), REAL), OUTPUTS)
    for sim in (of_units, by_hand):
        sim.run(2, 1e-3)
    for field in OUTPUTS:
        np.testing.assert_array_equal(of_units.output(field), by_hand.output(field) / REAL.of(field))


def test_newton_in_units_real() -> None:
    """A force of 1 kcal/mol/Angstrom accelerates 1 g/mol by 4.184e-4 Angstrom/fs^2.

    LAMMPS' factor is 1/48.88821291^2, of which half a unit of the last digit is twice 0.5e-8/48.9.
    """
    alone = State(np.full((1, 3), 3.0), np.zeros((1, 3)), np.ones(1), np.ones(1, int), np.zeros(1, bool))
    one = replace(MODEL.fix, rho0=(1.0,), cs=(1.0,), thermal=False)
    model = Model(
        3, one, (1.0,), EOSTable((EOS("linear"),)), PairRheo(3.0), (Viscosity("constant", 0.0),), units="real"
    )
    model = replace(model, forces=(Force("setforce", (1.0, 0.0, 0.0)),))
    sim = Simulation(model, BOX, alone)
    sim.run(1, 2.0)
    assert sim.output("v")[0] == pytest.approx([2 * 4.184e-4, 0, 0], rel=2 * 0.5e-8 / 48.88821291, abs=0)


def test_consistent_units_change_nothing() -> None:
    si = replace(MODEL, units="si")
    assert consistent_model(si, UNITS["si"]) is si
    assert consistent_state(of := state_in_units(), UNITS["si"]) is of


def test_units_are_refused() -> None:
    with pytest.raises(InputError, match=r"units: must be one of lj, si.*nautical"):
        replace(MODEL, units="nautical")
    with pytest.raises(InputError, match="must not be real or metal in 2D"):
        replace(MODEL, dimension=2, forces=())
