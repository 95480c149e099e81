"""The main job: cases against LAMMPS, one after another through the workers, and everything a run leaves behind."""

from __future__ import annotations

import contextlib
import importlib
import os
import platform
import sys
import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eos_ref import EOSTable, InputError
from eos_ref.syntax.manual import Manual
from lammps_cases import history
from lammps_cases.comparison import prediction_keys
from lammps_cases.comparison.store import Store
from lammps_cases.engine.installations import Engine, library_sha256
from lammps_cases.engine.session import Answer, EngineMissing, Job
from lammps_cases.engine.workers import Failure, Workers, solve
from lammps_cases.records import folders, wording
from lammps_cases.records.files import write_arrays, write_atomically
from lammps_cases.records.progress import SILENT, Progress
from lammps_cases.records.run_record import CaseRecord, EngineRecord, FailOn, HarnessError, RunRecord, Triage
from lammps_cases.records.stages import stage, taken
from lammps_cases.run.case_journal import CaseJournal, start
from lammps_cases.run.output_folder import output_folder
from lammps_cases.scene import FromFile, Scene
from lammps_cases.scene.atoms import Atoms, build
from lammps_cases.scene.casefile import Case
from lammps_cases.setup import reference_side, twins
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan
from lammps_cases.setup.twins import Twin

if TYPE_CHECKING:  # judging is the workers' affair: this process starts sooner without
    from lammps_cases.comparison.predictor import Predictor
    from lammps_cases.history.reported import Past
    from lammps_cases.report.drawn import Drawn
    from lammps_cases.verdict.outcome import Arrays
    from lammps_cases.verdict.particle_model import Reason

JUDGING = 1800.0  # seconds that judging a case may take
OPENING = 30.0  # seconds that opening LAMMPS may take at least
AHEAD = 4  # cases under way for each worker
KEPT = 1000  # cases of which this process keeps particles, record and picture; of more it keeps the names
Outcomes = list[Answer | Failure]  # of a case's run, or of the original's and its twin's


@dataclass(frozen=True)
class PreparedCase:
    """A case ready to run: its particles and, unless LAMMPS is to refuse it, its laws."""

    case: Case
    eos: EOSTable | None
    atoms: Atoms
    twin: Twin | None = None

    @property
    def sides(self) -> list[tuple[Scene, Atoms]]:
        """The scene and its particles, or those of the original and its twin."""
        if self.twin is None:
            return [(self.case.scene, self.atoms)]
        return [(self.twin.scene, self.twin.atoms), (self.twin.other_scene, self.twin.other_atoms)]

    @property
    def jobs(self) -> list[Job]:
        """The jobs for LAMMPS: one, or those of the original and its twin."""
        return [job(scene, atoms, plan(scene)) for scene, atoms in self.sides]

    @property
    def reading_lists(self) -> list[Job]:
        """The same jobs, read at every step with the neighbour lists."""
        return [job(scene, atoms, plan(scene), every_step=True, lists=True) for scene, atoms in self.sides]


MaybePrepared = PreparedCase | Case  # beyond `KEPT` cases the latter: checked, and prepared when it is its turn


@dataclass(eq=False)
class UnderWay:
    """A case in the workers: its runs, then its judgement."""

    ready: PreparedCase
    futures: list[Future[Any]]
    judging: bool = False

    @property
    def done(self) -> bool:
        """Whether what it waits for is there."""
        return all(future.done() for future in self.futures)


def prepare(case: Case) -> PreparedCase:
    """Build a case's particles and laws, checking them against each other.

    Raises
    ------
    InputError
    """
    eos = None if case.scene.expect else case.scene.eos(case.where)
    atoms = build(case, eos)
    if case.scene.whole_model and not case.scene.expect:
        reference_side.state(case.scene, atoms, case.where)  # refuses what has no meaning before LAMMPS sees it
    return PreparedCase(case, eos, atoms, twins.make(case, atoms) if case.scene.twin else None)


def run_cases(
    cases: Sequence[Case],
    engine: Engine,
    jobs: int,
    directory: Path,
    command: str = "",
    fail_on: FailOn = "new",
    part: tuple[str, str] = ("", ""),
    progress: Progress = SILENT,
    store: Store | None = None,
    resume: bool | None = None,
) -> RunRecord:
    """Run cases and write their report into a folder, which holds the earlier report until this one is complete.

    With a store, predictions of the reference are taken from there and kept there. With ``resume`` a run that was
    interrupted is gone on with, or begun anew (False); unless it is given nothing is kept of one that is interrupted. A
    ``part`` is the name of a shard, and what it has in common with the others (`lammps_cases.run.shards.divided`).

    Raises
    ------
    InputError
        Bad case, or a folder that cannot be written or is in use.
    EngineMissing
        There is no LAMMPS with RHEO.
    KeyboardInterrupt
        With where the partial report is, if any of it is kept.
    """
    begin = time.perf_counter()
    options = {"fail_on": fail_on, "shard": part[0], "divided": part[1]}
    with output_folder(directory, resume) as folder:
        campaign = Campaign(cases, folder, options, progress, store)
        try:
            drawn = campaign.judge(engine, jobs, command)
            campaign.found()  # and what workers left half-written that were killed goes
            run = campaign.run()
            run.triage = triaged(run, cases, folder, store)
            run.seconds = round(time.perf_counter() - begin, 3)
            with stage("report"):
                write_run(run, folder, drawn, history.past(run))
            if lost := campaign.lost():
                rule = (
                    f"lost {wording.counted(len(lost), 'judged case')} while the run was made; --resume does the rest"
                )
                raise InputError("output folder", rule, where=str(directory))
        except InputError as error:
            raise (error if error.where or not campaign.begun else error.at(str(directory))) from None
        except KeyboardInterrupt:
            if resume is None or not campaign.found():
                raise
            write_partial(campaign.run(), folder)
            partial = folders.interrupted(directory) / "summary.md"
            judged = f"{len(campaign.judged)} of {wording.counted(len(cases), 'case')}"
            raise KeyboardInterrupt(f"interrupted after {judged}: see {partial}; --resume does the rest") from None
    history.collect(run, directory)
    if store and run.predictions.computed:
        store.trim()
    return run


class Campaign:
    """Cases on their way through the workers, each in the journal of a folder when it is judged.

    Its memory does not grow with the cases that are judged beyond `KEPT`, which wait for the report in the journal.

    Attributes
    ----------
    judged : the names of the cases that are judged
    records : those at hand: what no journal has, `KEPT` others, and all of them after `found`
    """

    def __init__(
        self, cases: Sequence[Case], folder: Path, options: Mapping[str, Any], progress: Progress, store: Store | None
    ) -> None:
        self.cases, self.folder, self.options = cases, folder, options
        self.progress, self.store = progress, store
        self.journal = CaseJournal(folder)
        self.begun = self.journal.begun()
        self.judged = set[str]()
        self.records: dict[str, CaseRecord] = {}
        if self.found() > KEPT:
            self.records.clear()

    def judge(self, engine: Engine, jobs: int, command: str) -> dict[str, Drawn]:
        """Judge all cases that are not; return what the page shows of them.

        Raises
        ------
        InputError
            A bad case, or a run that goes on as another.
        EngineMissing
        """
        drawn: dict[str, Drawn] = {}
        with Workers(engine.site, max(1, min(jobs, len(self.cases)))) as workers:
            workers.check_shared(self.folder)
            identity = workers.identify(patience := _patience(self.cases))
            with stage("preparing"):
                left = [case for case in sorted(self.cases, key=_last) if case.name not in self.judged]
                rest = [_kept(prepare(case), k) for k, case in enumerate(left)]  # none is bad
            importlib.import_module("lammps_cases.report.page")  # while LAMMPS starts
            who = workers.outcome(identity, patience)
            if isinstance(who, Failure):
                raise EngineMissing(f"LAMMPS cannot be opened, for any case: {wording.one_line(who.message)}")
            answering = engine_record(engine, who)
            now = provenance(answering, command).model_copy(update=self.options)
            self.begun = self.journal.begin(start(now, self.cases))
            rest = [by(each, answering.manual) for each in rest]
            for ready, verdict in self._judged(workers, rest, answering):
                judgement = workers.outcome(verdict, JUDGING)
                if isinstance(judgement, Failure):
                    self.records[ready.case.name] = record = unjudged(ready, judgement, answering)
                else:
                    record, shown = judgement
                    if len(self.records) < KEPT:
                        self.records[record.case], drawn[record.case] = record, shown
                self.judged.add(ready.case.name)
                if self.store and len(self.judged) % KEPT == 0:
                    self.store.trim()
                complaint = "" if record.as_expected else f"{record.verdict} {record.case}"
                self.progress.advance(len(self.judged), len(self.cases), record.case, complaint)
        return drawn

    def _judged(
        self, workers: Workers, cases: Sequence[MaybePrepared], engine: EngineRecord
    ) -> Iterator[tuple[PreparedCase, Future[tuple[CaseRecord, Drawn]]]]:
        """Yield every case with its judgement when that is there; no more are under way than keep the workers busy."""
        waiting, under_way = deque(cases), list[UnderWay]()
        while waiting or under_way:
            while waiting and len(under_way) < AHEAD * workers.count:
                case = waiting.popleft()
                ready = case if isinstance(case, PreparedCase) else prepare(case)
                limit = ready.case.scene.engine.time_limit
                under_way.append(UnderWay(ready, [workers.submit(one, limit) for one in ready.jobs]))
            wait([future for each in under_way for future in each.futures if not future.done()], None, FIRST_COMPLETED)
            for each in [each for each in under_way if each.done]:
                if each.judging:
                    under_way.remove(each)
                    yield each.ready, each.futures[0]
                else:
                    task = self.folder, each.ready, answers(workers, each.ready, each.futures), engine, self.store
                    each.futures, each.judging = [workers.call(report, *task, time_limit=JUDGING)], True

    def found(self) -> int:
        """Look for cases that were judged and are not at hand; return how many are judged."""
        self.records = self.journal.records(self.records) if self.begun else {}
        self.judged.update(self.records)
        return len(self.judged)

    def lost(self) -> list[str]:
        """Return the cases that were judged and of which the journal has no more all there was."""
        return sorted({*self.journal.lost(self.records), *self.judged.difference(self.records)})

    def run(self) -> RunRecord:
        """Return the record of the cases that are judged."""
        from lammps_cases.report.findings import carried_over

        assert self.begun is not None
        run = self.begun.run.model_copy()
        run.cases = sorted(self.records.values(), key=lambda record: record.case)
        run.missing = len(self.cases) - len(run.cases)
        run.carried = carried_over(run)
        return run.counted()


def _kept(ready: PreparedCase, number: int) -> MaybePrepared:
    """Return a prepared case; of many, what takes half a millisecond to prepare once more."""
    return ready if number < KEPT else ready.case


def by(each: MaybePrepared, manual: Manual) -> MaybePrepared:
    """Return a case prepared, or checked, by the manual's version that the reference is to follow."""
    before = each.case if isinstance(each, PreparedCase) else each
    if (case := before.by(manual)) is before:
        return each
    ready = prepare(case)
    return ready if isinstance(each, PreparedCase) else case


def cases_of(run: RunRecord, paths: Sequence[Path] = ()) -> list[Case]:
    """Return the cases that there are now: those shipped, and those of files that a finished run names or of others."""
    from lammps_cases.scene import casefile

    named = [Path(source) for source in sorted({record.source for record in run.cases})]
    own = paths or [path for path in named if path.is_absolute() and path.is_file()]
    return [*casefile.load(), *(casefile.load(own) if own else [])]


def triaged(run: RunRecord, cases: Sequence[Case], folder: Path, store: Store | None = None) -> Triage | None:
    """Return the triage of a run from its arrays in the folder of its report; a green run costs nothing."""
    if all(record.as_expected for record in run.cases):
        return None
    from lammps_cases.comparison.predictor import Predictor
    from lammps_cases.diagnosis.triage import triage

    return triage(run, cases, folder / "fields", Predictor(store))


def report(
    site: str | None, folder: Path, ready: PreparedCase, outcomes: Outcomes, engine: EngineRecord, store: Store | None
) -> tuple[CaseRecord, Drawn]:
    """Task: judge a case, write its arrays and its entry in the journal, and take from them what the page shows."""
    from lammps_cases.report.drawn import beside_file, drawn, split

    with stage("comparison"):
        record, arrays = judge(site, ready, outcomes, engine, store)
    with stage("report"):
        arrays, beside = split(arrays)
        shown = drawn(record, arrays, beside)
    if arrays:
        with stage("writing"):
            write_arrays(folder / "fields" / f"{record.case}.npz", arrays)
            if beside:
                write_arrays(beside_file(folder / "fields", record.case), beside)
        if not record.as_expected and ready.case.scene.whole_model and ready.twin is None:
            from lammps_cases.diagnosis import answers as kept

            assert isinstance(outcomes[0], Answer)
            kept.keep(folder / "fields", record.case, ready.case.scene, outcomes[0])
    record.seconds.stages = taken()
    CaseJournal(folder).keep(record)
    return record, shown


def judge(
    site: str | None, ready: PreparedCase, outcomes: Outcomes, engine: EngineRecord, store: Store | None = None
) -> tuple[CaseRecord, Arrays]:
    """Judge a case; a fault of the harness costs its case alone, as one of LAMMPS does."""
    from lammps_cases.comparison.prediction_keys import current
    from lammps_cases.comparison.predictor import Predictor
    from lammps_cases.verdict.exercise import exercised
    from lammps_cases.verdict.looks import pair_arrays
    from lammps_cases.verdict.outcome import blank_record, sampled

    predictor = Predictor(store if store and current(store) else None)
    exercises: dict[str, int] = {}
    try:
        with stage("exercises"):
            exercises = exercised(ready.case, ready.atoms, predictor)
        record, arrays = _evaluated(ready, outcomes, engine, predictor)
    except Exception as error:
        record, arrays = blank_record(ready.case, ready.eos, ready.atoms, engine), {}
        faulty(record, HarnessError(exception=type(error).__name__, text=str(error)))
    compared = bool(arrays) and ready.case.scene.whole_model
    with contextlib.suppress(Exception):  # the verdict stands, whatever becomes of the search for its reason
        if compared and (looked := with_lists(site, ready, outcomes, record)):
            record, arrays = _evaluated(ready, looked, engine, predictor)
    with contextlib.suppress(Exception):
        searched = compared and record.verdict == "differs" and ready.twin is None
        if searched and (reason := first_step_outside(site, ready, engine.distribution, predictor)):
            record.blame, record.beyond = reason.first, reason.beyond
            record.message = wording.message(record)
    with contextlib.suppress(Exception), stage("pairs"):
        if compared:
            steps = ready.twin.steps if ready.twin else ready.case.scene.snapshots
            arrays |= pair_arrays(record, *ready.sides[0], ready.case.where, steps, predictor)
    record.exercises = exercises
    if record.unexercised:
        record.verdict = "error" if record.as_expected else record.verdict  # a difference comes first
        record.message = wording.message(record)
    return record, sampled(arrays)


def _evaluated(
    ready: PreparedCase, outcomes: Outcomes, engine: EngineRecord, predictor: Predictor
) -> tuple[CaseRecord, Arrays]:
    from lammps_cases.verdict.judgement import evaluate
    from lammps_cases.verdict.twins import evaluate_twin

    if ready.twin is not None:
        return evaluate_twin(ready.case, ready.twin, outcomes, engine, predictor)
    return evaluate(ready.case, ready.eos, ready.atoms, outcomes[0], engine, predictor)


def _explained_blindly(record: CaseRecord) -> bool:
    """Return whether a finding explains a case that would predict more if LAMMPS' lists of neighbours were read."""
    from lammps_cases.findings import LEDGER

    variants = (entry.model_variant for entry in LEDGER if entry.id in record.findings)
    return any(variant is not None and variant.lists for variant in variants)


def with_lists(site: str | None, ready: PreparedCase, outcomes: Outcomes, record: CaseRecord) -> Outcomes:
    """Run LAMMPS again for its neighbour lists, read at every step; nothing if they would not change the verdict."""
    from lammps_cases.verdict.model_cases import asks_for_lists

    if record.verdict != "differs" and not _explained_blindly(record):
        return []
    if not any(asks_for_lists(ready.case, scene, atoms) for scene, atoms in ready.sides):
        return []
    return listed(site, ready, outcomes, ready.reading_lists)


def listed(site: str | None, ready: PreparedCase, outcomes: Outcomes, reading: Sequence[Job]) -> Outcomes:
    """Return the outcomes of a case with the lists of the same runs, read at every step; nothing if they are others."""
    found: Outcomes = []
    for (scene, _), outcome, every_step in zip(ready.sides, outcomes, reading, strict=True):
        if isinstance(outcome, Failure):
            return []
        again = solve(site, every_step)
        compared = zip(scene.snapshots, outcome.snapshots, strict=True)
        if not all(_same(arrays, again.snapshots[step]) for step, arrays in compared):
            return []  # another run than the one judged: its lists say nothing
        found.append(replace(outcome, lists=again.lists))
    return found


def _same(arrays: Arrays, others: Arrays) -> bool:
    """Return whether two runs have their particles, of which lists follow, in the same places."""
    return all(arrays[name].tobytes() == others[name].tobytes() for name in ("id", "x"))


def first_step_outside(site: str | None, ready: PreparedCase, engine: str, predictor: Predictor) -> Reason | None:
    """Run a case that differs once more and read every step, to blame the first one."""
    scene = ready.case.scene
    if scene.snapshots[-1] <= 1:
        return None
    from lammps_cases.verdict.model_cases import asks_for_lists, first_step

    lists = asks_for_lists(ready.case, scene, ready.atoms)
    every_step = job(scene, ready.atoms, plan(scene), every_step=True, lists=lists)
    return first_step(ready.case, ready.atoms, solve(site, every_step), engine, predictor)


def answers(workers: Workers, ready: PreparedCase, futures: Sequence[Future[Answer]]) -> Outcomes:
    """Wait for the runs of a case."""
    limit = ready.case.scene.engine.time_limit
    outcomes: Outcomes = []
    for future in futures:
        outcome = workers.outcome(future, limit)
        outcomes.append(outcome)
    return outcomes


def unjudged(ready: PreparedCase, failure: Failure, engine: EngineRecord) -> CaseRecord:
    """Return the record of a case whose judgement failed."""
    from lammps_cases.verdict.outcome import blank_record

    return faulty(blank_record(ready.case, ready.eos, ready.atoms, engine), HarnessError(text=failure.message))


def faulty(record: CaseRecord, fault: HarnessError) -> CaseRecord:
    """Turn the record of a case into that of a fault of the harness."""
    record.verdict, record.ended, record.harness_error = "error", "error", fault
    record.message = wording.message(record)
    return record


def _patience(cases: Sequence[Case]) -> float:
    """Return how many seconds LAMMPS may take to be opened: what a case may, and what a busy machine needs."""
    return max(OPENING, *(case.scene.engine.time_limit for case in cases))


def _last(case: Case) -> int:
    """Return the order of submission: cases that may kill a worker late, those that take long to read last."""
    return 2 * isinstance(case.scene.positions, FromFile) + (case.scene.expect is not None)


def engine_record(engine: Engine, who: dict[str, str] | Failure) -> EngineRecord:
    """Return who answered (nothing is known of one that died), with the hash of its library."""
    identity = {} if isinstance(who, Failure) else who
    return EngineRecord(name=engine.name, library_sha256=library_sha256(identity.get("library", "")), **identity)


def provenance(engine: EngineRecord, command: str) -> RunRecord:
    """Return a run without cases: versions, machine, date, command."""
    from importlib.metadata import version

    packages = {"eos-ref": "eos-ref", "numpy": "numpy", "numba": "numba", "python-flint": "python-flint"}
    return RunRecord(
        engine=engine,
        reference={"python": platform.python_version(), **{name: version(name) for name in packages}},
        machine={
            "system": f"{platform.system()} {platform.release()}",
            "processor": platform.processor() or platform.machine(),
            "cores": str(os.cpu_count()),
            "kind": prediction_keys.processor(),
        },
        date=time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        command=command,
    )


def write_run(run: RunRecord, folder: Path, drawn: Mapping[str, Drawn] | None = None, past: Past | None = None) -> None:
    """Write run.json and the reports made from it; ``drawn`` and ``past`` as in `lammps_cases.report.write_report`."""
    from lammps_cases.report import write_report

    write_atomically(folder / "run.json", run.to_json())
    write_report(run, folder, drawn=drawn, history=past)


def write_partial(run: RunRecord, folder: Path) -> None:
    """Write what there is in a moment of the report of an interrupted run; ``eos-ref report`` makes the page."""
    from lammps_cases.report import junit, markdown
    from lammps_cases.report.findings import outcome

    of_run = outcome(run)
    write_atomically(folder / "run.json", run.to_json())
    write_atomically(folder / "summary.md", markdown.summary(of_run))
    write_atomically(folder / "junit.xml", junit.document(of_run))


def command_line() -> str:
    """Return the command as the user typed it, without the folder of the program."""
    import shlex

    return shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])
