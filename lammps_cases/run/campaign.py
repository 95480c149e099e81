"""The main job: compare cases with LAMMPS, one after another through the workers, and write their report."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from eos_ref import InputError
from eos_ref.syntax.manual import Manual
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.store import Store
from lammps_cases.engine.installations import Engine
from lammps_cases.engine.session import EngineMissing
from lammps_cases.engine.workers import Failure, Workers
from lammps_cases.findings import LEDGER
from lammps_cases.records import folders, wording
from lammps_cases.records.faults import part
from lammps_cases.records.levels import FailOn
from lammps_cases.records.progress import SILENT, Progress, stage
from lammps_cases.records.run_record import CaseRecord, EngineRecord, RunRecord, Triage
from lammps_cases.report.findings import compare_with_ledger
from lammps_cases.run.flow import JUDGING, faulty, outcomes_of, record_case
from lammps_cases.run.judged import CaseJournal, RunStart, start
from lammps_cases.run.prepared_case import Kept, PreparedCase, discard, prepare
from lammps_cases.run.provenance import engine_record, run_record
from lammps_cases.run.report_files import (
    WHAT,
    begin_articles,
    output_folder,
    past_of,
    write_kept_run,
    write_partial,
    write_run,
)
from lammps_cases.scene import FromFile, casefile
from lammps_cases.scene.casefile import Case

OPENING = 30.0  # seconds that opening LAMMPS may take at least
AHEAD = 4  # cases in progress for each worker
KEPT = 1000  # above this many cases, keep only names in memory
MaybePrepared = PreparedCase | Case  # beyond `KEPT` cases the latter: checked, and prepared in its turn


@dataclass(frozen=True)
class Request:
    """Options of a run, as its record keeps them.

    Attributes
    ----------
    part : the name of a shard, and the identity it shares with the others (`lammps_cases.run.shards.divided`)
    allow : findings that never fail the run
    """

    command: str = ""
    fail_on: FailOn = "new"
    part: tuple[str, str] = ("", "")
    allow: Sequence[str] = ()

    @property
    def recorded(self) -> dict[str, Any]:
        """Return the fields of the record, except the command."""
        shard, divided = self.part
        allowed = dict.fromkeys(self.allow, "--allow")
        return {"fail_on": self.fail_on, "shard": shard, "divided": divided, "allowed": allowed}


@dataclass(frozen=True, eq=False)
class Running:
    """A case that LAMMPS is running."""

    ready: PreparedCase
    futures: list[Future[Any]]


@dataclass(frozen=True, eq=False)
class Judging:
    """A case whose answers are being judged."""

    ready: PreparedCase
    kept: Kept
    future: Future[CaseRecord]


def run_cases(
    cases: Sequence[Case],
    engine: Engine,
    jobs: int,
    directory: Path,
    request: Request | None = None,
    progress: Progress = SILENT,
    store: Store | None = None,
    resume: bool | None = None,
) -> RunRecord:
    """Run cases and write their report into a folder, which holds the earlier report until this one is complete.

    With a store, predictions of the reference are read from it and kept in it. With ``resume`` an interrupted run
    is resumed; None: the calling command has no such option.

    Raises
    ------
    InputError
        Bad case, or a folder that cannot be written or is in use.
    EngineMissing
        LAMMPS with RHEO is missing.
    KeyboardInterrupt
        With the location of the partial report, if any case is judged.
    """
    begin, request = time.perf_counter(), request or Request()
    with output_folder(directory, bool(resume)) as folder:
        campaign = Campaign(cases, folder, request, progress, store)
        try:
            with Workers(engine.site, max(1, min(jobs, len(cases)))) as workers:
                campaign.run_all(workers, engine)
                run = _finished(campaign, workers, begin)
            if lost := campaign.lost():
                cases_lost = wording.counted(len(lost), "judged case")
                rule = f"lost {cases_lost} during the run; --resume continues"
                raise InputError("output folder", rule, where=str(directory))
        except InputError as error:
            raise (error if error.where or not campaign.begun else error.at(str(directory))) from None
        except KeyboardInterrupt:
            if not (campaign.begun and campaign.collect()):
                raise
            write_partial(campaign.run(), folder)
            partial = folders.interrupted(directory) / "summary.md"
            judged = f"{len(campaign.judged)} of {wording.counted(len(cases), 'case')}"
            rest = "" if resume is None else "; the same command with --resume continues"
            raise KeyboardInterrupt(f"interrupted after {judged}: see {partial}{rest}") from None
    if store and run.predictions.computed:
        store.trim()
    return run


def _finished(campaign: Campaign, workers: Workers, begin: float) -> RunRecord:
    """Return the record of a campaign whose cases are judged, and write the report."""
    campaign.collect()  # also removes half-written files of killed workers
    run = campaign.run()
    run.triage = part("triage", run.faults, lambda: triaged(run, campaign.cases, campaign.folder, campaign.store), None)
    run.seconds = round(time.perf_counter() - begin, 3)
    with stage("report"):
        making = (lambda families: begin_articles(workers, families)) if workers.local else None
        write_kept_run(run, campaign.folder, making)
    return run


class Campaign:
    """Cases on their way through the workers, each kept in the journal of a folder once it is judged.

    Beyond `KEPT`, judged cases wait for the report in the journal, so that memory does not grow with them.

    Attributes
    ----------
    judged : the names of the cases that are judged
    records : those in memory: cases not in a journal, `KEPT` others, and all of them after `collect`
    """

    def __init__(
        self, cases: Sequence[Case], folder: Path, request: Request, progress: Progress, store: Store | None
    ) -> None:
        self.cases, self.folder, self.request = cases, folder, request
        self.progress, self.store = progress, store
        self.journal = CaseJournal(folder)
        self.begun = self.journal.begun()
        self.judged = set[str]()
        self.records: dict[str, CaseRecord] = {}
        self.collect()
        for name in [name for name, record in self.records.items() if record.harness_error]:  # by code fixed since
            self.records.pop(name)
            self.judged.remove(name)
        if len(self.judged) > KEPT:
            self.records.clear()

    def run_all(self, workers: Workers, engine: Engine) -> None:
        """Run and judge all cases that are not judged yet.

        Raises
        ------
        InputError
            A bad case, or a resumed run that differs.
        EngineMissing
        """
        workers.check_shared(self.folder)
        identity = workers.identify(_patience(self.cases))
        # Work independent of LAMMPS is done while it starts.
        with stage("preparing"):
            left = ordered(case for case in self.cases if case.name not in self.judged)
            # None is bad, as tests prove for shipped cases, which are prepared while LAMMPS runs others.
            rest = [case if case.shipped else _kept(prepare(case), k) for k, case in enumerate(left)]
        begun = run_record(EngineRecord(), self.request.command).model_copy(update=self.request.recorded)
        now = start(begun, self.cases)
        who = workers.outcome(identity)
        if isinstance(who, Failure):
            raise EngineMissing(f"LAMMPS cannot be opened, for any case: {wording.one_line(who.message)}")
        now.run.engine = answering = engine_record(engine, who)
        self.begun = self.journal.begin(now, self.judged)
        rest = [following(each, answering.manual) for each in rest]
        for ready, recorded in self._recorded(workers, rest, answering):
            record = workers.outcome(recorded)
            if isinstance(record, Failure):
                self.records[ready.case.name] = record = faulty(ready, answering, record)
            elif len(self.records) < KEPT:
                self.records[record.case] = record
            self.judged.add(ready.case.name)
            if self.store and len(self.judged) % KEPT == 0:
                self.store.trim()
            complaint = "" if record.as_expected else f"{record.verdict} {record.case}"
            self.progress.advance(len(self.judged), len(self.cases), record.case, complaint)

    def _recorded(
        self, workers: Workers, cases: Sequence[MaybePrepared], engine: EngineRecord
    ) -> Iterator[tuple[PreparedCase, Future[CaseRecord]]]:
        """Yield every case when it is recorded; no more are in progress than keep the workers busy.

        LAMMPS' runs of a case are tasks; its judgement, from the files with their answers, is another.
        """
        assert self.begun is not None
        judgements = replace(self.store, context=self.begun.code) if self.store else None
        waiting, running, judging = deque(cases), list[Running](), list[Judging]()
        while waiting or running or judging:
            while waiting and len(running) + len(judging) < AHEAD * workers.count:
                case = waiting.popleft()
                ready = case if isinstance(case, PreparedCase) else prepare(case)
                limit = ready.case.scene.engine.time_limit
                running.append(Running(ready, [workers.submit_for_task(job, limit) for job in ready.jobs]))
            runs = [future for each in running for future in each.futures if not future.done()]
            wait([*runs, *(each.future for each in judging)], None, FIRST_COMPLETED)
            for ended in [each for each in running if all(future.done() for future in each.futures)]:
                running.remove(ended)
                kept = outcomes_of(workers, ended.futures)
                task = self.folder, ended.ready, kept, engine, self.store, judgements
                judging.append(Judging(ended.ready, kept, workers.call(record_case, *task, time_limit=JUDGING)))
            for over in [each for each in judging if each.future.done()]:
                judging.remove(over)
                yield over.ready, over.future
                discard(over.kept)

    def collect(self) -> int:
        """Load judged cases that are not in memory; return how many cases are judged."""
        self.records = self.journal.records(self.records) if self.begun else {}
        self.judged.update(self.records)
        return len(self.judged)

    def lost(self) -> list[str]:
        """Return the judged cases whose entries in the journal are no longer complete."""
        return sorted({*self.journal.lost(self.records), *self.judged.difference(self.records)})

    def run(self) -> RunRecord:
        """Return the record of the judged cases."""
        assert self.begun is not None
        return run_of(self.begun, self.records)


def run_of(begun: RunStart, records: Mapping[str, CaseRecord]) -> RunRecord:
    """Return the record of a run that began with some cases, of which some are judged."""
    run = begun.run.model_copy(update={"faults": []})
    run.cases = sorted(records.values(), key=lambda record: record.case)
    run.missing = len(begun.cases) - len(run.cases)
    run.carried = part("carried findings", run.faults, lambda: compare_with_ledger(run), None)
    return run.counted()


def left(directory: Path) -> tuple[RunRecord, Path] | None:
    """Write the report of the judged cases of an interrupted or broken run; return it, and its folder.

    ``directory`` is the place of the report, or of the journal left by the run; None without such a run.

    Raises
    ------
    InputError
        Another run is writing there, or the journal is damaged.
    """
    target = folders.target(directory)
    if (directory == target and directory.exists()) or folders.resumable(target) is None:
        return None
    with (
        folders.exclusive(target, WHAT, "another run is writing into it"),
        folders.replacement(target, resume=True) as folder,
    ):
        journal = CaseJournal(folder)
        if (begun := journal.begun()) is None:
            raise InputError("journal", "is damaged: its run is unknown", where=str(directory))
        run = run_of(begun, journal.records())
        write_run(run, folder, past=past_of(run))
    return run, folders.interrupted(target)


def _kept(ready: PreparedCase, number: int) -> MaybePrepared:
    """Return a prepared case; with many cases, drop the parts that take half a millisecond to prepare again."""
    return ready if number < KEPT else ready.case


def following(each: MaybePrepared, manual: Manual) -> MaybePrepared:
    """Return a case prepared, or checked, for the version of the manual that the reference is to follow."""
    before = each.case if isinstance(each, PreparedCase) else each
    if (case := before.by(manual)) is before:
        return each
    ready = prepare(case)
    return ready if isinstance(each, PreparedCase) else case


def cases_of(run: RunRecord, paths: Sequence[Path] = ()) -> list[Case]:
    """Return the present cases: those shipped, and those of files named by a finished run or given."""
    named = [Path(source) for source in sorted({record.source for record in run.cases})]
    own = paths or [path for path in named if path.is_absolute() and path.is_file()]
    return [*casefile.load(), *(casefile.load(own) if own else [])]


def triaged(run: RunRecord, cases: Sequence[Case], folder: Path, store: Store | None = None) -> Triage | None:
    """Return the triage of a run from its arrays in the folder of its report; free for a green run."""
    if all(record.as_expected or record.limits for record in run.cases):
        return None
    from lammps_cases.verdict.diagnosis.triage import triage  # only a red run needs it

    return triage(run, cases, folder / "fields", Predictor(store))


def _patience(cases: Sequence[Case]) -> float:
    """Return how many seconds LAMMPS may take to open: a case's limit, or a busy machine's needs."""
    return max(OPENING, *(case.scene.engine.time_limit for case in cases))


def ordered(cases: Iterable[Case]) -> list[Case]:
    """Return cases in the order of submission: those that may kill a worker late, those that take long to read last.

    Cases known to kill one come after all others, which would have to open LAMMPS, and its ranks, again.
    """
    crashes = [entry for entry in LEDGER if entry.outcome == "crashed"]

    def order(case: Case) -> tuple[bool, bool, bool]:
        kills = any(entry.covers(case.name) for entry in crashes)
        return kills, isinstance(case.scene.positions, FromFile), case.scene.expect is not None

    return sorted(cases, key=order)
