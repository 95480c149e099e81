"""Every use of a kernel, run for the two styles that `test_another_kernel` adds to a copy of the packages."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.kernels.styles import KERNELS
from eos_ref.syntax.fixes import parse_fix_rheo
from lammps_cases.comparison.trajectory import predict
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import build
from lammps_cases.scene.casefile import Case
from lammps_cases.setup import reference_side
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan
from lammps_cases.studies.chart import flows
from lammps_cases.studies.chart import kernels as chart
from lammps_cases.studies.flows.flow import relative
from lammps_cases.studies.stability.maps import matrices
from lammps_cases.verdict.diagnosis.reached import MODULES
from lammps_cases.verdict.diagnosis.triage import features
from lammps_cases.verdict.mistakes import undetected_in_model
from lammps_cases.verdict.problems import problem_of
from tests.eos_ref.test_numerics_page import PAGE, of_kernels

PLAIN, CORRECTED = "wendland", "WRK1"
REGIONS = [{"type": 1, "low": [0, 0], "high": [1, 1]}, {"type": 2, "low": [0, 0], "high": [0.5, 1]}]
schema = json.dumps(Scene.model_json_schema())
found = {}
for style in (PLAIN, CORRECTED, "quintic", "RK1"):
    # command text, schema, scene, plan and LAMMPS' commands
    assert parse_fix_rheo(f"fix r all rheo 3.0 {style} 0", 1).kernel == style and f'"{style}"' in schema
    scene = Scene.model_validate(
        {
            "dimension": 2,
            "types": [{"mass": 0.9, "rho0": 1.1, "cs": 9.0}, {"mass": 0.7, "rho0": 0.8, "cs": 7.0, "viscosity": 0.3}],
            "positions": {"lattice": "sq", "spacing": 1.0, "cells": [8, 8], "disorder": 0.2, "regions": REGIONS},
            "pressure": [{"types": "*", "style": "tait/water"}],
            "rho": {"ratio": [0.9, 1.1]},
            "velocity": {"random": 0.3},
            "rheo": {"kernel": style},
            "evolve": {"steps": 2, "timestep": 0.001, "compare_at": [0, 2]},
            "compare": ["f", "grad/v", "rho"],
        }
    )
    case = Case("new", "", (), scene, Path("new"))
    atoms = build(case, scene.eos())
    assert any(line.startswith("fix ") and f" {style} 0" in line for line in job(scene, atoms, plan(scene)).commands)

    # predicted with a bound, linted, sorted by features
    problem = problem_of(scene, atoms, case.where, (0, 2))
    prediction = predict(problem)
    for bounds in prediction.bounds:
        for field in scene.compare:
            bound_n = bounds[field]
            assert np.all(np.isfinite(bound_n)) and np.max(bound_n) < 1e-9, (style, field)
    assert undetected_in_model(problem, prediction) == []
    assert f"kernel {style}" in features(scene)
    found[style] = prediction.fields[0]["grad/v"]
assert len({values.tobytes() for values in found.values()}) == 4

# formulas that a red case may have wrong, stability maps
assert "kernels.wendland" in MODULES
for each, layers in ((matrices.LATTICE, 1), (matrices.ZMIN, 2), (matrices.SURFACE, 2)):
    assert sum(CORRECTED in layer for layer in each.layers) == layers and PLAIN not in each.layers
    assert CORRECTED in {theory.layer for theory in each.theory}

# a curve in the chart: an error for every cutoff
assert {PLAIN, CORRECTED} <= set(flows.STYLES)
methods = {method.name: method for method in chart.gradients((2.0, 3.0), 0.1, 16)}
for style in (PLAIN, CORRECTED):
    for cut in (2, 3):
        method = methods[f"{style}, cutoff {cut}"]
        scene, at = method.setup.case.scene, method.setup.atoms
        sim = reference_side.simulation(scene, at, ("grad/v",), "new", evaluator=ArrayEvaluator)
        sim.evaluate()
        exact = chart.gradient(at.x_nc)
        error = relative(sim.output("grad/v") - exact, exact)
        assert 1e-4 < error < 0.5 and method.reason == KERNELS[style].about, (style, cut, error)

# NUMERICS.md
assert all(f"\n{row}" in PAGE.read_text() for row in of_kernels())

print(PLAIN, CORRECTED)
