"""The numbers of a sample: which particles count, lints, effects of findings, decisions at the cutoff."""

from __future__ import annotations

import numpy as np
import pytest

from eos_ref import EOS, EOSTable, parse_fix_rheo
from eos_ref.evaluation import blocks
from eos_ref.model.box import Box
from eos_ref.model.parameters import Model, PairRheo, Viscosity
from eos_ref.model.quantities import has, keyword_of
from eos_ref.model.state import State
from eos_ref.numbers.rounded import error, value
from lammps_cases.audit import effects, fields
from lammps_cases.audit import lints as audit_lints
from lammps_cases.audit.effects import compare, worst
from lammps_cases.audit.evaluation import ParticleSample, SampleEvaluation
from lammps_cases.audit.lints import Stillness, lints, number_density
from lammps_cases.audit.sample import judged, known
from lammps_cases.audit.verdict import Findings
from lammps_cases.findings.forces import ForcePerVolume
from lammps_cases.findings.neighbour_lists import NeighbourList
from lammps_cases.records import deck_wording
from lammps_cases.records.case_parts import CheckRecord, EffectRecord, Verdict
from lammps_cases.records.wording import number
from lammps_cases.run.prepared_case import prepare
from lammps_cases.scene import casefile
from lammps_cases.verdict.problems import problem_of
from tests.support.vortices import EDGE, vortices

ENGINE, BUG = "2025.7.22.4.0", "force-per-volume"


def grid(*edges: int) -> np.ndarray:
    """Points of a lattice of spacing 1, the last axis varying fastest, (n, d)."""
    return np.stack(np.meshgrid(*map(np.arange, edges), indexing="ij"), -1).reshape(-1, len(edges)) + 0.5


def sample_of(x_nc: np.ndarray, box: Box, v_nc: np.ndarray | None = None, words: str = "") -> ParticleSample:
    """Fluid particles of one type with a cutoff of 3."""
    d, n = x_nc.shape[1], len(x_nc)
    fix = parse_fix_rheo(f"fix 1 all rheo 3.0 quintic 0 {words}")
    laws, viscosity = EOSTable((EOS("linear"),)), (Viscosity("constant", 0.1),)
    model = Model(2 if d == 2 else 3, fix, (1.0,), laws, PairRheo(3.0), viscosity)
    v_nc = np.zeros((n, d)) if v_nc is None else v_nc
    return ParticleSample(model, box, State(x_nc, v_nc, np.ones(n), np.ones(n, int), np.zeros(n, bool)), np.ones(n))


# --- which particles can be compared


@pytest.mark.slow
@pytest.mark.parametrize("name", ["surfaces.divergence.open", "thermal-walls.reconstructed.rk1", "shift.sum.2d"])
def test_blocks_exclude_the_same_particles(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    (case,) = (case for case in casefile.load() if case.name == name)
    problem = problem_of(case.scene, prepare(case).atoms, case.where, case.scene.snapshots)
    mass_n = np.array(problem.model.mass_t)[problem.state.type_n - 1]
    z_n = np.where(np.arange(len(mass_n)) % 97 == 0, 1e-9, 0.0)  # some displaced slightly upwards
    sample = ParticleSample(problem.model, problem.box, problem.state, mass_n, z_n=z_n)
    names = [f for f in fields.checked() if f not in ("virial", "press") and has(problem.model, keyword_of(f))]

    def left_out() -> dict[str, list[bool]]:
        by = SampleEvaluation(sample, names)
        return {field: by.comparable(field).tolist() for field in names} | {"tilted": by.tilted().tolist()}

    whole = left_out()
    assert any(whole["tilted"]) and not all(whole["f"])
    monkeypatch.setattr(blocks, "ROWS", 7)
    assert left_out() == whole


@pytest.mark.parametrize(("limit", "open_"), [(24, False), (25, True), (28, True), (29, False)])
def test_pairs_at_the_cutoff_are_open(limit: int, open_: bool) -> None:
    """On a square lattice with a cutoff of 3 spacings four neighbours lie at the cutoff, exactly or within rounding."""
    x_nc, box = grid(10, 10) - 0.4, Box((0, 0), (10, 10), (True, True))
    sample = sample_of(x_nc, box, words=f"surface/detection coordination {limit} 0")
    evaluation = SampleEvaluation(sample, ("coordination", "surface"))
    counted, surface = evaluation.output("coordination"), evaluation.output("surface")
    assert np.all(error(counted) == 4) and np.all((value(counted) >= 24) & (value(counted) <= 28))
    assert np.all((error(surface) > 0) == open_)
    assert np.all(value(surface) == (limit == 29)) or open_


# --- lints


def test_many_particles_are_sampled_in_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Results from evenly spaced blocks equal those of all particles, and the line states the count."""
    sample = sample_of(grid(30, 30), Box((0.0, 0.0), (30.0, 30.0), (True, False)))
    n_n, full_n = number_density(sample)
    assert not [of for of in lints(sample, np.arange(900)) if of.subject == "some"]
    monkeypatch.setattr(audit_lints, "ROWS", 100)
    monkeypatch.setattr(audit_lints, "MOST", 300)
    some_n, some_full_n = number_density(sample)
    judged_n = np.isfinite(some_n)
    assert judged_n.sum() == 300 and judged_n[:100].all() and judged_n[400:500].all() and judged_n[-100:].all()
    np.testing.assert_array_equal(some_n[judged_n], n_n[judged_n])
    np.testing.assert_array_equal(some_full_n, full_n & judged_n)
    (line,) = [of.line for of in lints(sample, np.arange(900)) if of.subject == "some"]
    assert "were judged by about 300 of 900 particles" in line


@pytest.mark.parametrize("d", [2, 3])
def test_only_particles_with_full_support_count(d: int) -> None:
    """On a lattice of spacing 1 between two free surfaces: those two rows inside, where 1/n is 1."""
    rows, across = 8, 6
    x_nc = grid(*[across] * (d - 1), rows)
    box = Box((0.0,) * d, (*(float(across),) * (d - 1), float(rows)), (*(True,) * (d - 1), False))
    n_n, full_n = number_density(sample_of(x_nc, box))
    assert sorted(set(x_nc[full_n, -1])) == [2.5, 3.5, 4.5, 5.5]
    # The sum over the quintic spline with h = spacing is an integral to within its smallest wave's transform.
    np.testing.assert_allclose(n_n[np.abs(x_nc[:, -1] - rows / 2) < 1.5], 1.0, rtol=3e-3, atol=0)
    assert not number_density(sample_of(x_nc[:1], box))[1].any()


def test_stillness_needs_two_samples_and_a_moving_particle() -> None:
    x_nc, ids, box = grid(6, 6), np.arange(36), Box((0, 0), (6, 6), (True, True))
    moving = sample_of(x_nc, box, np.where(x_nc[:, 1:] < 2, 0.0, [0.1, 0.1]))
    turned = sample_of(x_nc[::-1].copy(), box, moving.state.v_nc[::-1].copy())
    at_rest = sample_of(x_nc, box)

    def line(*looks: tuple[int, ParticleSample, bool]) -> str:
        still = Stillness()
        for step, sample, begins in looks:
            still.look(step, ids[::-1].copy() if sample is turned else ids, sample, begins)
        return still.line

    assert not line((0, moving, True))
    assert line((0, moving, True), (10, turned, False)).startswith(
        "12 fluid particles of type 1 are at rest in step 10 "
    )
    assert not line((10, moving, False), (10, moving, True)), "a run begins, and velocities may have been set"
    assert not line((0, at_rest, False), (10, at_rest, False)), "nothing moves"


# --- effects of findings


def effect(field: str = "f", relative: float | None = 0.1, factor: float | None = None) -> EffectRecord:
    of = {"run": 1, "step": 0, "particles": 1, "of": 2}
    return EffectRecord(finding=BUG, field=field, relative=relative, factor=factor, **of)


def test_effects_are_multiples_or_differences() -> None:
    right = np.array([[1.0, -2.0], [0.5, 0.25]])
    assert compare(right, 100 * right, 0.0 * right) == (2, 99.0, 100.0)  # sums of few bits
    assert compare(right, right, 0.0 * right) is None
    assert compare(right, right + 1e-9, np.full((2, 2), 1e-8)) is None, "rounding is no effect"
    right, wrong = np.array([4.0, 2.0, 1.0]), np.array([4.0, 3.0, 1.0])
    assert compare(right, wrong, np.zeros(3)) == (1, 0.25, None)
    assert compare(np.zeros(3), wrong, np.zeros(3)) == (3, None, None)


def test_the_largest_effect_is_kept() -> None:
    small, large, other = effect(), effect(relative=0.2), effect("drho", None)
    assert worst([small], [large, other]) == [large, other]
    assert worst([large], [small]) == [large]
    by = "(1 of 2 particles, step 0)"
    assert deck_wording.effect(large) == f"f is wrong by up to 20 % of its largest value {by}"
    assert deck_wording.effect(other) == f"drho is wrong where it should be 0 {by}"
    assert deck_wording.effect(effect(factor=100.0)) == f"f is 100 times what it should be {by}"


@pytest.mark.parametrize(
    ("verdict", "step", "stays"), [("pass", 0, False), ("exact", 0, False), ("differs", 0, True), ("pass", 2, True)]
)
def test_field_inside_its_bound_contradicts_an_effect(verdict: Verdict, step: int, stays: bool) -> None:
    """Such as an effect on a force that another fix sets, if the same sample has the field."""
    numbers = {"max_abs": 0.0, "max_over_bound": 0.0, "worst_id": 1}
    check = CheckRecord(step=step, run=1, field="f", type=0, natoms=2, verdict=verdict, **numbers)
    assert bool(Findings(effects=[effect()], checks=[check]).case("in.deck").effects) == stays


def sample_of_vortices() -> ParticleSample:
    """With volumes of 0.01."""
    problem = vortices(mass=0.01)
    return ParticleSample(problem.model, problem.box, problem.state, np.full(len(problem.state.x_nc), 0.01))


def test_effect_of_a_finding_is_sampled_from_many_particles(monkeypatch: pytest.MonkeyPatch) -> None:
    sample = sample_of_vortices()
    (whole,) = effects.effects(sample, ENGINE, 1, 0)
    monkeypatch.setattr(effects, "MOST", 900)
    monkeypatch.setattr(effects, "FEW", 600)
    (some,) = effects.effects(sample, ENGINE, 1, 0)
    assert whole.of == EDGE**2 and 0 < some.of < 600
    assert some.finding == whole.finding == BUG
    assert some.factor == pytest.approx(whole.factor, rel=1e-12) and number(some.factor) == "100"


def test_neighbour_lists_are_read_for_findings_that_depend_on_them() -> None:
    sample = sample_of_vortices()
    shown = {"f": np.asarray(value(SampleEvaluation(sample, ("f",), ForcePerVolume).output("f")))}

    def never(tag_n: np.ndarray) -> tuple[NeighbourList, ...]:
        raise AssertionError

    found = judged(sample, ("f",), np.arange(EDGE**2), shown, known(ENGINE), {}, lists=never)
    assert [entry.id for entry in found.explained["f"]] == [BUG]
