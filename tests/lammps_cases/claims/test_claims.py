"""The list of claims: whole, traceable both ways, and carried by cases that can show them."""

from __future__ import annotations

from collections import Counter
from typing import get_args

import pytest

from eos_ref import InputError
from lammps_cases.claims import model
from lammps_cases.claims.model import KINDS, Claim, Page, claims
from lammps_cases.claims.trace import trace
from lammps_cases.claims.verdicts import Names
from lammps_cases.findings import LEDGER
from tests.support.claim_records import CASES, KNOWN, PROBES, WITHOUT_NUMBERS, fields_of

NAMES = Names(KNOWN)
BY_ID = {claim.id: claim for claim in claims()}


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


def test_findings_can_be_met() -> None:
    """Every finding that would refute a claim speaks of a case of that claim, or applies to its scenes."""
    by_id = {entry.id: entry for entry in LEDGER}
    for claim in claims():
        for entry in (by_id[id] for id in claim.refuted_by):
            covered = [name for name in NAMES.of(claim) if entry.covers(name)]
            assert covered or entry.model_variant is not None, (claim.id, entry.id)


def test_traceable_both_ways() -> None:
    leads = trace(claims(), KNOWN)
    assert leads.dangling == {}
    assert leads.stale == []
    assert [name for name, why in leads.unclaimed.items() if not why] == []
    assert leads.complete


def test_trace_names_what_leads_nowhere() -> None:
    lost = Claim(id="x", page="fix rheo", section="s", kind="syntax", text="T.", cases=("near-rho0.gone", "nowhere.*"))
    leads = trace([lost], ["near-rho0.linear.2d", "brand-new.case"])
    assert leads.dangling == {"x": ["near-rho0.gone", "nowhere.*"]}
    assert leads.unclaimed == {"brand-new.case": "", "near-rho0.linear.2d": ""}
    assert not leads.complete


@pytest.mark.parametrize("id", [claim.id for claim in claims() if claim.fields])
def test_cases_compare_the_fields_of_their_claim(id: str) -> None:
    """A case that does not compare what carries the claim could never refute it."""
    claim = BY_ID[id]
    for name in NAMES.of(claim):
        if name in PROBES or name in WITHOUT_NUMBERS or CASES[name].scene.expect:
            continue
        assert set(claim.fields) & set(fields_of(CASES[name])), (id, name)


@pytest.mark.parametrize("id", [c.id for c in claims() if c.page == "fix rheo/pressure" and c.kind == "formula"])
def test_formulas_are_told_apart(id: str) -> None:
    """Of the scenes behind a formula, one at least is one in which none of its symbols is 1."""
    scenes = [CASES[name].scene for name in NAMES.of(BY_ID[id]) if name in CASES]
    assert not scenes or any(1.0 not in (*(s.rho0 or (1.0,)), *(s.cs or (1.0,))) for s in scenes)


def test_claim_needs_cases_or_a_reason() -> None:
    with pytest.raises(ValueError, match="either cases or untestable"):
        Claim(id="x", page="fix rheo", section="s", kind="syntax", text="T.")


def test_unknown_key_is_refused() -> None:
    whole = {"id": "x", "page": "fix rheo", "section": "s", "kind": "syntax", "text": "T.", "untestable": "so"}
    assert model._checked([whole], tuple[Claim, ...], "rheo.yaml")[0].id == "x"
    with pytest.raises(InputError, match="refuted: Extra inputs are not permitted"):
        model._checked([whole | {"refuted": []}], tuple[Claim, ...], "rheo.yaml")


def test_selection() -> None:
    assert [c.id for c in model.select(["pressure-linear"])] == ["pressure-linear"]
    assert all(c.kind == "unit" for c in model.select(["unit"]))
    assert {c.page for c in model.select(["fix rheo/pressure"])} == {"fix rheo/pressure"}
    assert "rheo-fix-modify" in [c.id for c in model.select(["probes.rheo-fix-modify-temp"])]
    assert len(model.select([])) == len(claims())
    with pytest.raises(InputError, match="did you mean 'pressure-linear"):
        model.select(["pressure-liner"])
