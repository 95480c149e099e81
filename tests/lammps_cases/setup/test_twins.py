"""LAMMPS against itself: every kind of twin on real LAMMPS, and planted faults that must be detected."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eos_ref import InputError
from eos_ref.model.quantities import Quantity, named
from lammps_cases import findings
from lammps_cases.engine.session import Answer
from lammps_cases.engine.workers import Failure, Workers
from lammps_cases.records.run_record import CaseRecord, EngineRecord, read_run
from lammps_cases.run import flow, prepared_case
from lammps_cases.scene import casefile
from lammps_cases.scene.casefile import Case
from lammps_cases.setup import twins
from tests.support.outcome import Outcome
from tests.support.twin_kinds import KINDS

pytestmark = pytest.mark.lammps

ENGINE = EngineRecord(distribution=version("lammps"))
FLUIDS = [
    {"mass": 1.31, "rho0": 1.27, "cs": 6.1, "viscosity": {"eta": 0.41, "gd0": 0.3, "K": 0.27, "n": 0.5}},
    {"mass": 0.62, "rho0": 0.81, "cs": 9.3, "viscosity": 0.29},
]
BASE: dict[str, Any] = {
    "dimension": 2,
    "types": FLUIDS,
    "positions": {"lattice": "sq", "spacing": 0.9, "cells": [7, 8], "disorder": 0.15},
    "pressure": [{"types": 1, "style": "tait/water"}, {"types": 2, "style": "linear"}],
    "rho": {"ratio": [0.97, 1.04]},
    "velocity": {"random": 0.3},
    "pair": {"artificial_visc": 0.37, "rho_damp": 0.11},
    "forces": [{"style": "gravity", "vector": [0.3, -0.7]}, {"style": "addforce", "vector": [0.1, 0.2]}],
    "evolve": {"steps": 10, "timestep": 0.004},
    "compare": ["coordination", "grad/v", "viscosity", "pressure", "f", "drho", "rho", "x", "v"],
}
WALL = {"mass": 0.62, "rho0": 0.81, "cs": 9.3, "phase": "solid", "velocity": [0.4, 0.15]}
WALLS: dict[str, Any] = {
    "types": [FLUIDS[0], WALL],
    "positions": BASE["positions"] | {"regions": [{"type": 2, "low": [0, 0], "high": [1, 0.4]}]},
    "forces": [{"style": "setforce", "types": 2, "vector": [0.0, 0.0]}],
    "rheo": {"interface_reconstruct": True},
}
HEAT: dict[str, Any] = {
    "types": [t | {"conductivity": 0.7, "specific_heat": 1.5} for t in FLUIDS],
    "energy": {"range": [0.8, 1.9]},
    "compare": [*BASE["compare"], "temperature", "heatflow", "energy"],
}
ACROSS: dict[str, Any] = {
    "rheo": {"shift": {"scale_cross_type": [0.3, 0.05, 0.25]}},
    "evolve": {"steps": 1, "timestep": 0.004},
    "compare": [*BASE["compare"], "shift/v"],
}
BLAME = re.compile(r"LAMMPS against itself \(twin: (\w+)\): (\S+) \(stage twin\) leaves its bound at step (\d+) .*")

Make = Callable[..., Case]


@pytest.fixture
def make(case_file: Callable[..., Path]) -> Make:
    """A small case with a twin."""

    def case(kind: str, value: Any = None, **changes: Any) -> Case:
        twin = {kind: KINDS[kind] if value is None else value}
        (made,) = casefile.load_file(case_file(**{**BASE, **changes, "twin": twin}))
        return made

    return case


def answers(workers: Workers, ready: prepared_case.PreparedCase) -> list[Answer | Failure]:
    found: list[Answer | Failure] = []
    for future in [workers.submit(told, 60.0) for told in ready.jobs]:
        outcome = workers.outcome(future)
        assert isinstance(outcome, Answer), outcome
        found.append(outcome)
    return found


def judged(workers: Workers, case: Case) -> CaseRecord:
    ready = prepared_case.prepare(case)
    return flow.judge(None, ready, answers(workers, ready), ENGINE)[0]


# --- on real LAMMPS


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_on_real_lammps(kind: str, make: Make, workers: Workers) -> None:
    record = judged(workers, make(kind))
    expected = {"rescale": ("explained",), "units": ("explained",), "split": ("exact",)}.get(kind, ("exact", "pass"))
    assert record.verdict in expected, record.message
    assert record.twin == kind
    assert {field.stage for field in record.fields} == {"twin"}
    assert all(f"against itself ({kind})" in field.derivation for field in record.fields)
    steps = {step.step for field in record.fields for step in field.steps}
    assert steps == ({10} if kind == "split" else {0, 1, 10})


@pytest.mark.parametrize(
    ("kind", "changes", "entries"),
    [
        ("rescale", {}, "force-per-volume"),
        ("rescale", HEAT, "force-per-volume, heat-is-temperature-rate"),
        ("boost", WALLS, "wall-velocity-lost"),
        ("relabel", ACROSS, "cross-type-support, cross-type-normal"),
    ],
)
def test_findings_explain_the_symmetries_they_break(
    kind: str, changes: dict[str, Any], entries: str, make: Make, workers: Workers
) -> None:
    record = judged(workers, make(kind, **changes))
    assert record.verdict == "explained", record.message
    (names,) = {tuple(field.explained_by) for field in record.fields if field.verdict == "explained"}
    assert names and set(names) <= set(entries.split(", ")), names
    assert record.message.endswith(f"; explained by {', '.join(names)}")


def test_twin_differs_without_the_finding(make: Make, workers: Workers, monkeypatch: pytest.MonkeyPatch) -> None:
    ready = prepared_case.prepare(make("boost", **WALLS))
    monkeypatch.setattr(findings, "LEDGER", ())
    record, _ = flow.judge(None, ready, answers(workers, ready), EngineRecord(distribution="2099.1.1"))
    assert record.verdict == "differs"
    assert not record.as_expected
    assert BLAME.match(record.message), record.message


# --- planted faults


@pytest.mark.parametrize("kind", ["relabel", "translate", "newton"])
def test_corrupted_answer_is_blamed(kind: str, make: Make, workers: Workers) -> None:
    ready = prepared_case.prepare(make(kind))
    one, other = answers(workers, ready)
    assert isinstance(other, Answer) and ready.twin is not None
    row = int(ready.twin.row_n[16])  # of atom 17
    force_nc = other.snapshots[1]["f"].copy()
    force_nc[row, 1] *= 1 + 1e-9
    snapshots = (other.snapshots[0], other.snapshots[1] | {"f": force_nc}, other.snapshots[2])
    record, arrays = flow.judge(None, ready, [one, replace(other, snapshots=snapshots)], ENGINE)
    assert record.verdict == "differs"
    start = f"LAMMPS against itself (twin: {kind}): f (stage twin) leaves its bound at step 1 at 1 of 56 atoms, "
    assert record.message.startswith(f"{start}first atom 17: as given "), record.message
    (force,) = [field for field in record.fields if field.field == "f"]
    assert (force.verdict, force.worst_step, force.worst_id, force.first_id) == ("differs", 1, 17, 17)
    assert {field.field for field in record.fields if field.verdict not in ("exact", "pass")} == {"f"}
    assert np.flatnonzero((np.abs(arrays["f.lammps"] - arrays["f.reference"]) > arrays["f.bound"]).any(axis=1)) == [16]


INPUT = ["x", "mass", "time", "viscosity", "grad/v", "diffusivity", "conductivity", "acceleration", "f", "kernel"]


@pytest.mark.parametrize("quantity", INPUT)
def test_wrong_unit_is_detected(quantity: str, make: Make, workers: Workers, monkeypatch: pytest.MonkeyPatch) -> None:
    def wrong(name: str) -> Quantity:
        right = named(name)
        longer = right.dimension._replace(length=right.dimension.length + (name == quantity))
        return replace(right, dimension=longer)

    monkeypatch.setattr(twins, "named", wrong)
    everything = HEAT | ACROSS | {"compare": [*HEAT["compare"], "shift/v"]}
    record = judged(workers, make("rescale", **everything))
    assert record.verdict == "differs"
    found = BLAME.match(record.message)
    assert found and "first atom" in record.message, record.message
    assert record.message.endswith("; the reference differs as well, so the two are not the same problem")


def test_everything_rescaled_is_the_same_problem(make: Make, workers: Workers) -> None:
    """The scene of the wrong exponents, with the right ones."""
    everything = HEAT | ACROSS | {"compare": [*HEAT["compare"], "shift/v"]}
    record = judged(workers, make("rescale", **everything))
    assert record.verdict == "explained", record.message


def test_failure_of_the_twin_is_reported(make: Make, workers: Workers) -> None:
    ready = prepared_case.prepare(make("newton"))
    one, _ = answers(workers, ready)
    record, arrays = flow.judge(None, ready, [one, Failure("crashed", "it died")], ENGINE)
    assert (record.verdict, arrays) == ("crashed", {})
    assert record.message == "LAMMPS answers, and its twin (newton) does not: it died"


# --- the transformations


@pytest.mark.parametrize("kind", ["translate", "boost", "relabel", "rescale"])
@pytest.mark.parametrize("dimension", [2, 3])
def test_transformation_is_inverted(kind: str, dimension: int, make: Make) -> None:
    changes: dict[str, Any] = {"forces": None}
    value = KINDS[kind]
    if dimension == 3:
        positions = {"lattice": "sc", "spacing": 0.9, "cells": [5, 6, 5], "disorder": 0.15}
        changes |= {"dimension": 3, "positions": positions, "rheo": {"cut": 2.2}}
        value = [*value, 0.7] if isinstance(value, list) else value
    case = make(kind, value, **changes)
    twin = prepared_case.prepare(case).twin
    assert twin is not None and twin.kind == kind
    one, other = twin.atoms, twin.other_atoms
    assert ((other.x_nc >= other.low_c) & (other.x_nc < other.high_c)).all()
    fields = {"x": other.x_nc[:, :dimension], "v": other.v_nc[:, :dimension], "rho": other.rho_n}
    back = twin.back(fields, 0)
    edge_c = (one.high_c - one.low_c)[:dimension]
    turns_nc = np.round((one.x_nc[:, :dimension] - back["x"]) / edge_c)
    assert turns_nc.any() == (kind == "translate")
    rounding = twin.rounding(back, 0)
    returned_nc = back["x"].astype(np.longdouble) + turns_nc * edge_c
    assert (np.abs(returned_nc - one.x_nc[:, :dimension]) <= rounding.get("x", 0.0)).all()
    if kind in ("translate", "boost"):
        posed_nc = other.x_nc[:, :dimension].astype(np.longdouble) - twin.displacement_c + turns_nc * edge_c
        assert np.array_equal(posed_nc, one.x_nc[:, :dimension]), "the same problem, to the last bit"
    assert np.array_equal(back["v"], one.v_nc[:, :dimension])
    assert np.array_equal(back["rho"], one.rho_n)
    assert not np.array_equal(one.x_nc, other.x_nc) or kind == "boost"


def test_grid_moves_particles_within_its_resolution(make: Make) -> None:
    ready = prepared_case.prepare(make("translate"))
    assert ready.twin is not None
    moved_nc = np.abs(ready.twin.atoms.x_nc - ready.atoms.x_nc)
    # Half a unit of the grid, that of the power of two above the largest number.
    assert 0 < moved_nc.max() <= np.abs(ready.atoms.x_nc).max() * 2.0**-twins.GRID_BITS


def test_particles_must_stay_in_the_box(make: Make) -> None:
    positions = BASE["positions"] | {"periodic": [True, False], "margin": 1.0}
    assert prepared_case.prepare(make("translate", [3.0, 0.5], positions=positions)).twin is not None
    with pytest.raises(InputError, match="leave particles in the box"):
        prepared_case.prepare(make("translate", [3.0, 2.5], positions=positions))


# --- the command


def test_command_runs_and_explains(eos_ref_command: Callable[..., Outcome], tmp_path: Path) -> None:
    done = eos_ref_command("run", "twins.fluid.split", "twins.fluid.relabel", "--out", tmp_path / "out")
    assert done.code == 0, done.out + done.err
    run = read_run(tmp_path / "out")
    assert {case.twin for case in run.cases} == {"relabel", "split"}
    with np.load(tmp_path / "out" / "fields" / "twins.fluid.relabel.npz") as arrays:
        assert np.all(np.abs(arrays["x.lammps"] - arrays["x.reference"]) <= arrays["x.bound"])
    told = eos_ref_command("explain", "twins.fluid.boost", "--full")
    assert told.code == 0
    assert "its twin. boost [0.8, -0.45]: Galilean invariance" in told.out
    assert "LAMMPS commands of the twin:" in told.out
