"""The hand calculation of a number: formulas over what the reference summed over the pairs of one particle."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from lammps_cases.comparison.pair_sums import Sum


@dataclass(frozen=True)
class Line:
    """A line of the calculation: a name, its formula, the same with numbers for LAMMPS, the value."""

    name: str
    formula: str
    numbers: str
    value: float


def symbols(given: Sum) -> dict[str, float]:
    """Return what formulas may name, each with the id of its particle: m1, rho1, v1 by components, of pairs r2, W2.

    ``gx2`` and ``gy2`` are the gradient of the kernel at the pair of the particle of the number with particle 2, ``x2``
    and ``y2`` its distance vector.
    """
    numbers: dict[str, float] = {}
    for one in (given.particle, *(pair.other for pair in given.pairs)):
        values = {"m": one.mass, "rho": one.rho, "vx": one.v[0], "vy": one.v[1], **one.constants}
        numbers |= {f"{name}{one.id}": number for name, number in values.items()}
    for pair in given.pairs:
        values = {"r": pair.r, "W": pair.w, "x": pair.x[0], "y": pair.x[1]}
        values |= {"gx": pair.gradient[0], "gy": pair.gradient[1]}
        numbers |= {f"{name}{pair.other.id}": number for name, number in values.items()}
    return numbers


def calculate(formulas: Mapping[str, str], given: Sum) -> tuple[Line, ...]:
    """Evaluate formulas one after another, each of which may name those before it."""
    numbers, lines = symbols(given), dict[str, Line]()
    for name, formula in formulas.items():

        def number(word: re.Match[str]) -> str:
            if word[0] in lines:
                return f"${{{word[0]}}}"
            return repr(numbers[word[0]]) if numbers[word[0]] >= 0 else f"({numbers[word[0]]!r})"

        scope = numbers | {line.name: line.value for line in lines.values()}
        result = float(eval(formula.replace("^", "**"), {"__builtins__": {}}, scope))  # of this package's own data
        lines[name] = Line(name, formula, re.sub(r"[A-Za-z]\w*", number, formula), result)
    return tuple(lines.values())
