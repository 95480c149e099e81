"""The reference, changed in this process: functions whose source is edited, in every module that has them."""

from __future__ import annotations

import ast
import importlib
import sys
import textwrap
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache, cached_property, partial
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any

from eos_ref.errors import InputError
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from lammps_cases.scene.changes import Change


@contextmanager
def plain_arrays() -> Iterator[None]:
    """Evaluate arrays without their compiled loops, which an edit does not change."""
    loops, ArrayEvaluator.loops = ArrayEvaluator.loops, None
    try:
        yield
    finally:
        ArrayEvaluator.loops = loops


@contextmanager
def installed(codes: Mapping[FunctionType, CodeType]) -> Iterator[None]:
    """Run functions with other code, without compiled loops; the compiled evaluator is not changed."""
    right = {function: function.__code__ for function in codes}
    try:
        for function, code in codes.items():
            function.__code__ = code
        with plain_arrays():
            yield
    finally:
        for function, code in right.items():
            function.__code__ = code


@contextmanager
def made(change: Change) -> Iterator[None]:
    """Apply a change, which is an edit of the reference's source, to the reference of this process.

    Raises
    ------
    InputError
        The target does not exist, or is not a function.
    """
    function, code = _edited_function(change)
    with installed({function: code}):
        yield


def reaches(change: Change, codes: set[CodeType]) -> bool:
    """Return whether a run that went through some functions can show a change: one without an edit always can."""
    return not change.function or _edited_function(change)[0].__code__ in codes


def codes_of(run: Callable[[], object]) -> set[CodeType]:
    """Return the code of all functions that a run calls."""
    codes: set[CodeType] = set()
    before = sys.getprofile()
    sys.setprofile(lambda frame, event, argument: codes.add(frame.f_code))
    try:
        run()
    finally:
        sys.setprofile(before)
    return codes


@cache
def _edited_function(change: Change) -> tuple[FunctionType, CodeType]:
    module, _, name = change.function.partition(":")
    of: Any = importlib.import_module(module)
    for part in name.split("."):
        of = vars(of)[part]
    of = of.fget if isinstance(of, property) else of.func if isinstance(of, cached_property) else of
    text = edited(Path(str(sys.modules[module].__file__)).read_text(encoding="utf-8"), change)
    code = _code(compile(text, f"{change.id} in {module}", "exec", dont_inherit=True), name)
    if not isinstance(of, FunctionType) or code is None:
        raise InputError("change", "must be in a function", f"{change.id} in {name}")
    return of, code


def _code(of: CodeType, name: str) -> CodeType | None:
    """Return the code of a function by its qualified name among the constants of a module."""
    for part in (const for const in of.co_consts if isinstance(const, CodeType)):
        if part.co_qualname == name:
            return part
        if name.startswith(f"{part.co_qualname}.") and (inner := _code(part, name)):
            return inner
    return None


# --- the source


def edited(text: str, change: Change) -> str:
    """Return a module's source with one expression, or one run of statements, replaced in one definition.

    ``replace`` and ``by`` are Python expressions, or statements, where ``by`` may be empty; ``at`` selects the match
    that is replaced, from 1 on; without it there must be exactly one.

    Raises
    ------
    InputError
        The text is not Python, the module does not define the name, no match, or several without ``at``.
    """
    name, at, where = change.function.partition(":")[2], change.at, change.id
    old, new = _parsed(change.replace, where), _parsed(change.by, where)
    tree = ast.parse(text)
    inside = _definition(tree, name, where)
    if len(old) == len(new) == 1 and isinstance(old[0], ast.Expr) and isinstance(new[0], ast.Expr):
        matches = _expressions(inside, old[0].value, new[0].value)
    else:
        matches = _statements(inside, old, new)
    if not matches or (len(matches) > 1 if at is None else at > len(matches)):
        rule = f"must be in {name} once" if at is None else f"must be in {name} at least {at} times"
        raise InputError(f"source {change.replace!r}", rule, f"{len(matches)} times", where)
    matches[(at or 1) - 1]()
    return ast.unparse(tree)


def _definition(tree: ast.Module, name: str, where: str) -> ast.AST:
    node: ast.AST = tree
    for part in name.split("."):
        inner = [child for child in getattr(node, "body", ()) if getattr(child, "name", "") == part]
        if not inner:
            raise InputError("name", "must be that of a definition in the reference's module", name, where)
        node = inner[0]
    return node


def _parsed(text: str, where: str) -> list[ast.stmt]:
    try:
        return ast.parse(textwrap.dedent(text)).body
    except SyntaxError as error:
        raise InputError("source", f"must be Python ({error.msg})", text, where) from None


def _expressions(inside: ast.AST, old: ast.expr, new: ast.expr) -> list[Callable[[], None]]:
    """Return the replacements of an expression, one for each occurrence."""
    changes: list[Callable[[], None]] = []
    for node in ast.walk(inside):
        for name, child in ast.iter_fields(node):
            if isinstance(child, list):
                changes += [partial(child.__setitem__, k, new) for k, part in enumerate(child) if _same(part, old)]
            elif _same(child, old):
                changes.append(partial(setattr, node, name, new))
    return changes


def _statements(inside: ast.AST, old: list[ast.stmt], new: list[ast.stmt]) -> list[Callable[[], None]]:
    """Return the replacements of a run of statements, one for each occurrence."""
    bodies = (getattr(node, name, None) for node in ast.walk(inside) for name in ("body", "orelse", "finalbody"))
    return [
        partial(body.__setitem__, slice(k, k + len(old)), new or [ast.Pass()] * (len(body) == len(old)))
        for body in bodies
        if isinstance(body, list)
        for k in range(len(body) - len(old) + 1)
        if all(map(_same, body[k : k + len(old)], old))
    ]


def _same(node: object, wanted: ast.AST) -> bool:
    return isinstance(node, ast.AST) and type(node) is type(wanted) and ast.dump(node) == ast.dump(wanted)
