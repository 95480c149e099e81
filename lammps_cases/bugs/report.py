"""A bug report of a finding or a red case: the deck, and the data for the text for LAMMPS' tracker.

A finding is demonstrated by a minimal scene, and a number in it (the last section of its document), which formulas
over the pairs of one particle give by hand. A finding about input has no number: LAMMPS runs the first case or probe
that it applies to, unchanged or smaller.
"""

from __future__ import annotations

import fnmatch
import functools
import math
import re
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict

from eos_ref import InputError
from eos_ref.errors import unknown
from eos_ref.syntax.manual import FIRST, Manual
from lammps_cases.bugs import deck
from lammps_cases.bugs.deck import BugDeck, Check
from lammps_cases.claims.probes import manual
from lammps_cases.claims.probes.manual import ManualProbe
from lammps_cases.comparison import pair_sums
from lammps_cases.comparison.pair_sums import Sum
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.problem import Problem
from lammps_cases.engine.installations import Engine
from lammps_cases.engine.session import Job
from lammps_cases.engine.workers import Workers
from lammps_cases.findings import LEDGER, Finding
from lammps_cases.findings.document import demonstration
from lammps_cases.findings.variants import combined
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.records.yaml_files import OfManual
from lammps_cases.run import campaign, prepared_case, provenance
from lammps_cases.scene import casefile
from lammps_cases.scene.casefile import Case
from lammps_cases.scene.fields import FIELDS
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan
from lammps_cases.verdict.problems import problem_of


class AtomNumber(BaseModel):
    """A component of a field of an atom, after the last step of a scene or another step."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    field: str
    atom: int
    axes: tuple[int, ...] = ()
    step: int | None = None


class Workaround(BaseModel):
    """What runs a line of a workaround: one of these, which the tests of the findings do.

    Attributes
    ----------
    scenes : changes of the scene, each of which is effective
    also : other findings that show in these
    edits : edits of the deck, old and new text
    orders, wrong : commands before the last run of the deck, by name: effective ones, and ones that are not
    nothing : why there is nothing to run
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    scenes: tuple[dict[str, Any], ...] = ()
    also: tuple[str, ...] = ()
    edits: tuple[tuple[str, str], ...] = ()
    orders: tuple[str, ...] = ()
    wrong: tuple[str, ...] = ()
    nothing: str = ""


class EditedDeck(BaseModel):
    """A deck of the probes with other words, one after the other, and how it ends; run by the tests of the findings.

    Attributes
    ----------
    base, edits : the deck, and old and new text in it
    law, keywords, pair, ask : the arguments of fix rheo/pressure, the keywords of fix rheo, the pair style, the columns
        that a compute outputs in place of the steps; one of these
    ended : how LAMMPS ends; "nan": without a message, and with NaN for every number
    says, lacks : what its error contains and does not contain, with @ for the first of the words
    as_if, unlike : other such words, with which every number is the same, or not
    forbidden : what the reference says of them
    workaround : the line of the workaround that they are
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    base: str = "deck"
    edits: tuple[tuple[str, str], ...] = ()
    law: tuple[str, ...] = ()
    keywords: tuple[str, ...] = ()
    pair: tuple[str, ...] = ()
    ask: tuple[str, ...] = ()
    ended: Literal["answered", "refused", "crashed", "nan"] = "answered"
    says: tuple[str, ...] = ()
    lacks: tuple[str, ...] = ()
    as_if: str = ""
    unlike: str = ""
    forbidden: str = ""
    workaround: int = 0


class Demonstration(OfManual, BaseModel):
    """What shows a finding: content of a deck, and of the tests of its text.

    Attributes
    ----------
    scene : the keys of a scene
    number : the number in it to compare
    hand : the same by hand: formulas of `symbols`, the last of which gives the number
    other : changes for a second scene, which must give the same number
    times : factor between the two numbers
    smaller : changes of the case that the finding applies to
    recomputed : named numbers of the text, as expressions of what the scene gives
    decks : decks with the words of the text
    test : changes of the scene with which LAMMPS' test programs show the finding alone
    workaround : what runs lines of the workaround, by their number
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    scene: dict[str, Any] = {}
    number: AtomNumber | None = None
    hand: dict[str, str] = {}
    other: dict[str, Any] = {}
    times: float = 1.0
    smaller: dict[str, Any] = {}
    recomputed: dict[str, str] = {}
    decks: tuple[EditedDeck, ...] = ()
    test: dict[str, Any] = {}
    workaround: dict[int, Workaround] = {}


@functools.cache
def demonstrations() -> dict[str, Demonstration]:
    """Return the demonstrations of findings that have a scene or change a case, by finding."""
    found = {entry.id: Demonstration.model_validate(demonstration(entry.id)) for entry in LEDGER}
    return {name: shown for name, shown in found.items() if shown.scene or shown.smaller}


def case_of(name: str, about: str, scene: Mapping[str, Any]) -> Case:
    """Return a scene as a case, read like a case file.

    Raises
    ------
    InputError
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"{name}.yaml"
        file.write_text(yaml.safe_dump({"name": name, "about": about, "scene": dict(scene)}))
        return casefile.load_file(file)[0]


def smaller(case: Case, changes: Mapping[str, Any]) -> Case:
    """Return a case with changes of its scene."""
    if not changes:
        return case
    scene = case.scene.model_dump(mode="json", exclude_unset=True)
    return case_of(case.name.split(".")[0], case.about, casefile.merge(scene, changes))


@dataclass(frozen=True)
class Line:
    """A line of the calculation: name, formula, the formula with numbers for LAMMPS, value."""

    name: str
    formula: str
    numbers: str
    value: float


def symbols(given: Sum) -> dict[str, float]:
    """Return the symbols of formulas, each with the id of its particle: m1, rho1, v1 by components, of pairs r2, W2.

    ``gx2`` and ``gy2`` are the gradient of the kernel for the pair of the number's particle with particle 2, ``x2``
    and ``y2`` its distance vector.
    """
    numbers: dict[str, float] = {}
    for one in (given.particle, *(pair.other for pair in given.pairs)):
        values = {"m": one.mass, "rho": one.rho, "vx": one.v[0], "vy": one.v[1], **one.constants}
        numbers |= {f"{name}{one.id}": number for name, number in values.items()}
    for pair in given.pairs:
        values = {"r": pair.r, "W": pair.w, "x": pair.x[0], "y": pair.x[1]}
        values |= {"gx": pair.gradient[0], "gy": pair.gradient[1]}
        numbers |= {f"{name}{pair.other.id}": number for name, number in values.items()}
    return numbers


def calculate(formulas: Mapping[str, str], given: Sum) -> tuple[Line, ...]:
    """Evaluate formulas in order; each may refer to those before it."""
    numbers, lines = symbols(given), dict[str, Line]()
    for name, formula in formulas.items():

        def number(word: re.Match[str]) -> str:
            if word[0] in lines:
                return f"${{{word[0]}}}"
            return repr(numbers[word[0]]) if numbers[word[0]] >= 0 else f"({numbers[word[0]]!r})"

        scope = numbers | {line.name: line.value for line in lines.values()}
        result = float(eval(formula.replace("^", "**"), {"__builtins__": {}}, scope))  # data of this package
        lines[name] = Line(name, formula, re.sub(r"[A-Za-z]\w*", number, formula), result)
    return tuple(lines.values())


@dataclass(frozen=True)
class Report:
    """A deck and its subject.

    Attributes
    ----------
    finding : the finding that it shows, None for a case that no finding explains
    number : the number to compare; None: how LAMMPS ends
    sum : the terms that the reference summed for the number
    lines : the number by hand from these, if short
    """

    name: str
    title: str
    deck: BugDeck
    finding: Finding | None = None
    record: CaseRecord | None = None
    number: AtomNumber | None = None
    sum: Sum | None = None
    lines: tuple[Line, ...] = ()


@dataclass(frozen=True)
class ExpectedNumber:
    """A number of the reference: the value, its bound, the step, and the problem of the prediction."""

    value: float
    bound: float
    step: int
    problem: Problem


def finding_named(name: str) -> Finding | None:
    """Return the finding with a name; None without one."""
    return next((entry for entry in LEDGER if entry.id == name), None)


def make(name: str, engine: Engine, paths: tuple[Path, ...] = ()) -> Report:
    """Return the report of a finding, or of a case that is red on an engine.

    Raises
    ------
    InputError
        No finding or case has the name, or there is nothing to report.
    """
    entry = finding_named(name)
    if entry is not None:
        with Workers(engine.site, 1) as workers:
            who = workers.outcome(workers.identify())
        return of_finding(entry, provenance.engine_record(engine, who).manual)
    cases = casefile.load(paths)
    if not casefile.names_like(name, cases):
        raise unknown("finding or case", name, [*(entry.id for entry in LEDGER), *(case.name for case in cases)])
    return of_case(casefile.only(cases, name), engine)


def of_finding(entry: Finding, manual: Manual = FIRST) -> Report:
    """Return the report of a finding, for a LAMMPS that a version of the manual describes.

    Raises
    ------
    InputError
        That version documents LAMMPS' behaviour.
    """
    shown, probe = demonstrations().get(entry.id), _probe(entry)
    for demonstrated, why in ((shown, "which documents what LAMMPS does"), (probe, "which does not promise otherwise")):
        if demonstrated is not None and not demonstrated.made_in(manual):
            raise InputError("finding", f"is not a bug by the manual of {manual}, {why}", entry.id)
    if shown is None or shown.number is None:
        return Report(entry.id, entry.title, _of_input(entry), entry)
    case = case_of(entry.id, entry.title, shown.scene).by(manual)
    if shown.other:
        other = case_of(entry.id, entry.title, casefile.merge(shown.scene, shown.other)).by(manual)
        made = _of_two(case, other, shown.number, shown.times)
        return Report(entry.id, entry.title, made, entry, number=shown.number)
    made, terms = _of_number(case, shown.number, formulas=shown.hand)
    lines = calculate(shown.hand, terms)
    return Report(entry.id, entry.title, made, entry, number=shown.number, sum=terms, lines=lines)


def _probe(entry: Finding) -> ManualProbe | None:
    """Return the probe, if any, that shows a finding without its own scene."""
    by_scene = entry.model_variant is not None and entry.id in demonstrations()
    name = entry.applies_to[0] if entry.applies_to and not by_scene else ""
    return next((probe for probe in manual.probes() if fnmatch.fnmatchcase(probe.name, name)), None)


def _of_input(entry: Finding) -> BugDeck:
    """Return the deck of the first case or probe that a finding about input applies to."""
    name, probe = entry.applies_to[0], _probe(entry)
    if probe is not None:
        given = probe.input
        if probe.measured and not isinstance(given, Job):
            return deck.of_measured(given)
        return deck.of_outcome(given, probe.refused)
    shown = demonstrations().get(entry.id)
    case = casefile.select(casefile.load(), (name,))[0]
    return _of_case_input(smaller(case, shown.smaller if shown else {}))


def _of_case_input(case: Case) -> BugDeck:
    scene = case.scene
    return deck.of_outcome(prepared_case.prepare(case).jobs[0], scene.expect.refused if scene.expect else "")


def _of_two(case: Case, other: Case, number: AtomNumber, times: float) -> BugDeck:
    first, second = (prepared_case.prepare(one).jobs[0] for one in (case, other))
    obtained = deck.word(first, number.field, number.atom, number.axes)
    bound = times * predicted(case, number).bound
    return deck.of_two(first, second, times, Check(obtained, "", bound))


def _of_number(
    case: Case, number: AtomNumber, step: int | None = None, formulas: Mapping[str, str] = MappingProxyType({})
) -> tuple[BugDeck, Sum]:
    """Return the deck for a number after the last step of a scene or another step, and the terms of the reference.

    Raises
    ------
    InputError
        LAMMPS' variables do not read it.
    """
    expected = predicted(case, number, step)
    ready = prepared_case.prepare(case)
    lammps_job = job(case.scene, ready.atoms, plan(case.scene))
    obtained = deck.word(lammps_job, number.field, number.atom, number.axes)
    if not obtained:
        raise InputError("field", "cannot be read by LAMMPS' variables", number.field, case.name)
    terms = pair_sums.terms(expected.problem, expected.step, number.atom)
    check = Check(obtained, repr(expected.value), expected.bound)
    if formulas:
        check = _by_hand(obtained, expected, calculate(formulas, terms))
    return deck.of_number(lammps_job, expected.step, check), terms


def _by_hand(obtained: str, expected: ExpectedNumber, lines: Sequence[Line]) -> Check:
    """Return the check against a number calculated by LAMMPS.

    Its operations are those of the reference, which rounds them as well: the bound counts twice. In formulas LAMMPS
    uses other variables with 15 significant digits, which adds half a unit of the last one.

    Raises
    ------
    InputError
        The formulas do not give what the reference predicts.
    """
    bound = 2 * expected.bound
    if not abs(lines[-1].value - expected.value) <= bound:
        raise InputError("calculation by hand", f"must give {expected.value!r}", lines[-1].value)
    if expected.value:
        bound += 0.5 * 10.0 ** (math.floor(math.log10(abs(expected.value))) - 14)
    return Check(obtained, "v_expected", bound, tuple((line.name, line.numbers) for line in lines))


def predicted(case: Case, number: AtomNumber, step: int | None = None) -> ExpectedNumber:
    """Return the number that the reference predicts, after the last step of a scene or another step."""
    step = number.step if step is None else step
    at = case.scene.snapshots[-1] if step is None else step
    problem, value_n, bound_n = _fields(case, number.field, at)
    row = list(prepared_case.prepare(case).atoms.id_n).index(number.atom)
    place = (row, *number.axes)
    return ExpectedNumber(float(value_n[place]), float(bound_n[place]), at, problem)


def _fields(case: Case, field: str, step: int) -> tuple[Problem, Any, Any]:
    problem = problem_of(case.scene, prepared_case.prepare(case).atoms, case.where, (step,))
    problem = replace(problem, fields=(field,))
    prediction = Predictor().predict(problem)
    value_n = np.asarray(prediction.fields[0][field], float)
    return problem, value_n, np.broadcast_to(prediction.bounds[0][field], value_n.shape)


def of_case(case: Case, engine: Engine) -> Report:
    """Run a case on an engine and return the report of the first number outside its bound, or of how LAMMPS ends.

    Raises
    ------
    InputError
        The case is not red, or its failure does not fit into one deck.
    """
    if case.scene.twin:
        raise InputError("case", "must not be a twin, which is two runs: name its original", case.name)
    with tempfile.TemporaryDirectory() as folder:
        run = campaign.run_cases([case], engine, 1, Path(folder) / "run")
    (record,), case = run.cases, case.by(run.engine.manual)
    if record.as_expected and record.verdict != "explained":
        raise InputError("case", f"must be red on {engine.name}: there is nothing to report", record.verdict)
    if record.ended != "answered":
        entry = finding_named(record.explained_by[0]) if record.explained_by else None
        return Report(case.name, entry.title if entry else record.message, _of_case_input(case), entry, record)
    number, step = _first_outside(case, record)
    names = next(field.explained_by for field in record.fields if field.field == number.field)
    entry = _changing(names, predicted(case, number, step), number)
    made, terms = _of_number(case, number, step)
    return Report(case.name, entry.title if entry else record.message, made, entry, record, number, terms)


def _changing(names: Sequence[str], expected: ExpectedNumber, number: AtomNumber) -> Finding | None:
    """Return the first finding that explains a case and whose variant changes the number; else the first of all."""
    entries = [entry for entry in map(finding_named, names) if entry]
    for entry in entries:
        made = combined([entry.model_variant], expected.problem, {}) if entry.model_variant else None
        if made is None:
            continue
        (fields,) = Predictor().values(expected.problem, made)
        changed = np.asarray(fields[number.field], float)[(number.atom - 1, *number.axes)]
        if not abs(changed - expected.value) <= expected.bound:
            return entry
    return entries[0] if entries else None


def _first_outside(case: Case, record: CaseRecord) -> tuple[AtomNumber, int]:
    job = prepared_case.prepare(case).jobs[0]
    last = case.scene.snapshots[-1]
    outside = [(field.field, field.worst_id, field.worst_step) for field in record.fields if field.outside]
    if record.blame:
        outside.insert(0, (record.blame.field, record.blame.atom, record.blame.step))
    for name, atom, at in outside:
        if name in FIELDS and atom is not None and deck.word(job, name, atom, (0,) * FIELDS[name].quantity.rank):
            step = last if at is None else at
            axes = _axes(case, name, atom, step, record)
            return AtomNumber(field=name, atom=atom, axes=axes), step
    raise InputError("case", "has no field outside its bound that LAMMPS' variables read", case.name)


def _axes(case: Case, field: str, atom: int, step: int, record: CaseRecord) -> tuple[int, ...]:
    """Return the blamed component, by its value on the side of the reference; else the first."""
    of_atom = np.asarray(_fields(case, field, step)[1][list(prepared_case.prepare(case).atoms.id_n).index(atom)])
    blame = record.blame
    if not of_atom.ndim or blame is None or blame.reference is None or (blame.field, blame.atom) != (field, atom):
        return (0,) * of_atom.ndim
    return tuple(int(k) for k in np.unravel_index(np.argmin(np.abs(of_atom - blame.reference)), of_atom.shape))
