"""A test for LAMMPS' tree per finding: which ones have one, and that it is red by the finding alone."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import pytest
import yaml
from syrupy.assertion import SnapshotAssertion

from lammps_cases.bugs import issue
from lammps_cases.bugs.deck import Ending
from lammps_cases.bugs.report import demonstrations
from lammps_cases.bugs.upstream import finding_tests
from lammps_cases.bugs.upstream.finding_tests import FindingTest, force_test, shows
from lammps_cases.bugs.upstream.force_tests import TEMPLATE, ForceTest, expected
from lammps_cases.bugs.upstream.programs import Commands, explained, failing, replay
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.engine.workers import Workers
from lammps_cases.findings import LEDGER
from tests.support.bug_decks import engine_of, finding_of, report_of, version_of

PREDICTOR = Predictor()


@cache
def made(name: str) -> FindingTest | str:
    return finding_tests.test_of(report_of(name), PREDICTOR)


def force(name: str) -> ForceTest:
    return force_test(finding_of(name), demonstrations()[name], report_of(name))


def with_files() -> list[tuple[str, FindingTest]]:
    """The findings with a test for the programs that read files."""
    tests = ((entry.id, made(entry.id)) for entry in LEDGER)
    return [(name, one) for name, one in tests if isinstance(one, FindingTest) and TEMPLATE in one.files]


@pytest.mark.slow
def test_every_finding_has_a_test_or_a_reason(snapshot: SnapshotAssertion) -> None:
    tests = {entry.id: made(entry.id) for entry in LEDGER}
    kinds = {name: one if isinstance(one, str) else f"in {one.folder}" for name, one in tests.items()}
    assert kinds == snapshot


@pytest.mark.slow
def test_numbers_are_red_by_the_finding() -> None:
    """Where its variant needs no neighbour lists; of the other findings of the newest LAMMPS none makes them red."""
    for name, _ in with_files():
        test = force(name)
        assert shows(test, expected(test, PREDICTOR), PREDICTOR, finding_of(name)) is not False, name


@pytest.mark.slow
def test_files_have_names_of_their_own_and_the_calculation_by_hand() -> None:
    own = TEMPLATE.removeprefix("in.")
    for name, test in with_files():
        assert all(own in file for file in test.files)
        (of,) = (file for file in test.files if file.endswith(".yaml"))
        (data,) = (file for file in test.files if file.startswith("data."))
        text, report = test.files[of], report_of(name)
        assert yaml.safe_load(text)["epsilon"] > 0 and f"variable data_file index ${{input_dir}}/{data}" in text
        assert all(f"{line.name} = {line.formula}" in text for line in report.lines)
        written = issue.text(report, Ending(0, "LAMMPS (22 Jul 2025)\n"), test)
        assert f"`{test.ctest}`" in written and all(f"`{file}`" in written for file in test.files)
        assert finding_of(name).remedy in written and "independent reference" in written
        pattern = re.fullmatch(r"ctest -R (\w+) -V", test.ctest)
        assert pattern and pattern[1] in of


def test_report_without_a_test_says_why() -> None:
    name = "virial-of-places"
    written = issue.text(report_of(name), Ending(0, "LAMMPS (22 Jul 2025)\n"), made(name))
    assert "There is no test for LAMMPS' own tree: its numbers also depend on virials-cancel" in written


@pytest.mark.lammps
@pytest.mark.parametrize(
    ("name", "engine", "red"),
    [
        ("force-per-volume", "env", True),
        ("force-per-volume", "pypi:2025.7.22.1.0", False),
        ("heat-is-temperature-rate", "env", True),
        ("virials-cancel", "env", True),
        ("mass-of-first", "env", True),
        ("temperature-without-mass", "env", False),
    ],
)
def test_red_where_lammps_has_the_finding(name: str, engine: str, red: bool, tmp_path: Path) -> None:
    """By the commands of the test programs, for the finding alone; green on a LAMMPS without it."""
    test, whole = force(name), made(name)
    assert isinstance(whole, FindingTest)
    for file, text in whole.files.items():
        (tmp_path / file).write_text(text)
    with Workers(engine_of(engine).site, 1) as workers:
        looks = workers.outcome(workers.call(replay, Commands.of(test), str(tmp_path), time_limit=60))
    checks = [*failing(test, expected(test, PREDICTOR), looks)]
    by = [explained(test, stage, each, looks[stage.name], version_of(engine), PREDICTOR) for stage, each in checks]
    assert bool(checks) == red
    # The reference does not see the masses of the last stage of the program, which show that one.
    assert set(by) <= {(name,)} or name == "mass-of-first"
