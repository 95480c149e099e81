"""What explains that engines differ: of maps and layers that there are, each once."""

from __future__ import annotations

from lammps_cases.findings import LEDGER
from lammps_cases.studies.stability.maps import MAPS

PLACES = [where for entry in LEDGER for where in entry.expected_in_maps]


def test_every_explanation_is_of_a_map_and_a_layer_that_exist() -> None:
    assert PLACES
    for where in PLACES:
        assert where.layer is None or where.layer in MAPS[where.map].layers, where
        assert where.map in MAPS
        assert where.why


def test_no_difference_is_explained_twice() -> None:
    places = [(where.map, where.layer) for where in PLACES]
    assert len(places) == len(set(places))
    named = {where.map for where in PLACES}
    assert not [of.id for of in MAPS.values() if of.engines_differ and of.id in named]
