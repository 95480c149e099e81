"""What mkdocs does not do by itself: pages from outside docs/, formulas, and a search that needs no server."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from markdown.extensions.toc import slugify
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

from lammps_cases.findings import LEDGER
from lammps_cases.versions.evidence import BASELINES, collect, page

ROOT = Path(__file__).parents[1]
PAGES = ("ARCHITECTURE.md", "CONTRIBUTING.md", "eos_ref/NUMERICS.md")
# A link to a file that is no page of the site is left as text.
OUTSIDE = re.compile(
    r"\[([^\]]+)\]\((?:\.\./)*"
    r"(?:LICENSE|CITATION\.cff|lammps_cases/[^)]*|tests/[^)]*|reports/[^)]*(?<!\.png)|\.github/[^)]*)\)"
)
FINDING = re.compile(r"\]\((?:\.\./)?lammps_cases/data/findings/")  # its source, which has a page here
CODE = re.compile(r"(```.*?```|`[^`\n]+`)", re.DOTALL)
FORMULA = re.compile(r"\$\$([^$]+)\$\$|\$([^$\n]+)\$")
KEPT = re.compile("\ue000([0-9a-f]+)([\ue001\ue002])")
DIGIT = re.compile(r"(\]\([^)\s]*#)(?=\d)")  # a link to a heading that begins with one
PREFIX = "section-"  # of the name of such a heading


def on_files(files: Files, config: MkDocsConfig, **_: Any) -> Files:
    """Add the pages and pictures that live elsewhere in the repository, and a page of each finding."""
    for path in (*(ROOT / name for name in PAGES), *sorted((ROOT / "reports").glob("*.png"))):
        name = path.relative_to(ROOT).as_posix()
        files.append(File.generated(config, name, abs_src_path=str(path)))
    evidence = collect(BASELINES)
    for entry in LEDGER:
        files.append(File.generated(config, f"findings/{entry.id}.md", content=page(entry, evidence)))
    return files


def on_config(config: MkDocsConfig, **_: Any) -> MkDocsConfig:
    """Let the names of headings begin with a letter, which the theme's script expects."""
    config.mdx_configs["toc"] = {"slugify": _anchor}
    return config


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Follow links within the site, and keep formulas from Markdown."""
    inside = OUTSIDE.sub(r"\1", FINDING.sub("](findings/", markdown))
    inside = re.sub(r"\]\((\.\./)+(ARCHITECTURE|CONTRIBUTING|eos_ref|reports)", r"](\2", inside)
    inside = inside.replace("](docs/", "](")
    parts = CODE.split(inside)
    return "".join(part if part.startswith("`") else _kept(DIGIT.sub(rf"\1{PREFIX}", part)) for part in parts)


def on_page_content(html: str, **_: Any) -> str:
    """Set formulas in MathML, and let wide tables scroll."""
    html = html.replace("<table>", '<div class="wide"><table>').replace("</table>", "</table></div>")
    return KEPT.sub(_formula, html)


def on_post_build(config: MkDocsConfig, **_: Any) -> None:
    """Make a script of the index of the search: a page that is a file may read no other."""
    folder = Path(config.site_dir) / "search"
    index = (folder / "search_index.json").read_text(encoding="utf-8")
    (folder / "search_index.js").write_text(f"window.search_index = {index};\n", encoding="utf-8")
    for name in ("search_index.json", "worker.js"):
        (folder / name).unlink()


def _anchor(heading: str, separator: str) -> str:
    name = slugify(heading, separator)
    return PREFIX + name if name[:1].isdigit() else name


def _kept(text: str) -> str:
    """Put the letters of formulas out of reach of Markdown, which would take some for a list, a table or HTML."""
    return FORMULA.sub(lambda m: "\ue000" + (m[1] or m[2]).encode().hex() + ("\ue001" if m[1] else "\ue002"), text)


def _formula(kept: re.Match[str]) -> str:
    tex = bytes.fromhex(kept[1]).decode()
    if kept[2] == "\ue001":
        return f'<span class="formula">{convert(tex, display="block")}</span>'
    return str(convert(tex))
