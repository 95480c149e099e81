"""The copy of a deck's folder in which an audit runs it."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from eos_ref.errors import InputError

LARGEST = 2 * 2**30  # bytes; a deck that lies in a home folder must not copy all of it


def copy_folder(source: Path, target: Path, largest: int = LARGEST) -> None:
    """Copy the files below a folder; links are followed, sockets and the like left out.

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
        if here.resolve() in done or (target.resolve().is_relative_to(here.resolve()) and here != source):
            folders.clear()  # a link that leads back, or the copy itself
            continue
        done.add(here.resolve())
        to = target / here.relative_to(source)
        to.mkdir(parents=True, exist_ok=True)
        for file in sorted(files):
            if not (here / file).is_file():
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
