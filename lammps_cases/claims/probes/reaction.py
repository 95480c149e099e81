"""What LAMMPS does with bad input, in one word: whether its error is clear, or nothing is said, or it dies."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from typing import Any, Literal, get_args

import numpy as np

from lammps_cases.claims.probes.probe import Probe, base, commands, replaced
from lammps_cases.claims.probes.run import Reply
from lammps_cases.records.case_wording import error_text
from lammps_cases.records.wording import one_line

Reaction = Literal[
    "clear error",
    "vague error",
    "misleading error",
    "warning",
    "no effect",
    "silent acceptance",
    "silent NaN",
    "crash",
    "hang",
]
REACTIONS: tuple[Reaction, ...] = get_args(Reaction)
ERRORS: tuple[Reaction, ...] = ("clear error", "vague error", "misleading error")


def said(error: str) -> str:
    """Return LAMMPS' own words of an error: without the place in its source, nor the command, which it repeats."""
    return one_line(re.sub(r"ERROR( on proc \d+)?:|For more information see \S+", "", error_text(error)))


def offending(probe: Probe) -> tuple[str, ...]:
    """Return the words of an input that its base lacks, without single digits, which many texts hold."""
    before = commands(base(probe.base))
    present = set(" ".join(before).split())
    new = [word for line in probe.add for word in line.split() if word not in present]
    for line in before:
        first, *more = replaced((line,), probe.edits) or ("",)
        new += (Counter(first.split()) - Counter(line.split())).elements()
        new += (word for other in more for word in other.split() if word not in present)
    return tuple(word for word in dict.fromkeys(new) if not re.fullmatch(r"\d", word))


def names_it(text: str, names: Sequence[str]) -> bool:
    """Return whether a text holds one of the words, whole and in any case; latent/heat may be spelt latent heat."""

    def held(name: str) -> bool:
        spelt = "[/_ ]".join(map(re.escape, re.split("[/_ ]", name)))
        return bool(re.search(rf"(?<![\w./-]){spelt}(?![\w/])(?!\.\d)", text, re.IGNORECASE))

    return any(map(held, names))


def reaction(
    reply: Reply, names: Sequence[str], others: Sequence[str] = (), control: Reply | None = None
) -> tuple[Reaction, str]:
    """Return the class of what LAMMPS did with an input, and its text.

    An error is *clear* if it holds one of the names of what is wrong; *misleading* if instead it holds one of the words
    by which it speaks of something else; else *vague*. Where LAMMPS goes on, it is a *warning* if its log has one that
    the control's has not, *silent NaN* if any number of the particles after the last step is not finite, *no effect* if
    all numbers are those of the control, to the last bit, and *silent acceptance* if they are others.

    Parameters
    ----------
    names, others : sequence of str
        What is wrong, and what is not, in the manual's words.
    control : Reply, optional
        To the same input without what is wrong; without it nothing has no effect.

    Raises
    ------
    RuntimeError
        The harness failed, not LAMMPS.
    """
    match reply.ended:
        case "answered":
            return _accepted(reply, control)
        case "crashed":
            return "crash", reply.error
        case "timeout":
            return "hang", reply.error
        case "error":
            raise RuntimeError(reply.error)
        case "lost":  # the harness counts atoms; LAMMPS itself said nothing
            return "silent acceptance", said(reply.error)
    text = said(reply.error)
    if names_it(text, names):
        return "clear error", text
    return "misleading error" if names_it(text, others) else "vague error", text


def warnings(reply: Reply) -> list[str]:
    """Return the warnings of a log, in its order, without the place in LAMMPS' source."""
    lines = [line for line in reply.log.splitlines() if line.startswith("WARNING")]
    return [one_line(re.sub(r"WARNING( on proc \d+)?:|\([^()]*\.(cpp|h):\d+\)", "", line)) for line in lines]


def _accepted(reply: Reply, control: Reply | None) -> tuple[Reaction, str]:
    numbers = {name.removeprefix("q."): np.asarray(v, float) for name, v in reply.arrays.items() if name != "id"}
    wrong = {name: ~np.isfinite(v).all(axis=tuple(range(1, v.ndim))) for name, v in numbers.items()}
    bad = {name: int(wrong_n.sum()) for name, wrong_n in wrong.items() if wrong_n.any()}
    p_n = numbers.get("pressure", np.zeros(0))
    text = f"pressure {p_n.min():.4g} to {p_n.max():.4g}" if p_n.size else "no atoms"
    if bad:
        counts = ", ".join(f"{name} of {count}" for name, count in sorted(bad.items()))
        text = f"not finite: {counts} of {len(next(iter(numbers.values())))} atoms"
    given = warnings(control) if control else []
    if new := [line for line in warnings(reply) if line not in given]:
        return "warning", f"{new[0]}; {text}"
    if bad:
        return "silent NaN", text
    if control is not None and same(reply.arrays, control.arrays):
        return "no effect", text
    return "silent acceptance", text


def same(one: dict[str, Any], other: dict[str, Any]) -> bool:
    """Return whether arrays are the same to the last bit."""
    return one.keys() == other.keys() and all(np.array_equal(one[name], other[name]) for name in one)
