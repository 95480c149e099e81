"""What mkdocs does not do by itself: pages and pictures from outside docs/, and formulas that need no script."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[1]
PAGES = ("ARCHITECTURE.md", "CONTRIBUTING.md", "eos_ref/NUMERICS.md")
# A link to a file that is no page of the site is left as text.
OUTSIDE = re.compile(
    r"\[([^\]]+)\]\((?:\.\./)*"
    r"(?:LICENSE|CITATION\.cff|lammps_cases/[^)]*|tests/[^)]*|reports/[^)]*(?<!\.png)|\.github/[^)]*)\)"
)
CODE = re.compile(r"(```.*?```|`[^`\n]+`)", re.DOTALL)


def on_files(files: Files, config: MkDocsConfig, **_: Any) -> Files:
    """Add the pages and pictures that live elsewhere in the repository."""
    for path in (*(ROOT / page for page in PAGES), *sorted((ROOT / "reports").glob("*.png"))):
        name = path.relative_to(ROOT).as_posix()
        files.append(File.generated(config, name, abs_src_path=str(path)))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Follow links within the site, and set formulas in MathML."""
    inside = OUTSIDE.sub(r"\1", markdown)
    inside = re.sub(r"\]\((\.\./)+(ARCHITECTURE|CONTRIBUTING|eos_ref|reports)", r"](\2", inside)
    inside = inside.replace("](docs/", "](")
    parts = CODE.split(inside)
    return "".join(part if part.startswith("`") else _formulas(part) for part in parts)


def _formulas(text: str) -> str:
    text = re.sub(r"(?<=[^\n])\n(?=\$[^$])", " ", text)  # a line that begins with a formula would be a block of HTML
    text = re.sub(r"\$\$(.+?)\$\$", lambda m: convert(m[1], display="block"), text, flags=re.DOTALL)
    return re.sub(r"\$([^$\n]+)\$", lambda m: convert(m[1]), text)
