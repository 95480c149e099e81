"""Sentences on an audited deck: effects of findings, how its state broke, why it failed, what was not checked."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence

from lammps_cases.records import case_wording, wording
from lammps_cases.records.case_parts import BreakRecord, EffectRecord, FieldRecord, LostRecord
from lammps_cases.records.levels import FAIL_ON, SEVERITIES, Severity, allowed, fails, severity_of
from lammps_cases.records.run_record import CaseRecord, Level
from lammps_cases.records.wording import counted, listed, number, times

_MORE = re.compile(r" For more information see \S+")
IN_BRIEF = 60  # characters of a reason that a headline has room for
PLURALS = {
    **dict.fromkeys(("f", "fx", "fy", "fz"), "forces"),
    **dict.fromkeys(("x", "y", "z"), "positions"),
    **dict.fromkeys(("v", "vx", "vy", "vz"), "velocities"),
    **dict.fromkeys(("energy", "esph", "e"), "energies"),
    "rho": "densities",
    "drho": "rates of density",
    "heatflow": "heat flows",
    "pressure": "pressures",
    "temperature": "temperatures",
    "grad/v": "velocity gradients",
    "shift/v": "shifts",
}


def plural(field: str) -> str:
    """Name the values of a field or column."""
    return PLURALS.get(field, f"values of {field}")


def percent(part: float) -> str:
    """Format a part in percent, with two digits at least: 0.004, 12, 250."""
    return f"{100 * part:.0f}" if part >= 1 else number(100 * part, 2)


# --- effects of findings


def effects(case: CaseRecord) -> dict[str, str]:
    """Describe, by finding, the effects of known findings on an audited deck."""
    lines: dict[str, list[str]] = {of.finding: [of.does] for of in case.acting}
    for of in case.effects:
        lines.setdefault(of.finding, []).append(effect(of))
    return {finding: "; ".join(said) for finding, said in lines.items()}


def effect(of: EffectRecord) -> str:
    """Describe the effect of a finding on a field of an audited deck."""
    where = f"{of.particles} of {counted(of.of, 'particle')}, step {of.step}"
    if of.factor is not None and number(of.factor) != "1":
        how = f"1/{times(1 / of.factor)} of" if 0 < of.factor <= 1 / wording.FACTOR else f"{times(of.factor)} times"
        return f"{of.field} is {how} what it should be ({where})"
    if of.relative is None:
        return f"{of.field} is wrong where it should be 0 ({where})"
    if of.relative >= wording.FACTOR:
        return f"{of.field} is off by up to {times(of.relative)} times its largest right value ({where})"
    return f"{of.field} is wrong by up to {percent(of.relative)} % of its largest value ({where})"


def in_brief(of: EffectRecord) -> str:
    """Describe the same in a few words: forces are 100 times too large."""
    if of.factor is not None and of.factor >= 2:
        how = f"{times(of.factor)} times too large"
    elif of.factor is not None and 0 < of.factor <= 0.5:
        how = f"{times(1 / of.factor)} times too small"
    elif of.relative is None:
        how = "wrong where they should be 0"
    elif of.relative >= wording.FACTOR:
        how = f"off by up to {times(of.relative)} times their largest right value"
    else:
        how = f"off by at most {percent(of.relative)} %"
    return f"{plural(of.field)} are {how}"


def change(case: CaseRecord, finding: str) -> float:
    """Return the largest effect of a finding on a deck, over the largest right value; infinite if it is unknown."""
    of_finding = [of.relative for of in case.effects if of.finding == finding]
    known = of_finding and all(of is not None and math.isfinite(of) for of in of_finding)
    return max(of_finding) if known else math.inf  # type: ignore[type-var, return-value]


def severity(case: CaseRecord, finding: str) -> Severity:
    """Return the severity of a finding on a deck: by what it changes there, else that of the finding itself."""
    effect = change(case, finding)
    general = next((of.severity for of in case.acting if of.finding == finding), None)
    return general if general and math.isinf(effect) else severity_of(effect)


def rejected(case: CaseRecord, fail_on: Level) -> list[str]:
    """Return the findings of a deck that a level rejects; an unknown effect is above every level."""
    if fail_on in FAIL_ON:
        return [finding for finding in case.findings if fails(severity(case, finding), fail_on)]
    return [finding for finding in case.findings if change(case, finding) > allowed(fail_on)]


def what(case: CaseRecord, finding: str) -> str:
    """Describe the effect of a finding on a deck in a few words, with its name."""
    records = [of for of in case.effects if of.finding == finding]
    acts = [of.does for of in case.acting if of.finding == finding]
    own = [of.does for of in case.acting if of.finding == finding and of.own]
    fields = [field.field for field in case.fields if finding in field.explained_by]
    if own:
        said = own[0]
    elif records:
        said = in_brief(max(records, key=lambda of: -1.0 if of.relative is None else of.relative))
    else:
        said = acts[0] if acts else f"{plural(fields[0])} are wrong" if fields else ""
    return f"{said} ({finding})" if said else finding


def bugs(case: CaseRecord) -> list[str]:
    """Return the findings that act on a deck, the most severe first, then by effect."""

    def rank(finding: str) -> tuple[int, float]:
        return SEVERITIES.index(severity(case, finding)), -change(case, finding)

    return sorted(case.findings, key=rank)


# --- what happened


def broke(of: BreakRecord) -> str:
    """Describe where the state of a deck stops being that of a fluid."""
    if of.kind == "runaway" and not of.given:
        return f"{plural(of.column)} run away from {_step(of)} on"
    return f"{of.column} of atom {of.atom} is {of.value} at {_step(of)}"


def broke_at_length(of: BreakRecord) -> str:
    """Describe the same with the numbers, and whether both codes agree."""
    where = f"{of.particles} of {counted(of.of, 'particle')}, first atom {of.atom}: {number(of.value)}"
    if of.given:
        return f"{broke(of)} ({where}), with which run {of.run} begins: a command before it has set it"
    of_state = of.column in PLURALS and not of.column.startswith("f")
    codes = "the reference has the same, from the same state" if of.both else "the reference has finite numbers there"
    return f"{broke(of)} ({where})" + ("" if of_state else f"; {codes}")


def _step(of: BreakRecord | LostRecord) -> str:
    return f"step {of.step}" + (f" of run {of.run}" if of.run > 1 else "")


def lost(of: LostRecord) -> str:
    """Describe how many particles a deck lost without an error."""
    return f"{of.lost} of {counted(of.of, 'atom')} lost by {_step(of)}, after which LAMMPS goes on (thermo_modify lost)"


def event(case: CaseRecord) -> str:
    """Describe how a deck failed; empty if it did not."""
    if case.broke and (case.broke.kind == "not a number" or case.broke.given):
        return broke(case.broke)
    if case.lost and not case.lost.ignored and not case.as_expected:
        return f"LAMMPS loses {case.lost.lost} of {counted(case.lost.of, 'atom')} by {_step(case.lost)}"
    if case.broke:
        return broke(case.broke)
    if case.as_expected or case.verdict == "differs":
        return ""
    words = _MORE.sub("", case_wording.own_words(case) or case.verdict)
    return f"LAMMPS stops at step {case.steps}: {words}" if case.verdict == "refused" and case.checks else words


def failure(case: CaseRecord) -> str:
    """Describe why the audit of a deck fails, with its cause and what is new; empty if it does not."""
    why = [_with_cause(event(case), case), _new(case)]
    return "; ".join(filter(None, why)) or ("" if case.as_expected else case.verdict)


def _with_cause(what_happened: str, case: CaseRecord) -> str:
    of = case.outlook
    if of is None or not what_happened:
        return what_happened
    if of.cause == "findings":
        known = "a known bug" if len(of.findings) == 1 else "known bugs"
        return f"{what_happened}, because of {known}: {'; '.join(what(case, name) for name in of.findings)}"
    if of.cause == "not understood":
        return f"{what_happened}, which is not understood"
    cause = "unstable because of the time step" if of.cause == "time step" else "unstable as set up"
    return f"{cause}: {of.because} ({what_happened})" if of.because else f"{cause}: {what_happened}"


def _new(case: CaseRecord) -> str:
    differing = list(dict.fromkeys(field.field for field in case.fields if field.verdict == "differs"))
    first = case.blame
    if first is None or not differing:
        return f"{listed(differing)} differ (new)" if differing else ""
    step = f"step {first.step}" + (f" of run {first.run}" if (first.run or 1) > 1 else "")
    limit = f"a known limit of {listed(case.limits)}" if case.limits else "new"
    others = [name for name in differing if name != first.field]
    more = f"; {listed(others)} too" if others else ""
    return f"{first.field} differs at {first.outside} of {counted(first.of, 'atom')} from {step} on ({limit}){more}"


# --- other remarks


def nothing(case: CaseRecord) -> str:
    """State that nothing was compared, and why if known."""
    return "nothing was compared" + (f": {case.message}" if case.message else "")


def unchecked(case: CaseRecord, never: Mapping[str, str] | None = None) -> list[str]:
    """Describe which fields an audit could not check, those with one reason in one line.

    Fields that are ``never`` checked, given with their reasons, are listed in one line without them.
    """
    reasons: dict[str, list[str]] = {}
    for name, reason in case.unchecked.items():
        known = (never or {}).get(name) == reason
        reasons.setdefault("not in any audit (the report says why)" if known else reason, []).append(name)
    return [f"{', '.join(names)}: {reason}" for reason, names in reasons.items()] or case.not_checked


def remarks(case: CaseRecord) -> list[str]:
    """Describe in a few words each what a headline must add to the state: gaps, losses, warnings."""
    missed = {name: reason for name, reason in case.unchecked.items() if name not in case.out_of_scope}
    names, reasons, said = list(missed), set(missed.values()), []
    if missed:
        reason = reasons.pop() if len(reasons) == 1 else ""
        said.append(f"{_all(names)} not checked" + (f" ({reason})" if 0 < len(reason) <= IN_BRIEF else ""))
    until = [field for field in case.fields if field.until is not None]
    if until:
        said.append(f"checked to step {min(field.until or 0 for field in until)} only")
    if case.lost and case.lost.ignored:
        said.append(f"{case.lost.lost} of {counted(case.lost.of, 'atom')} lost")
    if case.warnings:
        said.append(counted(len(case.warnings), "warning") + (f": {case.brief}" if case.brief else ""))
    return said


def _all(names: Sequence[str]) -> str:
    return wording.some(names, 3) if len(names) > 3 else " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))


def verdict(field: FieldRecord) -> str:
    """Return the verdict on a field with its qualifications: how long it was judged, and equal rounding."""
    until = "" if field.until is None else f" to step {field.until}"
    return f"{field.verdict}{until}" + (" (same rounding)" if field.verdict == "exact" and field.max_abs else "")
