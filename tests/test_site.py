"""The site of ``make docs`` as its reader opens it: files, without a network or a server."""

from __future__ import annotations

import importlib
import importlib.util
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

import eos_ref
from lammps_cases.cli.main import COMMANDS
from lammps_cases.findings import LEDGER
from tests.support.browser import browser

pytestmark = pytest.mark.browser  # and what builds the site: make browser

ROOT = Path(__file__).parents[1]
NUMERICS = r"""- Surfaces: $\nabla\cdot\mathbf r$, normal
  $\mathbf n = -\nabla C$ with $\nabla C = 0$ **(convention)**. A particle
  is at the surface.
- Shifting

$x_i$ begins a paragraph with *words*
$$a_1 * b_1$$
and ends it: `$HOME`.

| a | b |
|---|---|
| $x_1$ | $y_1$ |
"""


@pytest.fixture(scope="module")
def hooks() -> ModuleType:
    spec = importlib.util.spec_from_file_location("site_hooks", ROOT / "docs" / "site.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def site(hooks: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, timeout=120)
    return folder


def test_formulas_do_not_break_lists_tables_and_paragraphs(hooks: ModuleType) -> None:
    markdown = importlib.import_module("markdown")
    html = hooks.on_page_content(markdown.markdown(hooks.on_page_markdown(NUMERICS), extensions=["tables"]))
    assert html.count("<ul>") == 1 and html.count("<li>") == 2
    item = html[html.index("<li>") : html.index("</li>")]
    assert item.count("<math") == 3 and "<strong>(convention)</strong>" in item and "is at the surface" in item
    paragraph = html[html.index("</ul>") : html.index("<table>")]
    assert paragraph.count("<p>") == 1 and "<em>words</em>" in paragraph and 'display="block"' in paragraph
    assert "<code>$HOME</code>" in paragraph
    assert html.count("<td><math") == 2 and "$x" not in html


def test_links_to_headings_starting_with_a_digit(hooks: ModuleType) -> None:
    link = hooks.on_page_markdown("[a](#1-a-deck) [b](NUMERICS.md#5-terms-of-a-pair) [c](faq.md#why) `[d](#1)`")
    names = [hooks._anchor(heading, "-") for heading in ("1. A deck", "5. Terms of a pair", "Why")]
    assert all(f"#{name})" in link for name in names) and all(name[0].isalpha() for name in names)
    assert link.endswith("`[d](#1)`")


def test_references_hold_every_command_and_every_exported_name(hooks: ModuleType) -> None:
    commands, api = hooks.commands(), hooks.api()
    assert re.findall(r"^### eos-ref (\S+)$", commands, re.MULTILINE) == list(COMMANDS)
    assert all(f"### eos_ref.{name}\n" in api for name in eos_ref.__all__)
    assert "\n- `rho0` (float):\n" in api and "$A_3$" in api and ":math:" not in api
    assert "calculate_numerical_forces" not in api, "inherited from a library"


def test_formulas_of_findings_are_set(hooks: ModuleType, site: Path) -> None:
    for entry in (entry for entry in LEDGER if entry.formulas):
        html = (site / "findings" / f"{entry.id}.html").read_text(encoding="utf-8")
        assert html.count("<math") >= len(entry.formulas) and "$" not in html.partition('role="main"')[2], entry.id


def test_no_page_complains_or_scrolls_sideways(site: Path, tmp_path: Path) -> None:
    pages = sorted(path for path in site.rglob("*.html") if path.name != "404.html")
    assert len(pages) > 20
    wide = {}
    with browser(tmp_path) as page:
        for path in pages:
            page.open(path.as_uri())
            page.wait("document.readyState === 'complete'", 120)
            for width in (1280, 390):
                page.resize(width)
                inner = page.value("document.documentElement.scrollWidth")
                if inner > width:
                    wide[f"{path.relative_to(site)} at {width}"] = inner
        assert page.complaints == [] and wide == {}


def test_search_and_colour_switch_work(site: Path, tmp_path: Path) -> None:
    results = "[...document.querySelectorAll('#mkdocs-search-results a')].map((each) => each.href)"
    theme = "document.documentElement.getAttribute('data-bs-theme')"
    with browser(tmp_path) as page:
        for name in ("index.html", "findings/force-per-volume.html"):
            page.open((site / name).as_uri())
            page.wait("document.readyState === 'complete'", 120)
            page.value("document.querySelector('[data-bs-target=\"#mkdocs_search_modal\"]').click()")
            page.wait("document.activeElement.id === 'mkdocs-search-query'")
            page.ask("Input.insertText", text="audit")
            found = page.wait(f"({results}).length && {results}")
            assert found[0].split("#")[0] == (site / "audit.html").as_uri()
            page.value("document.querySelector('#mkdocs-search-query').value = ''")
            page.ask("Input.insertText", text="qqqqq")
            page.wait("document.querySelector('#mkdocs-search-results').textContent === 'No results found'")
        for mode in ("dark", "light"):
            page.value(f"document.querySelector('[data-bs-theme-value={mode}]').click()")
            assert page.value(theme) == mode
        page.open((site / "eos_ref" / "NUMERICS.html").as_uri())
        page.wait("document.readyState === 'complete'", 120)
        bold = "getComputedStyle(document.querySelector('mi[mathvariant=bold]'))"
        assert page.value(f"[{bold}.fontWeight, {bold}.textTransform]") == ["700", "none"]
        assert page.complaints == []
