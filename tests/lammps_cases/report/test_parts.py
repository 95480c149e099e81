"""Single parts of reports: escaped text, scales of plots, the table of fields against steps."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from lammps_cases.records.case_parts import FieldRecord, LawRecord, StepRecord, Verdict
from lammps_cases.records.outcome import CaseOutcome
from lammps_cases.records.run_record import CaseRecord, EngineRecord, RunRecord
from lammps_cases.report import findings, markdown, plots
from lammps_cases.report.history import views


@pytest.mark.parametrize(
    ("words", "text", "code"),
    [
        ("plain words", "plain words", "`plain words`"),
        ("a|b *c* _d_", r"a\|b \*c\* \_d\_", r"`a\|b *c* _d_`"),
        ("<b>&amp;</b>", "&lt;b&gt;&amp;amp;&lt;/b&gt;", "`<b>&amp;</b>`"),
        ("[x](y) #1 ~z~ \\ `", r"\[x\](y) \#1 \~z\~ \\ \`", "`[x](y) #1 ~z~ \\ '`"),
        ("two\nlines\x1b[31m\ttab", r"two lines \[31m tab", "`two lines [31m tab`"),
        ("", "", ""),
    ],
)
def test_text_is_escaped(words: str, text: str, code: str) -> None:
    assert (markdown.text(words), markdown.code(words)) == (text, code)


def test_table_and_folded_text() -> None:
    table = markdown.table(("case", "s"), [("a", 1), ("b", 2.5)])
    assert table.splitlines() == ["| case | s |", "| --- | --- |", "| a | 1 |", "| b | 2.5 |"]
    assert markdown.folded("T", "x") == "<details><summary>T</summary>\n\nx\n\n</details>"


@pytest.mark.parametrize(
    ("values", "scale"),
    [
        ([1.0, 2.0, 3.0], {"kind": "linear"}),
        ([0.0, np.nan, np.inf], {"kind": "linear"}),
        ([], {"kind": "linear"}),
        ([1.0, 1e-3, 1.0, 1.0, 1.0], {"kind": "linear"}),  # a thousandth exactly
        ([1e-4, -1e-5, 1.0, 1.0, 1.0], {"kind": "symlog", "decade": -5}),
        ([1e-320, 1e-320, 1.0], {"kind": "symlog", "decade": -307}),
    ],
)
def test_scales(values: list[float], scale: dict[str, Any]) -> None:
    """A fifth of the values three decades below the largest requires a logarithmic scale."""
    assert plots.scale_of(np.array(values)) == scale


def test_relative_offsets_from_rho0_of_every_type() -> None:
    laws = [LawRecord(type=k, style="linear", rho0=rho0, cs=1.0, background=0.0) for k, rho0 in ((1, 2.0), (2, 4.0))]
    case = CaseRecord(case="one", verdict="pass", laws=laws)
    delta_n = plots.offsets(case, np.array([1, 2, 3, 1]), np.array([3.0, 3.0, 3.0, 1.0]))
    assert np.array_equal(delta_n, [0.5, -0.25, np.nan, -0.5], equal_nan=True)


def _stepped(name: str, field: str, *at: tuple[int, Verdict, float], **facts: Any) -> CaseRecord:
    steps = [StepRecord(step=step, verdict=verdict, max_over_bound=ratio, max_abs=0.0) for step, verdict, ratio in at]
    record = FieldRecord(field=field, stage="pair", verdict="pass", max_over_bound=0.0, steps=steps)
    return CaseRecord(case=name, verdict="pass", fields=[record], **facts)


def test_fields_against_steps() -> None:
    cases = [
        _stepped("a", "f", (0, "exact", 0.0), (1, "pass", 0.5)),
        _stepped("b", "f", (0, "exact", 0.0), (1, "pass", 0.25), (5, "differs", 3.0)),
        _stepped("c", "f", (1, "explained", 7.0), explained_by=["y", "x"]),
        _stepped("d", "rho", (1, "exact", 0.0)),
        _stepped("t", "f", (1, "differs", 2.0), twin="newton"),
        CaseRecord(case="law", verdict="pass"),
    ]
    of_reference, of_twins = findings.matrices(RunRecord(engine=EngineRecord(), reference={}, cases=cases))
    assert (of_reference.cases, of_reference.steps, of_reference.explained) == (4, [0, 1, 5], ["x", "y"])
    assert [(row.field, row.exact) for row in of_reference.rows] == [("f", False), ("rho", True)], "as a step computes"
    first, second, last = of_reference.rows[0].cells
    assert first and second and last and of_reference.rows[1].cells[0] is None
    assert [cell.verdict for cell in (first, second, last)] == ["exact", "explained", "differs"]
    assert (second.cases, second.agree, second.inside.cases) == (3, 2, 2)
    assert (second.inside.ratio, second.inside.case, second.explained.ratio) == (0.5, "a", 7.0)
    assert (last.outside.case, of_twins.twins, of_twins.cases) == ("b", True, 1)
    assert findings.matrices(RunRecord(engine=EngineRecord(), reference={}, cases=cases[-1:])) == []


def test_the_mark_of_an_outcome() -> None:
    outcome = CaseOutcome("one", "differs", False, worst=3.0, worst_field="f")
    assert views.mark("1.0", "2026-01-02", "2 runs", outcome) == views.RunMark(
        "1.0", "2026-01-02", "differs", 3.0, "1.0, 2 runs: differs, worst in f"
    )
    assert views.mark("1.0", "", "1 run", CaseOutcome("one", "pass", True)).says == "1.0, 1 run: pass"


def test_audit_begins_with_its_worst_field_and_step() -> None:
    def record(field: str, verdict: str, ratio: float, step: int) -> FieldRecord:
        return FieldRecord(
            field=field, stage="", verdict=verdict, max_over_bound=ratio, worst_step=step, derivation="derived"
        )

    count = 3
    zeros_n, ones_n = np.zeros(count), np.ones(count)
    arrays = {"id": np.arange(1, count + 1), "type": np.ones(count, int), "x": np.zeros((count, 3)), "rho": ones_n}
    arrays["step"] = np.array(60)
    for field, size in (("pressure", 0.0), ("drho", 0.5), ("f", 2.0)):
        arrays |= {f"{field}.lammps": size * ones_n, f"{field}.reference": zeros_n, f"{field}.bound": ones_n}
    fields = [record("pressure", "exact", 0.0, 0), record("drho", "pass", 0.7, 40), record("f", "explained", 2.0, 60)]
    case = CaseRecord(case="in.deck", verdict="explained", natoms=count, tags=["audit"], fields=fields)
    data, _ = plots.payload(case, arrays, plots.differences(arrays))
    assert data is not None and data["first"] == "f" and data["step"] == 60
    assert {field: step for field, (step, _) in data["elsewhere"].items()} == {"drho": 40}
