"""Reductions of a scene by kind; each returns the smallest failing content that it finds.

A candidate fails if it fails in the same way as the shrunk case. Each reduction is deterministic and accepts only
smaller contents, so that repeating all of them terminates.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from eos_ref import InputError
from lammps_cases.bugs.shrink.candidate import (
    VALUES,
    Content,
    FailureMode,
    Path,
    at,
    digits,
    keys,
    leaves,
    only_particles,
    only_types,
    replaced,
    types_of,
    without,
)

Fails = Callable[[Content], FailureMode | None]  # how a content fails, if in the same way
# Numbers of neighbours; the limit of divergence, below 1 or not much above, is not lowered by these.
COUNTS: tuple[Path, ...] = (
    ("rheo", "zmin"),
    ("rheo", "surface_detection", "limit"),
    ("rheo", "surface_detection", "splash"),
)
FEW = 16  # particles
ROUNDINGS = (1, 2, 3, 4, 6, 8)  # significant digits


def one_field(content: Content, fails: Fails) -> Content:
    """Compare only the blamed field: fewer predictions make all later reductions faster."""
    failure = fails(content)
    if failure is None or not failure.shown_in or len(content.get("compare", ())) < 2:
        return content
    candidate = content | {"compare": [failure.shown_in]}
    return candidate if fails(candidate) else content


def fewer_steps(content: Content, fails: Fails) -> Content:
    """Take fewer time steps: none, one, or as many as until the first is outside; with few particles, bisect.

    Steps of many particles are slow to predict, and the blame, read at every step, gives the first without a search.
    """
    evolve = content.get("evolve")
    if evolve is None:
        return content
    if fails(static := without(content, ("evolve",))):
        return static

    def lasting(steps: int) -> Content:
        compared = [step for step in evolve.get("compare_at") or () if step < steps]
        new = {**evolve, "steps": steps}
        if evolve.get("compare_at") is not None:
            new["compare_at"] = [*compared, steps]
        return content | {"evolve": new}

    best = int(evolve["steps"])
    if best > 1 and fails(lasting(1)):
        return lasting(1)
    failure = fails(content)
    first = failure.step if failure and failure.step else best
    if 1 < first < best and fails(lasting(first)):
        best = first
    low = 1 if not failure or failure.step is None or len(content["positions"]["x"]) <= FEW else best  # does not fail
    while best - low > 1:
        middle = (low + best) // 2
        if fails(lasting(middle)):
            best = middle
        else:
            low = middle
    return lasting(best) if best < evolve["steps"] else content


def fewer_particles(content: Content, fails: Fails) -> Content:
    """Keep the blamed particle and its nearest neighbours; leave out parts of them, down to single ones."""
    n = len(content["positions"]["x"])
    failure = fails(content)
    if n == 1 or failure is None:
        return content
    order = _nearest(content, failure.atom or 1)
    rows = list(range(n))
    count = 1
    while count < n:
        near = sorted(order[:count])
        if smaller := next((c for c in _with_lower_counts(content, count) if fails(only_particles(c, near))), None):
            content, rows = smaller, near
            break
        count *= 2
    rows = _without_parts(rows, lambda kept: fails(only_particles(content, kept)) is not None)
    return only_particles(content, rows)


def _with_lower_counts(content: Content, particles: int) -> Iterator[Content]:
    """Yield a content, then variants with limits of neighbours that a few particles can be above and below."""
    yield content
    limits = [path for path in COUNTS if _holds(content, path)]
    for limit in dict.fromkeys((particles - 1, particles // 2)):
        lower = content
        for path in limits:
            value = at(content, path)
            lower = replaced(lower, path, type(value)(min(value, max(limit, 1))))
        if lower != content:
            yield lower


def _holds(content: Content, path: Path) -> bool:
    part: Any = content
    for key in path:
        if not isinstance(part, dict) or key not in part:
            return False
        part = part[key]
    return True


def _nearest(content: Content, atom: int) -> list[int]:
    positions = content["positions"]
    x_nc = np.array(positions["x"], float)
    edge_c = np.array(positions["high"], float) - np.array(positions["low"], float)
    periodic_c = np.array(positions.get("periodic") or [True] * len(edge_c))
    d_nc = x_nc - x_nc[min(atom, len(x_nc)) - 1]
    d_nc -= np.where(periodic_c, np.round(d_nc / edge_c) * edge_c, 0.0)
    order: list[int] = np.argsort((d_nc**2).sum(axis=1), kind="stable").tolist()
    return order


def _without_parts(rows: list[int], fails: Callable[[list[int]], bool]) -> list[int]:
    """Leave out halves, quarters, ... and single rows until none can be left out (ddmin, its complements)."""
    parts = 2
    while len(rows) > 1:
        chunk = -(-len(rows) // parts)
        for begin in range(0, len(rows), chunk):
            rest = rows[:begin] + rows[begin + chunk :]
            if rest and fails(rest):
                rows, parts = rest, max(parts - 1, 2)
                break
        else:
            if chunk == 1:
                break
            parts = min(2 * parts, len(rows))
    return rows


def fewer_types(content: Content, fails: Fails) -> Content:
    """Leave out types without particles, and give the particles of one type to another."""
    changed = True
    while changed and len(content["types"]) > 1:
        changed = False
        for candidate in _with_fewer_types(content):
            if fails(candidate):
                content, changed = candidate, True
                break
    return content


def _with_fewer_types(content: Content) -> Iterator[Content]:
    type_n = types_of(content)
    every = range(1, len(content["types"]) + 1)
    used = sorted(set(type_n))
    choices = [(used, type_n)] if len(used) < len(every) else []
    choices += [([t], [t] * len(type_n)) for t in used]
    choices += [
        ([t for t in used if t != a], [b if t == a else t for t in type_n]) for a in used for b in used if a != b
    ]
    for kept, new_n in choices:
        try:
            yield only_types(content, kept, new_n)
        except InputError:
            continue


def fewer_keys(content: Content, fails: Fails) -> Content:
    """Leave out every dispensable key, whose default then holds, and member of a list, the outer ones first."""
    content = _plainer_values(content, fails)
    tried: set[Path] = set()
    while True:
        # A type has its number by its place: `fewer_types` leaves them out.
        path = next((p for p in keys(content) if p not in tried and (p[0] != "types" or len(p) != 2)), None)
        if path is None:
            return content
        tried.add(path)
        candidate = without(content, path)
        if fails(candidate):
            content, tried = candidate, {p for p in tried if p[: len(path)] != path}


def _plainer_values(content: Content, fails: Fails) -> Content:
    """Write one value for all particles, one linear law for all types."""
    linear = [{"types": "*", "style": "linear"}]
    candidates: list[tuple[Path, Any]] = [(("pressure",), linear)] if content["pressure"] != linear else []
    for name in VALUES:
        if values := content.get(name, {}).get("values"):
            candidates += [((name,), {"uniform" if name == "velocity" else "constant": values[0]})]
    if set(types_of(content)) == {1} and "types" in content["positions"]:
        candidates.append((("positions",), {k: v for k, v in content["positions"].items() if k != "types"}))
    for path, value in candidates:
        candidate = replaced(content, path, value)
        if fails(candidate):
            content = candidate
    return content


def simpler_box(content: Content, fails: Fails) -> Content:
    """Open the periodic faces of the box, and shrink it around the particles."""
    positions = content["positions"]
    d = len(positions["low"])
    periodic = list(positions.get("periodic") or [True] * d)
    if not any(periodic) or positions.get("tilt"):  # an edge leans between periodic axes alone
        return content
    x_nc, around = np.array(positions["x"], float), 2.0 * positions.get("spacing", 1.0)
    x_nc = x_nc - x_nc[0]
    low_c, high_c = x_nc.min(axis=0) - around, x_nc.max(axis=0) + around
    close = {"x": x_nc.tolist(), "low": low_c.tolist(), "high": high_c.tolist()}
    opened = {"periodic": [False] * d}
    for update in (
        close | opened,
        opened,
        *({"periodic": [*periodic[:c], False, *periodic[c + 1 :]]} for c in range(d)),
    ):
        candidate = content | {"positions": positions | update}
        if candidate != content and fails(candidate):
            return simpler_box(candidate, fails)
    return content


def fewer_digits(content: Content, fails: Fails) -> Content:
    """Round all numbers to few digits, then each to 0, 1 or as few digits as possible."""
    for figures in ROUNDINGS:
        candidate = content
        for path, value in _numbers(content):
            candidate = replaced(candidate, path, _rounded(value, figures))
        if candidate == content:
            break
        if fails(candidate):
            content = candidate
            break
    for path, _ in list(_numbers(content)):
        value = at(content, path)
        plainer = sorted({0.0, 1.0, *(_rounded(value, figures) for figures in ROUNDINGS)}, key=_complexity)
        for other in plainer:
            if _complexity(other) >= _complexity(value):
                break
            candidate = replaced(content, path, other)
            if fails(candidate):
                content = candidate
                break
    return content


def _numbers(content: Content) -> Iterator[tuple[Path, float]]:
    return ((path, value) for path, value in leaves(content) if isinstance(value, float))


def _rounded(value: float, figures: int) -> float:
    return float(f"{value:.{figures - 1}e}")


def _complexity(value: float) -> tuple[int, float, float]:
    """Return a sort key of numbers: 0, 1, then those with few digits, near 1 in size."""
    if value in (0.0, 1.0):
        return int(value), 0.0, 0.0
    return 1 + digits(value), abs(float(np.log10(abs(value)))), float(value < 0)


REDUCTIONS: Sequence[Callable[[Content, Fails], Content]] = (
    one_field,
    fewer_steps,
    fewer_particles,
    fewer_types,
    fewer_keys,
    simpler_box,
    fewer_digits,
)
