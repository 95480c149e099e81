"""Pictures of every page: numbers of logarithmic axes."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from lammps_cases.report.pages import figures


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.002, "0.002"), (20000.0, "20000"), (1e5, "$10^{5}$"), (2e6, r"$2\cdot10^{6}$"), (1e-10, "$10^{-10}$")],
)
def test_numbers_of_many_digits_are_powers_of_ten(value: float, text: str) -> None:
    assert figures._plain(value) == text


def test_inline_svg_follows_dark_mode(tmp_path: Path) -> None:
    figure = Figure()
    axes = figure.subplots()
    axes.plot([1, 2], color="#2b3137")
    axes.plot([2, 1], color="#c0392b")
    page = figures.saved(figure, tmp_path, "lines")
    assert not {"#2b3137", "#000000", "#ffffff"} & set(re.findall(r"#[0-9a-f]{6}\b", page))
    assert "#c0392b" in page and "var(--ink)" in page and "var(--paper)" in page
    assert "var(" not in (tmp_path / "lines.svg").read_text(encoding="utf-8")
