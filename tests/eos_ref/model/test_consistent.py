"""A model in its own units must predict the same as the model in consistent numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eos_ref import EOS, EOSTable, InputError
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.box import Box
from eos_ref.model.consistent import consistent_model, consistent_state
from eos_ref.model.parameters import Force, Model, PairRheo, Thermal, Viscosity
from eos_ref.model.state import State
from eos_ref.model.units import UNITS
from eos_ref.syntax.fixes import FixRheo

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
FIELDS = ("grad/v", "viscosity", "pressure", "stress/t", "temperature", "heatflow", "energy", "drho", "f", "rho", "v")


def state() -> State:
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
    of_units = Simulation(MODEL, BOX, state(), FIELDS)
    by_hand = Simulation(plain, BOX, consistent_state(state(), REAL), FIELDS)
    for sim in (of_units, by_hand):
        sim.run(2, 1e-3)
    for field in FIELDS:
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
    assert consistent_state(of := state(), UNITS["si"]) is of


def test_refused() -> None:
    with pytest.raises(InputError, match=r"units: must be one of lj, si.*nautical"):
        replace(MODEL, units="nautical")
    with pytest.raises(InputError, match="must not be real or metal in 2D"):
        replace(MODEL, dimension=2, forces=())
