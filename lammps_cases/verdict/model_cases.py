"""Judgement of cases of the whole model: a scene as the reference's problem, LAMMPS' fields by its names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from eos_ref.model.parameters import Model
from lammps_cases.comparison.compare import Comparison
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.problem import Problem, ProblemStop
from lammps_cases.engine.session import Answer
from lammps_cases.findings import Finding, applicable, with_gap
from lammps_cases.findings.neighbour_lists import NeighbourList
from lammps_cases.findings.variants import Snapshot
from lammps_cases.records.run_record import Beyond, Blame, CaseRecord, worst
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import Atoms
from lammps_cases.scene.casefile import Case
from lammps_cases.scene.fields import FIELDS
from lammps_cases.scene.stops import AS_TEXT, FROM_FILE, upper_corners
from lammps_cases.setup import reference_side
from lammps_cases.verdict import particle_model
from lammps_cases.verdict.outcome import (
    Arrays,
    compare_carried,
    compare_inputs,
    field_arrays,
    first_input_outside,
    leave_unchecked,
)
from lammps_cases.verdict.particle_model import Reason

TEXT_DIGITS = 16  # significant digits of a number in a file of write_data


def problem_of(
    scene: Scene, atoms: Atoms, where: str, steps: tuple[int, ...], predictor: Predictor | None = None
) -> Problem:
    """Return a scene as the reference takes it, to be compared at some steps; with a predictor it is made once."""
    if predictor is not None:
        return predictor.problem((scene, atoms), steps, lambda: problem_of(scene, atoms, where, steps))
    return Problem(
        reference_side.model(scene, atoms, where),
        reference_side.box(scene, atoms),
        reference_side.state(scene, atoms, where),
        scene.evolve.timestep if scene.evolve else 0.0,
        scene.compare,
        steps,
        _stops(scene, atoms),
        scene.engine.ranks,
        scene.engine.newton_flags,
    )


def _stops(scene: Scene, atoms: Atoms) -> tuple[ProblemStop, ...]:
    """Return where a scene's runs end and others begin, as the reference takes them."""
    evolve = scene.evolve
    corners = upper_corners(evolve.stops if evolve else (), atoms.low_c.tolist(), atoms.high_c.tolist())
    return tuple(
        ProblemStop(
            stop.at,
            np.arange(len(atoms)) >= len(atoms) - stop.renews(len(atoms)),
            stop.timestep,
            reference_side.displacement(stop, scene, atoms),
            stop.by in FROM_FILE,
            TEXT_DIGITS if stop.by in AS_TEXT else None,
            replace(atoms, high_c=np.array(corners[stop.at])).box(scene.dimension) if stop.stretch else None,
            stop.by == "minimize",
            stop.by == "continued",
        )
        for stop in (evolve.beginnings if evolve else ())
    )


def snapshot(scene: Scene, arrays: Arrays) -> Snapshot:
    """Return LAMMPS' fields of one step by name, vectors with as many components as dimensions."""
    return {name: FIELDS[name].of(arrays, scene.dimension) for name in scene.compare}


def read_snapshots(scene: Scene, answer: Answer, steps: Sequence[int] = ()) -> list[Snapshot]:
    """Return LAMMPS' fields at all steps read, or at some of those compared; the first holds its neighbour lists."""
    at = [scene.snapshots.index(step) for step in steps] or range(len(answer.snapshots))
    snapshots = [snapshot(scene, answer.snapshots[k]) for k in at]
    if answer.lists:
        snapshots[0]["lists"] = tuple(NeighbourList.read(answer.arrays["id"], **arrays) for arrays in answer.lists)
    return snapshots


def asks_for_lists(case: Case, scene: Scene, atoms: Atoms) -> bool:
    """Return whether a scene shows findings whose variants need LAMMPS' neighbour lists."""
    variants = (
        entry.model_variant for entry in applicable(problem_of(scene, atoms, case.where, scene.snapshots), True)
    )
    return any(variant is not None and variant.lists for variant in variants)


def judge_model(
    record: CaseRecord, case: Case, atoms: Atoms, answer: Answer, engine: str, predictor: Predictor
) -> Arrays:
    """Judge the fields of the whole model, and the input that LAMMPS has not changed since."""
    scene = case.scene
    problem = problem_of(scene, atoms, case.where, scene.snapshots, predictor)
    inputs = _inputs(case, atoms, answer, predictor)
    judged = particle_model.judge(
        problem,
        case.name,
        atoms.id_n,
        read_snapshots(scene, answer),
        engine,
        predictor,
    )
    comparisons = [*(comparison for _, comparison in inputs), *judged.comparisons]
    record.fields = [comparison.record for comparison in comparisons]
    record.verdict = worst([field.verdict for field in record.fields])
    first = judged.beyond.blame if judged.beyond else judged.first
    gaps = [entry for entry in with_gap(scene, engine) if first is None or _reaches(entry, problem.model, first)]
    known_limits = [entry.id for entry in gaps if not left_to_chance(entry)]
    record.unseen = [entry.id for entry in judged.unseen if entry.id not in known_limits]  # else nothing tells
    record.limits = known_limits if record.verdict == "differs" else []
    record.lint = judged.lint
    leave_unchecked(record, judged.unpredictable)
    record.ended = "answered"
    reason = Reason(judged.first, judged.beyond, judged.entries) if judged.first else None
    if reason := with_news(reason, first_input_outside(inputs, atoms.id_n)):
        record.blame, record.beyond = reason.first, reason.beyond
    in_box = atoms.within(problem.box_at(scene.snapshots[-1]))
    return field_arrays(in_box, answer.arrays, comparisons, judged.table)


def _reaches(entry: Finding, model: Model, first: Blame) -> bool:
    """Return whether a finding reaches what LAMMPS differs in first; after a step all depends on all."""
    return bool(first.step) or entry.model_variant is None or entry.model_variant.reaches(model, first.field)


def left_to_chance(entry: Finding) -> bool:
    """Return whether a variant leaves the values that it cannot tell without a bound: the others it does tell."""
    return entry.model_variant is not None and entry.model_variant.undefined


def first_step(case: Case, atoms: Atoms, answer: Answer, engine: str, predictor: Predictor) -> Reason | None:
    """Find the first difference of a case, in an answer read at every step."""
    scene = case.scene
    snapshots = read_snapshots(scene, answer)
    every = problem_of(scene, atoms, case.where, tuple(range(len(snapshots))))
    reason = particle_model.reason(every, case.name, atoms.id_n, snapshots, engine, predictor)
    return with_news(reason, first_input_outside(_inputs(case, atoms, answer, predictor), atoms.id_n))


def _inputs(case: Case, atoms: Atoms, answer: Answer, predictor: Predictor) -> list[tuple[int, Comparison]]:
    """Compare what LAMMPS holds at the beginning and carries over at stops, each with its step."""
    scene = case.scene
    through_text = any(stop.step == 0 and stop.digits for stop in _stops(scene, atoms))
    unchanged = scene.snapshots[0] == 0 and not scene.rheo.interface_reconstruct and not through_text
    held = compare_inputs(case, atoms, answer.snapshots[0], unchanged)
    problem = problem_of(scene, atoms, case.where, scene.snapshots, predictor)
    return [*((0, comparison) for comparison in held), *compare_carried(case, atoms, answer, TEXT_DIGITS, problem)]


def with_news(reason: Reason | None, news: Blame | None) -> Reason | None:
    """Return why a case differs with the first of its inputs outside, which no finding explains, in its place."""
    if reason is None or news is None:
        return reason if news is None else Reason(news)
    step, left = news.step or 0, reason.beyond
    if step <= (reason.first.step or 0):  # the input comes before what is made of it
        return Reason(news)
    if (left is None and not reason.explained) or (left and step > (left.blame.step or 0)):
        return reason
    beside = left.findings if left else [entry.id for entry in reason.explained]
    return Reason(reason.first, Beyond(findings=beside, blame=news))
