"""What a rate of caught faults speaks of: functions of the reference with a planted fault; and those without, why."""

from __future__ import annotations

import ast
import fnmatch
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

from tests.workshop.faults import formula, source
from tests.workshop.faults.edits import FOLDER, split_name, text_of

# Modules in which nothing is mutated by machine, and why; named mistakes may be planted there all the same.
LEFT_OUT: dict[str, tuple[str, ...]] = {
    "compiled loops: the same sums once more, held against the arrays by tests": (
        *("compiled.*", "eos.compiled", "evaluation.pair_loops", "evaluation.rounded_loops", "jit"),
    ),
    "the same sums in blocks, held against those of whole arrays by tests": ("evaluation.blocks",),
    "the judge's bounds and exact values, held against Arb by tests": (
        *("eos.bounds", "eos.rigorous", "eos.lammps_rounding", "numbers.rounded", "numbers.number"),
        "evaluation.cutoff",
    ),
    "other ways to evaluate a law, which judge no case": ("methods.*",),
    "analytic solutions of flows, which judge no case": ("analytic.*",),
    "records that say which formula is whose": ("eos.law", "eos.registry", "kernels.kernel", "kernels.styles"),
    "factors of units, which every twin in other units tests": ("model.units", "model.consistent"),
    "the box and the state, in which mistakes are planted by name": ("model.box", "model.state"),
    "the manual's text, messages and caches: no numbers of a scene": (
        *("syntax.manual", "syntax.words", "model.commands", "errors", "cache", "__init__", "*.__init__"),
    ),
}
NOT_DRAWN = "not drawn into the sample of automatic mutations"
NOT_NAMED = "not among the functions of its module that a scene's numbers go through"
NOTHING = "nothing in it that an operator of the mutations changes"


@dataclass(frozen=True)
class Coverage:
    """The functions of the reference by what is planted in them.

    Attributes
    ----------
    mutated : functions with at least one planted fault
    left_out : functions without one, by reason
    drawn, possible : automatic mutations planted, and those that the operators can make where any are planted
    """

    mutated: tuple[str, ...]
    left_out: dict[str, tuple[str, ...]]
    drawn: int
    possible: int

    @property
    def unmutated(self) -> int:
        """Return the number of functions without a fault."""
        return sum(map(len, self.left_out.values()))

    def sentence(self) -> str:
        """Say how many functions of the reference are not mutated, and why."""
        reasons = "; ".join(f"{len(functions)} {reason}" for reason, functions in self.left_out.items())
        total = len(self.mutated) + self.unmutated
        return (
            f"{self.unmutated} of {total} functions of the reference are not mutated: {reasons}. "
            f"Of {self.possible} automatic mutations of the others {self.drawn} are drawn"
        )


@cache
def coverage() -> Coverage:
    """Return which functions of the reference have a planted fault, and why the others have none."""
    planted = _planted()
    mutated: list[str] = []
    left_out: dict[str, list[str]] = {}
    for module in modules():
        for name in functions(module):
            where = f"{module}:{name}"
            if where in planted:
                mutated.append(where)
            else:
                left_out.setdefault(_reason(module, name), []).append(where)
    largest = sorted(left_out.items(), key=lambda item: -len(item[1]))
    return Coverage(
        tuple(mutated),
        {reason: tuple(names) for reason, names in largest},
        drawn=len(source.faults()),
        possible=sum(len(source.names(module, ast.parse(text_of(module)))) for module in source.MODULES),
    )


def modules() -> list[str]:
    """Return the modules of the reference, named below ``eos_ref``."""
    paths = sorted(path.relative_to(FOLDER).with_suffix("") for path in FOLDER.rglob("*.py"))
    return [".".join(path.parts) for path in paths]


def functions(module: str) -> list[str]:
    """Return the functions and methods of a module by their qualified names, without those that are abstract."""
    return [name for name, _ in _definitions(ast.parse(text_of(module)))]


def _definitions(tree: ast.Module) -> Iterator[tuple[str, ast.FunctionDef]]:
    for node in tree.body:
        inner = [(f"{node.name}.", part) for part in node.body] if isinstance(node, ast.ClassDef) else [("", node)]
        for parent, function in inner:
            if isinstance(function, ast.FunctionDef) and not source.is_abstract(function):
                yield parent + function.name, function


def _planted() -> Counter[str]:
    """Return how many faults are planted in every function: named mistakes, and automatic mutations."""
    named = (split_name(edit.function) for edit in formula.edits().values())
    counts = Counter(f"{module}:{name}" for module, name in named)
    for module in source.MODULES:
        counts.update(f"{module}:{name}" for name in source.drawn(module))
    return counts


def left_out_because(module: str) -> str:
    """Return why a module is left out of the automatic mutations; empty if it is not."""
    patterns = ((reason, pattern) for reason, of in LEFT_OUT.items() for pattern in of)
    return next((reason for reason, pattern in patterns if fnmatch.fnmatchcase(module, pattern)), "")


def _reason(module: str, name: str) -> str:
    if by_name := source.excluded(module).get(name):
        return f"by name: {by_name}"
    if module in source.ONLY and name not in source.ONLY[module]:
        return NOT_NAMED
    if module in source.MODULES:
        return NOT_DRAWN if name in source.mutable(module) else NOTHING
    return left_out_because(module) or "of a module that nobody has judged"
