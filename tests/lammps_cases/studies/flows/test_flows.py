"""Flows of all kinds: orders on the reference, faults that they detect, how findings change them in LAMMPS.

Flows at which a measure falls with another order than expected have an error in the formulas; a planted mistake in a
property that the flow depends on must do that.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from scipy.stats import linregress

from eos_ref import EOS, InputError
from eos_ref.analytic.channel import column
from eos_ref.eos.bounds import EPS
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from eos_ref.kernels.quintic import QUINTIC
from lammps_cases.engine.session import Session
from lammps_cases.engine.workers import Workers
from lammps_cases.findings.forces import ForcePerVolume
from lammps_cases.findings.thermal import HeatAsTemperatureRate
from lammps_cases.findings.walls import WallVelocityLost
from lammps_cases.scene import Scene
from lammps_cases.setup import reference_side
from lammps_cases.studies.flows import periodic, surfaces
from lammps_cases.studies.flows.catalogue import FLOWS
from lammps_cases.studies.flows.flow import Options, Start
from lammps_cases.studies.flows.known import Flow
from lammps_cases.studies.flows.periodic import COMPRESSED, HEAT, MOVED, SHEAR, SOUND, SOUNDS, VORTICES, wave_number
from lammps_cases.studies.flows.record import LAMMPS, REFERENCE, FlowRecord, order, recorded
from lammps_cases.studies.flows.solve import by_lammps, by_reference, fit, in_worker
from lammps_cases.studies.flows.surfaces import DROP, INTERFACE, SHOCK_TUBE
from lammps_cases.studies.flows.walls import COMPRESSION, COUETTE, COUETTE_STORED, POISEUILLE, TANK
from tests.support.flow_faults import Plant, faster, in_scene, of_energy, of_gamma, of_gravity, of_types
from tests.support.roundings import HALF_EPS, rounded

pytestmark = pytest.mark.slow

SAME = 1e-8  # formulas that are the same on paper differ by roundings, which grow over hundreds of steps
QUICK = periodic.QUICK
BY_WALLS = (8, 12, 18)
RESOLUTIONS = (8, 12, 20, 30)


@pytest.fixture(scope="module")
def session() -> Session:
    return Session()


def quick(flow: Flow) -> Sequence[int]:
    """Resolutions at which the order is already seen."""
    return BY_WALLS if flow in (POISEUILLE, COUETTE, COUETTE_STORED, TANK) else flow.quick or QUICK


def solved(flow: Flow, engine: str, at: Sequence[int]) -> list[FlowRecord]:
    """Run a flow at some resolutions."""
    with Workers(None, 1) if engine == LAMMPS else nullcontext() as workers:
        solve = partial(in_worker, workers=workers) if workers else by_reference
        return [recorded(flow, n, engine, solve(flow.start(n, flow.options))) for n in at]


def one(flow: Flow, engine: str, options: Options | None = None, at: Sequence[int] = ()) -> list[FlowRecord]:
    found = solved(replace(flow, options=options or flow.options), engine, at or quick(flow))
    assert not any(run.message for run in found)
    return found


def errors_of(runs: Sequence[FlowRecord], measure: str = "") -> list[float]:
    """The errors of a measure, by default the first, from the coarsest resolution on."""
    return [run.errors[measure or next(iter(run.errors))] for run in runs]


# --- order of convergence


def lost(errors: list[float]) -> float:
    """Error of a slope, or of its standard error, by 8 roundings of every logarithm."""
    x = np.log(RESOLUTIONS) - np.log(RESOLUTIONS).mean()
    return float(8 * HALF_EPS * np.abs(np.log(errors)).max() * np.abs(x).sum() / (x**2).sum())


@pytest.mark.parametrize("errors", [[0.5, 0.21, 0.11, 0.03], [3.0 * n**-1.5 for n in RESOLUTIONS]])
def test_fit_is_least_squares(errors: list[float]) -> None:
    line = linregress(np.log(RESOLUTIONS), np.log(errors))
    found = fit(RESOLUTIONS, errors)
    expected = -line.slope, line.stderr
    assert (found.order, found.standard_error) == pytest.approx(expected, rel=0, abs=2 * lost(errors))


def test_fit_omits_missing_values() -> None:
    # ln 32 and ln 8, each 2.5 times their difference at most; that, ln 4 and the quotient.
    assert fit((8, 16, 32), (1.0, float("nan"), 0.25)).order == rounded(1.0, 8)
    assert np.isnan(fit((8, 16, 32), (1.0, float("nan"), 0.25)).standard_error)
    assert np.isnan(fit((8, 16), (1.0, 0.0)).order)


def test_flows_have_names_resolutions_and_orders() -> None:
    """Every flow is listed by its own name, at three or more resolutions, with a numeric order."""
    assert len(FLOWS) >= 9
    for name, flow in FLOWS.items():
        assert name == flow.name
        assert min(len(set(flow.resolutions)), len(set(flow.quick)) or 3) >= 3
        assert flow.expected.split(":")[0].isdecimal()


SECOND = (*periodic.FLOWS, POISEUILLE, COUETTE)
FIRST = (COUETTE_STORED, TANK, DROP, INTERFACE, SHOCK_TUBE)


def promised(flow: Flow) -> int:
    return 1 if flow in FIRST else 2


named = {"ids": lambda part: getattr(part, "name", str(part))}


@pytest.mark.parametrize("flow", [*SECOND, *FIRST], **named)
def test_order(flow: Flow) -> None:
    """Nearer to the expected order than to the next lower one, or better; of periodic flows in every measure."""
    assert str(promised(flow)) == flow.expected.split(":")[0]
    found = one(flow, REFERENCE)
    orders = [order(found, measure).order for measure in found[0].errors]
    assert min(orders if flow in periodic.FLOWS else orders[:1]) > promised(flow) - 0.5


def another_law(scene: Scene) -> dict[str, Any]:
    """The linear law: at a density other than rho0 every law has its own speed of sound."""
    return {"pressure": SOUND.start(QUICK[0], SOUND.options).case.scene.pressure}


@pytest.mark.parametrize(
    ("flow", "measure", "plant"),
    [
        pytest.param(SHEAR, "rate", of_types(viscosity=1.05), id="shear-viscosity"),
        pytest.param(HEAT, "rate", of_types(conductivity=1.05), id="heat-conductivity"),
        pytest.param(HEAT, "rate", of_types(specific_heat=1.05), id="heat-specific-heat"),
        pytest.param(VORTICES, "rate", of_types(viscosity=1.05), id="vortices-viscosity"),
        pytest.param(SOUND, "damping", of_types(viscosity=0.95), id="sound-viscosity"),
        # A gas with 10 % more energy, where sound is 5 % faster.
        *(
            pytest.param(f, "speed", of_energy(1.1) if "gas" in f.name else of_types(cs=1.05), id=f.name)
            for f in SOUNDS
        ),
        *(
            pytest.param(f, "speed", in_scene(another_law), id=f"{f.name}-of-another-law")
            for f in SOUNDS
            if not f.name.endswith(("linear", "gas"))
        ),
        pytest.param(POISEUILLE, "", of_types(viscosity=1.05), id="poiseuille-viscosity"),
        pytest.param(POISEUILLE, "", of_gravity(1.02), id="poiseuille-gravity"),
        pytest.param(COUETTE, "", of_types(viscosity=1.05), id="couette-viscosity"),
        pytest.param(COUETTE, "", faster(1.02), id="couette-speed"),
        pytest.param(TANK, "", of_gravity(1.02), id="tank-gravity"),
        pytest.param(TANK, "", of_types(cs=1.02), id="tank-sound"),
        pytest.param(DROP, "", faster(1.05), id="drop-rate"),
        pytest.param(DROP, "", of_types(cs=0.3), id="drop-sound"),
        pytest.param(INTERFACE, "", of_types((2,), mass=1.1), id="interface-mass"),
        pytest.param(INTERFACE, "", of_types((2,), rho0=1.1), id="interface-density"),
        pytest.param(SHOCK_TUBE, "", of_energy(1.1), id="shock-energy"),
        pytest.param(SHOCK_TUBE, "", of_gamma(1.45), id="shock-gamma"),
        pytest.param(SHOCK_TUBE, "", of_types((2,), mass=0.9), id="shock-mass-of-the-thin-gas"),
    ],
)
def test_order_detects_faults(flow: Flow, measure: str, plant: Plant) -> None:
    """In the measure of the property, or in the headline."""
    begin = flow.start
    found = one(replace(flow, start=lambda n, options: plant(begin(n, options))), REFERENCE, at=quick(flow))
    assert order(found, measure or next(iter(found[0].errors))).order < promised(flow) - 0.5


# --- how findings change flows in LAMMPS


class ForceAndWall(ForcePerVolume, WallVelocityLost):
    """The two findings that plane flow with a moving wall meets."""


def last_state(start: Start, stages: Any) -> dict[str, Any]:
    """Velocities, densities and energies at the end, by stages of the reference or of a variant."""
    scene = start.case.scene
    model, box = reference_side.model(scene, start.atoms, ""), reference_side.box(scene, start.atoms)
    simulation = Simulation(model, box, reference_side.state(scene, start.atoms), (), stages)
    simulation.run(start.steps[-1], start.timestep)
    return {name: simulation.output(name) for name in ("v", "rho", *(["energy"] if scene.thermal else []))}


@pytest.mark.lammps
@pytest.mark.parametrize(
    ("flow", "stages", "least"),
    [
        *((flow, ForcePerVolume, 0.0) for flow in (SHEAR, VORTICES, *SOUNDS, POISEUILLE)),  # hardly different
        *((flow, ForcePerVolume, 1e4) for flow in (TANK, SHOCK_TUBE)),
        *((flow, ForcePerVolume, 1e3) for flow in (DROP, INTERFACE)),
        (COUETTE, ForceAndWall, 1e4),
    ],
    **named,
)
def test_findings_account_for_lammps(flow: Flow, stages: type, least: float, session: Session) -> None:
    """The findings' variant reproduces LAMMPS: velocities over the largest, densities relative. The reference not."""
    n = 12 if flow in periodic.FLOWS else quick(flow)[0]
    start = flow.start(n, flow.options)
    found = by_lammps(start, session).snapshots[-1]
    for who, within in ((stages, True), (ArrayEvaluator, False)):
        ours = last_state(start, who)
        v = np.abs(found.v_nc - ours["v"]).max() / np.abs(ours["v"]).max()
        off = max(v, np.abs(found.rho_n / ours["rho"] - 1).max())
        assert off < SAME if within else off >= least * SAME
    if flow in periodic.FLOWS and flow is not VORTICES:
        assert np.abs(ours["rho"] / ours["rho"].mean() - 1).max() < 20 * COMPRESSED


@pytest.mark.lammps
@pytest.mark.parametrize("extra", [{}, {"cv": 2.0}, {"rho0": 2.0, "cv": 3.0}], ids=["unit", "cv", "rho0-cv"])
def test_findings_account_for_heat(extra: dict[str, float | str], session: Session) -> None:
    """heat-is-temperature-rate: diffusivity instead of conductivity; the same if m, V and cv are 1."""
    start = HEAT.start(12, replace(HEAT.options, extra=extra))
    found = by_lammps(start, session).snapshots[-1].energy_n
    assert found is not None
    assert found == pytest.approx(last_state(start, HeatAsTemperatureRate)["energy"], rel=SAME)
    assert (np.abs(last_state(start, ArrayEvaluator)["energy"] / found - 1).max() < SAME) == (not extra)


@pytest.mark.lammps
def test_heat_in_lammps_flows_slower_by_mass_and_heat_capacity() -> None:
    found = one(HEAT, LAMMPS, replace(HEAT.options, extra={"rho0": 2.0, "cv": 3.0}))
    assert errors_of(found, "rate") == pytest.approx([1 - 1 / 6] * len(QUICK), rel=wave_number(QUICK[0]) ** 2 / 6)


@pytest.mark.lammps
def test_lammps_drags_fluid_to_half_the_speed_of_a_plate() -> None:
    """wall-velocity-lost: U d_s/(d_s + d_f), and a wall half way between the rows has d_s = d_f."""
    errors = errors_of(one(COUETTE, LAMMPS))
    assert errors == pytest.approx([0.5] * len(BY_WALLS), abs=0.5 / BY_WALLS[0] ** 2)


@pytest.mark.lammps
def test_lammps_tank_has_an_error_of_the_size_of_its_compression() -> None:
    """force-per-volume: forces of rho g on masses m. The error is at most rho/rho0 - 1, twice that in a swing."""
    hardly = replace(TANK.options, extra={"compression": COMPRESSION / 40})
    errors, smaller = (errors_of(one(TANK, LAMMPS, how)) for how in (None, hardly))
    assert all(0.5 * COMPRESSION < error < 2 * COMPRESSION for error in errors)
    assert all(new < old / 4 for new, old in zip(smaller, errors, strict=True))


@pytest.mark.lammps
def test_lammps_shock_converges_to_the_solution_without_volumes() -> None:
    """force-per-volume, as a closed solution: LAMMPS converges to it and not to that of the gas."""
    found = one(SHOCK_TUBE, LAMMPS)
    for name in ("density", "velocity"):
        assert order(found, name).order < 0.5 < order(found, f"{name} without volume").order
        assert found[-1].errors[name] > found[-1].errors[f"{name} without volume"]


@pytest.mark.lammps
@pytest.mark.parametrize("flow", [DROP, INTERFACE], **named)
def test_lammps_converges_with_the_same_errors(flow: Flow) -> None:
    """Volumes stay near 1, so the missing volume changes the error by less than a tenth."""
    ours, theirs = (errors_of(one(flow, engine)) for engine in (REFERENCE, LAMMPS))
    np.testing.assert_allclose(theirs, ours, rtol=0.1)


# --- periodic flows: what is known of their errors


def test_shear_wave_decays_as_its_lattice_does() -> None:
    """Rate of a lattice, -2 nu sum V W'/r (1 - cos k x), with forces half a step old."""
    n, options = 16, Options()
    start = SHEAR.start(n, options)
    k, nu, dt = wave_number(n), start.case.scene.types[0].viscosity, start.timestep
    assert isinstance(nu, float)
    x_p, y_p = (a.ravel() for a in np.meshgrid(np.arange(-3, 4), np.arange(-3, 4)))
    r_p = np.hypot(x_p, y_p)
    near = (r_p > 0) & (r_p < options.cut)
    x_p, r_p = x_p[near], r_p[near]
    slope_p = QUINTIC.normalisation(2, options.cut) * QUINTIC.slope(r_p)
    rate = -2 * nu * np.sum(slope_p / r_p * (1 - np.cos(k * x_p)))
    exact = -np.log(1 - rate * dt) / dt / (nu * k**2) - 1
    found = SHEAR.measures(n, options, by_reference(start).snapshots)["rate"]
    assert found == pytest.approx(abs(exact), abs=MOVED**2)
    assert found > 50 * MOVED  # the compared error is far above the uncertainty due to the motion of particles


@pytest.mark.lammps
@pytest.mark.parametrize("name", [REFERENCE, LAMMPS])
def test_sound_grows_at_long_time_steps(name: str) -> None:
    """The pressure lags by half a step, so damping is too small by a fraction c^2 dt/(2 nu); above 1 the wave grows."""
    n, errors = 24, []
    for fraction in (1.0, 0.5):
        options = replace(SOUND.options, dt_fraction=fraction, extra={"attenuation": 0.003})
        missed = SOUND.start(n, options).timestep / (2 * 0.003 * n)
        errors.append(one(SOUND, name, options, (n,))[0].errors["damping"])
        assert errors[-1] == pytest.approx(missed, rel=(wave_number(n)) ** 2)  # except for the kernel's smoothing
    assert errors[0] > 1 > errors[1]


def test_summed_density_keeps_the_error_of_its_sum() -> None:
    """The sum over a lattice has the same error at every resolution, and the wave still converges."""
    found = one(SOUND, REFERENCE, Options(kernel="RK1", rho_sum=True))
    cells = np.arange(-3, 4)
    r_nn = np.hypot(cells[:, None], cells)
    missed = np.sum(np.where(r_nn < 3, QUINTIC.normalisation(2, 3.0) * QUINTIC.shape(r_nn), 0.0)) - 1
    assert errors_of(found, "mean") == pytest.approx([abs(missed)] * len(QUICK), abs=COMPRESSED**2)
    assert order(found, "speed").order > promised(SOUND) - 0.5


def test_start_of_sound_conserves_mass() -> None:
    """Spacing times density is the mass of a column, to second order in the spacing over the wavelength."""
    n = 32
    atoms = SOUND.start(n, SOUND.options).atoms
    assert atoms.rho_n is not None
    x_n, rho_n = atoms.x_nc[:n, 0], atoms.rho_n[:n]
    mass_n = np.diff(x_n) * (rho_n[1:] + rho_n[:-1]) / 2
    assert mass_n == pytest.approx(atoms.mass_n[0], rel=COMPRESSED * wave_number(n) ** 2)
    assert np.ptp(rho_n) > 1.9 * COMPRESSED and len(atoms) == n * periodic.STRIP


# --- the tank and the shock tube


@pytest.mark.parametrize("law", ["linear", "tait/water"])
def test_tank_rows_have_equal_mass(law: str) -> None:
    """Spacing times density is the mass of a row, to second order; the surface has the density at rest."""
    n = 12
    atoms = TANK.start(n, replace(TANK.options, extra={"law": law})).atoms
    fluid_n = (atoms.type_n == 1) & (atoms.x_nc[:, 0] < 1)
    assert atoms.rho_n is not None
    y_n, rho_n = atoms.x_nc[fluid_n, 1], atoms.rho_n[fluid_n]
    assert np.diff(y_n) * (rho_n[1:] + rho_n[:-1]) / 2 == pytest.approx(1.0, rel=(COMPRESSION / n) ** 2)
    expected = column(EOS("tait/water" if law == "tait/water" else "linear"), 0.5, COMPRESSION / n)[1]
    assert rho_n[-1] == float(expected)


def test_shock_without_volumes_solves_its_equations() -> None:
    """The mass stays; in the fan du/dt = -dP/dx / m and d rho/dt = -rho du/dx, by central differences."""
    gases = surfaces.problem(Options())
    left, t, d = gases.left, 1.3, 1e-5
    x_n = np.linspace(-3.0, 3.0, 600_001)
    mass = np.trapezoid(surfaces.without_volume(gases, x_n, t)[0], x_n)
    assert mass == pytest.approx(3 * (left.rho + gases.right.rho), abs=x_n[1] - x_n[0])
    x_n = np.linspace(-0.95, -0.5, 10) * t * left.c

    def rates(dx: float, dt: float) -> list[Any]:
        ends = (surfaces.without_volume(gases, x_n + s * dx, t + s * dt) for s in (1, -1))
        return [(a - b) / (2 * d) for a, b in zip(*ends, strict=True)]

    (rho_t, u_t), (rho_x, u_x) = rates(0, d), rates(d, 0)
    rho_n, u_n = surfaces.without_volume(gases, x_n, t)
    # Central differences of a profile with lengths and times of 1: d^2, and ten roundings over d.
    allowed = d**2 + 10 * EPS / d
    np.testing.assert_allclose(rho_t + u_n * rho_x + rho_n * u_x, 0.0, atol=allowed)
    np.testing.assert_allclose(u_t + u_n * u_x + left.c**2 * rho_x / left.rho, 0.0, atol=allowed)


# --- runs that fail, options that are refused


@pytest.mark.parametrize(
    ("flow", "extra", "words"),
    [
        (SOUND, {"law": "ideal"}, "option law"),
        (HEAT, {"cv": "two"}, "must be a number"),
        (SHOCK_TUBE, {"thin": 1.5}, "thin"),
    ],
    **named,
)
def test_bad_options_are_refused(flow: Flow, extra: dict[str, float | str], words: str) -> None:
    with pytest.raises(InputError, match=words):
        flow.start(60, replace(flow.options, extra=extra))


def test_only_lammps_errors_become_messages() -> None:
    """A bug of this project is not blamed on LAMMPS."""
    with pytest.raises(AttributeError):
        by_lammps(SHEAR.start(8, SHEAR.options), None)


@pytest.mark.lammps
def test_refused_run_leaves_a_message() -> None:
    """A shear wave lacks an argument at resolution 12."""

    def refused(n: int, options: Options) -> Start:
        plant = in_scene(lambda scene: {"violate": "unknown-pressure-style" if n == 12 else None})
        return plant(SHEAR.start(n, options))

    found = solved(replace(SHEAR, start=refused), LAMMPS, (8, 12, 16))
    assert ["ERROR" in run.message for run in found] == [False, True, False]
    assert [bool(run.errors) for run in found] == [True, False, True]
    assert order(found, "rate").order == pytest.approx(2.0, abs=0.5)  # from two coarse runs: nearer to 2 than to 1 or 3


@pytest.mark.lammps
def test_lost_atoms_leave_a_message() -> None:
    start = SHEAR.start(8, SHEAR.options)
    v_nc = start.atoms.v_nc
    assert v_nc is not None

    def moving(v_nc: Any) -> Start:
        return replace(start, atoms=replace(start.atoms, v_nc=v_nc))

    with Workers(None, 1) as workers:
        fled = in_worker(moving(v_nc + np.array([1e9, 0.0, 0.0])), workers)
        assert fled.lost and "Lost atoms" in fled.message
        unreal = in_worker(moving(v_nc * np.nan), workers)
        assert not unreal.lost and unreal.message
        late = in_worker(SHEAR.start(48, SHEAR.options), workers, 0.01)
        assert not late.lost and "time limit" in late.message
        assert not in_worker(start, workers).message  # the worker lives on


@pytest.mark.parametrize("evaluator", [None, ArrayEvaluator])
def test_snapshots_are_at_the_requested_steps(evaluator: Callable[..., Any] | None) -> None:
    start = SHEAR.start(8, SHEAR.options)
    sampled = replace(start, steps=(0, 3, start.steps[-1]))
    result = by_reference(sampled, evaluator)
    assert [shot.time for shot in result.snapshots] == [step * start.timestep for step in sampled.steps]
    assert np.array_equal(result.snapshots[0].x_nc, start.atoms.x_nc[:, :2])
    assert (result.n, result.steps, result.message) == (64, start.steps[-1], "")
    assert not np.array_equal(result.snapshots[1].v_nc, result.snapshots[2].v_nc)
