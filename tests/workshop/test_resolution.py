"""Every number of a scene is changed alone; the smallest detected change is red, the largest undetected one is not."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from lammps_cases.engine import installations
from lammps_cases.engine.session import Job
from lammps_cases.engine.workers import Workers
from lammps_cases.records.run_record import EngineRecord
from lammps_cases.run import prepared_case
from lammps_cases.scene import casefile
from lammps_cases.verdict.cases import compare_case
from tests.support.outcome import Solver
from tests.workshop.faults import resolution
from tests.workshop.faults.resolution import Resolution, VisibleChange
from tests.workshop.faults.scene_numbers import SceneNumber, numbers

ENGINE = EngineRecord(distribution="2025.7.22.4.0")
CASES = {case.name: case for case in casefile.load()}
LAW, FLUID, GAS = "near-rho0.linear.2d", "images.quintic.two", "near-rho0.ideal-gas.2d"


# --- one number changed


def _differences(one: Job, other: Job) -> int:
    """Commands that differ, and numbers of the arrays."""
    commands = zip([*one.setup, *one.commands], [*other.setup, *other.commands], strict=True)
    pairs = [(one.x_nc, other.x_nc), *((one.per_atom[name], other.per_atom[name]) for name in one.per_atom)]
    if one.v_nc is not None:
        pairs.append((one.v_nc, other.v_nc))
    return sum(a != b for a, b in commands) + sum(int((a != b).sum()) for a, b in pairs)


@pytest.mark.parametrize(
    ("case", "parameters"),
    [
        (LAW, {"mass", "rho0", "cs", "initial rho"}),
        (GAS, {"mass", "rho0", "cs", "gamma", "initial rho", "initial energy"}),
        (
            "forces.power.quintic.2d",
            {"mass", "rho0", "cs", "viscosity eta", "viscosity K", "viscosity n", "viscosity gd0", "timestep"},
        ),
        (
            "thermal.latent.2d",
            {"conductivity", "specific_heat", "latent_heat", "T_freeze", "initial energy", "initial velocity"},
        ),
        ("cross-type.both.2d", {"shiftscale", "cmin", "wmin", "cut", "box edge", "initial x"}),
        ("surfaces.divergence.open", {"surface limit, divergence", "splash"}),
        ("walls-moving.pushed.quintic", {"wall velocity", "addforce"}),
        ("zmin.some.rk1", {"zmin"}),
        ("walls.stored.gravity", {"gravity"}),
        ("walls.stored.damped", {"artificial_visc", "rho_damp"}),
    ],
)
def test_every_number_is_changed_alone(case: str, parameters: set[str]) -> None:
    ready = prepared_case.prepare(CASES[case])
    found = numbers(ready)
    assert parameters <= {number.parameter for number in found}
    assert len({(number.parameter, number.place) for number in found}) == len(found)
    walls = int((ready.atoms.type_n == 2).sum())
    for number in found:
        assert _differences(ready.jobs[0], number.job_with(number.value)) == 0, number
        job = number.job_with(number.value + 1 if number.whole else number.value * 1.01)
        # The cutoff is given twice, and all particles of a wall move.
        expected = {"cut": 2, "wall velocity": walls}.get(number.parameter, 1)
        assert _differences(ready.jobs[0], job) == expected, number


@pytest.mark.parametrize("case", ["refused.unknown-style", "twins.fluid.ranks"])
def test_refusals_and_twins_have_no_numbers(case: str) -> None:
    assert numbers(prepared_case.prepare(CASES[case])) == []


# --- the search


class Threshold:
    """A stub of a case that detects relative changes above some size."""

    def __init__(self, size: float) -> None:
        self.size = size
        self.ready = prepared_case.prepare(CASES[LAW])
        self.asked = 0

    def detects(self, change: float) -> bool:
        self.asked += 1
        return abs(change) >= self.size

    def moved(self, change: float) -> dict[str, float]:
        return {"pressure": abs(change) / self.size}


def _smallest(case: Threshold, value: float, guess: float, sign: int = 1) -> VisibleChange | None:
    number = SceneNumber("cs", "type 1", value, lambda other: other - value)  # type: ignore[return-value]
    return resolution.smallest_change(case, number, sign, guess)


@pytest.mark.parametrize("guess", [1e-16, 1.0, 1e3])
@pytest.mark.parametrize("size", [1e-14, 3e-7, 0.2])
@pytest.mark.parametrize("sign", [1, -1])
def test_bisection_ends_within_a_factor(size: float, guess: float, sign: int) -> None:
    case = Threshold(size)
    found = _smallest(case, 1.0, min(size * guess, 1.0), sign)
    assert found is not None
    assert math.copysign(1, found.change) == sign
    assert found.unseen < size <= found.relative_change <= resolution.CLOSE * max(found.unseen, size / resolution.CLOSE)
    assert case.asked < 70


def test_search_ends_at_one_ulp_or_where_nothing_is_detected() -> None:
    found = _smallest(Threshold(5e-324), 1.3, resolution.FLOOR)
    assert found is not None
    assert (found.change, found.unseen) == (math.ulp(1.3), 0)
    assert _smallest(Threshold(5.0), 1.0, 0.1) is None
    probe = resolution.Sensitivity("cs", "type 1", 0.1, whole=False, decides=False)
    nothing = Resolution("cs", "", None, 1, 1, None, None, "no case sees it")
    assert resolution.resolution_of("cs", {"a": [probe]}, [], set()) == nothing


# --- with LAMMPS


@pytest.fixture(scope="module")
def measured() -> dict[str, Resolution]:
    cases = [replace(CASES[LAW], tags=("quick",)), replace(CASES[FLUID], tags=())]
    parameters = ("cs", "mass", "timestep", "viscosity", "cut")
    return {r.parameter: r for r in resolution.measure(cases, installations.Engine(), parameters)}


@pytest.fixture(scope="module")
def red() -> Iterator[Callable[[str, str, str, float], bool]]:
    """Whether a case is red when LAMMPS is given a number plus a change."""
    with Workers(None, 1) as workers:

        def verdict(case: str, parameter: str, place: str, change: float) -> bool:
            ready = prepared_case.prepare(CASES[case])
            number = next(n for n in numbers(ready) if (n.parameter, n.place) == (parameter, place))
            answer = workers.outcome(workers.submit(number.job_with(number.value + change), 60.0))
            return compare_case(ready.case, ready.eos, ready.atoms, answer, ENGINE)[0].verdict == "differs"

        yield verdict


@pytest.mark.lammps
def test_smallest_change_is_red_and_undetected_one_is_green(
    measured: dict[str, Resolution], red: Callable[[str, str, str, float], bool]
) -> None:
    assert sorted(measured) == ["cs", "cut", "mass", "timestep", "viscosity"]
    for found in measured.values():
        best = found.best
        assert best is not None
        assert (found.case, found.relative_change) == (best.case, best.relative_change)
        assert red(best.case, found.parameter, best.place, best.change), found
        unseen = math.copysign(best.unseen * abs(best.value), best.change)
        assert not red(best.case, found.parameter, best.place, unseen), found
        assert np.nextafter(best.value, math.inf) - best.value <= abs(best.change) < 1e-9 * abs(best.value)


@pytest.mark.lammps
def test_quick_and_insensitive_cases_are_distinguished(measured: dict[str, Resolution]) -> None:
    assert measured["cs"].quick is not None
    assert measured["cs"].quick.case == LAW
    assert measured["viscosity"].quick is None  # only the fluid has one
    counts = {name: (measured[name].candidates, measured[name].sensitive) for name in ("mass", "cs")}
    assert counts == {"mass": (2, 1), "cs": (2, 2)}  # no law except ideal/gas depends on the mass


@pytest.mark.lammps
def test_bound_of_the_law_is_the_resolution_of_its_speed_of_sound(
    measured: dict[str, Resolution], solver: Solver
) -> None:
    """P of linear is proportional to cs^2: red if twice the change exceeds the relative bound, apart from rounding."""
    ready = prepared_case.prepare(CASES[LAW])
    arrays = compare_case(ready.case, ready.eos, ready.atoms, solver(ready.jobs[0]), ENGINE)[1]
    least = float((arrays["pressure.bound"] / np.abs(arrays["pressure.reference"])).min())
    quick = measured["cs"].quick
    assert quick is not None
    assert 0.2 * least <= 2 * quick.relative_change <= 1.1 * 2 * least
