"""Where things are kept that can be made again."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import platformdirs


def cache_folder(name: str) -> Path:
    """Return a writable folder in the user's cache, or among the temporary files if that cannot be.

    Nothing depends on what is in it, so an unwritable home costs time and not a result.
    """
    fallback = Path(tempfile.gettempdir()) / f"eos-ref-{os.getuid()}"
    for root in (Path(platformdirs.user_cache_dir("eos-ref")), fallback):
        folder = root / name
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            return folder
    return Path(tempfile.mkdtemp(prefix="eos-ref-"))
