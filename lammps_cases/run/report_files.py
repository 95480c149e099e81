"""The folder of a report, which holds the earlier report until the new one is complete, and the files in it."""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from eos_ref import InputError
from lammps_cases.engine.workers import Failure, Workers
from lammps_cases.records import folders
from lammps_cases.records.documents import LARGEST
from lammps_cases.records.faults import part
from lammps_cases.records.files import read_bytes, write_atomically
from lammps_cases.records.run_record import HeadlineRecord, RunRecord
from lammps_cases.report import formats, history, markdown, page
from lammps_cases.report.findings import outcome
from lammps_cases.report.history import Past
from lammps_cases.report.page import Articles, Family, FamilyArticles, Making

WHAT = "output folder"
REPORT = {"run.json", "fields", "report.html", "summary.md", "junit.xml", folders.JOURNAL}
SHARES = 4  # tasks for each worker that make articles: the largest first, so that all end at about the same time
LIMIT = 600.0  # seconds allowed for such a task


@contextmanager
def output_folder(directory: Path, resume: bool | None = None) -> Iterator[Path]:
    """Yield a hidden folder that replaces ``directory`` on success; a kill at any moment leaves a whole report.

    ``resume`` is that of `folders.replacement`.

    Raises
    ------
    InputError
        It cannot be written, holds something other than a report, or another run is writing into it.
    """
    if len(os.fsencode(directory.name)) > folders.LONGEST_NAME:
        raise InputError(WHAT, f"must have a name of at most {folders.LONGEST_NAME} bytes", str(directory))
    if folders.is_link(directory):
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
    """Return whether a folder holds anything that is not an earlier report and would be lost with it."""
    names = {path.name for path in directory.iterdir()}
    if not names:
        return False
    try:
        ours = b'"schema": "eos-ref/run/' in read_bytes(directory / "run.json", "run", LARGEST)[:200]
    except InputError:
        return True
    fields = directory / "fields"
    return not ours or bool(names - REPORT) or (fields.exists() and any(p.suffix != ".npz" for p in fields.iterdir()))


def write_run(
    run: RunRecord,
    folder: Path,
    past: Past | None = None,
    making: Making | None = None,
) -> None:
    """Write run.json and the reports made from it; see `lammps_cases.report.formats.write_report`."""
    with _uncollected():
        made = lambda: formats.write_report(run, folder, history=past, making=making)  # noqa: E731
        if part("report", run.faults, made, None) is None:
            write_atomically(folder / "summary.md", formats.bare_summary(run))
            write_atomically(folder / "report.html", formats.bare_page(run))
        write_atomically(folder / "run.json", run.to_json())  # last: it lists what the report lacks


def write_kept_run(run: RunRecord, folder: Path, making: Making | None = None) -> None:
    """Write a run with the runs before it, and keep it in the user's history."""
    past = past_of(run)
    write_run(run, folder, past, making)
    before = len(run.faults)
    part("entry in the history", run.faults, lambda: history.collect(run, folder), None)
    if len(run.faults) > before:
        write_run(run, folder, past, making)


def past_of(run: RunRecord) -> Past | None:
    """Return the earlier runs that the report of a run shows."""
    return part("history", run.faults, lambda: history.past(run), None)


@contextmanager
def _uncollected() -> Iterator[None]:
    """Make a report without garbage collection: there is little garbage, and it would take a fifth of the time."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def write_partial(run: RunRecord, folder: Path) -> None:
    """Write the quickly made parts of the report of an interrupted run; ``eos-ref report`` makes the page."""

    def made() -> tuple[str, bytes]:
        of_run = outcome(run)
        run.headline = HeadlineRecord(state=of_run.headline.state, sentence=of_run.headline.sentence)
        return markdown.summary(of_run), formats.junit(of_run)

    summary, document = part("summary.md", run.faults, made, None) or (formats.bare_summary(run), None)
    write_atomically(folder / "run.json", run.to_json())
    write_atomically(folder / "summary.md", summary)
    if document:
        write_atomically(folder / "junit.xml", document)


def make_articles(site: str | None, families: Sequence[Family]) -> list[FamilyArticles]:
    """Task: return the packed articles of some families of cases."""
    return page.articles(families)


def begin_articles(workers: Workers, families: Sequence[Family]) -> Articles:
    """Start making the articles of a run; those that no worker delivers are made here when waited for."""
    shares = article_shares(families, SHARES * workers.count)
    futures = [workers.call(make_articles, [families[k] for k in share], time_limit=LIMIT) for share in shares]

    def made() -> list[FamilyArticles]:
        found: dict[int, FamilyArticles] = {}
        for share, future in zip(shares, futures, strict=True):
            texts = workers.outcome(future)
            if isinstance(texts, Failure) or any(lacking for _, lacking in texts):  # a worker's memory may be full
                texts = page.articles([families[k] for k in share])
            found.update(zip(share, texts, strict=True))
        return [found[k] for k in range(len(families))]

    return made


def article_shares(families: Sequence[Family], most: int) -> list[list[int]]:
    """Divide families, by their indices, into about equal shares, the largest first."""
    weights = [sum(entry.weight for entry in family.entries) for family in families]
    shares: list[list[int]] = [[] for _ in range(min(most, len(families)))]
    full = [0] * len(shares)
    for k in sorted(range(len(families)), key=lambda k: -weights[k]):
        least = full.index(min(full))
        shares[least].append(k)
        full[least] += weights[k]
    return shares
