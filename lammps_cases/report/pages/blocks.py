"""Parts of a page as values, which one template renders: a page is a list of sections, each a list of blocks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from markupsafe import Markup

from lammps_cases.report.pages import frame


@dataclass(frozen=True)
class Paragraph:
    """Text; ``css``: about, note or warning."""

    kind: ClassVar = "paragraph"
    text: str
    css: str = "note"


@dataclass(frozen=True)
class Bullets:
    """A list."""

    kind: ClassVar = "bullets"
    items: Sequence[str]


@dataclass(frozen=True)
class Definitions:
    """Names with what they are."""

    kind: ClassVar = "terms"
    items: Mapping[str, str]


@dataclass(frozen=True)
class Picture:
    """A figure."""

    kind: ClassVar = "picture"
    image: Markup


@dataclass(frozen=True)
class PageRow:
    """A row of a table."""

    cells: Sequence[object]
    css: str = ""
    id: str = ""


@dataclass(frozen=True)
class PageTable:
    """A table; the title of a column of numbers begins with a #. ``label`` describes it to a screen reader."""

    kind: ClassVar = "table"
    columns: Sequence[str]
    rows: Sequence[PageRow | Sequence[object]]
    label: str = ""
    css: str = "points"


@dataclass(frozen=True)
class Details:
    """Blocks that a reader opens."""

    kind: ClassVar = "details"
    summary: str
    blocks: Sequence[Block]


@dataclass(frozen=True)
class Heading:
    """A heading within a section, with an address."""

    kind: ClassVar = "heading"
    text: str
    id: str = ""


@dataclass(frozen=True)
class Abreast:
    """Groups of blocks next to each other."""

    kind: ClassVar = "abreast"
    groups: Sequence[Sequence[Block]]


Block = Paragraph | Bullets | Definitions | Picture | PageTable | Details | Heading | Abreast


@dataclass(frozen=True)
class PageSection:
    """A part of the page that the navigation leads to; ``again``: the command that repeats it."""

    id: str
    title: str
    blocks: Sequence[Block]
    css: str = ""


def link(address: str, text: str) -> Markup:
    """Return a link."""
    return Markup('<a href="{}">{}</a>').format(address, text)


def code(text: str) -> Markup:
    """Return text as code."""
    return Markup("<code>{}</code>").format(text)


def page(
    name: str,
    title: str,
    sentence: str,
    lead: Sequence[Block],
    sections: Sequence[PageSection],
    *,
    engine: str,
    command: str,
    facts: Sequence[tuple[str, str]],
    status: str = "good",
    styles: Sequence[Path] = (),
    scripts: Sequence[Path] = (),
) -> str:
    """Render a page.

    Parameters
    ----------
    name : str
        The command that writes it.
    title, sentence : str
        Headline of the page; what it is about, for the index of the reports.
    lead : sequence of Block
        Before the navigation.
    command : str
        The command line that was run.
    facts : sequence of pairs
        Names and values below the headline.
    engine, status, styles, scripts
        See `frame.page`.
    """
    return frame.page(
        frame.SHARED,
        name,
        status,
        engine=engine,
        template="study",
        styles=styles,
        scripts=scripts,
        facts=facts,
        again=command,
        headline_text=title,
        sentence=sentence,
        lead=lead,
        sections=sections,
        navigation=[(section.id, section.title) for section in sections],
    )
