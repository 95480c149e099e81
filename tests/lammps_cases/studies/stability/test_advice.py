"""Advice: how far a scene lies from measured limits, and when it warns."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eos_ref import InputError
from eos_ref.kernels.quintic import quintic
from eos_ref.model.box import Box
from eos_ref.model.parameters import Model
from eos_ref.model.state import State
from lammps_cases.audit.evaluation import ParticleSample, TimedSample
from lammps_cases.audit.warn import Questions
from lammps_cases.setup import reference_side
from lammps_cases.studies.flows.flow import Options, Start, rows, start
from lammps_cases.studies.stability.advice import advice, judge
from lammps_cases.studies.stability.limits import (
    Curve,
    LimitPoint,
    Limits,
    Numbers,
    Tension,
    measured,
    numbers,
    read,
    save,
)
from lammps_cases.studies.stability.model import Axis, Boundary, FailureCriteria, MapCell, StabilityMap
from tests.support.outcome import Outcome
from tests.support.roundings import rounded

NU, CS, MASS = 0.4, 3.0, 1.5  # that of the scene; h = cut/3 = 0.9


def square(dt: float, viscosity: float = MASS * NU, cs: float = CS, **scene: Any) -> Start:
    """Fluid at rest on a square lattice."""
    kind = {"mass": MASS, "rho0": MASS, "cs": cs, "viscosity": viscosity}
    made = {"types": [kind], "pressure": [{"types": "*", "style": "linear"}], **scene}
    return start("square", made, rows(0, 9, 9), (9.0, 9.0), options=Options(cut=2.7), times=[dt], timestep=dt)


def parts(made: Start) -> tuple[Model, Box, State, float]:
    scene, atoms = made.case.scene, made.atoms
    return (
        reference_side.model(scene, atoms, ""),
        reference_side.box(scene, atoms),
        reference_side.state(scene, atoms),
        made.timestep,
    )


RATIO = NU / (CS * 0.9)  # below 1/2: sound limits the step
LIMITS = Limits(
    "1",
    (
        Curve(
            "step", "", "lammps", "energy growth", (LimitPoint(RATIO / 10, 2.0, 2.1), LimitPoint(RATIO * 10, 0.5, 0.6))
        ),
        Curve("step", "", "reference", "energy growth", (LimitPoint(RATIO, 0.01, 0.02),)),
        Curve("other", "shift", "reference", "clumping", (LimitPoint(RATIO, 1.5, 1.6),)),
    ),
)

LIMIT = 1.0 * 0.9 / (4 * CS)  # 1 is halfway, in logarithms, between 2 and 0.5


@pytest.mark.parametrize(("fraction", "warns"), [(0.5, False), (0.9, True), (1.5, True)])
def test_time_step_above_the_measured_limit_warns(fraction: float, warns: bool) -> None:
    [first] = [line for line in advice(*parts(square(fraction * LIMIT)), LIMITS) if "of the measured limit" in line]
    expected = f"time step {fraction * LIMIT:.3g} is {100 * fraction:.0f} % of the measured limit (0.075 to "
    assert first.startswith(("warning: " if warns else "") + expected)
    assert "sound; map step: energy growth)" in first
    viscous = f"{200 * fraction * RATIO:.0f} % of the viscous limit h^2/8nu"
    assert f"{100 * fraction:.0f} % of CFL h/4(c+U), {viscous}" in first
    assert "outside the measured" not in first


def test_lammps_limits_precede_the_reference_and_near_ones_far() -> None:
    [said, *_] = judge(*parts(square(0.5 * LIMIT)), replace(LIMITS, curves=LIMITS.curves[1:]))
    assert "map step: energy growth" in said.text
    assert "50 times the measured limit" in said.text
    [said, *_] = judge(*parts(square(0.5 * LIMIT)), replace(LIMITS, curves=LIMITS.curves[2:]))
    assert "33 % of the measured limit" in said.text and "sound; map other, shift: clumping, outside" in said.text


def test_viscosity_outside_the_measured_range_is_reported() -> None:
    for viscosity, dt in ((0.0, 2.0 * 0.9 / (4 * CS)), (MASS * NU * 100, 0.5 * 0.9**2 / (8 * NU * 100))):
        [said, *_] = judge(*parts(square(0.7 * dt, viscosity)), replace(LIMITS, curves=LIMITS.curves[:1]))
        assert "is 70 % of the measured limit" in said.text
        assert "outside the measured viscosities" in said.text


@pytest.mark.parametrize(("fraction", "grows"), [(0.9, False), (1.1, True)])
def test_sound_grows_beyond_two_nu_over_c_squared(fraction: float, grows: bool) -> None:
    dt = fraction * 2 * NU / CS**2
    said = advice(*parts(square(dt)), Limits("", ()))
    assert any("sound waves grow" in line for line in said) == grows
    if grows:
        assert f"warning: sound waves grow: time step {dt:.3g} > 2 nu/c^2 = 0.0889" in said
        damped = advice(*parts(square(dt, pair={"artificial_visc": 1.0})), Limits("", ()))
        assert any(line.startswith("sound waves grow") and "not included" in line for line in damped)


def test_no_advice_without_steps() -> None:
    model, box, state, _ = parts(square(1.0))
    assert advice(model, box, state, None, LIMITS) == []


def test_theory_replaces_missing_measured_limits() -> None:
    [line, *_] = advice(*parts(square(0.4 * LIMIT)), Limits("", ()))
    assert (
        line
        == f"time step {0.4 * LIMIT:.3g} is 40 % of CFL h/4(c+U), 12 % of the viscous limit h^2/8nu (no measured limit)"
    )
    assert advice(*parts(square(1.01 * LIMIT)), Limits("", ()))[0].startswith(
        f"warning: time step {1.01 * LIMIT:.3g} is 101 % of CFL"
    )


def test_density_near_the_end_of_a_law_warns() -> None:
    made = square(1e-3, pressure=[{"types": "*", "style": "cubic", "A3": -4.0}])
    model, box, state, dt = parts(made)
    end = MASS + 1 / math.sqrt(12)
    for left, warns in ((0.5, False), (0.1, True), (-0.1, True)):
        state.rho_n = np.full(81, end + left * (MASS - end))
        said = [a for a in judge(model, box, state, dt, LIMITS) if "stops growing" in a.text]
        assert [a.warns for a in said] == ([True] if warns else [])
        assert all(f"({100 * left:.0f} % of the way" in a.text for a in said)


def test_distance_to_the_surface_limit_is_reported() -> None:
    made = square(1e-3, rheo={"surface_detection": {"style": "coordination", "limit": 20, "splash": 3}})
    # 20 neighbours lie within 2.7 spacings on a square lattice.
    nearest = "from the nearest value of a fluid particle"
    line = f"surface limit 20 (coordination): 0.0 % {nearest}; 81 of 81 fluid particles lie within 5 %"
    assert line in advice(*parts(made), LIMITS)
    made = square(1e-3, rheo={"surface_detection": {"style": "coordination", "limit": 10, "splash": 3}})
    assert f"surface limit 10 (coordination): 100.0 % {nearest}" in advice(*parts(made), LIMITS)


def test_checks_skipped_for_many_particles_are_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lammps_cases.studies.stability.advice.MOST", 80)
    made = square(1e-3, rheo={"surface_detection": {"style": "coordination", "limit": 20, "splash": 3}})
    line = "warning: moment matrices and surface limits were not examined: 81 particles, more than 80"
    assert line in advice(*parts(made), LIMITS)
    assert not [line for line in advice(*parts(square(1e-3)), LIMITS) if "examined" in line]


def test_worst_condition_of_matrices_is_reported() -> None:
    def lines(x_nc: Any) -> list[str]:
        made = square(1e-3, rheo={"kernel": "RK1"})
        made = replace(made, atoms=replace(made.atoms, x_nc=np.hstack([x_nc, np.zeros((81, 1))])))
        return [line for line in advice(*parts(made), LIMITS) if "matri" in line]

    [line] = lines(rows(0, 9, 9))
    # On the square lattice the matrix is diagonal: sums of V W and V W (x/rc)^2 over the 20 neighbours within 2.7.
    offset_pc = np.array([(a, b) for a in range(-2, 3) for b in range(-2, 3) if 0 < a * a + b * b < 2.7**2]) / 2.7
    q_p = np.sqrt((offset_pc**2).sum(axis=1))
    w_p = quintic(3 * q_p)
    condition = w_p.sum() / (w_p * offset_pc[:, 0] ** 2).sum()
    assert line == f"condition number of moment matrices up to {condition:.2g}"
    x_nc = rows(0, 9, 9)
    x_nc[:, 1] = 4.5 + 1e-7 * (x_nc[:, 1] - 4.5)  # almost on a line
    assert any(line.startswith("warning: condition number") or "no Cholesky factor" in line for line in lines(x_nc))


# --- limits


def test_numbers_use_the_largest_speed_and_viscosity() -> None:
    kinds = [{"mass": 1.0, "rho0": 1.0, "cs": c, "viscosity": eta} for c, eta in ((2.0, 0.6), (5.0, 0.2))]
    type_n = np.repeat([1, 2], [40, 41])
    made = start(
        "two",
        {"types": kinds, "pressure": [{"types": "*", "style": "linear"}]},
        rows(0, 9, 9),
        (9.0, 9.0),
        options=Options(cut=2.7),
        times=[0.1],
        timestep=0.1,
        type_n=type_n,
        v_nc=np.stack([np.where(type_n == 2, 0.5, 4.0), np.zeros(81)], axis=1),
        rho_n=np.where(type_n == 1, 0.5, 1.0),
    )
    model, _, state, dt = parts(made)
    found = numbers(model, state, dt)
    assert found == Numbers(6.0, 1.2, rounded(0.9, 4), 0.1)
    assert (found.acoustic, found.viscous) == rounded((4 * 6.0 * 0.1 / 0.9, 8 * 1.2 * 0.1 / 0.81), 12)
    assert found.fraction == found.acoustic
    assert found.ratio == rounded(1.2 / (6.0 * 0.9), 8)


def step_map(make: Any) -> StabilityMap:
    axis = Axis("dt", 0.01, 1.0, 0.05, log=True)
    return StabilityMap(
        "step", "t", "a", axis, Axis("nu", 0.1, 10.0, 0.1, log=True), (0.1, 1.0), make, lambda _: FailureCriteria()
    )


def test_limits_are_boundaries_along_a_time_step() -> None:
    maps = {"step": step_map(lambda cell: square(cell.x, MASS * cell.y))}
    boundaries = [
        Boundary("step", "", 1.0, "lammps", 0.1, 0.12, "stable", "energy growth"),
        Boundary("step", "", 0.1, "lammps", 0.2, 0.22, "stable", "non-finite"),
        Boundary("step", "", 1.0, "lammps", 0.3, 0.32, "energy growth", "non-finite"),
        Boundary("step", "", 1.0 + 1e-9, "lammps", 0.15, 0.16, "stable", "energy growth"),
        Boundary("gone", "", 1.0, "lammps", 0.1, 0.12, "stable", "energy growth"),
    ]
    found = measured(boundaries, maps, "1")
    [curve] = found.curves
    assert [p.ratio for p in curve.points] == rounded([0.1 / (CS * 0.9), 1.0 / (CS * 0.9)], 12)
    assert [(p.low, p.high) for p in curve.points] == [
        rounded((0.2 * 4 * CS / 0.9, 0.22 * 4 * CS / 0.9), 12),
        rounded((0.1 * 4 * CS / 0.9, 0.12 * 4 * CS / 0.9), 12),
    ]


def test_boundaries_along_other_axes_are_not_step_limits() -> None:
    maps = {"step": step_map(lambda cell: square(0.01 * cell.x, cs=cell.x))}
    assert not measured([Boundary("step", "", 1.0, "lammps", 0.1, 0.12, "stable", "clumping")], maps, "1").curves


def test_limits_round_trip(tmp_path: Path) -> None:
    save(LIMITS, tmp_path / "limits.json")
    assert read(tmp_path / "limits.json") == LIMITS
    assert read(tmp_path / "none.json") == Limits("", ())
    (tmp_path / "bad.json").write_text("{}")
    with pytest.raises(InputError, match="schema: must be eos-ref/stability-limits"):
        read(tmp_path / "bad.json")


# --- tension


@pytest.mark.parametrize(("fraction", "warns"), [(0.5, False), (0.9, True), (1.5, True)])
def test_tension_near_the_measured_one_warns(fraction: float, warns: bool) -> None:
    tensions = (
        Tension("tension", "", "reference", False, -0.9, -0.8),
        Tension("tension", "", "lammps", False, -0.05, -0.04),
        Tension("tension", "shift", "lammps", True, -0.5, -0.4),
    )
    limits = replace(LIMITS, tensions=tensions)
    model, box, state, dt = parts(square(1e-3))
    state.rho_n[7] = MASS * (1 - 0.04 * fraction)
    [said] = [a for a in judge(model, box, state, dt, limits) if "tension" in a.text]
    assert said.warns == warns
    expected = f"is {100 * fraction:.0f} % of the tension at which particles clump (tension: -0.05 to -0.04)"
    assert said.text == f"lowest pressure {-0.04 * fraction:.3g} rho0 c^2 {expected}"
    model, *_ = parts(square(1e-3, rheo={"shift": True}))
    [said] = [a for a in judge(model, box, state, dt, limits) if "tension" in a.text]
    assert f"is {10 * fraction:.0f} % of" in said.text
    state.rho_n[:] = MASS
    assert not [a for a in judge(model, box, state, dt, limits) if "tension" in a.text]


def test_tensions_are_clumping_boundaries_along_a_pressure() -> None:
    def make(cell: MapCell) -> Start:
        law = [{"types": "*", "style": "linear"}, {"types": "*", "style": "background", "P_b": MASS * CS**2 * cell.x}]
        return square(1e-3, pressure=law)

    found = measured(
        [
            Boundary("step", "", 0.1, "lammps", -0.3, -0.2, "clumping", "stable"),
            Boundary("step", "", 1.0, "lammps", -0.1, -0.05, "clumping", "stable"),
            Boundary("step", "", 1.0, "lammps", -0.5, -0.4, "overlap", "clumping"),
        ],
        {"step": step_map(make)},
        "1",
    )
    [one] = found.tensions
    assert (one.low, one.high, one.shift) == (rounded(-0.1, 4, terms=1.0), rounded(-0.05, 4, terms=1.0), False)
    assert not found.curves


# --- where advice is printed


@pytest.mark.lammps
def test_explain_and_audit_print_advice(eos_ref_command: Callable[..., Outcome], tmp_path: Path) -> None:
    explained = json.loads(eos_ref_command("explain", "fluids.unit", "--json").out)["cases"]
    assert all(any(line.partition("time step ")[1] for line in case["stability"]) for case in explained)
    assert "\nstability:\n  " in eos_ref_command("explain", "fluids.unit").out
    # Particles that do not interact need no advice.
    assert json.loads(eos_ref_command("explain", "near-rho0.linear.2d", "--json").out)["cases"][0]["stability"] == []
    deck = Path(__file__).parents[3] / "decks" / "in.walls_corrected"
    out = eos_ref_command("audit", deck, "--steps", 3, "--out", tmp_path / "audit").out
    assert "32 % of CFL h/4(c+U), 1.9 % of the viscous limit h^2/8nu" in out
    assert "stability: sound waves grow: time step 0.02 > 2 nu/c^2 = 0.0147" in out


def test_audit_reports_the_worst_time_step(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lammps_cases.studies.stability.advice.read", lambda: Limits("", ()))
    model, box, state, _ = parts(square(1e-3))
    questions = Questions()
    for run, dt in enumerate((1e-3, 1e-3, 3 * LIMIT), 1):
        sample = ParticleSample(model, box, state, np.ones(len(state.type_n)))
        questions.look(TimedSample(sample, dt, run, 0, np.arange(len(state.type_n))))
        if run == 2:
            expected = [f"time step 0.001 is {0.1 / LIMIT:.2g} %"]
            assert [line.partition(" of CFL")[0] for line in questions.stability] == expected
    assert not questions.stability  # only the worst is kept
    marked = f"run 3: time step {3 * LIMIT:.3g} is 3 times CFL"
    assert any(line.startswith(marked) for line in questions.lines())
