"""Known bugs that affect a deck although no field shows them: through units or masses, or in fields not compared."""

from __future__ import annotations

from pathlib import Path

import pytest

from lammps_cases.audit.options import AuditOptions
from lammps_cases.audit.supervise import audit_deck
from lammps_cases.audit.verdict import Findings
from lammps_cases.records.case_parts import CheckRecord, EffectRecord, Verdict
from lammps_cases.report import findings
from lammps_cases.report.statements import known_bugs
from tests.support.audited_decks import case_of

DECK = """units           {units}
dimension       3
atom_style      rheo
comm_modify     vel yes
{before}lattice         sc {lattice}
region          box block 0 5 0 5 0 5
create_box      1 box
create_atoms    1 box
displace_atoms  all random 0.2 0.2 0.2 135414 units box
set             group all rheo/rho 0.3
mass            1 18
{masses}velocity        all set 0.001 0.0 0.0
timestep        1e-6
pair_style      rheo 10.0
pair_coeff      * *
fix             1 all rheo 10.0 quintic 0 density 0.28 speed/sound 0.01 {sums}
fix             2 all rheo/viscosity * constant 0.01
fix             3 all rheo/pressure * linear
run             2
"""
MASSES = "set atom * mass 18\nset atom 7 mass 36\n"


def deck(folder: Path, units: str = "lj", sums: str = "", masses: str = "", before: str = "") -> Path:
    file = folder / "in.deck"
    lattice = 4.0**-3 if units == "lj" else 4.0  # a density there
    file.write_text(DECK.format(units=units, lattice=lattice, sums=sums, masses=masses, before=before))
    return file


@pytest.mark.lammps
@pytest.mark.parametrize(
    ("units", "sums", "bugs"),
    [
        ("lj", "", set()),
        ("real", "", {"units-unconverted", "density-by-force-factor"}),
        ("metal", "rho/sum", {"units-unconverted"}),
    ],
)
def test_units_not_converted_by_lammps(units: str, sums: str, bugs: set[str], tmp_path: Path) -> None:
    result = audit_deck(deck(tmp_path, units, sums), AuditOptions())
    case = case_of(result)
    assert {*case.explained_by} - {"force-per-volume"} == bugs == known_bugs(case).keys() - {"force-per-volume"}
    assert case.verdict == "explained" and findings.outcome(result.record).headline.state == "KNOWN BUGS"
    strict = result.record.model_copy(update={"fail_on": "high"})
    assert (findings.outcome(result.record).exit_code, findings.outcome(strict).exit_code) == (0, 1)
    if bugs:  # forces are not compared
        assert case.unchecked["f"].startswith("in units") and "force-per-volume" in case.explained_by


@pytest.mark.lammps
@pytest.mark.parametrize("unequal", [True, False])
def test_effects_of_unequal_masses_are_explained_by_neighbour_lists(unequal: bool, tmp_path: Path) -> None:
    masses = MASSES if unequal else MASSES.replace("36", "18")
    before = "fix m all property/atom rmass ghost yes\n"
    case = case_of(audit_deck(deck(tmp_path, masses=masses, before=before), AuditOptions()))
    forces = next(field for field in case.fields if field.field == "f")
    assert ("mass-of-first" in case.explained_by) == unequal == ("mass-of-first" in forces.explained_by)
    assert ("mass-of-first" in known_bugs(case)) == unequal and case.verdict == "explained"
    assert all(field.verdict != "differs" for field in case.fields)


@pytest.mark.lammps
def test_images_without_masses_give_a_warning(tmp_path: Path) -> None:
    bare = case_of(audit_deck(deck(tmp_path, masses=MASSES, before="fix m all property/atom rmass\n"), AuditOptions()))
    assert any("without 'ghost yes'" in line for line in bare.warnings)
    ghosts = "fix m all property/atom rmass ghost yes\n"
    assert not any(
        "ghost" in line for line in case_of(audit_deck(deck(tmp_path, before=ghosts), AuditOptions())).warnings
    )


@pytest.mark.parametrize(
    ("verdict", "step", "said"), [("pass", 4, False), ("exact", 4, False), ("differs", 4, True), ("pass", 2, True)]
)
def test_field_inside_its_bound_contradicts_an_effect(verdict: Verdict, step: int, said: bool) -> None:
    """Such as an effect on a force that another fix sets, if the same sample has the field."""
    effect = EffectRecord(
        finding="force-per-volume", field="f", run=1, step=4, particles=1, of=2, relative=0.1, factor=None
    )
    check = CheckRecord(
        step=step, run=1, field="f", type=0, natoms=2, verdict=verdict, max_abs=0.0, max_over_bound=0.0, worst_id=1
    )
    assert bool(Findings(effects=[effect], checks=[check]).case("in.deck").effects) == said
