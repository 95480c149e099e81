"""What explains that engines differ: of maps and layers that there are, by findings that there are."""

from __future__ import annotations

from lammps_cases.findings import LEDGER
from lammps_cases.studies.stability.known import KNOWN
from lammps_cases.studies.stability.maps import maps


def test_every_explanation_is_of_a_map_a_layer_and_a_finding_that_exist() -> None:
    findings = {entry.id for entry in LEDGER} | {""}
    for known in KNOWN:
        assert known.finding in findings
        assert known.layer is None or known.layer in maps()[known.map].layers, known
        assert known.why


def test_no_explanation_stands_twice() -> None:
    places = [(known.map, known.layer) for known in KNOWN]
    assert len(places) == len(set(places))
