"""What LAMMPS does with bad input, in one word: whether its error is clear, or nothing is said, or it dies."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np

from lammps_cases.probes.probe import Probe, base, commands, replaced
from lammps_cases.probes.run import Reply
from lammps_cases.records.wording import error_text, one_line

Reaction = Literal["clear error", "misleading error", "silent acceptance", "silent NaN", "crash", "hang"]


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


def reaction(reply: Reply, names: Sequence[str]) -> tuple[Reaction, str]:
    """Return the class of what LAMMPS did with an input, and its text.

    An error is clear if it holds one of the names of what is wrong, else misleading; silence is NaN if any number of
    the particles after the last step is not finite.

    Raises
    ------
    RuntimeError
        The harness failed, not LAMMPS.
    """
    match reply.ended:
        case "answered":
            return _silent(reply.arrays)
        case "crashed":
            return "crash", reply.error
        case "timeout":
            return "hang", reply.error
        case "error":
            raise RuntimeError(reply.error)
    text = said(reply.error)
    if text.startswith("LAMMPS kept"):  # the harness counts atoms; LAMMPS itself said nothing
        return "silent acceptance", text
    return "clear error" if names_it(text, names) else "misleading error", text


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
