"""The folder of a report, which holds the earlier report until the new one is complete."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from eos_ref import InputError
from lammps_cases.records import folders, kept, untrusted
from lammps_cases.records.documents import LARGEST

WHAT = "output folder"
REPORT = {"run.json", "fields", "report.html", "summary.md", "junit.xml", folders.JOURNAL}


@contextmanager
def output_folder(directory: Path, resume: bool | None = None) -> Iterator[Path]:
    """Yield a hidden folder that replaces ``directory`` on success; a kill at any moment leaves a whole report.

    ``resume`` is that of `folders.replacement`.

    Raises
    ------
    InputError
        It cannot be written, holds something else than a report, or another run is writing into it.
    """
    if len(os.fsencode(directory.name)) > folders.LONGEST_NAME:
        raise InputError(WHAT, f"must have a name of at most {folders.LONGEST_NAME} bytes", str(directory))
    if kept.is_link(directory):
        raise InputError(WHAT, "must not be a link to a report that is kept: leave --out out", str(directory))
    directory = directory.resolve()
    if directory in (Path.cwd(), *Path.cwd().parents):
        raise InputError(WHAT, "must not be the current folder or above it", str(directory))
    with (
        folders.exclusive(directory, WHAT, "another run is writing into it"),
        folders.replacement(directory, resume) as partial,
    ):
        if directory.exists() and (not directory.is_dir() or _foreign(directory)):
            raise InputError(WHAT, "must be empty or hold an earlier report and nothing else", str(directory))
        yield partial
        folders.swap(partial, directory)


def _foreign(directory: Path) -> bool:
    """Return whether a folder holds anything that is not an earlier report, which would be lost with it."""
    names = {path.name for path in directory.iterdir()}
    if not names:
        return False
    try:
        ours = b'"schema": "eos-ref/run/' in untrusted.read_bytes(directory / "run.json", "run", LARGEST)[:200]
    except InputError:
        return True
    fields = directory / "fields"
    return not ours or bool(names - REPORT) or (fields.exists() and any(p.suffix != ".npz" for p in fields.iterdir()))
