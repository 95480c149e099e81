"""The reference with changes: edits of its source and classes put before its own, and what it then predicts."""

from __future__ import annotations

import ast
import copy
import importlib
import inspect
import sys
import textwrap
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from functools import cache, cached_property, lru_cache, partial
from types import CodeType, FunctionType
from typing import Any

from eos_ref import EOSTable, InputError
from eos_ref.eos.table import FloatArray
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.blocks import in_blocks
from eos_ref.evaluation.time_step import Simulation
from lammps_cases.comparison.compare import EosState, evaluate
from lammps_cases.comparison.problem import Problem
from lammps_cases.comparison.trajectory import visit
from lammps_cases.scene.changes import Change

Classes = tuple[type[ArrayEvaluator], type[Simulation]]
PLAIN: Classes = (ArrayEvaluator, Simulation)
Replacement = tuple[Callable[[], None], Callable[[], None]]  # and back


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
def made(*changes: Change) -> Iterator[None]:
    """Apply the edits of some changes to the reference of this process, in every module that has its functions.

    Raises
    ------
    InputError
        The target does not exist, or is not a function.
    SyntaxError, TypeError, ValueError
        Edits that are not valid Python in their place.
    """
    by_function: dict[str, tuple[Change, ...]] = {}
    for change in changes:
        if change.function:
            by_function[change.function] = (*by_function.get(change.function, ()), change)
    codes = {function_of(path): _compiled(path, own) for path, own in by_function.items()}
    with installed(codes) if codes else nullcontext():
        yield


def joined(name: str, parts: Iterable[type | None], base: type) -> Any:
    """Return a class with several as bases, in order; a base of another one is left out."""
    given = dict.fromkeys(part for part in parts if part is not None)
    bases = tuple(part for part in given if not any(part in other.__mro__[1:] for other in given))
    # Named, as a prediction is kept only if the module of its stages is known.
    return type(name, bases, {"__module__": __name__}) if bases else base


def classes(changes: Sequence[Change], base: Classes = PLAIN) -> Classes:
    """Return stages and stepping with those of some changes before them.

    Raises
    ------
    TypeError
        A change and a base that is built on it.
    """
    stages, stepping = base
    if parts := [change.stages for change in changes if change.stages]:
        stages = joined("Stages", [*parts, stages], stages)
    if steps := [change.stepping for change in changes if change.stepping]:
        stepping = joined("Stepping", [*steps, stepping], stepping)
    return stages, stepping


def fields(problem: Problem, changes: Sequence[Change] = (), base: Classes = PLAIN) -> Generator[dict[str, Any]]:
    """Yield the fields of the reference with some changes at the steps of a problem; close it if it does not end."""
    with made(*changes):
        stages, stepping = classes(changes, base)
        sim: Simulation = problem.simulation(in_blocks(stages, len(problem.state.x_nc)), stepping)
        for _ in visit(sim, problem.steps, problem.timestep, problem.stops):
            yield {field: sim.output(field) for field in problem.fields}


def pressure(change: Change, table: EOSTable, state: EosState) -> FloatArray | None:
    """Return the pressure of every particle with a change, (n,); None if it changes no law, or cannot be evaluated."""
    if change.laws and not any(eval(change.laws, {"law": law, "table": table}) for law in table.laws):
        return None
    try:
        with made(change):
            return evaluate(change.table(table) if change.table else table, state)
    except (InputError, ArithmeticError):
        return None


def reaches(change: Change, codes: set[CodeType]) -> bool:
    """Return whether a run that went through some functions can show a change: one without an edit always can."""
    return not change.function or function_of(change.function).__code__ in codes


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


# --- the source


@cache
def function_of(path: str) -> FunctionType:
    """Return a function, a method, or that of a property by ``MODULE:QUALIFIED_NAME``.

    Raises
    ------
    InputError
        The module has none of this name.
    """
    module, _, name = path.partition(":")
    of: Any = importlib.import_module(module)
    for part in name.split("."):
        of = getattr(of, "__dict__", {}).get(part)
    of = of.fget if isinstance(of, property) else of.func if isinstance(of, cached_property) else of
    of = getattr(of, "__wrapped__", getattr(of, "__func__", of))
    if not isinstance(of, FunctionType):
        raise InputError("name", "must be that of a function in the reference's module", name, module)
    return of


@cache
def tree_of(module: str) -> ast.Module:
    """Return the syntax tree of a module."""
    return ast.parse(inspect.getsource(importlib.import_module(module)))


@cache
def definition(path: str) -> tuple[ast.FunctionDef, ast.Module]:
    """Return a function's definition, and a module of it alone, in classes as in its own: ``super`` needs them."""
    module, _, name = path.partition(":")
    node: Any = tree_of(module)
    for part in name.split("."):
        node = next(n for n in node.body if isinstance(n, ast.FunctionDef | ast.ClassDef) and n.name == part)
    assert isinstance(node, ast.FunctionDef)
    bare = copy.copy(node)
    bare.decorator_list = []
    body: ast.stmt = bare
    for part in reversed(name.split(".")[:-1]):
        body = ast.ClassDef(part, [], [], [body], [])
    return bare, ast.Module([ast.ImportFrom("__future__", [ast.alias("annotations")], 0), body], [])


@lru_cache(maxsize=4096)
def _compiled(path: str, changes: tuple[Change, ...]) -> CodeType:
    function = function_of(path)
    node, alone = definition(path)
    replacements = [each for change in changes for each in replaced(node, change)]
    try:
        for put, _ in replacements:
            put()
        ast.fix_missing_locations(alone)
        with warnings.catch_warnings(action="ignore", category=SyntaxWarning):  # such as `None is None`
            code = compile(alone, function.__code__.co_filename, "exec", dont_inherit=True)
    finally:
        for _, back in reversed(replacements):
            back()
    for _ in function.__qualname__.split("."):
        code = next(const for const in code.co_consts if isinstance(const, CodeType))
    return code


def replaced(node: ast.AST, change: Change) -> list[Replacement]:
    """Return the replacements that a change makes in a definition, each with the way back.

    ``replace`` and ``by`` are Python expressions, or statements, where ``by`` may be empty. The match is that of syntax
    trees: line breaks, comments and brackets do not matter.

    Raises
    ------
    InputError
        Not Python; no match, or several without ``at``.
    """
    old, new, at = _parsed(change.replace, change.id), _parsed(change.by, change.id), change.at
    if len(old) == len(new) == 1 and isinstance(old[0], ast.Expr) and isinstance(new[0], ast.Expr):
        matches = _expressions(node, old[0].value, new[0].value)
    else:
        matches = _statements(node, old, new)
    if not matches or (len(matches) > 1 if at is None else at > len(matches)):
        name = change.function.partition(":")[2]
        rule = f"must be in {name} once" if at is None else f"must be in {name} at least {max(at, 1)} times"
        raise InputError(f"source {change.replace!r}", rule, f"{len(matches)} times", change.id)
    return matches if at == 0 else [matches[(at or 1) - 1]]


def _parsed(text: str, where: str) -> list[ast.stmt]:
    try:
        return ast.parse(textwrap.dedent(text)).body
    except SyntaxError as error:
        raise InputError("source", f"must be Python ({error.msg})", text, where) from None


def _expressions(inside: ast.AST, old: ast.expr, new: ast.expr) -> list[Replacement]:
    """Return the replacements of an expression, one for each occurrence, in the order of `ast.walk`."""
    found: list[Replacement] = []
    for node, name, k, part in _places(inside).get(ast.dump(old), ()):
        put = partial(setattr, node, name) if k is None else partial(getattr(node, name).__setitem__, k)
        found.append((partial(put, new), partial(put, part)))
    return found


@lru_cache(maxsize=512)
def _places(inside: ast.AST) -> dict[str, list[tuple[ast.AST, str, int | None, ast.expr]]]:
    """Return parent, field, number and node of all expressions by what they are; a tree is restored after each edit."""
    places: dict[str, list[tuple[ast.AST, str, int | None, ast.expr]]] = {}
    for node in ast.walk(inside):
        for name, child in ast.iter_fields(node):
            for k, part in enumerate(child) if isinstance(child, list) else ((None, child),):
                if isinstance(part, ast.expr):
                    places.setdefault(ast.dump(part), []).append((node, name, k, part))
    return places


def _statements(inside: ast.AST, old: list[ast.stmt], new: list[ast.stmt]) -> list[Replacement]:
    """Return the replacements of a run of statements, one for each occurrence."""
    found: list[Replacement] = []
    texts = list(map(ast.dump, old))
    for body in bodies(inside):
        for k in range(len(body) - len(old) + 1):
            run = body[k : k + len(old)]
            if list(map(ast.dump, run)) == texts:
                by = new or [ast.Pass()] * (len(body) == len(old))
                back = partial(body.__setitem__, slice(k, k + len(by)), run)
                found.append((partial(body.__setitem__, slice(k, k + len(old)), by), back))
    return found


def bodies(node: ast.AST) -> Iterator[list[ast.stmt]]:
    """Yield all lists of statements in a tree."""
    for each in ast.walk(node):
        yield from (b for name in ("body", "orelse", "finalbody") if isinstance(b := getattr(each, name, None), list))
