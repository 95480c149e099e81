"""Explanations of differences between engines name existing maps and layers, each once."""

from __future__ import annotations

from lammps_cases.findings import LEDGER
from lammps_cases.studies.stability.maps import MAPS

PLACES = [where for entry in LEDGER for where in entry.expected_in_maps]


def test_every_explanation_names_an_existing_map_and_layer() -> None:
    assert PLACES
    for where in PLACES:
        assert where.layer is None or where.layer in MAPS[where.map].layers, where
        assert where.map in MAPS
        assert where.why


def test_differences_are_explained_once() -> None:
    places = [(where.map, where.layer) for where in PLACES]
    assert len(places) == len(set(places))
    named = {where.map for where in PLACES}
    assert not [of.id for of in MAPS.values() if of.engines_differ and of.id in named]
