"""What LAMMPS does with every input that the project refuses: a table, each row from a LAMMPS that it cannot harm."""

from __future__ import annotations

import functools
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np

from lammps_cases.engine import session
from lammps_cases.engine.session import Answer, Job
from lammps_cases.engine.workers import Failure, Workers
from lammps_cases.findings import LEDGER
from lammps_cases.records.progress import SILENT, Progress
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan
from lammps_cases.studies.stability.refusals import BadInput, Base, bad_inputs, edited, load_scene, refusal

Reaction = Literal["clear error", "misleading error", "silent acceptance", "silent NaN", "crash", "hang"]
REACTIONS: tuple[Reaction, ...] = get_args(Reaction)
TIME_LIMIT = 10.0  # seconds that LAMMPS has for an input; the scenes take 0.01


@dataclass(frozen=True)
class InputRow:
    """One input and what becomes of it.

    Attributes
    ----------
    words : the input as a deck would hold it
    refusal : what the project says
    reaction, text : what LAMMPS does, and its text, or the numbers with which it goes on
    promise : what LAMMPS' manual says to it, if anything
    candidate : whether LAMMPS goes on, or dies, where its manual promises otherwise
    ledger : the finding that is known of it
    """

    id: str
    area: str
    words: str
    refusal: str
    reaction: Reaction
    text: str
    promise: str = ""
    candidate: bool = False
    ledger: str = ""


# --- the input in LAMMPS' words


@functools.cache
def base_job(base: Base) -> Job:
    """What LAMMPS is told of a harmless scene."""
    case, laid = load_scene(base, {})
    return job(case.scene, laid, plan(case.scene))


def commands(told: Job) -> tuple[str, ...]:
    """All commands of a job, runs included, in order."""
    return *told.setup, *told.commands, *(stretch.command for stretch in told.runs)


def put(bad: BadInput) -> Job:
    """The job that puts an input to LAMMPS.

    Raises
    ------
    ValueError
        A text to be replaced stands in no command of the base, or in several.
    """
    told = base_job(bad.base)
    for old, _ in bad.edits:
        found = sum(line.count(old) for line in commands(told))
        if found != 1:
            raise ValueError(f"{bad.id}: {old!r} stands {found} times in the commands of the base")

    def changed(lines: Sequence[str]) -> tuple[str, ...]:
        return tuple(part for line in lines for part in edited(line, bad.edits).split("\n"))

    told = replace(
        told,
        setup=changed(told.setup),
        commands=bad.add + changed(told.commands),
        runs=tuple(replace(stretch, command=edited(stretch.command, bad.edits)) for stretch in told.runs),
        per_atom={name: values_n for name, values_n in told.per_atom.items() if name not in bad.drop},
    )
    if "atoms" in bad.drop:
        arrays = {name: getattr(told, name)[:0] for name in ("id_n", "type_n", "x_nc")}
        told = replace(told, **arrays, v_nc=None, per_atom={})
    return told


def words(bad: BadInput) -> str:
    """The commands in which an input differs from its base, as a deck would hold them."""
    before = set(commands(base_job(bad.base)))
    lines = [line for line in commands(put(bad)) if line not in before]
    return "; ".join(lines) or f"without {', '.join(bad.drop)}"


# --- what LAMMPS does with it

Ending = Literal["error", "arrays", "crash", "hang"]


@dataclass(frozen=True)
class Ended:
    """How LAMMPS ended: with an error and its text, with arrays, with its death or not at all."""

    how: Ending
    text: str = ""
    arrays: dict[str, Any] | None = None


def ask(site: str | None, told: Job) -> Answer:
    """Task of a worker: run a job on a LAMMPS of its own, which no earlier input has touched."""
    lmp = session.open_lammps(site)
    try:
        return session.run(lmp, told)
    finally:
        lmp.close()


def ended(outcome: Answer | Failure) -> Ended:
    """How LAMMPS ended.

    Raises
    ------
    RuntimeError
        The harness failed, not LAMMPS.
    """
    if isinstance(outcome, Answer):
        return Ended("arrays", arrays=outcome.arrays)
    hows: dict[str, Ending] = {"refused": "error", "crashed": "crash", "timeout": "hang"}
    if outcome.verdict not in hows:
        raise RuntimeError(f"{outcome.verdict}: {outcome.message}")
    return Ended(hows[outcome.verdict], outcome.message)


def said(text: str) -> str:
    """LAMMPS' own words of an error: without the place in its source, nor the command, which it repeats."""
    kept = [line for line in text.splitlines() if not line.startswith("Last input line") and set(line) - set(" ^")]
    kept_words = re.sub(r"\(src/[^)]*\)|ERROR( on proc \d+)?:|For more information see \S+", "", " ".join(kept))
    return " ".join(kept_words.split())


def offending(bad: BadInput) -> tuple[str, ...]:
    """Words of the input that the base has not; a single digit names nothing, as many texts hold one."""
    before = commands(base_job(bad.base))
    known = set(" ".join(before).split())
    new = [word for line in bad.add for word in line.split() if word not in known]
    for line in before:
        first, *more = edited(line, bad.edits).split("\n")
        new += (Counter(first.split()) - Counter(line.split())).elements()
        new += (word for other in more for word in other.split() if word not in known)
    return tuple(word for word in dict.fromkeys(new) if not re.fullmatch(r"\d", word))


def names_it(text: str, names: Sequence[str]) -> bool:
    """Whether a text holds one of the words, whole and in any case; the manual's latent/heat may be latent heat."""

    def held(name: str) -> bool:
        spelt = "[/_ ]".join(map(re.escape, re.split("[/_ ]", name)))
        return bool(re.search(rf"(?<![\w./-]){spelt}(?![\w/])(?!\.\d)", text, re.IGNORECASE))

    return any(map(held, names))


def reaction(bad: BadInput, end: Ended) -> tuple[Reaction, str]:
    """Class of what LAMMPS did, and its text.

    An error is clear if it names the offending word or the quantity in the manual's words, else misleading; silence
    is NaN if any number of the particles after the last step is not finite.
    """
    match end.how:
        case "crash":
            return "crash", end.text
        case "hang":
            return "hang", end.text
        case "error":
            text = said(end.text)
            if text.startswith("LAMMPS kept"):  # the harness counts atoms; LAMMPS itself said nothing
                return "silent acceptance", text
            return "clear error" if names_it(text, (*bad.names, *offending(bad))) else "misleading error", text
    return _silent(end.arrays or {})


def _silent(arrays: dict[str, Any]) -> tuple[Reaction, str]:
    numbers = {name.removeprefix("q."): np.asarray(values, float) for name, values in arrays.items() if name != "id"}
    wrong = {name: ~np.isfinite(v).all(axis=tuple(range(1, v.ndim))) for name, v in numbers.items()}
    bad = {name: int(wrong_n.sum()) for name, wrong_n in wrong.items() if wrong_n.any()}
    if bad:
        counts = ", ".join(f"{name} of {count}" for name, count in sorted(bad.items()))
        return "silent NaN", f"not finite: {counts} of {len(arrays['id'])} atoms"
    p_n = numbers.get("pressure", np.zeros(0))
    spread = f"pressure {p_n.min():.4g} to {p_n.max():.4g}" if p_n.size else "no atoms"
    return "silent acceptance", spread


def row(bad: BadInput, end: Ended) -> InputRow:
    """The row of the table for an input and what LAMMPS did with it."""
    what, text = reaction(bad, end)
    goes_on = what in ("silent acceptance", "silent NaN", "crash", "hang")
    return InputRow(
        bad.id,
        bad.area,
        words(bad),
        refusal(bad, commands(base_job(bad.base))),
        what,
        text,
        bad.promise,
        candidate=goes_on and bool(bad.promise),
        ledger=next((entry.id for entry in LEDGER if bad.id in entry.expected_inputs), ""),
    )


def table(
    workers: Workers,
    progress: Progress = SILENT,
    inputs: Sequence[BadInput] = (),
    time_limit: float = TIME_LIMIT,
) -> list[InputRow]:
    """Put every input to LAMMPS.

    Parameters
    ----------
    workers : Workers
        Processes in which LAMMPS may die.
    progress : Progress, optional
        Is told of every input.
    inputs : sequence of BadInput, optional
        All by default.
    time_limit : float
        Seconds that LAMMPS has for each.
    """
    chosen = tuple(inputs) or bad_inputs()
    futures = [workers.call(ask, put(bad), time_limit=time_limit) for bad in chosen]
    rows = []
    for k, (bad, future) in enumerate(zip(chosen, futures, strict=True), 1):
        outcome: Answer | Failure = workers.outcome(future, time_limit)
        rows.append(row(bad, ended(outcome)))
        progress.advance(k, len(chosen), "bad inputs")
    return rows
