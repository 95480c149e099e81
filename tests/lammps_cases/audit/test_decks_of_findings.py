"""The decks of all findings (``eos-ref report-bug``), audited: every one shows its finding and nothing new."""

from __future__ import annotations

from pathlib import Path

import pytest

from eos_ref import InputError
from eos_ref.syntax.manual import manual_of
from lammps_cases.audit.deck import Deck
from lammps_cases.audit.effects import Acting
from lammps_cases.audit.options import AuditOptions
from lammps_cases.audit.supervise import audit_deck
from lammps_cases.bugs.deck import DECK
from lammps_cases.claims.probes import manual
from lammps_cases.claims.probes.probe import commands
from lammps_cases.findings import LEDGER
from lammps_cases.findings.entry import OutcomeFinding
from tests.support.audited_decks import case_of
from tests.support.bug_decks import ENGINES, engine_of, finding_of, report_of, said_in, version_of

IDS = [entry.id for entry in LEDGER]

# Their decks differ from the page in one word only: no field, no run and no output is affected.
OF_THE_PAGE = {
    "cubic-unit": "LAMMPS computes the formula; the unit that the page gives for its prefactor does not fit it",
    "support-unit": "LAMMPS compares the sum of the formula; the page says that the threshold has no unit",
    "rmin-unit": "the same, of the newest manual",
    "sum-includes-self": "LAMMPS sums over the particle itself, as the method does; the formula of the page does not",
    "wall-density-shared": "the density of a solid is a mean over its fluid neighbours, as published",
    "gas-on-other-atoms": "more atom styles work than the page says",
    "no-mass-diffusion": "densities follow the equation of continuity, as in the papers; the page names another one",
}
# LAMMPS accepts an argument that the manual forbids, and the reference has no value for it: one line names the finding.
FORBIDDEN = {
    "kernel-wendland-c4": "the page has no such kernel, and no formula of it",
    "range-tail-ignored": "a range of three numbers, of which the page has no meaning",
    "scales-unchecked": "laws divide by an equilibrium density of 0, and by a speed of sound",
    "law-arguments-unchecked": "the law divides by the exponent",
    "shiftscale-no-fraction": "a fraction outside of 0 to 1",
}
# LAMMPS stops, with an error or a signal, where the manual promises a run; or with a misleading error, or too late.
ENDS = {entry.id for entry in LEDGER if entry.outcome in ("refused", "crashed") or entry.ended == "refused"}


@pytest.mark.lammps
@pytest.mark.slow
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("name", IDS)
def test_deck_of_a_finding_is_never_new(name: str, engine: str, tmp_path: Path) -> None:
    entry, version = finding_of(name), version_of(engine)
    if not said_in(name, manual_of(version)):
        return  # the manual of this engine documents what LAMMPS does: there is no deck
    made = report_of(name, manual_of(version)).deck
    made.write(tmp_path)
    try:
        case = case_of(audit_deck(tmp_path / DECK, AuditOptions(every=1, engine=engine_of(engine).site)))
    except InputError as error:
        assert entry.listed(version) and name in FORBIDDEN and f"known bug {name}" in str(error), str(error)
        assert "\n" not in str(error)
        return
    assert "differs" not in [case.verdict, *(field.verdict for field in case.fields)], case.message
    if case.ended != "answered":
        assert made.refused or (entry.listed(version) and name in ENDS), case.message
        assert case.verdict == case.ended
    elif entry.listed(version) and name not in OF_THE_PAGE:
        assert case.verdict not in ("exact", "pass") and name in case.explained_by, case.message


def test_tables_name_existing_findings() -> None:
    assert {*OF_THE_PAGE, *FORBIDDEN} <= set(IDS)


# --- arguments that the manual forbids and LAMMPS accepts


def refused(lines: tuple[str, ...]) -> InputError:
    """The complaint of the reference about the commands of a deck."""
    deck, ntypes = Deck(), 2  # as in the data files of such decks
    for words in map(str.split, lines):
        ntypes = int(words[1]) if words[0] == "create_box" else ntypes
        if words[0] in ("fix", "pair_style"):
            deck.note(words)
    with pytest.raises(InputError) as raised:
        laws = deck.laws(ntypes)
        assert laws is not None
        deck.model(2, ntypes, [1.0] * ntypes, laws)
    return raised.value


ACCEPTING = [entry for entry in LEDGER if isinstance(entry, OutcomeFinding) and entry.accepts]


@pytest.mark.parametrize("entry", ACCEPTING, ids=lambda entry: entry.id)
def test_arguments_accepted_by_lammps_are_refused_by_the_reference(entry: OutcomeFinding) -> None:
    probes = [commands(probe.input) for probe in manual.probes() if entry.covers(probe.name)]
    errors = [refused(lines) for lines in probes or [report_of(entry.id).deck.lines]]
    assert {error.what for error in errors} == set(entry.accepts)
    acting = Acting(entry.engines[-1])
    assert all(f"known bug {entry.id}" in str(acting.accepted(error)) for error in errors)
    assert [*acting.found] == [entry.id]


def test_other_arguments_are_not_a_known_bug() -> None:
    acting, error = Acting("2025.7.22.4.0"), InputError("cut", "must be positive", 0.0)
    assert acting.accepted(error) is error and not acting.found
