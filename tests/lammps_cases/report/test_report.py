"""The reports of a run: their content, well-formedness, and that no text in them acts as markup."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eos_ref import EOSTable
from lammps_cases.records import case_wording, wording
from lammps_cases.records.case_parts import OutlookRecord
from lammps_cases.records.run_record import CaseRecord, EngineRecord, RunRecord
from lammps_cases.report import findings, markdown, page, plots
from lammps_cases.report.formats import write_report
from lammps_cases.scene.fields import in_step_order
from tests.support.made_report import FINDINGS, HOSTILE, NAME, WATER, Page, entry, model, numbers, scene
from tests.support.pages import unpacked


def test_the_page_loads_nothing_from_elsewhere(parsed: Page, html: str) -> None:
    for tag, attributes in parsed.elements:
        assert tag not in ("link", "iframe", "img", "object", "embed", "base"), tag
        assert "src" not in attributes and "srcset" not in attributes
        assert (attributes.get("href") or "#").startswith("#")
    assert "default-src 'none'" in html
    style = html[html.index("<style>") : html.index("</style>")]
    assert "url(" not in style and "@import" not in style


def test_every_case_has_a_row_and_a_page(parsed: Page, run: RunRecord) -> None:
    shown = {a["data-case"] for tag, a in parsed.elements if tag == "article"}
    rows = [a for tag, a in parsed.elements if tag == "tr" and "data-kind" in a]
    assert shown == {case.case for case in run.cases}
    assert [row["data-kind"] for row in rows] == [wording.kind(case) for case in run.cases]


def test_checks_of_an_audit(parsed: Page, html: str) -> None:
    checks = parsed.data["audit.in.dam"]["checks"]
    assert len(numbers(checks["ratio"])) == plots.CHECKS and checks["total"] == 800
    assert "cs is below 10 times the largest velocity" in html
    assert f"{page.ROWS} of 800 shown" in html


def test_hostile_text_stays_text(parsed: Page, html: str, run: RunRecord) -> None:
    assert "<img" not in html.lower()
    assert "<script>alert" not in html
    assert not any(name.startswith("on") for _, attributes in parsed.elements for name in attributes)
    others = html.count('<script type="application/json" class="more">')  # other steps
    assert parsed.scripts == 4 + len(parsed.data) + others
    text = (Path("x") / markdown.summary(findings.outcome(run, FINDINGS))).as_posix()
    assert "<img" not in text and "<script" not in text
    assert page.embedded({"a": "</script><!--"}).count("<") == 0
    assert json.loads(page.embedded({"a": "</script>&"})) == {"a": "</script>&"}


def test_fields_against_steps(parsed: Page, html: str) -> None:
    start = html.index('data-case="model.flat"')
    article = html[start : html.index("</article>", start)]
    table = article[article.index('<table class="steps">') : article.index("</table>")]
    rows = {re.search(r"data-field=\"([^\"]*)\"", row)[1]: row for row in table.split("<tr") if "data-field" in row}
    assert list(rows) == ["grad/v", "f", "pressure"]  # the order of the record, that of the evaluations in a step
    cells = {
        name: re.findall(r'<td class="at v-(\w+) s(\d)" title="[^"]*atom 4: [^"]*">([^<]*)<', rows[name])
        for name in rows
    }
    assert cells["grad/v"] == [("pass", "3", "0.5"), ("explained", "5", "7e3")]
    assert cells["f"] == [("explained", "7", "3e9"), ("explained", "6", "2e8")]
    assert '<td class="at v-exact" colspan="2">=</td>' in table  # fields compared once
    blames = re.findall(r'<p class="blame[^>]*>(.*?)</p>', article)
    assert blames[0] == (
        "f (stage pair) leaves its bound at step 0 at 1 of 60 atoms, first atom 4: "
        "LAMMPS 1.5, reference 0.5, bound 1e-14"
    )
    assert blames[1] == 'Explained by <a href="#finding=pairs">pairs</a>, <a href="#finding=F-3">F-3</a>'


def test_a_long_page_has_the_other_steps_of_one_field(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case = model(tmp_path, "m", 2)
    record = RunRecord(engine=EngineRecord(), reference={}, cases=[case])

    def more() -> list[Any]:
        write_report(record, tmp_path, FINDINGS)
        html = unpacked((tmp_path / "report.html").read_text())
        return [json.loads(text) for text in re.findall(r'class="more">(.*?)</script>', html)]

    (kept,) = more()
    assert {name: list(of["at"]) for name, of in kept.items()} == {"grad/v": ["0"], "pressure": ["0"]}
    monkeypatch.setattr(page, "WHOLE", 0)
    assert more() == []
    case.verdict = "differs"  # all are kept for a case that is not accepted
    assert more() == [kept]


def test_colours_deepen_by_decades() -> None:
    depths = [page.shade(ratio, "pass") for ratio in (0.0, 1e-9, 2e-3, 0.02, 0.2, 1.0)]
    assert depths == sorted(depths) == [0, 0, 1, 2, 3, 4]
    depths = [page.shade(ratio, "differs") for ratio in (1.1, 1e4, 1e10, 1e15, 1e300, np.inf, np.nan)]
    assert depths == sorted(depths) and depths[0] == 4 and depths[-3:] == [9, 9, 9]
    assert page.shade(None, "differs") == 0


def test_findings_of_a_run(run: RunRecord, parsed: Page, html: str) -> None:
    found = {finding.entry.id: finding for finding in findings.of_run(run, FINDINGS)}
    assert list(found) == ["pairs", "gone", "elsewhere", "F-3", "open", "hostile"]  # severity, then status
    assert found["pairs"].cases == ["model.flat", "model.cube", f"hostile2.{NAME}"]
    assert found["pairs"].unseen == []  # of the particle model: the records of cases show where it applies
    assert "ledger.artificial" in found["F-3"].cases
    assert (found["gone"].status, found["gone"].unseen) == ("unseen", ["model.cube"])
    assert found["open"].cases == ["eos.broken"]  # without a variant a difference is shown, not explained
    assert found["elsewhere"].status == "absent" and not found["elsewhere"].listed
    places = [a for tag, a in parsed.elements if tag == "details" and (a.get("class") or "").startswith("finding")]
    last = sorted(found, key=lambda name: found[name].status == "absent")
    assert [place["id"] for place in places] == [f"finding={name}" for name in last]
    absent = sum(finding.status == "absent" for finding in found.values())
    folded = html[html.index(f"{wording.counted(absent, 'other finding')} not seen in this run") :]
    assert 'id="finding=elsewhere"' in folded and 'id="finding=pairs"' not in folded
    links = {a["href"] for tag, a in parsed.elements if tag == "a" and "href" in a}
    assert {"#finding=pairs", "#finding=F-3", "#case=model.flat", "#case=eos.broken"} <= links
    assert "applies to 1 case, not seen" in html and "not known of this version of LAMMPS" in html
    assert "About this run" in html and "this engine no longer shows gone" in html


def test_finding_without_its_predicted_outcome_is_unseen() -> None:
    crash = entry("crash", applies_to=("[a-d]",), outcome="crashed")
    cases = [
        CaseRecord(case="a", verdict="explained", explained_by=["crash"]),
        CaseRecord(case="b", verdict="refused", expects="x"),
        CaseRecord(case="c", verdict="skipped"),
        CaseRecord(case="d", verdict="differs"),
    ]
    run = RunRecord(engine=EngineRecord(distribution="2025.7.22.4.0"), reference={}, cases=cases)
    (found,) = findings.of_run(run, (crash,))
    assert (found.cases, found.unseen) == (["a"], ["b", "d"])


def test_agreement(run: RunRecord, html: str, folder: Path) -> None:
    model, twins = findings.matrices(run)
    assert (model.cases, model.steps, twins.cases) == (2, [0, 10], 1)
    assert [row.field for row in model.rows] == ["grad/v", "pressure", "f"]
    force = model.rows[2].cells[0]
    assert force is not None and (force.agree, force.explained.cases, force.explained.ratio) == (0, 2, 3e9)
    gradient = model.rows[0].cells[0]
    assert gradient is not None and (gradient.agree, gradient.inside.ratio, gradient.verdict) == (2, 0.5, "pass")
    assert 'title="model.flat">≤ 0.5</a>' in html
    text = (folder / "summary.md").read_text(encoding="utf-8")
    assert "### Agreement: LAMMPS against the reference (2 cases)" in text
    assert "| grad/v | 2 (0.5) | 2 explained (7e3) |" in text
    effect = "**title of pairs** effect of pairs."
    assert f"| high | {effect} | 2025.7.22.4.0 | 3 | `eos-ref report-bug pairs` |" in text
    assert "| high | `gone` | title of gone | 1 |" in text
    assert "> **Note:** this engine no longer shows gone" in text
    assert in_step_order(["zz", "f", "x", "aa"]) == ["x", "f", "aa", "zz"]  # unknown fields do no harm


def test_a_run_without_the_model(tmp_path: Path) -> None:
    cases = [scene(tmp_path, "a", EOSTable((WATER,)), np.linspace(990, 1010, 10))]
    write_report(RunRecord(engine=EngineRecord(), reference={}, cases=cases), tmp_path)
    html = unpacked((tmp_path / "report.html").read_text())
    assert 'id="agreement"' not in html and "#agreement" not in html and 'class="steps"' not in html
    assert "Agreement" not in (tmp_path / "summary.md").read_text()
    assert 'id="findings"' in html


def test_a_model_case_without_arrays_keeps_its_table(tmp_path: Path) -> None:
    case = model(tmp_path, "m", 2)
    (tmp_path / "fields" / "m.npz").unlink()
    write_report(RunRecord(engine=EngineRecord(), reference={}, cases=[case]), tmp_path)
    html = unpacked((tmp_path / "report.html").read_text())
    assert Page(html).data == {} and '<table class="steps">' in html and "data-field" not in html[: html.index("Plots")]


def test_a_page_of_many_cases_lists_some_of_them(run: RunRecord, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page, "LISTED", 8)
    html = unpacked(page.render(findings.outcome(run, FINDINGS), folder / "fields"))
    rows = [a for tag, a in Page(html).elements if tag == "tr" and "data-kind" in a]
    listed = [a["data-case"] for tag, a in Page(html).elements if tag == "article"]
    assert len(rows) == len(listed) == 8 < len(run.cases)
    bad = [case.case for case in findings.outcome(run, FINDINGS).unaccepted]
    assert set(bad) <= set(listed)
    assert f"8 of {len(run.cases)} cases are listed" in html and f"Cases ({len(run.cases)})" in html
    monkeypatch.setattr(page, "LISTED", 2)
    html = unpacked(page.render(findings.outcome(run, FINDINGS), folder / "fields"))
    assert [a["data-case"] for tag, a in Page(html).elements if tag == "article"] == sorted(bad[:2])


def test_error_of_a_failed_deck_is_quoted_verbatim(run: RunRecord, folder: Path) -> None:
    why = OutlookRecord(cause="findings", findings=["F-3"], run=1, step=0, taken=20, after=3, steps=50)
    lost = "ERROR: Lost atoms: original 100 current 2"
    deck = CaseRecord(case="in.deck", verdict="refused", engine_error=lost, outlook=why, tags=["audit"])
    deck.unchecked = {"cv": "no thermal", "chi": "no walls", "heatflow": "no thermal"}
    alone = run.model_copy(update={"cases": [deck.model_copy(update={"message": case_wording.message(deck)})]})
    html = unpacked(page.render(findings.outcome(alone, FINDINGS), folder / "fields"))
    says, lists = re.findall(r"<dt>(.*?)</dt><dd>(.*?)</dd>", html), re.findall(r"<li>([^<]*)</li>", html)
    assert ("LAMMPS printed", f"<code>{lost}</code>") in says
    assert ("Why", case_wording.outlook(deck)) in says
    assert {"cv, heatflow: no thermal", "chi: no walls"} < {*lists}


def test_a_case_without_fields_does_not_show_an_older_run(tmp_path: Path) -> None:
    case = scene(tmp_path, "a", EOSTable((WATER,)), np.linspace(990, 1010, 10))
    case.fields, case.verdict = [], "crashed"
    write_report(RunRecord(engine=EngineRecord(), reference={}, cases=[case]), tmp_path)
    assert Page(unpacked((tmp_path / "report.html").read_text())).data == {}


def test_junit(run: RunRecord, folder: Path) -> None:
    suite = ET.parse(folder / "junit.xml").getroot()[0]
    outcomes = {c.get("name"): {child.tag for child in c} for c in suite.iter("testcase")}
    assert len(outcomes) == len(run.cases) == int(suite.get("tests", 0))
    assert outcomes["eos.broken"] == {"failure"}
    assert all(outcomes[name] == {"error"} for name in ("refuse.surprise", "crash.segfault", "slow.timeout"))
    assert outcomes["skip.plugin"] == {"skipped"}
    assert outcomes["refuse.gamma"] == outcomes["ledger.artificial"] == {"system-out"}
    assert outcomes["eos.types"] == set()
    assert [suite.get(name) for name in ("failures", "errors", "skipped")] == ["1", "3", "1"]
    classes = {c.get("name"): c.get("classname") for c in suite.iter("testcase")}
    assert classes["eos.water.near"] == "eos-ref.eos"
    crash = suite.find("testcase[@name='crash.segfault']/error")
    assert crash is not None and crash.get("message") == HOSTILE.replace("\x1b", "")
    assert suite.find("properties/property[@name='engine.distribution']") is not None


def test_summary(run: RunRecord, folder: Path) -> None:
    text = (folder / "summary.md").read_text(encoding="utf-8")
    assert text.startswith(
        "## eos-ref: 🔴 FAIL\n\n4 cases not as expected: 1 refused, 1 differs, 1 timeout, 1 crashed; "
    )
    table = text[text.index("### Not accepted") : text.index("> **Note")]
    rows = [line for line in table.splitlines() if line.startswith("|")]
    assert {len(re.findall(r"(?<!\\)\|", row)) for row in rows} == {8}
    assert [row.split("`")[1] for row in rows[2:]] == [
        "crash.segfault",
        "slow.timeout",
        "eos.broken",
        "refuse.surprise",
    ]
    assert "| differs | pressure | eos | 6 | ∞ |" in table
    assert "<summary>Most digits lost</summary>" in text and "2025.7.22.4.0" in text


def test_same_bytes_again(run: RunRecord, folder: Path) -> None:
    names = ("report.html", "summary.md", "junit.xml")
    before = [(folder / name).read_bytes() for name in names]
    write_report(run, folder, FINDINGS)
    assert [(folder / name).read_bytes() for name in names] == before
    assert sorted(path.name for path in folder.iterdir()) == sorted([*names, "fields"])


def test_without_plotly_there_is_a_bare_page(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    run = RunRecord(engine=EngineRecord(), reference={})
    lacks = "not in this report: page: InputError: plotly: must be installed"
    assert lacks in write_report(run, tmp_path).read_text() and lacks in (tmp_path / "summary.md").read_text()
    assert run.exit_code() == 3


def test_a_case_whose_pictures_fail_has_an_article_without_them(tmp_path: Path) -> None:
    table = EOSTable((WATER,))
    rho_n = 1000 * (1 + np.linspace(0.001, 0.01, 9))
    cases = [scene(tmp_path, name, table, rho_n) for name in ("a.one", "a.two")]
    (tmp_path / "fields" / "a.two.npz").write_bytes(b"damaged")
    run = RunRecord(engine=EngineRecord(), reference={}, cases=cases).counted()
    html = unpacked(write_report(run, tmp_path).read_text())
    shown = Page(html)
    assert {a["data-case"] for tag, a in shown.elements if tag == "article"} == {"a.one", "a.two"}
    assert [*shown.data] == ["a.one"]
    assert html.count("not in this report: pictures of a.two: InputError: per-atom arrays: are damaged") == 1
    assert [(fault.part, fault.cases) for fault in run.faults] == [("pictures", ["a.two"])]
    scene(tmp_path, "a.two", table, rho_n)
    assert "not in this report" not in write_report(run, tmp_path).read_text() and not run.faults
