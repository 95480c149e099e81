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
    """Return the same of a text that many pages hold, kept in the user's cache, with a hash of both."""
    name = hashlib.sha256(text.encode()).hexdigest()
    file = cache_folder("packed") / name
    with contextlib.suppress(OSError, ValueError):
        hashed, _, kept = file.read_text(encoding="ascii").partition("\n")
        if hashed == _hash(name, kept):
            return Markup(kept)
    made = packed(text)
    with contextlib.suppress(OSError):
        replace_file(file, f"{_hash(name, made)}\n{made}")
    return made


def _hash(name: str, content: str) -> str:
    return hashlib.sha256(f"{name}\n{content}".encode()).hexdigest()
