"""What the pages share: one frame, one style sheet; each is one file that opens offline."""

from __future__ import annotations

from pathlib import Path

import jinja2
from markupsafe import Markup

from lammps_cases.records import wording

SHARED = Path(__file__).parent / "assets"


def environment(assets: Path) -> jinja2.Environment:
    """Templates of a folder, beside those that pages share: ``frame.html.j2`` is what a page extends.

    The filters ``number``, ``brief`` and ``counted`` are those of `lammps_cases.records.wording`.
    """
    loader = jinja2.FileSystemLoader([assets, SHARED])
    made = jinja2.Environment(loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True)
    made.filters |= {"number": wording.number, "brief": wording.brief, "counted": wording.counted}
    return made


def style(*own: Path) -> Markup:
    """The shared style sheet, and a page's own."""
    return Markup("\n".join(path.read_text(encoding="utf-8") for path in (SHARED / "page.css", *own)))


def script(path: Path) -> Markup:
    """A script as it may stand in a page."""
    return Markup(path.read_text(encoding="utf-8").replace("</script", "<\\/script"))
