"""Accepted baselines: LAMMPS' results, one folder per engine, in a form readable in the diffs of a repository.

``baseline.json`` names engine and machine, ``verdicts.tsv`` has a line per case and field, ``arrays/CASE.npz``
holds LAMMPS' arrays of the quick cases at their worst steps, ``reasons.jsonl`` every acceptance with its reason.
"""

from __future__ import annotations

import csv
import itertools
import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import get_args

from pydantic import BaseModel, ConfigDict, Field

from eos_ref import InputError
from lammps_cases.comparison import store
from lammps_cases.records import folders
from lammps_cases.records.case_parts import VERDICTS, Ended, Verdict, as_expected
from lammps_cases.records.documents import SCHEMAS, Document
from lammps_cases.records.files import MIB, csv_text, read_text
from lammps_cases.records.folders import folder_name
from lammps_cases.records.outcome import CaseOutcome, FieldOutcome, StepOutcome
from lammps_cases.records.run_record import EngineRecord, RunRecord
from lammps_cases.records.wording import finding_ids, listed
from lammps_cases.scene import casefile
from lammps_cases.versions import outcomes
from lammps_cases.versions.change import Policy
from lammps_cases.versions.changes import Changes, compare
from lammps_cases.versions.outcomes import Samples, Side

IDENTITY, VERDICT_LINES, ARRAYS, REASONS = "baseline.json", "verdicts.tsv", "arrays", "reasons.jsonl"
LARGEST = 256 * MIB  # of the lines
NOTHING = "-"
CASE = "(case)"  # in the column of fields: the line of the case itself
COLUMNS = ("case", "field", "stage", "verdict", "explained_by", "over_bound", "digest", "detail")
HEAD = (
    "# One line per field: stage, verdict, largest difference over bound, digest of LAMMPS' array over all steps, and",
    "# in detail the verdict and digest of every step. One line per case: how it ended as its stage, the refusal that",
    "# it is for as its detail.",
)


class Identity(BaseModel):
    """``baseline.json``."""

    model_config = ConfigDict(extra="forbid", populate_by_name=True)

    schema_: str = Field(SCHEMAS["baseline"], alias="schema")
    engine: EngineRecord
    machine: str = Field(
        description="what decides how LAMMPS rounds: the processor, as far as it does, and the C library"
    )
    reference: dict[str, str] = Field(description="versions of what judged last")
    cases: int
    fields: int


DOCUMENT = Document("baseline", Identity)


def engine_name(engine: EngineRecord) -> str:
    """Return the name of the folder of an engine's baseline.

    Raises
    ------
    InputError
        The engine has no identity.
    """
    if any(engine.version):
        return folder_name("-".join(engine.version))
    raise InputError("engine", "is not known: the run holds no version, git revision or hash", engine.name)


def find(engine: EngineRecord, baselines: Path) -> Path:
    """Find the baseline of an engine in a folder of baselines; that folder, if it is a baseline itself.

    Raises
    ------
    InputError
        It does not exist.
    """
    if (baselines / IDENTITY).exists():
        return baselines
    folder = baselines / engine_name(engine)
    if not (folders.present(folder) / IDENTITY).exists():
        there = ", ".join(sorted(path.parent.name for path in baselines.glob(f"[!.]*/{IDENTITY}"))) or "none"
        rule = f"none is accepted for this engine (eos-ref accept RUN --reason TEXT; accepted are: {there})"
        raise InputError("baseline", rule, where=str(folder))
    return folder


def readable(baselines: Path) -> None:
    """Raise unless there are baselines to compare a run with.

    Raises
    ------
    InputError
        Neither a folder of baselines nor a baseline.
    """
    if not (baselines / IDENTITY).exists() and not any(baselines.glob(f"*/{IDENTITY}")):
        raise InputError("baseline", "must be a folder of accepted baselines, or one of them", str(baselines))


def read(folder: Path, name: str = "") -> Side:
    """Read a baseline.

    Raises
    ------
    InputError
        No baseline there, one of another schema, or a damaged one: file, line and rule.
    """
    whole = folders.present(folder)
    if not (whole / IDENTITY).exists():
        raise InputError("baseline", f"must be a folder with {IDENTITY}", str(folder))
    identity = DOCUMENT.read(whole / IDENTITY)
    cases = _cases(whole / VERDICT_LINES)
    audited = {name: whole / outcomes.DECKS / name for name in cases if (whole / outcomes.DECKS / name).is_dir()}
    cases |= {name: outcomes.read_deck(folder, cases[name]) for name, folder in audited.items()}
    counted = (len(cases), sum(len(case.fields) for case in cases.values()))
    if counted != (identity.cases, identity.fields):
        rule = f"must hold {identity.cases} cases with {identity.fields} fields, as {IDENTITY} says"
        raise InputError("baseline", rule, "{} and {}".format(*counted), str(whole / VERDICT_LINES))

    def samples(case: str) -> Samples:
        if case in audited:
            return outcomes.of_baseline(audited[case])
        return Samples(whole / ARRAYS / f"{case}.npz")

    side = name or str(whole)
    program = outcomes.program_of(identity.engine, identity.machine)
    return Side(side, identity.engine, identity.reference, cases, samples, whole, identity.machine, program)


# --- verdicts.tsv


def lines(cases: Mapping[str, CaseOutcome], audited: Collection[str] = ()) -> str:
    """Return the content of ``verdicts.tsv``; the steps of audited decks have a separate file."""
    rows: list[Iterable[str]] = [COLUMNS]
    for name in sorted(cases):
        case = cases[name]
        findings = listed(case.explained_by)
        rows.append(_filled(name, CASE, case.ended, case.verdict, findings, "", "", case.expects))
        for field in sorted(case.fields.values(), key=lambda f: f.name):
            by_step = () if name in audited else field.by_step
            detail = " ".join(f"{at.step}:{at.verdict}:{at.digest}" for at in by_step)
            ratio = "" if field.max_over_bound is None else f"{field.max_over_bound:.3g}"
            findings = listed(field.explained_by)
            rows.append(_filled(name, field.name, field.stage, field.verdict, findings, ratio, field.digest, detail))
    return "".join(f"{line}\n" for line in HEAD) + csv_text(rows, "\t")


def _filled(*cells: str) -> Iterator[str]:
    return (cell or NOTHING for cell in cells)  # without white space at the end of a line


def _cases(path: Path) -> dict[str, CaseOutcome]:
    rows = read_text(path, "baseline", LARGEST).splitlines(keepends=True)
    head = sum(1 for _ in itertools.takewhile(lambda row: row.startswith("#"), rows)) + 1
    try:
        columns, *table = list(csv.reader(rows[head - 1 :], delimiter="\t")) or [[]]
    except csv.Error as error:
        raise InputError("baseline", f"is damaged: {error}", where=str(path)) from None
    if tuple(columns) != COLUMNS:
        raise InputError("columns", f"must be {', '.join(COLUMNS)}", ", ".join(columns), f"{path}, line {head}")
    cases: dict[str, CaseOutcome] = {}
    fields: dict[str, dict[str, FieldOutcome]] = {}
    for number, row in enumerate(table, head + 1):
        where = f"{path}, line {number}"
        try:
            case = _row(row)
        except ValueError as error:
            raise InputError("line", f"is damaged: {error}", where=where) from None
        if isinstance(case, CaseOutcome):
            cases[case.case] = case
            fields[case.case] = {}
        elif row[0] in fields:
            fields[row[0]][case.field] = case
        else:
            raise InputError("line", "must follow the line of its case", row[0], where)
    return {name: replace(case, fields=fields[name]) for name, case in cases.items()}


def _row(row: list[str]) -> CaseOutcome | FieldOutcome:
    """Read a line of the table.

    Raises
    ------
    ValueError
        Not a row.
    """
    if len(row) != len(COLUMNS):
        raise ValueError(f"{len(row)} columns instead of {len(COLUMNS)}")
    name, of, stage, text, explained_by, ratio, digest, detail = ("" if cell == NOTHING else cell for cell in row)
    verdict, findings = _verdict(text), tuple(sorted(finding_ids(explained_by)))
    if of == CASE:
        if stage not in get_args(Ended):
            raise ValueError(f"unknown end {stage!r}")
        how: Ended = stage  # type: ignore[assignment]
        expected = as_expected(verdict, detail)
        return CaseOutcome(name, verdict, expected, how, findings, detail)
    steps = (at.split(":") for at in detail.split())
    by_step = tuple(StepOutcome(int(step), _verdict(of_step), bits) for step, of_step, bits in steps)
    return FieldOutcome(of, verdict, findings, float(ratio) if ratio else None, digest, stage, by_step)


def _verdict(text: str) -> Verdict:
    if text not in VERDICTS:
        raise ValueError(f"unknown verdict {text!r}")
    return text


# --- comparison of a run with it


def check(run: RunRecord, folder: Path, baselines: Path, known: Collection[str] | None = None) -> Changes:
    """Compare a run with the accepted baseline of its engine; `Changes.faults` is empty if nothing differs.

    Any change of a verdict, a finding, or how a case ends is a fault, and so is a field that is no longer compared.
    Other bits are a fault on the machine kind of the baseline. On another kind they are only reported, as long
    as they are within bounds: rounding in the last place by functions of the C library and by fused operations
    depends on processor and library, with the same LAMMPS. Cases and fields that the baseline lacks are
    reported, and so are those of it that no case file makes any more; cases that the run did not choose are not.

    Parameters
    ----------
    run : RunRecord
        The run; ``folder`` is its report folder, with the arrays.
    baselines : Path
        Folder of baselines, one per engine, or the baseline to compare with.
    known : collection of str, optional
        All cases of the case files; those shipped unless given.

    Raises
    ------
    InputError
        No baseline for the engine, or a damaged one.
    """
    base = read(find(run.engine, baselines))
    here = machine_of(run)
    chosen = {case.case for case in run.cases}
    a = replace(base, cases={name: case for name, case in base.cases.items() if name in chosen})
    same = base.machine == here
    changes = compare(a, outcomes.of_run(run, folder, "this run"), Policy(bits=same, findings=True, news=False))
    notes = list(changes.notes)
    if not same:
        kinds = f"{base.machine}; this is {here}"
        notes.append(
            f"the baseline was made on another kind of machine ({kinds}); bit differences within the bounds are "
            "reported but do not fail"
        )
    exist = known if known is not None else {case.name for case in casefile.load()}
    absent = sorted(base.cases.keys() - set(exist) - chosen)
    if absent:
        rule = "no case file defines these cases of the baseline any more (eos-ref accept --prune drops them)"
        notes.append(f"{rule}: {', '.join(absent)}")
    return replace(changes, notes=tuple(notes))


def check_decks(run: RunRecord, folder: Path, place: Path, whole: bool) -> Changes:
    """Compare the audits of decks with the accepted ones, of any LAMMPS.

    With the same library on the same kind of machine every bit must be equal. Otherwise both have the same prediction
    only where the runs begin; from there on each is compared with the reference at its own state, and only a verdict,
    a finding, or the digits of thermo output that LAMMPS prints are faults.

    Parameters
    ----------
    run : RunRecord
        The audits; ``folder`` is their report folder.
    place : Path
        The baseline.
    whole : bool
        Whether all decks of the baseline should be among the audits.

    Raises
    ------
    InputError
        No baseline there, a damaged one, or one that holds none of the decks.
    """
    base = read(place)
    chosen = {case.case for case in run.cases}
    if not chosen & base.cases.keys():
        raise InputError("deck", "is not in the baseline (--accept adds it)", ", ".join(sorted(chosen)), str(place))
    a = base if whole else replace(base, cases={name: base.cases[name] for name in chosen & base.cases.keys()})
    b = outcomes.of_run(run, folder, "this run")
    changes = compare(a, b, Policy(bits=a.program == b.program, findings=True, news=False))
    first = sorted(changes.fields, key=lambda change: (change.case, math.inf if change.step is None else change.step))
    return replace(changes, fields=tuple(first))


def machine_of(run: RunRecord) -> str:
    """Return what determines the instructions and the C library that rounded in a run: its note, or this machine.

    The model of the processor is part of it, although processors of one family mostly round equally: treating two
    machines as different costs a warning, treating them as the same a false alarm.
    """
    return run.machine.get("kind") or store.processor()  # older runs hold no note
