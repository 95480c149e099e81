"""The benchmarks of the paper behind RHEO: published numbers where the start is public, and their solutions."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from lammps_cases.engine.session import kept
from lammps_cases.studies.flows.catalogue import PAPER
from lammps_cases.studies.flows.known import Flow
from lammps_cases.studies.flows.paper import errors_of, points_of
from lammps_cases.studies.flows.paper_bulk import WINDOW
from lammps_cases.studies.flows.paper_obstacles import CYLINDERS, SPHERES, ObstacleArray
from lammps_cases.studies.flows.paper_walls import NEWTONIAN, YIELDING, ChannelFluid
from lammps_cases.studies.flows.solve import by_lammps, by_reference, fit
from tests.support.outcome import Outcome


def first_error(of: Flow, n: int) -> float:
    found = by_reference(of.start(n, of.options))
    assert not found.message
    return next(iter(of.measures(n, of.options, found.snapshots).values()))


@pytest.mark.parametrize("name", ["paper-normal-circle", "paper-normal-sine"])
@pytest.mark.parametrize("at", range(3))
def test_normals_are_the_published_ones_to_all_their_digits(name: str, at: int) -> None:
    of = PAPER[name]
    assert of.published is not None
    n = of.resolutions[at]
    assert float(f"{first_error(of, n):.4g}") == of.published.errors[n]


def test_coincident_particles_make_the_published_error_of_the_circle() -> None:
    for n in (2, 4, 5):
        assert first_error(PAPER["paper-normal-circle-even"], n) < 0.1 * first_error(PAPER["paper-normal-circle"], n)


def test_published_rk0_repeats_the_quintic() -> None:
    assert errors_of("2", "RK0", "static") == errors_of("2", "quintic", "static")


@pytest.mark.parametrize("kernel", ["Quintic", "RK1", "RK2"])
def test_published_energies_have_the_viscosity_to_about_a_thousandth_up_to_the_window(kernel: str) -> None:
    t, energy = map(
        np.array, points_of("taylor_green_2d_energy", "t_u0_over_L", "E_over_E0", kernel=kernel, shifting="shift")
    )
    early = t <= WINDOW
    slope = np.polyfit(t[early], np.log(energy[early]), 1)[0]
    assert -slope * 10 / (16 * np.pi**2) == pytest.approx(1, abs=1.5e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("kernel", "order"), [("quintic", 0), ("rk0", 0), ("rk1", 1), ("rk2", 2)])
def test_divergence_falls_with_the_order_of_the_kernel(kernel: str, order: int) -> None:
    of = PAPER[f"paper-divergence-{kernel}"]
    errors = {n: first_error(of, n) for n in (20, 40, 50, 100)}
    assert fit(list(errors), list(errors.values())).order == pytest.approx(order, abs=0.2)
    assert of.published is not None
    # Another sample of the disorder: the mean of a thousand values of either sign and size.
    assert errors[100] == pytest.approx(of.published.errors[100], rel=0.1)


@pytest.mark.parametrize("of", PAPER.values(), ids=list(PAPER))
def test_every_benchmark_has_a_start_and_something_to_compare(of: Flow) -> None:
    assert of.published is not None
    assert of.published.errors or of.panels or of.quantities or "even" in of.name
    n = of.resolutions[0]
    begin = of.start(n, of.options)
    assert len(begin.atoms) < 4000 and begin.case.scene.whole_model


@pytest.mark.lammps
@pytest.mark.slow
@pytest.mark.parametrize("name", ["paper-conduction-rk1-narrow", "paper-divergence-rk2", "paper-sphere-quintic"])
def test_both_sides_solve_the_same_flow(name: str) -> None:
    of = PAPER[name]
    n = of.resolutions[0]
    begin = of.start(n, of.options)
    found = [of.measures(n, of.options, run.snapshots) for run in (by_reference(begin), by_lammps(begin, kept(None)))]
    # LAMMPS' forces lack the volume, which the compression changes: Mach^2 / Re = 1e-4 / 0.04 of the slow flow.
    assert list(found[0].values()) == pytest.approx(list(found[1].values()), abs=0.0025)


@pytest.mark.slow
def test_wall_of_a_channel_lies_half_a_spacing_beyond_its_last_row() -> None:
    of = PAPER["paper-poiseuille-rk1"]
    found = by_reference(of.start(20, of.options))
    _, at_last_row, half_a_spacing_out = of.measures(20, of.options, found.snapshots).values()
    assert at_last_row > 0.1 and half_a_spacing_out < 0.01


@pytest.mark.slow
def test_yielding_fluid_flows_as_between_walls_at_the_last_row_and_half_a_spacing_out() -> None:
    of = PAPER["paper-herschel-bulkley-rk1"]
    last = by_reference(of.start(20, of.options)).snapshots[-1]
    n_wet = last.x_nc[:, 1] ** 2 <= 9**2
    y_n, mean = last.x_nc[n_wet, 1] / 2, last.v_nc[n_wet, 0].mean()
    inner, outer = (YIELDING.speed(y_n, last.time / 2, half).mean() for half in (5.0, 5.25))
    assert inner < mean < outer


def test_energy_that_is_held_stays() -> None:
    of = PAPER["paper-conduction-rk1-narrow"]
    begin = of.start(20, of.options)
    last = by_reference(begin).snapshots[-1]
    assert last.energy_n is not None
    # The set-up alone heats the plates, as LAMMPS' fix acts from the first step on.
    cold_n, warm_n = (last.energy_n[begin.atoms.type_n == t] for t in (2, 1))
    assert np.abs(cold_n).max() < 0.02 * warm_n.max()


@pytest.mark.parametrize("half", [5.0, 5.25])
def test_finite_volumes_give_the_series_of_a_newtonian_fluid(half: float) -> None:
    as_volumes = ChannelFluid(NEWTONIAN.eta, NEWTONIAN.gravity, gd0=1e3, power=1.0)
    y = np.linspace(-half, half, 41)
    exact = NEWTONIAN.speed(y, 50.0, half)
    # Cells of H/400 err by their square; between their centres the parabola is drawn by straight lines, as much again.
    assert as_volumes.speed(y, 50.0, half) == pytest.approx(exact, abs=4 * (1 / 400) ** 2 * exact.max())


def test_yielding_fluid_comes_to_the_closed_profile() -> None:
    y = np.linspace(1.25, 5.0, 16)  # beyond the Newtonian core of the regularised law
    plug, n = YIELDING.yielding / YIELDING.gravity, YIELDING.power
    size = n / (n + 1) * (YIELDING.gravity / YIELDING.K) ** (1 / n)
    closed = size * ((5.0 - plug) ** (1 + 1 / n) - (y - plug) ** (1 + 1 / n))
    assert YIELDING.speed(y, 2000.0, 5.0) == pytest.approx(closed, abs=2e-4 * closed.max())


@pytest.mark.parametrize("array", [SPHERES, CYLINDERS], ids=["spheres", "cylinders"])
def test_obstacle_fills_about_its_part_of_the_cell(array: ObstacleArray) -> None:
    of = PAPER["paper-sphere-rk1" if array is SPHERES else "paper-cylinder-rk1"]
    begin = of.start(16, of.options)
    share = np.mean(begin.atoms.type_n == 2)
    whole = 4 / 3 * np.pi * array.radius**3 if array is SPHERES else np.pi * array.radius**2
    assert share == pytest.approx(whole, rel=0.1)


def test_command_offers_the_benchmarks(eos_ref_command: Callable[..., Outcome]) -> None:
    outcome = eos_ref_command("validate", "papers")
    assert outcome.code == 2 and "did you mean 'paper'?" in outcome.err
    assert eos_ref_command("validate", "paper", "--quick", "--full").code == 2
