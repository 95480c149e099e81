"""Case files as tests: what ``pytest --eos-ref`` collects, and the report of a case that fails."""

from __future__ import annotations

import keyword
import re
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import pytest
from _pytest._code.code import ReprEntryNative, ReprExceptionInfo, ReprFileLocation, ReprTraceback

from eos_ref import InputError
from lammps_cases.comparison.store import Store
from lammps_cases.engine import forkserver
from lammps_cases.engine.installations import Engine
from lammps_cases.engine.session import EngineMissing
from lammps_cases.engine.workers import Failure, Workers
from lammps_cases.findings import LEDGER, severities
from lammps_cases.records import wording
from lammps_cases.records.levels import FailOn, fails
from lammps_cases.records.run_record import CaseRecord, EngineRecord
from lammps_cases.report.annotations import case_lines
from lammps_cases.run.flow import JUDGING, faulty, judge, outcomes_of
from lammps_cases.run.prepared_case import prepare
from lammps_cases.run.provenance import engine_record
from lammps_cases.scene import casefile
from lammps_cases.scene.casefile import Case
from lammps_cases.verdict import case_arrays

# Tags that must not become marks of the same name: those would skip a case, or are words of -m.
TAKEN = {"filterwarnings", "parametrize", "skip", "skipif", "usefixtures", "xfail", *keyword.kwlist}


class NotAsExpected(Exception):
    """A case that leaves the session red."""

    def __init__(self, record: CaseRecord) -> None:
        super().__init__(record.message)
        self.record = record


class Abandoned(Exception):
    """Work that was begun but not finished."""


class CaseJudge:
    """One LAMMPS process for all cases, and their judgement; ``folder`` receives the arrays of a report."""

    def __init__(self, engine: Engine, store: Store, fail_on: FailOn) -> None:
        self.store = store
        self.fail_on = fail_on
        self.folder: Path | None = None
        self.engine = EngineRecord(name=engine.name)
        self._engine = engine
        self._workers: Workers | None = None
        self._resources = ExitStack()

    def start(self) -> None:
        """Start LAMMPS unless it is running.

        Raises
        ------
        EngineMissing
        """
        if self._workers is None:
            forkserver.preload("lammps_cases.verdict.cases")
            self._workers = self._resources.enter_context(Workers(self._engine.site, 1))
        if not self.engine.version_string:
            who = self._workers.outcome(self._workers.identify())
            self.engine = engine_record(self._engine, who)

    def record(self, case: Case) -> CaseRecord:
        """Run a case and judge it, after `start`.

        Raises
        ------
        InputError
            The scene is not valid.
        """
        assert self._workers is not None
        ready = prepare(case.by(self.engine.manual))
        futures = [self._workers.submit(job, case.scene.engine.time_limit) for job in ready.jobs]
        arguments = (ready, outcomes_of(self._workers, futures), self.engine, self.store)
        judged = self._workers.outcome(self._workers.call(judge, *arguments, time_limit=JUDGING))
        if isinstance(judged, Failure):
            return faulty(ready, self.engine, judged)
        record, arrays = judged
        if arrays and self.folder:
            case_arrays.write(self.folder / "fields", record.case, arrays)
        return record

    def accepts(self, record: CaseRecord) -> bool:
        """Return whether a case leaves the session green."""
        known = severities(record.findings)
        failing = [name for name, severity in known.items() if fails(severity, self.fail_on)]
        new = [entry.id for entry in LEDGER if entry.new_on(self.engine.distribution)]
        return record.accepted([*failing, *new]) and not record.lacks

    def stop(self, at_once: bool = False) -> None:
        """End LAMMPS; at once, if it may be computing."""
        with suppress(Abandoned), self._resources:
            if at_once:
                raise Abandoned


JUDGE = pytest.StashKey[CaseJudge]()


class CaseYaml(pytest.File):
    """A case file."""

    def collect(self) -> Iterator[CaseItem]:
        """Yield one test for each case, with its tags as marks."""
        try:
            cases = casefile.load_file(self.path, shipped=self.path.is_relative_to(casefile.SHIPPED))
        except InputError as error:
            raise self.CollectError(str(error)) from None
        lines = case_lines(self.path)
        marks = {tag: mark_of(tag) for case in cases for tag in case.tags}
        for tag, mark in marks.items():
            self.config.addinivalue_line("markers", f"{mark}: cases with the tag {tag}")
        for case in cases:
            item = CaseItem.from_parent(self, name=case.name, case=case, line=lines.get(case.name, 1))
            for tag in case.tags:
                item.add_marker(marks[tag])
            yield item


class CaseItem(pytest.Item):
    """A case."""

    def __init__(self, *, case: Case, line: int, **options: Any) -> None:
        super().__init__(**options)
        self.case = case
        self.line = line
        self.record: CaseRecord | None = None

    def setup(self) -> None:
        """Start LAMMPS once; a missing LAMMPS ends the session with an error instead of skipping cases."""
        missing = ""
        try:
            self.config.stash[JUDGE].start()
        except EngineMissing as error:
            missing = f"{error} (eos-ref doctor says more)"
        if missing:  # outside the handler, so that pytest shows no chain of tracebacks
            self.session.shouldfail = "eos-ref: there is no LAMMPS to run"
            pytest.fail(missing, pytrace=False)

    def runtest(self) -> None:
        """Run and judge the case."""
        judge = self.config.stash[JUDGE]
        self.record = judge.record(self.case)
        ratio = wording.worst_ratio(self.record)
        self.user_properties += [
            ("verdict", self.record.verdict),
            ("max_over_bound", "" if ratio is None else repr(ratio)),
            ("engine", " ".join(filter(None, (judge.engine.name, judge.engine.distribution)))),
        ]
        if not judge.accepts(self.record):
            raise NotAsExpected(self.record)

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """Describe the failure of the case; a traceback only for a fault of eos-ref itself."""
        error = excinfo.value
        if isinstance(error, NotAsExpected):
            return self._complaint(verdict_line(error.record), failure_lines(error.record))
        if isinstance(error, InputError):
            return self._complaint(str(error), [str(error)])
        return super().repr_failure(excinfo, style)

    def _complaint(self, message: str, lines: Iterable[str]) -> ReprExceptionInfo:
        """Put lines for the terminal and a message for the summary into a form that can be sent between processes."""
        trace = ReprTraceback([ReprEntryNative([f"{line}\n" for line in lines])], None, "native")
        return ReprExceptionInfo(trace, ReprFileLocation(str(self.path), self.line, message))

    def reportinfo(self) -> tuple[Path, int, str]:
        """Return file, line from 0, and name."""
        return self.path, self.line - 1, self.name


def mark_of(tag: str) -> str:
    """Return the mark for a tag: letters, digits and underscores, without a meaning to pytest."""
    name = re.sub(r"\W", "_", tag)
    return f"tag_{name}" if name in TAKEN or name.startswith("_") else name


def named(item: CaseItem, config: pytest.Config) -> bool:
    """Return whether the command line names a case, or selects those left out by default: by node id, -k or -m."""
    words = re.findall(r"[^\s()]+", config.option.keyword)
    chosen = any(word in item.name for word in words if word not in ("and", "or", "not"))
    by_mark = re.search(r"\b(long|more)\b", config.option.markexpr) is not None
    return chosen or by_mark or any(item.name in argument.split("::")[1:] for argument in config.args)


def verdict_line(record: CaseRecord) -> str:
    """Return the verdict and its basis: field, stage, step and atom to blame, or LAMMPS' words."""
    return f"{record.verdict}: {record.message}" if record.message else record.verdict


def failure_lines(record: CaseRecord) -> list[str]:
    """Return the verdict, every field outside its bound, and the command that runs the case alone."""
    lines = [verdict_line(record)]
    for field in record.fields:
        if field.verdict in ("differs", "explained"):
            step = "" if field.worst_step is None else f"step {field.worst_step}, "
            off = f"off by {wording.number(field.max_abs)}, {wording.number(field.max_over_bound)} x the bound"
            why = f", explained by {wording.listed(field.explained_by)}" if field.explained_by else ""
            lines.append(f"  {field.field} (stage {field.stage}): worst at {step}atom {field.worst_id}, {off}{why}")
    return [*lines, f"reproduce: {record.reproduce}"]
