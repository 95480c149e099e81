"""Pages as a browser unpacks them, and as a person reads them."""

from __future__ import annotations

import base64
import json
import re
import zlib
from functools import cached_property
from html import unescape
from html.parser import HTMLParser
from typing import Any

_PART = re.compile(r'(<script type="text/plain" class="packed"[^>]*>)([A-Za-z0-9+/=]*)</script>')
_UNREAD = re.compile(r"<(script|style|svg|head)\b.*?</\1>", re.DOTALL)
_INLINE = re.compile(
    r"</?(?:a|abbr|b|bdi|button|code|em|i|input|label|option|select|small|span|strong|sub|sup|wbr)\b[^>]*>"
)


def unpacked(page: str) -> str:
    """A page with every packed part replaced by its markup; scripts are unchanged."""
    return _PART.sub(lambda part: zlib.decompress(base64.b64decode(part[2])).decode(), page)


def text_of(page: str) -> str:
    """The text of an unpacked page: a line for each block, the cells of a row in one; neither scripts nor pictures."""
    flat = re.sub(r"\s+", " ", _UNREAD.sub("", page))
    flat = re.sub(r"</t[hd]>", " | ", re.sub(r"<t[hd]\b[^>]*>", "", flat))
    lines = unescape(re.sub(r"<[^>]*>", "\n", _INLINE.sub("", flat))).splitlines()
    return "\n".join(line for each in lines if (line := " ".join(each.split())))


class Page(HTMLParser):
    """An unpacked page as a browser parses it.

    Attributes
    ----------
    elements : tags with their attributes
    open : what is not closed at the end, or closed without having been opened
    scripts : of every script its case, its class and its text
    """

    def __init__(self, html: str) -> None:
        super().__init__()
        self.elements, self.open = list[tuple[str, dict[str, str | None]]](), list[str]()
        self.scripts, self._case = list[tuple[str, str, str]](), ""
        self.feed(html)
        self.close()

    @cached_property
    def data(self) -> dict[str, Any]:
        """What the page draws of a case."""
        return {case: json.loads(text) for case, of, text in self.scripts if of == "data"}

    def all(self, name: str) -> list[str | None]:
        """The values of an attribute."""
        return [given[name] for _, given in self.elements if name in given]

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_startendtag(tag, attrs)
        given = self.elements[-1][1]
        if tag == "article":
            self._case = given.get("data-case") or ""
        if tag == "script":
            self.scripts.append((self._case, given.get("class") or "", ""))
        if tag not in ("meta", "input", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if self.open[-1:] == [tag]:
            self.open.pop()
        else:
            self.open.append(f"/{tag}")

    def handle_data(self, data: str) -> None:
        if self.open[-1:] == ["script"]:
            case, of, text = self.scripts[-1]
            self.scripts[-1] = case, of, text + data
