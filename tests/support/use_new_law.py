"""Every use of a law, run for the stiffened gas that `test_new_law` adds to a copy of the packages."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from eos_ref import EOS, STYLES, EOSTable, InputError, parse_fix_rheo_pressure, resolve
from eos_ref.eos import bounds, lammps_rounding, rigorous, rounded_eos
from eos_ref.eos.table import examples
from eos_ref.methods import choice
from eos_ref.methods.laws import methods_of
from eos_ref.numbers.rounded import Rounded
from lammps_cases.audit import scaling
from lammps_cases.comparison.compare import EosState, compare_pressure
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import build
from lammps_cases.scene.casefile import Case
from lammps_cases.scene.particles import entries
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan
from lammps_cases.studies.chart import laws as chart
from lammps_cases.studies.flows.catalogue import FLOWS
from lammps_cases.verdict import mistakes
from tests.eos_ref.test_numerics_page import PAGE, of_laws

STYLE, GAMMA, RHO0, CS = "stiffened/gas", 1.7, 1.25, 3.5
random = np.random.default_rng(3)
rho_n, e_n, mass_n = random.uniform(0.5, 3.0, 5000), random.uniform(1.0, 30.0, 5000), random.uniform(0.5, 2.0, 5000)
law = EOS(STYLE, RHO0, CS, GAMMA, background=0.3)
plain_n = (GAMMA - 1) * rho_n * e_n - CS**2 * RHO0 + 0.3

# EOS, compiled loop, bounds, Arb, LAMMPS' roundings
p_n = law.pressure(rho_n, e_n)
bound_n = bounds.reference(law, rho_n, e_n)
for rho, e, p, bound in zip(rho_n[:300], e_n[:300], p_n[:300], bound_n[:300], strict=True):
    exact = rigorous.pressure(law, float(rho), float(e))
    assert rigorous.error(float(p), exact) <= bound
    assert rigorous.error(float(law.evaluate(rho, e)), exact) <= bound
assert np.all(np.abs(p_n - plain_n) <= bounds.engine(law, rho_n, e_n) + bound_n)
theirs_n = lammps_rounding.pressure_of_law(law, rho_n, e_n * mass_n, mass_n)
assert np.all(np.abs(p_n - theirs_n) <= bounds.engine(law, rho_n, e_n) + bound_n)
assert "c^2 rho0" in bounds.comparison_derivation(law)

# inverse and derivative, plain and with rounding errors
lost_n = (bounds.engine(law, rho_n, e_n) + bound_n) / ((GAMMA - 1) * e_n)  # of the pressure, in both directions
assert np.all(np.abs(law.density(p_n, e_n) - rho_n) <= 2 * lost_n)
assert np.array_equal(law.stiffness(rho_n, e_n), (GAMMA - 1) * e_n)
carried = rounded_eos.pressure(law, Rounded(rho_n, 1e-9 * rho_n), Rounded(e_n, 1e-9 * e_n))
assert np.all(carried.error >= 1e-9 * np.abs((GAMMA - 1) * rho_n * e_n))
assert law.is_defined(rho_n).all()
for wrong in ({"parameter": 1.0}, {"parameter": None}):
    try:
        EOS(STYLE, **wrong)
    except InputError as error:
        assert "gamma" in str(error)
    else:
        raise AssertionError(wrong)

# a table with other laws: every particle by its own
table = EOSTable((EOS("linear", RHO0, CS), EOS("tait/general", RHO0, CS, 1.4), EOS("ideal/gas", parameter=1.4), law))
type_n = random.integers(1, 5, rho_n.size)
mixed_n = table.pressure(rho_n, type_n, e_n)
for t in (1, 2, 3, 4):
    at = type_n == t
    assert np.array_equal(mixed_n[at], table[t].pressure(rho_n[at], e_n[at]))

# command text, methods without a measured cost
read = resolve(parse_fix_rheo_pressure(f"fix p all rheo/pressure * {STYLE} 1.7"), 2)
assert [eos.style for eos in read] == [STYLE, STYLE]
assert [eos.style for eos in examples()] == list(STYLES)
assert choice.AUTO == "auto" and STYLE not in choice.measured()
assert np.array_equal(law.pressure(rho_n, e_n, method="auto", tolerance=1e-6), p_n)

# scene: checks, plan, LAMMPS' commands, lint
scene = Scene.model_validate(
    {
        "dimension": 2,
        "types": [{"mass": 1.0, "rho0": RHO0, "cs": CS}],
        "positions": {"lattice": "sq", "spacing": 1.0, "cells": [6, 6]},
        "pressure": entries(law),
        "rho": {"range": [0.5, 3.0]},
        "energy": {"range": [1.0, 30.0]},
    }
)
atoms = build(Case("new", "", (), scene, Path("new")), scene.eos())
of_scene = plan(scene)
assert next(item.why for item in of_scene.reference if item.name == "energy") == f"input of {STYLE}"
commands = "\n".join(job(scene, atoms, of_scene).commands)
assert f"rheo/pressure * {STYLE} 1.7 * background 0.3" in commands, commands
one, every_n = EOSTable((law,)), np.ones(rho_n.size, int)
state = EosState(np.arange(rho_n.size) + 1, every_n, rho_n, mass_n, e_n * mass_n)
own_n = bounds.comparison(one, rho_n, every_n, e_n)
blind = mistakes.undetected_in_laws(one, state, one.pressure(rho_n, every_n, e_n), own_n)
assert blind == [], blind
assert compare_pressure(one, state, theirs_n).record.verdict == "exact"

# schema, flows, diagnosis, audit of decks in another unit of length
assert STYLE in json.dumps(Scene.model_json_schema()) and scene.defaults == ()
assert f"sound-wave-{STYLE.replace('/', '-')}" in FLOWS
assert scaling.FIXES["rheo/pressure"].keywords[STYLE] == (None,)

# a curve in the chart, of every method that evaluates the law
regime = chart.REGIMES[2]
assert {STYLE, *STYLES} == {each.style for each in chart.LAWS}
errors = {each.name: chart.worst_of(None, law, each.name, regime, 64).error for each in methods_of(law)}
assert {"compiled", "numpy"} <= errors.keys() and all(0 <= each < 1e-3 for each in errors.values()), errors

# NUMERICS.md
assert all(f"\n{row}" in PAGE.read_text() for row in of_laws())

print(STYLE)
