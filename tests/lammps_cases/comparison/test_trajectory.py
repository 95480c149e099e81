"""The choice of evaluator by the size of a scene, and the bounds of its fields over time steps."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eos_ref import InputError
from eos_ref.compiled.evaluator import CompiledEvaluator
from eos_ref.eos.bounds import EPS
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from lammps_cases.comparison import trajectory
from lammps_cases.comparison.perturbation import Signs
from lammps_cases.comparison.problem import Problem
from lammps_cases.comparison.trajectory import (
    COMPILED_ABOVE,
    MOVED_PARTICLES,
    MOVED_RUNS,
    UPDATES,
    Fields,
    Prediction,
    Shaken,
    evaluations,
    moved_runs,
    own_stages,
    predict,
    visit,
)
from lammps_cases.run import prepared_case
from lammps_cases.scene import casefile
from lammps_cases.verdict.problems import problem_of

Write = Callable[..., Path]


def problem(case_file: Write, **scene: Any) -> Problem:
    case = casefile.load((case_file(**({"compare": ["f"], "velocity": {"random": 0.3}} | scene)),))[0]
    return problem_of(case.scene, prepared_case.prepare(case).atoms, "", (0,))


def of_size(scene: Problem, n: int) -> Problem:
    return replace(scene, state=replace(scene.state, x_nc=np.zeros((n, 2))))


def test_large_scenes_use_the_compiled_evaluator(case_file: Write) -> None:
    scene = problem(case_file)
    assert issubclass(own_stages(of_size(scene, COMPILED_ABOVE)), ArrayEvaluator)
    assert own_stages(of_size(scene, COMPILED_ABOVE + 1)) is CompiledEvaluator


def test_cost_counts_steps_and_perturbed_runs(case_file: Write) -> None:
    scene = of_size(problem(case_file), 100)
    assert evaluations(scene) == 100
    stepped = replace(scene, steps=(0, 9))
    assert evaluations(stepped) == 100 * 10 * (1 + MOVED_RUNS)
    n = COMPILED_ABOVE // (10 * (1 + MOVED_RUNS))
    assert own_stages(of_size(stepped, n)) is ArrayEvaluator
    assert own_stages(of_size(stepped, n + 1)) is CompiledEvaluator


# --- bounds over steps


def predicted(scene: Problem, stepping: type[Simulation] = Simulation) -> Prediction:
    return predict(replace(scene, steps=(0, 2), timestep=0.001), ArrayEvaluator, stepping)


def test_bound_before_the_first_step_is_that_of_one_evaluation(case_file: Write) -> None:
    scene = problem(case_file)
    alone, stepped = predict(scene, ArrayEvaluator), predicted(scene)
    assert (alone.bounds[0]["f"] > 0).any()
    np.testing.assert_array_equal(stepped.bounds[0]["f"], alone.bounds[0]["f"])


def test_bounds_include_forces_at_steps_not_compared(case_file: Write) -> None:
    """Later all may be frozen: particles then feel no force, but have moved by the forces of the first step."""
    scene = replace(problem(case_file), fields=("v",), timestep=0.001)
    alone, both = (predict(replace(scene, steps=steps), ArrayEvaluator) for steps in ((1,), (0, 1)))
    np.testing.assert_array_equal(alone.fields[0]["v"], both.fields[1]["v"])
    np.testing.assert_array_equal(alone.bounds[0]["v"], both.bounds[1]["v"])


@pytest.mark.parametrize(("fails", "unbounded"), [(0, [True] * 3), (2, [False, False, True])])
def test_perturbed_run_that_fails_leaves_later_steps_unbounded(
    case_file: Write, fails: int, unbounded: list[bool]
) -> None:
    """At its beginning, or in its second step, as particles that run away do."""

    class Ending(Simulation):
        taken = 0

        def setup(self) -> None:
            self.refuse(0)
            super().setup()

        def step(self, dt: float) -> None:
            self.taken += 1
            self.refuse(self.taken)
            super().step(dt)

        def refuse(self, at: int) -> None:
            if isinstance(self, Shaken) and at == fails:
                raise InputError("positions", "must be finite", np.inf)

    found = predict(replace(problem(case_file), steps=(0, 1, 3), timestep=0.001), ArrayEvaluator, Ending)
    assert [bool(np.isinf(bounds["f"]).any()) for bounds in found.bounds] == unbounded
    assert np.isfinite(found.fields[2]["f"]).all()


def test_spread_of_perturbed_runs_bounds_all_particles_equally(case_file: Write) -> None:
    """Integrated quantities have no bound before the first step, then the spread and their accumulated roundings."""
    scene = replace(problem(case_file), fields=("v", "x"))
    found = predicted(scene)
    first, last = found.bounds
    for field in scene.fields:
        assert not np.any(first[field])
        own = 2 * UPDATES * 2 * EPS * np.abs(found.fields[1][field])
        spread = last[field] - own
        assert np.ptp(spread) < 1e-6 * spread.min() and 0 < spread.max() < 1e-9


def test_sums_rounded_in_one_direction_stay_inside(case_file: Write) -> None:
    """Velocities under a constant force, rounded up in the last place by each half of a hundred steps."""

    class RoundingUp(Simulation):
        def step(self, dt: float) -> None:
            super().step(dt)
            self.state.v_nc = np.nextafter(np.nextafter(self.state.v_nc, np.inf), np.inf)

    pushed = problem(case_file, forces=[{"style": "setforce", "vector": [0.1, 0.2]}])
    scene = replace(pushed, fields=("v",), steps=(0, 100), timestep=0.001)
    right, other = (predict(scene, ArrayEvaluator, stepping) for stepping in (Simulation, RoundingUp))
    apart = np.abs(right.fields[1]["v"] - other.fields[1]["v"])
    assert (apart > 0).all() and (apart <= right.bounds[1]["v"]).all()


def test_stages_are_perturbed_in_one_run_of_three_the_same_way_at_every_step(
    case_file: Write, monkeypatch: pytest.MonkeyPatch
) -> None:
    given, kept = [], []

    class Noted(Simulation):
        def __init__(self, *arguments: Any, **options: Any) -> None:
            super().__init__(*arguments, **options)
            given.append(arguments[4].__name__)

    def noted(random: np.random.Generator, **options: bool) -> Signs:
        kept.append(options["kept"])
        return Signs(random, **options)

    monkeypatch.setattr(trajectory, "Signs", noted)
    monkeypatch.setattr(trajectory, "MOVED_PARTICLES", 80)  # of 20 for four runs
    scene = replace(problem(case_file), steps=(0, 1), timestep=1e-3)
    predict(scene, ArrayEvaluator, Noted)
    assert kept == [True, False, False, True]
    assert given == ["ArrayEvaluator", *["Moved"] * len(kept)]


def test_number_of_perturbed_runs_covers_the_signs_of_few_particles(case_file: Write) -> None:
    scene = problem(case_file)
    runs = [moved_runs(of_size(scene, n)) for n in (0, 1, 2, MOVED_PARTICLES // MOVED_RUNS)]
    assert runs == [MOVED_PARTICLES, MOVED_PARTICLES, math.ceil(MOVED_PARTICLES / 2), MOVED_RUNS]


@pytest.mark.parametrize(("steps", "seeds"), [(1, 20), (60, 5)])
def test_some_run_of_any_seed_moves_few_particles_apart(case_file: Write, steps: int, seeds: int) -> None:
    """Densities of a pair, each rounded differently at every step: damping turns their difference into a rate."""

    class RoundingOne(Simulation):
        def evaluate(self) -> Fields:
            if not self.fresh:
                self.state.rho_n = np.nextafter(self.state.rho_n, [np.inf, 0.0])
            return super().evaluate()

    pair = problem(
        case_file,
        positions={"x": [[0.5, 0.5], [1.3, 0.5]], "low": [0.0, 0.0], "high": [9.0, 9.0], "spacing": 1.0},
        velocity={},
        rho={"values": [1.2, 1.2]},
        pair={"rho_damp": 1.0},
        rheo={"cut": 3.0},
    )
    scene = replace(pair, fields=("drho",), steps=(0, steps), timestep=1e-9)
    rates = []
    for stepping in (Simulation, RoundingOne):
        sim = scene.simulation(ArrayEvaluator, stepping)
        assert list(visit(sim, scene.steps, scene.timestep)) == [0, steps]
        rates.append(sim.output("drho"))
    apart = np.abs(np.subtract(*rates))
    bounds = [predict(scene, ArrayEvaluator, seed=seed).bounds[1]["drho"] for seed in range(seeds)]
    assert (apart > 0).all() and (apart <= np.min(bounds, axis=0)).all()


def test_counts_are_bounded_particle_by_particle(case_file: Write) -> None:
    """A particle whose neighbours change in a perturbed run leaves its own count open, and no other."""

    class Gaining(Simulation):
        def output(self, field: str) -> Any:
            counts_n = super().output(field)
            return counts_n if type(self) is Gaining else counts_n + (np.arange(len(counts_n)) == 3)

    scene = replace(problem(case_file), fields=("coordination",))
    (_, last) = predicted(scene, Gaining).bounds
    assert np.flatnonzero(np.broadcast_to(last["coordination"], 20)).tolist() == [3]


def test_lost_run_bounds_nothing(case_file: Write) -> None:
    class Lost(Simulation):
        def output(self, field: str) -> Any:
            values = super().output(field)
            return values if type(self) is Lost else np.full_like(values, np.nan)

    first, last = predicted(problem(case_file), Lost).bounds
    assert np.isfinite(first["f"]).all()
    assert np.isinf(last["f"]).all()


def test_bounds_depend_on_the_seed_alone(case_file: Write) -> None:
    scene = replace(problem(case_file), steps=(0, 2), timestep=0.001)
    bounds = [predict(scene, ArrayEvaluator, seed=seed).bounds[1]["f"] for seed in (1, 1, 2)]
    np.testing.assert_array_equal(bounds[0], bounds[1])
    assert not np.array_equal(bounds[0], bounds[2])


def test_status_is_open_where_rounding_decides_the_class(case_file: Write) -> None:
    """A neighbour exactly at the cutoff may count or not, and so may the surface limit; the status word shows which."""
    scene = {
        "positions": {"x": [[1.0, 1.0], [1.6, 1.0], [4.0, 4.0], [4.5, 4.0]], "low": [0.0, 0.0], "high": [9.0, 9.0]},
        "rheo": {"cut": 1.6 - 1.0, "surface_detection": {"style": "coordination", "limit": 9, "splash": 1}},
        "compare": ["surface", "status"],
    }
    (case,) = casefile.load((case_file(**scene),))
    bounds = predict(problem_of(case.scene, prepared_case.prepare(case).atoms, "", (0,))).bounds[0]
    for field in ("surface", "status"):
        np.testing.assert_array_equal(bounds[field] > 0, [True, True, False, False])
    assert (bounds["status"][:2] >= 16).all(), "surface and splash differ by that"


@pytest.mark.parametrize("shape", [(), (7,), (300, 3), (5, 2, 2)])
def test_signs_equal_the_choice_of_the_generator(shape: tuple[int, ...]) -> None:
    ours, theirs = Signs(np.random.default_rng((3, 1))), np.random.default_rng((3, 1))
    for _ in range(5):
        np.testing.assert_array_equal(ours("x", shape), theirs.choice((-1.0, 1.0), shape))


def test_kept_signs_belong_to_their_quantity() -> None:
    kept, drawn = (Signs(np.random.default_rng(1), kept) for kept in (True, False))
    for name in ("x", "v"):
        np.testing.assert_array_equal(kept(name, (40,)), drawn(name, (40,)))
    assert kept("x", (40,)) is kept("x", (40,)) and not np.array_equal(kept("x", (40,)), kept("v", (40,)))
    assert not np.array_equal(drawn("x", (40,)), drawn("x", (40,)))
