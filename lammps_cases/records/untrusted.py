"""The one way in which files of unknown origin are opened: regular files, up to a size."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from eos_ref.errors import InputError

MIB = 2**20


def read_bytes(path: Path, what: str, most: int) -> bytes:
    """Return the content of a file; a fifo, a device or a file without end neither hangs nor fills the memory.

    Parameters
    ----------
    what : str
        The name of such a file in complaints.
    most : int
        Bytes that it may have.

    Raises
    ------
    InputError
        It cannot be read, is no regular file, or is larger.
    """
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)  # of a fifo, without waiting for a writer
        with os.fdopen(handle, "rb") as file:
            if not stat.S_ISREG(os.fstat(handle).st_mode):
                raise InputError(what, "must be a regular file", where=str(path))
            content = file.read(most + 1)
    except OSError as error:
        raise InputError(what, f"cannot be read: {error.strerror}", where=str(path)) from None
    except ValueError:  # a path with a null character
        raise InputError(what, "cannot be read: no name of a file", where=str(path)) from None
    if len(content) > most:
        raise InputError(what, f"must be at most {most / MIB:g} MiB", where=str(path))
    return content


def read_text(path: Path, what: str, most: int) -> str:
    """Return the text of a file; raises as `read_bytes`, and if it is not UTF-8."""
    try:
        return read_bytes(path, what, most).decode("utf-8")
    except UnicodeDecodeError:
        raise InputError(what, "must be UTF-8 text", where=str(path)) from None
