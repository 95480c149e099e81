"""Advised numbers: their formulas, and flows that run with them on both sides, and no longer beyond them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis.strategies import floats

from eos_ref import InputError
from lammps_cases.audit.flow_scales import scales_of_scene
from lammps_cases.audit.options import Given
from lammps_cases.engine.session import Session
from lammps_cases.studies.flows.flow import Options, Start, fluid, forces, rows, start
from lammps_cases.studies.flows.solve import FlowResult, by_lammps, by_reference
from lammps_cases.studies.stability.choice import AdvisedNumbers, FlowScales, evidence, lattice_error, strictest
from lammps_cases.studies.stability.limits import read
from tests.support.roundings import rounded
from tests.workshop import measured_flows

N, LAYERS, STEPS = 12, 3, 300
FLUID = fluid(cs=1.0, viscosity=0.2)
WALLS = [FLUID, {**FLUID, "phase": "solid"}]


def made(name: str, scene: dict[str, Any], x_nc: Any, high: Any, low: Any = (0.0, 0.0), **more: Any) -> Start:
    return start(name, scene, x_nc, high, low, options=Options(), times=[STEPS * 0.1], timestep=0.1, **more)


def tank() -> Start:
    x_nc = rows(-LAYERS, N, 8)
    scene = {"types": WALLS, "rheo": {"interface_reconstruct": True}, "forces": forces(gravity=(0.0, -1e-3))}
    return made(
        "tank", scene, x_nc, (8.0, 2.0 * N), (0.0, -LAYERS - 1.0), periodic=(True, False), type_n=solid_below(x_nc)
    )


def solid_below(x_nc: Any) -> Any:
    return np.where(x_nc[:, 1] > 0, 1, 2)


def channel() -> Start:
    x_nc = rows(-LAYERS, N + LAYERS, 8)
    y_n = x_nc[:, 1]
    pull = [{"style": "gravity", "vector": (1e-4, 0.0), "types": "1"}]
    scene = {"types": WALLS, "forces": [*pull, *forces()]}
    type_n = np.where((y_n > 0) & (y_n < N), 1, 2)
    return made("channel", scene, x_nc, (8.0, N + LAYERS), (0.0, -LAYERS), type_n=type_n)


def dam() -> Start:
    x_nc = rows(-LAYERS, N + 4, 3 * N + 2 * LAYERS) - np.array([LAYERS, 0.0])
    x_n, y_n = x_nc.T
    wet_n = (y_n > 0) & (y_n < N) & (x_n > 0) & (x_n < N / 2)
    solid_n = (y_n < 0) | (x_n < 0) | (x_n > 3 * N)
    scene = {
        "types": WALLS,
        "rheo": {"interface_reconstruct": True},
        "forces": forces(gravity=(0.0, -1e-3)),
        "pair": {"artificial_visc": 0.1, "rho_damp": 0.1},
    }
    low, high = (-LAYERS - 1.0,) * 2, (3.0 * N + LAYERS + 1, 2.0 * N)
    kept_n = wet_n | solid_n
    type_n = np.where(wet_n, 1, 2)[kept_n]
    return made("dam", scene, x_nc[kept_n], high, low, type_n=type_n, periodic=(False, False))


def vortices() -> Start:
    x_nc, k = rows(0, N, N), 2 * np.pi / N
    x_n, y_n = x_nc.T
    v_nc = 0.05 * np.stack([-np.cos(k * x_n) * np.sin(k * y_n), np.sin(k * x_n) * np.cos(k * y_n)], axis=1)
    return made("vortices", {"types": [FLUID]}, x_nc, (N, N), v_nc=v_nc)


def advised(of: Start) -> AdvisedNumbers:
    flow = scales_of_scene(of.case.scene, of.atoms, Given(), of.case.name)
    return strictest([flow], 0.01, read())


def with_numbers(of: Start, choice: AdvisedNumbers, times: float = 1.0) -> Start:
    """The start with the advised numbers, its time step that often, for `STEPS` steps."""
    scene, dt = of.case.scene, times * choice.of("time step")
    types = tuple(kind.model_copy(update={"cs": choice.of("speed of sound")}) for kind in scene.types)
    rheo = scene.rheo.model_copy(update={name: choice.of(name) for name in ("kernel", "cut", "zmin")})
    evolve = scene.evolve.model_copy(update={"timestep": dt, "steps": STEPS})
    pair = scene.pair.model_copy(update={"rho_damp": choice.of("rho/damp")})
    changed = scene.model_copy(update={"types": types, "rheo": rheo, "evolve": evolve, "pair": pair})
    return replace(of, case=replace(of.case, scene=changed), steps=(100, 200, STEPS), timestep=dt)


def varied(of: Start, run: Callable[[Start], FlowResult]) -> float:
    """By how much densities of the fluid vary in a run; infinite where it breaks off."""
    try:
        with np.errstate(all="ignore"):
            snapshots = run(of).snapshots
    except InputError:
        return math.inf
    fluid_n = of.atoms.type_n == 1
    off = max((float(np.abs(shot.rho_n[fluid_n] - 1).max()) for shot in snapshots), default=math.inf)
    return off if len(snapshots) == len(of.steps) and math.isfinite(off) else math.inf


FLOWS: dict[str, tuple[Callable[[], Start], str]] = {
    "tank": (tank, "tank"),
    "channel": (channel, "poiseuille"),
    "dam": (dam, "dam-break"),
    "vortices": (vortices, "taylor-green"),
}


def on_lammps(of: Start) -> FlowResult:
    return by_lammps(of, Session())


@pytest.mark.slow
@pytest.mark.lammps
@pytest.mark.parametrize("name", FLOWS)
def test_advised_flow_is_stable_on_both_sides_and_not_far_beyond(name: str) -> None:
    make, like = FLOWS[name]
    of = make()
    choice = advised(of)
    assert choice.flow.like == like
    assert choice.fails is not None and choice.fails > choice.of("time step")
    for run in (by_reference, on_lammps):
        assert varied(with_numbers(of, choice), run) <= 0.01
        assert varied(with_numbers(of, choice, 2 * choice.fails / choice.of("time step")), run) > 0.05


SCALES = FlowScales(
    like="tank", dimension=2, spacing=1.0, length=12.0, speed=0.02, because="", head=0.012, sudden=False, gravity=1e-3,
    sound=1.0, stiffest=1.0, nu=0.2, heat=0.0, smoothing=0.0, tension=0.0, artificial=False, surface=True, fewest=14,
    pressures=1.0, viscous=1.0, kernel="quintic", cut=3.0, zmin=0, timestep=0.1,
)  # fmt: skip


def chosen(compressibility: float = 0.01, **changed: Any) -> AdvisedNumbers:
    return strictest([replace(SCALES, **changed)], compressibility, read())


# What changes, the subject, the advised number.
CHOSEN: list[tuple[dict[str, Any], str, Any]] = [
    ({}, "speed of sound", 1.1),  # (g H / 0.01)^(1/2) = 1.095
    ({"sudden": True}, "speed of sound", 1.55),
    ({"speed": 0.2}, "speed of sound", 2.0),
    ({"nu": 20.0, "head": 0.0}, "speed of sound", 1.83),  # (nu U/L / 0.01)^(1/2)
    ({"tension": 0.3}, "speed of sound", 1.59),  # (sigma/rho L / 0.01)^(1/2)
    ({"sound": math.nan}, "speed of sound", None),  # a gas
    ({"speed": 0.0, "head": 0.0}, "speed of sound", 1.0),  # heat in a fluid at rest: kept
    ({}, "time step", 0.22),  # h/4(c+U)
    ({"stiffest": 2.0, "artificial": True}, "time step", 0.11),  # of two types the faster one
    ({"nu": 2.0}, "time step", 0.062),  # h^2/8nu
    ({"heat": 4.0}, "time step", 0.031),
    ({"gravity": 10.0}, "time step", 0.079),  # (h/g)^(1/2)/4
    ({"tension": 0.3}, "time step", 0.15),
    ({"tension": 30.0, "artificial": True}, "time step", 0.015),
    ({"nu": 0.11}, "time step", 0.18),  # 2nu/c^2
    ({"nu": 0.01}, "rho/damp", 0.11),  # 0.1 h c
    ({"nu": 0.01, "artificial": True}, "rho/damp", 0.0),
    (
        {"pressures": 100.0, "viscous": 100.0, "nu": 0.02, "artificial": True},
        "time step",
        0.022,
    ),  # LAMMPS' sound is ten times as fast
    ({"pressures": 0.01, "viscous": 0.01}, "time step", 0.22),  # the reference's is the faster one
    ({"kernel": "RK1", "zmin": 8}, "kernel", "quintic"),  # a free surface
    ({"surface": False}, "kernel", "RK1"),
    ({"surface": False, "kernel": "RK2"}, "kernel", "RK2"),
    ({"surface": False, "zmin": 40}, "zmin", 14),
    ({"surface": False}, "zmin", 3),
    ({"surface": False, "dimension": 3}, "zmin", 4),
    ({"cut": 2.2}, "cut", 3.0),
    ({"cut": 2.4}, "cut", 2.4),
    ({"cut": 5.0}, "cut", 3.0),
    ({"like": "dam-break", "artificial": True}, "rho/damp", 0.11),
    ({"like": "taylor-green-100", "speed": 2.0}, "spacing", 0.833),  # U dx/nu = 10, measured up to 8.33
    ({"like": "taylor-green-100"}, "spacing", 1.0),
    ({"surface": False}, "background pressure", "none"),
    ({"options": ("rho/sum",)}, "rho/sum", "off"),
]


@pytest.mark.parametrize(("changed", "subject", "expected"), CHOSEN)
def test_chosen_number(changed: dict[str, Any], subject: str, expected: Any) -> None:
    line = chosen(**changed).line(subject)
    assert (line.now if line.advised is None else line.advised) == expected or expected is line.advised is None
    assert line.why


def test_great_compressibility_needs_a_background_pressure() -> None:
    line = chosen(0.1, surface=False, speed=0.3).line("background pressure")
    assert line.advised == "rho0 c^2 x 0.075" and "particles clump from -0.025 on (map tension)" in line.why


def test_of_several_runs_the_strictest_number_counts() -> None:
    choice = strictest([replace(SCALES, speed=0.2), SCALES, replace(SCALES, gravity=10.0)], 0.01, read())
    assert choice.of("speed of sound") == 2.0
    assert choice.of("time step") == 0.079
    assert choice.limits["h/4(c+U)"] == rounded(1 / 4 / (2.0 + 0.02), 8)


@given(length=floats(1e-4, 1e4), time=floats(1e-6, 1e6))
def test_numbers_have_the_units_of_the_deck(length: float, time: float) -> None:
    """In other units of length and time the same flow has the same numbers, to the digits that are printed."""
    speed, nu = length / time, length**2 / time
    of = {"spacing": length, "length": length, "cut": length, "speed": speed, "sound": speed, "nu": nu, "smoothing": nu}
    of |= {"head": speed**2, "gravity": length / time**2, "timestep": time}
    there = chosen(**{name: getattr(SCALES, name) * factor for name, factor in of.items()})
    for subject, unit, digits in (("speed of sound", speed, 0.011), ("time step", time, 0.12), ("cut", length, 0.051)):
        assert there.of(subject) / unit == pytest.approx(chosen().of(subject), rel=digits)
    assert there.flow.cell == pytest.approx(SCALES.cell)


def test_lattice_error_is_that_of_the_flows() -> None:
    assert f"{lattice_error(2, 3.0):.1e} {lattice_error(2, 2.7):.1e}" == "8.0e-04 -1.4e-04"  # see the flow tank
    assert lattice_error(2, 2.2) == pytest.approx(-0.047, abs=5e-4)


def test_expected_error_is_scaled_by_the_measured_order() -> None:
    known = evidence()["flows"]["tank"]
    said = str(chosen(length=2.0 * known["n"], spacing=1.0).of("error"))
    assert said == f"{known['reference'] / 2 ** known['order']:.2g} reference, 0.015 LAMMPS".replace("e-0", "e-")
    assert all(chosen(like=name).of("error") for name in evidence()["flows"])
    assert chosen(options=("shift", "thermal")).line("cost").why.startswith("2.23 µs per particle")


def test_evidence_is_that_of_the_tables() -> None:
    assert measured_flows.evidence() == evidence()


@pytest.mark.slow
@pytest.mark.parametrize(("kernel", "dt"), [("quintic", 0.1), ("quintic", 0.3), ("RK1", 0.1)])
def test_sound_grows_beyond_the_limit_of_rho_damp(kernel: Any, dt: float) -> None:
    """The rate over k^2 of a long wave is c^2 dt/4 - (nu + rho/damp)/2; RK1's diffusion leaves long waves alone."""
    n, damp, amplitude, x_nc = 24, 0.1, 1e-4, rows(0, 8, 24)
    rho_n = 1 + amplitude * np.cos(2 * np.pi / n * x_nc[:, 0])
    scene = {"types": [fluid(viscosity=0.0)], "pair": {"rho_damp": damp}}
    options = Options(kernel=kernel, zmin=0 if kernel == "quintic" else 3)
    of = start("wave", scene, x_nc, (n, 8), options=options, times=[75.0], timestep=dt, rho_n=rho_n)
    [last] = by_reference(of).snapshots
    energy = np.sum(last.v_nc**2) + np.sum((last.rho_n - 1) ** 2)
    rate = np.log(energy / np.sum((rho_n - 1) ** 2)) / (2 * last.time) / (2 * np.pi / n) ** 2
    known = dt / 4 - (damp / 2 if kernel == "quintic" else 0.0)
    assert rate == pytest.approx(known, rel=0.2)
    assert (rate > 0) == (dt > 2 * damp or kernel == "RK1")
