"""Conserved quantities of a sample, and runs of the reference with one thing changed."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from eos_ref.eos.bounds import EPS
from eos_ref.model.box import Box
from eos_ref.numbers.columns import axes, summed
from eos_ref.numbers.rounded import error, value
from lammps_cases.audit import budgets, rerun
from lammps_cases.audit.budgets import Rates, budget
from lammps_cases.audit.deck import Action
from lammps_cases.audit.evaluation import ParticleSample, TimedSample
from lammps_cases.audit.rerun import closed, deviation
from lammps_cases.findings import LEDGER
from lammps_cases.findings.forces import ForcePerVolume
from lammps_cases.records.case_parts import ClosedRecord, SeriesRecord
from lammps_cases.run.prepared_case import prepare
from lammps_cases.scene import casefile
from lammps_cases.verdict.problems import problem_of
from tests.support import made_runs

FORCES, SHIFT, THERMAL = "forces.all.quintic.2d", "shift.all.2d", "thermal.arithmetic.2d"


@cache
def sample_of(name: str) -> ParticleSample:
    (case,) = (case for case in casefile.load() if case.name == name)
    problem = problem_of(case.scene, prepare(case).atoms, case.where, case.scene.snapshots)
    mass_n = np.array(problem.model.mass_t)[problem.state.type_n - 1]
    return ParticleSample(replace(problem.model, forces=()), problem.box, problem.state, mass_n)


def still(sample: ParticleSample) -> np.ndarray:
    return np.zeros(sample.state.x_nc.shape)


def quintic(sample: ParticleSample) -> ParticleSample:
    """The same particles, all fluid, with opposite forces of pairs."""
    fix = replace(sample.model.fix, kernel="quintic", interface_reconstruct=False, rho_sum=False, shift=None)
    state = replace(sample.state, solid_n=np.zeros(len(sample.mass_n), bool))
    return replace(sample, model=replace(sample.model, fix=fix), state=state)


@pytest.mark.parametrize("name", [FORCES, SHIFT])
def test_pressure_power_equals_compression_work(name: str) -> None:
    sample = quintic(sample_of(name))
    found = budget(sample, still(sample), 1, 0, 0.0, [entry for entry in LEDGER if entry.id == "force-per-volume"])
    assert {"momentum", "energy of pressure"} <= set(found.residual)
    for quantity, residual in found.residual.items():
        assert abs(residual) <= found.bound[quantity], quantity
    parts = {part.name: part for part in found.parts}
    assert abs(parts["pressure"].power) > found.bound["energy of pressure"], "nothing of note is kept"
    assert parts["viscosity"].power < 0
    (wrong,) = found.findings
    assert max(abs(f) for f in wrong.force) > found.bound["momentum"]


def test_force_without_volume_breaks_conservation() -> None:
    sample = quintic(sample_of(FORCES))
    wrong = Rates(sample, ForcePerVolume)
    residuals = wrong.residuals(wrong)
    assert all(abs(value(of)[0]) > error(of)[0] for of in residuals.values())


def test_parts_add_up_to_the_total() -> None:
    sample = sample_of(FORCES)
    gravity = Action("gravity", "all", (0.1, -0.2, 0.0))
    sample = replace(sample, actions=[(gravity, np.ones(len(sample.mass_n), bool))])
    found = budget(sample, still(sample), 1, 0, 0.0)
    d = sample.model.dimension
    forces = np.array(
        [part.force for part in found.parts if part.force and part.name not in ("shifting", "other fixes")]
    )
    # Sums of the parts and of the whole, each rounded on its own; the parts cancel where the whole is taken from them.
    np.testing.assert_allclose(forces.sum(axis=0), found.pairs.force, atol=4 * found.bound["momentum"], rtol=0)
    (others,) = [part for part in found.parts if part.name == "other fixes"]
    acted = Rates(sample)
    for force, f_n, g in zip(others.force, axes(acted.acted_nc - acted.force_nc), gravity.vector[:d], strict=True):
        weight = math.fsum(sample.mass_n * g)
        of_weight = EPS * math.fsum(np.abs(sample.mass_n * g))  # half of it a product, half the sum
        assert abs(force - weight) <= error(summed(f_n))[0] + of_weight


def test_half_step_velocities_are_completed() -> None:
    sample = sample_of(FORCES)
    force_nc = np.ones(sample.state.x_nc.shape)
    at_rest = replace(sample, state=replace(sample.state, v_nc=still(sample)))
    found = budget(at_rest, force_nc, 1, 5, 0.25)
    assert found.momentum == [0.25 * len(sample.mass_n)] * sample.model.dimension
    assert found.press is None, "LAMMPS' velocities and forces are not of one moment"
    assert budget(sample, force_nc, 1, 0, 0.0).press is not None


# --- runs with one thing changed


@pytest.mark.parametrize("name", [FORCES, "forces.all.quintic.3d", THERMAL])
def test_refined_particles_represent_the_same_fluid(name: str) -> None:
    sample = sample_of(name)
    state, d = sample.state, sample.model.dimension
    fine = rerun.finer(sample.model, sample.box, state)
    mass_n = np.array(fine.model.mass_t)[fine.state.type_n - 1]
    assert len(fine.state.x_nc) == 2**d * len(state.x_nc) and fine.model.fix.cut == sample.model.fix.cut / 2
    assert math.fsum(mass_n) == math.fsum(sample.mass_n), "masses are divided by powers of 2"
    before, after = (sample.mass_n[:, None] * state.v_nc), mass_n[:, None] * fine.state.v_nc
    for c in range(d):
        # A product of each term, half EPS, and for that of a part the sum that makes its velocity: d products more.
        allowed = EPS * (math.fsum(np.abs(before[:, c])) + (d + 1) * math.fsum(np.abs(after[:, c])))
        assert abs(math.fsum(after[:, c]) - math.fsum(before[:, c])) <= allowed
    low_c, high_c = np.array(sample.box.low_c), np.array(sample.box.high_c)
    inside = (fine.state.x_nc >= low_c) & (fine.state.x_nc <= high_c)
    assert inside[:, np.array(sample.box.periodic)].all()
    if state.energy_n is not None:
        assert math.fsum(fine.state.energy_n) == math.fsum(state.energy_n)


def test_diverging_runs_record_how_they_ended() -> None:
    sample = sample_of(FORCES)
    series = rerun.reruns(TimedSample(sample, 50.0, 1, 0, np.arange(len(sample.mass_n))), 40, 10, ())
    assert series[0].name == rerun.AS_IT_IS and all(of.ended for of in series)


# --- closed solutions


def vortices(**changes: object) -> TimedSample:
    n, edge = 12, 12.0
    x_nc = np.stack(np.meshgrid(np.arange(n), np.arange(n), indexing="ij"), axis=-1).reshape(-1, 2) + 0.25
    k = 2 * np.pi / edge
    v_nc = 0.1 * np.stack(
        [-np.cos(k * x_nc[:, 0]) * np.sin(k * x_nc[:, 1]), np.sin(k * x_nc[:, 0]) * np.cos(k * x_nc[:, 1])], axis=1
    )
    base = sample_of(FORCES)
    count = len(x_nc)
    one = replace(
        base.model, mass_t=base.model.mass_t[:1], viscosity=base.model.viscosity[:1], thermal=None,
        fix=replace(base.model.fix, rho0=None, cs=None),
        eos=type(base.model.eos)(base.model.eos.laws[:1]),
    )  # fmt: skip
    state = replace(
        base.state, x_nc=x_nc, v_nc=v_nc, rho_n=np.ones(count), type_n=np.ones(count, base.state.type_n.dtype),
        solid_n=np.zeros(count, bool), energy_n=None, mass_n=None,
    )  # fmt: skip
    box = Box((0.0, 0.0), (edge, edge), (True, True))
    return TimedSample(
        ParticleSample(one, box, replace(state, **changes), np.full(count, 2.0)), 0.5, 1, 0, np.arange(count)
    )


def test_vortices_are_recognised_by_their_velocities() -> None:
    good = vortices()
    found = closed(good, [0, 10])
    assert found is not None and found.decays
    eta, rho0 = good.sample.model.viscosity[0].eta, good.sample.model.eos.laws[0].rho0
    exponent = 4 * eta / rho0 * (2 * np.pi / 12) ** 2 * 5.0
    # Seven operations make either exponent; values and their ratio, of three operations, change its logarithm as much.
    assert np.log(found.values[0] / found.values[1]) == pytest.approx(exponent, rel=14 * EPS, abs=4 * EPS)
    moved = good.sample.state.v_nc * 1.0
    moved[3, 0] += 1e-9
    assert closed(vortices(v_nc=moved), [0, 10]) is None, "something else flows here"
    assert closed(vortices(v_nc=0 * moved), [0, 10]) is None


@pytest.mark.parametrize("eta", [0.0, 1e-30, 1e6])
def test_viscosity_without_decay_rate_has_no_closed_solution(eta: float) -> None:
    good = vortices()
    law = replace(good.sample.model.viscosity[0], eta=eta)
    model = replace(good.sample.model, viscosity=(law,))
    assert closed(replace(good, sample=replace(good.sample, model=model)), [0, 10]) is None


def test_contribution_of_a_finding_is_the_difference_of_runs() -> None:
    exact = ClosedRecord(flow="", quantity="kinetic energy", about="", steps=[0, 1], values=[1, 0.5], decays=True)
    looks = {"steps": [0, 1], "momentum": [[0.0], [0.0]]}
    right = SeriesRecord(name=rerun.AS_IT_IS, kinetic=[1.0, 0.5], **looks)
    faster = {"kinetic": [1.0, 0.25], **looks}
    case = made_runs.case("a").model_copy(
        update={
            "closed": exact,
            "budgets": [budget(sample_of(FORCES), still(sample_of(FORCES)), 1, step, 0.0) for step in (0, 1)],
            "series": [
                right,
                SeriesRecord(name=rerun.SILENT, **faster),
                SeriesRecord(name="b", findings=["b"], **faster),
            ],
        }
    )
    _, _, silent, wrong = budgets.parts(case)
    assert silent.contribution == -1.0, "without it the decay is faster"
    assert wrong.contribution == 1.0, "with it the decay is faster"


def test_deviation_is_measured_at_a_common_step() -> None:
    decay = ClosedRecord(
        flow="", quantity="kinetic energy", about="", steps=[0, 4, 8], values=[1, 0.5, 0.25], decays=True
    )
    run = SeriesRecord(name="", steps=[0, 4], kinetic=[2.0, 0.5], momentum=[[0.0], [0.0]])
    assert deviation(decay, run) == 1.0, "twice the rate"
    assert deviation(decay, run, 8) is None
    value = decay.model_copy(update={"decays": False, "quantity": "momentum along x"})
    assert deviation(value, run.model_copy(update={"momentum": [[0.0], [0.625]]})) == 0.25
