"""What happened in a case, in a sentence: what leaves its bound first, how LAMMPS ended, what findings predict."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence

from lammps_cases.records.case_parts import Blame, LostAtoms, Mismatch, OtherSteps, Verdict
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.records.wording import INSIDE, counted, listed, one_line


def message(case: CaseRecord, findings: bool = True) -> str:
    """Describe what happened in a case: the blame, and how LAMMPS ended it if not with numbers.

    Without ``findings`` those that explain its numbers, listed elsewhere, are left out. A record without facts keeps
    its message.
    """
    if case.verdict in INSIDE:
        return ""
    limit = f"a known limit of {listed(case.limits)}, of which no variant reproduces such scenes" if case.limits else ""
    parts = [outlook(case), blame(case, findings), unpredictable(case), limit, end(case), unexercised(case)]
    return "; ".join(part for part in parts if part) or case.message


def outlook(case: CaseRecord) -> str:
    """Describe why LAMMPS stopped an audited run, and the particles searched for the cause; empty if it did not."""
    of = case.outlook
    if of is None:
        return ""
    part = "" if of.around is None else f" (in {of.particles} of {of.of_particles} particles around atom {of.around})"
    from_there = f"from step {of.step} of run {of.run}"
    after = counted(of.after or 0, "step")
    stable = f"continued {from_there}, the reference is stable for {counted(of.steps, 'step')}{part}"
    if of.cause == "findings":
        bugs, these = ("bugs", "these bugs") if len(of.findings) > 1 else ("bug", "this bug")
        why = f"unstable because of the known {bugs} {listed(of.findings)}"
        if of.after is None:
            return f"{why}, whose effect cannot be predicted: {stable}"
        return f"{why}: {stable}; with {these} it diverges after {of.after}"
    if of.cause == "not understood":
        return f"not understood: {stable}"
    if of.after is None:
        return f"unstable as set up: {of.because}"
    away = f"the reference also diverges after {after} {from_there}{part}"
    because = f"{of.because}; " if of.because else ""
    if of.cause == "time step":
        return f"unstable because of the time step: {because}{away}, but not with a tenth of the time step"
    return f"unstable as set up: {because}{away}, and also with a tenth of the time step"


def unpredictable(case: CaseRecord) -> str:
    """Describe which fields of a case could not be compared, and why; empty for an audit, which has other lines."""
    fields: dict[str, list[str]] = {}
    for name, why in case.unchecked.items() if "audit" not in case.tags else ():
        fields.setdefault(why, []).append(name)
    return "; ".join(f"{', '.join(names)} {why}" for why, names in fields.items())


def unexercised(case: CaseRecord) -> str:
    """Name the changes in `exercises` that a case does not detect; empty if it detects all."""
    if not case.unexercised:
        return ""
    return f"no field that the case compares shows {', '.join(case.unexercised)}, which it names in exercises"


def blame(case: CaseRecord, findings: bool = True) -> str:
    """Describe which numbers leave the bound first; empty if none does."""
    first = case.headline
    if first is None:
        return ""
    if first.run is not None:
        return _blame_of_audit(first)
    text = blame_of(first, case.twin)
    beside = f", in addition to {listed(case.beyond.findings)}" if case.beyond and case.beyond.findings else ""
    if case.twin:
        text = f"LAMMPS against itself (twin: {case.twin}): {text}"
        text += f"; of one run {blame_of(case.beyond.blame, '')}" if case.beyond else ""
    text += beside
    if case.not_same_problem:
        text += "; the reference differs as well, so the two are not the same problem"
    explaining = next((field.explained_by for field in case.fields if field.field == first.field), [])
    if explaining and findings:
        text += f"; explained by {listed(explaining)}"
    return text


def blame_of(first: Blame, twin: str = "") -> str:
    """Describe where numbers leave their bound first, and with what values."""
    step = "" if first.step is None else f" at step {first.step}"
    state = "" if first.rho is None else f" (type {first.type}, rho {first.rho!r})"
    one, other = ("as given", f"as its {twin} twin") if twin else ("LAMMPS", "reference")
    if first.bound == math.inf:
        some = f"{first.outside} of {first.of} atoms, first atom {first.atom}"
        return f"{first.field} (stage {first.stage}) is not predictable{step} at {some}; all that has a bound is inside"
    return (
        f"{first.field} (stage {first.stage}) leaves its bound{step} at {first.outside} of {first.of} atoms, "
        f"first atom {first.atom}{state}: {one} {first.lammps!r}, {other} {first.reference!r}, bound {first.bound:.3g}"
    )


def _blame_of_audit(first: Blame) -> str:
    where = f"atom {first.atom}" if first.type is None else f"type {first.type}, atom {first.atom}"
    return (
        f"{first.field} leaves its bound first at step {first.step} (run {first.run}), {where}: "
        f"{first.outside} of {first.of} atoms outside, |LAMMPS - reference| up to {first.max_abs:.3g} = "
        f"{first.max_over_bound:.3g} x bound (atom {first.worst_id})"
    )


def end(case: CaseRecord) -> str:
    """Describe how LAMMPS ended a case, if not with numbers to compare, and which finding predicts that."""
    text = _own_end(case)
    if text and _predicted(case):
        text = f"{_foreseen(case)}, as finding {listed(case.explained_by)} predicts: {text}"
    return f"LAMMPS answers, and its twin ({case.twin}) does not: {text}" if case.only_twin else text


def own_words(case: CaseRecord) -> str:
    """Return LAMMPS' own words on how it ended a case, in brief and without the findings."""
    brief_case = case.model_copy(update={"engine_error": error_text(case.engine_error)})
    text = _own_end(brief_case) or case.message
    return f"{_foreseen(case)}: {text}" if _predicted(case) else text


def error_text(error: str) -> str:
    """Shorten an error of LAMMPS by the place in its source and the command."""
    return one_line(re.sub(r"\(src/[^)]*\)", "", error.partition("Last input line")[0]))


def _predicted(case: CaseRecord) -> bool:
    return case.verdict == "explained" and bool(case.explained_by) and not case.fields


def _foreseen(case: CaseRecord) -> Verdict:
    """Return the verdict that a case would have without the finding that predicts it."""
    if case.ended in ("crashed", "timeout", "error"):
        return case.ended
    return "refused" if case.ended == "refused" and not case.expects else "differs"


def _own_end(case: CaseRecord) -> str:
    if case.harness_error is not None:
        fault = case.harness_error
        return f"{fault.exception} in the harness: {fault.text}" if fault.exception else f"judging failed: {fault.text}"
    if case.lacks:
        return f"this LAMMPS has no {case.lacks!r}"
    if case.ended == "unusable" and case.unusable is not None:
        return _unusable(case.unusable)
    wrong = _mismatch(case.mismatch) if case.mismatch else ""
    if case.ended == "accepted":
        more = f", and {wrong}" if wrong else ""
        return f"LAMMPS accepts what the manual refuses{more}; expected an error with {case.expects!r}"
    if case.ended == "refused" and case.expects and case.verdict != "refused":
        return f"expected an error with {case.expects!r}, LAMMPS printed: {case.engine_error}"
    return case.engine_error or wrong


def _unusable(answer: LostAtoms | OtherSteps) -> str:
    if isinstance(answer, LostAtoms):
        return (
            f"id (stage input): LAMMPS returned {answer.returned} of {answer.given} atoms; "
            f"first missing, foreign or doubled id: {answer.first_id}"
        )
    return f"LAMMPS counted steps {tuple(answer.counted)} instead of the requested {tuple(answer.asked)}"


def _mismatch(wrong: Mismatch) -> str:
    names = ", ".join(wrong.fields)
    match wrong.kind:
        case "not finite":
            return f"{names} are NaN or infinite"
        case "logged":
            return f"the log holds {wrong.text!r}"
        case "blind":
            return f"the probe is blind: its control passes ({wrong.text})"
        case "measured":
            number, expected, bound = wrong.values
            return f"{names} is measured as {number:.6g}, where {expected:.6g} within {bound:.2g} is expected"
        case "other atoms":
            return f"{names} differs: {wrong.counts[0]} and {wrong.counts[1]} atoms"
        case "other numbers":
            one, other = wrong.values
            return f"{names} differs at {wrong.counts[0]} of {wrong.counts[1]} numbers, most {one!r} and {other!r}"


def not_predictable(steps: Sequence[int], findings: Iterable[str]) -> str:
    """Describe in which steps findings leave nothing of a field to compare."""
    some_steps = f"step {steps[0]}" if len(steps) == 1 else f"steps {steps[0]} to {steps[-1]}"
    return f"not predictable in {some_steps}, because of the known bug {listed(findings)}"
