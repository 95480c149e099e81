"""Pages as a browser unpacks them."""

from __future__ import annotations

import base64
import re
import zlib

_PART = re.compile(r'(<script type="text/plain" class="packed"[^>]*>)([A-Za-z0-9+/=]*)</script>')


def unpacked(page: str) -> str:
    """A page with every packed part replaced by its text; scripts are unchanged."""
    return _PART.sub(lambda part: zlib.decompress(base64.b64decode(part[2])).decode(), page)


def words(page: str) -> str:
    """The text of a page, one element a line; without head, scripts and pictures."""
    bare = re.sub(r"<(svg|style|script|head)\b.*?</\1>", "", page, flags=re.DOTALL)
    return re.sub(r"\s*\|[\s|]*", "\n", re.sub(r"<[^>]+>", "|", bare)).strip() + "\n"
