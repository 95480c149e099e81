"""The copy of a deck's folder in which an audit runs it."""

from __future__ import annotations

import contextlib
import os
import shutil
from pathlib import Path

from eos_ref.errors import InputError

LARGEST = 2 * 2**30  # bytes; a deck that lies in a home folder must not copy all of it


def copy_folder(source: Path, target: Path, largest: int = LARGEST, links_out: bool = False) -> None:
    """Copy the files below a folder; sockets and the like are left out, and links that lead out of it.

    With ``links_out``, all links are followed.

    The copies belong to the user and can be written to, whatever the modes of the originals.

    Raises
    ------
    InputError
        More than ``largest`` bytes, or a file that cannot be read.
    """
    copied = 0
    done: set[Path] = set()
    for directory, folders, files in os.walk(source, followlinks=True):
        here = Path(directory)
        folders[:] = [name for name in folders if links_out or _is_within(source, here / name)]
        if here.resolve() in done or (target.resolve().is_relative_to(here.resolve()) and here != source):
            folders.clear()  # a link that leads back, or the copy itself
            continue
        done.add(here.resolve())
        to = target / here.relative_to(source)
        to.mkdir(parents=True, exist_ok=True)
        for file in sorted(files):
            if not (here / file).is_file() or not (links_out or _is_within(source, here / file)):
                continue
            copied += (here / file).stat().st_size
            if copied > largest:
                rule = (
                    f"must hold at most {largest / 2**20:.0f} MiB, as it is copied (give the deck a folder of its own)"
                )
                raise InputError("folder of the deck", rule, where=str(source))
            try:
                shutil.copyfile(here / file, to / file)
            except OSError as error:
                raise InputError(file, f"cannot be copied: {error.strerror}", where=str(here)) from None


def beside(source: Path, target: Path) -> Path:
    """Make and return the folder ``target/a/b`` for the copy of a source ``/a/b``.

    Whatever else the folders above the source hold is there as links, so that relative paths lead where they should.
    """
    here = target
    for folder, name in zip(reversed(source.parents), source.parts[1:], strict=True):
        with contextlib.suppress(OSError):  # a folder that may be entered, but not listed
            for other in folder.iterdir():
                if other.name != name:
                    (here / other.name).symlink_to(other)
        here = here / name
        here.mkdir()
    return here


def _is_within(folder: Path, path: Path) -> bool:
    return not path.is_symlink() or path.resolve().is_relative_to(folder)
