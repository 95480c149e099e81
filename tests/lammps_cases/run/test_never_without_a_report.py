"""A fault of the harness after judging costs a part of the report, which reports it in one line."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from types import CodeType, SimpleNamespace
from typing import Any

import pytest

from lammps_cases.cli import shared
from lammps_cases.comparison import store
from lammps_cases.comparison.compare import EosState, compare_pressure
from lammps_cases.engine.installations import Engine
from lammps_cases.records import folders
from lammps_cases.records.case_parts import Blame, HarnessError, StepRecord
from lammps_cases.records.files import write_arrays
from lammps_cases.records.run_record import CaseRecord, EngineRecord, read_run
from lammps_cases.report.history import store as history
from lammps_cases.run import campaign
from lammps_cases.run.campaign import Campaign
from lammps_cases.run.judged import start
from lammps_cases.run.prepared_case import prepare
from lammps_cases.run.provenance import run_record
from lammps_cases.scene import casefile
from lammps_cases.scene.casefile import Case
from tests.support import made_runs
from tests.support.broken import called, plant, public
from tests.support.outcome import Outcome

ROOMS = (
    "lammps_cases.verdict.diagnosis.triage",
    "lammps_cases.report.history",
    "lammps_cases.report.pages",
    "lammps_cases.report",
)
ARTICLES = {name: of for name, of in public("lammps_cases.run.report_files").items() if "article" in name}
FUNCTIONS = public(*ROOMS) | ARTICLES
CASES = ("near-rho0.linear.2d", "ranges.override")
COLOURS = {"green": 1.0, "red": 2.0}  # factors of LAMMPS' pressures over those of the reference
PARTS = {  # parts that faults of a module may cost; other modules are needed by a whole page or summary
    "verdict.diagnosis.": {"triage"},
    "report.history.": {"history", "entry in the history"},
    "report.findings.matri": {"agreement", "agreement in summary.md"},
    "report.page.plot_data": {"pictures"},
    "report.page.one_per_atom": {"pictures"},
    "report.page.embedded": {"pictures"},
    "report.plots.": {"pictures"},
    "report.formats.junit": {"junit.xml"},
    "report.formats.case_text": {"junit.xml"},
    "report.markdown.": {"summary.md", "agreement in summary.md"},
    "report.annotations.": set[str](),
}
ENGINE = EngineRecord(version_string="20250722", distribution="2025.7.22.4.0", library_sha256=64 * "a")
Command = Callable[..., Outcome]


def judged(case: Case, folder: Path, factor: float) -> CaseRecord:
    """A case in which LAMMPS' pressures are those of the reference times a factor, and its arrays."""
    atoms = prepare(case).atoms
    state = EosState(atoms.id_n, atoms.type_n, atoms.rho_n, atoms.mass_n, atoms.energy_n)
    table = case.scene.eos(case.where)
    found = compare_pressure(table, state, factor * table.pressure(state.rho_n, state.type_n, state.e_n))
    arrays = {"id": atoms.id_n, "type": atoms.type_n, "rho": atoms.rho_n, "mass": atoms.mass_n, "x": atoms.x_nc}
    sides = {"lammps": found.lammps_n, "reference": found.reference_n, "bound": found.bound_n}
    arrays |= {f"{found.record.field}.{side}": values for side, values in sides.items()}
    ratio = found.record.max_over_bound or 0.0
    found.record.steps = [StepRecord(step=0, verdict=found.record.verdict, max_abs=ratio, max_over_bound=ratio)]
    write_arrays(folder / "fields" / f"{case.name}.npz", arrays)
    red = found.record.verdict == "differs"
    blame = Blame(field=found.record.field, stage="eos", atom=1, outside=1, of=1, lammps=2, reference=1, bound=1e-9)
    return CaseRecord(
        case=case.name,
        verdict=found.record.verdict,
        natoms=len(atoms.id_n),
        dimension=case.scene.dimension,
        fields=[found.record],
        blame=blame if red else None,
        reproduce=f"eos-ref run {case.name}",
    )


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, eos_ref_command: Command) -> Command:
    """Run ``eos-ref run``, with the reference in LAMMPS' place, in a folder with a history."""
    monkeypatch.chdir(tmp_path)
    with history.History(tmp_path / "history.sqlite") as made:
        made.add(made_runs.run(version=ENGINE.distribution, date="2026-01-01T00:00:00Z"))
    monkeypatch.setenv(history.VARIABLE, str(made.path))
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(tmp_path / "summary.md"))
    monkeypatch.setattr(shared, "start_fork_server", lambda pairs: None)
    monkeypatch.setattr(store, "code", lambda *_: "the hash of all sources, which takes long")
    monkeypatch.setattr(campaign, "Workers", lambda *_: nullcontext(SimpleNamespace(local=False)))

    def command(factor: float, *words: str, meanwhile: Callable[[str], object] = lambda case: None) -> Outcome:
        def judge(self: Campaign, *_: Any) -> dict[str, Any]:
            begun = run_record(ENGINE, "eos-ref run").model_copy(update=self.request.recorded)
            now = start(begun, self.cases)
            self.begun = self.journal.begin(now, self.judged)
            for case in self.cases:
                if case.name not in self.judged:
                    self.journal.keep(judged(case, self.folder, factor))
                    meanwhile(case.name)
            return {}

        monkeypatch.setattr(Campaign, "run_all", judge)
        return eos_ref_command("run", *CASES, "--out", "reports/run", *words)

    return command


@pytest.fixture(scope="module")
def met() -> dict[float, set[CodeType]]:
    """Functions called in a run, by factor; filled by the first test that needs them."""
    return {}


def _met(factor: float, run: Command, met: dict[float, set[CodeType]]) -> set[CodeType]:
    if factor not in met:
        run(factor)  # code that runs only on import is not called again
        met[factor] = called(lambda: run(factor))
    return met[factor]


@pytest.mark.slow
@pytest.mark.parametrize("factor", COLOURS.values(), ids=COLOURS)
def test_functions_with_planted_faults_are_called(factor: float, run: Command, met: dict[float, set[CodeType]]) -> None:
    assert run(factor).code == factor - 1
    assert len(_met(factor, run, met) & {of.__code__ for of in FUNCTIONS.values()}) > 50
    assert not read_run(Path("reports/run")).faults


@pytest.mark.slow
@pytest.mark.parametrize("factor", COLOURS.values(), ids=COLOURS)
@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_function_that_fails_costs_a_part_of_the_report(
    name: str,
    factor: float,
    run: Command,
    met: dict[float, set[CodeType]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if FUNCTIONS[name].__code__ not in _met(factor, run, met):
        return
    plant(FUNCTIONS[name], monkeypatch)
    code, out, err = run(factor)
    record = read_run(Path("reports/run"))
    assert {case.verdict for case in record.cases} == ({"exact", "pass"} if factor == 1.0 else {"differs"})
    assert code == (3 if factor == 1.0 else 1)
    lacks = [line for line in out.splitlines() if line.startswith("  not in this report: ")]
    stale = [line for line in err.splitlines() if line.startswith("eos-ref: not up to date: reports/index.html: ")]
    assert (len(lacks), len(stale)) in ((1, 0), (0, 1), (1, 1)), out + err
    assert "Traceback" not in out + err and (out + err).count("planted here") == len(lacks + stale)
    of_room = next((parts for room, parts in PARTS.items() if name.startswith(room)), None)
    assert of_room is None or {fault.part for fault in record.faults} <= of_room
    for report in ("report.html", "summary.md"):
        text = Path("reports/run", report).read_text()
        assert text.count("not in this report: ") == text.count("planted here") == bool(record.faults)


def raises(error: BaseException) -> Callable[..., Any]:
    def function(*_: object, **__: object) -> Any:
        raise error

    return function


@pytest.mark.parametrize(
    ("error", "factor", "code", "text"),
    [
        (KeyboardInterrupt(), 2.0, 130, "interrupted after 2 of 2 cases: see reports/run.interrupted/summary.md"),
        (RuntimeError("planted here"), 1.0, 3, "this is a fault of eos-ref itself"),
    ],
)
def test_run_that_ends_before_its_report_is_rendered_and_resumed(
    error: BaseException,
    factor: float,
    code: int,
    text: str,
    run: Command,
    eos_ref_command: Command,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(campaign, "write_kept_run", raises(error))
        ended = run(factor)
    assert ended.code == code and text in ended.err and not Path("reports/run").exists()
    for place in ("reports/run", "reports/run.interrupted"):
        rendered = eos_ref_command("report", place)
        assert rendered.code == factor - 1 and "report: reports/run.interrupted/report.html" in rendered.out
        found = {case.verdict for case in read_run(Path("reports/run.interrupted")).cases}
        assert found == {"differs"} if factor == 2.0 else found <= {"exact", "pass"}
    judged_again = list[str]()
    assert run(factor, "--resume", meanwhile=judged_again.append).code == factor - 1
    assert not judged_again and not Path("reports/run.interrupted").exists()
    assert bool(read_run(Path("reports/run")).triage) == (factor == 2.0)
    assert "older" not in eos_ref_command("report", "reports/run").out


def test_judged_cases_of_a_killed_run_are_rendered(run: Command, eos_ref_command: Command) -> None:
    """They are in the partial folder, and the page counts the missing cases."""
    assert run(1.0, meanwhile=raises(KeyboardInterrupt())).code == 130
    folders.interrupted(Path("reports/run")).rename(folders.making(Path("reports/run")))
    rendered = eos_ref_command("report", "reports/run")
    assert rendered.code == 1 and "interrupted: 1 of 2 cases not judged" in rendered.out
    assert "interrupted: 1 of 2 cases not judged" in Path("reports/run.interrupted/report.html").read_text()
    (Path("reports/run.interrupted") / folders.JOURNAL / "run.json").write_text("damaged")
    damaged = eos_ref_command("report", "reports/run")
    assert damaged.code == 2 and damaged.err.startswith("eos-ref: journal: is damaged")


@pytest.mark.parametrize("context", ["same", "other"])
def test_judgements_of_earlier_code_are_named(context: str, run: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    assert run(1.0, meanwhile=raises(KeyboardInterrupt())).code == 130
    monkeypatch.setattr(store, "code", lambda *_: "mended")
    if context == "other":
        monkeypatch.setattr(store, "context", lambda *_: context)
    resumed = run(1.0, "--resume")
    since = "; the reference has changed since" if context == "other" else ""
    line = f"1 of 2 cases judged by other code, before --resume continued: {CASES[0]}{since}"
    assert resumed.code == 0 and f"  {line}\n" in resumed.out
    assert line in Path("reports/run/report.html").read_text()
    assert read_run(Path("reports/run")).older == {CASES[0]: "reference" if since else "code"}


def test_faults_of_the_harness_are_judged_again(run: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        faulty = CaseRecord(case=CASES[0], verdict="error", harness_error=HarnessError(text="planted here"))
        patch.setitem(globals(), "judged", lambda *_: faulty)
        assert run(1.0, meanwhile=raises(KeyboardInterrupt())).code == 130
    assert run(1.0, "--resume").code == 0


@pytest.mark.usefixtures("run")
def test_command_without_resume_leaves_judged_cases(
    case_file: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After the last case, an interrupt of ``claims``, ``compare`` or `lammps_cases.run` left nothing."""
    cases = casefile.load_file(case_file())

    def judge(self: Campaign, *_: Any) -> dict[str, Any]:
        self.begun = self.journal.begin(start(run_record(ENGINE, ""), self.cases))
        self.journal.keep(judged(cases[0], self.folder, 1.0))
        return {}

    monkeypatch.setattr(Campaign, "run_all", judge)
    monkeypatch.setattr(campaign, "write_kept_run", raises(KeyboardInterrupt()))
    with pytest.raises(KeyboardInterrupt, match=r"interrupted after 1 of 1 case: see .*/summary.md$"):
        campaign.run_cases(cases, Engine(), 1, tmp_path / "report")
    assert [case.case for case in read_run(tmp_path / "report.interrupted").cases] == ["mine"]
