"""Decks with bonds: pairs removed by special_bonds are explained, and only fields that bonds add to are unchecked."""

from __future__ import annotations

from pathlib import Path

import pytest

from lammps_cases.audit.supervise import audit_deck
from lammps_cases.claims.probes.probe import edited
from lammps_cases.records.run_record import CaseRecord
from tests.support.audited_decks import case_of

pytestmark = pytest.mark.lammps

FINDING = "special-bonds-remove-pairs"
OF_PAIRS = {"coordination", "grad/v", "stress/v", "stress/t", "drho", "heatflow", "shift/v", "f"}
WARM = (  # with everything that sums over neighbours, in motion; and a second bond, so that two are two bonds apart
    ("hybrid rheo bond", "hybrid rheo/thermal bond"),
    ("extra/bond/per/atom 1 extra/special/per/atom 2", "extra/bond/per/atom 2 extra/special/per/atom 4"),
    ("bond 1 1 2", "bond 1 1 2\ncreate_bonds single/bond 1 2 3"),
    ("set atom 1 vx 0.3", "set atom 1 vx 0.3\nset atom * sph/e 1.0\nset atom 1 sph/e 1.5"),
    ("visc 1.0", "visc 1.0 rho/damp 0.1"),
    ("quintic 0", "quintic 0 thermal shift"),
    ("fix 4 all", "fix 5 all rheo/thermal conductivity * constant 0.2 specific/heat * constant 0.9\nfix 4 all"),
    ("run 0", "timestep 0.01\nrun 20"),
)
HARMONIC = (("bond_style zero nocoeff", "bond_style harmonic"), ("bond_coeff *", "bond_coeff * 1.0 1.0"))


def audited(folder: Path, weights: str, *edits: tuple[str, str]) -> CaseRecord:
    lines = edited("bonded", (*WARM, ("lj 0 1 1 coul 0 1 1", weights), *edits))
    deck = folder / "in.bonded"
    deck.write_text("".join(f"{line}\n" for line in lines))
    return case_of(audit_deck(deck))


def test_pairs_removed_by_special_bonds_are_explained(tmp_path: Path) -> None:
    case = audited(tmp_path, "lj 0 1 1 coul 0 1 1")
    by = {field.field: field.explained_by for field in case.fields}
    assert by.keys() >= OF_PAIRS and not OF_PAIRS & case.unchecked.keys()
    assert case.verdict == "explained" and {field.verdict for field in case.fields} <= {"exact", "pass", "explained"}
    assert {name for name in OF_PAIRS if FINDING in by[name]} == OF_PAIRS
    assert [of.does for of in case.acting if of.finding == FINDING]


@pytest.mark.parametrize("weights", ["lj 0 1 1 coul 1 1 1", "lj 1 1 1 coul 0 1 1", "lj 0.5 1 1 coul 0.5 1 1"])
def test_positive_weights_change_nothing(weights: str, tmp_path: Path) -> None:
    case = audited(tmp_path, weights)
    assert {field.field for field in case.fields} >= OF_PAIRS and not OF_PAIRS & case.unchecked.keys()
    assert {field.verdict for field in case.fields} <= {"exact", "pass", "explained"}
    assert FINDING not in [*case.explained_by, *(of.finding for of in case.acting)]
    assert {field.verdict for field in case.fields if field.field in ("coordination", "grad/v")} <= {"exact", "pass"}


def test_bonds_leave_only_forces_unchecked(tmp_path: Path) -> None:
    case = audited(tmp_path, "lj 0 1 1 coul 1 1 1", *HARMONIC)
    assert {field.field for field in case.fields} >= OF_PAIRS - {"f"}
    assert {name for name, why in case.unchecked.items() if "bond" in why} == {"f"}
    assert case.unchecked["f"] == "bond_style harmonic adds to it"
    assert {field.verdict for field in case.fields} <= {"exact", "pass", "explained"}
