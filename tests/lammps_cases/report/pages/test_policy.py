"""Every page: its policy allows its own scripts only, and no text becomes markup."""

from __future__ import annotations

import base64
import dis
import hashlib
import html.parser
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jinja2
import jinja2.meta
import pytest

import lammps_cases
from lammps_cases.report.pages import frame
from tests.support.pages import unpacked

TEMPLATES = sorted(Path(lammps_cases.__file__).parent.rglob("*.html.j2"))
PAGES = [path for path in TEMPLATES if '{% extends "frame.html.j2" %}' in path.read_text(encoding="utf-8")]
HOSTILE = (
    "</script></style></title>\" onload=evil() '><script>evil()</script><img src=x onerror=evil()> javascript:evil()"
)
DEPTH = 6


class Anything(str):
    """A text that has every attribute, member and result, each such a text; its loops end."""

    depth = 0

    def __new__(cls, depth: int = 0) -> Anything:
        made = super().__new__(cls, HOSTILE)
        made.depth = depth
        return made

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return OfCode() if name == "data" else Anything(self.depth)

    def __getitem__(self, key: object) -> Any:
        return Anything(self.depth)

    def __call__(self, *arguments: object, **named: object) -> Any:
        return Anything(self.depth)

    def __iter__(self) -> Iterator[Any]:
        caller = sys._getframe(1)
        code, at = caller.f_code.co_code, caller.f_lasti
        if dis.opname[code[at]] == "UNPACK_SEQUENCE":  # as many as the targets of the unpacking
            return iter([Anything(self.depth + 1)] * code[at + 1])
        return iter([Anything(self.depth + 1)] * 2 if self.depth < DEPTH else [])

    def _same(self, *others: object) -> Any:
        return self

    __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __truediv__ = __mod__ = __rmod__ = _same

    def _less(self, other: object) -> bool:
        return False

    __lt__ = __gt__ = __le__ = __ge__ = _less

    def items(self) -> list[tuple[Any, Any]]:
        return [(Anything(self.depth + 1), Anything(self.depth + 1))] if self.depth < DEPTH else []

    # Methods of texts whose names our own models have as well.
    values = title = count = index = format = property(lambda self: Anything(self.depth))


class OfCode(dict[str, Any]):
    """The ``data-`` attributes of a row, whose names are written in the code."""

    def __init__(self) -> None:
        super().__init__(key=Anything())


class Markups(html.parser.HTMLParser):
    """Collect the parts of a page that a browser would act on."""

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: list[str] = []
        self.inside = False

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attributes)))
        if tag == "script":
            self.scripts.append("")
            self.inside = True

    def handle_endtag(self, tag: str) -> None:
        self.inside = False

    def handle_data(self, data: str) -> None:
        if self.inside:
            self.scripts[-1] += data


def test_all_pages_are_known() -> None:
    names = {path.name.partition(".")[0] for path in PAGES}
    assert names >= {"report", "compare", "history", "claims", "chart", "stability", "inputs", "index"}


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_no_text_is_markup(path: Path) -> None:
    environment = frame.environment_of(path.parent)
    environment.bytecode_cache = None  # templates compiled with other filters must not be cached
    parts = [part.read_text(encoding="utf-8") for part in TEMPLATES if part.parent in (path.parent, frame.SHARED)]
    for name in environment.filters.keys() | {name for part in parts for name in re.findall(r"\|\s*(\w+)", part)}:
        if name not in ("packed", "safe", "escape", "e"):
            environment.filters[name] = lambda value, *rest, **named: value if isinstance(value, str) else Anything()
    names = {name for part in parts for name in jinja2.meta.find_undeclared_variables(environment.parse(part))}
    given = {"scripts": [], "css": "", "policy": frame.policy([])}
    page = unpacked(environment.get_template(path.name).render(dict.fromkeys(names, Anything()) | given))
    assert "evil" in page
    found = Markups()
    found.feed(page)
    for tag, attributes in found.elements:
        assert attributes.get("src") != "x", (tag, attributes)
        assert not any(name.startswith("on") for name in attributes), (tag, attributes)
        assert tag != "script" or attributes.get("type") in ("text/plain", "application/json"), attributes


def test_only_the_policy_is_marked_safe() -> None:
    """Markup is made in a few places of the code, which escape their arguments."""
    named = re.compile(r"(\w+)\s*\|\s*safe")  # not the texts of a template
    assert [(path.name, name) for path in TEMPLATES for name in named.findall(path.read_text(encoding="utf-8"))] == [
        ("frame.html.j2", "policy")
    ]


def test_policy_names_the_scripts_of_a_page(tmp_path: Path) -> None:
    (tmp_path / "made.html.j2").write_text('{% extends "frame.html.j2" %}{% block main %}{{ text }}{% endblock %}')
    (tmp_path / "made.js").write_text("const a = '<b>';\n")
    page = frame.page(tmp_path, "made", unpacked=["later"], text=HOSTILE)
    found = Markups()
    found.feed(page)
    policies = [a["content"] for _, a in found.elements if a.get("http-equiv") == "Content-Security-Policy"]
    (policy,) = policies
    hashes = [base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in (*found.scripts, "later")]
    assert len(hashes) == 2 and policy is not None
    (scripts,) = [part for part in policy.split("; ") if part.startswith("script-src ")]
    assert scripts == " ".join(["script-src", *(f"'sha256-{each}'" for each in hashes)])
    assert "default-src 'none'" in policy and "base-uri 'none'" in policy and "evil" in page
    assert "script-src 'none'" in frame.policy([])


FOLDS = "claims"  # a table whose rows become blocks on a narrow screen, by its own style sheet


@pytest.mark.parametrize("path", TEMPLATES, ids=lambda path: path.name)
def test_wide_tables_scroll_and_not_the_page(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    for found in re.finditer(r'<table(?: class="([^"]*)")?', text):
        before = text[: found.start()].rstrip().rpartition("\n")[2]
        assert found[1] == FOLDS or 'class="scroll' in before, found[0]
