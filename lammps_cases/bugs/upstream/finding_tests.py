"""A test of a finding for LAMMPS' own tree: red while LAMMPS has it, green once it alone is fixed.

The smallest scene of a finding becomes a file for ``test_fix_timestep``, or for ``test_pair_style`` where it is about a
virial. A number that particles have is compared as a column of compute rheo/property/atom, of particles without forces;
a force by the positions and velocities that follow from it. A finding about input becomes a test of commands, in the
form of LAMMPS' manual (Developer_unittest).
"""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from eos_ref import InputError
from eos_ref.model.state import masses
from eos_ref.syntax.manual import MANUALS
from lammps_cases.bugs.report import Demonstration, Report, case_of, demonstrations
from lammps_cases.bugs.upstream.files import TESTS, kit_files
from lammps_cases.bugs.upstream.force_tests import (
    COLUMNS,
    STAGES,
    TEMPLATE,
    Expected,
    ForceTest,
    Stage,
    compared,
    error,
    expected,
    of_case,
    problem,
    reduced,
    shown,
    table,
)
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.problem import Problem
from lammps_cases.findings import KNOWN, LEDGER, Finding
from lammps_cases.findings.neighbour_lists import NeighbourList
from lammps_cases.findings.variants import Snapshot, combined
from lammps_cases.records.wording import listed
from lammps_cases.scene import casefile
from lammps_cases.scene.fields import FIELDS

OF_FIX = {"steps": 8, "timestep": 0.25, "compare_at": [8], "stops": [{"at": 0}, {"at": 4}]}
OF_PAIR = {"steps": 4, "timestep": 1e-300, "compare_at": [0, 4], "stops": [{"at": 0}]}
COMMANDS = "unittest/commands"  # in LAMMPS' tree
WORDS = "Words only:"  # a remedy that changes the manual and not LAMMPS
VIRIALS = ("stress/atom", "virial")


@dataclass(frozen=True)
class FindingTest:
    """A test by its files, their folder in LAMMPS' tree, and the command that runs it."""

    files: dict[str, str]
    folder: str
    ctest: str


@np.errstate(invalid="ignore", over="ignore", divide="ignore")  # in scenes whose steps rounding decides
def test_of(report: Report, predictor: Predictor | None = None) -> FindingTest | str:
    """Return the test of a report's finding, or why LAMMPS' forms of tests cannot show it."""
    entry, predictor = report.finding, predictor or Predictor()
    if entry is None:
        return "no finding explains it"
    scene = demonstrations().get(entry.id)
    if entry.remedy.startswith(WORDS):
        return "only words of the manual have to change"
    try:
        if scene is None or scene.number is None:
            return of_commands(report, entry)
        test = force_test(entry, scene, report)
        numbers = expected(test, predictor)
    except InputError as refused:
        return f"the {refused.what} {refused.rule}"
    if shows(test, numbers, predictor, entry) is False:
        return "its numbers after the steps of the test programs are right"
    if others := acting(test, numbers, predictor, entry):
        return f"its numbers also depend on {listed(others)}, without which it would stay red"
    files = {Path(file.path).name: file.content for file in kit_files(predictor, [test])}
    return FindingTest(files, TESTS, f"ctest -R {test.name.partition('_')[2]} -V")


def force_test(entry: Finding, made: Demonstration, report: Report) -> ForceTest:
    """Return the test of a finding's smallest scene.

    Raises
    ------
    InputError
        The forms of tests have no place for it.
    """
    assert made.number is not None
    if not made.made_in(MANUALS[-1]):
        raise InputError("finding", f"must contradict the manual of LAMMPS' tree, {MANUALS[-1]}")
    if made.other:
        raise InputError("finding", "must show in one scene, not in two")
    field, changes = made.number.field, dict[str, Any]()
    if field in VIRIALS:
        changes |= {"compare": ["f", "virial"], "evolve": OF_PAIR}
    else:
        changes |= {"compare": ["x", "v", *[field] * bool(FIELDS[field].column)], "evolve": OF_FIX}
    if FIELDS[field].column and "forces" not in made.scene:
        changes["forces"] = [{"style": "setforce", "vector": [0.0] * made.scene["dimension"]}]
    case = case_of(entry.id, entry.title, casefile.merge(casefile.merge(made.scene, changes), made.test))
    if case.scene.mass:
        raise InputError("finding", "must show without per-particle masses, which the programs set")
    label = "pair" if field in VIRIALS else "property" if case.scene.compare[2:] else "rheo"
    test = of_case(replace(case, name=f"finding.{label}-{entry.id}", about=about(entry, report)))
    name = TEMPLATE.removeprefix("in.")
    return replace(test, data_name=f"data.{name}_{entry.id.replace('-', '_')}")


def about(entry: Finding, report: Report) -> str:
    """Return what a file of a test is about, with the calculation by hand before the first step."""
    lines = [f"{entry.title}.", f"Remedy: {entry.remedy}"]
    if report.lines and report.number:
        component = "".join("xyz"[axis] for axis in report.number.axes)
        steps = ", ".join(f"{line.name} = {line.formula}" for line in report.lines)
        of = f"{report.number.field} {component}".strip()
        lines.append(f"By hand, {of} of atom {report.number.atom} at first: {steps} = {report.lines[-1].value:.15g}")
    return "\n".join(lines)


def acting(test: ForceTest, numbers: Expected, predictor: Predictor, entry: Finding) -> list[str]:
    """Return the other findings of the newest LAMMPS that change the numbers of a test beyond its epsilon."""
    others = [other for other in LEDGER if other.id != entry.id and other.listed(KNOWN[-1])]
    return [other.id for other in others if shows(test, numbers, predictor, other) is not False]


def shows(test: ForceTest, numbers: Expected, predictor: Predictor, entry: Finding) -> bool | None:
    """Return whether a finding makes a test red; None if only LAMMPS' neighbour lists decide."""
    variant = entry.model_variant
    answers: list[bool | None] = []
    if variant is None:
        return False
    for stage in STAGES[test.program]:
        of = problem(test, stage)
        if stage.name == "rmass":  # the masses of types, as each particle's own
            of = replace(of, state=replace(of.state, mass_n=masses(of.model, of.state)))
        if not variant.applies(of):
            continue
        lists = _lists(test, stage, of)
        made = combined([variant], of, lists)
        if made is None or (variant.lists and not lists):
            answers.append(None)
            continue
        (fields,) = predictor.values(of, made)
        for field, key in ((field, stage.keys[field]) for field in compared(test)):
            values = reduced(table(test, fields)) if field == COLUMNS else shown(test, field, np.asarray(fields[field]))
            red = not (error(values, numbers.values[key]) <= numbers.epsilon * stage.factors[field]).all()
            answers.append(red or (None if variant.undefined and not variant.lists else False))
    return True if True in answers else None if None in answers else False


def _lists(test: ForceTest, stage: Stage, of: Problem) -> Snapshot:
    """Return a neighbour list with every pair once, for every evaluation; empty where there are periodic images."""
    count = len(test.atoms)
    if any(test.atoms.periodic[: test.scene.dimension]):
        return {}
    flags = (False, False) if stage.name.startswith("newton off") else test.scene.engine.newton_flags
    given = NeighbourList(
        row_s=np.arange(count),
        x_sc=test.atoms.x_nc,
        own_s=np.ones(count, dtype=bool),
        pair_ps=np.array([*itertools.combinations(range(count), 2)], dtype=int).reshape(-1, 2),
        rank_s=np.zeros(count, dtype=int),
        low_rc=np.array([test.atoms.low_c]),
        newton=np.array(flags) & (stage.name != "nofdotr"),  # with nofdotr LAMMPS sums the virials of its pairs
    )
    return {"lists": (given,) * (stage.after + len(of.stops) + 1)}


def of_commands(report: Report, entry: Finding) -> FindingTest:
    """Return the test of an input that LAMMPS must run, or refuse.

    Raises
    ------
    InputError
        Its deck reads a file or compares numbers.
    """
    made = report.deck
    if made.data:
        raise InputError("deck", "must not read a data file in a test of commands")
    if entry.differing or made.lines[-1] not in ("print PASS", "print FAIL"):
        raise InputError("deck", "must not compare numbers in a test of commands")
    name = "".join(word.capitalize() for word in entry.id.split("-"))
    file = f"test_{TEMPLATE.removeprefix('in.')}_{entry.id.replace('-', '_')}.cpp"
    text = "\n".join((*(f"// {line}" for line in about(entry, report).splitlines()), *_fixture(report, name), ""))
    return FindingTest({file: text}, COMMANDS, "ctest -R SimpleCommands -V")


def _fixture(report: Report, name: str) -> Iterator[str]:
    lines = [line for line in report.deck.lines if not line.startswith("print ")]
    given = [f"    command({json.dumps(line)});" for line in lines]
    yield f"TEST_F(SimpleCommandsTest, {name})"
    yield "{"
    if report.deck.refused:
        error = re.sub(r"([^\w ,:/'-])", r"\\\1", report.deck.refused)
        yield f"    TEST_FAILURE({json.dumps(f'.*ERROR.*{error}.*')},"
        yield from (f"    {line}" for line in given)
        yield "    );"
    else:
        yield from ("    BEGIN_HIDE_OUTPUT();", *given, "    END_HIDE_OUTPUT();")
    yield "}"
