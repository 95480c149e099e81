"""The smallest set of findings explains a difference, on any LAMMPS; the rest is reported next to known findings.

The reference with findings of the ledger stands in for LAMMPS, so that any of them can be fixed.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.problem import Problem
from lammps_cases.findings import LEDGER, Finding, applicable, shown_by
from lammps_cases.findings.variants import Snapshot, Variant, combined
from lammps_cases.records import case_wording
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.run import prepared_case
from lammps_cases.scene import casefile
from lammps_cases.verdict import particle_model
from lammps_cases.verdict.problems import problem_of

CASES = {case.name: case for case in casefile.load()}
BY_ID = {entry.id: entry for entry in LEDGER}
NEW = "2099.1.1"
# Scenes that show several findings without LAMMPS' neighbour lists, two or three of them at a time.
SCENES = {
    "thermal.latent.2d": ("force-per-volume", "heat-is-temperature-rate"),
    "cross-type.both.2d": ("force-per-volume", "cross-type-support"),
}
PREDICTOR = Predictor()


class DoubledConductivity(ArrayEvaluator):
    """A fault that is not in the ledger."""

    def conduction(self) -> Any:
        return 2.0 * super().conduction()


def problem(name: str) -> tuple[Problem, Any]:
    """Return the reference's problem of a scene, and the ids of its particles."""
    ready = prepared_case.prepare(CASES[name])
    return problem_of(ready.case.scene, ready.atoms, "", ready.case.scene.snapshots), ready.atoms.id_n


def played(of: Problem, findings: Sequence[Finding], *faults: type[ArrayEvaluator]) -> list[Snapshot]:
    """Return the fields of a LAMMPS with some findings, and optional other faults."""
    variants = [entry.model_variant for entry in findings if entry.model_variant]
    made = combined([*variants, *(Variant(lambda _: True, fault) for fault in faults)], of, {})
    assert made is not None
    return [{name: np.asarray(array) for name, array in step.items()} for step in PREDICTOR.values(of, made)]


def judged(
    of: Problem, id_n: Any, name: str, snapshots: Sequence[Snapshot], engine: str
) -> particle_model.ModelVerdict:
    """Judge the fields of a scene as the output of an engine."""
    return particle_model.compare_and_explain(of, name, id_n, snapshots, engine, PREDICTOR)


@pytest.mark.parametrize("engine", ["2025.7.22.4.0", NEW])
@pytest.mark.parametrize("name", SCENES)
def test_every_subset_of_findings_explains_lammps_with_that_subset(name: str, engine: str) -> None:
    """Also subsets with one finding fixed, which an explanation by all together would report as a difference."""
    of, id_n = problem(name)
    findings = [BY_ID[finding] for finding in SCENES[name]]
    assert set(findings) <= set(shown_by(of, "2025.7.22.4.0")) <= set(applicable(of))
    for size in range(len(findings) + 1):
        for some in itertools.combinations(findings, size):
            verdict = judged(of, id_n, name, played(of, some), engine)
            assert {entry.id for entry in verdict.entries} == {entry.id for entry in some}
            assert (verdict.first is None) == (not some) and verdict.beyond is None
            worst = {comparison.record.verdict for comparison in verdict.comparisons}
            assert ("explained" in worst) == bool(some) and "differs" not in worst


def test_all_but_one_of_many_findings_are_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    """They are tried even if there are too many sets to try all; here no other set is tried."""
    of, id_n = problem("constants.metal")
    listed = shown_by(of, "2025.7.22.4.0")
    assert len(listed) > 2
    monkeypatch.setattr(particle_model, "SETS", 0)
    for mended in listed:
        left = [entry for entry in listed if entry is not mended]
        verdict = judged(of, id_n, "constants.metal", played(of, left), "2025.7.22.4.0")
        assert verdict.entries and mended not in verdict.entries
        assert "differs" not in {comparison.record.verdict for comparison in verdict.comparisons}


@pytest.mark.parametrize("engine", ["2025.7.22.0.1", "2025.7.22.4.0", NEW])
def test_finding_of_another_version_is_recognised(engine: str) -> None:
    of, id_n = problem("thermal.latent.2d")
    verdict = judged(of, id_n, "thermal.latent.2d", played(of, [BY_ID["temperature-without-mass"]]), engine)
    assert [entry.id for entry in verdict.entries] == ["temperature-without-mass"]


@pytest.mark.parametrize("engine", ["2025.7.22.4.0", NEW])
def test_new_difference_takes_the_headline_from_a_known_finding(engine: str) -> None:
    of, id_n = problem("thermal.latent.2d")
    known = [BY_ID["force-per-volume"]]
    verdict = judged(of, id_n, "thermal.latent.2d", played(of, known, DoubledConductivity), engine)
    assert not verdict.entries and verdict.first is not None and verdict.beyond is not None
    assert verdict.beyond.blame.field == "heatflow"
    fields = [comparison.record for comparison in verdict.comparisons]
    record = CaseRecord(case="x", verdict="differs", fields=fields, blame=verdict.first, beyond=verdict.beyond)
    assert case_wording.message(record).startswith("heatflow (stage ")
    assert verdict.beyond.findings == [] and "force-per-volume" in verdict.beyond.known, "heat comes before forces"
    assert "in addition to" not in case_wording.message(record)


@pytest.mark.parametrize(
    ("name", "flags"), [("newton.pairs.summed", (True, False)), ("newton.bonds.summed", (False, True))]
)
def test_boundary_pairs_count_twice_with_one_newton_setting(name: str, flags: tuple[bool, bool]) -> None:
    of, _ = problem(name)
    assert of.newton == flags and of.has_images
    assert (BY_ID["boundary-pairs-twice"] in applicable(of, lists=True)) == (flags == (False, True))


def test_number_of_tried_sets_is_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    """Known findings are tried at all steps at once, others step by step; then all; then all but one of the known."""
    of, id_n = problem("constants.metal")
    tried: list[tuple[int, bool]] = []

    def inside(trial: particle_model.Trial, entries: Sequence[Finding], at_once: bool = False) -> bool:
        tried.append((len(entries), at_once))
        return False

    monkeypatch.setattr(particle_model, "SETS", 2)
    monkeypatch.setattr(particle_model.Trial, "_inside", inside)
    listed, every = shown_by(of, "2025.7.22.4.0"), applicable(of)
    snapshots = [{name: 2 * array for name, array in step.items()} for step in played(of, [])]
    verdict = judged(of, id_n, "constants.metal", snapshots, "2025.7.22.4.0")
    assert verdict.first is not None and not verdict.entries
    assert tried == [(len(listed), True), (1, False), (1, False), (len(every), False)] + [
        (len(listed) - 1, False)
    ] * len(listed)


def test_absent_findings_are_not_reported() -> None:
    of, id_n = problem("thermal.latent.2d")
    verdict = judged(of, id_n, "thermal.latent.2d", played(of, [], DoubledConductivity), NEW)
    assert not verdict.entries
    assert verdict.first is not None and verdict.first.field == "heatflow"
