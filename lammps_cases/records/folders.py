"""Folders that are replaced as a whole, by one program at a time.

A folder is made beside the one that it replaces, as ``.NAME.partial``; then the old one is moved aside, to
``.NAME.old``, the new one into its place, and the old one removed. A kill at any moment leaves the old folder or the
new one: after a kill between the two renames the old one lies aside, where `present` and `replacement` find it.

A folder in the making that holds a `JOURNAL` can be gone on with: if the program ends it becomes ``NAME.interrupted``.
"""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from eos_ref.errors import InputError

JOURNAL = "journal"  # in a folder in the making: what is done
INTERRUPTED = ".interrupted"  # the end of the name of a folder that was being made when its program ended

LONGEST_NAME = 255 - len(INTERRUPTED)  # bytes: that of the folder beside it has to be one of a file system


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
    from filelock import FileLock, Timeout  # heavy, and commands that write no folder import this module

    path = target.with_name(f".{target.name}.lock")
    lock = FileLock(path)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        if target.exists() and not os.access(target, os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
        lock.acquire(timeout=0 if busy else -1)
    except Timeout:  # also where no file can be made, as in /proc
        raise InputError(what, busy if path.exists() else "cannot be written", str(target)) from None
    except OSError as error:
        raise InputError(what, f"cannot be written: {error.strerror}", str(target)) from None
    try:
        yield
    finally:
        path.unlink(missing_ok=True)  # while it is held: whoever locks a file that is gone tries again
        lock.release()


@contextmanager
def replacement(target: Path, resume: bool | None = None) -> Iterator[Path]:
    """Yield a folder beside a target, for `swap`; the caller holds the lock of the target.

    Parameters
    ----------
    resume : bool, optional
        Whether to go on with a folder that was being made when its program ended, if there is one, instead of an
        empty one. Unless given, nothing is left of the folder, however the block ends.
    """
    partial = making(target)
    left = resumable(target) if resume else None
    if resume is not None and left != partial:
        _set_aside(partial, interrupted(target))
    _settle(target, None if left == partial else partial)
    if left is not None and left != partial:
        left.rename(partial)
    partial.mkdir(parents=True, exist_ok=True)
    try:
        yield partial
    finally:
        if resume is not None:
            _set_aside(partial, interrupted(target))
        _settle(target, partial)


def making(target: Path) -> Path:
    """Return where a folder is made."""
    return target.with_name(f".{target.name}.partial")


def interrupted(target: Path) -> Path:
    """Return where a folder lies that was being made when its program ended."""
    return target.with_name(f"{target.name}{INTERRUPTED}")


def target(folder: Path) -> Path:
    """Return the target of a folder in the making, wherever that lies; another folder is its own target."""
    name = folder.name.removesuffix(INTERRUPTED).removesuffix(".partial")
    return folder.with_name(name.removeprefix(".") if folder.name.endswith(".partial") else name)


def resumable(target: Path) -> Path | None:
    """Return the folder in the making that can be gone on with; after a kill it lies where it was made."""
    left = max((making(target), interrupted(target)), key=_done)
    return left if _done(left) else None


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
    shutil.rmtree(target / JOURNAL, ignore_errors=True)
    if (interrupted(target) / JOURNAL).is_dir():  # an earlier attempt
        shutil.rmtree(interrupted(target), ignore_errors=True)


def present(target: Path) -> Path:
    """Return where a folder lies: aside, if a program was killed while it replaced it."""
    return _aside(target) if _aside(target).exists() and not target.exists() else target


def _done(partial: Path) -> int:
    """Return the number of files in the journal of a folder in the making."""
    return sum(path.is_file() for path in (partial / JOURNAL).rglob("*"))


def _set_aside(partial: Path, place: Path) -> None:
    """Keep a folder in the making, unless one of which more is done, or something else, has its place."""
    if not _done(partial) or _done(partial) < _done(place):
        return
    if _done(place):
        shutil.rmtree(place)
    if not place.exists():
        partial.rename(place)


def _settle(target: Path, partial: Path | None) -> None:
    """Bring back what a kill between the two renames of `swap` left aside, and remove the rest."""
    if present(target) != target:
        _aside(target).rename(target)
    for leftover in filter(None, (partial, _aside(target))):
        shutil.rmtree(leftover, ignore_errors=True)


def _aside(target: Path) -> Path:
    return target.with_name(f".{target.name}.old")
