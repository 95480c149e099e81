"""Ranges of types in fix rheo/thermal: every form gives the bits of one entry per type; the last one counts."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lammps_cases.engine.session import Answer, Job
from lammps_cases.engine.workers import Workers
from lammps_cases.run.prepared_case import prepare
from lammps_cases.scene import Scene, casefile

pytestmark = pytest.mark.lammps
VALUES = {"conductivity": (0.7, 0.3), "specific/heat": (1.5, 0.8), "Tfreeze": (0.75, 0.95), "latent/heat": (0.2, 0.5)}


@pytest.fixture(scope="module")
def job() -> Job:
    """Return a job with three types that freeze and melt; the second and the third get the same properties."""
    (case,) = casefile.select(casefile.load(), ["thermal.freezing.2d"])
    content = case.scene.model_dump(exclude_unset=True)
    content["types"] = [{"mass": 1.0 + 0.2 * t, "rho0": 1.0, "cs": 6.0} for t in range(3)]
    content["pressure"] = [{"types": "*", "style": "linear"}]
    content["rho"] = {"constant": 1.0}
    (made,) = prepare(replace(case, scene=Scene.model_validate(content), exercises=())).jobs
    return made


def found(workers: Workers, job: Job, forms: str, values: dict[str, tuple[float, float]] = VALUES) -> dict[str, Any]:
    """Return LAMMPS' arrays; each form selects one of the two values of every property: ``1=0 2*3=1``."""
    words = [
        f"{keyword} {form.split('=')[0]} constant {two[int(form.split('=')[1])]!r}"
        for keyword, two in values.items()
        for form in forms.split()
    ]
    line = " ".join(["fix thermal all rheo/thermal", *words])
    lines = tuple(line if told.startswith("fix thermal") else told for told in job.commands)
    answer = workers.outcome(workers.submit(replace(job, commands=lines), 60.0))
    assert isinstance(answer, Answer) and lines != job.commands, answer
    return answer.arrays


def same(one: dict[str, Any], other: dict[str, Any]) -> bool:
    """Return whether all arrays have the same bits."""
    return all(np.array_equal(one[name], other[name]) for name in one)


@pytest.mark.parametrize(
    "forms", ["1=0 2*3=1", "1=0 2*=1", "*=1 1=0", "*=1 *1=0", "*3=1 1*1=0", "1*=1 1=0", "2*3=1 *1=0"]
)
def test_every_form_of_a_range_gives_the_same_bits(workers: Workers, job: Job, forms: str) -> None:
    alone = found(workers, job, "1=0 2=1 3=1")
    assert same(found(workers, job, forms), alone)
    assert len(set(alone["esph"])) > 3, "energies change"


@pytest.mark.parametrize("keyword", VALUES)
def test_every_property_applies_to_its_range_alone(workers: Workers, job: Job, keyword: str) -> None:
    """Exchanging its values between the ranges changes the results."""
    other = VALUES | {keyword: VALUES[keyword][::-1]}
    assert not same(found(workers, job, "1=0 2*3=1", other), found(workers, job, "1=0 2*3=1"))
