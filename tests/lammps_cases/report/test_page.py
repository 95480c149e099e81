"""The page of a run: its content, well-formedness, and that no text in it acts as markup."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from syrupy.assertion import SnapshotAssertion

from eos_ref import EOSTable
from lammps_cases.records import case_wording, wording
from lammps_cases.records.case_parts import OutlookRecord
from lammps_cases.records.run_record import CaseRecord, EngineRecord, RunRecord
from lammps_cases.report import findings, page, plots
from lammps_cases.report.formats import write_report
from tests.support.made_report import FINDINGS, WATER, model, numbers, scene
from tests.support.pages import Page, text_of, unpacked


def run_of(*cases: CaseRecord) -> RunRecord:
    return RunRecord(engine=EngineRecord(), reference={}, cases=list(cases))


def written(record: RunRecord, folder: Path) -> str:
    return unpacked(write_report(record, folder, FINDINGS).read_text(encoding="utf-8"))


def law_case(folder: Path, name: str = "a") -> CaseRecord:
    return scene(folder, name, EOSTable((WATER,)), np.linspace(990, 1010, 10))


def test_page_loads_nothing_from_elsewhere_and_hostile_text_stays_text(parsed: Page, html: str) -> None:
    for tag, attributes in parsed.elements:
        assert tag not in ("link", "iframe", "img", "object", "embed", "base"), tag
        assert "src" not in attributes and "srcset" not in attributes
        assert (attributes.get("href") or "#").startswith("#")
        assert not any(name.startswith("on") for name in attributes)
    assert "default-src 'none'" in html
    styles = re.findall(r"<style>(.*?)</style>", html, re.DOTALL)
    assert styles and not any("url(" in style or "@import" in style for style in styles)
    assert "<img" not in html.lower() and "<script>alert" not in html
    others = html.count('<script type="application/json" class="more">')  # other steps
    assert len(parsed.scripts) == 4 + len(parsed.data) + others
    assert page.embedded({"a": "</script><!--"}).count("<") == 0
    assert json.loads(page.embedded({"a": "</script>&"})) == {"a": "</script>&"}


def test_text_of_the_page(html: str, snapshot: SnapshotAssertion) -> None:
    """Numbers of all their digits are those of random states."""
    shown = re.sub(r"\d\.\d{7,}(e[+-]\d+)?", "N", text_of(html)).replace(f"numpy {np.__version__}", "numpy N")
    assert shown == snapshot


def test_every_case_has_a_row_and_a_page_and_every_link_a_target(parsed: Page, run: RunRecord, html: str) -> None:
    shown = {a["data-case"] for tag, a in parsed.elements if tag == "article"}
    rows = [a for tag, a in parsed.elements if tag == "tr" and "data-kind" in a]
    assert shown == {case.case for case in run.cases}
    assert [row["data-kind"] for row in rows] == [wording.kind(case) for case in run.cases]
    checks = parsed.data["audit.in.dam"]["checks"]
    assert len(numbers(checks["ratio"])) == plots.CHECKS and checks["total"] == 800
    found = {finding.entry.id: finding for finding in findings.of_run(run, FINDINGS)}
    last = sorted(found, key=lambda name: found[name].status == "absent")
    places = [
        a["id"] for tag, a in parsed.elements if tag == "details" and (a.get("class") or "").startswith("finding")
    ]
    assert places == [f"finding={name}" for name in last]
    folded = html[html.index("2 other findings not seen in this run") :]
    assert 'id="finding=elsewhere"' in folded and 'id="finding=pairs"' not in folded
    links = {a["href"] for tag, a in parsed.elements if tag == "a" and "href" in a}
    assert {"#finding=pairs", "#finding=F-3", "#case=model.flat", "#case=eos.broken"} <= links


def test_fields_against_steps(html: str) -> None:
    """The verdict of every field at every step, deeper by decades, in the order of the evaluations in a step."""
    (table,) = re.findall(r'data-case="model.flat".*?<table class="steps">(.*?)</table>', html, re.DOTALL)[:1]
    rows = {found[1]: row for row in table.split("<tr") if (found := re.search(r'data-field="([^"]*)"', row))}
    at = r'<td class="at v-(\w+) s(\d)" title="[^"]*atom 4: [^"]*">([^<]*)<'
    assert {name: re.findall(at, row) for name, row in rows.items() if name != "pressure"} == {
        "grad/v": [("pass", "3", "0.5"), ("explained", "5", "7e3")],
        "f": [("explained", "7", "3e9"), ("explained", "6", "2e8")],
    }
    assert list(rows) == ["grad/v", "f", "pressure"]
    assert '<td class="at v-exact" colspan="2">=</td>' in table  # fields compared once
    depths = [page.shade(ratio, "pass") for ratio in (0.0, 1e-9, 2e-3, 0.02, 0.2, 1.0)]
    assert depths == [0, 0, 1, 2, 3, 4]
    depths = [page.shade(ratio, "differs") for ratio in (1.1, 1e4, 1e10, 1e15, 1e300, np.inf, np.nan)]
    assert depths == sorted(depths) and depths[0] == 4 and depths[-3:] == [9, 9, 9]
    assert page.shade(None, "differs") == 0


def test_long_page_has_the_other_steps_of_one_field(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case = model(tmp_path, "m", 2)

    def more() -> list[Any]:
        return [
            json.loads(text) for text in re.findall(r'class="more">(.*?)</script>', written(run_of(case), tmp_path))
        ]

    (kept,) = more()
    assert {name: list(of["at"]) for name, of in kept.items()} == {"grad/v": ["0"], "pressure": ["0"]}
    monkeypatch.setattr(page, "WHOLE", 0)
    assert more() == []
    case.verdict = "differs"  # all are kept for a case that is not accepted
    assert more() == [kept]


def test_page_of_many_cases_lists_some_of_them(run: RunRecord, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    of_run = findings.outcome(run, FINDINGS)
    bad = [case.case for case in of_run.unaccepted]
    for most in (8, 2):
        monkeypatch.setattr(page, "LISTED", most)
        html = unpacked(page.render(of_run, folder / "fields"))
        rows = [a for tag, a in Page(html).elements if tag == "tr" and "data-kind" in a]
        listed = [a["data-case"] for tag, a in Page(html).elements if tag == "article"]
        assert len(rows) == len(listed) == most < len(run.cases)
        assert set(bad) <= set(listed) or listed == sorted(bad[:2])
        assert f"{most} of {len(run.cases)} cases are listed" in html and f"Cases ({len(run.cases)})" in html


# --- parts that a run lacks


def test_run_without_the_model_or_arrays_has_no_such_parts(tmp_path: Path) -> None:
    html = written(run_of(law_case(tmp_path)), tmp_path)
    assert 'id="agreement"' not in html and "#agreement" not in html and 'class="steps"' not in html
    assert "Agreement" not in (tmp_path / "summary.md").read_text() and 'id="findings"' in html
    case = model(tmp_path, "m", 2)
    (tmp_path / "fields" / "m.npz").unlink()
    html = written(run_of(case), tmp_path)
    assert Page(html).data == {} and '<table class="steps">' in html and "data-field" not in html[: html.index("Plots")]
    case = law_case(tmp_path)
    case.fields, case.verdict = [], "crashed"
    assert Page(written(run_of(case), tmp_path)).data == {}, "arrays of an older run are not shown"


def test_error_of_a_failed_deck_is_quoted_verbatim(run: RunRecord, folder: Path) -> None:
    why = OutlookRecord(cause="findings", findings=["F-3"], run=1, step=0, taken=20, after=3, steps=50)
    lost = "ERROR: Lost atoms: original 100 current 2"
    deck = CaseRecord(case="in.deck", verdict="refused", engine_error=lost, outlook=why, tags=["audit"])
    deck.unchecked = {"cv": "no thermal", "chi": "no walls", "heatflow": "no thermal"}
    alone = run.model_copy(update={"cases": [deck.model_copy(update={"message": case_wording.message(deck)})]})
    html = unpacked(page.render(findings.outcome(alone, FINDINGS), folder / "fields"))
    says, lists = re.findall(r"<dt>(.*?)</dt><dd>(.*?)</dd>", html), re.findall(r"<li>([^<]*)</li>", html)
    assert {("LAMMPS printed", f"<code>{lost}</code>"), ("Why", case_wording.outlook(deck))} <= {*says}
    assert {"cv, heatflow: no thermal", "chi: no walls"} < {*lists}


def test_page_that_fails_is_replaced_by_a_bare_one(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(page, "ASSETS", tmp_path)  # without Plotly's script
    record = run_of()
    lacks = "not in this report: page: FileNotFoundError"
    assert lacks in written(record, tmp_path) and lacks in (tmp_path / "summary.md").read_text()
    assert record.exit_code() == 3


def test_case_whose_pictures_fail_has_an_article_without_them(tmp_path: Path) -> None:
    record = run_of(*(law_case(tmp_path, name) for name in ("a.one", "a.two"))).counted()
    (tmp_path / "fields" / "a.two.npz").write_bytes(b"damaged")
    html = written(record, tmp_path)
    assert {a["data-case"] for tag, a in Page(html).elements if tag == "article"} == {"a.one", "a.two"}
    assert [*Page(html).data] == ["a.one"]
    assert html.count("not in this report: pictures of a.two: InputError: per-atom arrays: are damaged") == 1
    assert [(fault.part, fault.cases) for fault in record.faults] == [("pictures", ["a.two"])]
    law_case(tmp_path, "a.two")
    assert "not in this report" not in written(record, tmp_path) and not record.faults
