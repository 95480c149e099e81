"""Named mistakes made in the reference of this very process, for as long as it takes to look at a scene.

`eos-ref power` loads a mutated reference in a process of its own, so that all that is built on it is built on the
mutation. Where many scenes are looked at with many mistakes that takes too long: here the code of the one function that
a mistake changes is exchanged, in every module that has it, and put back.
"""

from __future__ import annotations

import importlib
import types
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache, cached_property
from typing import Any

from eos_ref.errors import InputError
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from tests.workshop.faults import formula
from tests.workshop.faults.edits import split_name
from tests.workshop.faults.source import SourceFault


@contextmanager
def made(fault: str) -> Iterator[None]:
    """Have the reference make a mistake of ``formula.yaml``, named with its family.

    The compiled evaluator, whose machine code exists already, is not changed; arrays do without their compiled loops.

    Raises
    ------
    InputError
        A mistake of another kind, or in what is no function.
    """
    function, code = _changed(fault)
    right, function.__code__ = function.__code__, code
    loops, ArrayEvaluator.loops = ArrayEvaluator.loops, None
    try:
        yield
    finally:
        function.__code__, ArrayEvaluator.loops = right, loops


@cache
def _changed(fault: str) -> tuple[types.FunctionType, types.CodeType]:
    """Return the function that a mistake changes, and its mistaken code."""
    edit = formula.edits().get(fault)
    if edit is None:
        raise InputError("fault", "must be a change of the reference's source", fault)
    module, name = split_name(edit.function)
    of: Any = importlib.import_module(f"eos_ref.{module}")
    for part in name.split("."):
        of = vars(of)[part]
    of = of.fget if isinstance(of, property) else of.func if isinstance(of, cached_property) else of
    source = formula.faults()[fault]
    assert isinstance(source, SourceFault)
    code = _code(compile(source.text, f"{fault} in {module}", "exec", dont_inherit=True), name)
    if not isinstance(of, types.FunctionType) or code is None:
        raise InputError("fault", "must be in a function", f"{fault} in {name}")
    return of, code


def _code(of: types.CodeType, name: str) -> types.CodeType | None:
    """Return the code of a function by its qualified name among the constants of a module."""
    for part in (const for const in of.co_consts if isinstance(const, types.CodeType)):
        if part.co_qualname == name:
            return part
        if name.startswith(f"{part.co_qualname}.") and (inner := _code(part, name)):
            return inner
    return None
