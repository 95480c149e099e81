"""Parts of a page that a reader may never open: compressed in it, unpacked by the browser when they are opened."""

from __future__ import annotations

import base64
import contextlib
import hashlib
import zlib

from markupsafe import Markup

from eos_ref.cache import cache_folder
from lammps_cases.records.files import replace_file


def packed(text: str) -> Markup:
    """Return text in the zlib format as base64, for an element ``<script type="text/plain" class="packed">``.

    The class is ``packed script`` if the text is a script. ``packed.js`` reads it by the browser's DecompressionStream.
    """
    return Markup(base64.b64encode(zlib.compress(text.encode(), 6)).decode("ascii"))


def packed_once(text: str) -> Markup:
    """Return the same of a text that many pages hold, kept in the user's cache: to unpack it takes a tenth of the time.

    What was kept is taken if it unpacks to the text.
    """
    file = cache_folder("packed") / hashlib.sha256(text.encode()).hexdigest()
    with contextlib.suppress(OSError, ValueError, zlib.error):
        kept = file.read_text(encoding="ascii")
        if zlib.decompress(base64.b64decode(kept, validate=True)) == text.encode():
            return Markup(kept)
    made = packed(text)
    with contextlib.suppress(OSError):
        replace_file(file, made)
    return made
