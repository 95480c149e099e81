"""Different bits count as a change, except where LAMMPS' values are nondeterministic on both sides."""

from __future__ import annotations

import pytest

from lammps_cases.findings import LEDGER
from lammps_cases.versions.change import Policy, SideChange, left_to_chance

CHANCE = min(left_to_chance())
OTHER = min(entry.id for entry in LEDGER if entry.id not in left_to_chance())


@pytest.mark.parametrize(
    ("kind", "findings", "counts"),
    [
        ("within bounds", ((), ()), True),
        ("within bounds", ((OTHER,), (OTHER,)), True),
        ("within bounds", ((CHANCE,), ()), True),
        ("within bounds", ((OTHER, CHANCE), (CHANCE,)), False),
        ("changed", ((CHANCE,), (CHANCE,)), True),
        ("judged otherwise", ((CHANCE,), (CHANCE,)), True),
        ("same bits", ((), ()), False),
    ],
)
def test_other_bits_of_uninitialised_memory_do_not_count(
    kind: str, findings: tuple[tuple[str, ...], tuple[str, ...]], counts: bool
) -> None:
    change = SideChange("a.case", "grad/v", kind, findings=findings)
    assert Policy(bits=True).faults(change) == counts
    assert Policy(bits=False).faults(change) == (counts and kind != "within bounds")
