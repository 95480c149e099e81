"""Between two runs: the reference restarts from the state alone, and bounds include the rounding of text files."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eos_ref.eos.bounds import EPS
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.box import Box, Deform
from lammps_cases.comparison.perturbation import Signs
from lammps_cases.comparison.problem import Problem, ProblemStop
from lammps_cases.comparison.trajectory import halted, predict, shaken, visit
from lammps_cases.run import prepared_case
from lammps_cases.scene import casefile
from lammps_cases.verdict.problems import problem_of

DT = 0.004
WALLS, FLUID = "runs-walls.fluid.settings", "runs.summed.settings"


def problem(name: str, *stops: ProblemStop, steps: tuple[int, ...] = (0, 2, 4)) -> Problem:
    """A shipped case with other stops."""
    (case,) = casefile.select(casefile.load(), [name])
    return replace(problem_of(case.scene, prepared_case.prepare(case).atoms, "", steps), stops=stops)


def stop(of: Problem, step: int, **settings: object) -> ProblemStop:
    """A stop without new particles."""
    return replace(ProblemStop(step, np.zeros(len(of.state.x_nc), bool)), **settings)


def begun(of: Problem) -> Simulation:
    """The reference before its first evaluation."""
    return of.simulation()


def visited(of: Problem) -> list[dict[str, np.ndarray]]:
    """Its fields at the steps compared."""
    sim = begun(of)
    halts = visit(sim, of.steps, of.timestep, of.stops)
    return [{field: np.array(sim.output(field)) for field in of.fields} for _ in halts]


@pytest.mark.parametrize("name", [WALLS, FLUID])
def test_run_starts_from_the_state_alone(name: str) -> None:
    of = problem(name)
    stopped = visited(replace(of, stops=(stop(of, 2, timestep=DT / 2),)))
    first = begun(of)
    first.run(2, of.timestep)
    other = Simulation(of.model, of.box, first.state, of.wanted, ArrayEvaluator)
    other.setup()
    for at in (1, 2):
        for field in of.fields:
            np.testing.assert_array_equal(stopped[at][field], other.output(field), err_msg=field)
        other.run(2, DT / 2)
    continued = visited(of)
    assert all(np.array_equal(continued[0][field], stopped[0][field]) for field in of.fields)
    assert not np.array_equal(continued[1]["f"], stopped[1]["f"]), "the set-up takes the velocity of the whole step"


def test_walls_start_without_history() -> None:
    of = problem(WALLS)
    sim = begun(of)
    sim.run(2, of.timestep)
    assert sim.other_nc.any()
    sim.begin_again(np.zeros(len(of.state.x_nc), bool))
    assert not sim.other_nc.any() and sim.fresh


@pytest.mark.slow
def test_displaced_particles() -> None:
    of = problem(FLUID)
    by_nc = np.where(of.state.type_n[:, None] == 1, [0.3, -0.2], 0.0)
    moved, unmoved = (visited(replace(of, stops=(stop(of, 2, by_nc=by),)))[1]["x"] for by in (by_nc, None))
    np.testing.assert_array_equal(moved, unmoved + by_nc)


def test_particles_follow_a_changing_box() -> None:
    of = problem("stretched.fluid.once")
    wider = Box(of.box.low_c, (of.box.high_c[0] * 2, of.box.high_c[1]), of.box.periodic)
    changed = replace(of, stops=(stop(of, 2, box=wider),))
    moved, unmoved = (visited(each)[1]["x"] for each in (changed, replace(of, stops=(stop(of, 2),))))
    np.testing.assert_allclose(moved, unmoved * [2.0, 1.0], rtol=2 * EPS, atol=0)  # to a fraction, and back
    assert [changed.box_at(step) for step in (0, 1, 2, 4)] == [of.box, of.box, wider, wider]
    sim = begun(of)
    sim.run(2, of.timestep)
    sim.remap(wider)
    other = Simulation(of.model, wider, sim.state, of.wanted, ArrayEvaluator)
    assert np.array_equal(sim.evaluate()["f"], other.evaluate()["f"])


def test_growing_box_is_known_at_every_step_and_before_stops() -> None:
    of = problem("stretched.fluid.once")
    grows = Deform((0.5, -0.2))
    stops = (stop(of, 2, timestep=of.timestep / 2), stop(of, 3))
    growing = replace(of, model=replace(of.model, deform=grows), stops=stops, steps=(0, 1, 2, 3, 4))
    sim = begun(growing)
    for step in visit(sim, growing.steps, growing.timestep, growing.stops):
        assert sim.box == growing.box_at(step)
    assert growing.box_before(2) == grows.box(of.box, 2 * of.timestep) == growing.box_at(2)
    leaning = replace(of, model=replace(of.model, deform=Deform((0.5, 0.0), "v", (2.0,))), steps=(0, 1, 2))
    assert [leaning.box_of_images(step) for step in (0, 1, 2)] == [leaning.box_at(step) for step in (0, 0, 1)]
    assert [growing.box_of_images(step) for step in (1, 2)] == [growing.box_at(step) for step in (1, 2)]
    sheared = replace(leaning, stops=(stop(of, 1),), steps=(0, 1, 2))
    deform = sheared.model.deform
    assert deform is not None and of.image_velocity(0) is None
    for step, begins in ((0, 0), (1, 1), (2, 1)):
        np.testing.assert_array_equal(sheared.image_velocity(step), deform.image_velocity(sheared.box_at(begins)))
    assert not np.array_equal(sheared.image_velocity(0), sheared.image_velocity(1))
    wider = grows.box(of.box, 1.0)
    assert replace(growing, stops=(stop(of, 2, box=wider),)).box_before(2) == growing.box_before(2) != wider


def test_bounds_of_a_changing_box_include_conversion_to_fractions_and_back() -> None:
    of = problem("stretched.fluid.once", steps=(0, 1))
    plain, changed = (
        predict(replace(of, stops=(stop(of, 0, box=box),)), ArrayEvaluator).bounds[0]["x"].max()
        for box in (None, Box(of.box.low_c, tuple(1.3 * high for high in of.box.high_c), of.box.periodic))
    )
    assert 6 * EPS * 1.3 * max(of.box.high_c) < plain + changed < 16 * EPS * max(of.box.high_c)


@pytest.mark.parametrize("shear", [(), (0.7,)])
def test_perturbed_runs_move_a_growing_box_by_its_roundings(shear: tuple[float, ...]) -> None:
    """Six of each corner and tilt, up or down, whatever the edges."""
    of, signs = problem("stretched.fluid.once"), set()
    by, begun_in = Deform((0.5, -0.2), shear=shear), replace(of.box, low_c=(-9.0, 1.0), tilt=(1.3,))
    plain = by.box(begun_in, 0.25)
    for seed in range(9):
        steps = shaken(Simulation, Signs(np.random.default_rng(seed)))
        sim = of.simulation(ArrayEvaluator, steps)
        sim.begun = begun_in
        box = sim.grown(by, 0.25)
        size_c = 6 * EPS * np.maximum(np.abs(plain.low_c), np.abs(plain.high_c))
        tilt_size = 6 * EPS * np.abs(plain.tilt) * bool(shear)
        for moved, end, size in (
            (box.low_c, plain.low_c, size_c),
            (box.high_c, plain.high_c, size_c),
            (box.tilt, plain.tilt, tilt_size),
        ):
            far = np.subtract(moved, end)
            assert (np.abs(np.abs(far) - size) <= EPS / 2 * np.abs(end)).all()
            signs |= set(np.sign(far).tolist())
        assert (box.periodic, len(box.tilt)) == (plain.periodic, 1)
    assert {-1.0, 1.0} <= signs


@pytest.mark.parametrize("tilt", [(), (0.7,)])
def test_perturbed_runs_move_positions_by_the_roundings_of_a_changing_box(tilt: tuple[float, ...]) -> None:
    """Six of the farthest place of either axis, and what a box that leans rounds."""
    of = problem("stretched.fluid.once")
    wider = Box((-3.0, 1.0), (7.0, 9.0), of.box.periodic, tilt)
    plain = begun(of)
    plain.remap(wider)
    sim = of.simulation(ArrayEvaluator, shaken(Simulation, Signs(np.random.default_rng(1))))
    sim.remap(wider)
    far_nc = sim.state.x_nc - plain.state.x_nc
    size_c = 6 * EPS * np.array([13.0, 9.0]) + wider.rounding(of.model.cut)
    assert (np.abs(np.abs(far_nc) - size_c) <= EPS / 2 * np.abs(plain.state.x_nc)).all()
    assert (far_nc > 0).any() and (far_nc < 0).any()


def test_stops_after_the_last_step_are_ignored() -> None:
    of = problem(FLUID, steps=(0, 1))
    late = visited(replace(of, stops=(stop(of, 2, timestep=1.0),)))
    assert all(np.array_equal(late[1][field], visited(of)[1][field]) for field in of.fields)


def test_bounds_after_text_include_half_a_unit_of_the_last_digit() -> None:
    of = problem(FLUID, steps=(0, 1))
    plain, exact, text = (
        predict(replace(of, stops=stops), ArrayEvaluator).bounds[0]["x"].max()
        for stops in ((), (stop(of, 0),), (stop(of, 0, digits=8),))
    )
    largest = np.abs(of.state.x_nc).max()
    assert plain == 0 and 0 < exact < 4e-16 * max(of.box.high_c)
    assert 0.5e-7 * largest <= text <= 0.51e-7 * largest


def test_halted_run_has_passed_its_stops() -> None:
    of = problem(FLUID)
    stopped = replace(of, stops=(stop(of, 2, timestep=DT / 2),))
    for case, fields in ((stopped, visited(stopped)), (of, visited(of))):
        halts = halted(case, case.steps)
        for at, step in enumerate(case.steps):
            np.testing.assert_array_equal(halts[step].output("f"), fields[at]["f"])
    assert not np.array_equal(visited(stopped)[2]["f"], visited(of)[2]["f"])
