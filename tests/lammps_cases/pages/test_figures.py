"""Pictures of every page: numbers of logarithmic axes."""

from __future__ import annotations

import pytest

from lammps_cases.pages import figures


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.002, "0.002"), (20000.0, "20000"), (1e5, "$10^{5}$"), (2e6, r"$2\cdot10^{6}$"), (1e-10, "$10^{-10}$")],
)
def test_numbers_of_many_digits_are_powers_of_ten(value: float, text: str) -> None:
    assert figures._plain(value) == text
