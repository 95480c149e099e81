"""Pages as a browser has them."""

from __future__ import annotations

import base64
import re
import zlib

_PART = re.compile(r'(<script type="text/plain" class="packed"[^>]*>)([A-Za-z0-9+/=]*)</script>')


def unpacked(page: str) -> str:
    """A page with the text of every packed part in the place of that part; scripts stay as they are."""
    return _PART.sub(lambda part: zlib.decompress(base64.b64decode(part[2])).decode(), page)
