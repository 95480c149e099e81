"""Input perturbed by the rounding of a unit conversion: only converted values move, at most by the rounding."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from lammps_cases.comparison.perturbation import ROUNDING, moved_input
from lammps_cases.comparison.problem import Problem
from lammps_cases.comparison.trajectory import MOVED_RUNS, input_spread, predict
from lammps_cases.run import prepared_case
from lammps_cases.scene import casefile
from lammps_cases.verdict.problems import problem_of

SCENE = {
    "dimension": 3,
    "types": [{"mass": 1.3, "rho0": 1.2, "cs": 6.1, "viscosity": {"eta": 0.4, "gd0": 0.3, "K": 0.2, "n": 0.5}}],
    "positions": {"lattice": "sc", "spacing": 0.9, "cells": [3, 3, 3], "disorder": 0.1},
    "pressure": [{"types": "*", "style": "cubic", "A3": 2.1}],
    "rheo": {"surface_detection": {"style": "coordination", "limit": 20, "splash": 9}},
    "rho": {"ratio": [0.9, 1.1]},
    "velocity": {"random": 0.3},
    "compare": ["f", "pressure"],
}


def problem(case_file: Callable[..., Path], units: str = "lj") -> Problem:
    (case,) = casefile.load_file(case_file(**SCENE, units=units))
    return problem_of(case.scene, prepared_case.prepare(case).atoms, "", (0,))


def test_everything_moves_a_little(case_file: Callable[..., Path]) -> None:
    one = problem(case_file)
    own = {"energy_n": one.state.rho_n + 1, "mass_n": one.state.rho_n + 2}
    one = replace(one, state=replace(one.state, **own), timestep=0.3)
    other = moved_input(one, np.random.default_rng(1))
    for name in ("x_nc", "v_nc", "rho_n", *own):
        ours, theirs = getattr(one.state, name), getattr(other.state, name)
        far = (theirs - ours) / ours
        assert np.abs(np.abs(far) - ROUNDING).max() < 2.0**-52
        assert far.min() < 0 < far.max(), "each by itself"
    assert abs(abs(other.timestep / one.timestep - 1) - ROUNDING) < 2.0**-52
    model, moved = one.model, other.model
    assert moved.mass_t != model.mass_t and moved.fix.rho0 != model.fix.rho0 and moved.viscosity != model.viscosity
    assert moved.eos[1].parameter != model.eos[1].parameter
    assert (moved.cut, moved.pair.cut, moved.fix.surface_detection) == (
        model.cut,
        model.pair.cut,
        model.fix.surface_detection,
    )


def test_fraction_of_one_stays_one(case_file: Callable[..., Path]) -> None:
    shift = {"scale_cross_type": [1.0, 0.1, 0.3]}
    (case,) = casefile.load_file(case_file(**(SCENE | {"rheo": {"shift": shift}})))
    one = problem_of(case.scene, prepared_case.prepare(case).atoms, "", (0,))
    for seed in range(9):
        setting = moved_input(one, np.random.default_rng(seed)).model.fix.shift
        assert setting and setting.scale_cross_type
        assert setting.scale_cross_type[0] == 1.0 and setting.scale_cross_type[2] != 0.3


def test_bounds_of_converted_units_hold_it(case_file: Callable[..., Path]) -> None:
    """In units real a run from perturbed input lies within the bound, which is wider than in consistent units."""
    real = problem(case_file, "real")
    prediction = predict(real)
    moved = predict(moved_input(real, np.random.default_rng(99)))
    plain = predict(replace(real, model=replace(real.model, units="lj")))
    for field in ("f", "pressure"):
        far = np.abs(moved.fields[0][field] - prediction.fields[0][field])
        assert far.max() <= prediction.bounds[0][field].max()
        relative = [(p.bounds[0][field] / np.abs(p.fields[0][field]).max()).max() for p in (prediction, plain)]
        assert relative[0] > relative[1]


def test_spread_of_perturbed_input_is_that_of_its_runs(case_file: Callable[..., Path]) -> None:
    """The largest distance from the unperturbed run; the same in every process."""
    real = problem(case_file, "real")
    (values,) = predict(real).fields
    (spread,) = input_spread(real, ArrayEvaluator, Simulation, [values], seed=5)
    runs = [predict(moved_input(real, np.random.default_rng((5, k, 1)))).fields[0] for k in range(MOVED_RUNS)]
    for field in real.fields:
        assert spread[field] == max(np.abs(run[field] - values[field]).max() for run in runs) > 0
