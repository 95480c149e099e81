"""The report of a run, drawn in chromium: cases, addresses, keys and clicks."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

from lammps_cases.records.case_parts import CheckRecord, FieldRecord
from lammps_cases.records.run_record import CaseRecord, RunRecord
from lammps_cases.report import plots
from lammps_cases.report.formats import write_report
from tests.support.browser import browser
from tests.support.pages import Page

pytestmark = [pytest.mark.slow, pytest.mark.browser]


def _shown(folder: Path, address: str, tmp_path: Path) -> tuple[Page, str]:
    """Return the report as parsed and as text after a browser has opened an address in it without errors."""
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--virtual-time-budget=8000"]
    options += ["--disable-background-networking", "--enable-logging=stderr", f"--user-data-dir={tmp_path}"]
    url = f"{(folder / 'report.html').as_uri()}#{address}"
    done = subprocess.run(["chromium", *options, "--dump-dom", url], capture_output=True, text=True, timeout=120)
    assert not re.findall(r"CONSOLE.*(?:Uncaught|Error|Refused)", done.stderr)
    return Page(done.stdout[: done.stdout.rindex("</html>")]), done.stdout


@pytest.mark.parametrize(("case", "figures"), [("eos.types", 4 + 3), ("model.flat", 4)])
def test_a_browser_draws_a_case(run: RunRecord, folder: Path, tmp_path: Path, case: str, figures: int) -> None:
    shown, dom = _shown(folder, f"case={case}", tmp_path)
    assert re.search(rf"<title>eos-ref {case} \w+</title>", dom)
    assert [("hidden" in a) for _, a in shown.elements if a.get("id") == "missing"] == [True]
    # Only cases of its family are unpacked.
    family = {record.case for record in run.cases if record.case.startswith(case.split(".")[0] + ".")}
    articles = {a["data-case"]: a for t, a in shown.elements if t == "article"}
    assert articles.keys() == family and [name for name, a in articles.items() if "hidden" not in a] == [case]
    plotted = [a for t, a in shown.elements if t == "div" and "js-plotly-plot" in (a.get("class") or "")]
    # A law per type; difference and bound, pressure, ratio. Of the model: ratio, both sides, bound, value.
    assert len(plotted) == figures


def test_an_address_opens_a_field_and_an_atom(run: RunRecord, folder: Path, tmp_path: Path) -> None:
    with np.load(folder / "fields" / "model.flat.npz") as arrays:
        lammps_nc, reference_nc = arrays["f.lammps"], arrays["f.reference"]
    _, dom = _shown(folder, "case=model.flat&field=pressure&atom=4", tmp_path)
    assert re.search(r'data-field="pressure" aria-pressed="true"', dom) and "Atom 4, type" in dom
    row = re.search(r"<td[^>]*>f</td>((?:<td[^>]*>[^<]*</td>)*)", dom[dom.index("Atom 4, type") :])
    assert row is not None
    lammps, reference = (float(text) for text in re.findall(r"<td[^>]*>([^<]*)", row[1])[1:3])
    at = np.abs(lammps_nc - reference_nc)[3].argmax()
    digits = 2.0**-plots.VALUE + 2.0**-plots.SIZE + 1e-5  # binary ones of value and difference, decimal ones shown
    assert lammps == pytest.approx(lammps_nc[3, at], rel=digits)
    assert reference == pytest.approx(reference_nc[3, at], rel=digits, abs=digits * abs(lammps_nc[3, at]))


def test_step_and_neighbours_by_keys_and_clicks(run: RunRecord, folder: Path, tmp_path: Path) -> None:
    step = "document.querySelector('article:not([hidden]) .step input')"
    box = "document.querySelector('.atom')?.innerText"
    titles = "[...document.querySelectorAll('figcaption')].map((each) => each.firstChild.textContent).join()"
    spot = "document.querySelectorAll('.js-plotly-plot')[2].data.findLast((one) => one.customdata)"
    with browser(tmp_path) as page:
        page.open(f"{(folder / 'report.html').as_uri()}#case=model.flat&field=f&step=10&atom=4")
        page.wait(f"{box}?.includes('Atom 4')")
        assert page.value("document.querySelector('.plots').getBoundingClientRect().top < innerHeight")
        assert page.value(titles).count("step 10") == 4 and page.value(f"{step}.value") == "1"
        after = page.value(f"{spot}.y.join()")
        assert "explain model.flat --atom 4 --step 10" in page.value(box)  # its pairs are kept for step 0 only
        page.value(f"{step}.focus()")
        page.press("ArrowLeft")
        page.wait("location.hash === '#case=model.flat&field=f&step=0&atom=4'")
        assert page.value(titles).count("step 0") == 4 and page.value(f"{spot}.y.join()") != after
        assert page.value(f"{step}.getAttribute('aria-valuetext')").startswith("0 (worst) of 0, 10")
        said = page.value(box)
        assert "2 neighbours at step 0, and what each pair adds (the reference)" in said and "explain" not in said
        rows = page.value("[...document.querySelectorAll('.neighbours tr')].map((row) => row.innerText.trim())")
        assert [row.split() for row in rows[1:]] == [
            ["7", "0.5", "1", "0.5"],
            ["9", "0.75", "2", "-0.75"],
            ["sum", "3", "-0.25"],
        ]
        page.value("document.querySelector('.neighbour').click()")
        page.wait("location.hash === '#case=model.flat&field=f&step=0&atom=7'")
        assert "Atom 7" in page.value(box)
        page.press("ArrowLeft")  # already at the first step: no other case is opened
        assert page.value("location.hash").startswith("#case=model.flat")
        assert page.complaints == []


def test_address_keeps_filter_and_order_of_the_table(run: RunRecord, folder: Path, tmp_path: Path) -> None:
    shown, dom = _shown(folder, "find=eos.water&sort=atoms&down", tmp_path)
    rows = [a for tag, a in shown.elements if tag == "tr" and "data-kind" in a]
    listed = re.search(r"(\d+) of (\d+) cases", dom)
    assert listed is not None and int(listed[2]) == len(run.cases)
    assert int(listed[1]) == sum("hidden" not in row for row in rows) == 1
    sorted_by = [a.get("aria-sort") for tag, a in shown.elements if tag == "th" and "aria-sort" in a]
    assert sorted_by == ["descending"]


def test_unknown_case_in_the_address_is_searched(folder: Path, tmp_path: Path) -> None:
    shown, dom = _shown(folder, "case=nowhere.to-be-found", tmp_path)
    assert re.search(r"\b0 of \d+ cases", dom)
    (line,) = [a for tag, a in shown.elements if a.get("id") == "missing"]
    assert "hidden" not in line and 'No case "nowhere.to-be-found" in this report' in dom
    assert not [a for tag, a in shown.elements if tag == "article" and "hidden" not in a]


def test_the_report_of_an_audit_opens_at_its_deck(run: RunRecord, tmp_path: Path) -> None:
    decks = [CaseRecord(case=name, verdict="pass", tags=["audit"]) for name in ("in.one", "in.two")]
    hidden = "document.getElementById('list').hidden"
    with browser(tmp_path / "browser") as page:
        for cases, address in ((decks[:1], "#case=in.one"), (decks, "")):
            write_report(run.model_copy(update={"cases": cases}).counted(), tmp_path)
            page.open((tmp_path / "report.html").as_uri())
            page.wait("document.readyState === 'complete'")
            assert page.value("location.hash") == address
            assert page.value(hidden) == bool(address)
            if address:
                page.value("document.querySelector('article .back').click()")
                page.wait(f"!{hidden}")
        assert page.complaints == []


def test_audit_has_distinct_marks_and_one_derivation(run: RunRecord, tmp_path: Path) -> None:
    names = [f"field-{k}" for k in range(14)]
    look = CheckRecord(run=1, step=0, type=0, natoms=9, verdict="pass", max_over_bound=0.5, max_abs=1.0, worst_id=1)
    checks = [look.model_copy(update={"field": name, "step": step}) for name in names for step in (0, 10)]
    fields = [
        FieldRecord(field=name, stage="", verdict="pass", max_over_bound=0.5, derivation="by hand") for name in names
    ]
    deck = CaseRecord(case="in.one", verdict="pass", tags=["audit"], checks=checks, fields=fields)
    write_report(run.model_copy(update={"cases": [deck]}).counted(), tmp_path)
    marks = "document.querySelector('.js-plotly-plot')?.data.map((one) => `${one.marker.color} ${one.marker.symbol}`)"
    with browser(tmp_path / "browser") as page:
        page.open((tmp_path / "report.html").as_uri())
        found = page.wait(marks)
        assert len(found) == len(set(found)) == len(names)
        box = "document.querySelector('{}').getBoundingClientRect()"
        legend, bar = box.format(".legend"), box.format(".modebar")
        assert page.value(f"{bar}.bottom <= {legend}.top")
        assert page.value("[...document.querySelectorAll('.derivation')].map((each) => each.innerText)") == [
            "bound: by hand"
        ]
        assert page.value("document.querySelector('.product').innerText") == "audit of in.one"
        assert page.complaints == []


def test_addresses_of_the_table_show_its_heading(run: RunRecord, folder: Path, tmp_path: Path) -> None:
    top = "document.getElementById('list-of-cases').getBoundingClientRect().top"
    with browser(tmp_path) as page:
        for address in ("#find=eos", "#list-of-cases"):
            page.open(f"{(folder / 'report.html').as_uri()}{address}", height=300)
            page.wait("document.readyState === 'complete'")
            page.wait(f"Math.abs({top}) < 40")
        for width in (390, 1280):
            page.resize(width)
            assert page.value("document.documentElement.scrollWidth") <= width
        assert page.complaints == []
