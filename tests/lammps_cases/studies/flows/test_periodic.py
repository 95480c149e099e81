"""Periodic flows: order on the reference, faults that it detects, differences of LAMMPS."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eos_ref import InputError
from eos_ref.evaluation.time_step import Simulation
from eos_ref.kernels.quintic import QUINTIC
from lammps_cases.engine.session import Session
from lammps_cases.findings.forces import ForcePerVolume
from lammps_cases.findings.thermal import HeatAsTemperatureRate
from lammps_cases.setup import reference_side
from lammps_cases.studies.flows.flow import Flow, Options, Start
from lammps_cases.studies.flows.periodic import (
    COMPRESSED,
    FLOWS,
    HEAT,
    MOVED,
    QUICK,
    SHEAR,
    SOUND,
    SOUNDS,
    STRIP,
    VORTICES,
    wave_number,
)
from lammps_cases.studies.flows.solve import ENGINES, Engine, by_lammps, by_reference, converge
from tests.support.flow_faults import Plant, differences, in_scene, of_types

pytestmark = pytest.mark.slow

PROMISED = 2
SAME = 1e-8  # formulas that are the same on paper differ by roundings, which grow over hundreds of steps


@pytest.fixture(scope="module")
def session() -> Session:
    return Session()


def orders(flow: Flow, plant: Plant | None = None) -> dict[str, float]:
    """Order of every measure on the reference, with or without a mistake."""
    if plant is not None:
        planted, begin = plant, flow.start
        flow = replace(flow, start=lambda n, options: planted(begin(n, options)))
    (found,) = converge(flow, engines=("reference",), resolutions=QUICK)
    return {measure: found.fit(measure).order for measure in found.errors}


def hotter(start: Start) -> Start:
    """A gas with 10 % more energy, where sound is 5 % faster."""
    assert start.atoms.energy_n is not None
    return replace(start, atoms=replace(start.atoms, energy_n=1.1 * start.atoms.energy_n))


@pytest.mark.parametrize("flow", FLOWS, ids=lambda flow: flow.name)
def test_order(flow: Flow) -> None:
    """Every measure converges with an order nearer to the expected one than to the next lower one, or better."""
    assert str(PROMISED) == flow.expected.split(":")[0]
    assert min(orders(flow).values()) > PROMISED - 0.5


@pytest.mark.parametrize(
    ("flow", "measure", "plant"),
    [
        pytest.param(SHEAR, "rate", of_types(viscosity=1.05), id="shear-viscosity"),
        pytest.param(HEAT, "rate", of_types(conductivity=1.05), id="heat-conductivity"),
        pytest.param(HEAT, "rate", of_types(specific_heat=1.05), id="heat-specific-heat"),
        pytest.param(VORTICES, "rate", of_types(viscosity=1.05), id="vortices-viscosity"),
        pytest.param(SOUND, "damping", of_types(viscosity=0.95), id="sound-viscosity"),
        *(
            pytest.param(flow, "speed", hotter if "gas" in flow.name else of_types(cs=1.05), id=flow.name)
            for flow in SOUNDS
        ),
    ],
)
def test_order_detects_faults(flow: Flow, measure: str, plant: Plant) -> None:
    assert orders(flow, plant)[measure] < PROMISED - 0.5


@pytest.mark.parametrize(
    "flow", [flow for flow in SOUNDS if not flow.name.endswith(("linear", "gas"))], ids=lambda flow: flow.name
)
def test_order_detects_another_law(flow: Flow) -> None:
    """At a density other than rho0 every law has its own speed of sound."""
    law = SOUND.start(QUICK[0], SOUND.options).case.scene.pressure
    assert orders(flow, in_scene(lambda scene: {"pressure": law}))["speed"] < PROMISED - 0.5


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
@pytest.mark.parametrize("name", ENGINES)
def test_sound_grows_at_long_time_steps(name: Engine) -> None:
    """The pressure lags by half a step, so damping is too small by a fraction c^2 dt/(2 nu); above 1 the wave grows."""
    n, errors = 24, []
    for fraction in (1.0, 0.5):
        options = replace(SOUND.options, dt_fraction=fraction, extra={"attenuation": 0.003})
        start = SOUND.start(n, options)
        missed = start.timestep / (2 * 0.003 * n)
        (found,) = converge(SOUND, options, (name,), (n,))
        errors.append(found.errors["damping"][0])
        assert errors[-1] == pytest.approx(missed, rel=(wave_number(n)) ** 2)  # except for the kernel's smoothing
    assert errors[0] > 1 > errors[1]


@pytest.mark.lammps
@pytest.mark.parametrize("flow", [SHEAR, VORTICES, *SOUNDS], ids=lambda flow: flow.name)
def test_findings_account_for_lammps(flow: Flow, session: Session) -> None:
    """With forces per volume the reference reproduces LAMMPS."""
    n = 12
    shot = by_reference(flow.start(n, flow.options)).snapshots[-1]
    assert max(differences(flow, n, ForcePerVolume, session)) < SAME
    assert np.abs(shot.rho_n / shot.rho_n.mean() - 1).max() < 20 * COMPRESSED or flow is VORTICES


@pytest.mark.lammps
@pytest.mark.parametrize("extra", [{}, {"cv": 2.0}, {"rho0": 2.0, "cv": 3.0}], ids=["unit", "cv", "rho0-cv"])
def test_findings_account_for_heat(extra: dict[str, float | str], session: Session) -> None:
    """heat-is-temperature-rate: diffusivity instead of conductivity; the same if m, V and cv are 1."""
    n, options = 12, replace(HEAT.options, extra=extra)
    start = HEAT.start(n, options)
    found = by_lammps(start, session).snapshots[-1]
    scene = start.case.scene
    model, box = reference_side.model(scene, start.atoms, ""), reference_side.box(scene, start.atoms)
    simulation = Simulation(model, box, reference_side.state(scene, start.atoms), (), HeatAsTemperatureRate)
    simulation.run(start.steps[-1], start.timestep)
    assert found.energy_n == pytest.approx(simulation.output("energy"), rel=SAME)
    ours = by_reference(start).snapshots[-1]
    assert ours.energy_n is not None and found.energy_n is not None
    assert (np.abs(ours.energy_n / found.energy_n - 1).max() < SAME) == (not extra)


@pytest.mark.lammps
def test_heat_in_lammps_flows_slower_by_mass_and_heat_capacity() -> None:
    options = replace(HEAT.options, extra={"rho0": 2.0, "cv": 3.0})
    (found,) = converge(HEAT, options, ("lammps",), QUICK)
    assert found.errors["rate"] == pytest.approx([1 - 1 / 6] * len(QUICK), rel=wave_number(QUICK[0]) ** 2 / 6)


def test_summed_density_keeps_the_error_of_its_sum() -> None:
    """The sum over a lattice has the same error at every resolution, and the wave still converges."""
    options = Options(kernel="RK1", rho_sum=True)
    (found,) = converge(SOUND, options, ("reference",), QUICK)
    cells = np.arange(-3, 4)
    r_nn = np.hypot(cells[:, None], cells)
    missed = np.sum(np.where(r_nn < 3, QUINTIC.normalisation(2, 3.0) * QUINTIC.shape(r_nn), 0.0)) - 1
    assert found.errors["mean"] == pytest.approx([abs(missed)] * len(QUICK), abs=COMPRESSED**2)
    assert found.fit("speed").order > PROMISED - 0.5


def test_start_conserves_mass() -> None:
    """Spacing times density is the mass of a column, to second order in the spacing over the wavelength."""
    n = 32
    atoms = SOUND.start(n, SOUND.options).atoms
    assert atoms.rho_n is not None
    x_n, rho_n = atoms.x_nc[:n, 0], atoms.rho_n[:n]
    mass_n = np.diff(x_n) * (rho_n[1:] + rho_n[:-1]) / 2
    assert mass_n == pytest.approx(atoms.mass_n[0], rel=COMPRESSED * wave_number(n) ** 2)
    assert np.ptp(rho_n) > 1.9 * COMPRESSED and len(atoms) == n * STRIP


def test_unknown_law_is_refused() -> None:
    with pytest.raises(InputError, match="option law"):
        SOUND.start(16, Options(extra={"law": "ideal"}))
    with pytest.raises(InputError, match="must be a number"):
        HEAT.start(16, Options(extra={"cv": "two"}))
