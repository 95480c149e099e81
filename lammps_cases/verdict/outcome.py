"""Records of how cases ended: without numbers, without all atoms, or with fields; what every judgement shares."""

from __future__ import annotations

import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from eos_ref import EOSTable
from eos_ref.eos.bounds import EPS
from eos_ref.model.box import Box
from eos_ref.model.parameters import IntArray
from lammps_cases.comparison.compare import Comparison, compare_field, components, excess
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.problem import Problem
from lammps_cases.engine.session import Answer
from lammps_cases.engine.workers import Failure
from lammps_cases.findings import explain_outcome
from lammps_cases.records import field_names, wording
from lammps_cases.records.run_record import (
    Blame,
    CaseRecord,
    EngineRecord,
    LawRecord,
    LostAtoms,
    Predictions,
    Seconds,
)
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import Atoms, kernel_cut, seed
from lammps_cases.scene.casefile import Case
from lammps_cases.scene.stops import AS_TEXT, FOR_EACH_ATOM
from lammps_cases.verdict.model_fields import blame_of

Arrays = dict[str, Any]
ALL_KEPT = 50_000  # atoms of a case; of more only some are written to disk
SAMPLE, WORST = 5000, 50  # evenly spaced ones, and the worst of each field
# LAMMPS' error on a style or keyword that it does not have, and that word
LACKS = re.compile(
    r"(?:Unrecognized|Unknown(?! command)|Illegal|Invalid(?= keyword))\b.*?\b(?:style|keyword|command|option[^,]*)\b"
    r"[:,]? '?(?!keyword|missing)([a-zA-Z][\w/]*)"
)
BY_IMAGES = "; two roundings of place and edge of a particle outside the box; fractions of tilted edges"


def blank_record(case: Case, eos: EOSTable | None, atoms: Atoms, engine: EngineRecord) -> CaseRecord:
    """Return the record of a case before it has run."""
    scene = case.scene
    laws = [LawRecord.of(t, law, scene.types[t - 1].mass) for t, law in enumerate(eos.laws if eos else (), 1)]
    return CaseRecord(
        case=case.name,
        tags=list(case.tags),
        about=case.about,
        verdict="skipped",
        ended="skipped",
        natoms=len(atoms),
        steps=scene.evolve.steps if scene.evolve else 0,
        dimension=scene.dimension,
        units=scene.units,
        twin=scene.twin.kind if scene.twin else "",
        expects=scene.expect.refused if scene.expect else "",
        laws=laws,
        seed=seed(case.name),
        source=case.source.name if case.shipped else str(case.source),
        reproduce=case.reproduce(engine.name),
    )


def finish(record: CaseRecord, lammps: float, begin: float, predictor: Predictor) -> None:
    """Complete a record: its message, its times, and how many predictions were computed or read."""
    record.message = wording.message(record)
    reference = time.perf_counter() - begin
    record.seconds = Seconds(lammps=lammps, reference=reference, total=lammps + reference)
    record.predictions = Predictions(computed=predictor.computed, stored=predictor.stored)


def judge_failure(record: CaseRecord, failure: Failure, scene: Scene | None = None) -> None:
    """Judge a run that LAMMPS refused or did not finish, by what the case expects and by the findings."""
    record.verdict, record.engine_error = failure.verdict, wording.one_line(failure.message)
    record.ended, record.died = failure.verdict, failure.died
    lacks = LACKS.search(wording.error_text(failure.message)) if failure.verdict == "refused" else None
    if failure.verdict == "refused" and record.expects and record.expects not in record.engine_error:
        record.verdict = "differs"
    if failure.verdict != "skipped" and (record.verdict != "refused" or not record.expects):
        explain_ending(record, scene)
    if record.verdict == "refused" and not record.expects and lacks:
        record.verdict, record.ended, record.lacks = "skipped", "skipped", lacks[1]


def other_atoms(atoms: Atoms, answer: Answer) -> IntArray | None:
    """Return the ids of the first state of an answer that are not those given, sorted; None if all are."""
    states = [
        *answer.snapshots,
        *(side for each in answer.carried for side in (each.before, each.after)),
        answer.arrays,
    ]
    ids = (state["id"] for state in states if "id" in state)
    return next((got for got in ids if not np.array_equal(got, atoms.id_n)), None)


def judge_lost_atoms(record: CaseRecord, atoms: Atoms, got: IntArray) -> None:
    """Judge an answer in which atoms are missing, doubled or renamed: no other comparison has a meaning."""
    wrong = np.setxor1d(got, atoms.id_n)
    first = wrong[0] if wrong.size else got[np.flatnonzero(np.diff(got) <= 0)[0]]
    record.verdict, record.ended = "differs", "unusable"
    record.unusable = LostAtoms(returned=len(got), given=len(atoms), first_id=int(first))


def explain_ending(record: CaseRecord, scene: Scene | None = None) -> None:
    """Attribute how a case ended to the finding that predicts it, if there is one."""
    entry = explain_outcome(record, scene)
    if entry is not None:
        record.verdict, record.explained_by = "explained", [entry.id]


def leave_unchecked(record: CaseRecord, reasons: Mapping[str, str]) -> None:
    """Note in a record which fields were not checked, and why: as data and in words."""
    record.unchecked = dict(reasons)
    record.not_checked = [f"{name}: {reason}" for name, reason in reasons.items()]


def compare_inputs(case: Case, atoms: Atoms, got: Arrays, unchanged: bool) -> list[Comparison]:
    """Compare the input with what LAMMPS holds (stage `input`, bound 0), for arrays that have not changed since."""
    zero_n = np.zeros(len(atoms))
    given: Arrays = {"type": atoms.type_n}
    if unchanged and atoms.rho_n is not None and not case.scene.rho_sum:
        given["rho"] = atoms.rho_n
    if unchanged and atoms.energy_n is not None and "esph" in got:
        given["esph"] = atoms.energy_n
    return [
        compare_field(
            field_names.given(name) if case.scene.whole_model else name,
            "input",
            got["id"],
            got[name],
            values_n,
            zero_n,
            derivation="the same doubles",
        )
        for name, values_n in given.items()
    ]


def compare_carried(
    case: Case, atoms: Atoms, answer: Answer, digits: int, problem: Problem
) -> list[tuple[int, Comparison]]:
    """Compare the state after every stop with that before it (stage `input`): bit for bit, or to a text's digits.

    Positions are those of any image: LAMMPS may move a particle into the box at a stop. Returned with the steps.
    """
    comparisons = []
    scene = case.scene
    stops = scene.evolve.stops if scene.evolve else ()
    for stop, carried in zip(stops, answer.carried, strict=True):
        text = stop.by in AS_TEXT
        half = 0.5 * 10.0 ** (1 - digits) + EPS / 2 if text else 0.0  # and what reading the text rounds
        derivation = f"half a unit of the {digits}th digit of the text" if text else "the same doubles"
        for name, before_n in carried.before.items():
            if name == "id" or (name == "x" and (stop.displace or stop.stretch)):
                continue
            after_n, why = carried.after[name], derivation
            bound_n = half * np.abs(before_n)
            if name == "rheo_status" and stop.by in FOR_EACH_ATOM:  # set gives the phase alone
                before_n, after_n = before_n & 1, after_n & 1
            if name == "x":
                around = problem.box_before(stop.at)
                box = atoms.within(around).box()
                box = replace(box, tilt=box.tilt or (0.0,) * 3) if around.tilt else box
                places = box, before_n, after_n, half, kernel_cut(scene, atoms.spacing)
                after_n, bound_n = _images(*places)
                if scene.dimension == 2:  # a file has 0 where a box that is stretched has rounded it
                    before_n, after_n, bound_n = before_n[:, :2], after_n[:, :2], bound_n[:, :2]
                why += BY_IMAGES if bound_n.any() and not text else ""
            comparisons.append(
                (
                    stop.at,
                    compare_field(
                        field_names.carried(name, stop.by, stop.at),
                        "input",
                        atoms.id_n,
                        after_n,
                        before_n,
                        bound_n,
                        derivation=why,
                    ),
                )
            )
    return comparisons


def _images(box: Box, before_nc: Any, after_nc: Any, half: float, reach: float) -> tuple[Any, Any]:
    """Return positions as those of the images that were there before, and the bound of each, both (n, 3).

    A period that is added and taken away again rounds twice; tilted edges see `Box.rounding`.
    """
    turned_nc = box.shift(box.periods(before_nc - after_nc))
    left_nc = box.images(before_nc) != 0
    size_nc = np.abs(before_nc) + np.where(left_nc, np.abs(box.cell_cc).sum(axis=0), 0.0)
    bound_nc = (half + EPS * left_nc) * size_nc + box.rounding(reach)
    return np.where(turned_nc != 0, after_nc + turned_nc, after_nc), bound_nc


def first_input_outside(comparisons: Sequence[tuple[int, Comparison]], id_n: Any) -> Blame | None:
    """Return the first of some comparisons, each with its step, that leaves its bound."""
    outside = (blame_of(comparison, id_n, step) for step, comparison in comparisons if comparison.record.outside)
    return next(outside, None)


def field_arrays(
    atoms: Atoms, got: Arrays, comparisons: list[Comparison], table: Mapping[str, Sequence[Comparison]] | None = None
) -> Arrays:
    """Return the arrays of ``fields/CASE.npz``: the atoms, their box, and both sides and the bound of fields.

    And those of fields that differ at the other steps of a ``table``, by names such as ``@10 lammps f``
    (`lammps_cases.report.drawn.split`).
    """
    arrays: Arrays = {name: got[name] for name in ("id", "type", "x", "v", "rho")}
    arrays["mass"] = atoms.mass_n
    arrays["box"] = np.stack([atoms.low_c, atoms.high_c, *[atoms.tilt] * any(atoms.tilt)])
    arrays["periodic"] = np.array(atoms.periodic)
    for comparison in comparisons:
        name = comparison.record.field
        arrays[f"{name}.lammps"] = comparison.lammps_n
        arrays[f"{name}.reference"] = comparison.reference_n
        arrays[f"{name}.bound"] = comparison.bound_n
    for record in (comparison.record for comparison in comparisons):
        if not (table and record.steps and record.max_abs):
            continue
        for at, other in zip(record.steps, table[record.field], strict=True):
            if at.step != record.worst_step:
                sides = {"lammps": other.lammps_n, "reference": other.reference_n, "bound": other.bound_n}
                arrays |= {f"@{at.step} {side} {record.field}": values for side, values in sides.items()}
    return arrays


def sampled(arrays: Arrays) -> Arrays:
    """Return the arrays of some atoms of a case that has very many: evenly spaced ones, and the worst of every field.

    They are told by their ids; verdicts are of all atoms.
    """
    n = len(arrays.get("id", ()))
    if n <= ALL_KEPT:
        return arrays
    picked = [np.linspace(0, n - 1, SAMPLE).astype(int)]
    for name in (name.removesuffix(".lammps") for name in arrays if name.endswith(".lammps")):
        sides = (arrays[f"{name}.{side}"] for side in ("lammps", "reference", "bound"))
        ratio_n = components(excess(*sides)[1]).max(axis=1)
        picked.append(np.argpartition(ratio_n, -WORST)[-WORST:])
    at = np.unique(np.concatenate(picked))
    whole = ("box", "periodic")
    return {name: a if name in whole or name.startswith("@pairs ") else a[at] for name, a in arrays.items()}
