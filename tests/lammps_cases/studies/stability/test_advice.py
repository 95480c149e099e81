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
    LimitCurve,
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
    """Fluid on a square lattice; by default of one type, at rest."""
    kind = {"mass": MASS, "rho0": MASS, "cs": cs, "viscosity": viscosity}
    fields = {name: scene.pop(name) for name in ("type_n", "v_nc", "rho_n") if name in scene}
    made = {"types": [kind], "pressure": [{"types": "*", "style": "linear"}], **scene}
    box = {"options": Options(cut=2.7), "times": [dt], "timestep": dt}
    return start("square", made, rows(0, 9, 9), (9.0, 9.0), **box, **fields)


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
        LimitCurve(
            "step", "", "lammps", "energy growth", (LimitPoint(RATIO / 10, 2.0, 2.1), LimitPoint(RATIO * 10, 0.5, 0.6))
        ),
        LimitCurve("step", "", "reference", "energy growth", (LimitPoint(RATIO, 0.01, 0.02),)),
        LimitCurve("other", "shift", "reference", "clumping", (LimitPoint(RATIO, 1.5, 1.6),)),
    ),
)

NONE = Limits("", ())
LIMIT = 1.0 * 0.9 / (4 * CS)  # 1 is halfway, in logarithms, between 2 and 0.5


WITH_TENSIONS = replace(
    LIMITS,
    tensions=(
        Tension("tension", "", "reference", False, -0.9, -0.8),
        Tension("tension", "", "lammps", False, -0.05, -0.04),
        Tension("tension", "shift", "lammps", True, -0.5, -0.4),
    ),
)


def of_curves(first: int, last: int | None = None) -> Limits:
    return replace(LIMITS, curves=LIMITS.curves[first:last])


def at(**given: Any) -> Start:
    """The scene at a small time step; a density of particle 7, or of all, over rho0."""
    one, everywhere = given.pop("one", None), given.pop("all", None)
    made = square(**{"dt": 1e-3, **given})
    rho_n = np.full(81, MASS * (everywhere or 1.0))
    rho_n[7] *= one or 1.0
    return replace(made, atoms=replace(made.atoms, rho_n=rho_n))


def detecting(limit: int) -> dict[str, Any]:
    return {"surface_detection": {"style": "coordination", "limit": limit, "splash": 3}}


CUBIC = [{"types": "*", "style": "cubic", "A3": -4.0}]
END = 1 + 1 / math.sqrt(12) / MASS  # over rho0: dP/drho = 0 where 1 = 3 A3 (rho - rho0)^2
GROWS = 2 * NU / CS**2  # time step beyond which sound grows
VISCOUS = 0.9**2 / (8 * NU * 100)
# The scene, the limits, the subject, how far it is, and whether that is a warning. Limits of LAMMPS precede those of
# the reference, near ones far ones; on a square lattice 20 neighbours lie within 2.7 spacings.
JUDGED: dict[str, tuple[Start, Limits, str, float, bool]] = {
    **{f"time step {f:g}": (at(dt=f * LIMIT), LIMITS, "time step", f, f >= 0.8) for f in (0.5, 0.9, 1.5)},
    "curve of the reference": (at(dt=0.5 * LIMIT), of_curves(1), "time step", 50.0, True),
    "curve with shift": (at(dt=0.5 * LIMIT), of_curves(2), "time step", 1 / 3, False),
    "no viscosity": (at(dt=0.7 * 2.0 * 0.9 / (4 * CS), viscosity=0.0), of_curves(0, 1), "time step", 0.7, False),
    "great viscosity": (
        *(at(dt=0.7 * 0.5 * VISCOUS, viscosity=MASS * NU * 100), of_curves(0, 1)),
        *("time step", 0.7, False),
    ),
    "theory alone": (at(dt=0.4 * LIMIT), NONE, "time step", 0.4, False),
    "beyond theory": (at(dt=1.01 * LIMIT), NONE, "time step", 1.01, True),
    "sound grows": (at(dt=1.1 * GROWS), NONE, "sound", 1.1 * GROWS, True),
    "sound grows, damped": (
        *(at(dt=1.1 * GROWS, pair={"artificial_visc": 1.0}), NONE),
        *("sound", 1.1 * GROWS, False),
    ),
    **{f"tension {f:g}": (at(one=1 - 0.04 * f), WITH_TENSIONS, "tension", f, f >= 0.8) for f in (0.5, 0.9, 1.5)},
    "tension with shift": (at(one=0.96, rheo={"shift": True}), WITH_TENSIONS, "tension", 0.1, False),
    **{
        f"density {left:g}": (
            *(at(all=END + left * (1 - END), pressure=CUBIC), NONE),
            *("highest density of type 1", 1 - left, True),
        )
        for left in (0.1, -0.1)
    },
    "surface at the limit": (at(rheo=detecting(20)), NONE, "surface", 1.0, False),
    "surface far away": (at(rheo=detecting(10)), NONE, "surface", -1.0, False),
}


@pytest.mark.parametrize("name", JUDGED)
def test_judgement(name: str, snapshot: Any) -> None:
    made, limits, subject, measure, warns = JUDGED[name]
    [said] = [line for line in judge(*parts(made), limits) if line.subject == subject]
    assert said.measure == rounded(measure, 64)
    assert said.warns == warns
    assert said.text == snapshot


@pytest.mark.parametrize(
    ("made", "subject"),
    [
        (at(dt=0.9 * GROWS), "sound"),
        (at(), "tension"),
        (at(all=END + 0.5 * (1 - END), pressure=CUBIC), "highest density of type 1"),
        (at(), "examined"),
    ],
)
def test_subjects_far_from_a_limit_are_omitted(made: Start, subject: str) -> None:
    assert subject not in [line.subject for line in judge(*parts(made), WITH_TENSIONS)]


def test_warnings_come_first_and_without_steps_there_is_no_advice() -> None:
    first, second = advice(*parts(at(all=END + 0.1 * (1 - END), pressure=CUBIC)), LIMITS)
    assert first.startswith("warning: type 1: highest density") and second.startswith("time step 0.001 is")
    model, box, state, _ = parts(at())
    assert advice(model, box, state, None, LIMITS) == []


def test_checks_skipped_for_many_particles_are_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lammps_cases.studies.stability.advice.MOST", 80)
    line = "warning: moment matrices and surface limits were not examined: 81 particles, more than 80"
    assert line in advice(*parts(at(rheo=detecting(20))), LIMITS)


def test_worst_condition_of_matrices_is_reported() -> None:
    def lines(x_nc: Any) -> list[str]:
        made = at(rheo={"kernel": "RK1"})
        made = replace(made, atoms=replace(made.atoms, x_nc=np.hstack([x_nc, np.zeros((81, 1))])))
        return [line for line in advice(*parts(made), LIMITS) if "matri" in line]

    # On the square lattice the matrix is diagonal: sums of V W and V W (x/rc)^2 over the 20 neighbours within 2.7.
    offset_pc = np.array([(a, b) for a in range(-2, 3) for b in range(-2, 3) if 0 < a * a + b * b < 2.7**2]) / 2.7
    w_p = quintic(3 * np.sqrt((offset_pc**2).sum(axis=1)))
    condition = w_p.sum() / (w_p * offset_pc[:, 0] ** 2).sum()
    assert lines(rows(0, 9, 9)) == [f"condition number of moment matrices up to {condition:.2g}"]
    x_nc = rows(0, 9, 9)
    x_nc[:, 1] = 4.5 + 1e-7 * (x_nc[:, 1] - 4.5)  # almost on a line
    assert any(line.startswith("warning: condition number") or "no Cholesky factor" in line for line in lines(x_nc))


# --- limits


def test_numbers_use_the_largest_speed_and_viscosity() -> None:
    kinds = [{"mass": 1.0, "rho0": 1.0, "cs": c, "viscosity": eta} for c, eta in ((2.0, 0.6), (5.0, 0.2))]
    type_n = np.repeat([1, 2], [40, 41])
    fields = {
        "v_nc": np.stack([np.where(type_n == 2, 0.5, 4.0), np.zeros(81)], axis=1),
        "rho_n": np.where(type_n == 1, 0.5, 1.0),
    }
    model, _, state, dt = parts(square(0.1, types=kinds, type_n=type_n, **fields))
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
    found = measured(
        [
            Boundary("step", "", 1.0, "lammps", 0.1, 0.12, "stable", "energy growth"),
            Boundary("step", "", 0.1, "lammps", 0.2, 0.22, "stable", "non-finite"),
            Boundary("step", "", 1.0, "lammps", 0.3, 0.32, "energy growth", "non-finite"),
            Boundary("step", "", 1.0 + 1e-9, "lammps", 0.15, 0.16, "stable", "energy growth"),
            Boundary("gone", "", 1.0, "lammps", 0.1, 0.12, "stable", "energy growth"),
        ],
        maps,
        "1",
    )
    [curve] = found.curves
    assert [p.ratio for p in curve.points] == rounded([0.1 / (CS * 0.9), 1.0 / (CS * 0.9)], 12)
    assert [(p.low, p.high) for p in curve.points] == [
        rounded((low * 4 * CS / 0.9, high * 4 * CS / 0.9), 12) for low, high in ((0.2, 0.22), (0.1, 0.12))
    ]
    other = {"step": step_map(lambda cell: square(0.01 * cell.x, cs=cell.x))}  # not of the time step alone
    assert not measured([Boundary("step", "", 1.0, "lammps", 0.1, 0.12, "stable", "clumping")], other, "1").curves


def test_limits_round_trip(tmp_path: Path) -> None:
    save(LIMITS, tmp_path / "limits.json")
    assert read(tmp_path / "limits.json") == LIMITS
    assert read(tmp_path / "none.json") == NONE
    (tmp_path / "bad.json").write_text("{}")
    with pytest.raises(InputError, match="schema: must be eos-ref/stability-limits"):
        read(tmp_path / "bad.json")


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
    monkeypatch.setattr("lammps_cases.studies.stability.advice.read", lambda: NONE)
    model, box, state, _ = parts(square(1e-3))
    questions, n = Questions(), len(state.type_n)
    for run, dt in enumerate((1e-3, 1e-3, 3 * LIMIT), 1):
        questions.look(TimedSample(ParticleSample(model, box, state, np.ones(n)), dt, run, 0, np.arange(n)))
        if run == 2:
            [line] = questions.stability
            assert line.startswith(f"time step 0.001 is {0.1 / LIMIT:.2g} % of CFL")
    assert not questions.stability  # only the worst is kept
    marked = f"run 3: time step {3 * LIMIT:.3g} is 3 times CFL"
    assert any(line.startswith(marked) for line in questions.lines())
