"""docs/examples.md contains the measurements, in the table and in the text."""

from __future__ import annotations

import json

from lammps_cases.audit import budgets
from tests.workshop import examples_table as measured


def test_document_contains_the_measurements() -> None:
    text = measured.PAGE.read_text(encoding="utf-8")
    rows = json.loads(measured.FILE.read_text())
    assert measured.page(text, rows) == text
    assert measured.page(text, rows[1:]) != text
    by_run = {row["run"]: row["away"] for row in rows if row["deck"] == "taylor-green"}
    log = next(away for run, away in by_run.items() if run.startswith("log of"))
    # The statements of the document on the numbers in the table.
    assert budgets.percent(by_run[budgets.LAMMPS]) == budgets.percent(by_run["as it is"]) == budgets.percent(log)
    adds = {row["run"]: row["adds"] for row in rows if row["deck"] == "taylor-green"}
    assert adds["no artificial viscosity"] > by_run["as it is"] > 0 > adds["no density diffusion"]
    plates = {row["run"]: row["away"] for row in rows if row["deck"] == "poiseuille"}
    bare = plates["no artificial viscosity"]
    assert 0 < plates["as it is"] < bare / 2, "most of the error of the walls is hidden"
    assert 0 < plates["half the spacing, no artificial viscosity"] < 0.6 * bare, "of first order"
    assert bare - plates["as it is"] > plates["half the spacing, no artificial viscosity"] - plates["half the spacing"]
