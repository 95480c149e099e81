"""A box that grows while particles move: at rate 0 LAMMPS gives the same bits; faults in its input are detected."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from eos_ref.model.box import Deform
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.records.run_record import EngineRecord
from lammps_cases.run.prepared_case import prepare
from lammps_cases.scene import casefile
from lammps_cases.verdict.cases import compare_case
from tests.support.outcome import Solver
from tests.support.small_scene import SmallScene, engine
from tests.workshop.faults import input_faults

pytestmark = pytest.mark.lammps
ENGINE = EngineRecord(name="env", distribution="2025.7.22.4.0")


@pytest.mark.parametrize("name", ["deformed.fluid.still", "deformed.walls.still"])
def test_rate_of_0_changes_no_bit(name: str) -> None:
    (case,) = casefile.select(casefile.load(), [name])
    atoms = prepare(case).atoms

    def found(deform: Any) -> list[dict[str, Any]]:
        content = case.scene.model_dump(exclude_unset=True)
        content["evolve"] |= {"deform": deform}
        with engine() as lammps:
            return lammps.fields(SmallScene(case.scene.model_validate(content), atoms))

    still, without, moving = found({"remap": "none"}), found(None), found({"x": 0.1, "remap": "none"})
    for at, (one, other) in enumerate(zip(still, without, strict=True)):
        assert all(np.array_equal(one[field], other[field]) for field in one), at
    assert not np.array_equal(moving[-1]["f"], still[-1]["f"])


def test_bound_covers_image_speeds_from_position_differences(monkeypatch: pytest.MonkeyPatch, solver: Solver) -> None:
    """LAMMPS computes them this way; the shorter the run, the larger their rounding."""
    (case,) = casefile.select(casefile.load(), ["sheared.fluid.crossing"])
    content = case.scene.model_dump(exclude_unset=True)
    content["evolve"]["deform"] |= {"y": 0.3}
    content["evolve"]["timestep"] *= 1e-6
    ready = prepare(replace(case, scene=case.scene.model_validate(content)))

    def found() -> str:
        return compare_case(ready.case, ready.eos, ready.atoms, solver(ready.jobs[0]), ENGINE, Predictor())[0].verdict

    assert found() == "explained"
    monkeypatch.setattr(Deform, "image_rounding", lambda self, first: np.zeros((2, 2)))
    assert found() == "differs"


@pytest.mark.parametrize(
    ("name", "fault"),
    [
        ("deformed.fluid.remap", "no-deform"),
        ("deformed.fluid.remap", "deform-alone"),
        ("deformed.fluid.alone", "deform-with-x"),
        ("deformed.fluid.remap", "deform-later"),
        ("sheared.fluid.over", "deform-alone"),
        ("sheared.fluid.crossing", "images-at-rest"),
    ],
)
def test_fault_in_lammps_box_input_is_detected(name: str, fault: str, solver: Solver) -> None:
    (case,) = casefile.select(casefile.load(), [name])
    ready = prepare(case)
    jobs = input_faults.jobs(input_faults.faults()[f"told.{fault}"], ready)
    record, *_ = compare_case(case, ready.eos, ready.atoms, solver(jobs[0]), ENGINE, Predictor())
    assert record.verdict == "differs"
