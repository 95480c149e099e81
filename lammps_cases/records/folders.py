"""Folders that are replaced as a whole, by one program at a time.

A folder is made beside the one that it replaces, as ``.NAME.partial``; then the old one is moved aside, to
``.NAME.old``, the new one into its place, and the old one removed. A kill at any moment leaves the old folder or the
new one: after a kill between the two renames the old one lies aside, where `present` and `replacement` find it.
"""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from eos_ref.errors import InputError


@contextmanager
def exclusive(target: Path, what: str, busy: str = "") -> Iterator[None]:
    """Hold the lock of a folder, ``.NAME.lock`` beside it.

    Parameters
    ----------
    target : Path
        The folder; it need not exist.
    what, busy : str
        What a complaint calls the folder, and what it says if another program holds the lock; without the latter
        the lock is waited for.

    Raises
    ------
    InputError
        The folder cannot be written, or another program holds the lock.
    """
    from filelock import FileLock, Timeout

    path = target.with_name(f".{target.name}.lock")
    lock = FileLock(path)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        if target.exists() and not os.access(target, os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
        lock.acquire(timeout=0 if busy else -1)
    except Timeout:
        raise InputError(what, busy, str(target)) from None
    except OSError as error:
        raise InputError(what, f"cannot be written: {error.strerror}", str(target)) from None
    try:
        yield
    finally:
        path.unlink(missing_ok=True)  # while it is held: whoever locks a file that is gone tries again
        lock.release()


@contextmanager
def replacement(target: Path) -> Iterator[Path]:
    """Yield an empty folder beside a target, for `swap`; nothing is left of it, however the block ends.

    The caller holds the lock of the target.
    """
    partial = target.with_name(f".{target.name}.partial")
    _settle(target, partial)
    partial.mkdir(parents=True)
    try:
        yield partial
    finally:
        _settle(target, partial)


def swap(partial: Path, target: Path) -> None:
    """Put a folder into the place of another."""
    try:
        if target.exists():
            target.rename(_aside(target))
    except OSError:  # a mount point, say of a container, cannot be renamed: replace what is in it
        for path in target.iterdir():
            shutil.rmtree(path) if path.is_dir() else path.unlink()
        shutil.copytree(partial, target, dirs_exist_ok=True)
    else:
        partial.rename(target)


def present(target: Path) -> Path:
    """Return where a folder lies: aside, if a program was killed while it replaced it."""
    return _aside(target) if _aside(target).exists() and not target.exists() else target


def _settle(target: Path, partial: Path) -> None:
    """Bring back what a kill between the two renames of `swap` left aside, and remove the rest."""
    if present(target) != target:
        _aside(target).rename(target)
    for leftover in (partial, _aside(target)):
        shutil.rmtree(leftover, ignore_errors=True)


def _aside(target: Path) -> Path:
    return target.with_name(f".{target.name}.old")
