"""What LAMMPS is given and carries over at stops, compared with what it holds: stage `input`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from eos_ref.eos.bounds import EPS
from eos_ref.model.box import Box
from lammps_cases.comparison.compare import Comparison, compare_field
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.problem import Problem
from lammps_cases.engine.session import Answer
from lammps_cases.records import wording
from lammps_cases.records.case_parts import Beyond, Blame
from lammps_cases.scene.atoms import Atoms, kernel_cut
from lammps_cases.scene.casefile import Case
from lammps_cases.scene.stops import AS_TEXT, FOR_EACH_ATOM
from lammps_cases.verdict.case_arrays import Arrays
from lammps_cases.verdict.model_fields import blame_of
from lammps_cases.verdict.particle_model import Reason
from lammps_cases.verdict.problems import TEXT_DIGITS, problem_of, stops_of

BY_IMAGES = "; two roundings of place and edge of a particle outside the box; fractions of tilted edges"


def compare_model_inputs(
    case: Case, atoms: Atoms, answer: Answer, predictor: Predictor
) -> list[tuple[int, Comparison]]:
    """Compare what LAMMPS holds at the beginning and carries over at stops, each with its step."""
    scene = case.scene
    through_text = any(stop.step == 0 and stop.digits for stop in stops_of(scene, atoms))
    unchanged = scene.snapshots[0] == 0 and not scene.rheo.interface_reconstruct and not through_text
    held = compare_inputs(case, atoms, answer.snapshots[0], unchanged)
    problem = problem_of(scene, atoms, case.where, scene.snapshots, predictor)
    return [*((0, comparison) for comparison in held), *compare_carried(case, atoms, answer, TEXT_DIGITS, problem)]


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
            wording.given(name) if case.scene.whole_model else name,
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
                        wording.after_stop(name, stop.by, stop.at),
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


def prefer_input(reason: Reason | None, news: Blame | None) -> Reason | None:
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
