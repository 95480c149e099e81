"""Every use of a field, run for the one that `test_field_table` adds to a copy of the packages.

For a linear law it is the pressure, which real LAMMPS outputs.
"""

from __future__ import annotations

from contextlib import closing
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from eos_ref import EOS
from eos_ref.evaluation.evaluator import Evaluator
from eos_ref.model.units import UNITS
from lammps_cases.audit import fields as audit
from lammps_cases.audit.deck import Deck
from lammps_cases.cli import explain
from lammps_cases.engine.session import Session
from lammps_cases.records.run_record import EngineRecord
from lammps_cases.run import flow, prepared_case
from lammps_cases.scene import Scene
from lammps_cases.scene.casefile import Case
from lammps_cases.setup import twins
from lammps_cases.setup.plan import plan
from lammps_cases.verdict.case_arrays import snapshot
from lammps_cases.verdict.problems import problem_of
from tests.eos_ref.test_numerics_page import PAGE, of_quantities
from tests.workshop.faults import output_faults

NEW = "compression"
assert NEW in Scene.model_json_schema()["properties"]["compare"]["items"]["enum"]
scene = Scene.model_validate(
    {
        "dimension": 2,
        "types": [{"mass": 0.9, "rho0": 1.1, "cs": 9.0}],
        "positions": {"lattice": "sq", "spacing": 1.0, "cells": [8, 9], "disorder": 0.1},
        "pressure": [{"types": "*", "style": "linear"}],
        "rho": {"ratio": [0.98, 1.03]},
        "velocity": {"random": 0.1},
        "compare": [NEW, "coordination"],
    }
)
items = {item.name: item for item in plan(scene).reference}
assert items[NEW].needed and items[NEW].why == "compared" and items["density, given"].why == f"for {NEW}"
assert not items["pressure"].needed

# LAMMPS' output, within the bound; a wrong formula is outside, and blamed
ready = prepared_case.prepare(Case("new", "", (), scene, Path("new")))
assert "compute q all rheo/property/atom pressure coordination" in ready.jobs[0].commands
with closing(Session()) as session:
    answer = session.run(ready.jobs[0])
found_n, law = snapshot(scene, answer.arrays)[NEW], EOS("linear", rho0=1.1, cs=9.0)
# A square, a difference and a product on either side.
np.testing.assert_allclose(found_n, law.pressure(answer.arrays["rho"]), rtol=2 * 3 * 2.0**-53)
right = Evaluator.compression  # type: ignore[attr-defined]


def wrong(stages: Evaluator, rho_n: Any) -> Any:
    """Evaluate a field that is off by 1e-9."""
    return right(stages, rho_n) * (1 + 1e-9)


for formula, verdict in ((right, "exact"), (wrong, "differs")):
    Evaluator.compression = formula  # type: ignore[attr-defined]
    engine = EngineRecord(name="env", distribution=version("lammps"))
    record = flow.judge(None, ready, [answer], engine)[0]
    of_new = next(each for each in record.fields if each.field == NEW)
    assert (of_new.verdict, of_new.stage) == (verdict, "eos"), of_new
    assert record.message.startswith(f"{NEW} (stage eos) leaves its bound at step 0 at ") == (verdict == "differs")

# rescaled twins, units, audit, planted faults, what explain and NUMERICS.md say of it
scale = twins.Scale.of_size(4.0, 2)
assert scale.of(NEW) == scale.of("pressure") and UNITS["metal"].of(NEW) == UNITS["metal"].pressure
model = problem_of(scene, ready.atoms, "new", (0,)).model
assert NEW in audit.checked() and audit.chosen([NEW]) == (NEW,)
assert audit.why_not(NEW, model, audit.Setting(Deck(), "lj")) == ""
assert f"q.{NEW}" in output_faults.REAL
explain.explain_command.main([NEW], standalone_mode=False)
assert all(f"\n{row}" in PAGE.read_text() for row in of_quantities())
