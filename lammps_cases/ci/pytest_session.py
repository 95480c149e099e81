"""A session of ``pytest --eos-ref``: hooks of pytest and of pytest-xdist.

One LAMMPS process lives as long as the session, or as a process of pytest-xdist. The record of a case is sent with
pytest's own report of it, so that the process that prints the summary has those of all processes.
"""

from __future__ import annotations

import re
import shlex
import time
from collections import Counter
from collections.abc import Generator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import pytest

from eos_ref import InputError
from lammps_cases.ci.pytest_cases import JUDGE, Abandoned, CaseItem, CaseJudge, CaseYaml, named
from lammps_cases.comparison.store import open_store
from lammps_cases.engine import installations
from lammps_cases.records import wording
from lammps_cases.records.faults import part
from lammps_cases.records.headline import Headline
from lammps_cases.records.run_record import CaseRecord, EngineRecord, RunRecord
from lammps_cases.report import findings
from lammps_cases.run import provenance, report_files
from lammps_cases.run.report_files import output_folder
from lammps_cases.scene import casefile

SUFFIXES = (".yaml", ".yml")
# Other YAML files are ignored; if one of these keys is misspelt, another identifies a case file.
OWN_KEY = re.compile(r"""^\{?\s*["']?(about|matrix|scene)["']?\s*:""", re.MULTILINE)


class SessionPlugin:
    """Hooks of a session, called by pytest."""

    def __init__(self, config: pytest.Config) -> None:
        option = config.option
        self._config = config
        # None in the reporting process; in one of pytest-xdist the input from that process
        self._worker_input: dict[str, Any] | None = getattr(config, "workerinput", None)
        try:
            engine = installations.resolve(option.eos_ref_engine or "env")
        except InputError as error:
            raise pytest.UsageError(f"eos-ref: {error}") from None
        self._judge = config.stash[JUDGE] = CaseJudge(
            engine, open_store(option.eos_ref_fresh), option.eos_ref_fail_on or "new"
        )
        self._engine = self._judge.engine
        self._output = ExitStack()
        self._folder: Path | None = None
        self._records: list[CaseRecord] = []
        self._unjudged = 0  # cases and files that left no record
        self._run: RunRecord | None = None
        self._written = ""
        self._begin = time.perf_counter()
        config.add_cleanup(self._abandon)
        if option.eos_ref_shipped:
            alone = config.args_source is not pytest.Config.ArgsSource.ARGS
            config.args[:] = [*([] if alone else config.args), str(casefile.SHIPPED)]

    # --- collection

    def pytest_collect_file(self, file_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
        """Collect a YAML file that is named, or that has a key of a case file."""
        if file_path.suffix not in SUFFIXES:
            return None
        if not parent.session.isinitpath(file_path):
            with suppress(OSError):  # a file that cannot be read is reported when it is collected
                if not OWN_KEY.search(file_path.read_text(encoding="utf-8", errors="replace")):
                    return None
        collector: pytest.Collector = CaseYaml.from_parent(parent, path=file_path)
        return collector

    def pytest_collection_modifyitems(self, config: pytest.Config, items: list[pytest.Item]) -> None:
        """Leave out cases without the requested tag, and long ones and those tagged more that are not selected."""
        tag: str | None = config.option.eos_ref_tag
        out = {
            item
            for item in items
            if isinstance(item, CaseItem)
            and not (casefile.tagged(item.case, tag) if tag else named(item, config) or casefile.by_default(item.case))
        }
        if out:
            config.hook.pytest_deselected(items=[item for item in items if item in out])
            items[:] = [item for item in items if item not in out]

    # --- running

    @pytest.hookimpl(tryfirst=True)
    def pytest_sessionstart(self) -> None:
        """Open the folder of the report, before pytest-xdist starts its processes."""
        option = self._config.option
        if self._worker_input is not None:
            self._folder = Path(self._worker_input["eos_ref_folder"]) if self._worker_input["eos_ref_folder"] else None
        elif option.eos_ref_out and not option.collectonly:
            try:
                self._folder = self._output.enter_context(output_folder(Path(option.eos_ref_out)))
            except InputError as error:
                raise pytest.UsageError(f"eos-ref: {error}") from None
        self._judge.folder = self._folder

    @pytest.hookimpl(optionalhook=True)
    def pytest_configure_node(self, node: Any) -> None:
        """Pass the folder of the report to a process of pytest-xdist."""
        node.workerinput["eos_ref_folder"] = str(self._folder or "")

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(
        self, item: pytest.Item, call: pytest.CallInfo[None]
    ) -> Generator[None, Any, pytest.TestReport]:
        """Give the report of a case its record."""
        report: Any = yield
        if isinstance(item, CaseItem) and item.record is not None and call.when == "call":
            report.eos_ref = [self._judge.engine.model_dump_json(), item.record.model_dump_json()]
        return report  # type: ignore[no-any-return]

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Keep the record of a case."""
        carried = getattr(report, "eos_ref", None)
        if carried is not None:
            self._engine = EngineRecord.model_validate_json(carried[0])
            self._records.append(CaseRecord.model_validate_json(carried[1]))
        elif report.failed:
            self._unjudged += report.nodeid.partition("::")[0].endswith(SUFFIXES)

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        """Note a file that cannot be collected."""
        self._unjudged += report.failed and report.nodeid.endswith(SUFFIXES)

    # --- the end

    def pytest_sessionfinish(self, exitstatus: int) -> None:
        """Stop LAMMPS, join the records, write the report."""
        whole = exitstatus in (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED)
        self._judge.stop(at_once=not whole)
        if self._worker_input is not None:
            return
        if not self._records:
            self._written = "no report written: no case was judged" if self._folder else ""
            return
        self._run = self._joined()
        if self._run.predictions.computed:
            self._judge.store.trim()
        if self._folder is not None:
            self._written = self._report(self._run, self._folder, whole)

    def _joined(self) -> RunRecord:
        """Return the run of these cases."""
        command = shlex.join(["pytest", *map(str, self._config.invocation_params.args)])
        run = provenance.run_record(self._engine, command)
        run.fail_on = self._judge.fail_on
        run.cases = sorted(self._records, key=lambda record: record.case)
        run.carried = part("carried findings", run.faults, lambda: findings.compare_with_ledger(run), None)
        run.seconds = round(time.perf_counter() - self._begin, 3)
        return run.counted()

    def _report(self, run: RunRecord, folder: Path, whole: bool) -> str:
        """Write the report, unless it would hide cases that were not judged; one line states which."""
        out = self._config.option.eos_ref_out
        twice = [name for name, count in Counter(record.case for record in run.cases).items() if count > 1]
        if twice:
            why = f"two cases with the name {twice[0]}"
        elif self._unjudged:
            why = f"{self._unjudged} cases or files could not be judged"
        else:
            why = "" if whole else "the session was interrupted"
        if why:
            return f"no report written: {why}"
        with self._output:
            report_files.write_run(run, folder)
        return f"report: {Path(out) / 'report.html'}"

    def _abandon(self) -> None:
        """Remove partial files and end the process, whatever happened."""
        self._judge.stop(at_once=True)
        with suppress(Abandoned), self._output:
            raise Abandoned

    # --- what is printed

    def pytest_report_header(self) -> str:
        """Return the engine, and the folder of predictions."""
        strict = "" if self._judge.fail_on == "new" else f", fail on {self._judge.fail_on}"
        return f"eos-ref: engine {self._judge.engine.name}{strict}, predictions in {self._judge.store.folder}"

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        """Print verdicts and findings of the session."""
        if self._run is not None:
            terminalreporter.section("eos-ref")
            for line in _lines(self._run):
                terminalreporter.line(line)
        if self._written:
            terminalreporter.line(self._written)
        if self._run is not None:
            of_run = findings.outcome(self._run)
            headline = of_run.headline
            if self._unjudged and headline.state != "FAIL":
                headline = Headline("FAIL", f"{self._unjudged} cases or files could not be judged")
            terminalreporter.line(str(headline), bold=True, **{headline.look.terminal: True})
            for line in of_run.closing():
                terminalreporter.line(line)


def _lines(run: RunRecord) -> list[str]:
    lines = [f"{wording.engine(run.engine)}: {wording.tally(run)}"]
    lines += [*([wording.carried(run.carried)] if run.carried else []), *wording.lacks(run.faults), *run.notes]
    if run.predictions.stored:
        lines.append(f"{wording.predictions(run.predictions)} (--eos-ref-fresh recomputes them)")
    return lines
