"""What mkdocs does not do by itself: pages from outside docs/ or from code, formulas, and a search without a server."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
from latex2mathml.converter import convert
from markdown.extensions.toc import slugify
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

import eos_ref
from lammps_cases.cli.main import DEV, FIRST, group
from lammps_cases.findings import LEDGER, Finding
from lammps_cases.report.markdown import text
from lammps_cases.versions.evidence import BASELINES, collect, page

ROOT = Path(__file__).parents[1]
PAGES = ("ARCHITECTURE.md", "CHANGELOG.md", "CONTRIBUTING.md", "eos_ref/NUMERICS.md")
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
ROLE = re.compile(r":math:`([^`]+)`|\\ ?:sup:`(\d)`|``([^`]+)``")  # in docstrings
HEADED = re.compile(r"^(\w[\w ]*)\n-{3,}$", re.MULTILINE)
TYPED = re.compile(r"^(\w[\w, ]*) :(?: (.*))?\n(?= )", re.MULTILINE)
ENTRY = re.compile(r"^(\w[\w, ]*)(?: :(.*)$|\n(?=    ))", re.MULTILINE)


def on_files(files: Files, config: MkDocsConfig, **_: Any) -> Files:
    """Add the pages and pictures that live elsewhere in the repository, and a page of each finding."""
    for path in (*(ROOT / name for name in PAGES), *sorted((ROOT / "reports").glob("*.png"))):
        name = path.relative_to(ROOT).as_posix()
        files.append(File.generated(config, name, abs_src_path=str(path)))
    evidence = collect(BASELINES)
    written = {f"findings/{entry.id}.md": with_formulas(page(entry, evidence), entry) for entry in LEDGER}
    for name, content in {**written, "commands.md": commands(), "api.md": api()}.items():
        files.append(File.generated(config, name, content=content))
    return files


def with_formulas(content: str, entry: Finding) -> str:
    """Return the page of a finding with its formulas in LaTeX."""
    tex = {text(words): formula for words, formula in entry.formulas.items()}
    words = "|".join(map(re.escape, sorted(tex, key=len, reverse=True)))
    return re.sub(words, lambda m: f"${tex[m[0]]}$", content) if tex else content


def commands() -> str:
    """Return the reference of the commands: what each prints with --help."""
    parts = ["# Commands\n", "Every command, with the output of `--help`.\n"]
    for title, names in {**FIRST, **DEV}.items():
        parts.append(f"## {'Everyday' if title == 'Commands' else title}\n")
        for name in names:
            command = group.get_command(click.Context(group), name)
            context = click.Context(command, info_name=f"eos-ref {name}", terminal_width=100, max_content_width=100)
            parts.append(f"### eos-ref {name}\n\n```text\n{command.get_help(context)}\n```\n")
    return "\n".join(parts)


def api() -> str:
    """Return the reference of what `eos_ref` exports: signatures and docstrings."""
    parts = ["# Python API\n", "Everything that `eos_ref` exports. [Python](python.md) has examples.\n"]
    for name in eos_ref.__all__:
        parts += _documented(f"eos_ref.{name}", getattr(eos_ref, name))
    return "\n".join(parts)


def _documented(name: str, of: Any) -> Iterator[str]:
    if not (inspect.isfunction(of) or inspect.isclass(of)):
        yield f"### {name}\n\n```python\n{of!r}\n```\n"
        return
    yield f"### {name}\n\n{_call(name.rpartition('.')[2], of)}\n{_prose(inspect.getdoc(of) or '')}\n"
    for word, method in inspect.getmembers(of, inspect.isfunction) if inspect.isclass(of) else ():
        if not word.startswith("_") and method.__doc__ and method.__module__.startswith(("eos_ref", "lammps_cases")):
            yield f"{_call(word, method)}\n{_prose(inspect.getdoc(method) or '')}\n"


def _call(name: str, of: Any) -> str:
    """Return a signature without annotations: types are in the docstring."""
    try:
        parameters = inspect.signature(of).parameters.values()
    except ValueError:  # an exception's, say
        return f"`{name}`\n"
    bare = inspect.Signature([each.replace(annotation=inspect.Parameter.empty) for each in parameters])
    return f"```python\n{name}{bare}\n```\n"


def _prose(docstring: str) -> str:
    """Return a docstring in Markdown: headings bold, entries as a list, roles as formulas and code."""
    roles = ROLE.sub(lambda m: f"${m[1]}$" if m[1] else f"<sup>{m[2]}</sup>" if m[2] else f"`{m[3]}`", docstring)
    typed = TYPED.sub(lambda m: f"\n- `{m[1]}`{f' ({m[2]})' if m[2] else ''}:\n", HEADED.sub(r"**\1**\n", roles))
    return ENTRY.sub(lambda m: f"\n- `{m[1]}`:{m[2] or chr(10)}", typed) + "\n"


def on_config(config: MkDocsConfig, **_: Any) -> MkDocsConfig:
    """Let the names of headings begin with a letter, which the theme's script expects."""
    config.mdx_configs["toc"] = {"slugify": _anchor}
    return config


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Follow links within the site, and keep formulas from Markdown."""
    inside = OUTSIDE.sub(r"\1", FINDING.sub("](findings/", markdown))
    inside = re.sub(r"\]\((\.\./)+(ARCHITECTURE|CHANGELOG|CONTRIBUTING|eos_ref|reports)", r"](\2", inside)
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
