"""Where things are kept that can be made again."""

from __future__ import annotations

import os
import stat
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
            if root == fallback:
                _make_private(root)
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            return folder
    return Path(tempfile.mkdtemp(prefix="eos-ref-"))


def _make_private(folder: Path) -> None:
    """Make a folder that no one else can write to: what is read from there is believed, and compiled code is run.

    Raises
    ------
    OSError
        It is there already, as anybody may make one among the temporary files, and is another user's or open to others.
    """
    folder.mkdir(mode=0o700, exist_ok=True)
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o022:
        raise PermissionError(f"{folder} is not this user's own")
