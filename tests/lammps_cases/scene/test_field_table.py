"""The table of fields: every field is complete, and a new one is two records, a formula, a line and a row."""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.parameters import Model
from eos_ref.model.quantities import QUANTITIES, evaluated_for, order, required
from lammps_cases.audit import fields as audit
from lammps_cases.audit.deck import Deck
from lammps_cases.engine.session import Answer
from lammps_cases.records.run_record import CaseRecord, EngineRecord
from lammps_cases.run import flow, prepared_case
from lammps_cases.scene import Scene, casefile
from lammps_cases.scene.casefile import Case
from lammps_cases.scene.fields import FIELDS, in_step_order
from lammps_cases.setup import commands
from lammps_cases.setup.plan import plan
from lammps_cases.verdict.case_arrays import snapshot
from lammps_cases.verdict.problems import problem_of
from tests.support.outcome import Solver
from tests.support.walk import after, walk
from tests.workshop.faults import output_faults
from tests.workshop.faults.substitute import in_place_of

ENGINE = EngineRecord(name="env", distribution=version("lammps"))
RICH: dict[str, Any] = {
    "types": [{"mass": 0.9, "rho0": 1.1, "cs": 9.0, "conductivity": 0.7, "specific_heat": 1.5}],
    "positions": {"lattice": "sq", "spacing": 1.0, "cells": [8, 9], "disorder": 0.1},
    "pressure": [{"types": "*", "style": "linear"}],
    "rho": {"ratio": [0.98, 1.03]},
    "energy": {"range": [0.8, 1.3]},
    "velocity": {"random": 0.1},
    "rheo": {
        "interface_reconstruct": True,
        "surface_detection": {"style": "divergence", "limit": 1.6, "splash": 10},
        "shift": True,
    },
    "compare": list(FIELDS),
}
Make = Callable[..., Case]


@pytest.fixture
def make(case_file: Callable[..., Path]) -> Make:
    def case(**changes: Any) -> Case:
        (made,) = casefile.load_file(case_file(**{**RICH, **changes}))
        return made

    return case


def model_of(case: Case) -> Model:
    return problem_of(case.scene, prepared_case.prepare(case).atoms, case.where, (0,)).model


def answered(solver: Solver, case: Case) -> tuple[prepared_case.PreparedCase, Answer]:
    ready = prepared_case.prepare(case)
    return ready, solver(ready.jobs[0])


def judged(ready: prepared_case.PreparedCase, answer: Answer) -> CaseRecord:
    return flow.judge(None, ready, [answer], ENGINE)[0]


# --- every field


def test_every_derived_table_has_every_field(make: Make) -> None:
    case = make()
    model, atoms = model_of(case), prepared_case.prepare(case).atoms
    job = commands.job(case.scene, atoms, plan(case.scene))
    written = next(line for line in job.commands if line.startswith("compute q "))
    setting = audit.Setting(Deck(), "lj")
    for name, field in FIELDS.items():
        quantity = QUANTITIES[name]
        assert (field.name, field.quantity) == (name, quantity)
        assert set(evaluated_for(model, name)) <= set(QUANTITIES) and set(required(model, [name])) <= set(order())
        assert field.column or field.array or field.compute
        assert (f" {field.words()} " in f"{written} ") == bool(field.column)
        assert name in job.outputs if field.column else field.array in job.atom_arrays or field.compute
        assert bool(field.compute) == (field.compute_id in {compute.id for compute in job.computes})
        assert field.key in output_faults.REAL | output_faults.WHOLE | output_faults.PER_TYPE
        assert (name in audit.offered()) == (field.unaudited is not None)
        assert audit.why_not(name, model, setting) or name in audit.checked() or name not in audit.offered()
    assert in_step_order(reversed(FIELDS)) == list(FIELDS)
    assert Scene.model_json_schema()["properties"]["compare"]["items"]["enum"] == list(FIELDS)


@pytest.mark.lammps
def test_every_field_is_output_by_both_sides(make: Make, solver: Solver) -> None:
    """LAMMPS and the reference give arrays of the same shape, that of the rank; LAMMPS' can be converted back."""
    case = make()
    ready, answer = answered(solver, case)
    shown = snapshot(case.scene, answer.arrays)
    problem = problem_of(case.scene, ready.atoms, case.where, (0,))
    sim = Simulation(problem.model, problem.box, problem.state, problem.fields)
    sim.setup()
    for name in FIELDS:
        shape = (len(ready.atoms), *(2,) * QUANTITIES[name].rank)
        assert np.shape(shown[name]) == np.shape(sim.output(name)) == shape, name
    back = in_place_of(answer.arrays, {name: np.array(values, float) for name, values in shown.items()})
    assert back.keys() == answer.arrays.keys()
    assert all(np.array_equal(back[name], answer.arrays[name]) for name in back)


def test_field_without_its_keyword_is_refused(make: Make) -> None:
    bare = make(rheo={}, energy=None, types=[{"mass": 0.9}], compare=["f"])
    for name, quantity in QUANTITIES.items():
        has = name in FIELDS and not QUANTITIES[quantity.whole].keyword
        if name in FIELDS and not has:
            with pytest.raises(Exception, match=f"{name} needs "):
                make(rheo={}, energy=None, types=[{"mass": 0.9}], compare=[name])
            with pytest.raises(Exception, match="is not part of this model"):
                required(model_of(bare), [name])


# --- a new one

EDITS = {
    "eos_ref/model/quantities.py": after(
        'output=_thermal("specific_heat")),\n',
        '        Quantity("compression", "compressions", PRESSURE, inputs=("rho",)),\n',
    ),
    "eos_ref/evaluation/evaluator.py": after(
        "        return self._pressures[2]\n",
        """
    def compression(self, rho_n: Array) -> Array:
        \"\"\"Return the pressures of a linear law, (n,).\"\"\"
        return self.cs_n * self.cs_n * (rho_n - self.rho0_n)
""",
    ),
    "eos_ref/evaluation/time_step.py": after(
        'of a particle that the plan has: viscosity, pressure, temperature."""\n'
        "        s, e, fields, plan = self.state, self.evaluator, self.fields, self.plan\n",
        '        if "compression" in plan:\n            fields["compression"] = e.compression(s.rho_n)\n',
    ),
    "lammps_cases/scene/fields.py": after(
        '_column("pressure", "eos", "pressure"),\n', '        Field("compression", "eos", column="pressure"),\n'
    ),
    "eos_ref/NUMERICS.md": after(
        "| `cv` | specific heats | scalar | output | thermal |\n",
        "| `compression` | compressions | scalar | evaluation | |\n",
    ),
}


@pytest.mark.lammps
@pytest.mark.slow
def test_new_field_is_complete_in_five_files(tmp_path: Path) -> None:
    """From the schema through real LAMMPS to the verdict and the blame."""
    assert len(EDITS) <= 5
    printed = walk(tmp_path, EDITS, "use_new_field.py")  # followed by the cases of this name
    assert printed.startswith(
        "compression: compressions (scalar), of the stage eos; LAMMPS: compute rheo/property/atom pressure\n"
    )
