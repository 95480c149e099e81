"""Named mistakes in the formulas of the reference, which stands in for LAMMPS, or breaks its own rules.

Those that the lint knows (`lammps_cases.verdict.mistakes`, `lammps_cases.verdict.mistakes`), and changes of
the reference's source written down in ``formula.yaml``, addressed by function and syntax tree.
"""

from __future__ import annotations

import ast
import importlib
import re
import sys
import textwrap
import types
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from pathlib import Path
from typing import Any, Literal

from pydantic import ConfigDict, TypeAdapter

from eos_ref.errors import InputError
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from lammps_cases.records.yaml_files import read_yaml
from lammps_cases.verdict import mistakes
from tests.workshop.faults.fault import Fault, Kind, by_id

EDITS = Path(__file__).with_name("formula.yaml")


@dataclass(frozen=True)
class LintFault(Fault):
    """A mistake that the lint knows, by its name there: in a law, or in a stage of the model."""

    table: Literal["law", "stage"]
    name: str


@dataclass(frozen=True)
class SourceFault(Fault):
    """A change of a function of the reference, ``eos_ref.MODULE:NAME``; see `edited`."""

    __pydantic_config__ = ConfigDict(extra="forbid")

    function: str
    replace: str
    by: str
    at: int | None = None


# What the lint's mistakes are; any other is a missing term.
_KINDS: dict[str, Kind] = {
    "cs instead of cs^2": "exponent",
    "rho0 and cs exchanged": "exchanged",
    "cs off by 1e-6": "constant",
    "sign of the pressure": "sign",
    "background subtracted": "sign",
    "A3 of the wrong sign": "sign",
    "exponent 7 for every Tait law": "exponent",
    "exponent off by one": "exponent",
    "linear instead of Tait or cubic": "option",
    "gamma instead of gamma - 1": "constant",
    "energy not per unit mass": "volume or mass",
    "types exchanged": "exchanged",
    "density in float32": "single precision",
    "pressure in float32": "single precision",
    "masses ignored": "volume or mass",
    "rho0 for rho in volumes": "volume or mass",
    "V_i for V_j": "volume or mass",
    "no volume in the force": "volume or mass",
    "temperature of the whole energy": "volume or mass",
    "one conductivity for all types": "exchanged",
}


@cache
def faults() -> dict[str, SourceFault | LintFault]:
    """Return all faults of this family by their id, in order."""
    planted: list[LintFault] = []
    for table, names in (("law", mistakes.LAW_MUTANTS), ("stage", mistakes.MODEL_MUTANTS)):
        for name in names:
            slug = "-".join(re.findall(r"[^\W_]+", name.lower()))
            planted.append(
                LintFault(f"formula.lint-{slug}", _KINDS.get(name, "missing term"), f"{name} (lint)", table, name)
            )
    return by_id((*planted, *edits().values()))


@cache
def edits() -> dict[str, SourceFault]:
    """Return the changes of the reference's source by their ids, in order."""
    every = TypeAdapter(list[SourceFault]).validate_python(read_yaml(EDITS, "faults"))
    return by_id(replace(edit, id=f"formula.{edit.id}") for edit in every)


def stages(fault: Fault) -> type[ArrayEvaluator] | None:
    """Return the stages that make a mistake of the lint's."""
    in_lint = isinstance(fault, LintFault) and fault.table == "stage"
    return mistakes.MODEL_MUTANTS[fault.name].stages if in_lint else None  # type: ignore[attr-defined]


# --- the source changed


def edited(text: str, fault: SourceFault) -> str:
    """Return a module's source with one expression, or one run of statements, replaced in one definition.

    ``replace`` and ``by`` are Python expressions, or statements, of which ``by`` may have none; ``at`` says which match
    is replaced, from 1 on; without it there must be exactly one.

    Raises
    ------
    InputError
        Text that is not Python, a name that the module does not define, no match, or several without ``at``.
    """
    name, at, where = fault.function.partition(":")[2], fault.at, fault.id
    old, new = _parsed(fault.replace, where), _parsed(fault.by, where)
    tree = ast.parse(text)
    inside = _definition(tree, name, where)
    if len(old) == len(new) == 1 and isinstance(old[0], ast.Expr) and isinstance(new[0], ast.Expr):
        matches = _expressions(inside, old[0].value, new[0].value)
    else:
        matches = _statements(inside, old, new)
    if not matches or (len(matches) > 1 if at is None else at > len(matches)):
        rule = f"must be in {name} once" if at is None else f"must be in {name} at least {at} times"
        raise InputError(f"source {fault.replace!r}", rule, f"{len(matches)} times", where)
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
    """Return the replacements of an expression, one for each place that has it."""
    changes: list[Callable[[], None]] = []
    for node in ast.walk(inside):
        for name, child in ast.iter_fields(node):
            if isinstance(child, list):
                changes += [partial(child.__setitem__, k, new) for k, part in enumerate(child) if _same(part, old)]
            elif _same(child, old):
                changes.append(partial(setattr, node, name, new))
    return changes


def _statements(inside: ast.AST, old: list[ast.stmt], new: list[ast.stmt]) -> list[Callable[[], None]]:
    """Return the replacements of a run of statements, one for each place that has it."""
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


# --- a mistake made in this process


@contextmanager
def plain_arrays() -> Iterator[None]:
    """Have arrays do without their compiled loops, of which a mistake changes nothing."""
    loops, ArrayEvaluator.loops = ArrayEvaluator.loops, None
    try:
        yield
    finally:
        ArrayEvaluator.loops = loops


@contextmanager
def made(fault: SourceFault) -> Iterator[None]:
    """Have the reference of this process make a mistake, in every module that has the function.

    The compiled evaluator, whose machine code exists already, is not changed.

    Raises
    ------
    InputError
        What is changed is not there, or is no function.
    """
    function, code = _changed(fault)
    right, function.__code__ = function.__code__, code
    try:
        with plain_arrays():
            yield
    finally:
        function.__code__ = right


@cache
def _changed(fault: SourceFault) -> tuple[types.FunctionType, types.CodeType]:
    """Return the function that a mistake changes, and its mistaken code."""
    module, _, name = fault.function.partition(":")
    of: Any = importlib.import_module(module)
    for part in name.split("."):
        of = vars(of)[part]
    of = of.fget if isinstance(of, property) else of.func if isinstance(of, cached_property) else of
    text = edited(Path(str(sys.modules[module].__file__)).read_text(encoding="utf-8"), fault)
    code = _code(compile(text, f"{fault.id} in {module}", "exec", dont_inherit=True), name)
    if not isinstance(of, types.FunctionType) or code is None:
        raise InputError("fault", "must be in a function", f"{fault.id} in {name}")
    return of, code


def _code(of: types.CodeType, name: str) -> types.CodeType | None:
    """Return the code of a function by its qualified name among the constants of a module."""
    for part in (const for const in of.co_consts if isinstance(const, types.CodeType)):
        if part.co_qualname == name:
            return part
        if name.startswith(f"{part.co_qualname}.") and (inner := _code(part, name)):
            return inner
    return None
