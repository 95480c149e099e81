"""The list of claims: complete, traceable both ways, and covered by cases that can refute them."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import Any, get_args

import numpy as np
import numpy.typing as npt
import pytest

from eos_ref import InputError
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from lammps_cases.claims import model
from lammps_cases.claims.model import KINDS, Claim, Page, claims
from lammps_cases.claims.verdicts import Names, trace
from lammps_cases.comparison.trajectory import predict
from lammps_cases.findings import LEDGER
from lammps_cases.run import prepared_case
from lammps_cases.scene.casefile import Case
from lammps_cases.verdict.problems import problem_of
from tests.support.claim_records import CASES, KNOWN, PROBES, WITHOUT_NUMBERS, fields_of

NAMES = Names(KNOWN)
BY_ID = {claim.id: claim for claim in claims()}
MADE: dict[str, Any] = {
    "id": "x",
    "page": "fix rheo",
    "section": "s",
    "kind": "syntax",
    "text": "T.",
    "consequence": "Nothing would.",
}


def test_list() -> None:
    assert len(claims()) >= 170
    assert {claim.page for claim in claims()} == set(get_args(Page))
    assert {claim.kind for claim in claims()} == set(KINDS)
    texts = Counter((claim.page, claim.text) for claim in claims())
    assert max(texts.values()) == 1, texts.most_common(1)
    for claim in claims():
        assert claim.text.endswith(".") and claim.id.startswith(("rheo-", "pressure-")), claim.id


def test_findings_exist() -> None:
    known = {entry.id for entry in LEDGER}
    named = {entry for claim in claims() for entry in claim.refuted_by}
    assert named <= known, named - known


def test_findings_can_occur_in_their_cases() -> None:
    """Every finding that would refute a claim names a case of that claim, or applies to its scenes."""
    by_id = {entry.id: entry for entry in LEDGER}
    for claim in claims():
        for entry in (by_id[id] for id in claim.refuted_by):
            covered = [name for name in NAMES.of(claim) if entry.covers(name)]
            assert covered or entry.model_variant is not None, (claim.id, entry.id)
            assert not set(covered) & set(PROBES) or entry.outcome, (claim.id, entry.id)


def test_traceable_both_ways() -> None:
    leads = trace(claims(), KNOWN)
    assert leads.dangling == {}
    assert leads.stale == []
    assert [name for name, why in leads.unclaimed.items() if not why] == []
    assert leads.complete


def test_trace_names_dangling_references() -> None:
    lost = Claim(**MADE, cases=("near-rho0.gone", "nowhere.*"))
    leads = trace([lost], ["near-rho0.linear.2d", "brand-new.case"])
    assert leads.dangling == {"x": ["near-rho0.gone", "nowhere.*"]}
    assert leads.unclaimed == {"brand-new.case": "", "near-rho0.linear.2d": ""}
    assert not leads.complete


@pytest.mark.parametrize("id", [claim.id for claim in claims() if claim.fields])
def test_cases_compare_the_fields_of_their_claim(id: str) -> None:
    """A case that does not compare the fields of the claim could never refute it."""
    claim = BY_ID[id]
    for name in NAMES.of(claim):
        if name in PROBES or name in WITHOUT_NUMBERS or CASES[name].scene.expect:
            continue
        assert set(claim.fields) & set(fields_of(CASES[name])), (id, name)


@pytest.mark.parametrize("id", [c.id for c in claims() if c.page == "fix rheo/pressure" and c.kind == "formula"])
def test_formulas_are_distinguished(id: str) -> None:
    """At least one scene of a formula has no symbol equal to 1."""
    scenes = [CASES[name].scene for name in NAMES.of(BY_ID[id]) if name in CASES]
    assert not scenes or any(1.0 not in (*(s.rho0 or (1.0,)), *(s.cs or (1.0,))) for s in scenes)


def test_every_claim_states_the_consequence_that_is_checked() -> None:
    """In a sentence; few claims share one, and only claims of the same kind."""
    shared: dict[str, set[str]] = {}
    for claim in claims():
        assert claim.consequence[0].isupper() and claim.consequence.endswith("."), claim.id
        assert claim.consequence != claim.text, claim.id
        shared.setdefault(claim.consequence, set()).add(claim.kind)
    assert all(len(kinds) == 1 for kinds in shared.values())
    assert len(shared) > 0.7 * len(claims())
    with pytest.raises(ValueError, match="needs a consequence"):
        Claim(**MADE | {"consequence": ""}, cases=("near-rho0.linear.2d",))


@pytest.mark.parametrize(
    "more",
    [
        {},
        {"cases": ("near-rho0.linear.2d",), "untestable": "so"},
        {"argument": "so"},
        {"kind": "page", "untestable": "so"},
        {"cases": ("near-rho0.linear.2d",), "falls": True},
    ],
)
def test_claim_is_judged_in_one_way(more: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"needs one of|goes with the kind page"):
        Claim(**MADE | more)


def test_zmin_of_the_scenes_occurs_as_a_number_of_neighbours() -> None:
    """They contain particles with zmin - 1, zmin and zmin + 1 neighbours, so *fewer than* and *at most* differ."""
    for kernel in ("rk1", "rk2"):
        case = CASES[f"zmin.some.{kernel}"]
        zmin = case.scene.rheo.zmin
        counts = set(coordination(case).tolist())
        assert {zmin - 1, zmin, zmin + 1} <= counts, (kernel, zmin, sorted(counts))


def coordination(case: Case) -> npt.NDArray[Any]:
    """The numbers of neighbours at the start, by the reference."""
    problem = problem_of(case.scene, prepared_case.prepare(case).atoms, case.where, (0,))
    return np.asarray(
        predict(replace(problem, fields=("coordination",)), ArrayEvaluator, Simulation).fields[0]["coordination"]
    )


def test_unknown_key_is_refused() -> None:
    whole = MADE | {"untestable": "so"}
    assert model._checked([whole], tuple[Claim, ...], "rheo.yaml")[0].id == "x"
    with pytest.raises(InputError, match="refuted: Extra inputs are not permitted"):
        model._checked([whole | {"refuted": []}], tuple[Claim, ...], "rheo.yaml")


def test_selection() -> None:
    assert [c.id for c in model.select(["pressure-linear"])] == ["pressure-linear"]
    assert all(c.kind == "unit" for c in model.select(["unit"]))
    assert {c.page for c in model.select(["fix rheo/pressure"])} == {"fix rheo/pressure"}
    assert "rheo-fix-modify" in [c.id for c in model.select(["probes.rheo-fix-modify.temp"])]
    assert len(model.select([])) == len(claims())
    with pytest.raises(InputError, match="did you mean 'pressure-linear"):
        model.select(["pressure-liner"])
