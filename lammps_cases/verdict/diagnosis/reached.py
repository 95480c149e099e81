"""The functions of the reference called in a run, and the changes of each."""

from __future__ import annotations

import contextlib
import re
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, is_dataclass
from functools import cache
from inspect import CO_GENERATOR, CO_VARARGS, CO_VARKEYWORDS
from pathlib import Path
from types import CodeType, FrameType, FunctionType
from typing import Any

import numpy as np

from eos_ref import InputError
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.evaluator import Evaluator
from eos_ref.evaluation.time_step import Simulation
from eos_ref.kernels.styles import KERNELS
from lammps_cases.comparison.changed import function_of, made, tree_of
from lammps_cases.scene.changes import Change
from lammps_cases.verdict.diagnosis.edits import FunctionEdits, operands

# Modules with formulas; the others find pairs, propagate errors and read commands.
SHAPES = dict.fromkeys(style.kernel.shape.__module__.removeprefix("eos_ref.") for style in KERNELS.values())
MODULES = (
    "eos.laws", "eos.table", "eos.rounded_eos", *SHAPES, "kernels.kernel", "kernels.reproducing",
    "model.interactions", "model.per_atom", "evaluation.array_evaluator", "evaluation.evaluator",
    "evaluation.time_step", "numbers.matrices",
)  # fmt: skip
NO_FORMULA = {
    "pairs",
    "constant",
    "apart",
    "coincide",
    "output",
    "run",
    "conversion",
    "__init__",
    "_start",
    "__iter__",
    "__len__",
}


@dataclass(frozen=True)
class Reached:
    """A function, and one call of it: its arguments, its result, and its local variables at the end."""

    function: FunctionType
    arguments: Mapping[str, Any]
    result: Any
    scope: Mapping[str, Any]

    @property
    def words(self) -> str:
        """Return what it computes, by its docstring, and its location."""
        text = (self.function.__doc__ or "").partition("\n")[0]
        found = re.match(r"(?:Return|Evaluate|Set|Add|Take|Keep|Find) (.+?)(?:, \(|[,.;:(]|$)", text)
        name = self.function.__qualname__
        what = found[1].strip() if found else name.rpartition(".")[2].strip("_").replace("_", " ")
        path = Path(self.function.__code__.co_filename)
        return f"{what} ({name}, {path.parent.name}/{path.name}:{{}})"

    def edits(self) -> Iterator[Change]:
        """Yield its edits, except those that make no difference to the call."""
        again = self._repeatable()
        mine = "." in self.function.__qualname__ and isinstance(self.scope.get("self"), ArrayEvaluator)
        path = f"{self.function.__module__}:{self.function.__qualname__}"
        for edit in FunctionEdits(path, self.scope, self.words, _of_stages() if mine else ()):
            if not (again and self._idle(edit)):
                yield edit

    def _repeatable(self) -> bool:
        """Return whether the call can be repeated: it has a result, and leaves nothing changed."""
        if self.result is None or self.function.__code__.co_flags & (CO_VARARGS | CO_VARKEYWORDS | CO_GENERATOR):
            return False
        return not isinstance(self.scope.get("self"), Simulation) and self._as_before()

    def _as_before(self) -> bool:
        """Return whether repeating the call gives the same result."""
        try:
            with np.errstate(all="ignore"), warnings.catch_warnings():
                warnings.simplefilter("ignore")
                return _same(self.function(**self.arguments), self.result)
        except Exception:  # the evaluator has moved on to other particles
            return False

    def _idle(self, edit: Change) -> bool:
        """Return whether an edit makes no difference to the call, or no sense."""
        try:
            with made(edit):
                return self._as_before()
        except (InputError, SyntaxError, TypeError, ValueError):
            return True


@cache
def _of_stages() -> tuple[str, ...]:
    """Return the names that the stages of an evaluation take from the evaluator."""
    trees = (tree_of(of.__module__) for of in (ArrayEvaluator, Evaluator))
    return tuple(sorted({text for tree in trees for text in operands(tree) if text.startswith("self.")}))


def reached(run: Callable[[], Any]) -> list[Reached]:
    """Return the functions with formulas that a run calls, the last called first."""
    last: dict[CodeType, int] = {}
    begun: dict[FrameType, dict[str, Any]] = {}
    ended: dict[CodeType, tuple[str, dict[str, Any], Any, dict[str, Any]]] = {}
    calls = 0

    def watch(frame: FrameType, event: str, argument: object) -> None:
        nonlocal calls
        module = frame.f_globals.get("__name__", "").removeprefix("eos_ref.")
        if module not in MODULES or event not in ("call", "return"):
            return
        if event == "call":
            if frame.f_code not in ended:
                begun[frame] = dict(frame.f_locals)
            return
        calls += 1
        last[frame.f_code] = calls
        if (arguments := begun.pop(frame, None)) is not None and frame.f_code not in ended:
            ended[frame.f_code] = frame.f_globals["__name__"], arguments, argument, dict(frame.f_locals)

    before = sys.getprofile()
    sys.setprofile(watch)
    try:
        run()
    finally:
        sys.setprofile(before)
    found = []
    for code in sorted(last, key=last.__getitem__, reverse=True):
        module, arguments, result, scope = ended[code]
        with contextlib.suppress(InputError):  # a function within a function
            function = function_of(f"{module}:{code.co_qualname}")
            if function.__code__ is code and function.__name__ not in NO_FORMULA:
                found.append(Reached(function, arguments, result, scope))
    return found


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, list | tuple):
        return isinstance(b, list | tuple) and len(a) == len(b) and all(map(_same, a, b))
    if is_dataclass(a):
        return type(a) is type(b) and _same(list(vars(a).values()), list(vars(b).values()))
    if isinstance(a, np.ndarray | np.generic | float | int):
        return np.shape(a) == np.shape(b) and bool(np.array_equal(a, b, equal_nan=True))
    return a is b
