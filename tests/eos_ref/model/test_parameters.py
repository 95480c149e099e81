"""Bad input of the particle model is refused in one line that names the value; good input passes."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from eos_ref import EOS, EOSTable, InputError
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.box import Box
from eos_ref.model.parameters import Force, PairRheo, Thermal, Viscosity
from eos_ref.model.state import State, check_state
from eos_ref.syntax.fixes import Shift
from tests.support.particle_scenes import HOT, TWO_LAWS, scene

NAN, INF = math.nan, math.inf
ONE_LAW = EOSTable((EOS("linear"),))
GAS = EOSTable((EOS("ideal/gas", parameter=1.4), EOS("linear")))


def one_line(caught: Any) -> str:
    text = str(caught.value)
    assert "\n" not in text
    assert len(text) < 200
    return text


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (((0, 0), (1, 1), (True,)), "box: needs low, high and periodic for 2 or 3 axes"),
        (((0,), (1,), (True,)), "box: needs .* found 1"),
        (((0, 0), (1, 0), (True, True)), r"box: needs finite edges with low < high, found \(0, 0\)"),
        (((0, 2), (1, 1), (True, True)), r"box: .* found \(2, 1\)"),
        (((0, NAN), (1, 1), (True, True)), r"box: .* found \(nan, 1\)"),
        (((0, 0), (INF, 1), (True, True)), r"box: .* found \(0, inf\)"),
        (((0, 0), (1, 1), (True, True), (0.5, 0.0)), r"tilt of the box: must be xy in 2D, .* found \(0.5, 0.0\)"),
        (((0, 0), (1, 1), (True, True), (NAN,)), r"tilt of the box: must be finite, .* found \(nan,\)"),
        (((0, 0), (1, 1), (False, True), (0.5,)), r"tilt of the box: .* 0 but between periodic axes, found \(0.5,\)"),
    ],
)
def test_boxes(arguments: Any, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        Box(*arguments)
    one_line(caught)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Viscosity("constant", NAN), "eta of rheo/viscosity: must be a finite number, found nan"),
        (lambda: Viscosity("constant", -1.5), "eta of rheo/viscosity: must not be negative, found -1.5"),
        (
            lambda: Viscosity("power", 1.0, 0.0, 1.0, 0.5),
            "gd0 of rheo/viscosity: must be positive for power, found 0.0",
        ),
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


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"cut": 1e-310}, "cut: must lie within 1e-100 and 1e100, .* found 1e-310"),
        ({"cut": 1e200}, r"cut: must lie within .* found 1e\+200"),
        (
            {"rho0": (1.0, 1e308), "cs": (1.0, 2.0)},
            "scale of the pressure: density times speed/sound squared .* type 2",
        ),
        ({"rho0": (1e-308, 1.0), "cs": (1e-3, 2.0)}, "scale of the pressure: .* for type 1, found 1e-314"),
    ],
)
def test_scales_beyond_floating_point_are_refused(change: Any, message: str) -> None:
    model = scene().model
    with pytest.raises(InputError, match=message) as caught:
        replace(model, fix=replace(model.fix, **change), pair=PairRheo(change.get("cut", model.cut)))
    one_line(caught)


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
