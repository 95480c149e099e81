"""eos-ref explain and list: a case on one screen, the rest on request; the sums over a particle's neighbours."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from lammps_cases.cli.explain import _commands
from lammps_cases.comparison import pair_sums
from lammps_cases.comparison.trajectory import visit
from lammps_cases.findings import LEDGER
from lammps_cases.records.wording import MEANINGS
from lammps_cases.run.prepared_case import prepare
from lammps_cases.scene import casefile
from lammps_cases.scene.fields import FIELDS
from lammps_cases.verdict.problems import problem_of
from tests.conftest import ROOT
from tests.support.outcome import Outcome

Run = Callable[..., Outcome]
SCREEN = 40  # lines
OF_FULL = ("modelled by the reference", "given to LAMMPS", "LAMMPS commands:", "evaluated by")


@cache
def cases() -> list[casefile.Case]:
    return [*casefile.load()]


def case_of(name: str) -> casefile.Case:
    (case,) = (case for case in cases() if case.name == name)
    return case


# One of a law, the one with most types, the twin and the walls with most rules, one that LAMMPS is to refuse.
@pytest.mark.parametrize(
    "name",
    [
        *("near-rho0.cubic-minus.2d", "ranges.blocks", "twins.walls.ranks"),
        *("pair-classes.reconstructed.rk2.harmonic", "refused.background-alone"),
    ],
)
def test_case_fits_a_screen_and_the_rest_is_an_option(name: str, eos_ref_command: Run) -> None:
    short, full = eos_ref_command("explain", name), eos_ref_command("explain", name, "--full")
    assert (short.code, full.code) == (0, 0)
    assert len(short.out.splitlines()) <= SCREEN < len(full.out.splitlines())
    case = case_of(name)
    refused = case.scene.expect is not None
    assert all(rule in short.out for rule in case.exercises)
    assert ("compared" in short.out) != refused and ("bound: " in short.out) != refused
    assert not any(part in short.out for part in OF_FULL) and all(part in full.out for part in OF_FULL[: 4 - refused])
    assert "--full also shows" in short.out and "--full also shows" not in full.out


def test_cases_with_a_common_prefix_are_listed(eos_ref_command: Run) -> None:
    out = eos_ref_command("explain", "near-rho0").out
    listed = casefile.select(cases(), ("near-rho0",))
    assert len(out.splitlines()) < len(listed) + 10
    assert out.count(listed[0].about) == 1
    for case in listed:
        (line,) = (line for line in out.splitlines() if line.split()[:1] == [case.name])
        assert ", ".join(case.exercises) in line and case.scene.pressure[0].style in line
    assert out.splitlines()[-1].startswith(f"next: eos-ref explain {listed[0].name}")
    assert eos_ref_command("explain", "near-rho0", "--full").out.count("LAMMPS commands:") == len(listed)
    document = json.loads(eos_ref_command("explain", "near-rho0", "--json").out)
    assert [each["case"] for each in document["cases"]] == [case.name for case in listed]
    assert all(each["commands"] for each in document["cases"])


def test_text_of_a_twin_quotes_its_file(eos_ref_command: Run) -> None:
    assert "rebuild {every: 1, delay: 0, check: false}: when" in eos_ref_command("explain", "twins.walls.rebuild").out


@pytest.mark.slow
def test_commands_between_runs_are_shown(eos_ref_command: Run) -> None:
    out = eos_ref_command("explain", "runs.fluid.files", "--full").out
    assert "  write_restart ./" in out and "  read_restart ./" in out
    stopped = [case for case in cases() if case.scene.evolve and case.scene.evolve.stops]
    lines = [line for case in stopped for line in _commands(prepare(case).jobs[0])]
    assert len(stopped) > 50 and not any("{folder}" in line for line in lines)
    for remark in ("  # LAMMPS must refuse this", "  # for each atom"):
        assert any(line.endswith(remark) for line in lines)


@pytest.mark.slow
def test_findings_fields_and_verdicts_are_explained(eos_ref_command: Run) -> None:
    kinds = ([entry.id for entry in LEDGER], list(FIELDS), list(MEANINGS))
    for name in (name for names in kinds for name in names[:: len(names) // 2]):  # each loads every case
        code, out, err = eos_ref_command("explain", name)
        assert code == 0 and out.startswith(name), err
        assert json.loads(eos_ref_command("explain", name, "--json").out)


def test_document_has_the_same_text_on_verdicts() -> None:
    text = (ROOT / "docs" / "verdicts.md").read_text().replace("`", "").replace("[findings](findings.md)", "findings")
    for verdict, meaning in MEANINGS.items():
        assert any(verdict in line and meaning in line for line in text.splitlines()), verdict


def test_list_has_the_properties_that_select_cases(eos_ref_command: Run) -> None:
    names = ("near-rho0.linear.2d", "walls.stored.damped", "refused.type-zero")
    code, out, _ = eos_ref_command("list", *names, "--json")
    listed = {case["case"]: case for case in json.loads(out)["cases"]}
    assert code == 0 and listed.keys() == {*names}
    for name, case in listed.items():
        of = case_of(name)
        assert (case["about"], case["tags"], case["file"]) == (of.about, [*of.tags], str(of.source))
        assert (case["units"], case["dimension"]) == (of.scene.units, of.scene.dimension)
        assert case["atoms"] > 0
    linear, walls, refused = (listed[name] for name in names)
    assert (linear["laws"], linear["dimension"], linear["steps"]) == (["linear"], 2, 0)
    assert walls["steps"] > 0 and "rho" in walls["fields"] and refused["fields"] == []


# --- one particle

ATOM = 5
PLAIN = ("explain", "forces.all.quintic.2d", "--atom", "5")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["forces.all.rk1.2d", "forces.all.quintic.3d", "thermal.arithmetic.2d"])
def test_sums_equal_the_fields(name: str, eos_ref_command: Run) -> None:
    case = case_of(name)
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


def test_table_of_pairs_fits_a_narrow_terminal(eos_ref_command: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    out = eos_ref_command(*PLAIN, "--step", "0").out
    assert out.startswith("forces.all.quintic.2d, particle 5 after 0 steps") and "of pressure x" in out
    assert out.rstrip().splitlines()[-1].split()[0] == "sum"
    assert "twin" not in out and "add to it or set it" not in out
    monkeypatch.setenv("COLUMNS", "60")
    out = eos_ref_command(*PLAIN).out
    assert "\N{HORIZONTAL ELLIPSIS}" not in out and max(map(len, out.splitlines())) <= 60, out


def test_twin_shows_the_original(eos_ref_command: Run) -> None:
    words = ("explain", "twins.fluid.translate", "--atom", "5")
    line = "of the original of the two runs that are compared; translate makes the other, its twin"
    assert line in " ".join(eos_ref_command(*words).out.split())
    document, case = json.loads(eos_ref_command(*words, "--json").out), case_of(words[1])
    twin = prepare(case).twin
    assert twin is not None and document["run"] == "original"
    problem = problem_of(twin.scene, twin.atoms, case.where, (document["step"],))
    own = pair_sums.terms(problem, document["step"], 5).particle  # its positions lie on the grid of both runs
    assert document["particle"]["x"] == list(own.x)


@pytest.mark.slow
def test_fixes_that_change_the_force(eos_ref_command: Run) -> None:
    held = ("explain", "walls.stored.gravity", "--atom", "1")
    document = json.loads(eos_ref_command(*held, "--json").out)
    assert document["force_with_fixes"] == [0.0, 0.0] and any(document["sum"]["force"])
    assert "that add to it or set it: 0, 0" in eos_ref_command(*held).out
    pushed = json.loads(eos_ref_command("explain", "walls.stored.gravity", "--atom", "55", "--json").out)
    assert pushed["force_with_fixes"][1] < pushed["sum"]["force"][1] and pushed["particle"]["mass"] > 0
