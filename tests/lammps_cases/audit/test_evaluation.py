"""Which particles of a sample can be compared: the same in blocks as at once."""

from __future__ import annotations

import numpy as np
import pytest

from eos_ref.evaluation import blocks
from eos_ref.model.quantities import has, keyword_of
from lammps_cases.audit import fields
from lammps_cases.audit.evaluation import ParticleSample, SampleEvaluation
from lammps_cases.run.prepared_case import prepare
from lammps_cases.scene import casefile
from lammps_cases.verdict.problems import problem_of


def sample_of(name: str) -> ParticleSample:
    """Return the particles of a case, some of them displaced slightly upwards."""
    (case,) = (case for case in casefile.load() if case.name == name)
    problem = problem_of(case.scene, prepare(case).atoms, case.where, case.scene.snapshots)
    state = problem.state
    mass_n = np.array(problem.model.mass_t)[state.type_n - 1]
    z_n = np.where(np.arange(len(mass_n)) % 97 == 0, 1e-9, 0.0)
    return ParticleSample(problem.model, problem.box, state, mass_n, z_n=z_n)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["surfaces.divergence.open", "thermal-walls.reconstructed.rk1", "shift.sum.2d"])
def test_blocks_exclude_the_same_particles(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    sample = sample_of(name)
    model = sample.model
    asked = [f for f in fields.checked() if f not in ("virial", "press") and has(model, keyword_of(f))]

    def left_out() -> dict[str, list[bool]]:
        by = SampleEvaluation(sample, asked)
        return {field: by.comparable(field).tolist() for field in asked} | {"tilted": by.tilted().tolist()}

    whole = left_out()
    assert any(whole["tilted"]) and not all(whole["f"])
    monkeypatch.setattr(blocks, "ROWS", 7)
    assert left_out() == whole
