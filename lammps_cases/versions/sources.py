"""Sides that a user may compare: engines, which are run, and folders of runs or accepted baselines, which are read."""

from __future__ import annotations

import string
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path

from eos_ref import InputError
from lammps_cases.comparison.store import Store, open_store
from lammps_cases.engine import forkserver, installations
from lammps_cases.engine.installations import Engine
from lammps_cases.records.progress import SILENT, Progress
from lammps_cases.records.run_record import RunRecord
from lammps_cases.run import campaign, provenance
from lammps_cases.scene import casefile
from lammps_cases.scene.casefile import Case
from lammps_cases.versions import baseline, outcomes
from lammps_cases.versions.outcomes import Side

FORMS = "must be an engine (env, pypi:VERSION, path:DIR), a report folder with run.json, or a baseline"
LABELS = string.ascii_uppercase  # of the sides, in the order given
Judge = Callable[[Engine, Path], RunRecord]
WRITTEN = ("compare.json", "compare.html", "summary.md", "bisect.json")


def is_side(name: str) -> bool:
    """Return whether a word names a side: an engine, a folder, or any word with a slash."""
    return installations.is_engine(name) or "/" in name or Path(name).is_dir()


def source(name: str) -> Engine | Side:
    """Return the engine to run, or the side in a folder, that a name denotes.

    Raises
    ------
    InputError
        Neither an engine nor a folder of a run or a baseline, or an unreadable one.
    """
    if installations.is_engine(name):
        return installations.resolve(name)
    folder = Path(name)
    if (folder / baseline.IDENTITY).exists():
        return baseline.read(folder, name)
    if (folder / "run.json").exists():
        return replace(outcomes.read(folder), name=name)
    inside = sorted(path.parent.name for path in folder.glob(f"*/{baseline.IDENTITY}"))
    rule = f"{FORMS}; the folder holds the baselines {', '.join(inside)}" if inside else FORMS
    raise InputError("side", rule, name)


def narrowed(side: Side, names: Sequence[str], tagged: Collection[str] | None) -> Side:
    """Return a side with only the cases of some names (see `lammps_cases.scene.casefile.select`) and tags.

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


def _without(side: Side, names: Collection[str]) -> Side:
    return replace(side, cases={name: case for name, case in side.cases.items() if name not in names})


def _named(case: str, wanted: str) -> bool:
    return fnmatchcase(case, wanted) or case.startswith(f"{wanted}.")


@dataclass(frozen=True)
class RunTerms:
    """Settings for the runs of engines."""

    jobs: int
    store: Store | None = None
    progress: Progress = SILENT
    command: str = ""
    judge: Judge | None = None  # instead of running cases


def run_options(
    names: Sequence[str], jobs: int, fresh: bool, progress: Progress = SILENT, command: str = ""
) -> RunTerms:
    """Return the settings for the engines among some sides, and start the process that forks their workers."""
    if any(map(installations.is_engine, names)):  # saved sides need no workers
        forkserver.start_for_judging()
    return RunTerms(jobs, open_store(fresh), progress, command or provenance.command_line())


@dataclass(frozen=True)
class Sources:
    """Engines and saved sides, and the cases to compare them on; an engine is run when its side is needed.

    Attributes
    ----------
    cases : the cases that an engine runs
    folder : every engine writes its report into a subfolder, named by a letter of the alphabet
    """

    each: tuple[Engine | Side, ...]
    cases: tuple[Case, ...]
    folder: Path
    options: RunTerms

    def side(self, at: int) -> Side:
        """Return a side by its index; that of an engine after a run."""
        engine = self.each[at]
        if isinstance(engine, Side):
            return engine
        folder, how = self.folder / LABELS[at], self.options
        if how.judge is not None:
            return outcomes.of_run(how.judge(engine, folder), folder, engine.name)
        run = campaign.run_cases(
            self.cases, engine, how.jobs, folder, campaign.Request(how.command), how.progress, how.store
        )
        return outcomes.of_run(run, folder, engine.name)


def select(
    names: Sequence[str],
    cases: Sequence[str],
    tag: str | None,
    paths: Sequence[Path],
    folder: Path,
    options: RunTerms,
) -> Sources:
    """Return sides by name, on the cases chosen by name and tag; engines run the cases of the saved sides.

    Raises
    ------
    InputError
        A side, a case or a tag that does not exist, or a saved side where an engine is about to write.
    """
    each = [source(name) for name in names]
    engines = [at for at, one in enumerate(each) if not isinstance(one, Side)]
    of_cases = options.judge is None and (tag is not None or engines)
    every = casefile.ALL if len(engines) < len(each) else None  # saved sides hold the cases that they were run with
    chosen = casefile.select(casefile.load(paths), cases, tag or every) if of_cases else []
    tagged = {case.name for case in chosen} if tag is not None else None
    each = [narrowed(one, cases, tagged) if isinstance(one, Side) else one for one in each]
    # A side that was run without the cases tagged more does not miss them.
    beyond = casefile.more() - casefile.more().intersection(*(one.cases for one in each if isinstance(one, Side)))
    each = [_without(one, beyond) if isinstance(one, Side) else one for one in each]
    saved = [one for one in each if isinstance(one, Side)]
    if saved and chosen:
        held = {name for side in saved for name in side.cases}
        chosen = [case for case in chosen if case.name in held]
        if not chosen:
            raise InputError("cases", "none is in it", where=", ".join(side.name for side in saved))
    written = {(folder / LABELS[at]).resolve() for at in engines}
    for side in saved:
        if Path(side.name).resolve() in written:
            raise InputError("side", "is where an engine is about to write: choose another --out", side.name)
    return Sources(tuple(each), tuple(chosen), output(folder), options)


def output(folder: Path) -> Path:
    """Return the folder of a comparison, without what an earlier comparison wrote in addition to its runs.

    Raises
    ------
    InputError
        It holds anything else.
    """
    if folder.exists():
        killed = ("lock", "partial", "old")  # left by a run that could not clear up
        left = {f".{label}.{part}" for label in LABELS for part in killed}
        ours = {*WRITTEN, *LABELS, *left}
        foreign = {path.name for path in folder.iterdir()} - ours if folder.is_dir() else {folder.name}
        if foreign:
            rule = "must be empty or hold an earlier comparison and nothing else"
            raise InputError("output folder", rule, min(foreign), str(folder))
        for name in WRITTEN:
            (folder / name).unlink(missing_ok=True)
    return folder
