"""Verdicts of claims on an engine, from the records of their cases and probes, and missing links between both.

A claim of the kind page is judged by its argument. Another one is refuted by a finding that its data name as
contradicting it, or by a difference that no finding explains. A finding that explains a case otherwise is a remark:
LAMMPS then agrees, on every atom, with the reference that has that fault alone, so the case still shows what the claim
states. Traceability goes both ways: claims without a case, and cases without a claim.
"""

from __future__ import annotations

import fnmatch
import math
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, get_args

from eos_ref.syntax.manual import FIRST, Manual
from lammps_cases.claims.model import Claim, claims, without_claim
from lammps_cases.claims.probes import PREFIX
from lammps_cases.findings import severities
from lammps_cases.records.case_parts import FieldRecord
from lammps_cases.records.case_wording import own_words
from lammps_cases.records.headline import HERE, Headline, headline
from lammps_cases.records.levels import FailOn
from lammps_cases.records.run_record import CaseRecord, RunRecord
from lammps_cases.records.wording import INSIDE, counted, number

ClaimVerdict = Literal["holds", "does not hold", "not run", "cannot be tested", "not claimed"]
VERDICTS: tuple[ClaimVerdict, ...] = get_args(ClaimVerdict)
# Over several engines, some of whose manuals may not make the claim.
Ground = Literal["cases", "decks", "page"]  # of a refutation: cases, small decks (probes), words of its page
GROUNDS: tuple[Ground, ...] = get_args(Ground)
_WORST: tuple[ClaimVerdict, ...] = ("does not hold", "not run", "holds", "cannot be tested", "not claimed")
_PLURAL: Mapping[ClaimVerdict, str] = {"holds": "hold", "does not hold": "do not hold"}
BROKEN = ("error", "crashed", "timeout")  # such an end of an engine, without a finding, proves nothing about the manual


@dataclass(frozen=True)
class Evidence:
    """The evidence of a case about a claim; ``findings`` is empty if no finding explains it.

    Without a case it is the page's own text.
    """

    case: str
    field: str
    text: str
    findings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Judged:
    """A claim on an engine.

    Attributes
    ----------
    verdict : whether it holds
    cases : the cases and probes of the claim, run or not
    evidence : the refutation; or the case that comes nearest to refuting it
    unexplained : whether it fails without a finding
    remarks : findings that do not contradict it; cases without evidence
    """

    claim: Claim
    verdict: ClaimVerdict
    cases: tuple[str, ...] = ()
    evidence: tuple[Evidence, ...] = ()
    unexplained: bool = False
    remarks: tuple[str, ...] = ()


class Names:
    """Names of cases, by their first word: patterns are then compared with few of them."""

    def __init__(self, names: Iterable[str]) -> None:
        self.by_head: dict[str, list[str]] = {}
        self._found: dict[str, list[str]] = {}
        for name in sorted(names):
            self.by_head.setdefault(name.partition(".")[0], []).append(name)

    def matching(self, pattern: str) -> list[str]:
        """Return the names that fit a pattern, whose first word is not a wildcard."""
        if pattern not in self._found:
            near = self.by_head.get(pattern.partition(".")[0], [])
            start = pattern.removesuffix("*")
            if "*" not in start:  # the usual case, and ten times as quick as a regular expression
                hits = [name for name in near if name.startswith(start)] if start != pattern else []
                self._found[pattern] = [pattern] if pattern in near else hits
            else:
                self._found[pattern] = fnmatch.filter(near, pattern)
        return self._found[pattern]

    def of(self, claim: Claim) -> tuple[str, ...]:
        """Return the cases of a claim."""
        return tuple(sorted({name for pattern in claim.cases for name in self.matching(pattern)}))


@dataclass
class _Heard:
    against: list[Evidence] = field(default_factory=list)
    others: Counter[str] = field(default_factory=Counter)
    silent: list[str] = field(default_factory=list)
    shown: list[tuple[CaseRecord, FieldRecord | None]] = field(default_factory=list)


def judge(
    chosen: Sequence[Claim],
    records: Mapping[str, CaseRecord],
    known: Collection[str] | None = None,
    manual: Manual = FIRST,
) -> list[Judged]:
    """Return the verdict on every claim.

    Parameters
    ----------
    records : mapping
        Of cases and probes by name.
    known : collection of str, optional
        All existing cases and probes: a claim holds only if every one of its own has been run. Without it, one
        for each of its patterns must have been.
    manual : {"2025.7.22", "2026.7.4"}
        The manual of the LAMMPS that ran.
    """
    ran = Names(records)
    every = ran if known is None else Names(known)
    return [
        _judged(claim, ran, every, records, known is not None)
        if claim.made_in(manual)
        else Judged(claim, "not claimed")
        for claim in chosen
    ]


def _judged(claim: Claim, ran: Names, every: Names, records: Mapping[str, CaseRecord], complete: bool) -> Judged:
    if claim.untestable:
        return Judged(claim, "cannot be tested", remarks=(claim.untestable,))
    if claim.argument:
        return Judged(claim, "does not hold" if claim.falls else "holds", evidence=(Evidence("", "", claim.argument),))
    names, here = every.of(claim), ran.of(claim)
    heard = _Heard()
    for name in here:
        _listen(claim, records[name], heard)
    missing = [name for name in names if name not in records] if complete else []
    missing += [pattern for pattern in claim.cases if not every.matching(pattern)]
    remarks = tuple(_remarks(claim, heard))
    if heard.against:
        unexplained = any(not evidence.findings for evidence in heard.against)
        return Judged(claim, "does not hold", names, tuple(heard.against), unexplained, remarks)
    if missing or heard.silent or not here:
        waiting = f"not run: {', '.join(missing)}"
        return Judged(claim, "not run", names, remarks=(*remarks, waiting) if missing else remarks)
    return Judged(claim, "holds", names, (_nearest(heard),), remarks=remarks)


def _listen(claim: Claim, record: CaseRecord, heard: _Heard) -> None:
    if record.verdict in ("skipped", *BROKEN):
        heard.silent.append(f"{record.case}: {record.message or record.verdict}")
        return
    if not record.fields:
        _listen_to_end(claim, record, heard)
        return
    chosen = [f for f in record.fields if not claim.fields or f.field in claim.fields]
    if not chosen:
        heard.silent.append(f"{record.case} compares none of {', '.join(claim.fields)}")
        return
    for of in chosen:
        if of.verdict in INSIDE:
            heard.shown.append((record, of))
            continue
        _weigh(claim, record, of.explained_by, of, heard)


def _listen_to_end(claim: Claim, record: CaseRecord, heard: _Heard) -> None:
    """Take the evidence of a case without numbers: a refusal, a crash, or a probe."""
    if record.verdict in INSIDE or (record.verdict == "refused" and record.as_expected):
        heard.shown.append((record, None))
        return
    _weigh(claim, record, record.explained_by, None, heard)


def _weigh(claim: Claim, record: CaseRecord, findings: Sequence[str], of: FieldRecord | None, heard: _Heard) -> None:
    """Classify a difference: against the claim, or explained by something else."""
    against = [entry for entry in findings if entry in claim.refuted_by]
    if against or not findings:
        text = own_words(record) if of is None else _numbers(of, record)
        heard.against.append(Evidence(record.case, of.field if of else "", text, tuple(against)))
        return
    heard.others.update(findings)
    if of is None and claim.fields:
        heard.silent.append(f"{record.case} gave no numbers ({', '.join(findings)})")
    else:
        heard.shown.append((record, of))


def _numbers(of: FieldRecord, record: CaseRecord) -> str:
    where = f" at step {of.worst_step}" if of.worst_step is not None else ""
    who = f", atom {of.worst_id}" if of.worst_id is not None else ""
    atoms = f", {of.outside} of {record.natoms} atoms" if of.outside else ""
    if of.max_abs is None or of.max_over_bound is None:
        return f"{of.field} is outside its bound{where}{who}{atoms}"
    times = "where its bound is 0" if math.isinf(of.max_over_bound) else f"{number(of.max_over_bound)} times its bound"
    return f"{of.field} is off by {number(of.max_abs)}, {times}{where}{who}{atoms}"


def _nearest(heard: _Heard) -> Evidence:
    """Return the comparison nearest to its bound, among those that show the claim."""
    cases = len({case.case for case, _ in heard.shown})
    compared = [
        (at.max_over_bound or 0.0, case.case, of.field, at.verdict)
        for case, of in heard.shown
        if of is not None
        for at in (of.steps or (of,))  # if later steps are explained by a finding, earlier ones agree
        if at.verdict in INSIDE
    ]
    if compared:
        ratio, name, field, _ = max(compared)
        close = len({case for _, case, _, _ in compared})
        same = all(verdict == "exact" for *_, verdict in compared)
        text = "the same bits" if same else f"{field} within {ratio:.2g} of its bound at worst"
        more = f"; {cases - close} more explained by other findings" if heard.others and cases > close else ""
        return Evidence(name, field, f"{counted(close, 'case')}: {text}{more}")
    case = heard.shown[0][0]
    how = " refused as promised" if case.expects else " as documented"
    if heard.others:
        how = ", explained by a finding that does not contradict the claim"
    return Evidence(case.case, "", counted(cases, "case") + how)


def _remarks(claim: Claim, heard: _Heard) -> Iterable[str]:
    if claim.remark:
        yield claim.remark
    for entry, times in sorted(heard.others.items()):
        yield f"{entry} explains {counted(times, 'comparison')} and does not contradict it"
    yield from heard.silent


@dataclass(frozen=True)
class Summary:
    """The claims in the report of a run: those that do not hold, and the number of others.

    Attributes
    ----------
    probes : how many of those not run need probes, which are not cases
    """

    refuted: tuple[Judged, ...]
    holds: int
    not_run: int
    probes: int
    untestable: int


def summary(run: RunRecord) -> Summary | None:
    """Return the claims by the cases of a run; None if it has no case of any claim, as in an audit."""
    judged = of_run([claim for claim in claims() if not claim.argument], run)
    count = counts(judged)
    refuted = tuple(one for one in judged if one.verdict == "does not hold")
    if not refuted and not count.get("holds"):
        return None
    waiting = [one for one in judged if one.verdict == "not run"]
    probes = sum(any(pattern.startswith(PREFIX) for pattern in one.claim.cases) for one in waiting)
    return Summary(refuted, count.get("holds", 0), len(waiting), probes, count.get("cannot be tested", 0))


def of_run(chosen: Sequence[Claim], run: RunRecord, known: Collection[str] | None = None) -> list[Judged]:
    """Return the verdicts of a run."""
    return judge(chosen, {case.case: case for case in run.cases}, known, run.engine.manual)


def worst(verdicts: Iterable[ClaimVerdict]) -> ClaimVerdict:
    """Return the verdict over several engines: of one that refutes it, else of one that did not run it."""
    return min(verdicts, key=_WORST.index)


def counts(judged: Iterable[Judged]) -> dict[ClaimVerdict, int]:
    """Count the claims of each verdict."""
    count = Counter(one.verdict for one in judged)
    return {verdict: count[verdict] for verdict in VERDICTS if count[verdict]}


def refuted_by(columns: Sequence[Sequence[Judged]]) -> dict[Ground, int]:
    """Count the claims that do not hold on an engine, by what refutes them; the report of a run counts ``cases``."""
    grounds: dict[str, set[Ground]] = {}
    for judged in (one for of in columns for one in of if one.verdict == "does not hold"):
        of_cases = any(evidence.case and not evidence.case.startswith(PREFIX) for evidence in judged.evidence)
        ground: Ground = "page" if judged.claim.argument else "cases" if of_cases else "decks"
        grounds.setdefault(judged.claim.id, set()).add(ground)
    first = Counter(min(each, key=GROUNDS.index) for each in grounds.values())
    return {ground: first[ground] for ground in GROUNDS}


def of_all(columns: Sequence[Sequence[Judged]], broken: Sequence[str] = (), fail_on: FailOn = "new") -> Headline:
    """Return the headline over the verdicts of some engines; ``broken`` names what crashed or ended unforeseen."""
    fallen = [one for of in columns for one in of if one.verdict == "does not hold"]
    unexplained = {one.claim.id for one in fallen if one.unexplained}
    explained = {one.claim.id for one in fallen} - unexplained
    holding = {one.claim.id for of in columns for one in of if one.verdict == "holds"}
    new = [f"{_statements(unexplained, 'does not hold')}, unexplained"] if unexplained else []
    new += [f"{counted(len(broken), 'case')} broken or unforeseen"] if broken else []
    return headline(
        severities(finding for one in fallen for evidence in one.evidence for finding in evidence.findings),
        new,
        differences=f"{_statements(explained, 'does not hold')}, {'known' if unexplained else 'all known'}"
        if explained
        else "",
        same=_statements(holding, "holds"),
        fail_on=fail_on,
        compared=bool(holding),
        whose=HERE if len(columns) == 1 else f"seen in these {len(columns)} LAMMPS engines",
    )


def in_words(count: int, verdict: ClaimVerdict) -> str:
    """Return the words of a verdict for a number of claims: 1 holds, 2 hold."""
    return verdict if count == 1 else _PLURAL.get(verdict, verdict)


def _statements(claims_of: Collection[str], verdict: ClaimVerdict) -> str:
    return f"{counted(len(claims_of), 'statement')} {in_words(len(claims_of), verdict)}"


@dataclass(frozen=True)
class Trace:
    """Missing links between claims and cases.

    Attributes
    ----------
    untestable : claims without a case, and why
    dangling : patterns of claims that fit no case
    unclaimed : cases without a claim, and why; empty without a given reason
    stale : reasons given for cases that have a claim, or do not exist
    """

    untestable: dict[str, str]
    dangling: dict[str, list[str]]
    unclaimed: dict[str, str]
    stale: list[str]

    @property
    def complete(self) -> bool:
        """Return whether everything has its counterpart or its reason."""
        return not self.dangling and not self.stale and all(self.unclaimed.values())


def trace(claims: Sequence[Claim], cases: Iterable[str]) -> Trace:
    """Follow claims to cases (and probes), and back."""
    names = Names(cases)
    every = {name for names_of in names.by_head.values() for name in names_of}
    dangling = {c.id: [p for p in c.cases if not names.matching(p)] for c in claims}
    claimed = {name for claim in claims for name in names.of(claim)}
    reasons: dict[str, str] = {}
    stale = []
    for pattern, why in without_claim().items():
        fits = [name for name in names.matching(pattern) if name not in claimed]
        reasons |= dict.fromkeys(fits, why)
        if not fits:
            stale.append(pattern)
    return Trace(
        {claim.id: claim.untestable for claim in claims if claim.untestable},
        {id: patterns for id, patterns in dangling.items() if patterns},
        {name: reasons.get(name, "") for name in sorted(every - claimed)},
        stale,
    )
