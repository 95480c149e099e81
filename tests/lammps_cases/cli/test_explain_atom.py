"""A particle's neighbours and the contribution of each pair: the sums are the fields of the reference."""

from __future__ import annotations

import json
from collections.abc import Callable

import numpy as np
import pytest

from lammps_cases.comparison import pair_sums
from lammps_cases.comparison.trajectory import visit
from lammps_cases.run.prepared_case import prepare
from lammps_cases.scene import casefile
from lammps_cases.verdict.problems import problem_of
from tests.support.outcome import Outcome

ATOM = 5


@pytest.mark.slow
@pytest.mark.parametrize("name", ["forces.all.rk1.2d", "forces.all.quintic.3d", "thermal.arithmetic.2d"])
def test_sums_equal_the_fields(name: str, eos_ref_command: Callable[..., Outcome]) -> None:
    (case,) = (case for case in casefile.load() if case.name == name)
    problem = problem_of(case.scene, prepare(case).atoms, case.where, case.scene.snapshots)
    sim = problem.simulation()
    last = case.scene.snapshots[-1]
    for _ in visit(sim, (last,), problem.timestep, problem.stops):
        pass
    document = json.loads(eos_ref_command("explain", name, "--atom", str(ATOM), "--json").out)
    assert last > 0 and document["step"] == last
    assert document["count"] == len(document["pairs"]) == sim.fields["coordination"][ATOM - 1]
    sums, twin = document["sum"], sim.rounded()
    fields = {"force": "f", "drho": "drho", "heat": "heatflow"}
    named = {name: field for name, field in fields.items() if name in sums}
    assert set(named) == ({"force", "heat"} if problem.model.thermal else {"force", "drho"})
    for name, field in named.items():
        exact = twin.fields[field]
        bound = np.asarray(exact.error)[ATOM - 1]  # of both sides, which add in different orders
        assert np.all(np.abs(np.asarray(sums[name]) - exact.value[ATOM - 1]) <= bound), name


@pytest.mark.slow
def test_table_output(eos_ref_command: Callable[..., Outcome]) -> None:
    out = eos_ref_command("explain", "forces.all.quintic.2d", "--atom", "5", "--step", "0").out
    assert out.startswith("forces.all.quintic.2d, particle 5 after 0 steps") and "of pressure x" in out
    assert out.rstrip().splitlines()[-1].split()[0] == "sum"


def test_twin_shows_the_original(eos_ref_command: Callable[..., Outcome]) -> None:
    words = ("explain", "twins.fluid.translate", "--atom", "5")
    said = "of the original of the two runs that are compared; translate makes the other, its twin"
    assert said in " ".join(eos_ref_command(*words).out.split())
    document = json.loads(eos_ref_command(*words, "--json").out)
    (case,) = (case for case in casefile.load() if case.name == words[1])
    twin = prepare(case).twin
    assert twin is not None and document["run"] == "original"
    problem = problem_of(twin.scene, twin.atoms, case.where, (document["step"],))
    own = pair_sums.terms(problem, document["step"], 5).particle  # its positions lie on the grid of both runs
    assert document["particle"]["x"] == list(own.x)
    assert "twin" not in eos_ref_command("explain", "forces.all.quintic.2d", "--atom", "5").out


@pytest.mark.slow
def test_fixes_that_change_the_force(eos_ref_command: Callable[..., Outcome]) -> None:
    held = ("explain", "walls.stored.gravity", "--atom", "1")
    document = json.loads(eos_ref_command(*held, "--json").out)
    assert document["force_with_fixes"] == [0.0, 0.0] and any(document["sum"]["force"])
    assert "that add to it or set it: 0, 0" in eos_ref_command(*held).out
    pushed = json.loads(eos_ref_command("explain", "walls.stored.gravity", "--atom", "55", "--json").out)
    assert pushed["force_with_fixes"][1] < pushed["sum"]["force"][1] and pushed["particle"]["mass"] > 0
    assert "add to it or set it" not in eos_ref_command("explain", "forces.all.quintic.2d", "--atom", "5").out


def test_numbers_are_not_truncated_on_a_narrow_terminal(
    eos_ref_command: Callable[..., Outcome], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    out = eos_ref_command("explain", "forces.all.quintic.2d", "--atom", "5").out
    assert "\N{HORIZONTAL ELLIPSIS}" not in out and max(map(len, out.splitlines())) <= 60, out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("forces.all.quintic.2d", "--atom", "0"), "atom: must be an id of the "),
        (
            ("forces.all.quintic.2d", "--atom", "5", "--step", "3"),
            "step: must be one that is compared: 0, 1, 10, found 3",
        ),
        (("forces.all.quintic.2d", "--step", "1"), "option --step: is that of a particle"),
        (("near-rho0.tait-water.2d", "--atom", "5"), "case: must have particles that interact"),
        (
            ("forces.all.quintic", "--atom", "5"),
            "needs a single case, but 2 match, found 'forces.all.quintic.2d, forces.all.quintic.3d'",
        ),
    ],
)
def test_bad_input(words: tuple[str, ...], said: str, eos_ref_command: Callable[..., Outcome]) -> None:
    code, _, err = eos_ref_command("explain", *words)
    assert code == 2 and said in err, err
