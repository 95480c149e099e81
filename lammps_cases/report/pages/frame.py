"""The frame, style sheet and parts that all pages share; each page is one file that opens offline.

Parts that a reader may never open are compressed in the page, and unpacked by the browser when they are opened.
"""

from __future__ import annotations

import base64
import contextlib
import hashlib
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import jinja2
from markupsafe import Markup

from eos_ref.cache import cache_folder
from lammps_cases.records import wording
from lammps_cases.records.files import replace_file

SHARED = Path(__file__).parent / "assets"
FILTER = SHARED / "filter.js"  # script for pages that filter rows
PACKED = SHARED / "packed.js"  # script for pages with parts made by `packed`


def packed(text: str) -> Markup:
    """Return text in the zlib format as base64, for an element ``<script type="text/plain" class="packed">``.

    The class is ``packed script`` if the text is a script. ``packed.js`` reads it by the browser's DecompressionStream.
    """
    return Markup(base64.b64encode(zlib.compress(text.encode(), 6)).decode("ascii"))


def packed_once(text: str) -> Markup:
    """Return the same for a text on many pages, kept in the user's cache with a hash of both."""
    name = hashlib.sha256(text.encode()).hexdigest()
    file = cache_folder("packed") / name
    with contextlib.suppress(OSError, ValueError):
        hashed, _, kept = file.read_text(encoding="ascii").partition("\n")
        if hashed == _packed_hash(name, kept):
            return Markup(kept)
    made = packed(text)
    with contextlib.suppress(OSError):
        replace_file(file, f"{_packed_hash(name, made)}\n{made}")
    return made


def _packed_hash(name: str, content: str) -> str:
    return hashlib.sha256(f"{name}\n{content}".encode()).hexdigest()


@dataclass(frozen=True)
class TableCell:
    """A cell of a table: its text, its CSS classes, its tooltip, its link."""

    text: object
    css: str = ""
    title: str = ""
    link: str = ""


@dataclass(frozen=True)
class TableRow:
    """A row of a table, headed by a name; ``data`` are its ``data-`` attributes, for the page's script."""

    name: str
    cells: Sequence[TableCell | None]
    css: str = ""
    data: Mapping[str, str] = field(default_factory=dict)
    hidden: bool = False


def page(
    assets: Path,
    name: str,
    status: str = "",
    *,
    engine: str = "",
    date: str = "",
    template: str = "",
    styles: Sequence[Path] = (),
    scripts: Sequence[Path] = (),
    unpacked: Sequence[str] = (),
    filters: Mapping[str, Callable[..., object]] | None = None,
    **content: object,
) -> str:
    """Render a page; the same content gives the same bytes.

    Parameters
    ----------
    assets : Path
        Folder of the template ``NAME.html.j2``, which extends ``frame.html.j2``, and of ``NAME.css`` and ``NAME.js``,
        which the page embeds where they exist.
    name : str
        Of the page, and of the command that writes it.
    status : str
        Colour of the header: good, known, bad, empty or none.
    engine, date : str
        What the page is about and when it was measured, for the index of the reports.
    template : str
        Its name without ``.html.j2``, where it is not that of the page.
    styles, scripts : sequence of Path
        Additional ones, embedded before those of the page.
    unpacked : sequence of str
        Scripts that the page holds compressed.
    filters : mapping
        Of the page, with ``packed`` and ``number``, ``brief`` and ``counted`` of `lammps_cases.records.wording`.
    content
        The template's variables.
    """
    css = [SHARED / "page.css", *styles, assets / f"{name}.css"]
    embedded = [_script(path) for path in (*scripts, assets / f"{name}.js") if path.is_file()]
    environment = environment_of(assets)
    environment.filters |= filters or {}
    return environment.get_template(f"{template or name}.html.j2").render(
        command=name,
        status=status,
        about_engine=engine,
        about_date=date,
        css=Markup("\n".join(path.read_text(encoding="utf-8") for path in css if path.is_file())),
        policy=policy((*embedded, *unpacked)),
        scripts=embedded,
        **content,
    )


def environment_of(assets: Path) -> jinja2.Environment:
    """Return the environment that renders the templates of a folder: all they show is escaped text, never markup."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader([assets, SHARED]),
        # Compiling the templates takes a fifth of the time of a report.
        bytecode_cache=jinja2.FileSystemBytecodeCache(str(cache_folder("templates"))),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "number": wording.number,
        "brief": wording.brief,
        "counted": wording.counted,
        "packed": packed,
    }
    return environment


def policy(scripts: Iterable[str]) -> str:
    """Return a page's content-security policy: it loads nothing, and runs these scripts and no other."""
    hashes = (base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts)
    allowed = " ".join(f"'sha256-{each}'" for each in hashes) or "'none'"
    return (
        f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; img-src data: blob:; "
        "base-uri 'none'; form-action 'none'"
    )


def _script(path: Path) -> Markup:
    return Markup(path.read_text(encoding="utf-8").replace("</script", "<\\/script"))
