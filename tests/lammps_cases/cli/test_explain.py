"""eos-ref explain: the purpose of a case on one screen, and the rest on request."""

from __future__ import annotations

import json
from collections.abc import Callable

import pytest

from lammps_cases.cli.explain import _commands
from lammps_cases.run.prepared_case import prepare
from lammps_cases.scene import casefile
from tests.support.outcome import Outcome

Run = Callable[..., Outcome]
SCREEN = 40  # lines
OF_FULL = ("modelled by the reference", "given to LAMMPS", "LAMMPS commands:", "evaluated by")


# One of a law, the one with most types, the twin and the walls with most rules, one that LAMMPS is to refuse.
@pytest.mark.parametrize(
    "name",
    [
        "near-rho0.cubic-minus.2d",
        "ranges.blocks",
        "twins.walls.ranks",
        "pair-classes.reconstructed.rk2.harmonic",
        "refused.background-alone",
    ],
)
def test_case_fits_a_screen_and_the_rest_is_an_option(name: str, eos_ref_command: Run) -> None:
    short, full = eos_ref_command("explain", name), eos_ref_command("explain", name, "--full")
    assert (short.code, full.code) == (0, 0)
    assert len(short.out.splitlines()) <= SCREEN < len(full.out.splitlines())
    (case,) = casefile.select(casefile.load(), (name,))
    refused = case.scene.expect is not None
    for rule in case.exercises:
        assert rule in short.out
    assert ("compared" in short.out) != refused and ("bound: " in short.out) != refused
    assert not any(part in short.out for part in OF_FULL) and all(part in full.out for part in OF_FULL[: 4 - refused])
    assert "--full also shows" in short.out and "--full also shows" not in full.out


def test_cases_with_a_common_prefix_are_listed(eos_ref_command: Run) -> None:
    out = eos_ref_command("explain", "near-rho0").out
    cases = casefile.select(casefile.load(), ("near-rho0",))
    assert len(out.splitlines()) < len(cases) + 10
    assert out.count(cases[0].about) == 1
    for case in cases:
        (line,) = (line for line in out.splitlines() if line.split()[:1] == [case.name])
        assert ", ".join(case.exercises) in line and case.scene.pressure[0].style in line
    assert out.splitlines()[-1].startswith(f"next: eos-ref explain {cases[0].name}")
    full = eos_ref_command("explain", "near-rho0", "--full").out
    assert full.count("LAMMPS commands:") == len(cases)
    document = json.loads(eos_ref_command("explain", "near-rho0", "--json").out)
    assert [each["case"] for each in document["cases"]] == [case.name for case in cases]
    assert all(each["commands"] for each in document["cases"])


def test_text_of_a_twin_quotes_its_file(eos_ref_command: Run) -> None:
    assert "rebuild {every: 1, delay: 0, check: false}: when" in eos_ref_command("explain", "twins.walls.rebuild").out


def test_commands_between_runs_are_shown(eos_ref_command: Run) -> None:
    out = eos_ref_command("explain", "runs.fluid.files", "--full").out
    assert "  write_restart ./" in out and "  read_restart ./" in out
    stopped = [case for case in casefile.load() if case.scene.evolve and case.scene.evolve.stops]
    told = [line for case in stopped for line in _commands(prepare(case).jobs[0])]
    assert len(stopped) > 50 and not any("{folder}" in line for line in told)
    for remark in ("  # LAMMPS must refuse this", "  # for each atom"):
        assert any(line.endswith(remark) for line in told)
