"""What a user may compare: engines, which are run, and folders of runs or of accepted baselines, which are read."""

from __future__ import annotations

import string
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path

from eos_ref import InputError
from lammps_cases.comparison.store import Store
from lammps_cases.engine import installations
from lammps_cases.engine.installations import Engine
from lammps_cases.records.progress import SILENT, Progress
from lammps_cases.regression import baseline, seen
from lammps_cases.regression.seen import Side
from lammps_cases.run import campaign
from lammps_cases.scene import casefile
from lammps_cases.scene.casefile import Case

FORMS = "must be an engine (env, pypi:VERSION, path:DIR), a report folder with run.json, or a baseline"
LABELS = string.ascii_uppercase  # of the sides, in the order given
WRITTEN = ("compare.json", "compare.html", "summary.md", "bisect.json")


@dataclass(frozen=True)
class Source:
    """One thing to compare: an engine, or a side that is known already."""

    name: str
    engine: Engine | None = None
    known: Side | None = None


def is_side(name: str) -> bool:
    """Whether a word names a side: an engine, or what has a slash or is a folder."""
    return installations.is_engine(name) or "/" in name or Path(name).is_dir()


def source(name: str) -> Source:
    """What a name means.

    Raises
    ------
    InputError
        Neither an engine nor a folder of a run or a baseline, or one that cannot be read.
    """
    if installations.is_engine(name):
        return Source(name, installations.resolve(name))
    folder = Path(name)
    if (folder / baseline.IDENTITY).exists():
        return Source(name, known=baseline.read(folder).side(name))
    if (folder / "run.json").exists():
        return Source(name, known=replace(seen.read(folder), name=name))
    inside = sorted(path.parent.name for path in folder.glob(f"*/{baseline.IDENTITY}"))
    rule = f"{FORMS}; the folder holds the baselines {', '.join(inside)}" if inside else FORMS
    raise InputError("side", rule, name)


def narrowed(side: Side, names: Sequence[str], tagged: Collection[str] | None) -> Side:
    """Return a side with only the cases of some names (see `lammps_cases.scene.casefile.select`) that are tagged.

    Raises
    ------
    InputError
        A name that no case of the side has, or no case left.
    """
    for name in names:
        if not any(_named(case, name) for case in side.cases):
            raise InputError("case", "is not in it", name, side.name)
    chosen = {
        name: case
        for name, case in side.cases.items()
        if (not names or any(_named(name, wanted) for wanted in names)) and (tagged is None or name in tagged)
    }
    if not chosen:
        raise InputError("cases", "none of those chosen is in it", where=side.name)
    return replace(side, cases=chosen)


def _named(case: str, wanted: str) -> bool:
    return fnmatchcase(case, wanted) or case.startswith(f"{wanted}.")


@dataclass(frozen=True)
class Running:
    """How engines are run."""

    jobs: int
    store: Store | None = None
    progress: Progress = SILENT


@dataclass(frozen=True)
class Asked:
    """Sources and the cases on which they are compared; an engine is run when its side is asked for.

    Attributes
    ----------
    known : the sides that are saved, by place
    cases : what an engine runs
    folder : every engine writes its report into a folder of this, named by its place in the alphabet
    """

    sources: tuple[Source, ...]
    known: Mapping[int, Side]
    cases: tuple[Case, ...]
    folder: Path
    how: Running

    def side(self, at: int) -> Side:
        """A side, by its place."""
        engine = self.sources[at].engine
        if engine is None:
            return self.known[at]
        folder, how = self.folder / LABELS[at], self.how
        command = campaign.command_line()
        done = campaign.run_cases(self.cases, engine, how.jobs, folder, command, progress=how.progress, store=how.store)
        return seen.of_run(done, folder, engine.name)


def ask(
    names: Sequence[str], cases: Sequence[str], tag: str | None, paths: Sequence[Path], folder: Path, how: Running
) -> Asked:
    """Sides by name, on the cases chosen by name and tag; engines run those that the saved sides hold.

    Raises
    ------
    InputError
        A side, a case or a tag that does not exist, or a saved side where an engine is about to write.
    """
    found = tuple(source(name) for name in names)
    chosen: list[Case] = []
    if tag is not None or any(each.engine for each in found):
        chosen = casefile.select(casefile.load(paths), cases, tag)
    tagged = {case.name for case in chosen} if tag is not None else None
    known = {at: narrowed(each.known, cases, tagged) for at, each in enumerate(found) if each.known}
    if known and chosen:
        held = {name for side in known.values() for name in side.cases}
        chosen = [case for case in chosen if case.name in held]
        if not chosen:
            raise InputError("cases", "none is in it", where=", ".join(side.name for side in known.values()))
    written = {(folder / LABELS[at]).resolve() for at, each in enumerate(found) if each.engine}
    for side in known.values():
        if Path(side.name).resolve() in written:
            raise InputError("side", "is where an engine is about to write: choose another --out", side.name)
    return Asked(found, known, tuple(chosen), output(folder), how)


def output(folder: Path) -> Path:
    """The folder of a comparison, cleared of what an earlier one wrote beside its runs.

    Raises
    ------
    InputError
        It holds anything else.
    """
    if folder.exists():
        killed = ("lock", "partial", "old")  # what a run leaves that could not clear up
        left = {f".{label}.{part}" for label in LABELS for part in killed}
        ours = {*WRITTEN, *LABELS, *left}
        foreign = {path.name for path in folder.iterdir()} - ours if folder.is_dir() else {folder.name}
        if foreign:
            rule = "must be empty or hold an earlier comparison and nothing else"
            raise InputError("output folder", rule, min(foreign), str(folder))
        for name in WRITTEN:
            (folder / name).unlink(missing_ok=True)
    return folder
