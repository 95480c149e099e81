"""Which method to use, in a sentence: computed from the points of a panel."""

from __future__ import annotations

import math
from collections.abc import Mapping

from lammps_cases.records.wording import brief, times
from lammps_cases.studies.chart.record import LAMMPS, ONE_BIT, MethodPanel, MethodPoint

NOTICEABLE = 1.1  # factor between times from which another method is worth a condition
ROUNDED = 8 * 2.0**-53  # errors below are those of the last few operations: all the same
Points = Mapping[str, MethodPoint]  # of a regime, by method


def recommendation(panel: MethodPanel) -> str:
    """Return the method to use everywhere, better ones for some regimes, and what LAMMPS loses against it.

    A method will do in a regime if its error is at most twice the least one there, or `ROUNDED`. Of those that will do
    in every regime the fastest is recommended, by the geometric mean of its time over the shortest; if none will,
    the one whose error exceeds the least by the smallest factor.
    """
    regimes = {name: {p.method: p for p in panel.of(name)} for name in panel.regimes}
    own = [m for m, p in next(iter(regimes.values()), {}).items() if p.engine != LAMMPS]
    if not own:
        return ""
    excess = {m: max(_excess(m, points) for points in regimes.values()) for m in own}
    time = {m: math.prod(_slowness(m, of) for of in regimes.values()) ** (1 / len(regimes)) for m in own}
    enough = [m for m in own if excess[m] <= ONE_BIT]
    chosen = min(enough, key=time.__getitem__) if enough else min(own, key=excess.__getitem__)
    if math.isinf(excess[chosen]):
        return "No method is right everywhere."
    fastest = min(own, key=time.__getitem__)
    sentences = [f"Use “{chosen}”: {_error(chosen, regimes)}, {_cost(chosen, fastest, time)}"]
    sentences += _exceptions(chosen, own, regimes)
    return "; ".join(sentences) + "." + _of_lammps(chosen, regimes)


def _size(point: MethodPoint) -> float:
    return max(point.error, ROUNDED / ONE_BIT) if point.error < math.inf else math.inf


def _excess(method: str, points: Points) -> float:
    least = min(_size(p) for p in points.values() if p.engine != LAMMPS)
    return _size(points[method]) / least if least < math.inf else math.inf


def _slowness(method: str, points: Points) -> float:
    return points[method].ns.median / min(p.ns.median for p in points.values() if p.engine != LAMMPS)


def _error(method: str, regimes: Mapping[str, Points]) -> str:
    where = " everywhere" if len(regimes) > 1 else ""
    return f"error of at most {brief(max(of[method].error for of in regimes.values()))}{where}"


def _cost(method: str, fastest: str, time: Mapping[str, float]) -> str:
    if method == fastest:
        return "none is faster"
    return f"{times(time[method] / time[fastest])} times the time of the fastest, “{fastest}”"


def _exceptions(chosen: str, own: list[str], regimes: Mapping[str, Points]) -> list[str]:
    """Return the methods that are noticeably faster where their errors will do, with these regimes."""
    where: dict[str, dict[str, float]] = {}
    for regime, points in regimes.items():
        best = min((m for m in own if _excess(m, points) <= ONE_BIT), key=lambda m: points[m].ns.median, default=chosen)
        factor = points[chosen].ns.low / points[best].ns.high
        if factor > NOTICEABLE:
            where.setdefault(best, {})[regime] = points[chosen].ns.median / points[best].ns.median
    return [
        f"“{method}”, {times(max(faster.values()))} times as fast, only for {_listed([*faster])}"
        for method, faster in where.items()
    ]


def _listed(regimes: list[str]) -> str:
    """Return regimes in a row, the variable of all only once: d from 0 to 1 or 1 to 2."""
    variable, word, _ = regimes[0].partition(" from ")
    return " or ".join([regimes[0], *(regime.removeprefix(variable + word) for regime in regimes[1:])])


def _of_lammps(chosen: str, regimes: Mapping[str, Points]) -> str:
    """State how many digits LAMMPS loses at most against the chosen method, and its time; empty without LAMMPS."""
    pairs = [(regime, of.get(f"{LAMMPS} {chosen}", of.get(LAMMPS)), of[chosen]) for regime, of in regimes.items()]
    compared = [(ours.digits - p.digits, regime, p.ns.median / ours.ns.median) for regime, p, ours in pairs if p]
    if not compared:
        return ""
    lost, regime, _ = max(compared)
    ratios = [ratio for _, _, ratio in compared if ratio > 0]  # a difference of two noisy times may be negative
    took = " to ".join(dict.fromkeys(times(of(ratios)) for of in (min, max))) if ratios else ""
    least = math.log10(ONE_BIT)
    accuracy = f"loses up to {lost:.1f} digits against it, at {regime}," if lost > least else "is as accurate"
    return f" LAMMPS {accuracy}" + (f" and takes {took} times as long." if took else ".")
